//! The bytes of USB/IP 1.1.1: `Documentation/usb/usbip_protocol.rst` of Linux. Numbers have their high byte first.

use anyhow::{Result, ensure};
use otg::Host;

use crate::transfers::Urb;

/// The bus and the number on it under which the device is exported.
pub const BUS_ID: &str = "1-1";
const BUS: u32 = 1;
const DEVICE: u32 = 2;
/// Where a Linux host would have found it.
const PATH: &str = "/sys/devices/leadscrew/usb1/1-1";
/// The speed: full.
const FULL_SPEED: u32 = 2;

const VERSION: u32 = 0x0111;
const LIST_REQUEST: u32 = 0x8005;
const LIST_REPLY: u32 = 0x0005;
const IMPORT_REQUEST: u32 = 0x8003;
const IMPORT_REPLY: u32 = 0x0003;
const SUBMIT: u32 = 1;
const UNLINK: u32 = 2;
const SUBMITTED: u32 = 3;
const UNLINKED: u32 = 4;

/// Bytes of the head of an operation, of the name of a bus and of a path, and of a command without its data.
const OPERATION_BYTES: usize = 8;
const BUS_ID_BYTES: usize = 32;
const PATH_BYTES: usize = 256;
const COMMAND_BYTES: usize = 48;
/// Bytes of a transfer at most: more than any driver asks for.
pub(crate) const LONGEST_TRANSFER: usize = 1 << 20;
/// What stands for the number of packets where a transfer is not isochronous, beside 0.
const NOT_ISOCHRONOUS: u32 = u32::MAX;

/// Why a device cannot be imported.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Refusal {
    Busy = 2,
    NoDevice = 4,
}

/// What a client wants that has no device.
#[derive(Debug, PartialEq, Eq)]
pub(crate) enum Operation {
    List,
    /// The device of a bus.
    Import(String),
}

/// What a client wants of its device.
#[derive(Debug, PartialEq, Eq)]
pub(crate) enum Command {
    Submit(Urb),
    /// The transfer `of` is given up.
    Unlink {
        number: u32,
        of: u32,
    },
}

/// Returns the number of four bytes.
fn word(bytes: &[u8], at: usize) -> u32 {
    bytes[at..at + 4]
        .iter()
        .fold(0, |word, byte| word << 8 | u32::from(*byte))
}

/// Takes an operation, once it is whole.
///
/// # Errors
/// It is none.
pub(crate) fn take_operation(received: &mut Vec<u8>) -> Result<Option<Operation>> {
    if received.len() < OPERATION_BYTES {
        return Ok(None);
    }
    let head = word(received, 0);
    let version = head >> 16;
    ensure!(
        version == VERSION,
        "it speaks version {version:04x} of USB/IP, or another protocol"
    );
    match head & 0xffff {
        LIST_REQUEST => {
            received.drain(..OPERATION_BYTES);
            Ok(Some(Operation::List))
        }
        IMPORT_REQUEST => {
            let bytes = OPERATION_BYTES + BUS_ID_BYTES;
            if received.len() < bytes {
                return Ok(None);
            }
            let name = received.drain(..bytes).skip(OPERATION_BYTES);
            let name: Vec<u8> = name.take_while(|byte| *byte != 0).collect();
            Ok(Some(Operation::Import(
                String::from_utf8_lossy(&name).into_owned(),
            )))
        }
        code => anyhow::bail!("it asks for the operation {code:04x}, which is unknown"),
    }
}

/// Takes a command, once it is whole with its data.
///
/// # Errors
/// It is none.
pub(crate) fn take_command(received: &mut Vec<u8>) -> Result<Option<Command>> {
    if received.len() < COMMAND_BYTES {
        return Ok(None);
    }
    let number = word(received, 4);
    match word(received, 0) {
        SUBMIT => take_transfer(received),
        UNLINK => {
            let of = word(received, 20);
            received.drain(..COMMAND_BYTES);
            Ok(Some(Command::Unlink { number, of }))
        }
        code => anyhow::bail!("it sends the command {code:08x}, which is unknown"),
    }
}

