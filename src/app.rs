//! The application: which task owns what, and at which priority.
//!
//! | task        | kind, vector      | priority | released by                              |
//! |-------------|-------------------|----------|------------------------------------------|
//! | `step`      | hardware, TIM2    | 4        | the step timer                           |
//! | `serial_rx` | hardware, USART   | 3        | a byte in, a byte out, something to send |
//! | `inputs`    | hardware, TIM7    | 3        | an edge on an input pin, its timer       |
//! | `prepare`   | pended, TIM6      | 2        | all others, its timer                    |
//! | `wake`      | pended, I2C3\_ER  | 1        | `serial_rx`, `prepare`                   |
//! | `interpret` | async, dispatcher | 1        | `wake`                                   |
//! | `report`    | async, dispatcher | 1        | `wake`                                   |
//! | `idle`      |                   | 0        |                                          |
//!
//! Pended tasks borrow the vector of a peripheral that the machine does not use, or of a timer that
//! also releases them: pending a vector while its task runs makes the task run again, so no release
//! is ever lost. Tasks above priority 1
//! never touch a waker, which is a pointer to a function; they pend `wake`, which does.
//!
//! Tasks only move values between queues, peripherals and the state machines of the library. What
//! flows goes through queues with one writer and one reader; the snapshot alone is locked: what
//! `prepare` waits for is the time of a copy.

#[rtic::app(device = crate::board::pac, peripherals = true, dispatchers = [I2C2_EV])]
mod app {
    use core::task::Waker;

    use heapless::spsc::{Consumer, Producer, Queue};
    use leadscrew::{
        machine::{Inputs, Snapshot},
        planner::{Entry, Motion},
        protocol::{ByteReader, ByteWriter, Bytes, Progress, Session, realtime::Requests},
        sim::{ENTRY_RING, RECEIVED_RING, SENT_RING},
        stepper::{EventReader, EventRing, EventWriter, StepCounts, Stepper},
    };

    use crate::board::{
        self,
        release::{PREPARE, released},
        serial, step_output,
    };

    #[shared]
    struct Shared {
        /// Written by `prepare`, copied by `interpret` and `report`.
        snapshot: Snapshot,
        /// The session and its queues. Priority 1 only, as are the two after it.
        dialogue: (Session, ByteReader<'static>, ByteWriter<'static>),
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
        pins: board::InputPins,
        after: board::AfterPrepare,
        motion: &'static mut Motion,
        received_in: ByteWriter<'static>,
        sent_out: ByteReader<'static>,
        storage: board::Storage,
        entries_in: Producer<'static, Entry>,
        entries_out: Consumer<'static, Entry>,
        events_in: EventWriter<'static>,
        events_out: EventReader<'static>,
    }

    #[init(local = [
        motion_memory: Motion = Motion::new(),
        received: Bytes<RECEIVED_RING> = Bytes::new(),
        sent: Bytes<SENT_RING> = Bytes::new(),
        entries: Queue<Entry, ENTRY_RING> = Queue::new(),
        events: EventRing = EventRing::new(),
    ])]
    fn init(cx: init::Context) -> (Shared, Local) {
        let board = board::init(cx.device, cx.core);
        let motion = cx.local.motion_memory;
        let (received_in, received_out) = cx.local.received.split();
        let (sent_in, sent_out) = cx.local.sent.split();
        let (entries_in, entries_out) = cx.local.entries.split();
        let (events_in, events_out) = cx.local.events.split();
        interpret::spawn().expect("it has not been spawned before");
        report::spawn().expect("it has not been spawned before");
        let (pins, inputs) = board.inputs.watch(events_in.tap());
        let snapshot = motion.power_up(&board.loaded.stored.settings, &inputs);
        rtic::pend(PREPARE);
        let session = Session::new(&board.loaded.stored, board.loaded.is_first_boot);
        let shared = Shared {
            snapshot,
            dialogue: (session, received_out, sent_in),
            interpret_waker: None,
            report_waker: None,
            requests: Requests::new(),
            inputs,
            counts: StepCounts::new(),
        };
        let local = Local {
            output: board.output,
            port: board.serial,
            pins,
            after: board.after,
            motion,
            received_in,
            sent_out,
            storage: board.storage,
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
        let (received, sent) = (cx.local.received_in, cx.local.sent_out);
        cx.local.port.serve(cx.shared.requests, received, sent);
    }

    /// Filters switches, probe and buttons.
    ///
    /// Deadline: one step time while probing. A miss tells a position that is as much too late.
    #[task(binds = TIM7, priority = 3, local = [pins], shared = [&requests, &inputs, &counts])]
    fn inputs(cx: inputs::Context) {
        let (requests, inputs) = (cx.shared.requests, cx.shared.inputs);
        cx.local.pins.serve(requests, inputs, cx.shared.counts);
    }

    /// Keeps the event queue filled.
    ///
    /// Deadline: before the events in the queue have been played. A miss is a fault: alarm.
    #[task(
        binds = TIM6_DAC, priority = 2, local = [motion, entries_out, events_in, after],
        shared = [snapshot, &requests, &inputs, &counts]
    )]
    fn prepare(mut cx: prepare::Context) {
        let (motion, entries) = (cx.local.motion, cx.local.entries_out);
        let (events, counts) = (cx.local.events_in, cx.shared.counts);
        cx.local.after.begin(cx.shared.requests);
        let (requests, inputs) = (cx.shared.requests, cx.shared.inputs);
        // Of those who use it, this task has the highest priority: nobody waits for the lock.
        let prepared = cx
            .shared
            .snapshot
            .lock(|snapshot| motion.run(requests, inputs, counts, entries, events, snapshot));
        cx.local.after.follow(prepared, motion.outputs(), counts);
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
        priority = 1, local = [entries_in, storage],
        shared = [snapshot, dialogue, interpret_waker, &requests]
    )]
    async fn interpret(mut cx: interpret::Context) -> ! {
        let (requests, entries) = (cx.shared.requests, cx.local.entries_in);
        let storage = cx.local.storage;
        let mut snapshot = Snapshot::default();
        loop {
            let read = |shared: &mut Snapshot| snapshot.take_over(shared);
            cx.shared.snapshot.lock(read);
            let progress = cx.shared.dialogue.lock(|(session, received, sent)| {
                let entered = session.entered();
                let progress = session.run(&snapshot, requests, received, sent, entries);
                let new = session.entered().wrapping_sub(entered) as usize;
                // While an older entry waits, `prepare` looks again by itself.
                if session.takes_release() | (new != 0 && entries.len() <= new) {
                    rtic::pend(PREPARE);
                }
                let progress = storage.serve(session).unwrap_or(progress);
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
        let mut snapshot = Snapshot::default();
        loop {
            let read = |shared: &mut Snapshot| snapshot.take_over(shared);
            cx.shared.snapshot.lock(read);
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
