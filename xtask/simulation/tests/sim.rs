//! `cargo xtask sim` as a process: its files, its signals, and who is connected with it.

use std::{
    fs,
    io::{BufRead as _, BufReader, Lines, Read as _, Write as _},
    net::TcpStream,
    path::Path,
    process::{Child, ChildStderr, Command, Output, Stdio},
};

use rustix::process::{Pid, Signal, kill_process};

fn sim(folder: &Path, arguments: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_sim"));
    command.arg("sim").args(arguments).current_dir(folder);
    command
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped());
    command
}

/// Runs it with something at its standard input.
fn done(folder: &Path, arguments: &[&str], input: &str) -> Output {
    let mut child = sim(folder, arguments).spawn().unwrap();
    // What fails before it reads closes the pipe.
    let _ = child.stdin.take().unwrap().write_all(input.as_bytes());
    child.wait_with_output().unwrap()
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

fn interrupt(child: &Child) {
    kill_process(Pid::from_child(child), Signal::INT).unwrap();
}

fn names(folder: &Path) -> Vec<String> {
    let files = fs::read_dir(folder).unwrap();
    let mut names: Vec<_> = files
        .map(|file| file.unwrap().file_name().to_string_lossy().into_owned())
        .collect();
    names.sort();
    names
}

/// A server, ended by Ctrl-C.
struct Server {
    child: Child,
    messages: Lines<BufReader<ChildStderr>>,
}

impl Server {
    fn start(folder: &Path, arguments: &[&str]) -> (Self, String) {
        let mut child = sim(folder, arguments).spawn().unwrap();
        let messages = BufReader::new(child.stderr.take().unwrap()).lines();
        let mut server = Self { child, messages };
        let line = server.expect_line("Serving");
        (server, line)
    }

    /// The rest of the next line that begins with a word.
    fn expect_line(&mut self, word: &str) -> String {
        let line = self
            .messages
            .find(|line| line.as_ref().unwrap().contains(word));
        let line = line.unwrap().unwrap();
        line.split_once(word).unwrap().1.trim().to_owned()
    }

    fn tcp(folder: &Path, arguments: &[&str]) -> (Self, String) {
        let arguments = [&["--tcp", "127.0.0.1:0"], arguments].concat();
        let (server, line) = Self::start(folder, &arguments);
        let address = line.split_whitespace().next().unwrap();
        (server, address.trim_start_matches("tcp://").to_owned())
    }

    fn stop(mut self) {
        interrupt(&self.child);
        assert!(self.child.wait().unwrap().success());
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        let _ = self.child.kill();
    }
}

/// Sends lines, and reads until each has its answer.
fn talk(stream: &TcpStream, lines: &str) {
    let mut writer = stream;
    writer.write_all(lines.as_bytes()).unwrap();
    let answers = BufReader::new(stream).lines();
    let answers = answers.filter(|line| line.as_ref().unwrap() == "ok");
    let wanted = lines.lines().count();
    assert_eq!(answers.take(wanted).count(), wanted);
}

#[test]
fn a_program_comes_from_standard_input_too() {
    let folder = tempfile::tempdir().unwrap();
    let run = done(
        folder.path(),
        &["-", "--plot", "out.svg"],
        "G1 X1 F600\nX0\n",
    );
    assert!(run.status.success(), "{}", text(&run.stderr));
    assert!(text(&run.stdout).contains("X 0.000 mm"));
    let picture = fs::read_to_string(folder.path().join("out.svg")).unwrap();
    assert!(picture.contains("standard input"));
}

#[test]
fn a_program_with_numbers_and_checksums_of_its_own_is_sent_as_it_is() {
    let folder = tempfile::tempdir().unwrap();
    let run = |program: &str| done(folder.path(), &["-", "--reprap"], program);
    let right = "%\nG21\n(2*3)\nN0 M110 N2*127\n; a comment\n(one more)\n\nN3 G1 X2 F3000*4\nN4 G1 X0*100\n";
    let output = run(right);
    assert!(output.status.success(), "{}", text(&output.stderr));
    assert!(
        text(&output.stdout).contains("lines  9"),
        "{}",
        text(&output.stdout)
    );
    // From the middle of a program on, and with a wrong checksum: the machine asks for lines again.
    for (program, error) in [
        ("N3 G1 X2 F3000*4\nN4 G1 X0*100\n", "error:201"),
        ("N0 M110 N2*127\nN3 G1 X9 F3000*4\n", "error:200"),
    ] {
        let output = run(program);
        let lines = text(&output.stdout) + &text(&output.stderr);
        assert!(!output.status.success() && lines.contains(error), "{lines}");
    }
}

#[test]
fn text_is_sent_as_it_is_and_a_file_that_is_not_utf_8_is_reported() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("job.nc");
    for (comment, is_reported) in [
        ("(Änderung: 粗加工)".as_bytes(), false),
        (b"(\xc4nderung \x84)", true),
    ] {
        fs::write(&file, [b"G21\n", comment, b"\nG1 X1 F600\n"].concat()).unwrap();
        let run = done(folder.path(), &["job.nc"], "");
        assert!(run.status.success(), "{}", text(&run.stderr));
        assert!(
            text(&run.stdout).contains("X 1.000 mm"),
            "{}",
            text(&run.stdout)
        );
        let is_there = text(&run.stderr).contains("line 2 is not UTF-8");
        assert_eq!(is_there, is_reported, "{}", text(&run.stderr));
    }
    fs::write(&file, "G1 X1\u{2013}5 F600\n").unwrap();
    let run = done(folder.path(), &["job.nc"], "");
    assert!(
        text(&run.stdout).contains("error:"),
        "{}",
        text(&run.stdout)
    );
}

