//! The rings of events and of segments: `prepare` writes, `step` and `segment_start` interrupt it and each other, and
//! `inputs` halts them all.

use std::{cell::RefCell, rc::Rc};

use leadscrew::{
    atomic::{AtomicU32, Ordering::Relaxed, Pending, Task, barrier, end},
    axis::Axes,
    model::{Power, queues::EVENT_RING},
    stepper::{
        AxisMotion, EventReader, EventRing, EventTap, EventWriter, Generator, Segment, SegmentRing,
        StepEvent, Upcoming,
    },
    tasks::{self, StepPlatform},
    units::FineSteps,
};

use super::{Shared, expect, needs_fences, possible, shared};

/// Ticks of the first event of the first scenario.
const TICKS: u32 = 1000;
/// Events of a segment that wait when the next is made.
const LAST_EVENTS: u32 = 2;
/// Events that are output at most: more are without end.
const MOST_OUTPUT: usize = 20;

/// The step timer, which begins anew with its reload value as an interrupt comes, and the pins.
struct Timer {
    is_running: bool,
    /// What is being counted, half ticks less one.
    counted: u32,
    /// Volatile, which a compiler may move over accesses that are not.
    reload: &'static AtomicU32,
    set_up: Option<StepEvent>,
    output: Vec<StepEvent>,
    /// Whether `segment_start` is released.
    is_start_pending: bool,
    wrong: Option<String>,
}

struct Pins(Shared<Timer>);

impl StepPlatform for Pins {
    fn output(&mut self) {
        let reload = self.0.borrow().reload.load(Relaxed);
        let timer = &mut *self.0.borrow_mut();
        let Some(event) = timer.set_up.take() else {
            timer
                .wrong
                .get_or_insert("an interrupt without an event".into());
            return;
        };
        if event.half_ticks_less_one() != timer.counted {
            let wrong = format!("{event:?} comes after {}", timer.counted);
            timer.wrong.get_or_insert(wrong);
        }
        timer.output.push(event);
        timer.is_running &= timer.output.len() < MOST_OUTPUT;
        timer.counted = reload;
    }

    fn set_reload(&mut self, following: StepEvent) -> u32 {
        let reload = self.0.borrow().reload;
        reload.store(following.half_ticks_less_one(), Relaxed);
        0
    }

    fn set_up(&mut self, event: StepEvent) {
        self.0.borrow_mut().set_up = Some(event);
    }

    fn pend_segment_start(&mut self, event: StepEvent) {
        self.0.borrow_mut().is_start_pending |= event.is_boundary();
    }

    fn stop(&mut self) {
        let mut timer = self.0.borrow_mut();
        timer.is_running = false;
        timer.is_start_pending = true;
    }
}

/// The rings and who uses them, for all executions.
struct Machine {
    events: Shared<EventWriter<'static>>,
    reader: Shared<EventReader<'static>>,
    event_tap: EventTap<'static>,
    segments: &'static SegmentRing,
    reload: &'static AtomicU32,
}

impl Machine {
    fn new() -> Self {
        let (events, reader) = Box::leak(Box::new(EventRing::new())).split();
        Self {
            event_tap: events.tap(),
            events: shared(events),
            reader: shared(reader),
            segments: Box::leak(Box::new(SegmentRing::new())),
            reload: Box::leak(Box::new(AtomicU32::new(0))),
        }
    }

    /// Fills the ring with events that have been output, for a reader that looks too early.
    fn wear(self) -> Self {
        for number in 0..5000 {
            self.events.borrow_mut().push(StepEvent::new(77, 2, 0));
            if number == 0 {
                let _ = self.events.borrow_mut().set_up();
            }
            let _ = self.reader.borrow_mut().advance();
        }
        self
    }

    fn timer(&self) -> Shared<Timer> {
        shared(Timer {
            is_running: false,
            counted: 0,
            reload: self.reload,
            set_up: None,
            output: Vec::new(),
            is_start_pending: false,
            wrong: None,
        })
    }

