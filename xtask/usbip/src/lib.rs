//! A server of USB/IP: the transfers of its clients become transactions on the model of a chip's USB core.
//!
//! ```text
//!  usbip attach ⇄ Client ⇄ Transfers ⇄ otg::Core ⇄ the device
//! ```
//!
//! This process is the computer with the socket, and has read the descriptors as Linux does. One client at a time has
//! the device; a client that leaves has pulled the plug.

mod protocol;
mod transfers;

use std::{
    io::{ErrorKind, Read as _, Write as _},
    net::{SocketAddr, TcpListener, TcpStream},
    time::Duration,
};

use anyhow::{Result, ensure};
use otg::{Core, Host, HostError, System};
use rustix::{
    event::{PollFd, PollFlags},
    net::sockopt::{set_socket_keepalive, set_tcp_keepcnt, set_tcp_keepidle, set_tcp_keepintvl},
};

use self::{
    protocol::{Command, Operation, Refusal},
    transfers::{Transfers, UNLINKED},
};

pub use self::protocol::BUS_ID;

/// The port at which hosts look without being given another.
const USUAL_PORT: u16 = 3240;
/// Clients without the device at the same time, at most.
const MOST_CLIENTS: usize = 16;
/// Bytes that a client may have sent ahead, at most: the longest transfer, and another command.
const MOST_RECEIVED: usize = protocol::LONGEST_TRANSFER + 4096;
/// Bytes that wait for a client, at most.
const MOST_UNSENT: usize = 65_536;
/// Transfers that a client may have submitted without an answer, at most: Linux' driver has some twenty.
pub const MOST_TRANSFERS: usize = 1024;
/// A client that has gone without saying so is noticed after so long, and so many questions.
const SILENCE: Duration = Duration::from_secs(10);
const QUESTION: Duration = Duration::from_secs(5);
const QUESTIONS: u32 = 3;

