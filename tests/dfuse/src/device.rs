//! The device, as it answers control transfers.

use std::{error::Error, fmt};

use crate::{Chip, flash::FLASH, flash::Flash};

/// The most bytes of a block.
pub const TRANSFER_BYTES: u16 = 2048;
/// AN3156 wants at least two bytes.
const LEAST_BYTES: usize = 2;

/// Why a transfer has no answer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Failure {
    /// The device stalls it.
    Stall,
    /// The device is no longer at the bus.
    Gone,
}

impl fmt::Display for Failure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Stall => "stall",
            Self::Gone => "gone",
        })
    }
}

impl Error for Failure {}

/// What is wrong with a device or its cable.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Faults {
    /// The cable is pulled out after as many transfers.
    pub unplugged_after: Option<u64>,
    /// The number of a sector that cannot be erased: a write protection.
    pub no_erase: Option<usize>,
    /// An address of the flash whose byte stays as it is.
    pub stuck: Option<u32>,
    /// The flash is protected from being read: nothing can be read, erased or written.
    pub is_protected: bool,
    /// As many more GETSTATUS after a command find the device busy.
    pub busy_polls: u32,
}

/// Requests of USB DFU 1.1, table 3.2; in DFU mode, DETACH is none.
const DNLOAD: u8 = 1;
const UPLOAD: u8 = 2;
const GETSTATUS: u8 = 3;
const CLRSTATUS: u8 = 4;
const GETSTATE: u8 = 5;
const ABORT: u8 = 6;
/// Standard requests, USB 2.0, table 9-4.
const GET_STATUS: u8 = 0;
const GET_DESCRIPTOR: u8 = 6;
const GET_CONFIGURATION: u8 = 8;
const SET_CONFIGURATION: u8 = 9;
const GET_INTERFACE: u8 = 10;
const SET_INTERFACE: u8 = 11;
/// To the device and to an interface, standard and of the class; with the bit of the direction from the device.
const TO_DEVICE: u8 = 0x00;
const TO_INTERFACE: u8 = 0x01;
const CLASS: u8 = 0x21;
const IN: u8 = 0x80;
/// Commands of AN3156.
const GET: u8 = 0x00;
const SET_ADDRESS: u8 = 0x21;
const ERASE: u8 = 0x41;
const READ_UNPROTECT: u8 = 0x92;

/// USB DFU 1.1, 6.1.2: `bState`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
enum State {
    Idle = 2,
    DownloadSync = 3,
    DownloadBusy = 4,
    DownloadIdle = 5,
    ManifestSync = 6,
    Manifest = 7,
    UploadIdle = 9,
    Error = 10,
}

/// The same: `bStatus`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
enum Status {
    Ok = 0,
    Target = 1,
    Erase = 4,
    Vendor = 0x0b,
    Unknown = 0x0e,
    StalledPacket = 0x0f,
}

/// What the next GETSTATUS executes.
#[derive(Debug, Clone, PartialEq, Eq)]
enum Command {
    Write { block: u16, bytes: Vec<u8> },
    SetAddress(u32),
    Erase(u32),
    EraseAll,
    ReadUnprotect,
}

/// The bootloader of a chip at the bus.
#[derive(Debug)]
pub struct Device {
    chip: Chip,
    flash: Flash,
    /// May be changed at any time.
    pub faults: Faults,
    /// What GETSTATUS says of the time until the next one, ms.
    pub poll_ms: u32,
    state: State,
    status: Status,
    command: Option<Command>,
    /// Polls for which a command is still busy, and the error with which it ends.
    polls: u32,
    result: Status,
    pointer: u32,
    configuration: u8,
    alternate: u8,
    transfers: u64,
    started_at: Option<u32>,
    is_gone: bool,
}

impl Device {
    /// Returns the device of a chip whose flash is erased, configured by its host.
    #[must_use]
    pub fn new(chip: Chip) -> Self {
        Self {
            chip,
            flash: Flash::new(chip),
            faults: Faults::default(),
            poll_ms: 0,
            state: State::Idle,
            status: Status::Ok,
            command: None,
            polls: 0,
            result: Status::Ok,
            pointer: FLASH,
            configuration: 1,
            alternate: 0,
            transfers: 0,
            started_at: None,
            is_gone: false,
        }
    }

