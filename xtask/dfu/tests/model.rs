//! Boards are written by a model of their chip's bootloader, whole and with what goes wrong.

use std::{cell::RefCell, collections::BTreeMap};

use dfu::{Fault, RomBootloader, Step};
use dfu_core::{
    DfuIo, DfuProtocol, functional_descriptor::FunctionalDescriptor, memory_layout::MemoryLayout,
};
use dfuse_model::{Chip, Device, FLASH, Failure};
use firmware::{boards::Board, flash::Image};

/// A device as the system's USB gives it.
struct ModelIo<'a> {
    device: &'a RefCell<Device>,
    descriptor: FunctionalDescriptor,
    protocol: DfuProtocol<MemoryLayout>,
}

impl<'a> ModelIo<'a> {
    fn new(device: &'a RefCell<Device>) -> Self {
        let read = |value, language| {
            let mut device = device.borrow_mut();
            device.control_in(0x80, 6, value, language, 255).unwrap()
        };
        let configuration = read(0x0200, 0);
        let functional = &configuration[configuration.len() - 9..];
        let descriptor = FunctionalDescriptor::from_bytes(functional).unwrap();
        let descriptor = descriptor.unwrap();
        let name = read(0x0300 | u16::from(configuration[9 + 8]), 0x0409);
        let units = name[2..]
            .chunks(2)
            .map(|it| u16::from_le_bytes([it[0], it[1]]));
        let name: String = char::decode_utf16(units).map(Result::unwrap).collect();
        let protocol = DfuProtocol::new(&name, descriptor.dfu_version).unwrap();
        Self {
            device,
            descriptor,
            protocol,
        }
    }
}

fn fault(failure: Failure) -> Fault {
    match failure {
        Failure::Stall => Fault::Stalled,
        Failure::Gone => Fault::Gone,
    }
}

impl DfuIo for ModelIo<'_> {
    type Read = usize;
    type Write = usize;
    type Reset = ();
    type Error = Fault;
    type MemoryLayout = MemoryLayout;

    fn read_control(
        &self,
        kind: u8,
        request: u8,
        value: u16,
        to: &mut [u8],
    ) -> Result<usize, Fault> {
        let length = to.len() as u16;
        let mut device = self.device.borrow_mut();
        let bytes = device.control_in(kind, request, value, 0, length);
        let bytes = bytes.map_err(fault)?;
        to[..bytes.len()].copy_from_slice(&bytes);
        Ok(bytes.len())
    }

    fn write_control(
        &self,
        kind: u8,
        request: u8,
        value: u16,
        data: &[u8],
    ) -> Result<usize, Fault> {
        let mut device = self.device.borrow_mut();
        let taken = device.control_out(kind, request, value, 0, data);
        taken.map(|()| data.len()).map_err(fault)
    }

    fn usb_reset(self) -> Result<(), Fault> {
        Ok(())
    }

    fn protocol(&self) -> &DfuProtocol<MemoryLayout> {
        &self.protocol
    }

    fn functional_descriptor(&self) -> &FunctionalDescriptor {
        &self.descriptor
    }
}

fn board(name: &str) -> Board {
    firmware::boards::named(name).unwrap()
}

/// The parts of a firmware: vectors, code of a length that fills no block, and constants behind a gap.
fn parts(board: &Board) -> Vec<(u32, Vec<u8>)> {
    let memory = board.chosen_memory();
    let code_at = memory.code_start.unwrap_or(memory.flash_start + 0x1c4);
    let mut vectors = [0x2000_0000 + memory.ram_bytes, code_at | 1]
        .map(u32::to_le_bytes)
        .concat();
    vectors.resize(0x1c4, 0x5a);
    let code: Vec<u8> = (0..150_001_u32)
        .map(|it| (it * 7 + it / 256) as u8)
        .collect();
    let constants_at = code_at + 150_020;
    vec![
        (memory.flash_start, vectors),
        (code_at, code),
        (constants_at, vec![0xa5; 6]),
    ]
}

fn image(board: &Board) -> Image {
    let parts = parts(board);
    let parts: Vec<_> = parts.iter().map(|(at, bytes)| (*at, &bytes[..])).collect();
    Image::of_dfu(board, &formats::dfuse(&parts, &board.title)).unwrap()
}

fn device(chip: &str) -> RefCell<Device> {
    RefCell::new(Device::new(Chip::named(chip).unwrap()))
}

/// Writes the image of a board and starts it, as the command does.
fn flash(board: &Board, device: &RefCell<Device>) -> anyhow::Result<BTreeMap<&'static str, usize>> {
    let loader = RomBootloader::new(ModelIo::new(device), board)?.with_sleep(|_| {});
    let image = image(board);
    let mut done = BTreeMap::new();
    loader.write(&image, |step, bytes| {
        let name = match step {
            Step::Written => "written",
            Step::Compared => "compared",
        };
        *done.entry(name).or_default() += bytes;
    })?;
    loader.start(image.start())?;
    Ok(done)
}

/// What is said when it fails.
fn refusal(board: &Board, device: &RefCell<Device>) -> String {
    format!("{:#}", flash(board, device).unwrap_err())
}

