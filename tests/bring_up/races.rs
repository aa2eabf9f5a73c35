//! What meets the step timer at any instant: a halt, an event that is appended, a write of the reload value.

use cortex_m::peripheral::SYST;
use leadscrew::stepper::{EventTap, EventWriter, StepEvent};

use super::{
    CYCLES_PER_TICK, Facts, RUNS, Relaxed, SEGMENTS, Wait, clock, due_between, finish, handler,
    start, step_timer,
};

/// Rounds of [`halt_often`], half a second on a board; the events of each, and the ticks between them.
const ROUNDS: u32 = 10_000;
const EMULATED_ROUNDS: u32 = 1000;
const ROUND_EVENTS: u32 = 8;
const ROUND_TICKS: u32 = 256;

/// Halts the timer at another instant in each round, and counts what comes after that.
pub(super) fn halt_often(facts: &mut Facts, writer: &mut EventWriter<'static>) {
    let rounds = if super::super::emulation::is_emulated() {
        EMULATED_ROUNDS
    } else {
        ROUNDS
    };
    let (mut after, mut played, mut halted) = (0, 0, 0);
    for round in 0..rounds {
        let before = writer.tap().output_count();
        for _ in 0..ROUND_EVENTS {
            writer.push(StepEvent::new(ROUND_TICKS, 0, 1));
        }
        start(writer);
        let span = i64::from(ROUND_EVENTS * ROUND_TICKS) * CYCLES_PER_TICK;
        clock::wait(i64::from(round) * span / i64::from(rounds));
        halted += i64::from(halt(writer.tap()));
        let runs = RUNS.load(Relaxed);
        clock::wait(i64::from(2 * ROUND_TICKS) * CYCLES_PER_TICK);
        after += i64::from(RUNS.load(Relaxed).wrapping_sub(runs));
        // The rest, from where it was halted.
        start(writer);
        finish(Wait::Running);
        played += i64::from(writer.tap().output_count().wrapping_sub(before));
    }
    for (what, number) in [
        ("pushed", i64::from(rounds * ROUND_EVENTS)),
        ("played", played),
        ("halted", halted),
        ("after_halt", after),
    ] {
        facts.put_of("step.halts", what, number);
    }
}

/// Halts the timer, as [`StepInterrupt`] of the firmware does. Returns whether it ran.
fn halt(tap: EventTap<'_>) -> bool {
    cortex_m::interrupt::free(|_| {
        step_timer::halt();
        let was_running = SEGMENTS.is_running();
        tap.halt(&SEGMENTS);
        was_running
    })
}

/// Instants of [`append_often`] and [`reload_often`], cycles before and after the timer comes round: the emulator
/// needs some 60 for a look at the clock.
const SPAN: i64 = 200;
/// How often each instant is met; the ticks before the event that is appended, of a time that no other has.
const APPEND_REPEATS: u32 = 4;
const APPENDED_TICKS: u32 = 331;

/// Appends an event behind the last at another instant in each round: either it comes in its time, or the timer
/// has stopped, and it comes after another start.
pub(super) fn append_often(facts: &mut Facts, writer: &mut EventWriter<'static>) {
    let (mut pushed, mut in_time, mut too_late) = (0, 0, 0);
    let (mut least, mut most) = (i64::MAX, i64::MIN);
    let (late, before) = (writer.tap().late(), writer.tap().output_count());
    for phase in -SPAN..=SPAN {
        for _ in 0..APPEND_REPEATS {
            pushed += 3;
            // Two, as the emulator's timer begins with the time of the second.
            for _ in 0..2 {
                writer.push(StepEvent::new(ROUND_TICKS, 0, 1));
            }
            start(writer);
            clock::wait(i64::from(2 * ROUND_TICKS) * CYCLES_PER_TICK + phase);
            append(writer, StepEvent::new(APPENDED_TICKS, 0, 1));
            finish(Wait::Running);
            if writer.has_pending() {
                too_late += 1;
                start(writer);
                finish(Wait::Running);
            } else if let Some(handler) = handler() {
                in_time += 1;
                let due = due_between(handler.stamps[1], handler.stamps[2]);
                let deviation = due - i64::from(APPENDED_TICKS) * CYCLES_PER_TICK;
                (least, most) = (least.min(deviation), most.max(deviation));
            }
        }
    }
    for (what, number) in [
        ("pushed", pushed),
        (
            "played",
            writer.tap().output_count().wrapping_sub(before).into(),
        ),
        ("in_time", in_time),
        ("too_late", too_late),
        ("late", writer.tap().late().wrapping_sub(late).into()),
        ("least", least),
        ("most", most),
    ] {
        facts.put_of("step.appends", what, number);
    }
}

/// Appends an event, as the end of a run of `prepare` does.
fn append(writer: &mut EventWriter<'static>, event: StepEvent) {
    writer.push(event);
    if let Some(event) = writer.appended_late(&SEGMENTS) {
        step_timer::set_reload(event);
        writer.append(event);
    }
}

/// How often each instant of [`reload_often`] is met.
const RELOAD_REPEATS: u32 = 8;
/// The time in the reload register before the write and after it, ticks.
const OLD_TICKS: u32 = 512;
const NEW_TICKS: u32 = 1024;
/// A write this many cycles before the counter begins anew counts, and one so many after it does not.
const CLEAR_CYCLES: i64 = 16;

/// Writes the reload value around the reload of the counter, without interrupts. The counter must take the value that
/// the register had at the reload, old or new.
pub(super) fn reload_often(facts: &mut Facts) {
    let (mut new, mut old, mut wrong) = (0, 0, 0);
    let mut off = 0;
    for phase in -SPAN..=SPAN {
        for _ in 0..RELOAD_REPEATS {
            let Reloaded { at, value } = reload(phase);
            let [from_old, from_new] = [OLD_TICKS, NEW_TICKS]
                .map(|ticks| (value - i64::from(ticks) * CYCLES_PER_TICK).abs());
            let is_new = from_new < from_old;
            off = off.max(from_old.min(from_new));
            if is_new {
                new += 1;
                wrong += i64::from(at > CLEAR_CYCLES);
            } else {
                old += 1;
                wrong += i64::from(at < -CLEAR_CYCLES);
            }
        }
    }
    for (what, number) in [("new", new), ("old", old), ("wrong", wrong), ("off", off)] {
        facts.put_of("step.reloads", what, number);
    }
}

/// When the reload value was written, cycles from the instant at which the counter began anew, and with what
/// it did, cycles.
struct Reloaded {
    at: i64,
    value: i64,
}

fn reload(phase: i64) -> Reloaded {
    step_timer::set_up(StepEvent::new(OLD_TICKS, 0, 1));
    step_timer::start(StepEvent::new(OLD_TICKS, 0, 1));
    // The counter has begun when it is no longer zero.
    while SYST::get_current() == 0 {}
    let (left, begin) = (SYST::get_current(), clock::now());
    let since_begin = || clock::cycles(clock::now().wrapping_sub(begin));
    // It is zero in so many cycles, and begins anew one later.
    let due = i64::from(left) + 1;
    while since_begin() < due + phase {}
    step_timer::set_reload(StepEvent::new(NEW_TICKS, 0, 1));
    let at = since_begin() - due;
    while since_begin() < due + 2 * SPAN {}
    let (left, now) = (SYST::get_current(), since_begin());
    step_timer::halt();
    Reloaded {
        at,
        value: i64::from(left) + now - due + 1,
    }
}
