//! The WebSocket of a page: commands in, events out.
//!
//! Memory is bounded: a page sends little at a time, and one that does not read is dropped. The library reserves what
//! the header of a frame claims; so no frame is longer than a command, and a program comes in parts.

use std::{
    io::{self, ErrorKind, Read, Write},
    mem,
    net::TcpStream,
    sync::{
        Arc,
        atomic::{AtomicBool, Ordering},
        mpsc::{Receiver, SyncSender, TryRecvError, sync_channel},
    },
    time::{Duration, Instant},
};

use grbl_client::client::{Command, Event};
use serde::Deserialize;
use tungstenite::{
    Bytes, Error, Message, WebSocket,
    error::CapacityError,
    handshake::derive_accept_key,
    protocol::{Role, WebSocketConfig},
};

use crate::http::Request;

/// The longest program and the longest message, bytes.
const MOST_OF_PROGRAM: usize = 64 << 20;
const MOST_OF_MESSAGE: usize = 64 << 10;
/// The most messages that wait for a page.
const MOST_WAITING: usize = 128;
/// How long events wait for the end of a look at what the page says.
const LOOK: Duration = Duration::from_millis(20);
/// How often a page is asked whether it is there, and after which silence it counts as gone.
const PING: Duration = Duration::from_secs(1);
const SILENCE_LIMIT: Duration = Duration::from_secs(3);

/// What a page says, or what is message of it, with its number.
#[derive(Debug)]
pub(super) enum FromPage {
    Opened(Page),
    Command(usize, Command),
    TakesControl(usize),
    Closed(usize),
}

/// A page that is open, as the machine's side has it. Dropped, it is closed.
#[derive(Debug)]
pub(super) struct Page {
    pub(super) number: usize,
    outbox: SyncSender<Arc<str>>,
    is_in_control: Arc<AtomicBool>,
    stream: TcpStream,
}

impl Page {
    /// Sends a message; returns whether there was room for it.
    pub(super) fn send(&self, message: &Arc<str>) -> bool {
        self.outbox.try_send(message.clone()).is_ok()
    }

    /// Lets the page send programs.
    pub(super) fn set_control(&self, is_in_control: bool) {
        self.is_in_control.store(is_in_control, Ordering::Relaxed);
    }
}

impl Drop for Page {
    fn drop(&mut self) {
        let _ = self.stream.shutdown(std::net::Shutdown::Both);
    }
}

/// What a page may say beside the commands of the client.
#[derive(Deserialize)]
#[serde(tag = "do", rename_all = "kebab-case")]
enum ServerCommand {
    TakeControl,
    /// The text of a program that is longer than a message, before that of [`Command::Program`].
    ProgramPart {
        text: String,
    },
}

/// Whether a request asks for a WebSocket from a page of the same server.
pub(super) fn is_asked(request: &Request) -> bool {
    request.field("Upgrade").eq_ignore_ascii_case("websocket")
        && request.field("Sec-WebSocket-Version") == "13"
        && !request.field("Sec-WebSocket-Key").is_empty()
        && !request.field("Origin").is_empty()
}

/// Talks with a page until it goes.
pub(super) fn talk(
    request: Request,
    number: usize,
    to_server: &SyncSender<FromPage>,
) -> io::Result<()> {
    let key = derive_accept_key(request.field("Sec-WebSocket-Key").as_bytes());
    let fields = [("Upgrade", "websocket"), ("Sec-WebSocket-Accept", &key)];
    let (surplus, stream) = request.upgrade(&fields)?;
    stream.set_nodelay(true)?;
    stream.set_read_timeout(Some(LOOK))?;
    stream.set_write_timeout(Some(PING))?;
    let (outbox, inbox) = sync_channel(MOST_WAITING);
    let is_in_control = Arc::new(AtomicBool::new(false));
    let page = Page {
        number,
        outbox,
        is_in_control: is_in_control.clone(),
        stream: stream.try_clone()?,
    };
    let now = Instant::now();
    let line = Line {
        stream,
        received: now,
        until: now,
    };
    let config = WebSocketConfig::default()
        .write_buffer_size(0)
        .max_message_size(Some(MOST_OF_MESSAGE))
        .max_frame_size(Some(MOST_OF_MESSAGE))
        .read_buffer_size(16 << 10);
    let mut conversation = PageConnection {
        number,
        socket: WebSocket::from_partially_read(line, surplus, Role::Server, Some(config)),
        inbox,
        to_server,
        is_in_control,
        program: String::new(),
        pinged: now,
    };
    if to_server.send(FromPage::Opened(page)).is_ok() {
        // However it ends, the page has gone.
        let _ = conversation.run();
        let _ = to_server.send(FromPage::Closed(number));
    }
    Ok(())
}

