//! `--control`: a page that operates the machine. This program talks with the machine, so that a page which sleeps,
//! hangs or goes stops no job.

mod access;
mod pages;
mod socket;

use std::{
    ffi::OsStr,
    io,
    net::TcpListener,
    os::{fd::AsFd as _, unix::net::UnixStream},
    process::ExitCode,
    sync::{
        Arc,
        atomic::{AtomicUsize, Ordering},
        mpsc::{Receiver, SyncSender, sync_channel},
    },
    time::{Duration, Instant},
};

use anyhow::{Error, Result, bail, ensure};
use common::{options::Monitor as Options, ui};
use grbl_client::{
    Client, JobGuard, Link,
    client::{Command, Event},
    link::{self, PollFlags},
    realtime,
};
use simulation::interrupt::interruptions;

use crate::{
    http::{self, Request},
    site::Site,
    source::{self, Source},
};
use access::{OneTimeToken, Token};
use pages::Pages;
use socket::FromPage;

/// How often the client goes on.
const TICK: Duration = Duration::from_millis(20);
/// The longest wait for bytes and pages.
const WAIT: Duration = Duration::from_millis(5);
/// How often a machine that has gone is looked for, and how long an address may take to answer then.
const SEARCH: Duration = Duration::from_secs(1);
const ANSWER: Duration = Duration::from_millis(500);
/// After how long at rest a machine needs no guard any more.
const REST: Duration = Duration::from_secs(1);
/// Bytes that wait for the machine at most; then the pages wait.
const MAX_QUEUED_BYTES: usize = 4096;
/// Messages of pages that have not been taken, at most.
const MOST_UNREAD: usize = 64;
/// Realtime bytes that stop, or ask for a report.
const STOPS: [u8; 5] = [
    realtime::REPORT,
    realtime::HOLD,
    realtime::RESET,
    realtime::DOOR,
    realtime::JOG_CANCEL,
];
/// The most pages at a time.
const MOST_PAGES: usize = 16;

/// What a browser may do with the page: run its scripts, also as WebAssembly and in a worker, and ask this server alone.
const POLICY: &str = "default-src 'none'; script-src 'self' 'wasm-unsafe-eval'; worker-src 'self'; style-src 'self'; \
    img-src data:; connect-src 'self'; frame-src 'self'; base-uri 'none'; form-action 'none'";

/// Whether a command holds the machine.
fn is_hold(command: &Command) -> bool {
    let byte = realtime::HOLD;
    *command == Command::Realtime { byte }
}

/// Serves the page until Ctrl-C.
pub(crate) fn run(options: &Options) -> Result<ExitCode> {
    ensure!(
        options.settings.is_none() || options.sim,
        "--settings needs --sim here"
    );
    let files = ::pages::control::served(::pages::control::built()?);
    let Source {
        link,
        simulator: _simulator,
    } = crate::source(options)?;
    let stop = interruptions()?;
    let (machine, _) = source::greet(link, &stop)?;
    let (token, once) = (Token::new()?, OneTimeToken::new()?);
    let (listener, site) = Site::bind(&options.listen, POLICY, files)?;
    let [url, browser_url] =
        [token.query(), once.query()].map(|query| format!("{}?{query}", site.url()));
    let (to_server, from_pages) = sync_channel(MOST_UNREAD);
    serve(listener, site, (token, once), to_server);
    ui::status("Serving", &format!("{url} (Ctrl-C ends)"));
    if !options.no_open {
        ui::open(OsStr::new(&browser_url));
    }
    let mut server = ControlServer::new(options, machine.link, from_pages);
    server.run(&stop)?;
    Ok(ExitCode::SUCCESS)
}

