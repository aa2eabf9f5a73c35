//! Requests of browsers, as far as a page needs them: GET alone, of bounded size, number and time.
//!
//! Nothing is allocated because a request claims a size: a request with a body is refused unread.

use std::{
    collections::VecDeque,
    io::{self, Read as _, Write as _},
    net::{Shutdown, TcpListener, TcpStream},
    sync::{
        Arc, Mutex, MutexGuard, PoisonError,
        atomic::{AtomicUsize, Ordering},
    },
    thread,
    time::{Duration, Instant},
};

/// The most bytes of a request: those of browsers have some hundred.
const MOST_BYTES: usize = 16 * 1024;
/// The most fields of a request.
const MOST_FIELDS: usize = 64;
/// How long a request may take, and how long a browser may take nothing.
const PATIENCE: Duration = Duration::from_secs(10);
/// The most connections at a time, of which a page has one and some for its files.
const MOST_CONNECTIONS: usize = 64;

/// A request for a path.
pub(crate) struct Request {
    /// The path without what stands after `?`.
    pub(crate) path: String,
    /// What stands after `?`.
    pub(crate) query: String,
    fields: Vec<(String, String)>,
    /// What has come after the request.
    surplus: Vec<u8>,
    stream: TcpStream,
}

impl Request {
    /// The value of a field; nothing where there is none.
    pub(crate) fn field(&self, name: &str) -> &str {
        let mut fields = self.fields.iter();
        let field = fields.find(|(field, _)| field.eq_ignore_ascii_case(name));
        field.map_or("", |(_, value)| value)
    }

    /// Answers with a status, fields and contents.
    pub(crate) fn answer(
        mut self,
        status: &str,
        fields: &[(&str, &str)],
        content: &[u8],
    ) -> io::Result<()> {
        self.head(status, fields, Some(content.len()))?;
        self.stream.write_all(content)
    }

    /// Answers with contents that come by and by.
    pub(crate) fn begin(mut self, fields: &[(&str, &str)]) -> io::Result<TcpStream> {
        self.head("200 OK", fields, None)?;
        Ok(self.stream)
    }

    /// Answers that another protocol is spoken from now on. Returns what has come of it already, and the connection.
    pub(crate) fn upgrade(mut self, fields: &[(&str, &str)]) -> io::Result<(Vec<u8>, TcpStream)> {
        let mut all = vec![("Connection", "Upgrade")];
        all.extend(fields);
        write_head(&mut self.stream, "101 Switching Protocols", &all)?;
        Ok((self.surplus, self.stream))
    }

    fn head(
        &mut self,
        status: &str,
        fields: &[(&str, &str)],
        bytes: Option<usize>,
    ) -> io::Result<()> {
        let bytes = bytes.map(|bytes| bytes.to_string());
        let mut all = vec![("Connection", "close")];
        all.extend(fields);
        all.extend(bytes.iter().map(|it| ("Content-Length", it.as_str())));
        write_head(&mut self.stream, status, &all)
    }
}

fn write_head(stream: &mut TcpStream, status: &str, fields: &[(&str, &str)]) -> io::Result<()> {
    let fields = fields
        .iter()
        .map(|(name, value)| format!("{name}: {value}\r\n"));
    let fields: String = fields.collect();
    stream.write_all(format!("HTTP/1.1 {status}\r\n{fields}\r\n").as_bytes())
}

/// Serves connections, each in a thread, as long as the program runs.
pub(crate) fn serve(
    listener: TcpListener,
    answer: impl Fn(Request) -> io::Result<()> + Send + Sync + 'static,
) {
    let (answer, connections) = (Arc::new(answer), Arc::new(Connections::default()));
    thread::spawn(move || {
        for (number, stream) in listener.incoming().enumerate() {
            let Ok(stream) = stream else {
                // No file is left for another connection.
                thread::sleep(Duration::from_millis(10));
                continue;
            };
            let answer = answer.clone();
            let Some(connection) = Connection::open(&connections, number, &stream) else {
                continue;
            };
            let serve = move || {
                let request = read(stream);
                connection.has_asked();
                // Who has gone needs no answer.
                let _ = request.and_then(|request| request.map_or(Ok(()), |it| answer(it)));
                drop(connection);
            };
            // Without a thread, the connection is closed.
            let _ = thread::Builder::new().spawn(serve);
        }
    });
}

