//! The command as it is typed: at the simulator, and at machines that are none.

mod support;

use std::{
    fs,
    io::{BufRead as _, BufReader, Read as _, Write as _},
    net::{TcpListener, TcpStream},
    sync::mpsc::{Sender, TryRecvError, channel},
    thread,
    time::{Duration, Instant},
};

use rustix::process::Signal;
use serde_json::Value;
use simulation::pty::Pty;
use support::Monitor;
use tempfile::tempdir;

const REPORT: &[u8] = b"<Idle|MPos:1.000,2.000,0.000|FS:0,0|WCO:0.000,0.000,0.000>\r\n";

/// Asks for a page. Returns what is answered.
fn get(address: &str, path: &str, host: &str) -> BufReader<TcpStream> {
    let mut stream = TcpStream::connect(address).unwrap();
    write!(
        stream,
        "GET {path} HTTP/1.1\r\nHost: {host}\r\nConnection: close\r\n\r\n"
    )
    .unwrap();
    BufReader::new(stream)
}

fn head(address: &str, path: &str, host: &str) -> String {
    let lines = get(address, path, host).lines().map_while(Result::ok);
    let head: Vec<_> = lines.take_while(|line| !line.is_empty()).collect();
    head.join("\n")
}

/// The events of a page, to the last one.
fn events(address: &str) -> impl Iterator<Item = Value> {
    let lines = get(address, "/events", address)
        .lines()
        .map_while(Result::ok);
    lines.filter_map(|line| serde_json::from_str(line.strip_prefix("data: ")?).ok())
}

/// What no browser of a user sends, or only for a page from elsewhere: each is refused, and the page is served on.
fn check_attacks(address: &str) {
    let host = format!("Host: {address}\r\n");
    let endless = format!("GET /{} HTTP/1.1\r\n{host}\r\n", "x".repeat(100_000));
    let fields = format!("GET / HTTP/1.1\r\n{}{host}\r\n", "A: b\r\n".repeat(1000));
    for (request, status) in [
        (
            format!("POST / HTTP/1.1\r\n{host}Content-Length: 137438953472\r\n\r\nG0X7"),
            "405",
        ),
        (
            format!("GET / HTTP/1.1\r\n{host}Content-Length: 137438953472\r\n\r\nG0X7"),
            "413",
        ),
        (
            format!("GET / HTTP/1.1\r\n{host}Transfer-Encoding: chunked\r\n\r\nffffffff\r\n"),
            "413",
        ),
        (format!("DELETE / HTTP/1.1\r\n{host}\r\n"), "405"),
        ("GET / HTTP/1.1\r\n\r\n".into(), "403"),
        ("\0\x1b[2J / HTTP\r\n\r\n".into(), "400"),
        (
            format!("GET /events HTTP/1.1\r\n{host}Sec-Fetch-Site: cross-site\r\n\r\n"),
            "403",
        ),
        (fields, "4"),
        (endless, "431"),
    ] {
        let mut stream = TcpStream::connect(address).unwrap();
        // It may be refused before it has gone.
        let _ = stream.write_all(request.as_bytes());
        let mut answer = Vec::new();
        let _ = stream.read_to_end(&mut answer);
        let answer = String::from_utf8_lossy(&answer);
        let beginning: String = request.chars().take(60).collect();
        let is_cut = answer.is_empty() && request.len() > 10_000;
        let expected = format!("HTTP/1.1 {status}");
        assert!(
            is_cut || answer.starts_with(&expected),
            "{beginning:?}: {answer}"
        );
    }
    // More than there may be, none of which says anything; they are given up after a while.
    let idle: Vec<_> = (0..200).map(|_| TcpStream::connect(address)).collect();
    drop(idle);
    let since = Instant::now();
    while !head(address, "/", address).starts_with("HTTP/1.1 200") {
        assert!(
            since.elapsed() < Duration::from_secs(30),
            "it serves no more"
        );
        thread::sleep(Duration::from_millis(50));
    }
}

/// The page is there, for this computer alone, and refuses what comes from elsewhere.
fn check_pages(address: &str) {
    let page = head(address, "/", address);
    assert!(page.starts_with("HTTP/1.1 200"), "{page}");
    assert!(page.contains("default-src 'none'"), "{page}");
    for (path, host, status) in [
        ("/page.js", address, "200"),
        ("/page.css", "localhost:1", "200"),
        ("/favicon.ico", address, "204"),
        ("/etc/passwd", address, "404"),
        ("/", "elsewhere.example", "403"),
        ("/events", "elsewhere.example", "403"),
    ] {
        let head = head(address, path, host);
        assert!(
            head.starts_with(&format!("HTTP/1.1 {status}")),
            "{path}: {head}"
        );
    }
}

