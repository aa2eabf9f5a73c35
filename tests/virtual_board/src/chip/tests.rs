//! The models that are added to the crate's, on the chips of boards.

use std::{collections::BTreeMap, path::Path};

use rigless::emulator::{Error as EmulatorError, Memory};

use super::*;

mod usb;

const RCC_CR: u64 = 0x4002_3800;
const RCC_CFGR: u64 = 0x4002_3808;
const RCC_APB1ENR: u64 = 0x4002_3840;
const RCC_APB2ENR: u64 = 0x4002_3844;
const SYSCFG_EXTICR1: u64 = 0x4001_3808;
const EXTI: u64 = 0x4001_3C00;
const TIM9: u64 = 0x4001_4000;
const TIM11: u64 = 0x4001_4800;
const TIM14: u64 = 0x4000_2000;
const FLASH_KEYR: u64 = 0x4002_3C04;
const FLASH_SR: u64 = 0x4002_3C0C;
const FLASH_CR: u64 = 0x4002_3C10;
const PWR_CR: u64 = 0x4000_7000;
const DBGMCU_IDCODE: u64 = 0xE004_2000;

/// Memory beside the registers.
#[derive(Default)]
struct Words(BTreeMap<u64, u64>);

impl Memory for Words {
    fn read(&mut self, address: u64, _: Width) -> Result<u64, EmulatorError> {
        Ok(self.0.get(&address).copied().unwrap_or(0xFFFF_FFFF))
    }

    fn write(&mut self, address: u64, _: Width, value: u64) -> Result<(), EmulatorError> {
        self.0.insert(address, value);
        Ok(())
    }

    fn program(&mut self, address: u64, width: Width, value: u64) -> Result<(), EmulatorError> {
        self.write(address, width, value)
    }
}

/// A chip, its memory, and the time.
struct Rig {
    chip: Chip,
    memory: Words,
    now: u64,
    crystal_mhz: u32,
}

impl Rig {
    fn new(board: &str) -> Self {
        let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
        let board = Board::read(&Board::path(board, &root), &root).unwrap();
        let mut chip = Chip::new(&board, FittedParts::of(&board)).unwrap();
        chip.models.set_supply(3300);
        Self {
            chip,
            memory: Words::default(),
            now: 0,
            crystal_mhz: board.crystal_mhz,
        }
    }

    fn write(&mut self, address: u64, value: u64) {
        let at = VirtualNanos(self.now);
        self.chip.write(at, address, Width::W32, value).unwrap();
        self.chip.settle(&mut self.memory).unwrap();
    }

    fn read(&mut self, address: u64) -> u64 {
        let at = VirtualNanos(self.now);
        let value = self.chip.read(at, address, Width::W32).unwrap();
        self.chip.settle(&mut self.memory).unwrap();
        value
    }

    fn wait(&mut self, ns: u64) {
        self.now += ns;
        self.chip.advance_to(VirtualNanos(self.now));
        self.chip.settle(&mut self.memory).unwrap();
    }

    fn hold(&mut self, pin: &str, level: Level) {
        let at = VirtualNanos(self.now);
        self.chip.hold(at, pin.parse().unwrap(), Some(level));
        self.chip.settle(&mut self.memory).unwrap();
    }

    /// Numbers of the interrupts that were raised since this was asked before.
    fn raised(&mut self) -> Vec<u16> {
        let changes = self.chip.drain_interrupts().into_iter();
        let raised = changes.filter(|change| change.level == Level::High);
        raised.map(|change| change.interrupt).collect()
    }
}