    /// Starts the steps, as `prepare` does: the token of the timer is locked.
    fn start(&self, timer: &Shared<Timer>) {
        let Some(Upcoming { event, following }) = self.events.borrow_mut().set_up() else {
            return;
        };
        self.segments.start();
        self.reload.store(following.half_ticks_less_one(), Relaxed);
        let timer = &mut *timer.borrow_mut();
        timer.set_up = Some(event);
        timer.counted = event.half_ticks_less_one();
        timer.is_running = true;
        timer.is_start_pending = true;
    }

    /// The event that comes.
    fn step(&self, timer: &Shared<Timer>) -> Box<dyn Fn()> {
        let (reader, segments) = (self.reader.clone(), self.segments);
        let pins = RefCell::new(Pins(timer.clone()));
        Box::new(move || tasks::step(&mut *pins.borrow_mut(), &mut reader.borrow_mut(), segments))
    }

    /// `step`, as long as the timer runs, so many times at most.
    fn step_task(&self, timer: &Shared<Timer>, times: u32) -> Task {
        let left = shared(times);
        let (step, is_left, timer) = (self.step(timer), left.clone(), timer.clone());
        Task {
            priority: 5,
            pending: Box::new(move || {
                possible(timer.borrow().is_running && *is_left.borrow() != 0)
            }),
            run: Box::new(move || {
                *left.borrow_mut() -= 1;
                step();
            }),
        }
    }

    /// The part of `inputs` that halts the steps, with the token of the timer locked.
    fn halt_task(&self, timer: &Shared<Timer>, is_halted: &Shared<bool>) -> Task {
        let (segments, event_tap) = (self.segments, self.event_tap);
        let (timer, is_over) = (timer.clone(), is_halted.clone());
        let (running, is_halted) = (timer.clone(), is_halted.clone());
        Task {
            // That of the token: no event comes meanwhile.
            priority: 5,
            pending: Box::new(move || possible(running.borrow().is_running && !*is_over.borrow())),
            run: Box::new(move || {
                *is_halted.borrow_mut() = true;
                let mut timer = timer.borrow_mut();
                timer.is_running = false;
                timer.set_up = None;
                event_tap.halt(segments);
            }),
        }
    }

    /// `segment_start`, when it has been released. It sets `duties`.
    fn start_task(&self, timer: &Shared<Timer>, duties: &Shared<Vec<u16>>) -> Task {
        let (segments, event_tap) = (self.segments, self.event_tap);
        let (timer, duties, released) = (timer.clone(), duties.clone(), timer.clone());
        Task {
            priority: 3,
            pending: Box::new(move || {
                if released.borrow().is_start_pending {
                    Pending::Certain
                } else {
                    Pending::Never
                }
            }),
            run: Box::new(move || {
                timer.borrow_mut().is_start_pending = false;
                let begun = segments.start_segment(event_tap);
                duties.borrow_mut().extend(begun.duty);
                timer.borrow_mut().is_start_pending |= begun.has_more;
            }),
        }
    }

    /// Sets the time of an event that has been appended too late, as `prepare` does.
    fn append_late(&self) {
        let events = &mut *self.events.borrow_mut();
        if let Some(event) = events.appended_late(self.segments) {
            self.reload.store(event.half_ticks_less_one(), Relaxed);
            events.append(event);
        }
    }
}

/// Events that wait, and two more that `prepare` pushes behind them while they are played.
fn pushed_behind(waiting: u32, played: u32, with_halt: bool) -> usize {
    let machine = Rc::new(Machine::new().wear());
    needs_fences(|| {
        let timer = machine.timer();
        let is_halted = shared(false);
        for number in 0..waiting {
            let event = StepEvent::new(TICKS + number, 1, 0);
            machine.events.borrow_mut().push(event);
        }
        machine.start(&timer);
        let mut tasks = vec![machine.step_task(&timer, played)];
        if with_halt {
            tasks.push(machine.halt_task(&timer, &is_halted));
        }
        let machine = machine.clone();
        (tasks, move || {
            for number in waiting..waiting + 2 {
                let event = StepEvent::new(TICKS + number, 1, 0);
                machine.events.borrow_mut().push(event);
                machine.append_late();
            }
            barrier();
            end();
            let step = machine.step(&timer);
            while !*is_halted.borrow() {
                while timer.borrow().is_running {
                    step();
                }
                let has_pending = machine.events.borrow().has_pending();
                if !has_pending || timer.borrow().output.len() >= MOST_OUTPUT {
                    break;
                }
                machine.start(&timer);
            }
            let timer = timer.borrow();
            expect(&timer.wrong, &None, "events")?;
            let ticks: Vec<u32> = timer.output.iter().map(|event| event.ticks()).collect();
            let mut all: Vec<u32> = (TICKS..TICKS + waiting + 2).collect();
            if *is_halted.borrow() {
                all.truncate(ticks.len());
            }
            expect(&ticks, &all, "events that have been output")
        })
    })
}