#[test]
fn the_experiment_is_shown_from_its_begin_to_its_end() {
    let folder = tempdir().unwrap();
    let picture = folder.path().join("out.svg");
    let picture = picture.to_str().unwrap();
    let mut monitor = Monitor::start(&[
        "examples/pico.nc",
        "--sim",
        "--settings",
        "examples/pico.settings",
        "--svg",
        picture,
    ]);
    let address = monitor.address();
    check_pages(&address);
    check_attacks(&address);
    let (mut points, mut all, mut last) = (Vec::new(), 0, Value::Null);
    for (number, event) in events(&address).enumerate() {
        if number == 50 {
            // The page is loaded again in the middle: it gets everything.
            let again = events(&address).next().unwrap();
            assert_eq!(again["is_all"], true);
            assert!(again["path"].as_array().unwrap().len() >= points.len());
        }
        if event["is_all"] == true {
            points.clear();
            all += 1;
        }
        points.extend(event["path"].as_array().unwrap().iter().cloned());
        last = event;
    }
    assert_eq!(all, 1);
    assert_eq!(
        (&last["is_over"], &last["unit"]),
        (&Value::Bool(true), &"mm".into())
    );
    assert_eq!(last["now"]["at"], serde_json::json!([0.0, 0.0, 0.0]));
    assert_eq!(last["now"]["state"], "Idle");
    assert_eq!(last["now"]["lines"], 8);
    assert!(points.len() > 9000, "{}", points.len());
    for (axis, value) in [("low", -800.0), ("high", 800.0)] {
        for letter in 0..2 {
            let extent = last["now"]["extents"][axis][letter].as_f64().unwrap();
            assert!((extent - value).abs() <= 1.0, "{axis} {letter}: {extent}");
        }
    }
    let (status, printed) = monitor.end();
    assert_eq!(status, Some(0), "{printed}");
    let drawn = fs::read_to_string(picture).unwrap();
    assert!(
        drawn.contains("X -800 to 800 mm, Y -800 to 800 mm"),
        "{printed}"
    );
}

#[test]
fn a_job_that_is_interrupted_has_not_succeeded() {
    let mut monitor = Monitor::start(&["examples/plate.nc", "--sim"]);
    let address = monitor.address();
    let is_in_motion = |event: &Value| event["now"]["state"] == "Run";
    if !events(&address).any(|event| is_in_motion(&event)) {
        let (status, printed) = monitor.end();
        panic!("it does not move, {status:?}: {printed}");
    }
    monitor.interrupt();
    let (status, printed) = monitor.end();
    assert_eq!(status, Some(1), "{printed}");
    assert!(
        printed.contains("interrupted, and the machine is held"),
        "{printed}"
    );
}

#[test]
#[cfg(target_os = "linux")]
fn the_virtual_machine_of_a_monitor_that_is_killed_ends() {
    let mut monitor = Monitor::start(&["--sim"]);
    monitor.address();
    let id = monitor.process.id();
    let children = fs::read_to_string(format!("/proc/{id}/task/{id}/children")).unwrap();
    let child = children.split_whitespace().next().unwrap().to_owned();
    // One that has ended may be kept for whoever asks how.
    let runs = || {
        let status = fs::read_to_string(format!("/proc/{child}/status"));
        status.is_ok_and(|status| !status.contains("State:\tZ"))
    };
    assert!(runs());
    monitor.signal(Signal::KILL);
    monitor.end();
    let since = Instant::now();
    while runs() {
        assert!(since.elapsed() < Duration::from_secs(30), "it runs on");
        thread::sleep(Duration::from_millis(10));
    }
}

#[test]
fn an_alarm_is_shown_with_its_line_the_reason_and_what_to_do() {
    let folder = tempdir().unwrap();
    let program = folder.path().join("job.nc");
    fs::write(&program, "$X\nG999\nG1 X-1 F600\nG4 P1\nX250\nX-2\n").unwrap();
    let limits = ["--sim", "--set", "$22=1", "--set", "$20=1"];
    let mut monitor = Monitor::start(&[&limits[..], &[program.to_str().unwrap()]].concat());
    let last = events(&monitor.address()).last().unwrap();
    // Of a machine that was locked at first, no settings are known.
    let alarm = "line 5 (X250): ALARM:2, the target is outside the machine's travel: reset, ";
    let shown = last["now"]["alarm"].as_str().unwrap();
    assert!(shown.starts_with(alarm), "{shown}");
    let refusal = "line 2 (G999): error:20, this command or word is not supported: remove";
    let shown = last["now"]["refusal"].as_str().unwrap();
    assert!(shown.starts_with(refusal), "{shown}");
    let (status, printed) = monitor.end();
    assert_eq!(status, Some(1), "{printed}");
    assert!(printed.contains(refusal), "{printed}");
    assert!(
        printed.contains(&format!("is locked: {alarm}")),
        "{printed}"
    );
}

