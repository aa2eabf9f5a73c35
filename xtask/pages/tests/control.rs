//! `monitor --control`: what pages, cables and attackers do to a machine.

#[path = "support/browser.rs"]
mod browser;
mod support;

use std::{
    fs,
    io::{Read as _, Write as _},
    net::{Shutdown, TcpListener, TcpStream},
    process::Command,
    thread::{self, JoinHandle},
};

use browser::{Known, Page, send, step};
use rustix::process::Signal;
use serde_json::{Value, json};
use support::Monitor;
use tungstenite::Message;

const IDLE: &[u8] = b"<Idle|MPos:1.000,2.000,0.000|FS:0,0|WCO:0.000,0.000,0.000>\r\n";
const RUN: &[u8] = b"<Run|MPos:1.000,2.000,0.000|FS:0,0|WCO:0.000,0.000,0.000>\r\n";

/// A served machine, and who may open its page.
fn simulated(settings: &[&str]) -> (Monitor, Known) {
    let settings = settings.iter().flat_map(|setting| ["--set", setting]);
    let arguments = ["--control", "--sim", "--no-open"]
        .into_iter()
        .chain(settings);
    let mut monitor = Monitor::start(&arguments.collect::<Vec<_>>());
    let known = Known::by(&monitor.address());
    (monitor, known)
}

fn control(page: &mut Page, is_mine: bool) {
    page.until("control", |control| control["is_mine"] == is_mine);
}

#[test]
fn one_page_jogs_and_runs_jobs_and_the_others_watch() {
    let (monitor, known) = simulated(&["$110=6000", "$120=500"]);
    let mut first = known.page();
    let begin = first.event();
    assert_eq!(
        (&begin["is"], &begin["is_mine"]),
        (&"control".into(), &true.into()),
        "{begin}"
    );
    assert_eq!(first.event()["is"], "state");
    first.until_at(0.0);
    first.ask(&step(5.0));
    first.until_at(5.0);
    let mut second = known.page();
    assert_eq!(second.event()["is_mine"], false);
    assert_eq!(second.event()["machine"][0], 5.0);
    second.ask(&step(5.0));
    second.until("note", |note| {
        note["text"].as_str().unwrap().contains("watches")
    });
    second.ask(&json!({"do": "take-control"}));
    control(&mut second, true);
    control(&mut first, false);
    first.ask(&json!({"do": "start"}));
    first.until("note", |note| {
        note["text"].as_str().unwrap().contains("watches")
    });
    // More than a command may have, which only a page in control may send.
    let text = "G91 ; and so on\n".repeat(10_000);
    second.open(&format!("{text}G1 X2 F3000\n"));
    second.until_state(|state| state["job"]["lines"] == 10_001);
    second.open("G91\nG1 X2 F3000\n");
    second.start();
    for page in [&mut second, &mut first] {
        page.until_state(|state| state["job"]["outcome"] == "done");
    }
    second.until_at(7.0);
    monitor.interrupt();
    assert_eq!(monitor.end().0, Some(0));
}

#[test]
fn a_page_that_vanishes_amid_a_held_jog_stops_the_axis() {
    let (_monitor, known) = simulated(&["$110=3000", "$120=500"]);
    let mut page = known.page();
    page.until_at(0.0);
    assert_eq!(page.line("$G"), "ok");
    let mut watcher = known.page();
    let held = json!({"do": "move", "press": 1, "along": [1, 0, 0], "feed": 3000.0});
    let x_mm = |event: &Value| event["machine"][0].as_f64();
    page.ask(&held);
    // The page says so again with each report that it sees.
    while page.until("state", |_| true)["machine"][0].as_f64() < Some(10.0) {
        page.ask(&held);
    }
    page.socket.get_ref().shutdown(Shutdown::Both).unwrap();
    let mut at_mm: f64 = 0.0;
    let mut vanished_mm = None;
    while vanished_mm.is_none() {
        let event = watcher.event();
        at_mm = x_mm(&event).unwrap_or(at_mm);
        vanished_mm = (event["is"] == "control" && event["is_taken"] == false).then_some(at_mm);
    }
    let end = watcher.until("state", |state| state["state"] == "Idle");
    let moved_mm = x_mm(&end).unwrap() - vanished_mm.unwrap();
    // 250 ms at 50 mm/s, and as far as the machine comes until its next report.
    assert!(moved_mm <= 50.0 * (0.25 + 0.1), "{moved_mm}");
    for _ in 0..10 {
        let line = watcher.until("line", |_| true);
        assert!(!line["text"].as_str().unwrap().contains("$J"), "{line}");
    }
    watcher.ask(&json!({"do": "take-control"}));
    assert_eq!(watcher.line("$G"), "ok");
    watcher.ask(&step(1.0));
    let end_mm = x_mm(&end).unwrap() + 1.0;
    watcher.until("state", |it| {
        it["state"] == "Idle" && (x_mm(it).unwrap() - end_mm).abs() < 0.01
    });
}

