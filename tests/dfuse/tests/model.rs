//! What the documents of ST and of USB say, of the model.

use std::{
    io::{Read as _, Write as _},
    net::{TcpListener, TcpStream},
    thread,
};

use dfuse_model::{Chip, Device, FLASH, Failure, serve};

const OUT: u8 = 0x21;
const IN: u8 = 0xa1;
/// The states and statuses that the tests name.
const IDLE: u8 = 2;
const DOWNLOAD_BUSY: u8 = 4;
const DOWNLOAD_IDLE: u8 = 5;
const MANIFEST: u8 = 7;
const ERROR: u8 = 10;
const ERR_TARGET: u8 = 1;
const ERR_ERASE: u8 = 4;
const ERR_VENDOR: u8 = 0x0b;
const ERR_STALLED: u8 = 0x0f;

fn device(chip: &str) -> Device {
    Device::new(Chip::named(chip).unwrap())
}

fn download(device: &mut Device, block: u16, data: &[u8]) -> Result<(), Failure> {
    device.control_out(OUT, 1, block, 0, data)
}

/// Status and state.
fn status(device: &mut Device) -> (u8, u8) {
    let answer = device.control_in(IN, 3, 0, 0, 6).unwrap();
    (answer[0], answer[4])
}

/// A download with its GETSTATUS until the device is busy no longer.
fn done(device: &mut Device, block: u16, data: &[u8]) -> (u8, u8) {
    download(device, block, data).unwrap();
    assert_eq!(status(device), (0, DOWNLOAD_BUSY));
    status(device)
}

fn command(code: u8, address: u32) -> Vec<u8> {
    [vec![code], address.to_le_bytes().to_vec()].concat()
}

fn string(device: &mut Device, index: u16) -> String {
    let bytes = device.control_in(0x80, 6, 0x0300 | index, 0x0409, 255);
    let units = bytes.unwrap()[2..].to_vec();
    let units = units.chunks(2).map(|it| u16::from_le_bytes([it[0], it[1]]));
    char::decode_utf16(units).map(Result::unwrap).collect()
}

#[test]
fn descriptors_are_those_that_dfu_util_lists() {
    for (chip, sectors) in [
        ("f405", "04*016Kg,01*064Kg,07*128Kg"),
        ("f407", "04*016Kg,01*064Kg,07*128Kg"),
        ("f411", "04*016Kg,01*064Kg,03*128Kg"),
        ("f429", "04*016Kg,01*064Kg,07*128Kg"),
        ("f446", "04*016Kg,01*064Kg,03*128Kg"),
    ] {
        let mut device = device(chip);
        let bytes = device.control_in(0x80, 6, 0x0100, 0, 18).unwrap();
        assert_eq!(bytes[8..14], [0x83, 0x04, 0x11, 0xdf, 0x00, 0x22]);
        let short = device.control_in(0x80, 6, 0x0200, 0, 9).unwrap();
        let length = u16::from_le_bytes([short[2], short[3]]);
        let bytes = device.control_in(0x80, 6, 0x0200, 0, 255).unwrap();
        assert_eq!((short.len(), bytes.len()), (9, length.into()));
        assert_eq!(
            bytes[bytes.len() - 9..],
            [9, 0x21, 0x0b, 255, 0, 0, 8, 0x1a, 1]
        );
        let name = string(&mut device, bytes[9 + 8].into());
        assert_eq!(name, format!("@Internal Flash  /0x08000000/{sectors}"));
        assert_eq!(
            string(&mut device, bytes[4 * 9 + 8].into()),
            "@Device Feature/0xFFFF0000/01*004 e"
        );
        assert!(device.control_in(0x80, 6, 0x0308, 0x0409, 255).is_err());
    }
}

