//! The command as it is typed, at the simulator behind a TCP port and a serial device.

use std::{
    fs,
    io::{BufRead as _, BufReader, Read as _, Write as _},
    net::{TcpListener, TcpStream},
    path::Path,
    process::{Child, Command, Stdio},
    thread,
    time::{Duration, Instant},
};

use common::tools;
use rustix::{
    fs::FlockOperation,
    process::{Pid, Signal},
};
use tempfile::{TempDir, tempdir};

/// Writes a file and returns its path.
fn file(folder: &TempDir, name: &str, text: &str) -> String {
    let path = path(folder, name);
    fs::write(&path, text).unwrap();
    path
}

fn path(folder: &TempDir, name: &str) -> String {
    folder.path().join(name).to_str().unwrap().into()
}

/// The simulator in real time.
struct Simulator {
    process: Child,
    /// `tcp://127.0.0.1:2323`, or the device.
    place: String,
}

impl Simulator {
    fn start(arguments: &[&str]) -> Self {
        let mut process = tools::command(tools::SIM)
            .unwrap()
            .args(arguments)
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        let mut log = BufReader::new(process.stderr.take().unwrap());
        let mut line = String::new();
        while !line.contains("Serving") {
            line.clear();
            let length = log.read_line(&mut line).unwrap();
            assert!(length > 0, "the simulator has ended");
        }
        // It goes on writing, and nobody may be missing then.
        thread::spawn(move || log.read_to_end(&mut Vec::new()));
        let place = line.split_whitespace().nth(1).unwrap().into();
        Self { process, place }
    }

    /// At a free TCP port; also gives its address.
    fn tcp(arguments: &[&str]) -> (Self, String) {
        let simulator = Self::start(&[&["--tcp", "127.0.0.1:0"], arguments].concat());
        let address = simulator.place.strip_prefix("tcp://").unwrap().into();
        (simulator, address)
    }
}

impl Drop for Simulator {
    fn drop(&mut self) {
        // As Ctrl-C would: it takes its link away.
        if let Some(id) = Pid::from_raw(self.process.id().cast_signed()) {
            let _ = rustix::process::kill_process(id, Signal::TERM);
        }
        let _ = self.process.wait();
    }
}

/// Whether a command succeeds, its output, and its messages.
fn settings(arguments: &[&str]) -> (bool, String, String) {
    let has_timeout = arguments.contains(&"--timeout");
    let patient: &[&str] = if has_timeout {
        &[]
    } else {
        &["--timeout", "60"]
    };
    let output = Command::new(env!("CARGO_BIN_EXE_settings"))
        .arg("settings")
        .args(arguments)
        .args(patient)
        .output()
        .unwrap();
    let text = |bytes| String::from_utf8(bytes).unwrap();
    let is_success = output.status.success();
    (is_success, text(output.stdout), text(output.stderr))
}

/// A command that succeeds: what it prints.
fn done(arguments: &[&str]) -> String {
    let (is_success, printed, log) = settings(arguments);
    assert!(is_success, "{log}");
    printed
}

/// A command that fails: what it says.
fn failed(arguments: &[&str]) -> String {
    let (is_success, _, log) = settings(arguments);
    assert!(!is_success, "{log}");
    log
}

const CHANGED: &str =
    "Grbl 1.1h ['$' for help]\n$20=1\n$22=1\n$110=20000.000\n$100=250\n$0=3\n$14=7\nok\n";

#[test]
fn settings_are_loaded_in_an_order_that_works_and_compared_and_saved() {
    let folder = tempdir().unwrap();
    let (_simulator, address) = Simulator::tcp(&[]);
    let at = ["--tcp", &address];
    let file = file(&folder, "mill.txt", CHANGED);

    let (is_equal, printed, log) = settings(&[&at[..], &["--diff", &file]].concat());
    assert!(!is_equal && log.contains("left out 1 setting"), "{log}");
    let rows: Vec<_> = printed.lines().collect();
    assert_eq!(rows.len(), 5, "{printed}");
    let words = |text: &str| text.split_whitespace().collect::<Vec<_>>().join(" ");
    assert_eq!(words(rows[4]), "$110 largest speed of X 20000.000 500.000");

    let printed = done(&[&at[..], &["--load", &file]].concat());
    let numbers: Vec<_> = printed
        .lines()
        .skip(1)
        .map(|row| row.split_once("  ").unwrap().0)
        .collect();
    assert_eq!(numbers.len(), 4, "{printed}");
    assert!(
        words(&printed).contains("largest speed of X 500.000 20000.000"),
        "{printed}"
    );

    let saved = path(&folder, "saved.txt");
    done(&[&at[..], &["--save", &saved]].concat());
    let text = fs::read_to_string(&saved).unwrap();
    assert!(
        text.starts_with("$0=3\n") && text.contains("\n$800=0.000\n"),
        "{text}"
    );
    assert!(!Path::new(&path(&folder, "saved.txt.new")).exists());
    for file in [&file, &saved] {
        assert_eq!(done(&[&at[..], &["--diff", file]].concat()), "");
        let (_, _, log) = settings(&[&at[..], &["--load", file]].concat());
        assert!(log.contains("Equal"), "{log}");
    }
}