#[test]
fn a_page_that_answers_no_ping_controls_no_more() {
    let (_monitor, known) = simulated(&[]);
    let mut silent = known.page();
    control(&mut silent, true);
    let mut watcher = known.page();
    watcher.until("control", |control| control["is_taken"] == false);
}

#[test]
fn the_browser_is_opened_with_a_token_that_counts_once() {
    let folder = tempfile::tempdir().unwrap();
    // A browser that says what it is to open.
    let script = concat!(
        r#"mkfifo opened; printf '#!/bin/sh\nprintf %%s "$1" > %s/opened' "$PWD" > browser"#,
        "; chmod +x browser"
    );
    let made = Command::new("sh")
        .args(["-c", script])
        .current_dir(folder.path())
        .status()
        .unwrap();
    assert!(made.success());
    let browser = folder.path().join("browser");
    let mut monitor =
        Monitor::of(Monitor::command(&["--control", "--sim"]).env("BROWSER", &browser));
    let printed = monitor.address();
    let opened = fs::read_to_string(folder.path().join("opened")).unwrap();
    let opened = opened.replace("http://", "");
    let (address, token) = printed.split_once("/?token=").unwrap();
    assert!(opened.starts_with(&format!("{address}/?once=")), "{opened}");
    assert!(!opened.contains(token), "{opened}");
    let mut page = Known::by(&opened).page();
    control(&mut page, true);
    let (_, query) = opened.split_once('/').unwrap();
    let request = format!("GET /{query} HTTP/1.1\r\nHost: {address}\r\n\r\n");
    let answer = send(address, &request);
    assert!(answer.starts_with("HTTP/1.1 403"), "{answer}");
    // The address that was printed is for further pages.
    for _ in 0..2 {
        control(&mut Known::by(&printed).page(), false);
    }
    monitor.interrupt();
    let (status, printed) = monitor.end();
    assert_eq!(status, Some(0), "{printed}");
    assert!(printed.contains("was used twice"), "{printed}");
}

const HOST: &str = "Host: {address}";
const REBOUND: &str = "Host: elsewhere.example";
const COOKIE: &str = "Cookie: {cookie}";
const OWN: &str = "Origin: http://{address}";
const FOREIGN: &str = "Origin: http://elsewhere.example";
const UPGRADE: &str = "Connection: Upgrade\r\nUpgrade: websocket\r\nSec-WebSocket-Version: 13\r\n\
                       Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==";
const HUGE: &str = "Content-Length: 137438953472";

/// Requests that no page of the server sends, and the status of the answer; the last one is a page's.
const ATTACKS: [(&str, &[&str], &str); 22] = [
    ("POST /", &[HOST, COOKIE, HUGE], "405"),
    ("POST /socket", &[HOST, COOKIE, "Content-Length: 2"], "405"),
    ("GET /", &[HOST, COOKIE, HUGE], "413"),
    (
        "GET /",
        &[HOST, COOKIE, "Transfer-Encoding: chunked"],
        "413",
    ),
    ("GET /", &[HOST], "403"),
    ("GET /view.html", &[HOST], "403"),
    (
        "GET /?token=0123456789abcdef0123456789abcdef",
        &[HOST],
        "403",
    ),
    ("GET /", &[HOST, "Cookie: {forged}"], "403"),
    ("GET /", &[REBOUND, COOKIE], "403"),
    ("GET /", &[COOKIE], "403"),
    (
        "GET /",
        &[HOST, COOKIE, "Sec-Fetch-Site: cross-site"],
        "403",
    ),
    ("GET /", &[HOST, COOKIE, FOREIGN], "403"),
    ("GET /socket", &[HOST, COOKIE], "403"),
    ("GET /socket", &[HOST, COOKIE, UPGRADE], "403"),
    (
        "GET /socket",
        &[HOST, COOKIE, UPGRADE, "Origin: null"],
        "403",
    ),
    ("GET /socket", &[HOST, COOKIE, UPGRADE, FOREIGN], "403"),
    ("GET /socket", &[HOST, UPGRADE, OWN], "403"),
    ("GET /socket", &[REBOUND, COOKIE, UPGRADE, FOREIGN], "403"),
    ("GET /step?by=5", &[HOST, COOKIE], "404"),
    ("GET /../../etc/passwd", &[HOST, COOKIE], "404"),
    ("\0\x1b[2J /", &[HOST, COOKIE], "400"),
    ("GET /", &[HOST, COOKIE, OWN], "200"),
];

