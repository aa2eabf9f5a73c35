//! The application: which task owns what, and at which priority.
//!
//! | task            | kind, vector      | priority | released by                              |
//! |-----------------|-------------------|----------|------------------------------------------|
//! | `step`          | hardware, SysTick | 5        | the step timer                           |
//! | `serial_rx`     | hardware, USART   | 4        | a byte has come                          |
//! | or `usb`        | hardware, TIM11   | 4        | TIM11                                    |
//! | `segment_start` | pended, I2C3\_EV  | 3        | `step`: a segment begins, or motion ends |
//! | `inputs`        | hardware, TIM10   | 3        | an edge on an input pin, TIM10           |
//! | `prepare`       | pended, TIM9      | 2        | `segment_start`, most others, TIM9       |
//! | `wake`          | pended, TIM4      | 1        | `serial_rx`, `prepare`, TIM4, `idle`     |
//! | `usb_control`   | pended, I2C1\_ER  | 1        | `usb`                                    |
//! | `interpret`     | async, dispatcher | 1        | `wake`                                   |
//! | `report`        | async, dispatcher | 1        | `wake`                                   |
//! | `idle`          |                   | 0        | runs while no other task does            |
//!
//! A board has `serial_rx`, or with the feature `usb` both tasks of USB.
//!
//! A pended task binds the vector of an unused peripheral, or of a timer that also releases the task: TIM4 runs only in
//! firmware with the RepRap dialect. Pending a vector while its task runs makes the task run again, so no release is
//! lost. Tasks above priority 1 use no waker, which calls through a pointer; they pend `wake`, which wakes `interpret`
//! and `report`.
//!
//! Tasks only move values between queues, peripherals and the state machines of the library. Data
//! goes through queues with one writer and one reader. Tasks with deadlines lock two resources: the
//! snapshot, where `prepare` waits for the end of a copy, and the token of the step timer, where
//! `segment_start` and `inputs` wait.

#[rtic::app(device = crate::board::pac, peripherals = true, dispatchers = [I2C2_EV])]
mod app {
    use core::{mem::MaybeUninit, task::Waker};

    use heapless::spsc::{Consumer, Producer, Queue};
    use leadscrew::{
        machine::{Inputs, Snapshot},
        model::{
            Requests,
            queues::{ENTRY_RING, SENT_RING},
        },
        motion::Motion,
        path::Entry,
        protocol::{ByteReader, Bytes, Incoming, IncomingWriter, Progress, Session},
        stepper::{EventReader, EventRing, EventTap, EventWriter, SegmentRing},
        tasks::{self, SharedAtomics},
    };

    // In place of RTIC's own, by the name that its generated code uses.
    use crate::board::handlers as rtic;
    use crate::board::{
        self, ChipPlatform, SerialSession, StepInterrupt, host_clock,
        release::{await_idle, awaits_idle, end_round, released},
        trace,
        vectors::PREPARE,
    };

    #[shared]
    struct Shared {
        /// Written by `prepare`, copied by `interpret` and `report`.
        snapshot: Snapshot,
        /// Locked by tasks of priority 1 at most, as are the two wakers.
        serial: SerialSession,
        interpret_waker: Option<Waker>,
        report_waker: Option<Waker>,
        /// Locked by `prepare` and `inputs`.
        step_timer: board::StepTimerToken,
        /// Made of atomics: shared by reference and never locked, as are the two after it.
        requests: &'static Requests,
        inputs: Inputs,
        segments: SegmentRing,
    }

    #[local]
    struct Local {
        output: board::StepPins,
        #[cfg(not(feature = "usb"))]
        receiver: board::Receiver,
        #[cfg(not(feature = "usb"))]
        reception: IncomingWriter<'static>,
        #[cfg(feature = "usb")]
        usb: board::UsbLink,
        #[cfg(feature = "usb")]
        usb_reception: IncomingWriter<'static>,
        #[cfg(feature = "usb")]
        usb_sent: ByteReader<'static>,
        #[cfg(feature = "usb")]
        usb_control: board::UsbControl,
        pins: board::InputPins,
        actuators: board::Actuators,
        motion: &'static mut Motion,
        line_level: board::LineLevel,
        storage: &'static mut board::Storage,
        flash_erase_in: IncomingWriter<'static>,
        entries_in: Producer<'static, Entry>,
        entries_out: Consumer<'static, Entry>,
        events_in: EventWriter<'static>,
        events_out: EventReader<'static>,
        event_tap: EventTap<'static>,
    }

