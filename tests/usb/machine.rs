//! The whole machine behind a USB port: jobs, realtime bytes, and what a lost link does.

use leadscrew::{
    model::{State, queues::RECEIVED_RING},
    settings::{Settings, StepRate, assign},
    sim::{Edge, Simulator},
    units::TICKS_PER_MS,
};
use otg::{Core, Host, Silicon, System};
use usb_machine::{Device, PERIOD_US};

use crate::board::{NAME, UNIQUE, silicons};

const PERIOD_TICKS: u64 = PERIOD_US * TICKS_PER_MS as u64 / 1000;

/// A machine whose port a host has opened.
struct UsbMachine {
    device: Device,
    host: Host,
    edges: Vec<Edge>,
    /// What the host has fetched.
    text: String,
}

impl UsbMachine {
    /// With these assignments; the welcome has been read.
    fn new(silicon: Silicon, assignments: &[&str]) -> (Core, Self) {
        let simulator = Box::new(Simulator::new(&assigned(assignments)));
        let mut machine = Self {
            device: Device::new(simulator, NAME, UNIQUE),
            host: Host::default(),
            edges: Vec::new(),
            text: String::new(),
        };
        let mut core = Core::new(silicon);
        let mut host = Host::default();
        let device = &mut |core: &mut Core| machine.period(core);
        let result = host.enumerate(&mut core, System::Linux, device);
        assert_eq!(result, Ok(()), "{silicon:?}");
        machine.host = host;
        machine.run(&mut core, 50);
        assert!(
            machine.text.ends_with("Grbl 1.1h ['$' for help]\r\n"),
            "{}",
            machine.text
        );
        machine.text.clear();
        (core, machine)
    }

    fn period(&mut self, core: &mut Core) {
        let edges = &mut self.edges;
        self.device.period(core, &mut |edge| edges.push(*edge));
    }

    /// Some periods pass, and the host fetches what there is.
    fn run(&mut self, core: &mut Core, periods: usize) {
        for _ in 0..periods {
            self.period(core);
            let packet = self.host.take(core).unwrap_or_default();
            self.text
                .push_str(std::str::from_utf8(&packet).expect("answers are ASCII"));
        }
    }

    /// Sends bytes as fast as the device takes them.
    fn send(&mut self, core: &mut Core, bytes: &[u8]) {
        for packet in bytes.chunks(64) {
            while !self.host.offer(core, packet) {
                self.run(core, 1);
            }
        }
    }

    /// Sets DTR, or clears it.
    fn set_open(&mut self, core: &mut Core, is_open: bool) {
        let host = self.host.clone();
        let device = &mut |core: &mut Core| self.period(core);
        assert_eq!(host.set_lines(core, u16::from(is_open), device), Ok(()));
        self.run(core, 4);
    }

    fn state(&self) -> State {
        self.device.simulator.snapshot().state
    }

    fn duty(&self) -> u16 {
        self.device.simulator.outputs().duty
    }
}

/// What is proven of chips at 168 MHz.
const PROVEN_RATE_HZ: u32 = 190_000;

fn assigned(assignments: &[&str]) -> Settings {
    let mut settings = Settings::new(StepRate::Proven(PROVEN_RATE_HZ));
    for assignment in assignments {
        assign(&mut settings, assignment.as_bytes()).expect("the test assigns what there is");
    }
    settings
}

const FAST: [&str; 4] = ["110=6000", "111=6000", "120=500", "121=500"];

/// The edges of a job over a port without limits.
fn edges_without_usb(assignments: &[&str], job: &[u8]) -> Vec<u32> {
    let mut simulator = Simulator::new(&assigned(assignments));
    let mut edges = Vec::new();
    let mut bytes = job.iter();
    let mut next = bytes.next();
    simulator.settle();
    loop {
        while simulator.received_free() > 0
            && let Some(byte) = next
        {
            simulator.receive(*byte);
            next = bytes.next();
        }
        while simulator.send().is_some() {}
        let end = simulator.now() + PERIOD_TICKS;
        edges.extend(simulator.advance(end));
        if next.is_none()
            && simulator.due().is_none()
            && simulator.received_free() == RECEIVED_RING - 1
        {
            return edges.iter().map(|edge: &Edge| edge.raise).collect();
        }
    }
}