#[test]
fn a_sender_reaches_the_machine_through_the_link() {
    let folder = tempdir().unwrap();
    let link = folder.path().join("tty");
    let mut monitor = Monitor::start(&[
        "--sim",
        "--set",
        "$110=6000",
        "--link",
        link.to_str().unwrap(),
    ]);
    let address = monitor.address();
    let mut sender = fs::File::options()
        .read(true)
        .write(true)
        .open(&link)
        .unwrap();
    let mut lines = BufReader::new(sender.try_clone().unwrap())
        .lines()
        .map(Result::unwrap);
    for line in ["G91", "G1 X1 F6000", "$G", "M999"] {
        writeln!(sender, "{line}").unwrap();
    }
    let received: Vec<_> = lines.by_ref().take(5).collect();
    let parser = "[GC:G1 G54 G17 G21 G91 G94 M5 M9 T0 F6000 S0]";
    assert_eq!(received, ["ok", "ok", parser, "ok", "error:23"]);
    write!(sender, "?").unwrap();
    assert!(lines.next().unwrap().starts_with('<'));
    // Nothing of what the monitor asks for is among it.
    let mut events = events(&address);
    assert!(events.any(|event| event["now"]["at"] == serde_json::json!([1.0, 0.0, 0.0])));
    writeln!(sender, "G1 X1").unwrap();
    assert!(events.any(|event| event["now"]["at"] == serde_json::json!([2.0, 0.0, 0.0])));
    assert_eq!(lines.next().unwrap(), "ok");
    monitor.interrupt();
    let (status, printed) = monitor.end();
    assert_eq!(status, Some(0), "{printed}");
    assert!(printed.contains("X 0 to 2 mm"), "{printed}");
    assert!(fs::symlink_metadata(&link).is_err());
}

/// The whole of a file that is served.
fn body(address: &str, path: &str) -> Value {
    let mut text = String::new();
    get(address, path, address)
        .read_to_string(&mut text)
        .unwrap();
    serde_json::from_str(text.split_once("\r\n\r\n").unwrap().1).unwrap()
}

#[test]
fn a_job_that_a_sender_sends_is_known_from_its_begin_to_its_end() {
    let folder = tempdir().unwrap();
    let [link, program] = ["tty", "job.nc"].map(|name| folder.path().join(name));
    let lines = ["G0 X50 Y5", "G1 Z-2 F1200", "G1 X100 F1200", "G0 Z1"];
    fs::write(&program, lines.join("\n")).unwrap();
    let mut monitor = Monitor::start(&[
        "--sim",
        "--program",
        program.to_str().unwrap(),
        "--set",
        "$120=500",
        "--link",
        link.to_str().unwrap(),
    ]);
    let address = monitor.address();
    let facts = body(&address, "/job.json");
    assert_eq!(
        (&facts["title"], &facts["lines"]),
        (&"job.nc".into(), &4.into())
    );
    assert!(head(&address, "/job.path", &address).starts_with("HTTP/1.1 200"));
    let mut sender = fs::File::options().write(true).open(&link).unwrap();
    for line in lines {
        writeln!(sender, "{line}").unwrap();
    }
    let (mut most, mut seen) = (0.0_f64, std::collections::BTreeSet::new());
    let is_done = |event: Value| {
        let job = event["now"]["job"].clone();
        let number = |name: &str| job[name].as_f64().unwrap_or(-1.0);
        // It never jumps back, as nothing is cut twice here.
        assert!(number("time_s") >= most - 0.05, "{job} after {most}");
        most = most.max(number("time_s"));
        seen.extend(job["line"].as_u64());
        number("left_s") == 0.0 && event["now"]["state"] == "Idle"
    };
    assert!(events(&address).any(is_done));
    assert!(seen.contains(&1) && seen.contains(&3), "{seen:?}");
    monitor.interrupt();
    let (status, printed) = monitor.end();
    assert_eq!(status, Some(0), "{printed}");
    // Nothing is known of what nobody names.
    let mut monitor = Monitor::start(&["--sim"]);
    assert_eq!(body(&monitor.address(), "/job.json"), Value::Null);
    monitor.interrupt();
    monitor.end();
}

