//! The flash: the crate's model of its registers, and the array, which that lacks. A sector is erased when its erasure
//! begins, and a word programmed when it is stored, RM0090 3.6.3 and 3.6.4; RM0383 3.5, RM0390 3.5. `BSY` tells of both
//! from the second read on, as it comes some cycles late on chips, until their time is over.
//!
//! An erasure is over after some ms, not after the seconds of the data sheets: while the firmware looks at `BSY`, 100 ms
//! of the board's time take a second of the host's.

use std::collections::BTreeMap;

use board_data::Board;
use rigless::{
    device::{Device, DeviceContext, RegisterFile},
    soc::{
        Width,
        stm32f427::{
            generated::flash::{Register, cr, sr},
            peripherals::{flash::Flash, flash::LOCK, flash::STRT, rcc},
        },
    },
    time::{EventId, VirtualNanos},
};

use super::memory;

/// How long an erasure takes where nothing else is asked for.
const ERASE_NS: u64 = 20_000_000;
/// How long a word takes, of any width: data sheets, `t_prog`, typical.
const PROGRAM_NS: u64 = 16_000;

/// Something done to the array.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Change {
    /// Bytes are erased: the first address, and how many.
    Erased(u64, u64),
    /// Bytes are programmed.
    Programmed(u64, u64),
    /// A store without `PG`, which changes nothing and is an error.
    NotEnabled(u64),
    /// A store of another width than `PSIZE` says, which changes nothing and is an error: RM0090 3.6.2.
    OtherSize(u64),
    /// A write to `CR` or a store before what was begun is over. The chip's bus stalls until then, RM0090 3.6.1; here
    /// the write to `CR` is lost.
    WhileBusy,
    /// A store that would set a bit which a store before has cleared: RM0090 3.6.4.
    Sets(u64),
}

/// The registers and the array.
#[derive(Debug)]
pub(crate) struct FlashWithArray {
    pub(super) registers: Flash,
    sectors: Vec<(u64, u64)>,
    /// What was programmed since an erasure, by address.
    programmed: BTreeMap<u64, u64>,
    /// What has been done and nobody has looked at.
    pub(crate) changes: Vec<Change>,
    /// The supply has been cut: nothing changes any more.
    pub(crate) is_cut: bool,
    /// How long an erasure takes.
    pub(crate) erase_ns: u64,
    /// The end of what makes the flash busy.
    end: Option<EventId>,
    /// `BSY` has not been read since that began.
    hides_busy: bool,
}

impl FlashWithArray {
    pub(super) fn new(board: &Board) -> Self {
        Self {
            registers: Flash::with_clock(rcc::HSI_HZ),
            sectors: memory::sectors(board),
            programmed: BTreeMap::new(),
            changes: Vec::new(),
            is_cut: false,
            erase_ns: ERASE_NS,
            end: None,
            hides_busy: false,
        }
    }

    /// Bytes are erased, or hold what nobody knows here.
    pub(crate) fn forget(&mut self, start: u64, bytes: u64) {
        self.programmed
            .retain(|address, _| !(start..start + bytes).contains(address));
    }

    /// The chip has been reset: nothing is under way.
    pub(super) fn reset(&mut self) {
        self.registers = Flash::with_clock(rcc::HSI_HZ);
        self.end = None;
        self.hides_busy = false;
    }

    /// Programs a word, or says why the chip does not.
    fn store(
        &mut self,
        address: u64,
        width: Width,
        value: u64,
        control: u64,
    ) -> Result<u64, Change> {
        if !cr::PG.is_set(control) {
            return Err(Change::NotEnabled(address));
        }
        if u64::from(width.bytes()) != 1 << cr::PSIZE.get(control) {
            return Err(Change::OtherSize(address));
        }
        let before = self.programmed.get(&address).copied().unwrap_or(u64::MAX);
        if value & !before != 0 {
            return Err(Change::Sets(address));
        }
        self.programmed.insert(address, value);
        Ok(value)
    }

    fn be_busy(&mut self, ns: u64, registers: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        registers.set(Register::Sr, sr::BSY.set(registers.get(Register::Sr), 1));
        self.hides_busy = true;
        self.end = Some(context.schedule(VirtualNanos(context.now().0 + ns)));
    }

    /// Erases a sector; the registers are unlocked.
    fn erase(
        &mut self,
        number: u64,
        registers: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
    ) {
        let Some(&(start, bytes)) = self.sectors.get(number as usize) else {
            registers.set(
                Register::Sr,
                registers.get(Register::Sr) | sr::WRPERR.mask(),
            );
            return;
        };
        self.be_busy(self.erase_ns, registers, context);
        if !self.is_cut {
            self.changes.push(Change::Erased(start, bytes));
            self.forget(start, bytes);
            for address in (start..start + bytes).step_by(4) {
                context.program(address, Width::W32, 0xFFFF_FFFF, 0);
            }
        }
    }
}

impl Device for FlashWithArray {
    type Register = Register;

    fn read(
        &mut self,
        register: Register,
        registers: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
    ) -> Option<u64> {
        if register == Register::Sr && std::mem::take(&mut self.hides_busy) {
            return Some(sr::BSY.set(registers.get(register), 0));
        }
        Device::read(&mut self.registers, register, registers, context)
    }

    fn write(
        &mut self,
        register: Register,
        value: u64,
        registers: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
    ) {
        if register == Register::Cr && sr::BSY.is_set(registers.get(Register::Sr)) {
            self.changes.push(Change::WhileBusy);
        }
        let is_erasure = register == Register::Cr && STRT.is_set(value) && cr::SER.is_set(value);
        let is_locked = LOCK.is_set(registers.get(Register::Cr));
        if is_erasure && !is_locked {
            registers.set(Register::Cr, STRT.set(value, 0));
            self.erase(cr::SNB.get(value), registers, context);
        } else {
            Device::write(&mut self.registers, register, value, registers, context);
        }
    }

    fn on_event(
        &mut self,
        event: EventId,
        registers: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
    ) {
        if self.end == Some(event) {
            self.end = None;
            registers.set(Register::Sr, sr::BSY.set(registers.get(Register::Sr), 0));
        } else {
            Device::on_event(&mut self.registers, event, registers, context);
        }
    }

    fn on_clock(&mut self, hz: u64, registers: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        Device::on_clock(&mut self.registers, hz, registers, context);
    }

    fn write_region(
        &mut self,
        address: u64,
        width: Width,
        value: u64,
        registers: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
    ) -> bool {
        if self.is_cut {
            return true;
        }
        if sr::BSY.is_set(registers.get(Register::Sr)) {
            self.changes.push(Change::WhileBusy);
        }
        match self.store(address, width, value, registers.get(Register::Cr)) {
            Ok(word) => {
                let bytes = u64::from(width.bytes());
                self.changes.push(Change::Programmed(address, bytes));
                context.program(address, width, word, 0);
                self.be_busy(PROGRAM_NS, registers, context);
            }
            Err(refused) => {
                self.changes.push(refused);
                let flag = match refused {
                    Change::OtherSize(_) => sr::PGPERR,
                    _ => sr::PGSERR,
                };
                registers.set(Register::Sr, flag.set(registers.get(Register::Sr), 1));
            }
        }
        true
    }
}
