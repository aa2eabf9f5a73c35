//! The page: a few files and the stream of events, for browsers on this computer.
//!
//! Nothing is fetched from elsewhere, and the browser is told to refuse that. A page of another site that
//! leads here by a name of its own (DNS rebinding) is refused.

use std::{
    io::{self, Write},
    net::SocketAddr,
    sync::Arc,
    thread,
    time::{Duration, Instant},
};

use anyhow::{Context, Result, anyhow};
use tiny_http::{Header, Method, Request, Response, Server};

use crate::picture::{Shared, Shown};

/// Least time between two events: a screen shows no more.
const FRAME: Duration = Duration::from_millis(30);
/// Silence after which a comment is sent, so that a page that has gone is noticed.
const SILENCE: Duration = Duration::from_secs(2);
/// How long the last event may take.
const LAST_EVENT: Duration = Duration::from_secs(1);

const POLICY: &str = "default-src 'none'; script-src 'self'; style-src 'self'; connect-src 'self'; \
    base-uri 'none'; form-action 'none'; frame-ancestors 'none'";

/// The files: path, type, text.
const FILES: [(&str, &str, &str); 3] = [
    ("/", "text/html; charset=utf-8", include_str!("page.html")),
    (
        "/page.css",
        "text/css; charset=utf-8",
        include_str!("page.css"),
    ),
    (
        "/page.js",
        "text/javascript; charset=utf-8",
        include_str!("page.js"),
    ),
];

/// Serves the page at an address, and returns where.
pub(crate) fn serve(address: &str, shared: &Arc<Shared>) -> Result<SocketAddr> {
    let server = Server::http(address)
        .map_err(|error| anyhow!("{error}"))
        .with_context(|| format!("cannot serve the page at {address}"))?;
    let at = server
        .server_addr()
        .to_ip()
        .context("the page has no address")?;
    let shared = shared.clone();
    thread::spawn(move || {
        for request in server.incoming_requests() {
            // Who has gone needs no answer.
            let _ = answer(request, at, &shared);
        }
    });
    Ok(at)
}

/// Waits until each page has been told that nothing more is to come, at most a while.
pub(crate) fn wait_for_pages(shared: &Shared) {
    let end = Instant::now() + LAST_EVENT;
    let mut picture = shared.lock();
    while picture.pages > 0 && Instant::now() < end {
        picture = shared.wait(picture, FRAME);
    }
}

fn answer(request: Request, at: SocketAddr, shared: &Arc<Shared>) -> io::Result<()> {
    let host = request
        .headers()
        .iter()
        .find(|header| header.field.equiv("Host"));
    if !host.is_some_and(|host| is_this_computer(host.value.as_str(), at)) {
        return request.respond(Response::from_string("wrong host").with_status_code(403));
    }
    if *request.method() != Method::Get {
        return request.respond(Response::from_string("only GET").with_status_code(405));
    }
    let path = request
        .url()
        .split('?')
        .next()
        .unwrap_or_default()
        .to_owned();
    match path.as_str() {
        "/events" => {
            let shared = shared.clone();
            thread::spawn(move || events(request, &shared));
            Ok(())
        }
        // Browsers ask for it by themselves.
        "/favicon.ico" => request.respond(Response::empty(204)),
        _ => match FILES.iter().find(|(name, ..)| *name == path) {
            Some((_, kind, text)) => {
                let mut response = Response::from_string(*text);
                for (field, value) in [
                    ("Content-Type", *kind),
                    ("Content-Security-Policy", POLICY),
                    ("X-Content-Type-Options", "nosniff"),
                    ("Referrer-Policy", "no-referrer"),
                    ("Cache-Control", "no-store"),
                ] {
                    if let Ok(header) = Header::from_bytes(field, value) {
                        response.add_header(header);
                    }
                }
                request.respond(response)
            }
            None => request.respond(Response::from_string("not found").with_status_code(404)),
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
    let mut page = request.into_writer();
    page.write_all(
        b"HTTP/1.1 200 OK\r\nContent-Type: text/event-stream\r\nCache-Control: no-store\r\n\
          Connection: close\r\n\r\n",
    )?;
    page.flush()?;
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
