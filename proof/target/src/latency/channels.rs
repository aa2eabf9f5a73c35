//! The firmware's records, out of its memory: `src/board/trace/rings.rs` from the other side.
//!
//! The layout is that of SEGGER's RTT. The debugger moves each ring's reader on, and so makes room;
//! what is read belongs together in a [`Batch`].

use std::path::Path;

use anyhow::{Context, Result, ensure};
use target::emulator::symbol;

/// The firmware's control block, and the counts of the records that it has dropped.
const CONTROL_BLOCK: &str = "_SEGGER_RTT";
const DROPPED: &str = "TRACE_DROPPED";
/// The first bytes of a control block.
const MARK: &[u8; 16] = b"SEGGER RTT\0\0\0\0\0\0";
/// Bytes before its channels, and of each: name, buffer, size, write, read, flags.
const HEAD: usize = 24;
const CHANNEL: usize = 24;
const READ: u32 = 16;
/// The channel that is no task's.
const PANIC: &str = "panic";
/// Longest name of a channel, with its end.
const NAME: usize = 16;
/// Most channels, and most bytes of a ring, that are not taken for nonsense.
const CHANNELS: u32 = 16;
const RING: u32 = 1 << 20;
/// Bytes of a record.
const RECORD: usize = 16;
/// Latency of an activation whose release nobody has seen.
const UNKNOWN: u32 = u32::MAX;

/// The memory of a chip.
pub(super) trait Memory {
    /// Reads bytes.
    fn read(&mut self, address: u32, bytes: &mut [u8]) -> Result<()>;
    /// Writes a word.
    fn write(&mut self, address: u32, word: u32) -> Result<()>;

    /// Reads words.
    fn words(&mut self, address: u32, count: usize) -> Result<Vec<u32>> {
        let mut bytes = vec![0; 4 * count];
        self.read(address, &mut bytes)?;
        Ok(words(&bytes))
    }
}

/// One activation, as the firmware records it. Times are counts of its clock, which wraps.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Record {
    pub(super) start: u32,
    /// To its end, with everything that preempted it.
    pub(super) duration: u32,
    /// From its release to its start, where that is known.
    pub(super) latency: Option<u32>,
    /// Its number among the activations of its task, dropped ones included.
    pub(super) number: u32,
}

/// The records of one read.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Batch {
    /// The firmware's clock, after everything else was read.
    pub(super) now: u32,
    /// Each task's records, and its activations so far.
    pub(super) tasks: Vec<(Vec<Record>, u32)>,
}

/// The rings of a firmware.
pub(super) struct Channels {
    control_block: u32,
    dropped: u32,
    /// The address of the clock's counter.
    clock: u32,
    /// The rings, by their place in the control block.
    rings: Vec<Ring>,
}

struct Ring {
    index: u32,
    name: String,
    buffer: u32,
    size: u32,
    /// Records that have been taken.
    taken: u32,
}

impl Channels {
    /// Finds the rings of a firmware that runs.
    pub(super) fn open(memory: &mut dyn Memory, elf: &Path, clock: u32) -> Result<Self> {
        let control_block = symbol(elf, CONTROL_BLOCK)? as u32;
        let dropped =
            symbol(elf, DROPPED).context("the firmware was built without the feature `trace`")?;
        let rings = rings(memory, control_block)?;
        Ok(Self {
            control_block,
            dropped: dropped as u32,
            clock,
            rings,
        })
    }

    /// The names of the tasks, the highest priority first.
    pub(super) fn tasks(&self) -> impl Iterator<Item = &str> {
        self.rings.iter().map(|ring| &*ring.name)
    }

    /// Takes every record that is there.
    pub(super) fn drain(&mut self, memory: &mut dyn Memory) -> Result<Batch> {
        let mut tasks = Vec::new();
        for ring in &mut self.rings {
            tasks.push((ring.drain(memory, self.control_block)?, ring.taken));
        }
        // Read later: what was dropped meanwhile counts already, what was recorded does not yet.
        let dropped = memory.words(self.dropped, self.rings.len())?;
        for ((_, activations), dropped) in tasks.iter_mut().zip(dropped) {
            *activations = activations.wrapping_add(dropped);
        }
        let now = memory.words(self.clock, 1)?;
        Ok(Batch { now: now[0], tasks })
    }
}

/// Reads the control block.
fn rings(memory: &mut dyn Memory, control_block: u32) -> Result<Vec<Ring>> {
    let mut head = [0; HEAD];
    memory.read(control_block, &mut head)?;
    ensure!(head.starts_with(MARK), "the firmware does not run yet");
    let count = words(&head[MARK.len()..])[0];
    ensure!(
        count <= CHANNELS,
        "the firmware says it has {count} channels"
    );
    let mut rings = Vec::new();
    for index in 0..count {
        let channel = memory.words(descriptor(control_block, index), CHANNEL / 4)?;
        let mut name = [0; NAME];
        memory.read(channel[0], &mut name)?;
        let end = name.iter().position(|byte| *byte == 0).unwrap_or(NAME);
        let name = String::from_utf8_lossy(&name[..end]).into_owned();
        if name == PANIC {
            continue;
        }
        let size = channel[2];
        ensure!(
            size.is_multiple_of(RECORD as u32) && (1..=RING).contains(&size),
            "the ring of {name} has {size} bytes"
        );
        rings.push(Ring {
            index,
            name,
            buffer: channel[1],
            size,
            taken: 0,
        });
    }
    Ok(rings)
}