#[test]
fn a_program_is_erased_written_read_and_started() {
    let mut device = device("f446");
    device.flash_mut().fill(0);
    let start = FLASH + 0x1_0000;
    assert_eq!(
        done(&mut device, 0, &command(0x41, start + 5)),
        (0, DOWNLOAD_IDLE)
    );
    assert_eq!(
        done(&mut device, 0, &command(0x21, start)),
        (0, DOWNLOAD_IDLE)
    );
    let block = |value: u8| vec![value; 2048];
    assert_eq!(done(&mut device, 2, &block(0x12)), (0, DOWNLOAD_IDLE));
    assert_eq!(done(&mut device, 3, &block(0x34)), (0, DOWNLOAD_IDLE));
    // The length of a block counts in its address.
    assert_eq!(done(&mut device, 3, &[0x10; 4]), (0, DOWNLOAD_IDLE));
    device.control_out(OUT, 6, 0, 0, &[]).unwrap();
    assert_eq!(status(&mut device), (0, IDLE));
    let read = device.control_in(IN, 2, 3, 0, 2048).unwrap();
    assert_eq!(read, block(0x34));
    let flash = &device.flash()[0x1_0000..];
    assert_eq!(
        (flash[0], flash[4], flash[2048], flash[4096]),
        (0x12, 0x10, 0x34, 0xff)
    );
    assert_eq!((device.flash()[0xffff], device.flash()[0x2_0000]), (0, 0));
    device.control_out(OUT, 6, 0, 0, &[]).unwrap();
    download(&mut device, 0, &[]).unwrap();
    assert_eq!(device.started_at(), None);
    assert_eq!(status(&mut device), (0, MANIFEST));
    assert_eq!(device.started_at(), Some(start));
    assert_eq!(device.control_in(IN, 3, 0, 0, 6), Err(Failure::Gone));
}

#[test]
fn a_byte_that_is_not_erased_loses_bits_only() {
    let mut device = device("f411");
    for bytes in [[0xf0, 0x0f], [0x3c, 0xff]] {
        assert_eq!(done(&mut device, 2, &bytes), (0, DOWNLOAD_IDLE));
    }
    assert_eq!(device.flash()[..2], [0x30, 0x0f]);
    assert_eq!(done(&mut device, 0, &[0x41]), (0, DOWNLOAD_IDLE));
    assert!(device.flash().iter().all(|byte| *byte == 0xff));
}

#[test]
fn what_is_outside_of_the_flash_is_an_error() {
    let end = FLASH + 512 * 1024;
    for (block, data) in [
        (0, command(0x21, end)),
        (0, command(0x41, end)),
        (0, command(0x41, FLASH - 1)),
        (2 + 512 / 2, vec![0; 2048]),
        (2, vec![0]),
    ] {
        let mut device = device("f446");
        assert_eq!(
            done(&mut device, block, &data),
            (ERR_TARGET, ERROR),
            "{data:?}"
        );
        assert_eq!(download(&mut device, 2, &[1, 2]), Err(Failure::Stall));
        device.control_out(OUT, 4, 0, 0, &[]).unwrap();
        assert_eq!(status(&mut device), (0, IDLE));
        assert!(device.flash().iter().all(|byte| *byte == 0xff));
    }
}

#[test]
fn a_request_in_a_wrong_state_is_stalled() {
    type Request = fn(&mut Device) -> Result<(), Failure>;
    let upload: Request = |device| device.control_in(IN, 2, 2, 0, 64).map(drop);
    let write: Request = |device| download(device, 2, &[1, 2]);
    for (name, request) in [("upload", upload), ("download", write)] {
        // Behind a command without its GETSTATUS.
        let mut device = device("f405");
        download(&mut device, 2, &[1, 2]).unwrap();
        assert_eq!(request(&mut device), Err(Failure::Stall), "{name}");
        assert_eq!(status(&mut device), (ERR_STALLED, ERROR), "{name}");
        assert_eq!(device.flash()[0], 0xff);
    }
    let mut idle = device("f405");
    assert_eq!(done(&mut idle, 2, &[1, 2]), (0, DOWNLOAD_IDLE));
    assert_eq!(upload(&mut idle), Err(Failure::Stall));
    for data in [vec![0x21, 0], vec![0x99], vec![0; 2049]] {
        assert_eq!(download(&mut device("f405"), 0, &data), Err(Failure::Stall));
    }
    assert!(device("f405").control_out(OUT, 0, 1000, 0, &[]).is_err());
}