/// RM0090 9.2.3 and 12.2.5: a line listens to one port, and to the edges that are selected.
#[test]
fn an_edge_of_the_selected_port_interrupts_and_its_flag_is_cleared_by_a_one() {
    let mut rig = Rig::new("btt-skr-2");
    rig.write(RCC_APB2ENR, 1 << 14);
    // Line 1 is that of port C; it interrupts at falling edges.
    rig.write(SYSCFG_EXTICR1, 2 << 4);
    rig.write(EXTI, 1 << 1);
    rig.write(EXTI + 0x0C, 1 << 1);
    for pin in ["B1", "C1"] {
        rig.hold(pin, Level::High);
    }
    rig.raised();
    rig.hold("B1", Level::Low);
    assert_eq!((rig.raised(), rig.read(EXTI + 0x14)), (vec![], 0));
    rig.hold("C1", Level::Low);
    assert_eq!((rig.raised(), rig.read(EXTI + 0x14)), (vec![7], 2));
    rig.write(EXTI + 0x14, 2);
    rig.hold("C1", Level::High);
    assert_eq!((rig.raised(), rig.read(EXTI + 0x14)), (vec![], 0));
}

/// RM0090 5.2.2: the detector of the supply is line 16.
#[test]
fn a_supply_that_falls_interrupts() {
    let mut rig = Rig::new("btt-skr-2");
    rig.write(RCC_APB1ENR, 1 << 28);
    rig.write(EXTI, 1 << 16);
    rig.write(EXTI + 8, 1 << 16);
    // PLS, 2.9 V, and PVDE.
    rig.write(PWR_CR, 7 << 5 | 1 << 4);
    rig.chip.supply(VirtualNanos(rig.now), 3300);
    assert_eq!(rig.raised(), []);
    rig.chip.supply(VirtualNanos(rig.now), 2600);
    rig.chip.settle(&mut rig.memory).unwrap();
    assert_eq!(rig.raised(), [1]);
}

/// RM0090 19.4: the timer counts the clock of its bus, 16 MHz after a reset, and stops to be reached without its enable.
#[test]
fn the_ninth_timer_counts_and_needs_its_enable() {
    let mut rig = Rig::new("btt-skr-2");
    let at = VirtualNanos(0);
    assert!(rig.chip.write(at, TIM9, Width::W32, 1).is_err());
    rig.write(RCC_APB2ENR, 1 << 16);
    rig.write(TIM9 + 0x2C, 15_999);
    rig.write(TIM9 + 0x0C, 1);
    rig.write(TIM9, 1);
    rig.wait(999_000);
    assert_eq!(rig.raised(), []);
    rig.wait(2_000);
    assert_eq!(rig.raised(), [24]);
    rig.write(TIM9 + 0x10, 0);
    assert_eq!(rig.read(TIM9 + 0x10) & 1, 0);
}

/// RM0090 19.5: `UIF` is set each period, interrupts as 26 if `UIE` says so, and is cleared by a zero; as TIM10 is run.
#[test]
fn the_eleventh_timer_interrupts_each_period_until_its_flag_is_cleared() {
    let mut rig = Rig::new("btt-skr-2");
    rig.write(RCC_APB2ENR, 1 << 18);
    // 500 µs of 16 MHz.
    rig.write(TIM11 + 0x28, 15);
    rig.write(TIM11 + 0x2C, 499);
    rig.write(TIM11 + 0x14, 1);
    rig.write(TIM11 + 0x10, 0);
    rig.write(TIM11, 1);
    rig.wait(400_000);
    assert_eq!((rig.raised(), rig.read(TIM11 + 0x10) & 1), (vec![], 0));
    for interrupt in [vec![], vec![26]] {
        rig.write(TIM11 + 0x0C, interrupt.len() as u64);
        for _ in 0..3 {
            rig.wait(500_000);
            assert_eq!(rig.raised(), interrupt);
            assert_eq!(rig.read(TIM11 + 0x10) & 1, 1);
            rig.write(TIM11 + 0x10, 0);
            assert_eq!(rig.read(TIM11 + 0x10) & 1, 0);
        }
    }
}

#[test]
fn what_a_chip_lacks_has_no_model() {
    for (board, has_one) in [("btt-skr-2", true), ("blackpill-f411", false)] {
        let mut rig = Rig::new(board);
        let slot = rig.chip.bus().slot_at(TIM14).unwrap();
        assert_eq!(rig.chip.split(slot).1.is_some(), has_one, "{board}");
    }
}