/// Where a channel's description is.
fn descriptor(control_block: u32, index: u32) -> u32 {
    control_block + HEAD as u32 + index * CHANNEL as u32
}

impl Ring {
    /// Takes every record that is there.
    fn drain(&mut self, memory: &mut dyn Memory, control_block: u32) -> Result<Vec<Record>> {
        let places = descriptor(control_block, self.index) + READ - 4;
        let places = (places, memory.words(places, 2)?);
        let (&[write, read], place) = (&[places.1[0], places.1[1]], places.0 + 4);
        ensure!(
            write < self.size && read < self.size,
            "the ring of {} is damaged",
            self.name
        );
        let stretches = if read <= write {
            [(read, write), (0, 0)]
        } else {
            [(read, self.size), (0, write)]
        };
        let mut bytes = Vec::new();
        for (from, to) in stretches {
            let start = bytes.len();
            bytes.resize(start + (to - from) as usize, 0);
            if from != to {
                memory.read(self.buffer + from, &mut bytes[start..])?;
            }
        }
        if read != write {
            memory.write(place, write)?;
        }
        let records = bytes.chunks_exact(RECORD).zip(self.taken..);
        let records: Vec<_> = records
            .map(|(bytes, taken)| Record::parse(bytes, taken))
            .collect();
        self.taken = self.taken.wrapping_add(records.len() as u32);
        Ok(records)
    }
}

impl Record {
    /// Reads a record before which so many have been taken.
    fn parse(bytes: &[u8], taken: u32) -> Self {
        let words = words(bytes);
        Self {
            start: words[0],
            duration: words[1],
            latency: (words[2] != UNKNOWN).then_some(words[2]),
            number: taken.wrapping_add(words[3]),
        }
    }
}

fn words(bytes: &[u8]) -> Vec<u32> {
    let (words, _) = bytes.as_chunks();
    words.iter().map(|word| u32::from_le_bytes(*word)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Memory from address 0 on, with a control block at its beginning.
    struct Ram(Vec<u8>);

    impl Memory for Ram {
        fn read(&mut self, address: u32, bytes: &mut [u8]) -> Result<()> {
            let at = address as usize;
            bytes.copy_from_slice(&self.0[at..at + bytes.len()]);
            Ok(())
        }

        fn write(&mut self, address: u32, word: u32) -> Result<()> {
            self.0[address as usize..][..4].copy_from_slice(&word.to_le_bytes());
            Ok(())
        }
    }

    const BUFFER: u32 = 0x100;
    const COUNTS: u32 = 0x200;
    const CLOCK: u32 = 0x210;

    /// A chip with the panic's channel and one ring of four records, and its reader.
    fn chip() -> (Ram, Channels) {
        let mut ram = Ram(vec![0; 0x300]);
        ram.0[..16].copy_from_slice(MARK);
        ram.0[0x80..0x86].copy_from_slice(b"panic\0");
        ram.0[0x90..0x95].copy_from_slice(b"step\0");
        for (address, word) in [(16, 2), (24, 0x80), (48, 0x90), (52, BUFFER), (56, 64)] {
            ram.write(address, word).unwrap();
        }
        let rings = rings(&mut ram, 0).unwrap();
        let channels = Channels {
            control_block: 0,
            dropped: COUNTS,
            clock: CLOCK,
            rings,
        };
        (ram, channels)
    }

    /// Writes a record as the firmware does, whatever the reader's place.
    fn record(ram: &mut Ram, number: u32) {
        let place = ram.words(60, 1).unwrap()[0];
        // One was dropped before the second.
        let dropped = u32::from(number > 0);
        for (index, word) in (0..).zip([100 * number, 7, UNKNOWN, dropped]) {
            ram.write(BUFFER + place + 4 * index, word).unwrap();
        }
        ram.write(60, (place + 16) % 64).unwrap();
    }

    #[test]
    fn records_are_read_once_and_round_the_end_of_the_ring() {
        let (mut ram, mut channels) = chip();
        assert_eq!(channels.tasks().collect::<Vec<_>>(), ["step"]);
        ram.write(COUNTS, 1).unwrap();
        ram.write(CLOCK, 999).unwrap();
        let (mut seen, mut counts) = (Vec::new(), Vec::new());
        for group in [0..3, 3..5, 5..5] {
            group.for_each(|number| record(&mut ram, number));
            let batch = channels.drain(&mut ram).unwrap();
            assert_eq!(batch.now, 999);
            let (records, activations) = &batch.tasks[0];
            counts.push(*activations);
            seen.extend(records.iter().map(|record| record.number));
        }
        assert_eq!(seen, [0, 2, 3, 4, 5]);
        assert_eq!(counts, [4, 6, 6]);
    }

    #[test]
    fn a_record_says_when_the_release_is_unknown() {
        let mut bytes = [0; 16];
        bytes[8..12].copy_from_slice(&3_u32.to_le_bytes());
        assert_eq!(Record::parse(&bytes, 0).latency, Some(3));
        bytes[8..12].copy_from_slice(&UNKNOWN.to_le_bytes());
        assert_eq!(Record::parse(&bytes, 0).latency, None);
    }

    #[test]
    fn memory_without_a_control_block_is_refused() {
        let mut ram = Ram(vec![0; 64]);
        assert!(rings(&mut ram, 0).is_err());
        let (mut ram, _) = chip();
        ram.write(56, 63).unwrap();
        assert!(rings(&mut ram, 0).is_err(), "no whole records");
    }
}
