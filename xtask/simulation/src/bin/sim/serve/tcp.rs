//! A TCP port with one sender at a time.

use std::{
    io::Write as _,
    net::{SocketAddr, TcpListener, TcpStream},
    os::fd::{AsFd as _, BorrowedFd},
};

use anyhow::{Context, Result};
use common::ui;
use simulation::holder;

use super::Port;

/// What requests of browsers begin with: any page can have them sent to this computer, with G-code in them.
const REQUESTS: [&[u8]; 10] = [
    // A handshake of TLS.
    b"\x16\x03",
    b"GET ",
    b"POST ",
    b"HEAD ",
    b"PUT ",
    b"OPTIONS ",
    b"PATCH ",
    b"DELETE ",
    b"CONNECT ",
    b"TRACE ",
];

/// A listening socket and the sender that is connected.
pub(crate) struct Tcp {
    listener: TcpListener,
    sender: Option<Sender>,
}

/// A sender that is connected.
struct Sender {
    stream: TcpStream,
    address: SocketAddr,
    /// Its process, where that is known, for everybody else.
    name: String,
    /// It has sent something.
    has_begun: bool,
}

impl Sender {
    fn new(stream: TcpStream, address: SocketAddr) -> Self {
        let process = holder::of_address(address);
        let process = process.map_or(String::new(), |process| format!(", {process}"));
        Self {
            stream,
            address,
            name: format!("{address}{process}"),
            has_begun: false,
        }
    }
}

impl Tcp {
    /// Listens at an address.
    pub(crate) fn at(address: &str) -> Result<Self> {
        let tcp = Self {
            listener: listen(address, "127.0.0.1:2323")?,
            sender: None,
        };
        let address = tcp.address()?;
        ui::status("Serving", &format!("tcp://{address} (Ctrl-C ends)"));
        Ok(tcp)
    }

    /// Where it listens.
    pub(crate) fn address(&self) -> Result<SocketAddr> {
        self.listener
            .local_addr()
            .context("the port has no address")
    }
}

impl Port for Tcp {
    fn line(&self) -> Option<BorrowedFd<'_>> {
        self.sender.as_ref().map(|sender| sender.stream.as_fd())
    }

    fn door(&self) -> Option<BorrowedFd<'_>> {
        Some(self.listener.as_fd())
    }

    /// Takes who wants to connect if nobody is, and tells everybody else who that is.
    fn open_door(&mut self) -> Option<Vec<u8>> {
        while let Ok((mut stream, from)) = self.listener.accept() {
            if let Some(Sender { name: holder, .. }) = &self.sender {
                ui::status("Refused", &format!("{from}: {holder} is connected"));
                // Who has gone already need not know.
                let _ = write!(stream, "[MSG:In use by {holder}]\r\n");
            } else if usbip::prepare(&stream).is_ok() {
                ui::status("Connected", &from.to_string());
                self.sender = Some(Sender::new(stream, from));
            }
        }
        None
    }

    fn refuses(&mut self, first: &[u8]) -> bool {
        let Some(sender) = &mut self.sender else {
            return false;
        };
        let has_begun = std::mem::replace(&mut sender.has_begun, true);
        let is_refused = !has_begun && REQUESTS.iter().any(|request| first.starts_with(request));
        if is_refused {
            let from = sender.address;
            ui::status("Refused", &format!("{from}: a browser is no sender"));
        }
        is_refused
    }

    fn part(&mut self) {
        if let Some(sender) = self.sender.take() {
            ui::status("Left", &sender.address.to_string());
        }
    }
}

/// Listens at an address, of which the user is shown another one where that is impossible.
pub(super) fn listen(address: &str, example: &str) -> Result<TcpListener> {
    let listener = TcpListener::bind(address).with_context(|| {
        let parsed = address.parse().ok();
        let hint = match parsed.and_then(holder::of_address) {
            Some(holder) => format!("{holder} has it"),
            None => format!("an address is {example}"),
        };
        format!("cannot listen at {address:?} ({hint})")
    })?;
    listener.set_nonblocking(true)?;
    Ok(listener)
}