/// Answers requests of whoever has the token.
fn serve(
    listener: TcpListener,
    site: Site,
    (token, once): (Token, OneTimeToken),
    to_server: SyncSender<FromPage>,
) {
    let (numbers, open) = (AtomicUsize::new(0), Arc::new(AtomicUsize::new(0)));
    http::serve(listener, move |request| {
        if let Some(refusal) = site.refusal(&request) {
            return request.answer("403 Forbidden", &[], refusal.as_bytes());
        }
        let is_exchanged = || token.is_asked_with(&request) || once.is_exchanged_by(&request);
        if request.path == "/" && is_exchanged() {
            let cookie = token.cookie(site.at);
            let fields = [
                ("Location", "/"),
                ("Set-Cookie", &cookie),
                ("Cache-Control", "no-store"),
            ];
            return request.answer("303 See Other", &fields, &[]);
        }
        if !token.is_known(&request, site.at) {
            let hint = b"Open the address that cargo xtask monitor has printed.";
            return request.answer("403 Forbidden", &[], hint);
        }
        if request.path != "/socket" {
            return site.answer(request);
        }
        if !socket::is_asked(&request) {
            return request.answer("403 Forbidden", &[], b"a WebSocket of the page alone");
        }
        talk(request, &numbers, &open, &to_server)
    });
}

/// Talks with a page, if there may be another one.
fn talk(
    request: Request,
    numbers: &AtomicUsize,
    open: &AtomicUsize,
    to_server: &SyncSender<FromPage>,
) -> io::Result<()> {
    let talked = if open.fetch_add(1, Ordering::Relaxed) < MOST_PAGES {
        socket::talk(request, numbers.fetch_add(1, Ordering::Relaxed), to_server)
    } else {
        request.answer("503 Service Unavailable", &[], b"too many pages are open")
    };
    open.fetch_sub(1, Ordering::Relaxed);
    talked
}

/// A machine between its line and the pages.
struct ControlServer<'a> {
    options: &'a Options,
    /// None while the machine has gone.
    link: Option<Link>,
    client: Client,
    pages: Pages,
    from_pages: Receiver<FromPage>,
    to_machine: Vec<u8>,
    start: Instant,
    ticked: Instant,
    /// When the machine was looked for.
    searched: Instant,
    /// What holds the machine if this program is killed, and when the machine may last have moved.
    guard: Option<JobGuard>,
    moved: Instant,
}

impl<'a> ControlServer<'a> {
    fn new(options: &'a Options, link: Link, from_pages: Receiver<FromPage>) -> Self {
        let now = Instant::now();
        Self {
            options,
            pages: Pages::new(&link.name),
            link: Some(link),
            client: Client::default(),
            from_pages,
            to_machine: Vec::new(),
            start: now,
            ticked: now,
            searched: now,
            guard: None,
            moved: now,
        }
    }

    /// Goes on until Ctrl-C.
    fn run(&mut self, stop: &UnixStream) -> Result<()> {
        loop {
            if self.wait(stop)? {
                return self.stop();
            }
            self.take_from_pages();
            if let Err(error) = self.exchange() {
                self.lose(&error)?;
            }
            self.tick();
            let events = self.client.take_events();
            self.pages.tell(&events);
            if self.link.is_none() && self.searched.elapsed() >= SEARCH {
                self.search();
            }
        }
    }

    /// Waits for bytes, or room for them, for a short while. Returns whether it is to stop.
    fn wait(&self, stop: &UnixStream) -> Result<bool> {
        let mut flags = PollFlags::IN;
        flags.set(PollFlags::OUT, !self.to_machine.is_empty());
        let mut ends = vec![(stop.as_fd(), PollFlags::IN)];
        ends.extend(self.link.iter().map(|link| (link.as_fd(), flags)));
        Ok(link::wait(&ends, WAIT)?[0])
    }

    fn now_ms(&self) -> u64 {
        self.start.elapsed().as_millis() as u64
    }

    /// Takes the messages of pages, unless the machine has to take what was asked for before.
    fn take_from_pages(&mut self) {
        for _ in 0..MOST_UNREAD {
            if self.to_machine.len() >= MAX_QUEUED_BYTES {
                return;
            }
            let Ok(message) = self.from_pages.try_recv() else {
                return;
            };
            self.take(message);
            self.to_machine.extend(self.client.take_output());
        }
    }