/// RM0090 19.5.11: the input of TIM11 can be the crystal, divided; each eighth edge is captured.
#[test]
fn captures_of_the_crystal_have_the_distance_that_its_frequency_says() {
    let mut rig = Rig::new("btt-skr-2");
    rig.write(RCC_CR, 0x1_0083);
    rig.wait(10_000);
    rig.write(RCC_CFGR, 31 << 16);
    rig.write(RCC_APB2ENR, 1 << 18);
    rig.write(TIM11 + 0x50, 2);
    rig.write(TIM11 + 0x18, 0b1101);
    rig.write(TIM11 + 0x20, 1);
    rig.write(TIM11, 1);
    let mut captures = Vec::new();
    for _ in 0..20 {
        rig.wait(31_000);
        if rig.read(TIM11 + 0x10) & 2 != 0 {
            captures.push(rig.read(TIM11 + 0x34));
        }
    }
    // 248 periods of 8 MHz are 496 of 16 MHz.
    let distances = captures.windows(2).map(|it| (it[1] - it[0]) & 0xFFFF);
    assert_eq!(distances.collect::<Vec<_>>(), [496; 19]);
}

#[test]
fn a_crystal_that_is_not_there_is_never_ready() {
    let mut rig = Rig::new("btt-skr-2");
    rig.chip.fit(FittedParts {
        crystal_hz: 0,
        device: 0x413,
    });
    rig.write(RCC_CR, 0x1_0083);
    rig.wait(10_000);
    rig.chip.correct_ready_flags();
    assert_eq!(rig.read(RCC_CR) >> 17 & 1, 0);
}

/// RM0090 3.6: words are programmed with `PG`, and a sector is erased that `SNB` numbers.
#[test]
fn flash_is_programmed_and_erased_until_the_supply_is_cut() {
    let mut rig = Rig::new("btt-skr-2");
    let place = memory::FLASH + 0x8000;
    rig.write(place, 1);
    for key in [0x4567_0123, 0xCDEF_89AB] {
        rig.write(FLASH_KEYR, key);
    }
    rig.write(FLASH_CR, 0x201);
    rig.write(place, 0x1234);
    assert_eq!(rig.memory.0.get(&place), Some(&0x1234));
    assert_eq!(rig.read(FLASH_SR) >> 16, 0, "it is not told at once");
    assert_eq!(rig.read(FLASH_SR) >> 16, 1, "it is busy");
    rig.write(FLASH_CR, 0x200);
    rig.wait(100_000);
    assert_eq!(rig.read(FLASH_SR) >> 16, 0);
    rig.write(FLASH_CR, 0x1_0212);
    let expected = [
        Change::NotEnabled(place),
        Change::Programmed(place, 4),
        Change::WhileBusy,
        Change::Erased(place, 16 * 1024),
    ];
    assert_eq!(std::mem::take(&mut rig.chip.flash.changes), expected);
    assert_eq!(rig.memory.0.get(&place), Some(&0xFFFF_FFFF));
    rig.chip.flash.is_cut = true;
    rig.read(FLASH_SR);
    assert_eq!(rig.read(FLASH_SR) >> 16, 1, "it is busy");
    rig.wait(200_000_000);
    assert_eq!(rig.read(FLASH_SR) >> 16, 0);
    rig.write(FLASH_CR, 0x201);
    rig.write(place, 0x1234);
    assert_eq!(rig.memory.0.get(&place), Some(&0xFFFF_FFFF));
}

#[test]
fn sectors_and_numbers_are_those_of_the_board_s_chip() {
    for (board, sectors, device) in [
        ("blackpill-f411", 8, 0x431),
        ("btt-octopus-1.1-f446", 8, 0x421),
        ("btt-skr-2", 12, 0x413),
        ("btt-octopus-1.1-f429", 12, 0x419),
    ] {
        let mut rig = Rig::new(board);
        assert_eq!(rig.chip.word(DBGMCU_IDCODE) & 0xFFF, device, "{board}");
        let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
        let board = Board::read(&Board::path(board, &root), &root).unwrap();
        assert_eq!(memory::sectors(&board).len(), sectors);
    }
}