#[test]
fn a_file_that_is_refused_changes_nothing() {
    let folder = tempdir().unwrap();
    let (_simulator, address) = Simulator::tcp(&[]);
    let file = file(
        &folder,
        "wrong.txt",
        "$1=255\n$20=1\n$110=20000\n$111=6,5\n",
    );
    let log = failed(&["--tcp", &address, "--load", &file]);
    for part in [
        "3 lines are refused",
        "line 2: $20=1: ",
        "line 3: $110=20000: 83 333",
        "line 4: ",
    ] {
        assert!(log.contains(part), "{log}");
    }
    let saved = path(&folder, "saved.txt");
    done(&["--tcp", &address, "--save", &saved]);
    assert!(fs::read_to_string(&saved).unwrap().contains("\n$1=25\n"));
    // And a file that cannot be written is an error, with what was there as it was.
    let log = failed(&["--tcp", &address, "--save", &path(&folder, "no/saved.txt")]);
    assert!(log.contains("cannot write"), "{log}");
}

#[test]
fn a_serial_device_works_as_a_tcp_port_does() {
    let folder = tempdir().unwrap();
    let device = path(&folder, "tty");
    let _simulator = Simulator::start(&["--pty", &device, "--set", "$130=321"]);
    let file = file(&folder, "mill.txt", "$130=123\n");
    done(&["--port", &device, "--load", &file]);
    assert_eq!(done(&["--port", &device, "--diff", &file]), "");

    // At the link, each program gets a terminal of its own.
    let terminal = fs::read_link(&device).unwrap().display().to_string();
    let other = fs::File::open(&terminal).unwrap();
    rustix::fs::flock(&other, FlockOperation::LockExclusive).unwrap();
    while cfg!(target_os = "linux")
        && fs::read_link(&device).unwrap().display().to_string() == terminal
    {
        thread::yield_now();
    }
    let log = failed(&["--port", &terminal, "--diff", &file]);
    assert!(log.contains("is open in another program"), "{log}");
    if cfg!(target_os = "linux") {
        let log = failed(&["--port", &device, "--diff", &file]);
        assert!(log.contains("is in use by process"), "{log}");
    }
    drop(other);
    // A process that another test starts may hold the terminal a little longer.
    let (is_equal, printed, log) = loop {
        let outcome = settings(&["--port", &device, "--diff", &file]);
        if !outcome.2.contains("is in use by process") {
            break outcome;
        }
    };
    assert!(is_equal && printed.is_empty(), "{printed}{log}");

    let log = failed(&["--port", &path(&folder, "none"), "--diff", &file]);
    assert!(
        log.contains("there is no ") && log.contains("serial port"),
        "{log}"
    );
}

#[test]
fn who_does_not_answer_is_reported() {
    let folder = tempdir().unwrap();
    let file = file(&folder, "mill.txt", "$130=123\n");
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = listener.local_addr().unwrap().to_string();
    let log = failed(&["--tcp", &address, "--timeout", "0.3", "--diff", &file]);
    assert!(log.contains("has not answered for 0.3 s"), "{log}");
    drop(listener);
    // A process that another test starts may listen a little longer.
    while TcpStream::connect(&address).is_ok() {
        thread::yield_now();
    }
    let log = failed(&["--tcp", &address, "--diff", &file]);
    assert!(log.contains("no machine listens at"), "{log}");
}

/// Talks to a machine until it says something.
fn until(stream: &mut TcpStream, send: &str, received: &str) {
    let start = Instant::now();
    let mut all = String::new();
    stream
        .set_read_timeout(Some(Duration::from_millis(50)))
        .unwrap();
    stream.write_all(send.as_bytes()).unwrap();
    while !all.contains(received) {
        assert!(start.elapsed() < Duration::from_mins(1), "{all}");
        let mut chunk = [0; 256];
        if let Ok(length) = stream.read(&mut chunk) {
            all += &String::from_utf8_lossy(&chunk[..length]);
        }
    }
}