fn check_attack(known: &Known, (request, fields, status): (&str, &[&str], &str)) {
    let Known { address, cookie } = known;
    let other = |digit| if digit == '0' { '1' } else { '0' };
    let (name, token) = cookie.split_once('=').unwrap();
    let forged: String = token.chars().map(other).collect();
    let request = format!("{request} HTTP/1.1\r\n{}\r\n\r\n", fields.join("\r\n"))
        .replace("{address}", address)
        .replace("{cookie}", cookie)
        .replace("{forged}", &format!("{name}={forged}"));
    let answer = send(address, &request);
    let expected = format!("HTTP/1.1 {status}");
    assert!(answer.starts_with(&expected), "{request:?}: {answer}");
}

/// What a browser is told that it may do with a file.
fn policy(known: &Known, path: &str) -> String {
    let Known { address, cookie } = known;
    let answer = send(
        address,
        &format!("GET {path} HTTP/1.1\r\nHost: {address}\r\nCookie: {cookie}\r\n\r\n"),
    );
    let (_, policy) = answer.split_once("Content-Security-Policy: ").unwrap();
    policy.split_once("\r\n").unwrap().0.to_owned()
}

#[test]
fn only_the_view_runs_scripts_of_a_page_and_it_is_nobodys_page() {
    let (_monitor, known) = simulated(&[]);
    let page = "default-src 'none'; script-src 'self' 'wasm-unsafe-eval'; worker-src 'self'; style-src 'self'; \
                img-src data:; \
        connect-src 'self'; frame-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'";
    for path in ["/", "/page.css", "/glue.js", "/page.js", "/page.wasm"] {
        assert_eq!(policy(&known, path), page, "{path}");
    }
    assert_eq!(
        policy(&known, "/view.html"),
        "sandbox allow-scripts; default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; \
         img-src data:; base-uri 'none'; form-action 'none'; frame-ancestors 'self'"
    );
}

/// What a page sends that is none, each over a WebSocket of its own: frames as bytes.
fn frames() -> Vec<Vec<u8>> {
    let masked =
        |first: u8, length: &[u8], payload: &[u8]| [&[first], length, &[0; 4], payload].concat();
    let huge = (1_u64 << 37).to_be_bytes();
    let long = (1_u64 << 17).to_be_bytes();
    let fragment = masked(0x01, &[0xfe, 0x40, 0], &[b' '; 0x4000]);
    let more = masked(0x00, &[0xfe, 0x40, 0], &[b' '; 0x4000]);
    vec![
        masked(0x81, &[&[0xff][..], &huge].concat(), b"{"),
        masked(0x81, &[&[0xff][..], &long].concat(), b"{"),
        [fragment, more.repeat(5)].concat(),
        masked(0x82, &[0x84], b"\x18\x18\x18\x18"),
        masked(0x81, &[0x82], b"\xff\xfe"),
        b"\x81\x02$X".to_vec(),
        vec![0xff; 1000],
    ]
}

#[test]
fn what_attackers_send_moves_nothing_and_the_page_is_served_on() {
    let (_monitor, known) = simulated(&[]);
    let mut page = known.page();
    page.until_at(0.0);
    for attack in ATTACKS {
        check_attack(&known, attack);
    }
    // Each silent connection ends an older one.
    let silent = |_| TcpStream::connect(&known.address).ok();
    let held: Vec<_> = (0..100).map(silent).collect();
    for _ in 0..99 {
        (0..100).map(silent).for_each(drop);
        assert_eq!(page.line("$G"), "ok");
    }
    check_attack(&known, ATTACKS[ATTACKS.len() - 1]);
    drop(held);
    for frame in frames() {
        let mut other = known.page();
        control(&mut other, false);
        other.socket.get_mut().write_all(&frame).unwrap();
        // Whatever has been sent is read, and then the connection ends.
        while other.socket.read().is_ok() {}
    }
    // What claims more than a command is refused before it comes, also of the page in control.
    let mut other = known.page();
    other.ask(&json!({"do": "take-control"}));
    control(&mut other, true);
    other.socket.get_mut().write_all(&frames()[1]).unwrap();
    while other.socket.read().is_ok() {}
    page.ask(&json!({"do": "take-control"}));
    control(&mut page, true);
    for text in ["", "$X", "[]", "{\"do\":\"fly\"}", &"[".repeat(10_000)] {
        page.socket.send(Message::text(text)).unwrap();
        page.until("note", |note| {
            note["text"].as_str().unwrap().contains("does not know")
        });
    }
    let mut pages: Vec<_> = (0..15).map(|_| known.page()).collect();
    let stream = TcpStream::connect(&known.address).unwrap();
    let refused = tungstenite::client(known.request(), stream).unwrap_err();
    assert!(refused.to_string().contains("503"), "{refused}");
    for page in &mut pages {
        control(page, false);
    }
    page.ask(&step(1.0));
    page.until_at(1.0);
}