#[test]
fn the_flash_has_the_parts_of_the_image_and_keeps_settings_and_bootloader() {
    for (name, chip) in [
        ("blackpill-f411", "f411"),
        ("btt-octopus-1.1-f446", "f446"),
        ("netduino-plus-2", "f405"),
        // With the other chip of which the chip's file says that the firmware runs on it.
        ("netduino-plus-2", "f429-2m"),
    ] {
        let board = board(name);
        let device = device(chip);
        device.borrow_mut().flash_mut().fill(0x42);
        device.borrow_mut().faults.busy_polls = 1;
        let done = flash(&board, &device).unwrap();
        // The last word of a part is filled.
        let parts_bytes = parts(&board).into_iter();
        let bytes: usize = parts_bytes.map(|it| it.1.len().next_multiple_of(4)).sum();
        assert_eq!([done["written"], done["compared"]], [bytes; 2], "{name}");
        let device = device.borrow();
        let memory = board.chosen_memory();
        assert_eq!(device.started_at(), Some(memory.flash_start), "{name}");
        let mut expected = device.flash().to_vec();
        for (at, bytes) in parts(&board) {
            let at = (at - FLASH) as usize;
            expected[at..at + bytes.len()].copy_from_slice(&bytes);
        }
        assert!(device.flash() == expected, "{name}");
        // Bootloader, settings, and what is behind the image, are as they were.
        let kept = |start: u32, end: u32| {
            let place = (start - FLASH) as usize..(end - FLASH) as usize;
            let bytes = &device.flash()[place];
            assert!(bytes.iter().all(|byte| *byte == 0x42), "{name}: {start:#x}");
        };
        kept(FLASH, memory.flash_start);
        for sector in memory.journal.iter().flatten() {
            kept(sector.address, sector.address + sector.bytes);
        }
        kept(FLASH + 256 * 1024, FLASH + 512 * 1024);
    }
}

#[test]
fn another_chip_is_told_before_anything_is_asked_of_it() {
    for (name, chip, words) in [
        (
            "blackpill-f411",
            "f405",
            "1024 KiB of flash in 12 sectors, an STM32F411CE 512 KiB in 8",
        ),
        (
            "netduino-plus-2",
            "f446",
            "512 KiB of flash in 8 sectors, an STM32F405RG 1024 KiB in 12",
        ),
        (
            "btt-octopus-1.1-f446",
            "f429-2m",
            "2048 KiB of flash in 24 sectors",
        ),
    ] {
        let device = device(chip);
        device.borrow_mut().flash_mut().fill(0x42);
        let error = refusal(&board(name), &device);
        assert!(
            error.starts_with("the chip at USB is not that of a ") && error.contains(words),
            "{error}"
        );
        let device = device.borrow();
        // Both descriptors, and nothing else.
        assert_eq!(device.transfers(), 2);
        assert!(device.flash().iter().all(|byte| *byte == 0x42));
    }
}

#[test]
fn a_board_that_is_unplugged_starts_nothing_and_is_told() {
    let board = board("blackpill-f411");
    let whole = device("f411");
    flash(&board, &whole).unwrap();
    let transfers = whole.borrow().transfers();
    for limit in (2..transfers).step_by(7) {
        let device = device("f411");
        device.borrow_mut().flash_mut().fill(0x42);
        device.borrow_mut().faults.unplugged_after = Some(limit);
        // Behind the last transfer it has left by itself.
        let error = refusal(&board, &device);
        assert!(
            error.contains("the board is no longer at USB"),
            "{limit}: {error}"
        );
        let device = device.borrow();
        let flash = device.flash();
        let is_whole = flash[..0x1c4] == whole.borrow().flash()[..0x1c4];
        let is_old = flash[..0x1c4].iter().all(|byte| *byte == 0x42);
        let has_vectors = flash[..8] != [0xff; 8];
        let code = 0xc000..0xc000 + 150_001;
        let is_written = flash[code.clone()] == whole.borrow().flash()[code];
        assert!(
            is_old || !has_vectors || (is_whole && is_written),
            "{limit}: a half of a program would start"
        );
    }
}

#[test]
fn a_chip_that_refuses_or_forgets_is_told() {
    let board = board("blackpill-f411");
    let with = |change: fn(&mut Device)| {
        let device = device("f411");
        change(&mut device.borrow_mut());
        refusal(&board, &device)
    };
    let error = with(|device| device.faults.no_erase = Some(4));
    assert!(
        error.starts_with("the sector at 0x08010000 is not erased: ")
            && error.contains("write-protected"),
        "{error}"
    );
    let error = with(|device| device.faults.is_protected = true);
    assert!(
        error.contains("the chip is protected from being read"),
        "{error}"
    );
    let error = with(|device| {
        device.faults.stuck = Some(FLASH + 0xc123);
        device.flash_mut()[0xc123] = 0;
    });
    assert!(
        error.starts_with("the chip has 0x00 at 0x0800c123, where "),
        "{error}"
    );
}

#[test]
fn a_device_in_any_state_is_made_ready() {
    let board = board("blackpill-f411");
    for prepare in [
        |device: &mut Device| drop(device.control_in(0xa1, 2, 2, 0, 64)),
        |device: &mut Device| device.control_out(0x21, 1, 2, 0, &[1, 2]).unwrap(),
        |device: &mut Device| assert!(device.control_out(0x21, 1, 9, 0, &[0; 3000]).is_err()),
        |device: &mut Device| {
            device
                .control_out(0x21, 1, 0, 0, &[0x41, 0, 0, 0, 9])
                .unwrap();
            drop(device.control_in(0xa1, 3, 0, 0, 6));
        },
    ] {
        let device = device("f411");
        prepare(&mut device.borrow_mut());
        flash(&board, &device).unwrap();
        assert_eq!(device.borrow().started_at(), Some(FLASH));
    }
}

#[test]
fn a_chip_that_stays_busy_for_ever_is_given_up() {
    let device = device("f411");
    device.borrow_mut().faults.busy_polls = u32::MAX;
    device.borrow_mut().poll_ms = 1000;
    let error = refusal(&board("blackpill-f411"), &device);
    assert!(error.contains("does not answer"), "{error}");
    assert!(
        (30..50).contains(&device.borrow().transfers()),
        "half a minute"
    );
}
