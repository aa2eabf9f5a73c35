//! The bootloader in the chip's ROM: what it is told, by ST AN3156.
//!
//! Only the sectors are erased in which the image has bytes. The first bytes, which are the vectors, are erased first and
//! written last: a board that is unplugged in between has none, and starts no half of a program.

use std::{ops::Range, thread, time::Duration};

use anyhow::{Context as _, Result, ensure};
use dfu_core::{DfuIo, DfuProtocol, State, Status, memory_layout::MemoryLayout};
use firmware::{boards::Board, flash::Image};

use crate::Fault;

/// Start of the flash of every chip.
const FLASH: u32 = 0x0800_0000;
/// Requests of USB DFU 1.1, table 3.2, to the interface and from it.
const OUT: u8 = 0x21;
const IN: u8 = 0xa1;
const DNLOAD: u8 = 1;
const UPLOAD: u8 = 2;
const GETSTATUS: u8 = 3;
const CLRSTATUS: u8 = 4;
const ABORT: u8 = 6;
/// Commands of AN3156, and the number of the block at the address pointer: which length counts in the address of a block
/// behind it, is read in two ways.
const COMMAND: u16 = 0;
const SET_ADDRESS: u8 = 0x21;
const ERASE: u8 = 0x41;
const BLOCK: u16 = 2;
/// A word of the flash: no block is shorter.
const WORD_BYTES: usize = 4;
/// What is written to bytes that stay erased.
const ERASED: u8 = 0xff;
/// The longest that a command may take, and the shortest wait between two questions. A sector takes up to 4 s.
const MAX_COMMAND_TIME: Duration = Duration::from_secs(30);
const SHORTEST_WAIT: Duration = Duration::from_millis(1);
/// Requests after which a device is idle, from any state.
const MOST_REQUESTS: usize = 4;

/// What is done with some bytes of the image.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Step {
    /// They are written.
    Written,
    /// They are read back, and are right.
    Compared,
}

/// A device of the model or of the system.
pub trait Device:
    DfuIo<Read = usize, Write = usize, Error = Fault, MemoryLayout = MemoryLayout>
{
}

impl<D> Device for D where
    D: DfuIo<Read = usize, Write = usize, Error = Fault, MemoryLayout = MemoryLayout>
{
}

/// The bootloader of the chip of a board.
pub struct RomBootloader<D> {
    device: D,
    sectors: Vec<Range<u32>>,
    block_bytes: usize,
    sleep: fn(Duration),
}

impl<D: Device> RomBootloader<D> {
    /// Takes a device that is the bootloader of the board's chip.
    pub fn new(device: D, board: &Board) -> Result<Self> {
        let descriptor = device.functional_descriptor();
        ensure!(
            descriptor.can_download && descriptor.can_upload,
            "the device at USB is no bootloader that can be written and read"
        );
        let block_bytes = usize::from(descriptor.transfer_size) / WORD_BYTES * WORD_BYTES;
        ensure!(block_bytes > 0, "the device at USB takes no bytes");
        let DfuProtocol::Dfuse {
            address: FLASH,
            memory_layout,
        } = device.protocol()
        else {
            anyhow::bail!("the device at USB is no bootloader of an STM32: it has no flash");
        };
        compare_layout(memory_layout, board)?;
        let sectors = memory_layout.iter().scan(FLASH, |next, bytes| {
            let start = *next;
            *next += bytes;
            Some(start..*next)
        });
        let sectors = sectors.collect();
        Ok(Self {
            device,
            sectors,
            block_bytes,
            sleep: thread::sleep,
        })
    }

    /// Lets another function wait.
    #[must_use]
    pub fn with_sleep(self, sleep: fn(Duration)) -> Self {
        Self { sleep, ..self }
    }

    /// Brings the bootloader into the state in which it takes an image, whatever it was asked for before.
    pub fn make_ready(&self) -> Result<()> {
        let ready = self.idle();
        ready.context("the chip's bootloader is not ready, and nothing was erased")
    }

    /// Writes an image, and compares it with what is read back. `progress` is told bytes as they are done.
    pub fn write(&self, image: &Image, mut progress: impl FnMut(Step, usize)) -> Result<()> {
        self.make_ready()?;
        let blocks = self.blocks(image);
        for sector in &self.sectors {
            let has_bytes = |(start, bytes): &(u32, Vec<u8>)| {
                *start < sector.end && start + bytes.len() as u32 > sector.start
            };
            if image.parts().iter().any(has_bytes) {
                self.command(ERASE, sector.start).with_context(|| {
                    format!("the sector at {:#010x} is not erased", sector.start)
                })?;
            }
        }
        for (address, bytes) in blocks.iter().rev() {
            self.command(SET_ADDRESS, *address)
                .and_then(|()| self.download(BLOCK, bytes))
                .with_context(|| format!("the bytes from {address:#010x} on are not written"))?;
            progress(Step::Written, bytes.len());
        }
        for (address, bytes) in &blocks {
            let read = self.read(*address, bytes.len());
            let read = read.with_context(|| format!("{address:#010x} cannot be read back"))?;
            let mut pairs = read.iter().zip(bytes).zip(*address..);
            if let Some(((read, written), at)) = pairs.find(|((read, written), _)| read != written)
            {
                anyhow::bail!(
                    "the chip has {read:#04x} at {at:#010x}, where {written:#04x} was written: its flash is worn, or \
                     the supply is weak"
                );
            }
            ensure!(
                read.len() == bytes.len(),
                "{address:#010x} cannot be read back"
            );
            progress(Step::Compared, bytes.len());
        }
        Ok(())
    }