    /// Returns the flash, from its first address.
    #[must_use]
    pub fn flash(&self) -> &[u8] {
        self.flash.bytes()
    }

    /// Returns the flash, to put into it what was there before.
    pub fn flash_mut(&mut self) -> &mut [u8] {
        self.flash.bytes_mut()
    }

    /// Returns the address at which the device has started a program: it has left.
    #[must_use]
    pub fn started_at(&self) -> Option<u32> {
        self.started_at
    }

    /// Returns the number of transfers until now.
    #[must_use]
    pub fn transfers(&self) -> u64 {
        self.transfers
    }

    /// Answers a transfer to the host.
    ///
    /// # Errors
    /// The device stalls it, or is gone.
    pub fn control_in(
        &mut self,
        request_type: u8,
        request: u8,
        value: u16,
        index: u16,
        length: u16,
    ) -> Result<Vec<u8>, Failure> {
        self.begin()?;
        let length = usize::from(length);
        let mut answer = match (request_type, request) {
            (kind, GET_STATUS) if kind & !1 == IN => vec![0, 0],
            (kind, GET_DESCRIPTOR) if kind == IN | TO_DEVICE => self.descriptor(value)?,
            (kind, GET_CONFIGURATION) if kind == IN | TO_DEVICE => vec![self.configuration],
            (kind, GET_INTERFACE) if kind == IN | TO_INTERFACE && index == 0 => {
                vec![self.alternate]
            }
            (kind, _) if kind == IN | CLASS && index == 0 && self.configuration != 0 => {
                match request {
                    UPLOAD => self.upload(value, length)?,
                    GETSTATUS => self.get_status(),
                    GETSTATE => vec![self.state as u8],
                    _ => return self.stall(),
                }
            }
            _ => return Err(Failure::Stall),
        };
        answer.truncate(length);
        Ok(answer)
    }

    /// Takes a transfer from the host.
    ///
    /// # Errors
    /// The device stalls it, or is gone.
    pub fn control_out(
        &mut self,
        request_type: u8,
        request: u8,
        value: u16,
        index: u16,
        data: &[u8],
    ) -> Result<(), Failure> {
        self.begin()?;
        match (request_type, request) {
            (TO_DEVICE, SET_CONFIGURATION) if value <= 1 => {
                self.configuration = value as u8;
                self.alternate = 0;
                Ok(())
            }
            (TO_INTERFACE, SET_INTERFACE) if index == 0 && value < 4 => {
                self.alternate = value as u8;
                Ok(())
            }
            (CLASS, _) if index == 0 && self.configuration != 0 => match request {
                DNLOAD => self.download(value, data),
                CLRSTATUS => {
                    self.clear_status();
                    Ok(())
                }
                ABORT => self.abort(),
                _ => self.stall(),
            },
            _ => Err(Failure::Stall),
        }
    }

    /// Begins a transfer.
    fn begin(&mut self) -> Result<(), Failure> {
        let limit = self.faults.unplugged_after;
        self.is_gone |= limit.is_some_and(|limit| self.transfers >= limit);
        if self.is_gone {
            return Err(Failure::Gone);
        }
        self.transfers += 1;
        Ok(())
    }

    /// Stalls a request of the class, which is an error.
    fn stall<T>(&mut self) -> Result<T, Failure> {
        self.fail(Status::StalledPacket);
        Err(Failure::Stall)
    }

    fn fail(&mut self, status: Status) {
        (self.state, self.status) = (State::Error, status);
        self.command = None;
    }

