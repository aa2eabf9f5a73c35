//! The application: which task owns what, and at which priority.
//!
//! | task        | kind, vector      | priority | released by                              |
//! |-------------|-------------------|----------|------------------------------------------|
//! | `step`      | hardware, TIM2    | 4        | the step timer                           |
//! | `serial_rx` | hardware, USART   | 3        | a byte in, a byte out, something to send |
//! | `prepare`   | pended, I2C3\_EV  | 2        | `step`, `serial_rx`, `interpret`         |
//! | `wake`      | pended, I2C3\_ER  | 1        | `serial_rx`, `prepare`                   |
//! | `interpret` | async, dispatcher | 1        | `wake`                                   |
//! | `report`    | async, dispatcher | 1        | `wake`                                   |
//! | `idle`      |                   | 0        |                                          |
//!
//! Pended tasks borrow the vectors of a peripheral that the machine does not use: pending a vector
//! while its task runs makes the task run again, so no release is ever lost. Tasks above priority 1
//! never touch a waker, which is a pointer to a function; they pend `wake`, which does.
//!
//! Tasks only move values between queues, peripherals and the state machines of the library. What
//! flows goes through queues with one writer and one reader; the snapshot alone is locked, for the
//! time of a copy.

#[rtic::app(device = crate::board::pac, peripherals = true, dispatchers = [I2C2_EV])]
mod app {
    use core::task::Waker;

    use heapless::spsc::{Consumer, Producer, Queue};
    use leadscrew::{
        machine::{Inputs, Snapshot},
        planner::{Entry, Motion},
        protocol::{
            Progress, Session,
            realtime::{self, Release, Requests},
        },
        settings::Settings,
        sim::{ENTRY_RING, RECEIVED_RING, SENT_RING},
        stepper::{EventReader, EventRing, EventWriter, StepCounts, Stepper},
    };

    use crate::board::{
        self,
        release::{PREPARE, WAKE, released},
        serial, step_output,
    };

    /// Bytes left to send when a task that waits for room is woken, besides none.
    const SENT_HALF: usize = SENT_RING / 2;

    #[shared]
    struct Shared {
        /// Written by `prepare`, copied by `interpret` and `report`.
        snapshot: Snapshot,
        /// The session and its queues. Priority 1 only, as are the two after it.
        dialogue: (Session, Consumer<'static, u8>, Producer<'static, u8>),
        interpret_waker: Option<Waker>,
        report_waker: Option<Waker>,
        /// Atomics, shared by reference and never locked.
        requests: Requests,
        inputs: Inputs,
        counts: StepCounts,
    }

    #[local]
    struct Local {
        output: board::StepOutput,
        port: board::SerialPort,
        motion: &'static mut Motion,
        received_in: Producer<'static, u8>,
        sent_out: Consumer<'static, u8>,
        entries_in: Producer<'static, Entry>,
        entries_out: Consumer<'static, Entry>,
        events_in: EventWriter<'static>,
        events_out: EventReader<'static>,
    }