    /// Starts the program at an address: the bootloader leaves.
    pub fn start(&self, address: u32) -> Result<()> {
        let left = || -> Result<(), Fault> {
            self.idle()?;
            self.command(SET_ADDRESS, address)?;
            self.device.write_control(OUT, DNLOAD, COMMAND, &[])?;
            match self.status() {
                // It goes before it answers, which each system reports in its own form.
                Ok((_, State::DfuManifest | State::DfuManifestSync, _)) | Err(_) => Ok(()),
                Ok((status, ..)) => Err(Fault::Refused(status)),
            }
        };
        left().context("the firmware is written and right, and does not start by itself: switch the board off and on")
    }

    /// The image in blocks, in the order of their addresses. The last word of a part is filled.
    fn blocks(&self, image: &Image) -> Vec<(u32, Vec<u8>)> {
        let mut blocks = Vec::new();
        for (start, bytes) in image.parts() {
            let starts = (*start..).step_by(self.block_bytes);
            for (address, block) in starts.zip(bytes.chunks(self.block_bytes)) {
                let mut block = block.to_vec();
                block.resize(block.len().next_multiple_of(WORD_BYTES), ERASED);
                blocks.push((address, block));
            }
        }
        blocks
    }

    fn read(&self, address: u32, length: usize) -> Result<Vec<u8>, Fault> {
        self.idle()?;
        self.command(SET_ADDRESS, address)?;
        self.idle()?;
        let mut bytes = vec![0; length];
        let read = self.device.read_control(IN, UPLOAD, BLOCK, &mut bytes)?;
        bytes.truncate(read);
        Ok(bytes)
    }

    fn command(&self, code: u8, address: u32) -> Result<(), Fault> {
        let [a, b, c, d] = address.to_le_bytes();
        self.download(COMMAND, &[code, a, b, c, d])
    }

    /// Hands bytes over, and waits until the chip has done with them what is to be done.
    fn download(&self, block: u16, bytes: &[u8]) -> Result<(), Fault> {
        self.device.write_control(OUT, DNLOAD, block, bytes)?;
        let mut waited = Duration::ZERO;
        loop {
            match self.status()? {
                (_, State::DfuDnloadIdle, _) => return Ok(()),
                (_, State::DfuDnbusy | State::DfuDnloadSync, wait) => {
                    if waited > MAX_COMMAND_TIME {
                        return Err(Fault::Silent);
                    }
                    let wait = wait.clamp(SHORTEST_WAIT, MAX_COMMAND_TIME);
                    (self.sleep)(wait);
                    waited += wait;
                }
                (status, ..) => {
                    self.idle()?;
                    return Err(Fault::Refused(status));
                }
            }
        }
    }

    /// Brings the device into the state in which it takes any command.
    fn idle(&self) -> Result<(), Fault> {
        for _ in 0..MOST_REQUESTS {
            let request = match self.status()? {
                (_, State::DfuIdle, _) => return Ok(()),
                (_, State::DfuError, _) => CLRSTATUS,
                (_, State::DfuDnbusy, wait) => {
                    (self.sleep)(wait.clamp(SHORTEST_WAIT, MAX_COMMAND_TIME));
                    continue;
                }
                _ => ABORT,
            };
            self.device.write_control(OUT, request, 0, &[])?;
        }
        Err(Fault::Silent)
    }

    /// Status, state, and the time until the next question.
    fn status(&self) -> Result<(Status, State, Duration), Fault> {
        let mut answer = [0; 6];
        let read = self.device.read_control(IN, GETSTATUS, 0, &mut answer)?;
        if read < answer.len() {
            return Err(Fault::Silent);
        }
        let [status, a, b, c, state, _] = answer;
        let wait = Duration::from_millis(u32::from_le_bytes([a, b, c, 0]).into());
        Ok((status.into(), state.into(), wait))
    }
}

/// Makes sure that the flash of a device is of the board's chip.
fn compare_layout(found: &[u32], board: &Board) -> Result<()> {
    let in_kib: Vec<_> = found.iter().map(|bytes| bytes / 1024).collect();
    let flashes = board.flashes_kib();
    ensure!(
        flashes.contains(&in_kib),
        "the chip at USB is not that of a {}: it has {} KiB of flash in {} sectors, an STM32{} {} KiB in {}",
        board.title,
        in_kib.iter().sum::<u32>(),
        found.len(),
        board.part_name,
        board.part.flash_kib,
        flashes[0].len()
    );
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn two_banks_are_of_a_chip_that_has_them() {
        const KIB: u32 = 1024;
        let half = [16, 16, 16, 16, 64, 128, 128, 128].map(|kib| kib * KIB);
        let whole = [&half[..], &[128 * KIB; 4]].concat();
        for (name, found, is_taken) in [
            ("btt-octopus-1.1-f446", &half[..], true),
            ("btt-octopus-1.1-f446", &[half, half].concat(), false),
            ("mks-robin-nano-v3", &half, true),
            ("mks-robin-nano-v3", &whole, true),
            ("mks-robin-nano-v3", &[half, half].concat(), false),
            ("netduino-plus-2", &whole, true),
            ("netduino-plus-2", &[&whole[..], &whole].concat(), true),
            ("netduino-plus-2", &whole[1..], false),
        ] {
            let board = firmware::boards::named(name).unwrap();
            let is_same = compare_layout(found, &board).is_ok();
            assert_eq!(is_same, is_taken, "{name}: {} sectors", found.len());
        }
    }
}