#[test]
fn the_version_is_that_of_the_workspace() {
    let folder = tempfile::tempdir().unwrap();
    let run = done(folder.path(), &["--version"], "");
    assert_eq!(
        text(&run.stdout).trim(),
        concat!("xtask-sim ", env!("CARGO_PKG_VERSION"))
    );
}

#[test]
fn what_cannot_be_read_or_written_is_reported_before_anything_runs() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("part.nc"), "G1 X1 F600\n").unwrap();
    for (arguments, part) in [
        (
            &["no.nc", "--json", "a.json"][..],
            "cannot open the program no.nc",
        ),
        (
            &["part.nc", "--settings", "no.txt", "--json", "a.json"],
            "cannot read the settings no.txt",
        ),
        (
            &["part.nc", "--json", "a.json", "--plot", "no/a.svg"],
            "cannot create no/a.svg",
        ),
        (
            &["part.nc", "--json", "a.json", "--trace", "."],
            "cannot create .",
        ),
        (
            &["part.nc", "--flash", "part.nc", "--json", "a.json"],
            "cannot use part.nc as a flash",
        ),
    ] {
        let run = done(folder.path(), arguments, "");
        assert!(!run.status.success());
        assert!(text(&run.stderr).contains(part), "{}", text(&run.stderr));
        assert_eq!(text(&run.stdout), "", "{arguments:?}");
        assert_eq!(names(folder.path()), ["part.nc"], "{arguments:?}");
    }
}

#[test]
fn tools_come_from_a_table_and_stay_in_the_flash() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(
        folder.path().join("mm.tbl"),
        "T3 P1 Z+10.16 D3.048 ;drill\n",
    )
    .unwrap();
    let keeps = ["--flash", "flash.bin"];
    for (arguments, input, part) in [
        (
            &["--tool-table", "mm.tbl"][..],
            "G43 H3 Z0\n",
            "Z 10.160 mm",
        ),
        (&[], "G43 H3 Z0\n", "Z 0.000 mm"),
        (&[&["--tool-table", "mm.tbl"], &keeps[..]].concat(), "", ""),
        (&keeps, "G43 H3 Z0\n", "Z 10.160 mm"),
    ] {
        let run = done(folder.path(), &[&["-"], arguments].concat(), input);
        assert!(run.status.success(), "{}", text(&run.stderr));
        assert!(
            text(&run.stdout).contains(part),
            "{arguments:?}: {}",
            text(&run.stdout)
        );
    }
    fs::write(folder.path().join("mm.tbl"), "T3 Z1\nT4 Z9000\n").unwrap();
    let run = done(folder.path(), &["-", "--tool-table", "mm.tbl"], "");
    let messages = text(&run.stderr);
    assert!(
        messages.contains("line 2 of the tool table, $TT4=T4 Z9000: the target"),
        "{messages}"
    );
}

