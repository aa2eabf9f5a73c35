//! The step timer and the body of `step`, without pins: when events come, and when they should.
//!
//! The handler of the step timer is the firmware's, but where the firmware writes the pins, this handler takes the
//! time, and how long ago the event was due by the timer itself. So the delay of an interrupt does not count, and the
//! times between events must be exact.

use core::{
    cell::UnsafeCell,
    sync::atomic::{AtomicU32, Ordering::Relaxed},
};

use cortex_m::peripheral::{SCB, SYST, scb::SystemHandler};
use leadscrew::{
    model::queues::EVENT_RING,
    stepper::{EventReader, EventRing, EventWriter, SegmentRing, StepEvent, Upcoming},
    tasks::{self, StepPlatform},
};

use super::{Facts, clock, echo, pac, priorities, trace, vectors::nvic_priority};

#[path = "races.rs"]
mod races;
#[path = "../../src/board/step_timer.rs"]
#[allow(dead_code, reason = "no task is released")]
mod step_timer;

/// Cycles of the processor in a tick.
const CYCLES_PER_TICK: i64 = 2;
/// The shortest time between events that the firmware makes, ticks.
const SHORTEST: u32 = 128;
/// Most events of a script.
const SAMPLES: usize = 512;

/// A sequence of times between events.
struct Script {
    name: &'static str,
    events: usize,
    /// Returns the ticks before an event.
    ticks: fn(u32) -> u32,
}

const SCRIPTS: [Script; 4] = [
    Script {
        name: "shortest",
        events: SAMPLES,
        ticks: |_| SHORTEST,
    },
    Script {
        name: "longest",
        events: 16,
        ticks: |_| StepEvent::MAX_TICKS,
    },
    Script {
        name: "alternating",
        events: 32,
        ticks: |index| {
            if index.is_multiple_of(2) {
                SHORTEST
            } else {
                StepEvent::MAX_TICKS
            }
        },
    },
    Script {
        name: "random",
        events: SAMPLES,
        ticks: |index| SHORTEST + scatter(index) % 1024,
    },
];

/// Returns a number that looks like any other.
const fn scatter(index: u32) -> u32 {
    let mixed = (index ^ index >> 7).wrapping_mul(0x9e37_79b1);
    (mixed ^ mixed >> 15).wrapping_mul(0x85eb_ca77) >> 8
}

/// How the main program waits for the end of a script.
#[derive(Clone, Copy)]
enum Wait {
    Running,
    Sleeping,
    /// The interrupt of the sender's USART runs as often as it can.
    Flooded,
}

/// When an event came, and for how many cycles it had been due.
#[derive(Clone, Copy)]
struct Stamp {
    time: u32,
    age: u32,
}

/// What the handler of the step timer has. It runs only between [`step_timer::start`] and the end of a script,
/// while the main program does not use it.
struct Handler {
    timer: step_timer::StepTimer,
    events: EventReader<'static>,
    stamps: [Stamp; SAMPLES],
    count: usize,
}

/// Returns whether the step timer runs, for code that erases or programs flash.
#[inline(always)]
#[expect(clippy::inline_always, reason = "nothing in flash may be called")]
pub(super) fn is_running() -> bool {
    step_timer::is_running()
}

struct Shared(UnsafeCell<Option<Handler>>);

#[expect(unsafe_code, reason = "a handler has no arguments")]
// SAFETY: as tells `Handler`.
unsafe impl Sync for Shared {}

static HANDLER: Shared = Shared(UnsafeCell::new(None));
static SEGMENTS: SegmentRing = SegmentRing::new();
/// Runs of the handler.
static RUNS: AtomicU32 = AtomicU32::new(0);

#[expect(unsafe_code, reason = "a handler has no arguments")]
fn handler() -> &'static mut Option<Handler> {
    // SAFETY: as tells `Handler`.
    unsafe { &mut *HANDLER.0.get() }
}

/// The platform of `step`, without pins.
struct Stamping<'a> {
    timer: &'a mut step_timer::StepTimer,
    stamps: &'a mut [Stamp; SAMPLES],
    count: &'a mut usize,
}

impl StepPlatform for Stamping<'_> {
    #[inline]
    fn output(&mut self) {
        let stamp = stamp();
        if let Some(place) = self.stamps.get_mut(*self.count) {
            *place = stamp;
        }
        *self.count += 1;
    }

    #[inline]
    fn set_reload(&mut self, following: StepEvent) -> u32 {
        self.timer.set_reload(following).is_late() & 1
    }

    #[inline]
    fn set_up(&mut self, _event: StepEvent) {}

    #[inline]
    fn pend_segment_start(&mut self, _event: StepEvent) {}

    #[inline]
    fn stop(&mut self) {
        let _ = self.timer.stop();
    }
}

/// Takes the time. The counter began at the value that is still in the reload register.
#[inline(always)]
#[expect(clippy::inline_always, reason = "it is three reads of registers")]
fn stamp() -> Stamp {
    let (reload, count) = (SYST::get_reload(), SYST::get_current());
    Stamp {
        time: clock::now(),
        age: reload.wrapping_sub(count),
    }
}

#[expect(unsafe_code, reason = "the runtime wants such a function")]
mod exception {
    use cortex_m_rt::exception;

    #[exception]
    unsafe fn SysTick() {
        super::run();
    }
}