/// The connections that are open.
#[derive(Default)]
struct Connections {
    count: AtomicUsize,
    /// Those from which no whole request has come, with their numbers, the oldest first.
    silent: Mutex<VecDeque<(usize, TcpStream)>>,
}

impl Connections {
    fn silent(&self) -> MutexGuard<'_, VecDeque<(usize, TcpStream)>> {
        self.silent.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// One of the connections that are open.
struct Connection {
    all: Arc<Connections>,
    number: usize,
}

impl Connection {
    /// Adds a connection, if there may be another one: the one that has been silent for longest is ended for it.
    fn open(all: &Arc<Connections>, number: usize, stream: &TcpStream) -> Option<Self> {
        let mut silent = all.silent();
        if all.count.load(Ordering::Relaxed) >= MOST_CONNECTIONS {
            let (_, oldest) = silent.pop_front()?;
            let _ = oldest.shutdown(Shutdown::Both);
        }
        // Some that were ended may not have noticed it.
        if all.count.load(Ordering::Relaxed) >= 2 * MOST_CONNECTIONS {
            return None;
        }
        silent.push_back((number, stream.try_clone().ok()?));
        all.count.fetch_add(1, Ordering::Relaxed);
        let all = all.clone();
        Some(Self { all, number })
    }

    /// A request has come, or none will.
    fn has_asked(&self) {
        self.all.silent().retain(|(it, _)| *it != self.number);
    }
}

impl Drop for Connection {
    fn drop(&mut self) {
        self.has_asked();
        self.all.count.fetch_sub(1, Ordering::Relaxed);
    }
}

/// Reads a request; refuses what is none, and what wants more than a page.
fn read(stream: TcpStream) -> io::Result<Option<Request>> {
    stream.set_write_timeout(Some(PATIENCE))?;
    let mut request = Request {
        path: String::new(),
        query: String::new(),
        fields: Vec::new(),
        surplus: Vec::new(),
        stream,
    };
    let Some(refused) = read_head(&mut request)? else {
        return Ok(Some(request));
    };
    request.answer(refused, &[], refused.as_bytes())?;
    Ok(None)
}

/// Fills in a request; returns the status with which it is refused.
fn read_head(request: &mut Request) -> io::Result<Option<&'static str>> {
    let (since, mut head) = (Instant::now(), Vec::new());
    loop {
        let mut fields = [httparse::EMPTY_HEADER; MOST_FIELDS];
        let mut parsed = httparse::Request::new(&mut fields);
        match parsed.parse(&head) {
            Ok(httparse::Status::Complete(length)) => {
                request.surplus = head[length..].to_vec();
                return Ok(take(&parsed, request));
            }
            Ok(httparse::Status::Partial) if head.len() < MOST_BYTES => {}
            Ok(_) => return Ok(Some("431 Request Header Fields Too Large")),
            Err(_) => return Ok(Some("400 Bad Request")),
        }
        let left = PATIENCE.saturating_sub(since.elapsed());
        if left.is_zero() {
            return Ok(Some("408 Request Timeout"));
        }
        request.stream.set_read_timeout(Some(left))?;
        let mut bytes = [0; 1024];
        match request.stream.read(&mut bytes)? {
            0 => return Err(io::ErrorKind::UnexpectedEof.into()),
            length => head.extend(&bytes[..length]),
        }
    }
}

fn take(parsed: &httparse::Request<'_, '_>, request: &mut Request) -> Option<&'static str> {
    if parsed.method != Some("GET") {
        return Some("405 Method Not Allowed");
    }
    let path = parsed.path.unwrap_or_default();
    let (path, query) = path.split_once('?').unwrap_or((path, ""));
    (request.path, request.query) = (path.into(), query.into());
    let fields = parsed.headers.iter();
    request.fields = fields
        .filter_map(|field| Some((field.name.into(), str::from_utf8(field.value).ok()?.into())))
        .collect();
    let is_empty = matches!(request.field("Content-Length"), "" | "0");
    let is_whole = is_empty && request.field("Transfer-Encoding").is_empty();
    (!is_whole).then_some("413 Content Too Large")
}
