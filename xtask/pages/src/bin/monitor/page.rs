//! The page: a few files and the stream of events, for browsers on this computer.
//!
//! Nothing is fetched from elsewhere, and the browser is told to refuse that. A page of another site that
//! leads here by a name of its own (DNS rebinding) is refused.

use std::{
    io::{self, Write},
    net::{SocketAddr, TcpListener},
    sync::Arc,
    thread,
    time::{Duration, Instant},
};

use anyhow::{Context, Result};
use simulation::Job;

use crate::{
    http::{self, Request},
    picture::{Shared, Shown},
};

/// Least time between two events: a screen shows no more.
const FRAME: Duration = Duration::from_millis(30);
/// Silence after which a comment is sent, so that a page that has gone is noticed.
const SILENCE: Duration = Duration::from_secs(2);
/// How long the last event may take.
const LAST_EVENT_TIMEOUT: Duration = Duration::from_secs(10);

const POLICY: &str = "default-src 'none'; script-src 'self'; style-src 'self'; connect-src 'self'; \
    base-uri 'none'; form-action 'none'";
/// What a browser only takes from a header.
const FRAMES: &str = "; frame-ancestors 'none'";

const HTML: &str = "text/html; charset=utf-8";
const BYTES: &str = "application/octet-stream";

/// The files: path, type, content.
struct StaticFiles(Vec<(&'static str, &'static str, Vec<u8>)>);

impl StaticFiles {
    /// Those of the page, and of the job that is known in advance.
    fn new(job: Option<Job>) -> Result<Self> {
        let page = pages::page::served(
            "Leadscrew monitor",
            POLICY,
            include_str!("page/live.html"),
            include_str!("page/live.css"),
            include_str!("page/live.js"),
        );
        let facts = serde_json::to_vec(&job)?;
        let job = job.unwrap_or_default();
        Ok(Self(vec![
            ("/", HTML, page.html.into()),
            ("/page.css", "text/css; charset=utf-8", page.style.into()),
            (
                "/page.js",
                "text/javascript; charset=utf-8",
                page.script.into(),
            ),
            ("/job.json", "application/json", facts),
            ("/job.path", BYTES, job.columns),
            ("/job.curves", BYTES, job.curves),
            ("/job.program", BYTES, job.text),
        ]))
    }
}

/// Serves the page at an address, with a job that is known in advance, and returns where.
pub(crate) fn serve(address: &str, shared: &Arc<Shared>, job: Option<Job>) -> Result<SocketAddr> {
    let files = StaticFiles::new(job)?;
    let listener = TcpListener::bind(address);
    let listener = listener.with_context(|| format!("cannot serve the page at {address}"))?;
    let at = listener.local_addr().context("the page has no address")?;
    let shared = shared.clone();
    http::serve(listener, move |request| {
        answer(request, at, &files, &shared)
    });
    Ok(at)
}

/// Waits until each page has been told that nothing more is to come, at most a while.
pub(crate) fn wait_for_pages(shared: &Shared) {
    let end = Instant::now() + LAST_EVENT_TIMEOUT;
    let mut picture = shared.lock();
    while picture.pages > 0 && Instant::now() < end {
        picture = shared.wait(picture, FRAME);
    }
}

fn answer(
    request: Request,
    at: SocketAddr,
    files: &StaticFiles,
    shared: &Shared,
) -> io::Result<()> {
    if !is_this_computer(&request.host, at) {
        return request.answer("403 Forbidden", &[], b"wrong host");
    }
    if request.is_from_elsewhere {
        return request.answer("403 Forbidden", &[], b"another site");
    }
    match request.path.as_str() {
        "/events" => events(request, shared),
        // Browsers ask for it by themselves.
        "/favicon.ico" => request.answer("204 No Content", &[], &[]),
        path => match files.0.iter().find(|(name, ..)| *name == path) {
            Some((_, kind, content)) => {
                let policy = [POLICY, FRAMES].concat();
                let fields = [
                    ("Content-Type", *kind),
                    ("Content-Security-Policy", &policy),
                    ("X-Content-Type-Options", "nosniff"),
                    ("Referrer-Policy", "no-referrer"),
                    ("Cache-Control", "no-store"),
                ];
                request.answer("200 OK", &fields, content)
            }
            None => request.answer("404 Not Found", &[], b"not found"),
        },
    }
}

/// Whether a request was meant for this server, by the name in it.
fn is_this_computer(host: &str, at: SocketAddr) -> bool {
    let name = host.rsplit_once(':').map_or(host, |(name, _)| name);
    name == "localhost" || name == at.ip().to_string() || host == at.to_string()
}

/// Sends the changes of the picture as they come, all of it first.
fn events(request: Request, shared: &Shared) -> io::Result<()> {
    let mut page = request.begin(&[
        ("Content-Type", "text/event-stream"),
        ("Cache-Control", "no-store"),
    ])?;
    shared.lock().pages += 1;
    let sent = send_changes(&mut page, shared);
    shared.change(|picture| picture.pages -= 1);
    sent
}

fn send_changes(page: &mut impl Write, shared: &Shared) -> io::Result<()> {
    let mut shown = Shown::default();
    loop {
        let mut picture = shared.lock();
        if !picture.has_change(&shown) {
            picture = shared.wait(picture, SILENCE);
        }
        let is_over = picture.is_over();
        let event = match picture.change(&mut shown) {
            Some(change) => format!("data: {}\n\n", serde_json::to_string(&change)?),
            None => ": nothing new\n\n".into(),
        };
        drop(picture);
        page.write_all(event.as_bytes())?;
        page.flush()?;
        if is_over {
            return Ok(());
        }
        thread::sleep(FRAME);
    }
}

#[cfg(test)]
mod tests {
    use serde_json::{Value, json};

    use super::*;
    use crate::picture::Picture;

    // A point waits for the end of one event at most, and comes with the next.
    const _: () = assert!(3 * FRAME.as_millis() < 100);

    /// A page to which the machine moves while each event is on its way.
    struct Page<'a> {
        shared: &'a Shared,
        /// Where each event says that the machine is.
        places: Vec<Value>,
        most: usize,
    }

    impl Write for Page<'_> {
        fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
            let event = bytes
                .strip_prefix(b"data: ")
                .expect("an event in one piece");
            let event: Value = serde_json::from_slice(event)?;
            self.places.push(event["now"]["at"].clone());
            let x = self.places.len() as f64;
            self.shared.change(|picture| picture.move_to([x, 0.0, 0.0]));
            if self.places.len() == self.most {
                self.shared.change(Picture::end);
            }
            Ok(bytes.len())
        }

        fn flush(&mut self) -> io::Result<()> {
            Ok(())
        }
    }

    #[test]
    fn what_comes_during_an_event_is_in_the_next() {
        let shared = Shared::default();
        shared.change(|picture| picture.move_to([0.0; 3]));
        let mut page = Page {
            shared: &shared,
            places: Vec::new(),
            most: 10,
        };
        send_changes(&mut page, &shared).expect("nothing fails");
        let expected: Vec<_> = (0..=10).map(|x| json!([f64::from(x), 0.0, 0.0])).collect();
        assert_eq!(page.places, expected);
    }
}