    #[init(local = [
        motion_memory: board::MotionMemory = board::MotionMemory::new(),
        session_memory: MaybeUninit<Session> = MaybeUninit::uninit(),
        storage_memory: MaybeUninit<board::Storage> = MaybeUninit::uninit(),
        incoming: Incoming = Incoming::new(),
        #[cfg(feature = "usb")]
        usb_memory: board::UsbMemory = board::UsbMemory::new(),
        sent: Bytes<SENT_RING> = Bytes::new(),
        entries: Queue<Entry, ENTRY_RING> = Queue::new(),
        events: EventRing = EventRing::new(),
    ])]
    fn init(cx: init::Context) -> (Shared, Local) {
        let memory = board::Memory {
            storage: cx.local.storage_memory,
            session: cx.local.session_memory,
        };
        let board = board::init(cx.device, cx.core, memory);
        let motion = cx.local.motion_memory.power_up();
        let (requests, reception, received_out) = cx.local.incoming.split();
        let (sent, sent_out) = cx.local.sent.split();
        let (entries_in, entries_out) = cx.local.entries.split();
        let (events_in, events_out) = cx.local.events.split();
        let event_tap = events_in.tap();
        interpret::spawn().expect("it has not been spawned before");
        report::spawn().expect("it has not been spawned before");
        let (pins, inputs) = board.inputs.watch(event_tap);
        if !board.session.damaged().is_empty() {
            motion.lock();
        }
        let snapshot = motion.power_up(board.session.settings(), &inputs, board.alarm);
        // It switches the outputs, reads the door and arms the limit switches.
        rtic::pend(PREPARE);
        let line_level = board::LineLevel::new(reception.count());
        let flash_erase_in = reception.second();
        #[cfg(not(feature = "usb"))]
        let transmitter = board::Transmitter::new(sent_out);
        #[cfg(feature = "usb")]
        let transmitter = board::Transmitter;
        #[cfg(feature = "usb")]
        let (usb, usb_control) = cx.local.usb_memory.split(board.usb);
        let shared = Shared {
            snapshot,
            serial: SerialSession::new(board.session, received_out, sent, transmitter, event_tap),
            interpret_waker: None,
            report_waker: None,
            step_timer: board.step_timer,
            requests,
            inputs,
            segments: SegmentRing::new(),
        };
        let local = Local {
            output: board.output,
            #[cfg(not(feature = "usb"))]
            receiver: board.receiver,
            #[cfg(not(feature = "usb"))]
            reception,
            #[cfg(feature = "usb")]
            usb,
            #[cfg(feature = "usb")]
            usb_reception: reception,
            #[cfg(feature = "usb")]
            usb_sent: sent_out,
            #[cfg(feature = "usb")]
            usb_control,
            pins,
            actuators: board.actuators,
            motion,
            line_level,
            flash_erase_in,
            storage: board.storage,
            entries_in,
            entries_out,
            events_in,
            events_out,
            event_tap,
        };
        (shared, local)
    }

    /// Feeds the watchdog, lets `interpret` go on, looks for a break on the line, sends the bytes that the USART did
    /// not take at once, hands over to a bootloader if one is wanted, and sleeps.
    #[idle(local = [line_level], shared = [serial, &requests])]
    fn idle(mut cx: idle::Context) -> ! {
        let requests = cx.shared.requests;
        loop {
            board::watchdog::feed();
            end_round();
            cx.local.line_level.check(requests);
            let (is_sending, bootloader) = cx
                .shared
                .serial
                .lock(|serial| (serial.send_remaining(requests), serial.wanted_bootloader()));
            if bootloader.is_some() && !is_sending {
                board::bootloader::await_sender();
                let wanted = |serial: &mut SerialSession| serial.wanted_bootloader();
                if let Some(bootloader) = cx.shared.serial.lock(wanted) {
                    board::bootloader::enter(bootloader);
                }
            }
            if !is_sending && !awaits_idle() {
                board::sleep();
            }
        }
    }

    /// Outputs the event that is due and sets up the next: the same work for any number of axes.
    ///
    /// Deadline: before the next event. A miss delays later events, and is counted; no step is lost.
    #[task(binds = SysTick, priority = 5, local = [output, events_out], shared = [&segments])]
    fn step(cx: step::Context) {
        let _activation = trace::step();
        let (output, events) = (cx.local.output, cx.local.events_out);
        tasks::step(output, events, cx.shared.segments);
    }

    /// Takes the received byte.
    ///
    /// Deadline: one byte time. A miss loses a byte.
    #[cfg(not(feature = "usb"))]
    #[task(binds = USART1, priority = 4, local = [receiver, reception])]
    fn serial_rx(cx: serial_rx::Context) {
        let _activation = trace::serial_rx();
        cx.local.receiver.serve(cx.local.reception);
    }

    /// Moves packets between the host and the queues.
    ///
    /// Deadline: its period. A miss makes the host wait.
    #[cfg(feature = "usb")]
    #[task(binds = TIM1_TRG_COM_TIM11, priority = 4, local = [usb, usb_reception, usb_sent])]
    fn usb(cx: usb::Context) {
        let _activation = trace::usb();
        cx.local
            .usb
            .serve(cx.local.usb_reception, cx.local.usb_sent);
    }

    /// Answers requests of the host that are not data.
    #[cfg(feature = "usb")]
    #[task(binds = I2C1_ER, priority = 1, local = [usb_control], shared = [&requests])]
    fn usb_control(cx: usb_control::Context) {
        cx.local.usb_control.serve(cx.shared.requests);
    }

    /// Begins the segment whose first event `step` has set up.
    ///
    /// Deadline: before two more segments begin. A miss delays the change of the laser's power.
    #[task(binds = I2C3_EV, priority = 3, local = [event_tap], shared = [&segments])]
    fn segment_start(cx: segment_start::Context) {
        let _activation = trace::segment_start();
        tasks::segment_start(cx.shared.segments, *cx.local.event_tap, &mut ChipPlatform);
    }

    /// Filters switches, probe and buttons.
    ///
    /// Deadline: one step time while probing. A miss latches a position that is late by the delay.
    #[task(
        binds = TIM1_UP_TIM10, priority = 3, local = [pins],
        shared = [step_timer, &requests, &inputs, &segments]
    )]
    fn inputs(cx: inputs::Context) {
        let _activation = trace::inputs();
        let shared = SharedAtomics::new(cx.shared.requests, cx.shared.inputs, cx.shared.segments);
        cx.local.pins.serve(shared, cx.shared.step_timer);
    }

    /// Keeps the event queue filled.
    ///
    /// Deadline: before the events in the queue have been played. A miss is a fault: alarm.
    #[task(
        binds = TIM1_BRK_TIM9, priority = 2, local = [motion, entries_out, events_in, actuators],
        shared = [snapshot, step_timer, &requests, &inputs, &segments]
    )]
    fn prepare(mut cx: prepare::Context) {
        let _activation = trace::prepare();
        let (motion, entries) = (cx.local.motion, cx.local.entries_out);
        let (events, actuators) = (cx.local.events_in, cx.local.actuators);
        let shared = SharedAtomics::new(cx.shared.requests, cx.shared.inputs, cx.shared.segments);
        let steps = &mut StepInterrupt {
            token: cx.shared.step_timer,
            event_tap: events.tap(),
        };
        // This task has the highest priority of all that lock the snapshot: no task waits for this lock.
        let snapshot = &mut cx.shared.snapshot;
        tasks::prepare(motion, entries, events, shared, snapshot, steps, actuators);
    }

    /// Wakes `interpret`, and `report` if a status report is requested.
    #[task(binds = TIM4, priority = 1, shared = [interpret_waker, report_waker, &requests])]
    fn wake(mut cx: wake::Context) {
        if host_clock::take_tick() {
            cx.shared.requests.tick();
        }
        let wake = |waker: &mut Option<Waker>| waker.iter().for_each(Waker::wake_by_ref);
        cx.shared.interpret_waker.lock(wake);
        if cx.shared.requests.wants_status() {
            cx.shared.report_waker.lock(wake);
        }
    }

    /// Executes received lines, one run for each release: `idle` feeds the watchdog between two runs.
    #[task(
        priority = 1, local = [entries_in, storage, flash_erase_in],
        shared = [snapshot, serial, interpret_waker, &requests, &inputs, &segments]
    )]
    async fn interpret(mut cx: interpret::Context) -> ! {
        let (requests, entries) = (cx.shared.requests, cx.local.entries_in);
        let (inputs, segments) = (cx.shared.inputs, cx.shared.segments);
        let storage = cx.local.storage;
        storage.receive_while_erasing(cx.local.flash_erase_in.second());
        let mut snapshot = Snapshot::default();
        loop {
            let read = |shared: &mut Snapshot| snapshot.copy_from(shared, segments, inputs);
            cx.shared.snapshot.lock(read);
            let run = |serial: &mut SerialSession| {
                let store = |change, erasing, stored: &_, tools: &_| {
                    storage.write(change, erasing, stored, tools)
                };
                serial.run(&snapshot, requests, inputs, segments, entries, store)
            };
            if cx.shared.serial.lock(run) == Progress::Again {
                await_idle();
            }
            released(&mut cx.shared.interpret_waker, || !awaits_idle()).await;
        }
    }

    /// Answers `?`: in the time that tasks with deadlines leave.
    #[task(priority = 1, shared = [snapshot, serial, report_waker, &requests, &inputs, &segments])]
    async fn report(mut cx: report::Context) -> ! {
        let requests = cx.shared.requests;
        let (inputs, segments) = (cx.shared.inputs, cx.shared.segments);
        let mut snapshot = Snapshot::default();
        loop {
            let read = |shared: &mut Snapshot| snapshot.copy_from(shared, segments, inputs);
            cx.shared.snapshot.lock(read);
            let report = |serial: &mut SerialSession| serial.report(&snapshot, requests);
            // A `?` that has come meanwhile releases it again.
            cx.shared.serial.lock(report);
            released(&mut cx.shared.report_waker, || true).await;
        }
    }
}
