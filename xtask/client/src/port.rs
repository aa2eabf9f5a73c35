//! Where machines are: serial ports and TCP addresses, and why one cannot be had.

use std::{
    io::ErrorKind,
    net::{TcpStream, ToSocketAddrs},
    path::Path,
    time::Duration,
};

use anyhow::{Context, Error, Result, anyhow};
use rustix::fs::FlockOperation;
use serial2::SerialPort;

/// Opens a serial port, which no other program may have open.
pub(crate) fn serial(path: &Path, baud: u32) -> Result<SerialPort> {
    let name = path.display().to_string();
    let port = SerialPort::open(path, baud).map_err(|error| cannot_open(&name, error))?;
    // Programs that keep a port for themselves lock it so.
    if let Err(error) = rustix::fs::flock(&port, FlockOperation::NonBlockingLockExclusive) {
        return Err(cannot_open(&name, error.into()));
    }
    Ok(port)
}

/// Connects to a TCP address.
pub(crate) fn tcp(address: &str, timeout: Duration) -> Result<TcpStream> {
    let addresses = address.to_socket_addrs();
    let mut addresses =
        addresses.with_context(|| format!("{address:?} is no address (one is 127.0.0.1:2323)"))?;
    let first = addresses.next().context("the address leads nowhere")?;
    let stream =
        TcpStream::connect_timeout(&first, timeout).map_err(|error| match error.kind() {
            ErrorKind::ConnectionRefused => anyhow!("no machine listens at {address}"),
            _ => Error::new(error).context(format!("cannot connect to {address}")),
        })?;
    stream
        .set_nodelay(true)
        .with_context(|| format!("cannot use {address}"))?;
    Ok(stream)
}

/// Why a serial port cannot be opened, and what helps.
fn cannot_open(name: &str, error: std::io::Error) -> Error {
    match error.kind() {
        ErrorKind::NotFound => {
            let ports = SerialPort::available_ports().unwrap_or_default();
            let ports: Vec<_> = ports
                .iter()
                .map(|port| port.display().to_string())
                .collect();
            match &ports[..] {
                [] => anyhow!("there is no {name}, and no other serial port"),
                ports => anyhow!(
                    "there is no {name}; the serial ports are {}",
                    ports.join(", ")
                ),
            }
        }
        ErrorKind::PermissionDenied => anyhow!(
            "{name} is not yours to open: on Linux, `sudo usermod -a -G dialout $USER` and log in again"
        ),
        ErrorKind::ResourceBusy | ErrorKind::WouldBlock => {
            anyhow!("{name} is open in another program: disconnect the sender")
        }
        _ => Error::new(error).context(format!("cannot open {name} as a serial port")),
    }
}
