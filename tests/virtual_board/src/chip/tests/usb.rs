//! USB over the addresses of the bus: the driver of the firmware in the chips of boards, and hosts at their cables.

use std::fmt::Write as _;

use leadscrew::{
    settings::Settings,
    sim::Simulator,
    units::TICKS_PER_MS,
    usb::{ControlBus, Driver, Mailbox, Registers, UsbControl, serial_number},
};
use otg::System;

use super::*;
use crate::{
    compare::usb::faults,
    sender::Sender,
    usb_host::{
        HostAction::{self, Close, Enumerate, Open, Resume, Suspend},
        PERIOD_US,
    },
};

const RCC_PLLCFGR: u64 = 0x4002_3804;
const RCC_AHB1ENR: u64 = 0x4002_3830;
const RCC_AHB2ENR: u64 = 0x4002_3834;
const RCC_AHB2RSTR: u64 = 0x4002_3814;
const OTGFS: u64 = 1 << 7;
const GPIOA: u64 = 0x4002_0000;
const OSPEEDR: u64 = GPIOA + 0x08;
const AFRH: u64 = GPIOA + 0x24;
const OTG: u64 = 0x5000_0000;
const GOTGCTL: u64 = OTG;
const GUSBCFG: u64 = OTG + 0x00C;
const GRXSTSP: u64 = OTG + 0x020;
const GCCFG: u64 = OTG + 0x038;
const CID: u64 = OTG + 0x03C;
const DCTL: u64 = OTG + 0x804;
/// A board of each chip, with the version of its core.
const BOARDS: [(&str, u64); 5] = [
    ("netduino-plus-2", 0x1200),
    ("btt-skr-2", 0x1200),
    ("blackpill-f411", 0x1200),
    ("btt-octopus-1.1-f429", 0x1200),
    ("btt-octopus-1.1-f446", 0x2000),
];
const FIRST: &str = "btt-skr-2";
const SECOND: &str = "btt-octopus-1.1-f446";
/// Of `PLLCFGR`: the crystal is the source.
const HSE: u64 = 1 << 22;

/// Starts the PLL with a divider, of a source, a factor, and a divider of what it makes for USB.
fn start_pll(rig: &mut Rig, divider: u64, factor: u64, usb_divider: u64) {
    rig.write(RCC_CR, 0x1_0083);
    let main_divider = 1 << 16;
    rig.write(
        RCC_PLLCFGR,
        divider | factor << 6 | main_divider | usb_divider << 24,
    );
    rig.write(RCC_CR, 0x101_0083);
    rig.wait(10_000_000);
}

/// The registers of the core, by the addresses of the bus.
struct OverBus<'a>(&'a mut Rig);

impl Registers for OverBus<'_> {
    fn read(&mut self, offset: usize) -> u32 {
        self.0.read(OTG + offset as u64) as u32
    }

    fn write(&mut self, offset: usize, value: u32) {
        self.0.write(OTG + offset as u64, value.into());
    }
}

/// A board with the firmware's driver and the simulator's machine, whose cable is in a host.
struct UsbBoard {
    rig: Rig,
    simulator: Box<Simulator>,
    driver: Driver<'static>,
    control: UsbControl<'static>,
}

/// Sets up clocks and pins as the board layer does.
fn set_up(rig: &mut Rig) {
    let crystal_mhz = rig.crystal_mhz;
    rig.write(RCC_CR, 0x1_0083);
    rig.wait(10_000_000);
    start_pll(rig, u64::from(crystal_mhz) | HSE, 336, 7);
    rig.write(RCC_AHB1ENR, 1);
    rig.write(GPIOA, 0xA800_0000 | 0b1010 << 22);
    rig.write(OSPEEDR, 0x0C00_0000 | 0b1111 << 22);
    rig.write(AFRH, 0xAA << 12);
    rig.write(RCC_AHB2ENR, OTGFS);
}

/// The tasks of the firmware, out of a reset. Their memory lives as long as the tests.
fn tasks() -> (Driver<'static>, UsbControl<'static>) {
    let mailbox: &'static Mailbox = Box::leak(Box::new(Mailbox::new()));
    let allocator = Box::leak(Box::new(ControlBus::allocator(mailbox)));
    let digits = Box::leak(Box::new(serial_number([1, 2, 3])));
    let serial = std::str::from_utf8(digits).unwrap();
    let control = UsbControl::new(allocator, "A board", serial).unwrap();
    (Driver::new(mailbox), control)
}

