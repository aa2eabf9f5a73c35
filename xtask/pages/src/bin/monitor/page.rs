//! The page: a few files and the stream of events, for browsers on this computer.
//!
//! Nothing is fetched from elsewhere, and the browser is told to refuse that.

use std::{
    io::{self, Write},
    sync::Arc,
    thread,
    time::{Duration, Instant},
};

use anyhow::Result;
use simulation::Job;

use crate::{
    http::{self, Request},
    picture::{Shared, Shown},
    site::{self, File, Site},
};

/// Least time between two events: a screen shows no more.
const FRAME: Duration = Duration::from_millis(30);
/// Silence after which a comment is sent, so that a page that has gone is noticed.
const SILENCE: Duration = Duration::from_secs(2);
/// How long the last event may take.
const LAST_EVENT_TIMEOUT: Duration = Duration::from_secs(10);

const POLICY: &str = "default-src 'none'; script-src 'self'; style-src 'self'; connect-src 'self'; \
    base-uri 'none'; form-action 'none'";
/// The files of the page, and of the job that is known in advance.
fn files(job: Option<Job>) -> Result<Vec<File>> {
    let page = pages::page::served(
        "Leadscrew monitor",
        POLICY,
        include_str!("page/live.html"),
        include_str!("page/live.css"),
        include_str!("page/live.js"),
    );
    let facts = serde_json::to_vec(&job)?;
    let job = job.unwrap_or_default();
    Ok(vec![
        ("/", site::HTML, page.html.into()),
        ("/page.css", site::STYLE, page.style.into()),
        ("/page.js", site::SCRIPT, page.script.into()),
        ("/job.json", "application/json", facts),
        ("/job.path", site::BYTES, job.columns),
        ("/job.curves", site::BYTES, job.curves),
        ("/job.program", site::BYTES, job.text),
    ])
}

/// Serves the page at an address, with a job that is known in advance, and returns where.
pub(crate) fn serve(address: &str, shared: &Arc<Shared>, job: Option<Job>) -> Result<String> {
    let (listener, site) = Site::bind(address, POLICY, files(job)?)?;
    let (url, shared) = (site.url(), shared.clone());
    http::serve(listener, move |request| match site.refusal(&request) {
        Some(refusal) => request.answer("403 Forbidden", &[], refusal.as_bytes()),
        None if request.path == "/events" => events(request, &shared),
        None => site.answer(request),
    });
    Ok(url)
}

/// Waits until each page has been told that nothing more is to come, at most a while.
pub(crate) fn wait_for_pages(shared: &Shared) {
    let end = Instant::now() + LAST_EVENT_TIMEOUT;
    let mut picture = shared.lock();
    while picture.pages > 0 && Instant::now() < end {
        picture = shared.wait(picture, FRAME);
    }
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