fn run() {
    RUNS.store(RUNS.load(Relaxed).wrapping_add(1), Relaxed);
    if let Some(Handler {
        timer,
        events,
        stamps,
        count,
    }) = handler()
    {
        let mut platform = Stamping {
            timer,
            stamps,
            count,
        };
        tasks::step(&mut platform, events, &SEGMENTS);
    }
}

/// Plays all scripts, and halts in the middle of others.
pub(super) fn play_all(facts: &mut Facts, scb: &mut SCB, timer: SYST) {
    let ring =
        cortex_m::singleton!(: EventRing = EventRing::new()).expect("this is the first time");
    let (mut writer, reader) = ring.split();
    *handler() = Some(Handler {
        timer: step_timer::StepTimer::new(timer),
        events: reader,
        stamps: [Stamp { time: 0, age: 0 }; SAMPLES],
        count: 0,
    });
    set_priority(scb);
    for script in &SCRIPTS {
        play(facts, script, &mut writer, Wait::Running, "running");
    }
    for script in SCRIPTS.iter().filter(|script| script.events == SAMPLES) {
        play(facts, script, &mut writer, Wait::Flooded, "flooded");
    }
    // The emulator's time jumps in a sleep.
    if !super::emulation::is_emulated() {
        for script in &SCRIPTS {
            play(facts, script, &mut writer, Wait::Sleeping, "sleeping");
        }
    }
    races::halt_often(facts, &mut writer);
    races::append_often(facts, &mut writer);
    cortex_m::interrupt::disable();
    races::reload_often(facts);
}

#[expect(unsafe_code, reason = "an exception that RTIC does not manage")]
fn set_priority(scb: &mut SCB) {
    // SAFETY: nothing shares anything under a lock of priorities.
    unsafe {
        scb.set_priority(SystemHandler::SysTick, nvic_priority(priorities::STEP));
        cortex_m::interrupt::enable();
    }
}

/// Starts the timer with what has been pushed, as [`StepInterrupt`] of the firmware does.
fn start(writer: &mut EventWriter<'static>) {
    if let Some(handler) = handler() {
        handler.count = 0;
    }
    if let Some(Upcoming { event, following }) = writer.set_up() {
        step_timer::set_up(event);
        cortex_m::interrupt::free(|_| {
            SEGMENTS.start();
            step_timer::start(following);
        });
    }
}

/// Waits until everything has been played.
fn finish(wait: Wait) {
    while SEGMENTS.is_running() {
        match wait {
            Wait::Running => {}
            Wait::Sleeping => cortex_m::asm::wfe(),
            Wait::Flooded => pac::NVIC::pend(pac::Interrupt::USART1),
        }
    }
}

fn play(
    facts: &mut Facts,
    script: &Script,
    writer: &mut EventWriter<'static>,
    wait: Wait,
    waiting: &str,
) {
    let late_before = writer.tap().late();
    let served_before = echo::served_early();
    for index in 0..script.events as u32 {
        writer.push(StepEvent::new((script.ticks)(index), 0, 1));
    }
    start(writer);
    finish(wait);
    let Some(handler) = handler() else {
        return;
    };
    let mut name = heapless::String::<40>::new();
    let _ = core::fmt::Write::write_fmt(&mut name, format_args!("step.{}.{waiting}", script.name));
    let deviations = deviations(script, &handler.stamps);
    let ages = handler.stamps[..script.events]
        .iter()
        .map(|stamp| i64::from(stamp.age));
    for (what, number) in [
        ("pushed", signed(script.events)),
        ("played", signed(handler.count)),
        ("late", writer.tap().late().wrapping_sub(late_before).into()),
        (
            "served",
            echo::served_early().wrapping_sub(served_before).into(),
        ),
        ("least", deviations.clone().min().unwrap_or_default()),
        ("most", deviations.max().unwrap_or_default()),
        ("total", total(script, &handler.stamps)),
        ("entry_least", ages.clone().min().unwrap_or_default()),
        ("entry_most", ages.max().unwrap_or_default()),
    ] {
        facts.put_of(&name, what, number);
    }
}

fn signed(count: usize) -> i64 {
    i64::from(count as u32)
}

/// Returns how many cycles each time between two events is longer than it should be.
fn deviations<'a>(
    script: &'a Script,
    stamps: &'a [Stamp; SAMPLES],
) -> impl Iterator<Item = i64> + Clone + 'a {
    let pairs = stamps[..script.events].windows(2).enumerate();
    pairs.map(|(index, pair)| {
        let due = due_between(pair[0], pair[1]);
        due - CYCLES_PER_TICK * i64::from((script.ticks)(index as u32 + 1))
    })
}

/// Returns how many cycles the time from the first event to the last is longer than it should be.
fn total(script: &Script, stamps: &[Stamp; SAMPLES]) -> i64 {
    let due = due_between(stamps[0], stamps[script.events - 1]);
    let ticks = (1..script.events as u32).map(script.ticks);
    due - CYCLES_PER_TICK * ticks.map(i64::from).sum::<i64>()
}

/// Returns the cycles between the times at which two events were due.
fn due_between(first: Stamp, second: Stamp) -> i64 {
    let taken = clock::cycles(second.time.wrapping_sub(first.time));
    taken - (i64::from(second.age) - i64::from(first.age))
}

const _: () = assert!(SAMPLES < EVENT_RING);