#[test]
fn an_interrupted_run_leaves_no_half_file() {
    let folder = tempfile::tempdir().unwrap();
    let arguments = ["-", "--trace", "a.csv", "--json", "a.json"];
    let mut child = sim(folder.path(), &arguments).spawn().unwrap();
    // It waits for more of the program: its files have been begun.
    let mut input = child.stdin.take().unwrap();
    input.write_all(b"G1 X1 F600\n").unwrap();
    while names(folder.path()).len() < 2 {
        std::thread::yield_now();
    }
    // What has a name beside that of a file is none that looks whole.
    let is_partial = |name: &String| name.starts_with('.') && name.ends_with(".partial");
    assert!(names(folder.path()).iter().all(is_partial));
    interrupt(&child);
    assert!(!child.wait().unwrap().success());
    assert_eq!(names(folder.path()), Vec::<String>::new());
    drop(input);
}

#[test]
fn a_server_writes_its_files_when_it_ends() {
    let folder = tempfile::tempdir().unwrap();
    let files = ["--trace", "a.csv", "--plot", "a.svg", "--json", "a.json"];
    let (server, address) = Server::tcp(folder.path(), &files);
    talk(
        &TcpStream::connect(&address).unwrap(),
        "G1 X0.1 F600\nG4 P0.001\n",
    );
    server.stop();
    assert_eq!(names(folder.path()), ["a.csv", "a.json", "a.svg"]);
    let read = |name: &str| fs::read_to_string(folder.path().join(name)).unwrap();
    assert_eq!(read("a.csv").lines().count(), 1 + 25);
    assert!(read("a.json").contains(r#""lines":2,"responses":[[1,"ok"],[2,"ok"]]"#));
    assert!(read("a.svg").contains(&format!("tcp://{address}")));
}

#[test]
fn a_request_of_a_browser_is_no_program() {
    let folder = tempfile::tempdir().unwrap();
    let (mut server, address) = Server::tcp(folder.path(), &[]);
    let mut browser = TcpStream::connect(&address).unwrap();
    let request = "POST / HTTP/1.1\r\nHost: localhost\r\n\r\nG0X7\n";
    browser.write_all(request.as_bytes()).unwrap();
    let refused = server.expect_line("Refused");
    assert!(refused.ends_with("a browser is no sender"), "{refused}");
    let mut sender = TcpStream::connect(&address).unwrap();
    talk(&sender, "G4P0\n");
    sender.write_all(b"?").unwrap();
    let mut report = String::new();
    BufReader::new(sender).read_line(&mut report).unwrap();
    assert!(report.starts_with("<Idle|MPos:0.000,"), "{report}");
}

#[test]
fn a_second_sender_is_refused_with_who_is_connected() {
    let folder = tempfile::tempdir().unwrap();
    let (mut server, address) = Server::tcp(folder.path(), &[]);
    let first = TcpStream::connect(&address).unwrap();
    talk(&first, "G0\n");
    let holder = first.local_addr().unwrap().to_string();
    let mut second = TcpStream::connect(&address).unwrap();
    let mut messages = String::new();
    second.read_to_string(&mut messages).unwrap();
    let begin = format!("[MSG:In use by {holder}");
    let text_after = messages
        .strip_prefix(&begin)
        .and_then(|text_after| text_after.strip_suffix("]\r\n"))
        .unwrap();
    // Elsewhere than on Linux nobody tells which process that is.
    let process = format!(", process {} (", std::process::id());
    assert!(
        text_after.is_empty() || text_after.starts_with(&process),
        "{messages}"
    );
    let refused = server.expect_line("Refused");
    assert!(
        refused.ends_with(&format!("{holder}{text_after} is connected")),
        "{refused}"
    );
    let another = done(folder.path(), &["--tcp", &address], "");
    assert!(text(&another.stderr).contains("cannot listen at"));
    let process = format!("process {}", server.child.id());
    assert!(text_after.is_empty() || text(&another.stderr).contains(&process));
    talk(&first, "G0\n");
    drop(first);
    server.expect_line("Left");
    talk(&TcpStream::connect(&address).unwrap(), "G0\n");
    server.stop();
}

#[test]
fn a_usb_device_is_served_with_how_to_attach_it_and_alone() {
    let folder = tempfile::tempdir().unwrap();
    let (mut server, line) = Server::start(folder.path(), &["--usbip", "127.0.0.1:0"]);
    let address = line.split_whitespace().next().unwrap();
    let address = address.strip_prefix("usbip://").unwrap();
    let (_, port) = address.split_once(':').unwrap();
    assert_eq!(
        server.expect_line("Attach by"),
        format!("sudo usbip --tcp-port {port} attach -r 127.0.0.1 -b 1-1")
    );
    for (arguments, part) in [
        (&["--usbip", address][..], "cannot listen at"),
        (&["--usbip", "nowhere"], "an address is 127.0.0.1:3240"),
        (
            &["--usbip", address, "--tcp", "127.0.0.1:0"],
            "cannot be used with",
        ),
        (&["--usbip", address, "--pty", "tty"], "cannot be used with"),
        (&["--usbip", address, "-"], "cannot be used with"),
    ] {
        let run = done(folder.path(), arguments, "");
        assert!(!run.status.success());
        assert!(text(&run.stderr).contains(part), "{}", text(&run.stderr));
    }
    server.stop();
    assert_eq!(names(folder.path()), [""; 0]);
}

/// Where X is, mm, as a report tells.
#[cfg(target_os = "linux")]
fn x_mm(mut stream: &fs::File) -> String {
    stream.write_all(b"?").unwrap();
    let mut lines = BufReader::new(stream).lines();
    let report = lines.find(|line| line.as_ref().unwrap().starts_with('<'));
    let report = report.unwrap().unwrap();
    let (_, place) = report.split_once("MPos:").unwrap();
    place.split(',').next().unwrap().to_owned()
}

/// Sends lines, and reads until all are answered. What answers a line that nobody has ended may come before.
#[cfg(target_os = "linux")]
fn ask(mut stream: &fs::File, lines: &str) -> Vec<String> {
    stream.write_all(lines.as_bytes()).unwrap();
    let all = BufReader::new(stream).lines().map(Result::unwrap);
    let is_answer = |line: &String| line == "ok" || line.starts_with("error:");
    let answers = all.filter(|line| is_answer(line) && line != "error:210");
    answers.take(lines.lines().count()).collect()
}

#[cfg(target_os = "linux")]
#[test]
fn a_line_that_a_sender_has_not_ended_is_not_the_beginning_of_the_next_ones() {
    use std::os::fd::OwnedFd;

    let folder = tempfile::tempdir().unwrap();
    let (tcp, address) = Server::tcp(folder.path(), &[]);
    let (pty, _) = Server::start(folder.path(), &["--pty", "tty"]);
    let link = folder.path().join("tty");
    let connect: [&dyn Fn() -> fs::File; 2] = [
        &|| OwnedFd::from(TcpStream::connect(&address).unwrap()).into(),
        &|| {
            fs::File::options()
                .read(true)
                .write(true)
                .open(&link)
                .unwrap()
        },
    ];
    for (mut server, connect) in [tcp, pty].into_iter().zip(connect) {
        let mut first = connect();
        assert_eq!(ask(&first, "G1 X1 F500\nG4 P0.01\n"), ["ok"; 2]);
        first.write_all(b"G1 X5?").unwrap();
        drop(first);
        server.expect_line("Left");
        let second = connect();
        let answers = ask(&second, "0 F3000\nG4 P0.01\n");
        assert_eq!(answers, ["error:1", "ok"]);
        assert_eq!(x_mm(&second), "1.000");
        server.stop();
    }
}

#[cfg(target_os = "linux")]
#[test]
fn a_second_sender_at_a_link_is_refused_with_who_is_connected() {
    let folder = tempfile::tempdir().unwrap();
    let (mut server, _) = Server::start(folder.path(), &["--pty", "tty"]);
    let link = folder.path().join("tty");
    let open = || {
        fs::File::options()
            .read(true)
            .write(true)
            .open(&link)
            .unwrap()
    };
    let answered = |file: &fs::File| {
        let mut writer = file;
        writer.write_all(b"G0\n").unwrap();
        let mut lines = BufReader::new(file).lines();
        lines.any(|line| line.unwrap() == "ok")
    };
    for _ in 0..2 {
        let terminal = fs::read_link(&link).unwrap();
        let first = open();
        assert!(answered(&first));
        // From now on the link leads to another terminal.
        while fs::read_link(&link).unwrap() == terminal {
            std::thread::yield_now();
        }
        let second = open();
        let mut messages = String::new();
        BufReader::new(&second).read_line(&mut messages).unwrap();
        let holder = format!("[MSG:In use by process {} (", std::process::id());
        assert!(messages.starts_with(&holder), "{messages}");
        assert!(server.expect_line("Refused").ends_with("is connected"));
        drop(second);
        assert!(answered(&first));
        drop(first);
        server.expect_line("Left");
    }
    server.stop();
    assert_eq!(names(folder.path()), Vec::<String>::new());
}

#[test]
fn a_second_server_on_a_link_or_a_flash_is_refused_with_who_has_it() {
    let folder = tempfile::tempdir().unwrap();
    let (server, _) = Server::start(folder.path(), &["--pty", "tty", "--flash", "chip"]);
    let process = server.child.id();
    for (arguments, what) in [
        (["--pty", "tty", "--trace", "a.csv"], "tty"),
        (["-", "--flash", "chip", "--switches"], "chip"),
    ] {
        let run = done(folder.path(), &arguments, "");
        let messages = text(&run.stderr);
        assert!(
            messages.contains(&format!("process {process}")),
            "{messages}"
        );
        assert!(messages.contains(&format!(" has {what}")), "{messages}");
    }
    server.stop();
    assert_eq!(names(folder.path()), ["chip"]);
}

#[test]
fn an_idle_server_sleeps() {
    let folder = tempfile::tempdir().unwrap();
    let (server, address) = Server::tcp(folder.path(), &[]);
    let stream = TcpStream::connect(&address).unwrap();
    talk(&stream, "G0\n");
    let status = format!("/proc/{}/status", server.child.id());
    let switches = || -> Option<u64> {
        let status = fs::read_to_string(&status).ok()?;
        let line = status
            .lines()
            .find(|line| line.starts_with("voluntary_ctxt"))?;
        line.split_whitespace().last()?.parse().ok()
    };
    // Elsewhere than on Linux nobody counts.
    if let Some(before) = switches() {
        std::thread::sleep(std::time::Duration::from_millis(300));
        let after = switches().unwrap();
        assert!(after - before < 20, "{before} {after}");
    }
    server.stop();
}

#[test]
fn an_alarm_and_a_refused_line_are_printed_with_the_reason_and_what_to_do() {
    let folder = tempfile::tempdir().unwrap();
    let limits = ["-", "--set", "$22=1", "--set", "$20=1"];
    let program = "G1 X-1 F600\nX-2\nX250\nX-3\nX-4\nX-5\n";
    let run = done(folder.path(), &limits, program);
    let output = text(&run.stdout);
    assert!(!run.status.success(), "{output}");
    let alarm = "3:  X250  ALARM:2 the target is outside the machine's travel \
        (X 250.000 in machine coordinates is not within -200.000 to 0.000): reset, home or unlock";
    assert!(output.contains(alarm), "{output}");
    assert!(!text(&run.stderr).contains("ALARM"), "it is said once");
    let run = done(folder.path(), &["-"], "G0 X1\nG1 X2\n");
    let output = text(&run.stdout);
    let refusal = "2:  G1 X2  error:22 the feed rate is not set: give F";
    assert!(output.contains(refusal), "{output}");
}