/// A connection, of which is known when something has come.
struct Line {
    stream: TcpStream,
    received: Instant,
    /// When what comes has to wait for what goes.
    until: Instant,
}

impl Read for Line {
    fn read(&mut self, bytes: &mut [u8]) -> io::Result<usize> {
        let now = Instant::now();
        if now >= self.until {
            return Err(ErrorKind::WouldBlock.into());
        }
        let length = self.stream.read(bytes)?;
        self.received = now;
        Ok(length)
    }
}

impl Write for Line {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.stream.write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.stream.flush()
    }
}

struct PageConnection<'a> {
    number: usize,
    socket: WebSocket<Line>,
    inbox: Receiver<Arc<str>>,
    to_server: &'a SyncSender<FromPage>,
    is_in_control: Arc<AtomicBool>,
    /// What has come of a program.
    program: String,
    pinged: Instant,
}

impl PageConnection<'_> {
    /// Talks until either side ends it.
    fn run(&mut self) -> Result<(), Error> {
        loop {
            self.speak()?;
            let now = Instant::now();
            let line = self.socket.get_mut();
            if now >= line.received + SILENCE_LIMIT {
                return Ok(());
            }
            line.until = now + LOOK;
            match self.socket.read() {
                Ok(Message::Text(text)) => self.listen(&text)?,
                Ok(Message::Binary(_)) => return Ok(()),
                Ok(_) => {}
                Err(Error::Io(error)) if is_early(&error) => {}
                Err(error) => return Err(error),
            }
        }
    }

    /// Sends what waits.
    fn speak(&mut self) -> Result<(), Error> {
        loop {
            match self.inbox.try_recv() {
                Ok(text) => self.socket.send(Message::text(&*text))?,
                Err(TryRecvError::Empty) => break,
                Err(TryRecvError::Disconnected) => return Err(Error::ConnectionClosed),
            }
        }
        let now = Instant::now();
        if now >= self.pinged + PING {
            self.pinged = now;
            self.socket.send(Message::Ping(Bytes::new()))?;
        }
        Ok(())
    }

    /// Takes a message of the page.
    fn listen(&mut self, text: &str) -> Result<(), Error> {
        let message = match (serde_json::from_str(text), serde_json::from_str(text)) {
            (Ok(Command::Program { name, text }), _) => {
                self.add(&text)?;
                let text = mem::take(&mut self.program);
                FromPage::Command(self.number, Command::Program { name, text })
            }
            (Ok(command), _) => FromPage::Command(self.number, command),
            (_, Ok(ServerCommand::TakeControl)) => FromPage::TakesControl(self.number),
            (_, Ok(ServerCommand::ProgramPart { text })) => return self.add(&text),
            (Err(error), _) => {
                let text = format!("the server does not know this command: {error}");
                let note = serde_json::to_string(&[Event::Note { text }]);
                return self.socket.send(Message::text(note.unwrap_or_default()));
            }
        };
        self.to_server
            .send(message)
            .map_err(|_| Error::ConnectionClosed)
    }

    /// Takes a part of a program. A page that watches sends none: without a connection, no half of one is started.
    fn add(&mut self, text: &str) -> Result<(), Error> {
        let size = self.program.len() + text.len();
        let is_longer = size > MOST_OF_MESSAGE;
        if is_longer && (size > MOST_OF_PROGRAM || !self.is_in_control.load(Ordering::Relaxed)) {
            let max_size = MOST_OF_PROGRAM;
            return Err(CapacityError::MessageTooLong { size, max_size }.into());
        }
        self.program += text;
        Ok(())
    }
}

/// Whether there is only nothing yet.
fn is_early(error: &io::Error) -> bool {
    use ErrorKind::{Interrupted, TimedOut, WouldBlock};
    matches!(error.kind(), WouldBlock | TimedOut | Interrupted)
}