impl UsbBoard {
    /// Clocks and pins are set up, the driver has not run.
    fn new(name: &str, system: System) -> Self {
        let mut rig = Rig::new(name);
        set_up(&mut rig);
        rig.chip.otg.plug(system, Box::<Sender>::default());
        let (driver, control) = tasks();
        Self {
            rig,
            simulator: Box::new(Simulator::new(&Settings::default())),
            driver,
            control,
        }
    }

    /// Its port is open, and the welcome has been read.
    fn opened(name: &str, system: System) -> Self {
        let mut board = Self::new(name, system);
        board.await_line("Grbl 1.1h");
        board
    }

    /// A period of the driver passes, and of everything else.
    fn period(&mut self) {
        let end = self.simulator.now() + u64::from(TICKS_PER_MS) / 2;
        while self.simulator.now() < end {
            let _ = self.simulator.advance(end);
        }
        self.rig.wait(PERIOD_US * 1000);
        let mut registers = OverBus(&mut self.rig);
        if self.simulator.serve_usb(&mut self.driver, &mut registers) {
            self.simulator.serve_usb_control(&mut self.control);
        }
        self.simulator.settle();
        let now = VirtualNanos(self.rig.now);
        self.rig.chip.poll(now);
    }

    fn run(&mut self, ms: usize) {
        for _ in 0..2 * ms {
            self.period();
        }
    }

    fn sender(&mut self) -> &mut Sender {
        self.rig.chip.otg.program_as().unwrap()
    }

    /// Waits for a line with this beginning, for a second of the board; returns the number of lines before it.
    fn await_line(&mut self, beginning: &str) -> usize {
        let mut before = 0;
        for _ in 0..2000 {
            while let Some(line) = self.sender().lines.pop_front() {
                if line.starts_with(beginning) {
                    return before;
                }
                before += 1;
            }
            self.period();
        }
        panic!("{beginning} does not come: {:?}", self.rig.chip.otg);
    }

    fn send(&mut self, text: &str) {
        self.sender().outgoing.extend(text.bytes());
    }

    fn act(&mut self, action: HostAction) {
        self.rig.chip.otg.act(action);
    }

    fn state(&mut self) -> String {
        self.send("?");
        self.run(10);
        let report = self.sender().lines.pop_back().unwrap();
        report[1..].split(['|', ':']).next().unwrap().to_owned()
    }

    fn is_faultless(&mut self) {
        assert_eq!(self.rig.chip.otg.take_faults(), [""; 0]);
    }
}

/// Every system sets up every chip, whose registers are as they must be then.
#[test]
fn a_driver_is_enumerated_over_the_bus() {
    for (name, version) in BOARDS {
        for system in System::ALL {
            let mut board = UsbBoard::opened(name, system);
            assert_eq!(board.rig.read(CID), version, "{name}");
            assert_eq!(faults(&mut board.rig.chip), [""; 0], "{name}");
            board.is_faultless();
        }
    }
}

/// A sender waits for each answer; another one sends as much as the port takes.
#[test]
fn a_job_is_streamed_at_the_rate_of_the_bus() {
    let mut board = UsbBoard::opened(FIRST, System::Linux);
    for _ in 0..20 {
        board.send("G91G0X0\n");
        assert_eq!(board.await_line("ok"), 0);
    }
    let mut job = String::new();
    for nth in 0..200 {
        writeln!(job, "N{nth}(a comment that makes the line longer)G4P0").unwrap();
    }
    board.send(&job);
    let began = board.rig.now;
    for _ in 0..200 {
        assert_eq!(board.await_line("ok"), 0);
    }
    // The driver takes a packet in each period.
    let least_ns = job.len() as u64 / 64 * PERIOD_US * 1000;
    let ns = board.rig.now - began;
    assert!((least_ns..2 * least_ns).contains(&ns), "{ns} {least_ns}");
    assert_eq!(board.simulator.lost(), 0);
    board.is_faultless();
}

/// USB 2.0, table 5-9: so many packets in a ms.
#[test]
fn a_frame_has_room_for_19_packets() {
    let mut board = UsbBoard::opened(FIRST, System::Linux);
    let rig = &mut board.rig;
    let control = rig.read(OTG + 0x920) & !0x7FF;
    rig.write(OTG + 0x930, (25 << 19) | (4 * 25));
    // EPENA, CNAK, and packets of 4 bytes.
    rig.write(OTG + 0x920, control | 1 << 31 | 1 << 26 | 4);
    for _ in 0..25 {
        rig.write(OTG + 0x2000, u32::from_le_bytes(*b"abc\n").into());
    }
    let counts = [(); 5].map(|()| {
        board.rig.wait(PERIOD_US * 1000);
        board.rig.chip.poll(VirtualNanos(board.rig.now));
        board.sender().lines.len()
    });
    assert!(
        matches!(counts, [19, 19, 25, ..] | [19, 25, ..]),
        "{counts:?}"
    );
    board.is_faultless();
}