    fn download(&mut self, block: u16, data: &[u8]) -> Result<(), Failure> {
        if !matches!(self.state, State::Idle | State::DownloadIdle)
            || data.len() > TRANSFER_BYTES.into()
        {
            return self.stall();
        }
        if data.is_empty() {
            self.state = State::ManifestSync;
            return Ok(());
        }
        let command = match (block, data) {
            (0, [SET_ADDRESS, a, b, c, d]) => {
                Command::SetAddress(u32::from_le_bytes([*a, *b, *c, *d]))
            }
            (0, [ERASE, a, b, c, d]) => Command::Erase(u32::from_le_bytes([*a, *b, *c, *d])),
            (0, [ERASE]) => Command::EraseAll,
            (0, [READ_UNPROTECT]) => Command::ReadUnprotect,
            (0 | 1, _) => return self.stall(),
            (block, bytes) => Command::Write {
                block,
                bytes: bytes.to_vec(),
            },
        };
        self.command = Some(command);
        self.state = State::DownloadSync;
        Ok(())
    }

    /// The address of a block.
    fn address(&self, block: u16, length: usize) -> Option<u32> {
        let offset = u32::from(block.checked_sub(2)?).checked_mul(length as u32)?;
        self.pointer.checked_add(offset)
    }

    fn upload(&mut self, block: u16, length: usize) -> Result<Vec<u8>, Failure> {
        if !matches!(self.state, State::Idle | State::UploadIdle) || length > TRANSFER_BYTES.into()
        {
            return self.stall();
        }
        if block == 0 {
            self.state = State::Idle;
            return Ok(vec![GET, SET_ADDRESS, ERASE, READ_UNPROTECT]);
        }
        if self.faults.is_protected {
            self.fail(Status::Vendor);
            return Err(Failure::Stall);
        }
        let address = self.address(block, length);
        let bytes = address.and_then(|address| self.flash.read(address, length));
        let Some(bytes) = bytes.filter(|bytes| bytes.len() >= LEAST_BYTES) else {
            self.fail(Status::Target);
            return Err(Failure::Stall);
        };
        self.state = State::UploadIdle;
        Ok(bytes.to_vec())
    }

    /// Executes the command, and returns status and state.
    fn get_status(&mut self) -> Vec<u8> {
        match self.state {
            State::DownloadSync => {
                self.state = State::DownloadBusy;
                self.polls = self.faults.busy_polls;
                let command = self.command.take();
                self.result = command.map_or(Status::Unknown, |command| self.execute(command));
            }
            State::DownloadBusy if self.polls > 0 => self.polls -= 1,
            State::DownloadBusy if self.result == Status::Ok => self.state = State::DownloadIdle,
            State::DownloadBusy => self.fail(self.result),
            State::ManifestSync => {
                self.state = State::Manifest;
                self.started_at = Some(self.pointer);
                // It answers, and leaves.
                self.is_gone = true;
            }
            State::Idle
            | State::DownloadIdle
            | State::Manifest
            | State::UploadIdle
            | State::Error => {}
        }
        let [a, b, c, _] = self.poll_ms.to_le_bytes();
        vec![self.status as u8, a, b, c, self.state as u8, 0]
    }

    fn execute(&mut self, command: Command) -> Status {
        if command == Command::ReadUnprotect {
            // It erases everything, and starts anew.
            self.flash.erase_all();
            self.faults.is_protected = false;
            self.is_gone = true;
            return Status::Ok;
        }
        if self.faults.is_protected {
            return Status::Vendor;
        }
        let stuck = self.faults.stuck.and_then(|at| at.checked_sub(FLASH));
        let stuck = stuck.map(|at| at as usize);
        let before = stuck.and_then(|at| self.flash.bytes().get(at).copied());
        let status = self.change(command);
        if let (Some(at), Some(before)) = (stuck, before) {
            self.flash.bytes_mut()[at] = before;
        }
        status
    }

    /// Changes pointer or flash.
    fn change(&mut self, command: Command) -> Status {
        match command {
            Command::SetAddress(address) => match self.flash.sector(address) {
                Some(_) => {
                    self.pointer = address;
                    Status::Ok
                }
                None => Status::Target,
            },
            Command::Erase(address) => match self.flash.sector(address) {
                Some(sector) if self.faults.no_erase == Some(sector) => Status::Erase,
                Some(sector) => {
                    self.flash.erase(sector);
                    Status::Ok
                }
                None => Status::Target,
            },
            Command::EraseAll if self.faults.no_erase.is_some() => Status::Erase,
            Command::EraseAll => {
                self.flash.erase_all();
                Status::Ok
            }
            Command::Write { block, bytes } => {
                let address = self.address(block, bytes.len());
                let is_long_enough = bytes.len() >= LEAST_BYTES;
                let written = address
                    .filter(|_| is_long_enough)
                    .and_then(|address| self.flash.program(address, &bytes));
                written.map_or(Status::Target, |()| Status::Ok)
            }
            Command::ReadUnprotect => Status::Unknown,
        }
    }