#[test]
fn each_event_is_output_once_and_in_its_time() {
    for waiting in 1..=3 {
        assert_eq!(pushed_behind(waiting, 3, false), 3);
    }
    for waiting in 1..=2 {
        assert_eq!(pushed_behind(waiting, 2, true), 3);
    }
}

/// A segment of one step of X, with a duty of its own.
fn segment(steps: i64, duty: u16) -> Segment {
    let mut axes = Axes::from_fn(|_| AxisMotion::default());
    axes[0].to = FineSteps(steps << 32);
    Segment {
        ticks: 60_000,
        axes,
        line: duty.into(),
        power: Power { duty, ..Power::OFF },
        ..Segment::NONE
    }
}

/// Two segments and a standstill, of which the first is played while the others are made.
fn segments(steps: u32, with_halt: bool) -> usize {
    let machine = Rc::new(Machine::new());
    needs_fences(|| {
        let timer = machine.timer();
        let (duties, is_halted) = (shared(Vec::new()), shared(false));
        let mut generator = Generator::new();
        let push = {
            let machine = machine.clone();
            move |generator: &mut Generator| {
                assert!(generator.push_events(&mut machine.events.borrow_mut()));
                machine.append_late();
            }
        };
        generator.begin(&segment(1, 1), machine.segments);
        push(&mut generator);
        machine.start(&timer);
        let start = machine.start_task(&timer, &duties);
        (start.run)();
        // All but the last events of the first segment are over.
        let (all, step) = (EVENT_RING as u32, machine.step(&timer));
        while all - machine.events.borrow().room() > LAST_EVENTS {
            step();
        }
        let mut tasks = vec![
            machine.step_task(&timer, steps),
            machine.start_task(&timer, &duties),
        ];
        if with_halt {
            tasks.push(machine.halt_task(&timer, &is_halted));
        }
        let machine = machine.clone();
        (tasks, move || {
            generator.begin(&segment(2, 2), machine.segments);
            push(&mut generator);
            let (steps, _, line) = machine.segments.status();
            barrier();
            end();
            // As `report` has seen it.
            expect(&(line < 2 || steps[0] == 1), &true, "the steps of the line")?;
            let run_start = || {
                while (start.pending)() == Pending::Certain {
                    (start.run)();
                }
            };
            run_start();
            if !*is_halted.borrow() {
                generator.begin_standstill(Power::OFF, machine.segments);
                push(&mut generator);
                while machine.events.borrow().has_pending() {
                    if !timer.borrow().is_running {
                        machine.start(&timer);
                    }
                    while timer.borrow().is_running {
                        step();
                        run_start();
                    }
                }
                expect(&*duties.borrow(), &vec![1, 2, 0], "duties")?;
            } else {
                generator.discard_unplayed(machine.segments, &mut machine.events.borrow_mut());
            }
            let timer = timer.borrow();
            expect(&timer.wrong, &None, "events")?;
            let raised = timer.output.iter().filter(|event| event.raise() != 0);
            expect(&generator.steps()[0], &(raised.count() as i32), "steps")
        })
    })
}

#[test]
fn each_segment_begins_once_and_in_order() {
    assert_eq!(segments(2, false), 2);
}

#[test]
fn a_halt_leaves_the_position_of_the_steps_that_have_been_output() {
    assert_eq!(segments(1, true), 0);
}