/// A connection of the monitor to a machine that is none: it says the same to each `?`, and `ok` to what is asked
/// for at the begin. Returns what has come when the bytes are among it.
fn serve(stream: &mut TcpStream, report: &[u8], until: &[u8]) -> Vec<u8> {
    let (mut received, mut byte) = (Vec::new(), [0]);
    while !received.ends_with(until) && stream.read(&mut byte).is_ok_and(|length| length == 1) {
        received.push(byte[0]);
        if byte == *b"?" {
            let _ = stream.write_all(report);
        }
        if received.ends_with(b"$G\n") {
            let _ = stream.write_all(b"[GC:G0 G54]\r\n");
        }
        if received.ends_with(b"$$\n") || received.ends_with(b"$G\n") {
            let _ = stream.write_all(b"ok\r\n");
        }
    }
    received
}

/// The job of the tests with a machine that is none, of which it answers no line.
const JOB: &str = "G1 X100 F100\nG1 X200\n";

/// Monitor and page of a machine that gets the first line of a job, as it is then.
fn with_job<T: Send + 'static>(
    machine: impl FnOnce(TcpListener, TcpStream) -> T + Send + 'static,
) -> (Monitor, Page, JoinHandle<T>) {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = listener.local_addr().unwrap().to_string();
    let machine = thread::spawn(move || {
        let (mut stream, _) = listener.accept().unwrap();
        serve(&mut stream, IDLE, b"G1 X100 F100\n");
        machine(listener, stream)
    });
    let mut monitor = Monitor::start(&["--control", "--tcp", &address, "--no-open"]);
    let mut page = Known::by(&monitor.address()).page();
    page.until_state(|state| state["state"] == "Idle");
    page.open(JOB);
    page.start();
    (monitor, page, machine)
}

#[test]
fn nothing_goes_on_when_a_machine_is_connected_again() {
    let (_monitor, mut page, machine) = with_job(|listener, stream| {
        drop(stream);
        let (mut stream, _) = listener.accept().unwrap();
        serve(&mut stream, IDLE, b"M5\n")
    });
    page.until("control", |control| control["is_connected"] == false);
    page.until("state", |state| {
        state["job"]["outcome"] == "the line to the machine was lost"
    });
    page.until("control", |control| control["is_connected"] == true);
    page.until_state(|state| state["is_there"] == true);
    page.ask(&json!({"do": "line", "number": 2, "text": "M5"}));
    let received = String::from_utf8(machine.join().unwrap()).unwrap();
    assert_eq!(
        received
            .replace('?', "")
            .replace("$$\n", "")
            .replace("$G\n", ""),
        "M5\n"
    );
}

const JOG: &[u8] = b"<Jog|MPos:1.000,2.000,0.000|FS:600,0|WCO:0.000,0.000,0.000>\r\n";

#[test]
fn a_held_jog_is_held_and_no_line_follows_when_the_program_is_interrupted_or_killed() {
    for signal in [Signal::INT, Signal::KILL] {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let address = listener.local_addr().unwrap().to_string();
        let machine = thread::spawn(move || {
            let (mut stream, _) = listener.accept().unwrap();
            serve(&mut stream, IDLE, b"$J=");
            serve(&mut stream, JOG, b"!");
            let mut rest = Vec::new();
            let _ = stream.read_to_end(&mut rest);
            String::from_utf8_lossy(&rest).into_owned()
        });
        let mut monitor = Monitor::start(&["--control", "--tcp", &address, "--no-open"]);
        let mut page = Known::by(&monitor.address()).page();
        page.until_state(|state| state["state"] == "Idle");
        // Each line of the machine comes to the page: it asks often enough.
        let mut asked = 0;
        while page.event()["state"] != "Jog" {
            let press = asked / 10;
            page.ask(&json!({"do": "move", "press": press, "along": [1, 0, 0], "feed": 600.0}));
            asked += 1;
        }
        monitor.signal(signal);
        monitor.end();
        let rest = machine.join().unwrap();
        assert!(!rest.contains('$'), "{signal:?}: {rest}");
    }
}

#[test]
fn a_job_is_held_when_the_program_is_interrupted_or_killed() {
    for signal in [Signal::INT, Signal::KILL] {
        let (monitor, mut page, machine) = with_job(|_, mut stream| serve(&mut stream, RUN, b"!"));
        page.until_state(|state| state["state"] == "Run");
        monitor.signal(signal);
        let (status, printed) = monitor.end();
        if signal == Signal::INT {
            assert_eq!(status, Some(1), "{printed}");
            assert!(
                printed.contains("interrupted, and the machine is held"),
                "{printed}"
            );
        }
        assert!(machine.join().unwrap().ends_with(b"!"), "{signal:?}");
    }
}