#[test]
fn a_machine_in_alarm_or_in_motion_is_reported() {
    let folder = tempdir().unwrap();
    let file = file(&folder, "mill.txt", "$130=123\n");
    let fast = [
        "--switches",
        "--set",
        "$21=1",
        "--set",
        "$110=12000",
        "--set",
        "$120=5000",
    ];
    let (_simulator, address) = Simulator::tcp(&fast);
    let command = ["--tcp", &address, "--timeout", "30", "--load", &file];
    {
        let mut sender = TcpStream::connect(&address).unwrap();
        until(&mut sender, "G1 X-60 F60\n", "ok");
    }
    let log = failed(&command);
    assert!(log.contains("in the state Run"), "{log}");
    {
        let mut sender = TcpStream::connect(&address).unwrap();
        until(&mut sender, "\x18", "$X");
        until(&mut sender, "$X\nG0 X500\n", "ALARM:1");
    }
    let log = failed(&command);
    assert!(
        log.contains("in alarm and takes no lines before it is reset"),
        "{log}"
    );
    {
        // Still in alarm, but it reads lines again: settings may be changed.
        let mut sender = TcpStream::connect(&address).unwrap();
        until(&mut sender, "\x18", "$X");
    }
    assert!(done(&command).contains("123.000"));
}

/// A machine that reports a state, and answers lines; without an answer it ends the connection.
fn other_machine(state: &'static str, answer: fn(&str) -> Option<&'static str>) -> String {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = listener.local_addr().unwrap().to_string();
    thread::spawn(move || {
        for stream in listener.incoming() {
            let mut stream = stream.unwrap();
            let mut line = String::new();
            let mut byte = [0];
            while let Ok(1) = stream.read(&mut byte) {
                let answer = match byte[0] {
                    b'?' => Some(state),
                    b'\n' => answer(&std::mem::take(&mut line)),
                    byte => {
                        line.push(char::from(byte));
                        continue;
                    }
                };
                let Some(answer) = answer else {
                    break;
                };
                stream.write_all(answer.as_bytes()).unwrap();
            }
        }
    });
    address
}

const IDLE: &str = "<Idle|MPos:0.000,0.000,0.000|FS:0,0>\r\n";

/// Lines of Grbl 1.1, which has no `$+` and does not tell a step rate.
fn grbl(line: &str) -> &'static str {
    match line {
        "$$" => "$0=10\r\n$1=25\r\n$20=0\r\n$22=0\r\nok\r\n",
        "$I" => "[VER:1.1h.20190830:]\r\n[OPT:V,15,128]\r\nok\r\n",
        "$0=2" => "error:6\r\n",
        "$1=50" => "ok\r\n",
        _ => "error:3\r\n",
    }
}

#[test]
fn what_another_machine_refuses_or_forgets_is_reported() {
    let folder = tempdir().unwrap();
    let address = other_machine(IDLE, |line| Some(grbl(line)));
    let file = file(&folder, "mill.txt", "$0=2\n$1=50\n$41=1\n");
    let log = failed(&["--tcp", &address, "--load", &file]);
    for part in [
        "the machine does not have $41",
        "2 of 2 settings are not loaded",
        "$0=2: error:6",
        "$1=50 was accepted, and the machine shows 25",
    ] {
        assert!(log.contains(part), "{log}");
    }
    let saved = path(&folder, "saved.txt");
    done(&["--tcp", &address, "--save", &saved]);
    let text = fs::read_to_string(&saved).unwrap();
    assert_eq!(text, "$0=10\n$1=25\n$20=0\n$22=0\n");
}

#[test]
fn a_conversation_that_breaks_off_is_reported_and_no_file_is_written() {
    const HELD: &str = "<Hold:0|MPos:0.000,0.000,0.000|FS:0,0>\r\n";
    let folder = tempdir().unwrap();
    let saved = path(&folder, "saved.txt");
    let noise = "x".repeat(5000).leak();
    for (address, expected) in [
        (other_machine(noise, |_| None), "sends what is no text"),
        (other_machine(IDLE, |_| None), "the connection has ended"),
        (
            other_machine(IDLE, |_| Some("Grbl 1.1h ['$' for help]\r\n")),
            "has been reset",
        ),
        (
            other_machine(IDLE, |_| Some("")),
            "has not answered $+ for 0.4 s",
        ),
        (
            other_machine(IDLE, |_| Some("ok\r\n")),
            "has listed no settings",
        ),
        (other_machine(HELD, |_| Some("")), "it is in the state Hold"),
        (
            other_machine("noise", |_| Some("")),
            "has not answered for 0.4 s",
        ),
    ] {
        let timeout = if expected.contains("0.4 s") {
            "0.4"
        } else {
            "30"
        };
        let log = failed(&["--tcp", &address, "--timeout", timeout, "--save", &saved]);
        assert!(log.contains(expected), "{log}");
    }
    assert!(!Path::new(&saved).exists());
}