#[test]
fn a_host_that_closes_sleeps_or_resets_holds_a_motion() {
    for name in [FIRST, SECOND] {
        for actions in [
            &[Close, Open][..],
            &[Suspend, Resume],
            &[Enumerate(System::Windows)],
        ] {
            let mut board = UsbBoard::opened(name, System::Linux);
            board.send("G91G1X100F600\n");
            assert_eq!(board.await_line("ok"), 0);
            board.run(100);
            assert_eq!(board.state(), "Run");
            for action in actions {
                board.act(*action);
                board.run(200);
            }
            assert_eq!(board.state(), "Hold", "{actions:?}");
            board.send("~");
            board.run(50);
            assert_eq!(board.state(), "Run", "{actions:?}");
            board.is_faultless();
        }
    }
}

#[test]
fn a_closed_port_and_a_sleeping_host_hear_nothing() {
    for (action, end) in [(Close, Open), (Suspend, Resume)] {
        let mut board = UsbBoard::opened(FIRST, System::MacOs);
        board.act(action);
        board.run(20);
        board.sender().lines.clear();
        board.send("?");
        board.run(100);
        assert_eq!(board.sender().lines.len(), 0);
        assert_eq!(board.sender().outgoing.len(), usize::from(action == Close));
        board.act(end);
        board.await_line("<Idle");
    }
}

/// A reset of the chip, and one of the core alone, are another device to the host.
#[test]
fn a_core_that_is_reset_is_set_up_anew() {
    for is_core_alone in [true, false] {
        let mut board = UsbBoard::opened(FIRST, System::Linux);
        let rig = &mut board.rig;
        if is_core_alone {
            rig.write(RCC_AHB2RSTR, OTGFS);
            rig.write(RCC_AHB2RSTR, 0);
        } else {
            rig.chip.reset(VirtualNanos(rig.now), ResetCause::Pin);
            set_up(rig);
        }
        assert!(!rig.chip.otg.core.is_connected());
        board.send("?");
        board.run(10);
        assert_eq!(board.sender().outgoing.len(), 1);
        (board.driver, board.control) = tasks();
        board.await_line("Grbl 1.1h");
        board.await_line("<Idle");
        board.is_faultless();
    }
}

#[test]
fn the_core_answers_with_its_clocks_alone() {
    let mut rig = Rig::new(FIRST);
    let at = VirtualNanos(0);
    assert!(rig.chip.read(at, CID, Width::W32).is_err());
    rig.write(RCC_AHB2ENR, OTGFS);
    assert_eq!(rig.read(CID), 0);
    let expected = ["OTG_FS: a register is read without clocks"];
    assert_eq!(rig.chip.otg.take_faults(), expected);
    let mut board = UsbBoard::new(FIRST, System::Linux);
    assert_eq!(board.rig.read(CID), 0x1200);
    board.is_faultless();
}

/// Each FIFO is a page, whose addresses are one; a status without a packet, a byte, and what has no model are faults.
#[test]
fn fifos_are_windows_and_what_is_read_or_written_amiss_is_a_fault() {
    let mut board = UsbBoard::opened(FIRST, System::Linux);
    let slot = board.rig.chip.bus().slot_at(OTG + 0x4FFC);
    assert_eq!(slot, board.rig.chip.bus().slot_at(OTG));
    for (address, expected) in [
        (OTG + 0x1000, "more words are read than the packet has"),
        (OTG + 0x1FFC, "more words are read than the packet has"),
        (GRXSTSP, "the status of an empty receive FIFO is read"),
        (OTG + 0x440, "0x440 is read, which has no model"),
    ] {
        board.rig.read(address);
        assert_eq!(
            board.rig.chip.otg.take_faults(),
            [format!("OTG_FS: {expected}")]
        );
    }
    for (address, expected) in [
        (OTG + 0x1000, "a word too many is written to FIFO 0"),
        (OTG + 0x3FFC, "a word too many is written to FIFO 2"),
        (OTG + 0x440, "0x440 is written, which has no model"),
    ] {
        board.rig.write(address, 0);
        assert_eq!(
            board.rig.chip.otg.take_faults(),
            [format!("OTG_FS: {expected}")]
        );
    }
    let at = VirtualNanos(board.rig.now);
    board.rig.chip.read(at, CID, Width::W8).unwrap();
    let expected = ["OTG_FS: 0x3c is accessed as W8"];
    assert_eq!(board.rig.chip.otg.take_faults(), expected);
}

