//! The chip of a board: the models of `rigless`, written from RM0090 for the STM32F427, in the memory map of the
//! board's chip, and with what they lack.
//!
//! The chips of the family have one set of peripherals, of which each has a part; RM0383 and RM0390 repeat the
//! chapters. A peripheral that a chip lacks has no model here, so each access to it is reported.

mod capture;
mod exti;
mod flash;
pub(crate) mod memory;
#[cfg(test)]
mod tests;
mod timers;
mod usb;

use std::collections::BTreeSet;

use anyhow::{Context, Result};
use board_data::{Board, Pin};
use rigless::{
    device::{Device, ErasedDevice, Level, ResetCause},
    mcu::{Mcu, Operate as _},
    soc::{
        Bus, Clock, Gate, Layout, Peripheral, Region, Width, WriteModify, find_field,
        stm32f427::{
            self, PORTS, Stm32f427,
            generated::{dbg, gpioa, pwr, rcc as clock_registers},
            peripherals::gpio,
        },
    },
    time::VirtualNanos,
};

use self::{
    capture::Capture,
    exti::{Exti, Syscfg},
    flash::FlashWithArray,
    timers::SmallTimers,
    usb::Otg,
};
pub(crate) use self::{exti::Edge, flash::Change};

/// What answers for a slot of the bus instead of the crate's models.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Model {
    Exti,
    Flash,
    Syscfg,
    SmallTimer(usize),
    Capture,
    Otg,
    /// The chip does not have it.
    Absent,
}

/// A chip.
#[derive(Debug)]
pub(crate) struct Chip {
    /// The crate's models.
    pub(crate) models: Stm32f427,
    pub(crate) exti: Exti,
    pub(crate) flash: FlashWithArray,
    syscfg: Syscfg,
    timers: SmallTimers,
    capture: Capture,
    pub(crate) otg: Otg,
    slots: Slots,
    /// What answers for each slot instead of the crate's models.
    replaced: Vec<Option<Model>>,
    memory: &'static [Region],
    /// `DBGMCU_IDCODE`.
    id_code: u64,
    /// The crystal, Hz; 0: none.
    crystal_hz: u64,
    /// The regulator begins with its scale 2.
    has_scale_2: bool,
    /// What the board holds pins at, which a reset of the crate's models forgets.
    held: [[Option<Level>; 16]; PORTS.len()],
}

/// Slots whose registers others look at.
#[derive(Debug, Clone, Copy)]
struct Slots {
    clocks: usize,
    debug: usize,
    exti: usize,
    syscfg: usize,
    otg: usize,
}

/// What differs from what the board's file says.
#[derive(Debug, Clone, Copy)]
pub(crate) struct FittedParts {
    /// The crystal, Hz; 0: none.
    pub(crate) crystal_hz: u64,
    /// `DEV_ID`, RM0090 38.6.1.
    pub(crate) device: u64,
}

impl FittedParts {
    /// What the board's file says.
    pub(crate) fn of(board: &Board) -> Self {
        Self {
            crystal_hz: u64::from(board.crystal_mhz) * 1_000_000,
            device: board.chip.dev_ids[0].into(),
        }
    }
}

/// The revision of the silicon, above `DEV_ID`: that of production.
const REVISION: u64 = 0x1000_0000;

