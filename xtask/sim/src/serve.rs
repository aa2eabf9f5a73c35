//! The virtual machine in real time, behind a pseudo-terminal or a TCP port.

use std::{
    fs,
    io::{ErrorKind, Read, Write},
    net::{TcpListener, TcpStream},
    path::{Path, PathBuf},
    sync::{
        Arc,
        atomic::{AtomicBool, Ordering},
    },
    thread,
    time::{Duration, Instant},
};

use anyhow::{Context, Result, ensure};
use common::ui;
use host::{
    machine::{Ends, Machine},
    pty::Pty,
};
use leadscrew::{settings::Settings, sim::Flash};
use rustix::io::Errno;

/// How often bytes are moved.
const PERIOD: Duration = Duration::from_millis(1);
/// Bytes that wait for the machine at most; then the sender waits, as with flow control.
const BACKLOG: usize = 4096;

/// What is stored in the machine that is served.
pub(crate) enum Memory {
    /// These settings, and what is stored is forgotten in the end.
    Settings(Box<Settings>),
    /// The contents of this file, and they are kept there.
    File(PathBuf),
}

/// Bytes that wait for the sender at most, as many as operating systems keep.
const UNREAD: usize = 65_536;

/// The other end of the line.
trait Port {
    /// Reads what has arrived; 0 for nothing.
    fn read(&mut self, bytes: &mut [u8]) -> Result<usize>;
    /// Writes what can be written, and returns how much that was.
    fn write(&mut self, bytes: &[u8]) -> Result<usize>;
}

/// Serves a machine at a new pseudo-terminal, to which `path` becomes a link.
pub(crate) fn pty(path: &Path, memory: &Memory, switches: Option<&Ends>) -> Result<()> {
    let (mut port, _link) = Pty::at(path)?;
    ui::status(
        "Serving",
        &format!("{} (115200 baud; Ctrl-C ends)", path.display()),
    );
    serve(&mut port, memory, switches)
}

/// Serves a machine to whoever connects to `address`, one at a time.
pub(crate) fn tcp(address: &str, memory: &Memory, switches: Option<&Ends>) -> Result<()> {
    let listener = TcpListener::bind(address)
        .with_context(|| format!("cannot listen at {address:?} (an address is 127.0.0.1:2323)"))?;
    listener.set_nonblocking(true)?;
    let address = listener.local_addr()?;
    ui::status("Serving", &format!("tcp://{address} (Ctrl-C ends)"));
    let mut port = Tcp {
        listener,
        stream: None,
    };
    serve(&mut port, memory, switches)
}

/// Moves bytes and time until Ctrl-C.
fn serve(port: &mut dyn Port, memory: &Memory, switches: Option<&Ends>) -> Result<()> {
    let stop = Arc::new(AtomicBool::new(false));
    for signal in [signal_hook::consts::SIGINT, signal_hook::consts::SIGTERM] {
        signal_hook::flag::register(signal, stop.clone()).context("cannot catch Ctrl-C")?;
    }
    let mut machine = memory.machine()?;
    if let Some(ends) = switches {
        machine.mount(ends);
    }
    let mut stored = machine.flash().operations();
    let start = Instant::now();
    let mut unsent = Vec::new();
    let mut chunk = [0; 1024];
    while !stop.load(Ordering::Relaxed) {
        while machine.on_the_line() < BACKLOG {
            let length = port.read(&mut chunk)?;
            if length == 0 {
                break;
            }
            machine.send(&chunk[..length]);
        }
        machine.run_until_s(start.elapsed().as_secs_f64());
        if let Memory::File(path) = memory
            && stored != machine.flash().operations()
        {
            stored = machine.flash().operations();
            save(path, machine.flash())?;
        }
        unsent.extend(machine.take_bytes().into_iter().map(|(_, byte)| byte));
        if !unsent.is_empty() {
            let length = port.write(&unsent)?;
            unsent.drain(..length);
            // Nobody reads: what a serial line does with such bytes.
            unsent.drain(..unsent.len().saturating_sub(UNREAD));
        }
        thread::sleep(PERIOD);
    }
    ui::status("Stopped", "");
    Ok(())
}