#[test]
fn faults_are_those_that_were_asked_for() {
    let mut unplugged = device("f405");
    unplugged.faults.unplugged_after = Some(1);
    assert_eq!(status(&mut unplugged), (0, IDLE));
    let gone = unplugged.control_in(IN, 3, 0, 0, 6);
    assert_eq!((gone, unplugged.transfers()), (Err(Failure::Gone), 1));

    let mut locked = device("f405");
    locked.faults.no_erase = Some(4);
    let inside = command(0x41, FLASH + 0x1_8000);
    assert_eq!(done(&mut locked, 0, &inside), (ERR_ERASE, ERROR));

    let mut stuck = device("f405");
    stuck.faults.stuck = Some(FLASH + 1);
    assert_eq!(done(&mut stuck, 2, &[1, 2, 3, 4]), (0, DOWNLOAD_IDLE));
    assert_eq!(stuck.flash()[..4], [1, 0xff, 3, 4]);

    let mut protected = device("f405");
    protected.flash_mut()[0] = 7;
    protected.faults.is_protected = true;
    assert_eq!(protected.control_in(IN, 2, 2, 0, 64), Err(Failure::Stall));
    assert_eq!(status(&mut protected), (ERR_VENDOR, ERROR));
    protected.control_out(OUT, 4, 0, 0, &[]).unwrap();
    download(&mut protected, 0, &[0x92]).unwrap();
    assert_eq!(status(&mut protected), (0, DOWNLOAD_BUSY));
    assert_eq!(protected.control_in(IN, 3, 0, 0, 6), Err(Failure::Gone));
    assert_eq!(protected.flash()[0], 0xff);

    let mut slow = device("f405");
    (slow.faults.busy_polls, slow.poll_ms) = (2, 0x0001_0203);
    download(&mut slow, 2, &[1, 2]).unwrap();
    for state in [DOWNLOAD_BUSY, DOWNLOAD_BUSY, DOWNLOAD_BUSY, DOWNLOAD_IDLE] {
        let answer = slow.control_in(IN, 3, 0, 0, 6).unwrap();
        assert_eq!(answer, [0, 3, 2, 1, state, 0]);
    }
}

/// Sends a request, and returns the first line and the body of the answer.
fn ask(address: std::net::SocketAddr, line: &str, body: &[u8]) -> (String, Vec<u8>) {
    let mut stream = TcpStream::connect(address).unwrap();
    let head = format!(
        "{line} HTTP/1.1\r\nHost: a\r\nContent-Length: {}\r\n\r\n",
        body.len()
    );
    stream.write_all(&[head.as_bytes(), body].concat()).unwrap();
    let mut answer = Vec::new();
    stream.read_to_end(&mut answer).unwrap();
    let end = { answer.windows(4) }
        .position(|it| it == b"\r\n\r\n")
        .unwrap();
    let head = String::from_utf8_lossy(&answer[..end]).into_owned();
    assert!(head.contains("Access-Control-Allow-Origin: *"));
    let first = head.lines().next().unwrap().to_owned();
    (first, answer[end + 4..].to_vec())
}

#[test]
fn a_page_reaches_the_device_over_http() {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = listener.local_addr().unwrap();
    thread::spawn(move || serve(&mut device("f446"), &listener));
    let ok = || "HTTP/1.1 200 OK".to_owned();
    let status = "POST /in?type=161&request=3&value=0&index=0&length=6";
    assert_eq!(ask(address, status, b""), (ok(), vec![0, 0, 0, 0, IDLE, 0]));
    let write = "POST /out?type=33&request=1&value=2&index=0";
    assert_eq!(ask(address, write, &[7, 8, 9]), (ok(), Vec::new()));
    let stalled = ("HTTP/1.1 409 Conflict".into(), b"stall".to_vec());
    assert_eq!(ask(address, write, &[7, 8, 9]), stalled);
    assert_eq!(ask(address, "GET /flash", b"").1.len(), 512 * 1024);
    assert_eq!(ask(address, "GET /started", b""), (ok(), Vec::new()));
    assert_eq!(
        ask(address, "OPTIONS /in", b"").0,
        "HTTP/1.1 204 No Content"
    );
    assert_eq!(ask(address, "GET /no", b"").0, "HTTP/1.1 404 Not Found");
}