impl Chip {
    /// The chip of a board, out of a reset.
    pub(crate) fn new(board: &Board, fitted: FittedParts) -> Result<Self> {
        let models = Stm32f427::new().context("the crate's own description is wrong")?;
        let bus = models.bus();
        let mut replaced = vec![None; bus.slots().len()];
        for instance in absent(board, bus.peripherals()) {
            replaced[bus.slot(instance)?] = Some(Model::Absent);
        }
        for (instance, answers) in [
            ("EXTI", Model::Exti),
            ("SYSCFG", Model::Syscfg),
            ("FLASH", Model::Flash),
        ] {
            replaced[bus.slot(instance)?] = Some(answers);
        }
        for (nth, (instance, _)) in timers::CLOCKS.into_iter().enumerate() {
            replaced[bus.slot(instance)?].get_or_insert(Model::SmallTimer(nth));
        }
        replaced[bus.slot("TIM11")?] = Some(Model::Capture);
        let otg = replaced.len();
        replaced.push(Some(Model::Otg));
        let slots = Slots {
            otg,
            clocks: bus.slot("RCC")?,
            debug: bus.slot("DBG")?,
            exti: bus.slot("EXTI")?,
            syscfg: bus.slot("SYSCFG")?,
        };
        let mut chip = Self {
            exti: Exti::default(),
            flash: FlashWithArray::new(board),
            syscfg: Syscfg,
            timers: SmallTimers::new(),
            capture: Capture::new(),
            otg: Otg::new(board),
            slots,
            replaced,
            memory: memory::of(board),
            id_code: REVISION | fitted.device,
            crystal_hz: fitted.crystal_hz,
            has_scale_2: board.chip.hal == "f411",
            held: Default::default(),
            models,
        };
        chip.models.rcc.attach_crystals(fitted.crystal_hz, 0);
        chip.put_on(chip.bus_with_own()?);
        chip.otg.registers = chip.bus().slots()[otg].peripheral().registers;
        chip.correct_voltage();
        chip.check()?;
        Ok(chip)
    }

    /// A bus of the crate's instances in this chip's memory map, with what the models here need.
    ///
    /// The crate's description cannot be changed, and of its clocks alone a bus can be asked. Enables and resets are
    /// those of the instance's name in the clock controller: RM0090 6.3.5 to 6.3.14.
    fn bus_with_own(&self) -> Result<Bus> {
        let described = stm32f427::builder().build()?;
        let mut instances: Vec<Peripheral> = described.peripherals().copied().collect();
        for instance in &mut instances {
            if instance.name == "EXTI" {
                instance.interrupts = &exti::INTERRUPTS;
            }
            if usb::INSTANCES.contains(&instance.name) {
                (instance.base, instance.size) = (usb::END, 0);
            }
        }
        let mut builder = Bus::builder(stm32f427::CPU, self.memory, instances.iter().copied());
        for instance in &instances {
            if let Some(clock) = described.clock_of(instance.name) {
                builder = builder.clocked_by(instance.name, clock);
            }
            if let Some((register, field)) = bit_of(instance.name, "ENR", "EN") {
                builder = builder.gate(instance.name, Gate::by("RCC", register, field));
            }
            if let Some((register, field)) = bit_of(instance.name, "RSTR", "RST") {
                builder = builder.reset_by(instance.name, Gate::by("RCC", register, field));
            }
        }
        for reader in REQUEST_READERS {
            builder = builder.reads_requests(reader);
        }
        for (instance, output) in timers::CLOCKS {
            builder = builder
                .clocked_by(instance, Clock::output("RCC", output))
                .reset(instance, "ARR", 0xFFFF)
                .write_modify(instance, "SR", WriteModify::ZeroToClear);
        }
        let mut bus = builder
            // RM0090 5.5.1, bit 8: the backup domain takes no write before.
            .gate_writes("RCC", &["BDCR"], Gate::by("PWR", "CR", "DBP"))
            .gate_writes("RTC", &[], Gate::by("PWR", "CR", "DBP"))
            .write_modify("EXTI", "PR", WriteModify::OneToClear)
            .reads_requests("EXTI")
            .build()?;
        bus.add_window(usb::window())?;
        Ok(bus)
    }

    /// Puts the models on a bus; what the registers of the crate's models hold, and their corrections, come with them.
    fn put_on(&mut self, mut bus: Bus) {
        let old = self.models.bus_mut();
        for slot in 0..self.replaced.len() {
            if matches!(
                self.replaced[slot],
                None | Some(Model::Flash | Model::Absent)
            ) {
                let registers = old.slot_mut(slot).registers_mut();
                std::mem::swap(bus.slot_mut(slot).registers_mut(), registers);
            }
        }
        *old = bus;
        let debug = old.slot_mut(self.slots.debug).registers_mut();
        debug.set(dbg::Register::DbgmcuIdcode, self.id_code);
    }

