//! The virtual machine as a USB device: a server of USB/IP, whose transfers become transactions on the model of the
//! chip's core.
//!
//! ```text
//!  usbip attach ⇄ Client ⇄ Transfers ⇄ otg::Core ⇄ usb, usb_control ⇄ Simulator
//! ```
//!
//! This process is the computer with the socket, and has read the descriptors as Linux does. One client at a time has
//! the device; a client that leaves has pulled the plug.

mod protocol;
#[cfg(test)]
mod tests;
mod transfers;

use std::{
    io::{ErrorKind, Read as _, Write as _},
    net::{SocketAddr, TcpListener, TcpStream},
    os::unix::net::UnixStream,
    path::Path,
    time::Instant,
};

use anyhow::{Context, Result, anyhow, ensure};
use common::ui;
use leadscrew::{sim::Simulator, usb::DATA_ENDPOINT};
use otg::{Core, Host, SetupEnd, Silicon, System, Version};
use rustix::{
    event::{PollFd, PollFlags, Timespec, poll},
    io::Errno,
};
use simulation::{figures::Figures, play::Recorder};
use usb_machine::{Device, PERIOD_US};

use self::{
    protocol::{BUS_ID, Command, Operation, Refusal},
    transfers::{Transfers, UNLINKED},
};
use super::{MAX_UNREAD_BYTES, PERIOD, record::Record, tcp};

/// The name of the device.
const DEVICE_NAME: &str = "Leadscrew simulator";
/// The port at which hosts look without being given another.
const USUAL_PORT: u16 = 3240;
/// Clients without the device at the same time, at most.
const MOST_CLIENTS: usize = 16;
/// Bytes that a client may have sent ahead, at most: the longest transfer, and another command.
const MOST_RECEIVED: usize = protocol::LONGEST_TRANSFER + 4096;
/// Transfers that a client may have submitted without an answer, at most: Linux' driver has some twenty.
const MOST_TRANSFERS: usize = 1024;

/// Somebody who is connected.
struct Client {
    stream: TcpStream,
    from: SocketAddr,
    received: Vec<u8>,
    unsent: Vec<u8>,
}

impl Client {
    /// Takes what has come.
    ///
    /// # Errors
    /// The client is gone.
    fn read(&mut self) -> Result<()> {
        let mut chunk = [0; 4096];
        while self.reads() {
            match self.stream.read(&mut chunk) {
                Ok(0) => anyhow::bail!("it has left"),
                Ok(length) => self.received.extend_from_slice(&chunk[..length]),
                Err(error) if is_passing(&error) => break,
                Err(error) => return Err(error.into()),
            }
        }
        Ok(())
    }

    /// Sends as much as there is room for.
    ///
    /// # Errors
    /// The client is gone.
    fn write(&mut self) -> Result<()> {
        while !self.unsent.is_empty() {
            match self.stream.write(&self.unsent) {
                Ok(length) => drop(self.unsent.drain(..length)),
                Err(error) if is_passing(&error) => break,
                Err(error) => return Err(error.into()),
            }
        }
        Ok(())
    }

    /// Whether it is listened to: not where it does not take its answers, or has sent more than a transfer.
    fn reads(&self) -> bool {
        self.unsent.len() < MAX_UNREAD_BYTES && self.received.len() < MOST_RECEIVED
    }

    /// What is waited for.
    fn awaited(&self) -> PollFd<'_> {
        let wanted = [
            (self.reads(), PollFlags::IN),
            (!self.unsent.is_empty(), PollFlags::OUT),
        ];
        let wanted = wanted.into_iter().filter(|(is_wanted, _)| *is_wanted);
        PollFd::new(&self.stream, wanted.map(|(_, flag)| flag).collect())
    }
}

/// Whether an error of a socket passes by itself.
fn is_passing(error: &std::io::Error) -> bool {
    matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::Interrupted)
}

/// The machine at a bus that hosts reach by USB/IP.
pub(crate) struct UsbIp<'a, R> {
    device: Device,
    core: Core,
    /// The computer with the socket.
    host: Host,
    transfers: Transfers,
    record: Record<'a, R>,
    listener: TcpListener,
    address: SocketAddr,
    /// Who has the device.
    user: Option<Client>,
    /// Who has not.
    clients: Vec<Client>,
    start: Instant,
}