    #[init(local = [
        motion_memory: Motion = Motion::new(),
        received: Queue<u8, RECEIVED_RING> = Queue::new(),
        sent: Queue<u8, SENT_RING> = Queue::new(),
        entries: Queue<Entry, ENTRY_RING> = Queue::new(),
        events: EventRing = EventRing::new(),
    ])]
    fn init(cx: init::Context) -> (Shared, Local) {
        let settings = Settings::default();
        let board = board::init(cx.device, cx.core, &settings);
        let motion = cx.local.motion_memory;
        let inputs = Inputs::new();
        motion.power_up(&settings, &inputs);
        let (received_in, received_out) = cx.local.received.split();
        let (sent_in, sent_out) = cx.local.sent.split();
        let (entries_in, entries_out) = cx.local.entries.split();
        let (events_in, events_out) = cx.local.events.split();
        interpret::spawn().expect("it has not been spawned before");
        report::spawn().expect("it has not been spawned before");
        let shared = Shared {
            snapshot: *motion.snapshot(),
            dialogue: (Session::new(settings), received_out, sent_in),
            interpret_waker: None,
            report_waker: None,
            requests: Requests::new(),
            inputs,
            counts: StepCounts::new(),
        };
        let local = Local {
            output: board.output,
            port: board.serial,
            motion,
            received_in,
            sent_out,
            entries_in,
            entries_out,
            events_in,
            events_out,
        };
        (shared, local)
    }

    #[idle]
    fn idle(_: idle::Context) -> ! {
        board::idle()
    }

    /// Outputs the event that is due and takes the next.
    ///
    /// Deadline: before the next event. A miss delays that event, and is counted; no step is lost.
    #[task(
        binds = TIM2, priority = 4, shared = [&counts],
        local = [output, events_out, stepper: Stepper = Stepper::new()]
    )]
    fn step(cx: step::Context) {
        let (events, counts) = (cx.local.events_out, cx.shared.counts);
        cx.local.output.write();
        let is_late = if let Some(event) = events.take_within_segment() {
            cx.local.output.set_up(event)
        } else {
            rtic::pend(PREPARE);
            cx.local.output.turn(cx.local.stepper, events, counts)
        };
        if is_late {
            counts.count_late();
        }
    }

    /// Takes one byte in and puts one out.
    ///
    /// Deadline: one byte time. A miss loses a byte.
    #[task(
        binds = USART1, priority = 3, local = [port, received_in, sent_out], shared = [&requests]
    )]
    fn serial_rx(cx: serial_rx::Context) {
        let port = cx.local.port;
        if let Some(byte) = port.receive() {
            match realtime::receive(byte, cx.shared.requests, cx.local.received_in) {
                Release::Nobody => {}
                Release::Interpret | Release::Report => rtic::pend(WAKE),
                Release::Prepare => rtic::pend(PREPARE),
            }
            // One byte in or one out: what is to be sent may have been pended by the same vector.
            if cx.local.sent_out.ready() {
                serial::again();
            }
        } else if port.can_send() {
            let byte = cx.local.sent_out.dequeue();
            port.send(byte);
            if byte.is_some() && matches!(cx.local.sent_out.len(), 0 | SENT_HALF) {
                rtic::pend(WAKE);
            }
        }
    }

    /// Keeps the event queue filled.
    ///
    /// Deadline: before the events in the queue have been played. A miss is a fault: alarm.
    #[task(
        binds = I2C3_EV, priority = 2, local = [motion, entries_out, events_in],
        shared = [snapshot, &requests, &inputs, &counts]
    )]
    fn prepare(mut cx: prepare::Context) {
        let (motion, entries) = (cx.local.motion, cx.local.entries_out);
        let (events, counts) = (cx.local.events_in, cx.shared.counts);
        let prepared = motion.run(
            cx.shared.requests,
            cx.shared.inputs,
            counts,
            entries,
            events,
        );
        if prepared.start {
            step_output::start();
        }
        if prepared.again {
            rtic::pend(PREPARE);
        }
        if prepared.news {
            rtic::pend(WAKE);
        }
        cx.shared
            .snapshot
            .lock(|snapshot| *snapshot = *motion.snapshot());
    }

    /// Wakes the endless tasks.
    #[task(binds = I2C3_ER, priority = 1, shared = [interpret_waker, report_waker, &requests])]
    fn wake(mut cx: wake::Context) {
        let wake = |waker: &mut Option<Waker>| waker.iter().for_each(Waker::wake_by_ref);
        cx.shared.interpret_waker.lock(wake);
        if cx.shared.requests.wants_status() {
            cx.shared.report_waker.lock(wake);
        }
    }

    /// Executes received lines.
    #[task(
        priority = 1, local = [entries_in],
        shared = [snapshot, dialogue, interpret_waker, &requests]
    )]
    async fn interpret(mut cx: interpret::Context) -> ! {
        let (requests, entries) = (cx.shared.requests, cx.local.entries_in);
        loop {
            let snapshot = cx.shared.snapshot.lock(|snapshot| *snapshot);
            let progress = cx.shared.dialogue.lock(|(session, received, sent)| {
                let entered = session.entered();
                let progress = session.run(&snapshot, requests, received, sent, entries);
                // The length of the queue would not do: `prepare` may take entries meanwhile.
                if session.entered() != entered {
                    rtic::pend(PREPARE);
                }
                // Settings change at rest only, and nothing moves before the session goes on.
                step_output::follow(session.settings());
                serial::start(sent);
                progress
            });
            if progress == Progress::Waiting {
                released(&mut cx.shared.interpret_waker).await;
            }
        }
    }

    /// Answers `?`, within 5 ms.
    #[task(
        priority = 1,
        shared = [snapshot, dialogue, report_waker, &requests]
    )]
    async fn report(mut cx: report::Context) -> ! {
        let requests = cx.shared.requests;
        loop {
            let snapshot = cx.shared.snapshot.lock(|snapshot| *snapshot);
            let progress = cx.shared.dialogue.lock(|(session, received, sent)| {
                let free = received.capacity() - received.len();
                let progress = session.report(&snapshot, requests, free, sent);
                serial::start(sent);
                progress
            });
            if progress == Progress::Waiting {
                released(&mut cx.shared.report_waker).await;
            }
        }
    }
}