    /// The regulator of the chips of 100 MHz begins with its scale 2: RM0383 5.4.1.
    fn correct_voltage(&mut self) {
        if self.has_scale_2 {
            let (_, registers) = self.models.power();
            registers.set(pwr::Register::Cr, 0x8000);
        }
    }

    /// Has the OTG core hear of its clocks and its reset, before either changes again.
    fn follow_clocks(&mut self) {
        let clocks = self.models.bus().slots()[self.slots.clocks].registers();
        self.otg.follow(&self.models.rcc, clocks);
    }

    /// Fits another crystal, and another chip of the family, from the next reset on.
    pub(crate) fn fit(&mut self, fitted: FittedParts) {
        self.id_code = REVISION | fitted.device;
        self.crystal_hz = fitted.crystal_hz;
        self.models.rcc.attach_crystals(fitted.crystal_hz, 0);
    }

    /// Holds a pin at a level from outside, or lets it go.
    pub(crate) fn hold(&mut self, at: VirtualNanos, pin: Pin, level: Option<Level>) {
        let (port, number) = (usize::from(pin.port), usize::from(pin.number));
        self.held[port][number] = level;
        let which = gpio::Pin::new(pin.number).expect("a port has sixteen pins");
        self.models
            .drive_port(at, port, |model, registers, context| {
                model.drive(which, level, registers, context);
            });
    }

    /// Sets the supply, mV, of which the detector tells the EXTI: RM0090 5.2.2, line 16.
    pub(crate) fn supply(&mut self, at: VirtualNanos, millivolts: u32) {
        self.models.set_supply(millivolts);
        let (_, registers) = self.models.power();
        let is_low = pwr::csr::PVDO.is_set(registers.get(pwr::Register::Csr));
        let Self {
            models,
            exti,
            slots,
            ..
        } = self;
        let (registers, mut context) = models.bus_mut().drive(at, slots.exti);
        exti.supply(Level::from(is_low), registers, &mut context);
    }

    /// The crystal stops; returns whether the clock security system has seen it.
    pub(crate) fn stop_crystal(&mut self, at: VirtualNanos) -> bool {
        self.models.drive_clocks(at, |clocks, registers, context| {
            clocks.fail_hse(registers, context);
            let interrupts = registers.get(clock_registers::Register::Cir);
            clock_registers::cir::CSSF.is_set(interrupts)
        })
    }

    /// The crate lets every oscillator become ready: takes the flag of one back that is not there. RM0090 6.3.1.
    pub(crate) fn correct_ready_flags(&mut self) {
        if self.crystal_hz == 0 {
            let (_, registers) = self.models.clocks();
            let control = registers.get(clock_registers::Register::Cr);
            let corrected = clock_registers::cr::HSERDY.set(control, 0);
            if control != corrected {
                registers.set(clock_registers::Register::Cr, corrected);
            }
        }
    }

    /// A register as a debug probe sees it.
    pub(crate) fn word(&mut self, address: u64) -> u64 {
        // No register that is asked for here has a time.
        self.peek(VirtualNanos(0), address, Width::W32)
            .unwrap_or(u64::MAX)
    }

    /// The two bits of a pin in `MODER`.
    pub(crate) fn mode(&mut self, pin: Pin) -> u64 {
        let (_, registers) = self.models.port(pin.port.into());
        registers.get(gpioa::Register::Moder) >> (2 * pin.number) & 3
    }

    /// The frequency of the core, of both buses, Hz.
    pub(crate) fn frequencies(&mut self) -> [u64; 3] {
        let (clocks, registers) = self.models.clocks();
        [
            clocks.hclk(registers),
            clocks.pclk1(registers),
            clocks.pclk2(registers),
        ]
    }
}

/// Who hears requests in the crate's description, of which a bus cannot be asked.
const REQUEST_READERS: [&str; 14] = [
    "RCC", "RTC", "SPI1", "SPI2", "SPI3", "SPI4", "SPI5", "SPI6", "TIM1", "TIM8", "C_ADC", "ADC1",
    "DMA1", "DMA2",
];