#[test]
fn a_job_over_usb_makes_the_steps_that_it_makes_without() {
    let job = include_bytes!("../../examples/plate.nc");
    let expected = edges_without_usb(&FAST, job);
    for silicon in [silicons()[0], silicons()[11]] {
        let (mut core, mut machine) = UsbMachine::new(silicon, &FAST);
        machine.send(&mut core, job);
        while machine.device.simulator.due().is_some() || machine.state() != State::Idle {
            machine.run(&mut core, 100);
        }
        machine.run(&mut core, 100);
        let raised: Vec<u32> = machine.edges.iter().map(|edge| edge.raise).collect();
        assert!(raised == expected, "{} {}", raised.len(), expected.len());
        let answers = machine.text.matches("ok\r\n").count();
        assert_eq!(answers, job.split(|byte| *byte == b'\n').count() - 1);
        assert_eq!(
            (machine.device.simulator.lost(), core.violations()),
            (0, &[][..])
        );
    }
}

#[test]
fn short_lines_run_as_fast_as_the_motion() {
    let (mut core, mut machine) = UsbMachine::new(silicons()[0], &FAST);
    let line = |number: u32| format!("G1X{:.4}Y0.000F3000\n", f64::from(number) * 0.05);
    let job: String = (1..=2500).map(line).collect();
    let start = machine.device.simulator.now();
    machine.send(&mut core, job.as_bytes());
    while machine.device.simulator.due().is_some() || machine.state() != State::Idle {
        machine.run(&mut core, 10);
    }
    let ms = (machine.device.simulator.now() - start) / u64::from(TICKS_PER_MS);
    // 125 mm at 50 mm/s, and the ramps; at 115 200 baud the bytes alone take longer.
    assert!((2500..2700).contains(&ms), "{ms}");
    assert!(job.len() * 10 * 1000 / 115_200 > 4300);
}

#[test]
fn a_question_behind_a_burst_is_answered_and_a_hold_is_made_in_time() {
    // The proven rate: 2000 steps/mm of two axes at 2850 mm/min each.
    let rate = [
        "0=3", "110=2850", "100=2000", "120=500", "111=2850", "101=2000", "121=500",
    ];
    let (mut core, mut machine) = UsbMachine::new(silicons()[0], &rate);
    machine.send(&mut core, b"G1X500Y500F4030\n");
    machine.run(&mut core, 200);
    machine.text.clear();
    // 2.4 periods: the next one takes the byte, the next sends the report, and the host fetches it.
    assert!(machine.host.offer(&mut core, b"?"));
    machine.run(&mut core, 2);
    assert!(machine.text.starts_with('<'), "{:?}", machine.text);
    // A burst of 1 KiB of which the queue has room for a part.
    let mut burst = b"G1X1\n".repeat(200);
    burst.push(b'!');
    let start = machine.device.simulator.now();
    machine.send(&mut core, &burst);
    machine.run(&mut core, 1);
    let ms = (machine.device.simulator.now() - start) / u64::from(TICKS_PER_MS);
    assert_eq!(machine.state(), State::HoldSlowing);
    assert!(ms <= 8, "{ms}");
}

#[test]
fn a_lost_link_holds_a_motion_within_5_ms_and_once() {
    for loss in [suspend, close] {
        let (mut core, mut machine) = UsbMachine::new(silicons()[0], &FAST);
        machine.send(&mut core, b"G1X100F3000\nG1X0\n");
        machine.run(&mut core, 200);
        assert_eq!(machine.state(), State::Run);
        loss(&mut core, &mut machine);
        let ms = (0..10).find(|_| {
            let is_held = machine.state() != State::Run;
            machine.run(&mut core, 1);
            is_held
        });
        assert!(ms.is_some(), "held in ten periods");
        machine.run(&mut core, 2000);
        assert_eq!(machine.state(), State::HoldComplete);
        core.suspend(false);
        machine.set_open(&mut core, false);
        machine.set_open(&mut core, true);
        machine.run(&mut core, 100);
        // Nothing goes on by itself, and nothing is reset.
        assert_eq!(machine.state(), State::HoldComplete);
        assert!(machine.text.contains("Grbl 1.1h"), "{:?}", machine.text);
        machine.send(&mut core, b"~");
        machine.run(&mut core, 20_000);
        assert_eq!(machine.state(), State::Idle);
        assert_eq!(machine.device.simulator.physical_steps()[0], 0);
        assert_eq!(machine.device.simulator.requested_resets(), 0);
    }
}

