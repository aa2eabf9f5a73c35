//! Requests of browsers, as far as a page needs them: GET alone, of bounded size, number and time.
//!
//! Nothing is allocated because a request claims a size: a request with a body is refused unread.

use std::{
    io::{self, Read as _, Write as _},
    net::{TcpListener, TcpStream},
    sync::{
        Arc,
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
    /// The path without what is behind `?`.
    pub(crate) path: String,
    /// The name by which the browser knows the server.
    pub(crate) host: String,
    /// Another site's page asks for it.
    pub(crate) is_from_elsewhere: bool,
    stream: TcpStream,
}

impl Request {
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

    fn head(
        &mut self,
        status: &str,
        fields: &[(&str, &str)],
        bytes: Option<usize>,
    ) -> io::Result<()> {
        let mut head = Vec::new();
        write!(head, "HTTP/1.1 {status}\r\nConnection: close\r\n")?;
        for (name, value) in fields {
            write!(head, "{name}: {value}\r\n")?;
        }
        if let Some(bytes) = bytes {
            write!(head, "Content-Length: {bytes}\r\n")?;
        }
        head.extend(b"\r\n");
        self.stream.write_all(&head)
    }
}

/// Serves connections, each in a thread, as long as the program runs.
pub(crate) fn serve(
    listener: TcpListener,
    answer: impl Fn(Request) -> io::Result<()> + Send + Sync + 'static,
) {
    let (answer, open) = (Arc::new(answer), Arc::new(AtomicUsize::new(0)));
    thread::spawn(move || {
        for stream in listener.incoming() {
            let Ok(stream) = stream else {
                // No file is left for another connection.
                thread::sleep(Duration::from_millis(10));
                continue;
            };
            let (answer, connection) = (answer.clone(), Connection::new(&open));
            let Some(connection) = connection else {
                continue;
            };
            let serve = move || {
                // Who has gone needs no answer.
                let _ = read(stream).and_then(|request| request.map_or(Ok(()), |it| answer(it)));
                drop(connection);
            };
            // Without a thread, the connection is closed.
            let _ = thread::Builder::new().spawn(serve);
        }
    });
}

/// One of the connections that are open.
struct Connection(Arc<AtomicUsize>);

impl Connection {
    fn new(open: &Arc<AtomicUsize>) -> Option<Self> {
        let connection = Self(open.clone());
        (open.fetch_add(1, Ordering::Relaxed) < MOST_CONNECTIONS).then_some(connection)
    }
}

impl Drop for Connection {
    fn drop(&mut self) {
        self.0.fetch_sub(1, Ordering::Relaxed);
    }
}

/// Reads a request; refuses what is none, and what wants more than a page.
fn read(stream: TcpStream) -> io::Result<Option<Request>> {
    stream.set_write_timeout(Some(PATIENCE))?;
    let mut request = Request {
        path: String::new(),
        host: String::new(),
        is_from_elsewhere: false,
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
            Ok(httparse::Status::Complete(_)) => return Ok(take(&parsed, request)),
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
    let field = |name: &str| {
        let mut fields = parsed.headers.iter();
        let field = fields.find(|field| field.name.eq_ignore_ascii_case(name))?;
        str::from_utf8(field.value).ok()
    };
    if parsed.method != Some("GET") {
        return Some("405 Method Not Allowed");
    }
    if field("Transfer-Encoding").is_some() || field("Content-Length").is_some_and(|it| it != "0") {
        return Some("413 Content Too Large");
    }
    let path = parsed.path.unwrap_or_default();
    request.path = path.split('?').next().unwrap_or_default().into();
    request.host = field("Host").unwrap_or_default().into();
    let site = field("Sec-Fetch-Site").unwrap_or_default();
    request.is_from_elsewhere = matches!(site, "cross-site" | "same-site");
    None
}