impl<'a, R: Recorder> UsbIp<'a, R> {
    /// Serves a machine that has been switched on just now at an address.
    ///
    /// # Errors
    /// The address cannot be had, or the device does not answer.
    pub(crate) fn at(
        address: &str,
        mut simulator: Box<Simulator>,
        flash: Option<&'a Path>,
        recorder: &'a mut R,
    ) -> Result<Self> {
        let listener = tcp::listen(address, "127.0.0.1:3240")?;
        let address = listener.local_addr()?;
        let record = Record::new(simulator.flash(), flash, recorder);
        let silicon = Silicon {
            version: Version::V1,
            setup_end: SetupEnd::Entry,
            keeps_enabled: true,
        };
        let mut served = Self {
            // Simulators at other ports have other serial numbers.
            device: Device::new(simulator, DEVICE_NAME, [0, 0, address.port().into()]),
            core: Core::new(silicon),
            host: Host::default(),
            transfers: Transfers::default(),
            record,
            listener,
            address,
            user: None,
            clients: Vec::new(),
            start: Instant::now(),
        };
        served.identify()?;
        served.core.suspend(true);
        ui::status(
            "Serving",
            &format!("usbip://{address} as {BUS_ID} (Ctrl-C ends)"),
        );
        ui::status("Attach by", &command(address));
        Ok(served)
    }

    /// Where it listens.
    pub(crate) const fn address(&self) -> SocketAddr {
        self.address
    }

    /// Resets the bus, and reads the descriptors of the device, which has an address then.
    fn identify(&mut self) -> Result<()> {
        let (device, record) = (&mut self.device, &mut self.record);
        let period = &mut |core: &mut Core| device.period(core, &mut |edge| record.edge(edge));
        let identified = self.host.identify(&mut self.core, System::Linux, period);
        identified.map_err(|error| anyhow!("the device does not answer its host: {error:?}"))?;
        self.transfers = Transfers::new(self.host.address());
        Ok(())
    }

    /// Moves transfers and time until something is to be read from `stop`, and returns what was done.
    ///
    /// # Errors
    /// A file cannot be written.
    pub(crate) fn serve(mut self, stop: &UnixStream) -> Result<Figures> {
        loop {
            self.accept();
            self.read_guests()?;
            self.read_user();
            self.run()?;
            self.write();
            if self.wait(stop)? {
                break;
            }
        }
        for violation in self.core.violations() {
            ui::warning(&format!(
                "the driver does what the chip forbids: {violation}"
            ));
        }
        Ok(self.record.finish(&self.device.simulator))
    }

    /// Lets everybody in who wants to ask, as long as there is room.
    fn accept(&mut self) {
        while self.clients.len() < MOST_CLIENTS
            && let Ok((stream, from)) = self.listener.accept()
        {
            if tcp::prepare(&stream).is_ok() {
                self.clients.push(Client {
                    stream,
                    from,
                    received: Vec::new(),
                    unsent: Vec::new(),
                });
            }
        }
    }

    /// Answers those who have no device.
    fn read_guests(&mut self) -> Result<()> {
        for mut guest in std::mem::take(&mut self.clients) {
            if guest.read().is_ok() {
                match self.answer(guest) {
                    Ok(Some(guest)) => self.clients.push(guest),
                    Ok(None) => {}
                    Err(error) => return Err(error),
                }
            }
        }
        Ok(())
    }

    /// Answers a client without a device, and gives it back if it stays without.
    fn answer(&mut self, mut guest: Client) -> Result<Option<Client>> {
        loop {
            match protocol::take_operation(&mut guest.received) {
                Ok(Some(Operation::List)) => guest.unsent.extend(protocol::listed(&self.host)),
                Ok(Some(Operation::Import(bus))) => {
                    let refusal = match &self.user {
                        _ if bus != BUS_ID => Refusal::NoDevice,
                        Some(_) => Refusal::Busy,
                        None => {
                            self.attach(guest)?;
                            return Ok(None);
                        }
                    };
                    let why = match (&self.user, refusal) {
                        (Some(user), Refusal::Busy) => format!("{} has the device", user.from),
                        _ => format!("there is no device {bus:?}, but {BUS_ID}"),
                    };
                    ui::status("Refused", &format!("{}: {why}", guest.from));
                    guest.unsent.extend(protocol::refused(refusal));
                }
                Ok(None) => return Ok(Some(guest)),
                Err(error) => {
                    ui::status("Refused", &format!("{}: {error}", guest.from));
                    return Ok(None);
                }
            }
        }
    }