/// A bit of the clock controller that has the name of an instance and an ending, with its register.
fn bit_of(instance: &str, registers: &str, ending: &str) -> Option<(&'static str, &'static str)> {
    let table = clock_registers::Register::REGISTERS;
    let mut names = table.iter().map(|row| row.name);
    let name = format!("{instance}{ending}");
    names.find_map(|register| {
        let is_asked = register.ends_with(registers) && !register.ends_with("LPENR");
        let field = find_field(table, register, &name)?;
        is_asked.then_some((register, field.name))
    })
}

/// The instances that the chip of a board does not have: timers and serial ports that its file does not list.
fn absent<'a>(
    board: &Board,
    instances: impl Iterator<Item = &'a Peripheral>,
) -> BTreeSet<&'static str> {
    let has = |name: &str| {
        let number = |prefix| {
            name.strip_prefix(prefix)
                .and_then(|it| it.parse::<u8>().ok())
        };
        match (number("TIM"), number("USART"), number("UART")) {
            // Those without outputs are in no file: 6 and 7, which the F411 lacks.
            (Some(6 | 7), ..) => board.chip.hal != "f411",
            (Some(timer), ..) => board.chip.timers.contains(&timer),
            (_, Some(usart), _) => board.chip.usarts.contains(&usart),
            (.., Some(_)) => false,
            _ => true,
        }
    };
    instances
        .map(|instance| instance.name)
        .filter(|name| !has(name))
        .collect()
}

impl Mcu for Chip {
    fn bus(&self) -> &Bus {
        self.models.bus()
    }

    fn bus_mut(&mut self) -> &mut Bus {
        self.models.bus_mut()
    }

    fn reset(&mut self, at: VirtualNanos, cause: ResetCause) {
        // The crate compares its own description with that of the bus.
        let described = stm32f427::builder().build();
        self.put_on(described.expect("the crate's description has been built before"));
        self.models.reset(at, cause);
        let bus = self.bus_with_own();
        self.put_on(bus.expect("the bus has been built before"));
        self.correct_voltage();
        self.timers = SmallTimers::new();
        self.capture = Capture::new();
        FlashWithArray::reset(&mut self.flash);
        if let Some(supply) = std::num::NonZeroU32::new(self.models.pwr.supply()) {
            self.flash.registers.set_supply(supply);
        }
        Device::reset(&mut self.exti);
        self.otg.restart();
        for port in 0..PORTS.len() {
            for number in 0..16 {
                let level = self.held[port][number];
                if level.is_some() {
                    let pin = Pin {
                        port: port as u8,
                        number: number as u8,
                    };
                    self.hold(at, pin, level);
                }
            }
        }
    }

    fn poll(&mut self, now: VirtualNanos) {
        self.models.poll(now);
        self.follow_clocks();
        let (_, mut context) = self.models.bus_mut().drive(now, self.slots.otg);
        self.otg.visit(&mut context);
    }

    fn split(&mut self, slot: usize) -> (&mut Bus, Option<&mut dyn ErasedDevice>) {
        if slot == self.slots.clocks || slot == self.slots.otg {
            self.follow_clocks();
        }
        let Some(model) = self.replaced.get(slot).copied().flatten() else {
            return self.models.split(slot);
        };
        let bus = self.models.bus_mut();
        let model: &mut dyn ErasedDevice = match model {
            Model::Absent => return (bus, None),
            Model::Exti => {
                self.exti.sources = exti::sources(bus.slots()[self.slots.syscfg].registers());
                &mut self.exti
            }
            Model::Flash => &mut self.flash,
            Model::Syscfg => &mut self.syscfg,
            Model::Capture => {
                let clocks = bus.slots()[self.slots.clocks].registers();
                self.capture.follow(self.crystal_hz, clocks);
                &mut self.capture
            }
            Model::Otg => &mut self.otg,
            Model::SmallTimer(nth) => self.timers.model(nth),
        };
        (bus, Some(model))
    }
}
