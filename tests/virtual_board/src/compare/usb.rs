//! The registers of USB, once a host has set the device up: RM0090 6.3.2, 8.4 and 34.16, RM0390 31.15, ES0182.

use std::ops::RangeInclusive;

use rigless::soc::stm32f427::generated::rcc as clock_registers;

use crate::chip::Chip;

const GPIOA_MODER: u64 = 0x4002_0000;
const GPIOA_OSPEEDR: u64 = 0x4002_0008;
const GPIOA_AFRH: u64 = 0x4002_0024;
/// D- and D+, their function and the speed of the fastest outputs: data sheets.
const PINS: [u64; 2] = [11, 12];
const ALTERNATE: u64 = 2;
const OTG_FUNCTION: u64 = 10;
const VERY_HIGH: u64 = 3;
/// Registers of the core and their bits.
const GOTGCTL: usize = 0x000;
const GUSBCFG: usize = 0x00C;
const GCCFG: usize = 0x038;
const CID: usize = 0x03C;
const BVALOEN_BVALOVAL: u32 = 3 << 6;
const PHYSEL: u32 = 1 << 6;
const FDMOD: u32 = 1 << 30;
const PWRDWN: u32 = 1 << 16;
const VBUSASEN: u32 = 1 << 18;
const VBUSBSEN: u32 = 1 << 19;
/// Of the first version `NOVBUSSENS`, of the second `VBDEN`.
const SENSING: u32 = 1 << 21;
const VERSION_2: u32 = 0x2000;
/// How long a host has to see no device, µs: ES0182 2.11.
const LEAST_DISCONNECT_US: u64 = 3000;
/// 48 MHz within 0.25 %, which the internal oscillator is not: USB 2.0 7.1.11.
const TRANSCEIVER_HZ: RangeInclusive<u64> = 47_880_000..=48_120_000;

/// Everything that is not as it must be.
pub(crate) fn faults(chip: &mut Chip) -> Vec<String> {
    let mut faults = pins(chip);
    faults.extend(clocks(chip));
    faults.extend(core(chip));
    faults
}

fn pins(chip: &mut Chip) -> Vec<String> {
    let mut faults = Vec::new();
    for number in PINS {
        for (name, register, position, bits, expected) in [
            ("MODER", GPIOA_MODER, number, 2, ALTERNATE),
            ("OSPEEDR", GPIOA_OSPEEDR, number, 2, VERY_HIGH),
            ("AFR", GPIOA_AFRH, number - 8, 4, OTG_FUNCTION),
        ] {
            let is = chip.word(register) >> (bits * position) & ((1 << bits) - 1);
            if is != expected {
                faults.push(format!(
                    "A{number}, USB: GPIOA_{name} has {is} instead of {expected}"
                ));
            }
        }
    }
    faults
}

fn clocks(chip: &mut Chip) -> Vec<String> {
    let mut faults = Vec::new();
    let (clocks, registers) = chip.models.clocks();
    let enabled = registers.get(clock_registers::Register::Ahb2enr);
    if !clock_registers::ahb2enr::OTGFSEN.is_set(enabled) {
        faults.push("RCC_AHB2ENR: OTGFSEN is clear".into());
    }
    let factors = registers.get(clock_registers::Register::Pllcfgr);
    if !clock_registers::pllcfgr::PLLSRC.is_set(factors) {
        faults.push("RCC_PLLCFGR: USB has the internal oscillator's clock".into());
    }
    let hz = clocks.pll48(registers);
    if !TRANSCEIVER_HZ.contains(&hz) {
        faults.push(format!(
            "RCC_PLLCFGR makes {hz} Hz for USB instead of 48 MHz"
        ));
    }
    faults
}

fn core(chip: &Chip) -> Vec<String> {
    let core = &chip.otg.core;
    let has = |offset, bits: u32| core.peek(offset).unwrap_or_default() & bits == bits;
    let is_second = has(CID, VERSION_2);
    let is_long = { core.disconnect_us() }.is_some_and(|us| us >= LEAST_DISCONNECT_US);
    let of_version: &[_] = if is_second {
        &[
            (!has(GCCFG, SENSING), "GCCFG: VBDEN is set"),
            (
                has(GOTGCTL, BVALOEN_BVALOVAL),
                "GOTGCTL: BVALOEN or BVALOVAL is clear",
            ),
        ]
    } else {
        &[
            (has(GCCFG, SENSING), "GCCFG: NOVBUSSENS is clear"),
            (!has(GCCFG, VBUSBSEN), "GCCFG: VBUSBSEN is set"),
            (!has(GCCFG, VBUSASEN), "GCCFG: VBUSASEN is set"),
        ]
    };
    let of_both = [
        (has(GUSBCFG, FDMOD), "GUSBCFG: FDMOD is clear"),
        (has(GUSBCFG, PHYSEL), "GUSBCFG: PHYSEL is clear"),
        (has(GCCFG, PWRDWN), "GCCFG: PWRDWN is clear"),
        (
            is_long,
            "DCTL: SDIS is not set for 3 ms before the connection",
        ),
    ];
    let rules = of_both.iter().chain(of_version);
    let broken = rules.filter(|(is_kept, _)| !is_kept);
    broken.map(|(_, what)| format!("OTG_FS_{what}")).collect()
}