    /// A client plugs the device in.
    fn attach(&mut self, mut client: Client) -> Result<()> {
        self.core.suspend(false);
        self.identify()?;
        client.unsent.extend(protocol::imported(&self.host));
        ui::status("Attached", &format!("{BUS_ID} to {}", client.from));
        self.user = Some(client);
        Ok(())
    }

    /// The client has gone, or has to: the device is off the bus.
    fn detach(&mut self, why: &anyhow::Error) {
        if let Some(client) = self.user.take() {
            ui::status("Detached", &format!("{BUS_ID} from {}: {why}", client.from));
            self.transfers = Transfers::default();
            self.core.suspend(true);
        }
    }

    /// Takes the commands of the client that has the device.
    fn read_user(&mut self) {
        if let Some(client) = &mut self.user
            && let Err(error) = take_commands(client, &mut self.transfers)
        {
            self.detach(&error);
        }
    }

    /// Runs the machine until now.
    fn run(&mut self) -> Result<()> {
        let now_us = self.start.elapsed().as_micros();
        while u128::from(self.device.now_us() + PERIOD_US) <= now_us {
            let record = &mut self.record;
            self.device
                .period(&mut self.core, &mut |edge| record.edge(edge));
            self.step();
        }
        self.record.keep(self.device.simulator.flash())
    }

    /// Does the transactions of a period.
    fn step(&mut self) {
        let Some(client) = &mut self.user else {
            return;
        };
        for ended in self.transfers.step(&mut self.core) {
            let urb = &ended.urb;
            if urb.is_in && urb.endpoint == usize::from(DATA_ENDPOINT) {
                urb.data.iter().for_each(|byte| self.record.hear(*byte));
            }
            let answer = protocol::submitted(urb, ended.status, ended.moved);
            client.unsent.extend(answer);
        }
    }

    /// Sends what the clients are to hear.
    fn write(&mut self) {
        self.clients.retain_mut(|guest| guest.write().is_ok());
        if let Some(Err(error)) = self.user.as_mut().map(Client::write) {
            self.detach(&error);
        }
    }

    /// Waits for the next period, or for somebody who says something. Returns whether the machine is to stop.
    fn wait(&self, stop: &UnixStream) -> Result<bool> {
        let mut awaited = vec![PollFd::new(stop, PollFlags::IN)];
        if self.clients.len() < MOST_CLIENTS {
            awaited.push(PollFd::new(&self.listener, PollFlags::IN));
        }
        awaited.extend(self.clients.iter().chain(&self.user).map(Client::awaited));
        let period = Timespec {
            tv_sec: 0,
            tv_nsec: PERIOD.subsec_nanos().into(),
        };
        match poll(&mut awaited, Some(&period)) {
            Ok(_) => Ok(!awaited[0].revents().is_empty()),
            Err(Errno::INTR) => Ok(false),
            Err(error) => Err(error).context("cannot wait for hosts"),
        }
    }
}

/// Takes the commands that a client has sent.
///
/// # Errors
/// The client has left, or sends what is no command.
fn take_commands(client: &mut Client, transfers: &mut Transfers) -> Result<()> {
    client.read()?;
    while let Some(command) = protocol::take_command(&mut client.received)? {
        match command {
            Command::Submit(urb) => transfers.submit(urb),
            Command::Unlink { number, of } => {
                // What has ended has been answered before.
                let status = if transfers.unlink(of) { UNLINKED } else { 0 };
                client.unsent.extend(protocol::unlinked(number, status));
            }
        }
        ensure!(
            transfers.count() <= MOST_TRANSFERS,
            "it submits more than {MOST_TRANSFERS} transfers"
        );
    }
    Ok(())
}

/// How a Linux host attaches the device.
fn command(address: SocketAddr) -> String {
    let host = if address.ip().is_unspecified() {
        "HOST".into()
    } else {
        address.ip().to_string()
    };
    let port = match address.port() {
        USUAL_PORT => String::new(),
        port => format!("--tcp-port {port} "),
    };
    format!("sudo usbip {port}attach -r {host} -b {BUS_ID}")
}