    /// Does what a page wants.
    fn take(&mut self, message: FromPage) {
        match message {
            FromPage::Opened(page) => self.pages.open(page, self.client.state()),
            FromPage::TakesControl(page) => {
                if !self.pages.is_in_control(page) {
                    self.client.leave();
                    self.pages.take_control(page);
                }
            }
            FromPage::Closed(page) => {
                if self.pages.close(page) {
                    self.client.leave();
                }
            }
            // Whoever sees the machine may hold it.
            FromPage::Command(page, command)
                if !self.pages.is_in_control(page) && !is_hold(&command) =>
            {
                self.pages
                    .note(page, "this page watches: it has to take control first");
            }
            FromPage::Command(page, _) if self.link.is_none() => {
                self.pages.note(page, "there is no line to the machine");
            }
            FromPage::Command(page, command) => {
                if let Err(error) = self.guard_against(&command) {
                    self.pages
                        .note(page, &format!("nothing is done: {error:#}"));
                } else {
                    self.client.command(command, self.now_ms());
                }
            }
        }
    }

    /// Has a guard for a command that may move the machine.
    fn guard_against(&mut self, command: &Command) -> Result<()> {
        let is_harmless = match command {
            Command::Halt | Command::Stop | Command::Program { .. } => true,
            // What stops needs no guard.
            Command::Realtime { byte } => STOPS.contains(byte),
            _ => false,
        };
        if let (false, Some(link)) = (is_harmless, &self.link) {
            self.moved = Instant::now();
            if self.guard.is_none() {
                self.guard = Some(JobGuard::of(link)?);
            }
        }
        Ok(())
    }

    /// Moves what bytes there are.
    fn exchange(&mut self) -> Result<()> {
        let Some(link) = &self.link else {
            return Ok(());
        };
        let mut chunk = [0; 4096];
        let length = link.read(&mut chunk)?;
        let now_ms = self.now_ms();
        self.client.receive(&chunk[..length], now_ms);
        self.to_machine.extend(self.client.take_output());
        link.write(&mut self.to_machine)
    }

    /// Lets the client go on.
    fn tick(&mut self) {
        if self.ticked.elapsed() < TICK || self.link.is_none() {
            return;
        }
        self.ticked = Instant::now();
        self.client.tick(self.now_ms());
        self.to_machine.extend(self.client.take_output());
        if self.may_move() {
            self.moved = self.ticked;
        } else if self.moved.elapsed() >= REST
            && let Some(mut guard) = self.guard.take()
        {
            guard.dismiss();
        }
    }

    fn is_job_running(&self) -> bool {
        { self.client.state().job.iter() }.any(|job| job.is_running)
    }

    fn may_move(&self) -> bool {
        let state = self.client.state();
        let name = state.state.split(':').next().unwrap_or_default();
        let is_at_rest = matches!(name, "Idle" | "Alarm" | "Check" | "Sleep");
        !is_at_rest || !state.is_there || self.is_job_running()
    }

    /// Takes note of a machine that has gone: nothing that was asked for is done when it is back.
    fn lose(&mut self, error: &Error) -> Result<()> {
        if self.options.sim {
            bail!("the simulator has ended: {error:#}");
        }
        let text = format!("{error:#}: the line is looked for, and nothing goes on by itself");
        ui::warning(&text);
        self.link = None;
        if let Some(mut guard) = self.guard.take() {
            guard.dismiss();
        }
        self.client.lose_line();
        self.client.tick(self.now_ms());
        self.client.take_output();
        self.to_machine.clear();
        self.pages.set_connected(false);
        self.pages.tell(&[Event::Note { text }]);
        Ok(())
    }

    /// Looks for a machine that has gone.
    fn search(&mut self) {
        self.searched = Instant::now();
        let Options {
            port, baud, tcp, ..
        } = self.options;
        if let Ok(link) = Link::open(port.as_deref(), *baud, tcp.as_deref(), ANSWER) {
            ui::status("Connected", &link.name);
            self.link = Some(link);
            self.pages.set_connected(true);
        }
    }

    /// Ends: a machine that moves is held.
    fn stop(&mut self) -> Result<()> {
        self.client.leave();
        let cancel = self.client.take_output();
        if let Some(link) = &self.link {
            link.send(&cancel)?;
        }
        let Some(mut guard) = self.guard.take() else {
            return Ok(());
        };
        if !self.may_move() {
            guard.dismiss();
            return Ok(());
        }
        ensure!(
            guard.hold(),
            "the machine has not taken the hold: it may still move"
        );
        ensure!(
            !self.is_job_running(),
            "the job was interrupted, and the machine is held: ~ goes on, a reset ends it"
        );
        Ok(())
    }
}