/// Somebody who is connected.
#[derive(Debug)]
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

    /// Takes the commands that the client has sent.
    ///
    /// # Errors
    /// The client has left, or sends what is no command.
    fn take_commands(&mut self, transfers: &mut Transfers) -> Result<()> {
        self.read()?;
        while let Some(command) = protocol::take_command(&mut self.received)? {
            match command {
                Command::Submit(urb) => transfers.submit(urb),
                Command::Unlink { number, of } => {
                    // What has ended has been answered before.
                    let status = if transfers.unlink(of) { UNLINKED } else { 0 };
                    self.unsent.extend(protocol::unlinked(number, status));
                }
            }
            ensure!(
                transfers.count() <= MOST_TRANSFERS,
                "it submits more than {MOST_TRANSFERS} transfers"
            );
        }
        Ok(())
    }

    /// Whether it is listened to: not where it does not take its answers, or has sent more than a transfer.
    fn reads(&self) -> bool {
        self.unsent.len() < MOST_UNSENT && self.received.len() < MOST_RECEIVED
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

/// Has a connection send bytes at once, never wait, and notice a computer that is gone.
///
/// # Errors
/// The connection has ended.
pub fn prepare(stream: &TcpStream) -> std::io::Result<()> {
    stream.set_nonblocking(true)?;
    stream.set_nodelay(true)?;
    set_socket_keepalive(stream, true)?;
    set_tcp_keepidle(stream, SILENCE)?;
    set_tcp_keepintvl(stream, QUESTION)?;
    set_tcp_keepcnt(stream, QUESTIONS)?;
    Ok(())
}

/// Lets the device run for a period.
pub type Period<'a> = dyn FnMut(&mut Core) + 'a;

/// The computer with the socket, and its clients. The core that is asked for is the device's.
#[derive(Debug)]
pub struct Server {
    listener: TcpListener,
    host: Host,
    transfers: Transfers,
    /// Who has the device.
    user: Option<Client>,
    /// Who has not.
    clients: Vec<Client>,
    /// What has become of clients, in a word and a sentence, for whom the caller says it to.
    pub events: Vec<(&'static str, String)>,
}

impl Server {
    /// Serves those who connect.
    ///
    /// # Errors
    /// There is nobody to listen to.
    pub fn new(listener: TcpListener) -> std::io::Result<Self> {
        listener.set_nonblocking(true)?;
        Ok(Self {
            listener,
            host: Host::default(),
            transfers: Transfers::default(),
            user: None,
            clients: Vec::new(),
            events: Vec::new(),
        })
    }

    /// Plugs the device in, and reads its descriptors, which clients ask for. The bus is suspended then: nobody has the
    /// device.
    ///
    /// # Errors
    /// The device does not answer.
    pub fn plug(&mut self, core: &mut Core, period: &mut Period<'_>) -> Result<(), HostError> {
        self.identify(core, period)?;
        core.suspend(true);
        Ok(())
    }

    /// Resets the bus, and reads the descriptors of the device, which has an address then.
    fn identify(&mut self, core: &mut Core, period: &mut Period<'_>) -> Result<(), HostError> {
        self.host.identify(core, System::Linux, &mut { period })?;
        self.transfers = Transfers::new(self.host.address());
        Ok(())
    }

    /// Takes what clients have sent.
    ///
    /// # Errors
    /// The device does not answer.
    pub fn read(&mut self, core: &mut Core, period: &mut Period<'_>) -> Result<(), HostError> {
        self.accept();
        for mut guest in std::mem::take(&mut self.clients) {
            if guest.read().is_ok()
                && let Some(guest) = self.answer(guest, core, period)?
            {
                self.clients.push(guest);
            }
        }
        if let Some(client) = &mut self.user
            && let Err(error) = client.take_commands(&mut self.transfers)
        {
            self.detach(core, &error.to_string());
        }
        Ok(())
    }

    /// Does the transactions of a period; `hear` gets what data the device sends.
    pub fn run(&mut self, core: &mut Core, hear: &mut impl FnMut(u8)) {
        let Some(client) = &mut self.user else {
            return;
        };
        for ended in self.transfers.step(core) {
            let urb = &ended.urb;
            if urb.is_in && urb.endpoint == otg::DATA_ENDPOINT {
                urb.data.iter().for_each(|byte| hear(*byte));
            }
            let answer = protocol::submitted(urb, ended.status, ended.moved);
            client.unsent.extend(answer);
        }
    }

    /// Sends what the clients are to hear.
    pub fn write(&mut self, core: &mut Core) {
        self.clients.retain_mut(|guest| guest.write().is_ok());
        if let Some(Err(error)) = self.user.as_mut().map(Client::write) {
            self.detach(core, &error.to_string());
        }
    }

    /// Everything that is waited for.
    pub fn awaited(&self) -> impl Iterator<Item = PollFd<'_>> {
        let door = PollFd::new(&self.listener, PollFlags::IN);
        let door = (self.clients.len() < MOST_CLIENTS).then_some(door);
        let clients = self.clients.iter().chain(&self.user);
        door.into_iter().chain(clients.map(Client::awaited))
    }

    /// Lets everybody in who wants to ask, as long as there is room.
    fn accept(&mut self) {
        while self.clients.len() < MOST_CLIENTS
            && let Ok((stream, from)) = self.listener.accept()
        {
            if prepare(&stream).is_ok() {
                self.clients.push(Client {
                    stream,
                    from,
                    received: Vec::new(),
                    unsent: Vec::new(),
                });
            }
        }
    }

    /// Answers a client without a device, and gives it back if it stays without.
    fn answer(
        &mut self,
        mut guest: Client,
        core: &mut Core,
        period: &mut Period<'_>,
    ) -> Result<Option<Client>, HostError> {
        loop {
            match protocol::take_operation(&mut guest.received) {
                Ok(Some(Operation::List)) => guest.unsent.extend(protocol::listed(&self.host)),
                Ok(Some(Operation::Import(bus))) => {
                    let refusal = match &self.user {
                        _ if bus != BUS_ID => Refusal::NoDevice,
                        Some(_) => Refusal::Busy,
                        None => {
                            self.attach(guest, core, period)?;
                            return Ok(None);
                        }
                    };
                    let why = match (&self.user, refusal) {
                        (Some(user), Refusal::Busy) => format!("{} has the device", user.from),
                        _ => format!("there is no device {bus:?}, but {BUS_ID}"),
                    };
                    self.say("Refused", format!("{}: {why}", guest.from));
                    guest.unsent.extend(protocol::refused(refusal));
                }
                Ok(None) => return Ok(Some(guest)),
                Err(error) => {
                    self.say("Refused", format!("{}: {error}", guest.from));
                    return Ok(None);
                }
            }
        }
    }

    /// A client plugs the device in.
    fn attach(
        &mut self,
        mut client: Client,
        core: &mut Core,
        period: &mut Period<'_>,
    ) -> Result<(), HostError> {
        core.suspend(false);
        self.identify(core, period)?;
        client.unsent.extend(protocol::imported(&self.host));
        self.say("Attached", format!("{BUS_ID} to {}", client.from));
        self.user = Some(client);
        Ok(())
    }

    /// The client has gone, or has to: the device is off the bus.
    pub fn detach(&mut self, core: &mut Core, why: &str) {
        if let Some(client) = self.user.take() {
            self.say("Detached", format!("{BUS_ID} from {}: {why}", client.from));
            self.transfers = Transfers::default();
            core.suspend(true);
        }
    }

    fn say(&mut self, word: &'static str, sentence: String) {
        self.events.push((word, sentence));
    }
}

/// How a Linux host attaches the device that is served at an address.
#[must_use]
pub fn command(address: SocketAddr) -> String {
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_command_to_attach_names_host_and_port() {
        for (address, expected) in [
            ("127.0.0.1:3240", "sudo usbip attach -r 127.0.0.1 -b 1-1"),
            (
                "0.0.0.0:81",
                "sudo usbip --tcp-port 81 attach -r HOST -b 1-1",
            ),
        ] {
            assert_eq!(command(address.parse().unwrap()), expected);
        }
    }
}