/// A register is changed once everything is right.
#[test]
fn each_rule_of_usb_is_judged() {
    for (name, address, bits, expected) in [
        (FIRST, GPIOA, 1 << 22, "A11, USB: GPIOA_MODER has 3"),
        (FIRST, GPIOA, 1 << 24, "A12, USB: GPIOA_MODER has 3"),
        (FIRST, OSPEEDR, 1 << 22, "A11, USB: GPIOA_OSPEEDR has 2"),
        (FIRST, OSPEEDR, 2 << 24, "A12, USB: GPIOA_OSPEEDR has 1"),
        (FIRST, AFRH, 1 << 12, "A11, USB: GPIOA_AFR has 11"),
        (FIRST, AFRH, 1 << 16, "A12, USB: GPIOA_AFR has 11"),
        (FIRST, RCC_AHB2ENR, OTGFS, "OTGFSEN is clear"),
        (FIRST, GUSBCFG, 1 << 30, "FDMOD is clear"),
        (FIRST, GUSBCFG, 1 << 6, "PHYSEL is clear"),
        (FIRST, GCCFG, 1 << 16, "PWRDWN is clear"),
        (FIRST, GCCFG, 1 << 18, "VBUSASEN is set"),
        (FIRST, GCCFG, 1 << 19, "VBUSBSEN is set"),
        (FIRST, GCCFG, 1 << 21, "NOVBUSSENS is clear"),
        (SECOND, GUSBCFG, 1 << 30, "FDMOD is clear"),
        (SECOND, GCCFG, 1 << 16, "PWRDWN is clear"),
        (SECOND, GCCFG, 1 << 21, "VBDEN is set"),
        (SECOND, GOTGCTL, 1 << 6, "BVALOEN or BVALOVAL is clear"),
        (SECOND, GOTGCTL, 1 << 7, "BVALOEN or BVALOVAL is clear"),
    ] {
        let mut board = UsbBoard::opened(name, System::Linux);
        let right = board.rig.read(address);
        board.rig.write(address, right ^ bits);
        let faults = faults(&mut board.rig.chip);
        assert!(faults.len() == 1, "{expected}: {faults:?}");
        assert!(faults[0].contains(expected), "{expected}: {faults:?}");
    }
}

#[test]
fn the_clock_of_usb_is_48_mhz_of_the_crystal() {
    for (divider, factor, usb_divider, expected) in [
        (8 | HSE, 336, 8, "makes 42000000 Hz for USB"),
        (8 | HSE, 192, 7, "makes 27428571 Hz for USB"),
        (16, 336, 7, "USB has the internal oscillator's clock"),
    ] {
        let mut board = UsbBoard::opened(FIRST, System::Linux);
        start_pll(&mut board.rig, divider, factor, usb_divider);
        let faults = faults(&mut board.rig.chip);
        assert!(faults.len() == 1, "{expected}: {faults:?}");
        assert!(faults[0].contains(expected), "{expected}: {faults:?}");
    }
}

/// The core is a device 25 ms after it has been forced, and disconnected before for too short a time, or not at all.
#[test]
fn a_short_soft_disconnect_is_judged() {
    for (name, is_disconnected) in [(FIRST, true), (FIRST, false), (SECOND, true)] {
        let mut board = UsbBoard::new(name, System::Linux);
        let rig = &mut board.rig;
        rig.write(GUSBCFG, 1 << 30 | 1 << 6 | 6 << 10);
        rig.wait(26_000_000);
        if is_disconnected {
            rig.write(DCTL, 0);
            rig.write(DCTL, 2);
            rig.wait(2_000_000);
        }
        rig.write(OTG + 0x800, 3);
        if name == FIRST {
            rig.write(GCCFG, 1 << 16 | 1 << 21);
        } else {
            rig.write(GCCFG, 1 << 16);
            rig.write(GOTGCTL, 3 << 6);
        }
        rig.write(DCTL, 0);
        let expected = ["OTG_FS_DCTL: SDIS is not set for 3 ms before the connection"];
        assert_eq!(faults(&mut rig.chip), expected, "{name} {is_disconnected}");
        assert!(rig.chip.otg.core.is_connected());
    }
}