#[test]
fn the_job_of_a_machine_in_motion_begins_at_its_work_zero() {
    let folder = tempdir().unwrap();
    let [program, settings] = ["job.nc", "of.settings"].map(|name| folder.path().join(name));
    fs::write(&program, "G1 X3 F60\n").unwrap();
    fs::write(&settings, "$100=100\n").unwrap();
    let report = b"<Run|MPos:41.000,2.000,0.000|FS:60,0|WCO:40.000,2.000,0.000>\r\n";
    let (address, switch) = machine(report);
    let mut monitor = Monitor::start(&[
        "--tcp",
        &address,
        "--program",
        program.to_str().unwrap(),
        "--settings",
        settings.to_str().unwrap(),
    ]);
    let page = monitor.address();
    let mut events = events(&page);
    assert!(events.any(|event| event["now"]["job"] != Value::Null));
    drop(switch);
    let last = events.last().unwrap();
    let job = &last["now"]["job"];
    assert_eq!(job["is_on_path"], true, "{last}");
    assert_eq!(job["line"], 1, "{last}");
    monitor.end();
}

/// A machine that is none: it says the same to each `?`, and is gone when its switch is dropped.
fn machine(answer: &'static [u8]) -> (String, Sender<()>) {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = listener.local_addr().unwrap().to_string();
    let (switch, is_on) = channel();
    thread::spawn(move || {
        let (mut stream, _) = listener.accept().unwrap();
        let mut byte = [0];
        while is_on.try_recv() == Err(TryRecvError::Empty) {
            while stream.read(&mut byte).is_ok_and(|length| length == 1) && byte != *b"?" {
                if byte == *b"$" {
                    let _ = stream.write_all(b"$100=10.000\r\n$101=10.000\r\nok\r\n");
                }
            }
            if stream.write_all(answer).is_err() {
                return;
            }
        }
    });
    (address, switch)
}

/// A machine that is none: it reports a place on half a circle, each one farther on once its switch is used.
fn machine_on_an_arc() -> (String, Sender<()>) {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = listener.local_addr().unwrap().to_string();
    let (switch, begins) = channel();
    thread::spawn(move || {
        let (mut stream, _) = listener.accept().unwrap();
        let (mut byte, mut degrees) = ([0], 0_u8);
        while stream.read(&mut byte).is_ok_and(|length| length == 1) {
            let answer = match byte {
                [b'\n'] => "[GC:G1 G54 G17 G21 G90 T3 F600]\r\nok\r\n".into(),
                [b'?'] => {
                    if degrees > 0 || begins.try_recv() == Ok(()) {
                        degrees = (degrees + 30).min(180);
                    }
                    let angle = f64::from(degrees).to_radians();
                    let (x, y) = (10.0 - 10.0 * angle.cos(), 10.0 * angle.sin());
                    let state = if matches!(degrees, 0 | 180) {
                        "Idle"
                    } else {
                        "Run"
                    };
                    format!(
                        "<{state}|MPos:{x:.3},{y:.3},0.000|FS:600,0|Pn:P|Ov:80,100,100|A:S\
                         |WCO:0.000,0.000,0.000>\r\n[MSG:half\x1b[2Jway]\r\n"
                    )
                }
                _ => continue,
            };
            if stream.write_all(answer.as_bytes()).is_err() {
                return;
            }
        }
    });
    (address, switch)
}

#[test]
fn between_two_reports_the_path_is_that_of_the_job() {
    let folder = tempdir().unwrap();
    let program = folder.path().join("job.nc");
    fs::write(&program, "G2 X20 I10 F600\n").unwrap();
    let (address, switch) = machine_on_an_arc();
    let program = program.to_str().unwrap();
    let mut monitor = Monitor::start(&["--tcp", &address, "--program", program]);
    let mut points: Vec<[f64; 3]> = Vec::new();
    let mut last = Value::Null;
    for event in events(&monitor.address()) {
        let _ = switch.send(());
        let path = event["path"].clone();
        points.extend(serde_json::from_value::<Vec<[f64; 3]>>(path).unwrap());
        last = event["now"].clone();
        if last["job"]["left_s"] == 0.0 {
            break;
        }
    }
    assert!(points.len() > 30, "{}", points.len());
    for two in points.windows(2) {
        let [x, y] = [0, 1].map(|axis| f64::midpoint(two[0][axis], two[1][axis]));
        let off_mm = ((x - 10.0).hypot(y) - 10.0).abs();
        assert!(off_mm < 0.02, "{two:?}");
    }
    assert_eq!(points.last(), Some(&[20.0, 0.0, 0.0]));
    // What else a machine reports and says is shown, too.
    assert_eq!(last["words"], "Idle");
    assert_eq!(last["messages"][0], "half\u{241b}[2Jway");
    let values = last["values"].to_string();
    for value in [
        r#"["Feed","600 mm/min, set 600"]"#,
        r#"["Overrides","feed 80 %, rapids 100 %, spindle 100 %"]"#,
        r#"["On","spindle clockwise"]"#,
        r#"["Inputs","probe"]"#,
        r#"["Work system","G54"]"#,
        r#"["Tool","T3"]"#,
    ] {
        assert!(values.contains(value), "{value}: {values}");
    }
    monitor.interrupt();
    monitor.end();
}