#[test]
fn who_opens_the_port_of_a_locked_machine_sees_the_alarm() {
    let (mut core, mut machine) = UsbMachine::new(silicons()[0], &FAST);
    machine.send(&mut core, b"G1X100F3000\n");
    machine.run(&mut core, 200);
    machine.send(&mut core, b"\x18");
    machine.run(&mut core, 200);
    assert_eq!(machine.state(), State::Alarm);
    machine.set_open(&mut core, false);
    machine.run(&mut core, 20);
    machine.text.clear();
    machine.set_open(&mut core, true);
    machine.run(&mut core, 20);
    let lock = "[MSG:'$H'|'$X' to unlock]\r\n";
    let expected = format!("ALARM:3\r\n\r\nGrbl 1.1h ['$' for help]\r\n{lock}");
    assert!(machine.text.contains(&expected), "{:?}", machine.text);
    machine.send(&mut core, b"$X\n");
    machine.set_open(&mut core, false);
    machine.set_open(&mut core, true);
    machine.run(&mut core, 20);
    let rest = machine.text.split(lock).nth(1).unwrap_or_default();
    assert!(rest.contains("Grbl") && !rest.contains("ALARM"), "{rest:?}");
}

fn suspend(core: &mut Core, _: &mut UsbMachine) {
    core.suspend(true);
}

fn close(core: &mut Core, machine: &mut UsbMachine) {
    machine.set_open(core, false);
}

#[test]
fn with_787_at_0_what_has_been_sent_is_played_out() {
    let settings = [&FAST[..], &["787=0"]].concat();
    let (mut core, mut machine) = UsbMachine::new(silicons()[0], &settings);
    machine.send(&mut core, b"G1X100F3000\nG1X50\nG1X7");
    machine.run(&mut core, 200);
    core.suspend(true);
    machine.run(&mut core, 20_000);
    assert_eq!(machine.state(), State::Idle);
    // The line that was begun is not executed.
    assert_eq!(machine.device.simulator.physical_steps()[0], 50 * 250);
}

#[test]
fn a_lost_link_at_rest_holds_nothing_and_the_next_line_is_executed() {
    let (mut core, mut machine) = UsbMachine::new(silicons()[0], &FAST);
    for _ in 0..3 {
        machine.set_open(&mut core, false);
        machine.set_open(&mut core, true);
        machine.run(&mut core, 20);
        assert_eq!(machine.state(), State::Idle);
    }
    machine.text.clear();
    machine.send(&mut core, b"G91G1X1F600\n");
    machine.run(&mut core, 2000);
    assert_eq!(machine.text, "ok\r\n");
    assert_eq!(machine.device.simulator.physical_steps()[0], 250);
}

#[test]
fn a_laser_goes_dark_when_the_link_is_lost_and_a_spindle_stays() {
    for (hold, laser) in [("787=1", "32=1"), ("787=0", "32=1"), ("787=1", "32=0")] {
        let settings = [&FAST[..], &[hold, laser, "30=1000"]].concat();
        let (mut core, mut machine) = UsbMachine::new(silicons()[0], &settings);
        // At rest: a constant beam burns on.
        machine.send(&mut core, b"M3S1000\nG1X1F3000\n");
        machine.run(&mut core, 2000);
        assert!(
            machine.state() == State::Idle && machine.duty() != 0,
            "{hold} {laser}"
        );
        core.suspend(true);
        machine.run(&mut core, 20);
        assert_eq!(machine.duty() == 0, laser == "32=1", "{hold} {laser}");
        // It comes on with the next motion.
        core.suspend(false);
        machine.run(&mut core, 10);
        machine.send(&mut core, b"G1X200\n");
        machine.run(&mut core, 400);
        assert!(machine.state() == State::Run && machine.duty() != 0);
        // In motion: at once where the machine is held, otherwise at the end.
        core.suspend(true);
        machine.run(&mut core, 60);
        let is_dark = laser == "32=1" && hold == "787=1";
        assert_eq!(machine.duty() == 0, is_dark, "{hold} {laser}");
        machine.run(&mut core, 20_000);
        assert_eq!(machine.duty() == 0, laser == "32=1", "{hold} {laser}");
    }
}

#[test]
fn a_break_over_usb_holds_as_one_on_a_line_does() {
    let (mut core, mut machine) = UsbMachine::new(silicons()[0], &FAST);
    machine.send(&mut core, b"G1X100F3000\n");
    machine.run(&mut core, 200);
    let host = machine.host.clone();
    let device = &mut |core: &mut Core| machine.period(core);
    assert_eq!(host.send_break(&mut core, 200, device), Ok(()));
    machine.run(&mut core, 2000);
    assert_eq!(machine.state(), State::HoldComplete);
    assert!(machine.text.contains("[MSG:Break on the line]"));
}