    /// USB DFU 1.1, 6.1.3: only after an error.
    fn clear_status(&mut self) {
        if self.state == State::Error {
            (self.state, self.status) = (State::Idle, Status::Ok);
        } else {
            self.fail(Status::Unknown);
        }
    }

    fn abort(&mut self) -> Result<(), Failure> {
        match self.state {
            State::Idle
            | State::DownloadSync
            | State::DownloadIdle
            | State::ManifestSync
            | State::UploadIdle => {
                self.state = State::Idle;
                self.command = None;
                Ok(())
            }
            State::DownloadBusy | State::Manifest | State::Error => self.stall(),
        }
    }

    /// A descriptor, whose kind is in the high byte.
    fn descriptor(&self, value: u16) -> Result<Vec<u8>, Failure> {
        let [index, kind] = value.to_le_bytes();
        match (kind, index) {
            (1, 0) => Ok(DEVICE_DESCRIPTOR.to_vec()),
            (2, 0) => Ok(configuration_descriptor()),
            (3, 0) => Ok(vec![4, 3, 0x09, 0x04]),
            (3, index) => self.string(index).map(|text| string_descriptor(&text)),
            _ => Err(Failure::Stall),
        }
    }

    fn string(&self, index: u8) -> Result<String, Failure> {
        Ok(match index {
            1 => "STMicroelectronics".into(),
            2 => "STM32  BOOTLOADER".into(),
            // Of the chip's unique number.
            3 => "315A35663432".into(),
            4 => self.chip.layout(),
            5 => self.chip.option_bytes.into(),
            6 => "@OTP Memory /0x1FFF7800/01*512 e,01*016 e".into(),
            7 => "@Device Feature/0xFFFF0000/01*004 e".into(),
            _ => return Err(Failure::Stall),
        })
    }
}

/// 0483:df11, version 22.00.
const DEVICE_DESCRIPTOR: [u8; 18] = [
    18, 1, 0x00, 0x01, 0, 0, 0, 64, 0x83, 0x04, 0x11, 0xdf, 0x00, 0x22, 1, 2, 3, 1,
];
/// The alternate settings: flash, option bytes, OTP, features; with the number of the first one's string.
const ALTERNATES: u8 = 4;
const FIRST_STRING: u8 = 4;
/// It can download and upload, and detaches by itself; DFU 1.1a, which is `DfuSe`.
const FUNCTIONAL_DESCRIPTOR: [u8; 9] = {
    let [low, high] = TRANSFER_BYTES.to_le_bytes();
    [9, 0x21, 0x0b, 0xff, 0x00, low, high, 0x1a, 0x01]
};

fn configuration_descriptor() -> Vec<u8> {
    let mut interfaces = Vec::new();
    for alternate in 0..ALTERNATES {
        let string = FIRST_STRING + alternate;
        interfaces.extend([9, 4, 0, alternate, 0, 0xfe, 1, 2, string]);
    }
    let length = 9 + interfaces.len() + FUNCTIONAL_DESCRIPTOR.len();
    let [low, high] = (length as u16).to_le_bytes();
    // Powered by itself, 100 mA.
    let mut bytes = vec![9, 2, low, high, 1, 1, 0, 0xc0, 50];
    bytes.extend(interfaces);
    bytes.extend(FUNCTIONAL_DESCRIPTOR);
    bytes
}

fn string_descriptor(text: &str) -> Vec<u8> {
    let units = text.encode_utf16().flat_map(u16::to_le_bytes);
    let mut bytes = vec![0, 3];
    bytes.extend(units);
    bytes[0] = bytes.len() as u8;
    bytes
}