#[test]
fn any_machine_is_shown_by_its_reports_until_it_goes() {
    let (address, switch) = machine(REPORT);
    let mut monitor = Monitor::start(&["--tcp", &address]);
    let page = monitor.address();
    let mut events = events(&page);
    let first = events.next().unwrap();
    drop(switch);
    let last = events.last().unwrap_or(first);
    assert_eq!(
        last["now"]["machine_mm"],
        serde_json::json!([1.0, 2.0, 0.0])
    );
    assert_eq!(last["unit"], "mm");
    let (status, printed) = monitor.end();
    assert_eq!(status, Some(1));
    assert!(
        printed.contains(&format!("{address} has gone")),
        "{printed}"
    );
}

#[test]
fn what_is_no_grbl_is_reported() {
    let busy = b"[MSG:In use by process 7 (bCNC)]\r\n";
    for (answer, printed) in [
        (&b""[..], "has not answered as Grbl does"),
        (b"T:20.0 /0.0\n", "has not answered as Grbl does"),
        (busy, "is in use by process 7 (bCNC)"),
    ] {
        let (address, _switch) = machine(answer);
        let (status, received) = Monitor::start(&["--tcp", &address]).end();
        assert_eq!(status, Some(1));
        assert!(received.contains(printed), "{received}");
    }
}

#[test]
fn a_port_has_one_monitor_and_may_be_unplugged() {
    let folder = tempdir().unwrap();
    let path = folder.path().join("tty");
    let (pty, link) = Pty::at(&path).unwrap();
    let path = path.to_str().unwrap();
    let mut first = Monitor::start(&["--port", path]);
    // The machine answers until the first monitor shows it.
    let (ready, is_ready) = channel();
    let board = thread::spawn(move || {
        let mut bytes = [0; 64];
        while is_ready.try_recv().is_err() {
            let length = rustix::io::read(pty.controller(), &mut bytes).unwrap_or(0);
            for byte in &bytes[..length] {
                let answer = match byte {
                    b'?' => REPORT,
                    b'\n' => b"ok\r\n",
                    _ => b"",
                };
                let _ = rustix::io::write(pty.controller(), answer);
            }
            thread::yield_now();
        }
    });
    first.address();
    let (status, printed) = Monitor::start(&["--port", path]).end();
    assert_eq!(status, Some(1));
    assert!(printed.contains("is open in another program"), "{printed}");
    ready.send(()).unwrap();
    board.join().unwrap();
    let (status, printed) = first.end();
    assert_eq!(status, Some(1));
    assert!(printed.contains(&format!("{path} has gone")), "{printed}");
    drop(link);
}

#[test]
fn what_cannot_be_had_is_reported_at_once() {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let taken = listener.local_addr().unwrap().to_string();
    let (address, _switch) = machine(REPORT);
    let (status, printed) = Monitor::start(&["--tcp", &address, "--listen", &taken]).end();
    assert_eq!(status, Some(1));
    assert!(printed.contains("cannot serve the page"), "{printed}");
    for (arguments, what) in [
        (
            ["--port", "/dev/no-such-port"],
            "there is no /dev/no-such-port",
        ),
        (["--tcp", "nowhere"], "is no address"),
        (["--sim", "no-such.nc"], "no-such.nc"),
        (["--sim", "--program=no-such.nc"], "no-such.nc"),
        (["--sim", "--svg=/no/out.svg"], "cannot create /no/out.svg"),
        (["--sim", "--set=$110=x"], "is no number"),
    ] {
        let (status, printed) = Monitor::start(&arguments).end();
        assert_eq!(status, Some(1));
        assert!(
            printed.contains(what) && printed.matches("error: ").count() == 1,
            "{printed}"
        );
    }
}
