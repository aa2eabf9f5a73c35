//! A device served to a page over HTTP: for a test of a page whose `navigator.usb` hands its transfers on.
//!
//! ```text
//!  POST /in?type=161&request=3&value=0&index=0&length=6      200 with the answer's bytes
//!  POST /out?type=33&request=1&value=2&index=0               the data as body; 200
//!  GET /flash                                                200 with the flash's bytes
//!  GET /started                                              200 with the address, hexadecimal, or with nothing
//! ```
//!
//! A transfer that fails is answered by 409 with `stall` or `gone`. One request at a time, one for each connection.

use std::{
    io::{self, BufRead as _, BufReader, Read as _, Write as _},
    net::{TcpListener, TcpStream},
};

use crate::{Device, Failure};

/// The longest line or body that is read, bytes.
const LONGEST: u64 = 0x1_0000;

/// Serves a device until the listener fails.
///
/// # Errors
/// The listener fails.
pub fn serve(device: &mut Device, listener: &TcpListener) -> io::Result<()> {
    loop {
        let (mut stream, _) = listener.accept()?;
        // A page that has gone away wants no answer.
        let _ = answer(device, &mut stream);
    }
}

/// Reads a request, and answers it.
fn answer(device: &mut Device, stream: &mut TcpStream) -> io::Result<()> {
    let mut reader = BufReader::new(stream.try_clone()?).take(LONGEST);
    let mut first = String::new();
    reader.read_line(&mut first)?;
    let mut length = 0;
    loop {
        let mut line = String::new();
        if reader.read_line(&mut line)? == 0 || line.trim().is_empty() {
            break;
        }
        if let Some((name, value)) = line.split_once(':')
            && name.eq_ignore_ascii_case("content-length")
        {
            length = value.trim().parse().unwrap_or(0).min(LONGEST as usize);
        }
    }
    let mut body = vec![0; length];
    reader.read_exact(&mut body)?;
    let mut words = first.split(' ');
    let (method, target) = (words.next(), words.next().unwrap_or_default());
    let (status, bytes) = if method == Some("OPTIONS") {
        ("204 No Content", Vec::new())
    } else {
        response(device, target, &body)
    };
    write!(
        stream,
        "HTTP/1.1 {status}\r\nContent-Length: {}\r\nContent-Type: application/octet-stream\r\n\
         Access-Control-Allow-Origin: *\r\nAccess-Control-Allow-Headers: *\r\nConnection: close\r\n\r\n",
        bytes.len()
    )?;
    stream.write_all(&bytes)
}

/// The status and the body of an answer.
fn response(device: &mut Device, target: &str, body: &[u8]) -> (&'static str, Vec<u8>) {
    let (path, query) = target.split_once('?').unwrap_or((target, ""));
    let number = |name: &str| -> Option<u16> {
        let mut fields = query.split('&').filter_map(|field| field.split_once('='));
        fields.find(|(key, _)| *key == name)?.1.parse().ok()
    };
    let setup = || {
        let byte = |name: &str| u8::try_from(number(name)?).ok();
        Some((
            byte("type")?,
            byte("request")?,
            number("value")?,
            number("index")?,
        ))
    };
    let result = match (path, setup()) {
        ("/flash", _) => Ok(device.flash().to_vec()),
        ("/started", _) => {
            let address = device.started_at();
            let text = address.map_or(String::new(), |address| format!("{address:#010x}"));
            Ok(text.into_bytes())
        }
        ("/in", Some((kind, request, value, index))) => {
            let length = number("length").unwrap_or(0);
            device.control_in(kind, request, value, index, length)
        }
        ("/out", Some((kind, request, value, index))) => device
            .control_out(kind, request, value, index, body)
            .map(|()| Vec::new()),
        _ => return ("404 Not Found", Vec::new()),
    };
    match result {
        Ok(bytes) => ("200 OK", bytes),
        Err(failure @ (Failure::Stall | Failure::Gone)) => {
            ("409 Conflict", failure.to_string().into_bytes())
        }
    }
}