impl Memory {
    /// A machine that is switched on with what is stored; a file that is not there is a new machine.
    fn machine(&self) -> Result<Machine> {
        let path = match self {
            Self::Settings(settings) => return Ok(Machine::new(settings)),
            Self::File(path) => path,
        };
        let mut flash = Flash::new();
        let contents = flash.contents_mut();
        match fs::read(path) {
            Ok(bytes) => {
                let (size, wanted) = (bytes.len(), contents.len());
                let name = path.display();
                ensure!(
                    size == wanted,
                    "{name} has {size} bytes; the flash has {wanted}"
                );
                contents.copy_from_slice(&bytes);
            }
            Err(error) if error.kind() == ErrorKind::NotFound => {}
            Err(error) => {
                return Err(error).with_context(|| format!("cannot read {}", path.display()));
            }
        }
        let mut machine = Machine::power_up(flash);
        save(path, machine.flash())?;
        Ok(machine)
    }
}

/// Writes a flash to a file, all of it or nothing.
fn save(path: &Path, flash: &Flash) -> Result<()> {
    let mut beside = path.as_os_str().to_owned();
    beside.push(".new");
    fs::write(&beside, flash.contents())
        .and_then(|()| fs::rename(&beside, path))
        .with_context(|| format!("cannot write {}", path.display()))
}

impl Port for Pty {
    fn read(&mut self, bytes: &mut [u8]) -> Result<usize> {
        match rustix::io::read(self.controller(), bytes) {
            Ok(length) => Ok(length),
            Err(Errno::AGAIN | Errno::INTR | Errno::IO) => Ok(0),
            Err(error) => Err(error).context("cannot read from the pseudo-terminal"),
        }
    }

    fn write(&mut self, bytes: &[u8]) -> Result<usize> {
        match rustix::io::write(self.controller(), bytes) {
            Ok(length) => Ok(length),
            Err(Errno::AGAIN | Errno::INTR) => Ok(0),
            Err(error) => Err(error).context("cannot write to the pseudo-terminal"),
        }
    }
}

/// A listening socket and the sender that is connected.
struct Tcp {
    listener: TcpListener,
    stream: Option<TcpStream>,
}

impl Port for Tcp {
    fn read(&mut self, bytes: &mut [u8]) -> Result<usize> {
        if let Ok((stream, from)) = self.listener.accept() {
            ensure_nonblocking(&stream)?;
            ui::status("Connected", &from.to_string());
            // The newest sender wins: the one before may have gone without saying so.
            self.stream = Some(stream);
        }
        let Some(stream) = &mut self.stream else {
            return Ok(0);
        };
        match stream.read(bytes) {
            Ok(0) => {}
            Ok(length) => return Ok(length),
            Err(error) if is_temporary(error.kind()) => return Ok(0),
            Err(_) => {}
        }
        self.stream = None;
        ui::status("Left", "the sender has disconnected");
        Ok(0)
    }

    fn write(&mut self, bytes: &[u8]) -> Result<usize> {
        let Some(stream) = &mut self.stream else {
            return Ok(bytes.len());
        };
        match stream.write(bytes) {
            Ok(length) => Ok(length),
            Err(error) if is_temporary(error.kind()) => Ok(0),
            Err(_) => {
                self.stream = None;
                Ok(bytes.len())
            }
        }
    }
}

fn ensure_nonblocking(stream: &TcpStream) -> Result<()> {
    let set = stream
        .set_nonblocking(true)
        .and_then(|()| stream.set_nodelay(true));
    ensure!(set.is_ok(), "cannot use the connection");
    Ok(())
}

fn is_temporary(kind: ErrorKind) -> bool {
    matches!(kind, ErrorKind::WouldBlock | ErrorKind::Interrupted)
}