fn take_transfer(received: &mut Vec<u8>) -> Result<Option<Command>> {
    let length = word(received, 24) as usize;
    let packets = word(received, 32);
    ensure!(
        matches!(packets, 0 | NOT_ISOCHRONOUS),
        "it submits an isochronous transfer, for which the device has no endpoint"
    );
    ensure!(
        length <= LONGEST_TRANSFER,
        "it submits a transfer of {length} bytes"
    );
    let is_in = word(received, 12) != 0;
    let bytes = COMMAND_BYTES + if is_in { 0 } else { length };
    if received.len() < bytes {
        return Ok(None);
    }
    let mut setup = [0; 8];
    setup.copy_from_slice(&received[40..COMMAND_BYTES]);
    let urb = Urb {
        number: word(received, 4),
        is_in,
        endpoint: word(received, 16) as usize,
        flags: word(received, 20),
        setup,
        length,
        data: received[COMMAND_BYTES..bytes].to_vec(),
    };
    received.drain(..bytes);
    Ok(Some(Command::Submit(urb)))
}

/// Returns the head of a reply to an operation.
fn reply(code: u32, status: u32) -> Vec<u8> {
    [VERSION << 16 | code, status]
        .map(u32::to_be_bytes)
        .concat()
}

/// Returns a text in a field of some bytes.
fn field(text: &str, bytes: usize) -> impl Iterator<Item = u8> {
    text.bytes().chain(std::iter::repeat(0)).take(bytes)
}

/// Returns what a host has read of its device, as USB/IP has it.
fn device(host: &Host) -> Vec<u8> {
    let (device, configuration) = (&host.device, &host.configuration);
    let mut bytes: Vec<u8> = field(PATH, PATH_BYTES)
        .chain(field(BUS_ID, BUS_ID_BYTES))
        .collect();
    for number in [BUS, DEVICE, FULL_SPEED] {
        bytes.extend(number.to_be_bytes());
    }
    // Vendor, product and release.
    bytes.extend([9, 8, 11, 10, 13, 12].map(|at| device[at]));
    // Class, subclass and protocol; the value of the only configuration, and how many there are; interfaces.
    bytes.extend_from_slice(&device[4..7]);
    bytes.extend([configuration[5], device[17], configuration[4]]);
    bytes
}

/// Returns class, subclass and protocol of each interface.
fn interfaces(configuration: &[u8]) -> Vec<u8> {
    const INTERFACE: u8 = 4;
    let (mut bytes, mut rest) = (Vec::new(), configuration);
    while let [length, kind, ..] = *rest
        && length > 1
    {
        if kind == INTERFACE && rest.len() > 7 {
            bytes.extend([rest[5], rest[6], rest[7], 0]);
        }
        rest = rest.get(usize::from(length)..).unwrap_or_default();
    }
    bytes
}

/// Returns the list of devices, which has one.
pub(crate) fn listed(host: &Host) -> Vec<u8> {
    let mut bytes = reply(LIST_REPLY, 0);
    bytes.extend(1_u32.to_be_bytes());
    bytes.extend(device(host));
    bytes.extend(interfaces(&host.configuration));
    bytes
}

/// Returns what a client hears whose device this is from now on.
pub(crate) fn imported(host: &Host) -> Vec<u8> {
    let mut bytes = reply(IMPORT_REPLY, 0);
    bytes.extend(device(host));
    bytes
}

/// Returns what a client hears that does not get the device.
pub(crate) fn refused(refusal: Refusal) -> Vec<u8> {
    reply(IMPORT_REPLY, refusal as u32)
}

/// Returns a reply of as many bytes as a command has.
fn answer(code: u32, number: u32, status: i32, length: usize) -> Vec<u8> {
    let mut bytes = Vec::with_capacity(COMMAND_BYTES);
    for word in [code, number, 0, 0, 0, status.cast_unsigned(), length as u32] {
        bytes.extend(word.to_be_bytes());
    }
    bytes.resize(COMMAND_BYTES, 0);
    bytes
}

/// Returns the answer to a transfer that has ended.
pub(crate) fn submitted(urb: &Urb, status: i32, moved: usize) -> Vec<u8> {
    let mut bytes = answer(SUBMITTED, urb.number, status, moved);
    if urb.is_in {
        bytes.extend_from_slice(&urb.data);
    }
    bytes
}

/// Returns the answer to a client that gives a transfer up.
pub(crate) fn unlinked(number: u32, status: i32) -> Vec<u8> {
    answer(UNLINKED, number, status, 0)
}
