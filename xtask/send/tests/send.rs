//! The command as it is typed, at the simulator behind a serial device and a TCP port.

mod support;

use std::{
    fs,
    time::{Duration, Instant},
};

use grbl_client::{Link, Machine};
use rustix::process::Signal;
use support::{Cable, Sending, Simulator, machined::MachinedPath, path};
use tempfile::{TempDir, tempdir};

/// Quick enough that no test lasts. What a key is to find in motion moves for many seconds: the machine has no other
/// time than this computer, whatever that does besides.
const SETTINGS: [&str; 9] = [
    "$100=80",
    "$101=80",
    "$102=80",
    "$110=5000",
    "$111=5000",
    "$112=5000",
    "$120=500",
    "$121=500",
    "$122=500",
];

/// Two tools, two depths, and a round corner.
const JOB: &str = "\
G21 G90 G54
G10 L2 P1 X1.2 Y2.4 Z-0.3
T1 M6
M3 S1000
G0 Z5
G0 X5 Y5
G1 Z-1 F600
G1 X30 F600
Y20
G2 X20 Y30 I-10 J0 (a quarter)
G1 X5
Y5
G0 Z5
T2 M6
M3 S1000
G0 X8 Y8
G1 Z-2 F600
X14 F600
Y12
X8
Y8
X14
Y12
X8
Y8
X14
Y12
X8
Y8
X14
Y12
X8
Y8
G0 Z5
M5
G0 X0 Y0
M2
";

/// How long a line may be another's.
const WAIT: Duration = Duration::from_secs(30);
/// The surface of the workpiece, in steps: the origin of the job's work coordinates.
const SURFACE: i32 = -24;

fn file(folder: &TempDir, name: &str, text: &str) -> String {
    let path = path(folder, name);
    fs::write(&path, text).unwrap();
    path
}

/// Where the steps have led, X Y Z.
fn trace(path: &str) -> Vec<[i32; 3]> {
    let text = fs::read_to_string(path).unwrap();
    let row = |line: &str| {
        let mut numbers = line
            .split(',')
            .skip(1)
            .map(|number| number.parse().unwrap());
        [(); 3].map(|()| numbers.next().unwrap())
    };
    text.lines().skip(1).map(row).collect()
}

/// Runs the job without a disturbance, and returns its steps.
fn undisturbed(folder: &TempDir) -> Vec<[i32; 3]> {
    let (job, steps) = (file(folder, "plain.nc", JOB), path(folder, "plain.csv"));
    let device = path(folder, "plain");
    let simulator = Simulator::start(&["--pty", &device, "--trace", &steps], &SETTINGS);
    let mut sending = Sending::start(&[&job, "--port", &device]);
    for tool in ["T1", "T2"] {
        // That it waits may be told a second time.
        sending.until(&format!("[MSG:Tool change: {tool}]"));
        sending.until("the machine waits");
        sending.press("r");
    }
    sending.succeeds();
    assert!(!fs::exists(format!("{job}.resume")).unwrap());
    drop(simulator);
    trace(&steps)
}

/// Has the job held, its tools changed, its cable pulled out, and continued: by the same command where that
/// `waits`, otherwise by another one.
fn disturb(waits: bool) {
    let folder = tempdir().unwrap();
    let expected = undisturbed(&folder);
    let (job, steps) = (file(&folder, "job.nc", JOB), path(&folder, "job.csv"));
    let (device, end) = (path(&folder, "tty"), path(&folder, "cable"));
    let simulator = Simulator::start(&["--pty", &device, "--trace", &steps], &SETTINGS);

    let mut arguments = vec![job.as_str(), "--port", &end, "--spin-up", "0.1"];
    arguments.extend(waits.then_some("--wait"));
    // A port that is not there yet is waited for, too.
    let early = waits.then(|| Sending::start(&arguments));
    let cable = Cable::plug_in(&device, &end);
    let mut sending = early.unwrap_or_else(|| Sending::start(&arguments));
    sending.until("[MSG:Tool change: T1]");
    sending.until("the machine waits");
    sending.press("r");
    sending.until("Run ");
    sending.press("h");
    sending.until("the machine is held");
    sending.press("+r");
    sending.until("[MSG:Tool change: T2]");
    sending.until("the machine waits");
    sending.press("r");
    sending.until("Run ");
    cable.unplug();
    let cable = if waits {
        Cable::plug_in(&device, &end)
    } else {
        let log = sending.fails();
        assert!(
            log.contains("--resume continues it") && log.contains("has gone"),
            "{log}"
        );
        arguments.push("--resume");
        // This one does not wait for its port.
        let cable = Cable::plug_in(&device, &end);
        sending = Sending::start(&arguments);
        cable
    };
    sending.until("modes     [GC:G");
    let tool = sending.until("tool ");
    assert!(tool.ends_with(" T2") || tool.ends_with(" T1"), "{tool}");
    sending.until("[y/n]");
    sending.press("y");
    if tool.ends_with(" T1") {
        sending.until("[MSG:Tool change: T2]");
        sending.until("the machine waits");
        sending.press("r");
    }
    let log = sending.succeeds();
    assert_eq!(waits, log.contains("has gone"), "{log}");
    cable.unplug();
    drop(simulator);

    let done = trace(&steps);
    assert_eq!(done.last(), expected.last());
    let (expected, done) = (
        MachinedPath::of(&expected, SURFACE),
        MachinedPath::of(&done, SURFACE),
    );
    assert!(expected.len() > 1000, "{}", expected.len());
    let missing = expected.beyond(&done);
    assert!(missing.is_empty(), "{missing:?} were not cut: {log}");
    let beyond = done.beyond(&expected);
    assert!(beyond.is_empty(), "{beyond:?} should not be cut: {log}");
}

#[test]
fn a_job_that_is_held_unplugged_and_resumed_has_the_steps_of_an_undisturbed_one() {
    disturb(false);
}

#[test]
fn a_job_that_waits_for_its_port_has_the_steps_of_an_undisturbed_one() {
    disturb(true);
}

#[test]
fn a_job_whose_record_cannot_be_written_does_not_begin_anew_when_its_port_is_back() {
    let folder = tempdir().unwrap();
    // A name as long as a file's may be: that of the record would be longer.
    let name = format!("{}.nc", "n".repeat(250));
    let job = file(&folder, &name, "G21 G90\nG0 X2\nG1 X60 F200\n");
    let (device, end) = (path(&folder, "tty"), path(&folder, "cable"));
    let _simulator = Simulator::start(&["--pty", &device], &SETTINGS);
    let cable = Cable::plug_in(&device, &end);
    let mut sending = Sending::start(&[&job, "--port", &end, "--wait", "--spin-up", "0.1"]);
    sending.until("Run ");
    cable.unplug();
    let _cable = Cable::plug_in(&device, &end);
    sending.until("[y/n]");
    sending.press("n");
    let log = sending.fails();
    assert!(
        log.contains("--from LINE continues it") && log.contains("nothing was sent"),
        "{log}"
    );
}

/// A short job, of which the last line may be another one.
fn short(last: &str) -> String {
    format!("G21 G90\nG0 X2\nG0 Y2\n{last}\n")
}

#[test]
fn a_job_with_refused_lines_is_not_begun_unless_that_is_asked_for() {
    let folder = tempdir().unwrap();
    let steps = path(&folder, "steps.csv");
    let (simulator, address) = Simulator::tcp(&["--trace", &steps], &SETTINGS);
    let job = file(&folder, "job.nc", &short("G999"));
    let log = Sending::start(&[&job, "--tcp", &address]).fails();
    assert!(
        log.contains("error:20") && log.contains("nothing was sent"),
        "{log}"
    );
    let log = Sending::start(&[&job, "--tcp", &address, "--despite-refusals"]).fails();
    assert!(
        log.contains("line 4 (G999): error:20") && log.contains("Done"),
        "{log}"
    );
    drop(simulator);
    assert_eq!(trace(&steps).last(), Some(&[160, 160, 0]));
}

#[test]
fn a_job_that_would_leave_the_travel_is_not_begun() {
    let folder = tempdir().unwrap();
    let guarded = [&SETTINGS[..], &["$22=1", "$20=1"]].concat();
    let (_simulator, address) = Simulator::tcp(&["--switches"], &guarded);
    let job = file(&folder, "job.nc", "G21 G90\nG0 X-2\nG0 X-900\n");
    let log = Sending::start(&[&job, "--tcp", &address]).fails();
    assert!(
        log.contains("the machine is locked: --home homes it"),
        "{log}"
    );
    let fast = ["$24=600", "$25=5000", "$130=20", "$131=20", "$132=20"];
    let (_simulator, address) = Simulator::tcp(&["--switches"], &[&guarded[..], &fast].concat());
    let log = Sending::start(&[&job, "--tcp", &address, "--home"]).fails();
    let alarm = "line 3 (G0 X-900) would end in ALARM:2, the target is outside the machine's travel \
        (X -900.000 in machine coordinates is not within -20.000 to 0.000): reset";
    assert!(log.contains(alarm), "{log}");
    let job = file(&folder, "job.nc", "G21 G90\nG0 X-2\nG0 X-9\n");
    let log = Sending::start(&[&job, "--tcp", &address]).succeeds();
    assert!(
        log.contains("machine position -9.000 -1.000 -1.000"),
        "{log}"
    );
}

#[test]
fn ctrl_c_stops_the_homing_before_a_job() {
    let folder = tempdir().unwrap();
    // Longer than anybody waits: 150 mm to the switch at 60 mm/min.
    let homing = [&SETTINGS[..], &["$22=1", "$25=60"]].concat();
    let (_simulator, address) = Simulator::tcp(&["--switches"], &homing);
    let job = file(&folder, "job.nc", &short("G0 X5"));
    let mut sending = Sending::start(&[&job, "--tcp", &address, "--home"]);
    sending.until("Ctrl-C stops it");
    sending.interrupt();
    let log = sending.fails();
    assert!(
        log.contains("it was stopped before the job was begun"),
        "{log}"
    );
    // It is at rest, and its position is unknown.
    let log = Sending::start(&[&job, "--tcp", &address]).fails();
    assert!(log.contains("the machine is locked"), "{log}");
}

#[test]
fn without_an_operator_a_change_of_the_tool_ends_the_job() {
    let folder = tempdir().unwrap();
    let (_simulator, address) = Simulator::tcp(&[], &SETTINGS);
    let job = file(&folder, "job.nc", &short("T1 M6\nG0 X5"));
    let mut sending = Sending::start(&[&job, "--tcp", &address]);
    sending.leave();
    let log = sending.fails();
    assert!(
        log.contains("waits for its operator ([MSG:Tool change: T1]), and nobody is there"),
        "{log}"
    );
    // The machine was reset at rest: it takes the next job, and stands where it was.
    let mut sending = Sending::start(&[&job, "--tcp", &address, "--resume", "--confirmed"]);
    sending.until("position  X");
    sending.until("the machine waits");
    sending.press("r");
    let log = sending.succeeds();
    assert!(log.contains("machine position 5.000 2.000 0.000"), "{log}");
}

#[test]
fn ctrl_c_holds_and_a_second_one_ends_the_job_which_is_continued_only_with_a_yes() {
    let folder = tempdir().unwrap();
    let (_simulator, address) = Simulator::tcp(&[], &SETTINGS);
    let job = file(&folder, "job.nc", &short("G1 X60 F200"));
    let mut sending = Sending::start(&[&job, "--tcp", &address]);
    sending.until("Run ");
    sending.interrupt();
    sending.until("the machine is held");
    sending.interrupt();
    let log = sending.fails();
    assert!(
        log.contains("the job was interrupted") && log.contains("--resume continues it"),
        "{log}"
    );

    let mut sending = Sending::start(&[&job, "--tcp", &address, "--resume"]);
    sending.until("[y/n]");
    sending.press("n");
    assert!(sending.fails().contains("nothing was sent"));
    let mut sending = Sending::start(&[&job, "--tcp", &address, "--resume"]);
    sending.leave();
    assert!(sending.fails().contains("nothing was sent"));
    let mut sending = Sending::start(&[&job, "--tcp", &address, "--resume"]);
    sending.until("[y/n]");
    sending.press("y");
    let log = sending.succeeds();
    assert!(log.contains("machine position 60.000 2.000 0.000"), "{log}");
    // Where a line begins that is told, as long as no axis is where nothing says.
    let placed = file(&folder, "placed.nc", "G21 G90\nG0 X1 Y1 Z1\nG0 X2\nG0 X3\n");
    let mut sending = Sending::start(&[&placed, "--tcp", &address, "--from", "4", "--confirmed"]);
    sending.until("position  X2 Y1 Z1");
    sending.succeeds();
    let log = Sending::start(&[&job, "--tcp", &address, "--from", "3"]).fails();
    assert!(log.contains("depends on where the machine stood"), "{log}");
    // Nothing is left to continue.
    let log = Sending::start(&[&job, "--tcp", &address, "--resume"]).fails();
    assert!(
        log.contains("there is no record of an interrupted job"),
        "{log}"
    );
}

/// A cut in line 13, which the simulator is to be held in, between quick ones.
const LINE_13: &str = "\
G21 G90 F900
G0 Z2
G0 X1 Y1
G1 Z-1
X4
Y4
X1
Y1
X4
Y4
X1
M0
X30 F400
Y1 F900
X1
G0 Z2
X0 Y0
";

#[test]
fn a_job_that_is_stopped_in_line_13_is_continued_at_line_13_and_cuts_the_same() {
    let folder = tempdir().unwrap();
    let job = file(&folder, "job.nc", LINE_13);
    let cut = |name: &str, stops: bool| {
        let steps = path(&folder, name);
        let (simulator, address) = Simulator::tcp(&["--trace", &steps], &SETTINGS);
        let mut sending = Sending::start(&[&job, "--tcp", &address]);
        sending.until("the machine waits");
        sending.press("r");
        if stops {
            sending.until("Run ");
            sending.interrupt();
            sending.until("Hold:0  line 13 of 17");
            sending.interrupt();
            sending.fails();
            sending = Sending::start(&[&job, "--tcp", &address, "--resume", "--confirmed"]);
            // From above where the line begins.
            sending.until("approach  G0 X1 Y4");
        }
        let log = sending.succeeds();
        assert_eq!(log.contains("Continue at line 13"), stops, "{log}");
        drop(simulator);
        let steps = trace(&steps);
        (MachinedPath::of(&steps, 0), steps.last().copied())
    };
    let (expected, expected_end) = cut("whole.csv", false);
    let (done, end) = cut("stopped.csv", true);
    assert_eq!(end, expected_end);
    assert!(expected.len() > 1000);
    assert_eq!(
        (expected.beyond(&done), done.beyond(&expected)),
        (Vec::new(), Vec::new())
    );
}

/// The state of the simulator at an address, once nobody else has its line.
fn state(address: &str) -> String {
    let since = Instant::now();
    loop {
        let link = Link::open(None, 0, Some(address), WAIT).unwrap();
        match Machine::connect(link, WAIT, None) {
            Ok(machine) => return machine.status.report.state,
            Err(error) => assert!(since.elapsed() < WAIT, "{error:#}"),
        }
    }
}

#[test]
fn a_closed_terminal_and_a_killed_program_hold_the_machine() {
    let folder = tempdir().unwrap();
    let job = file(&folder, "job.nc", &short("G1 X60 F200"));
    for signal in [Signal::KILL, Signal::ABORT] {
        let (_simulator, address) = Simulator::tcp(&[], &SETTINGS);
        let mut sending = Sending::start(&[&job, "--tcp", &address]);
        sending.until("Run ");
        sending.signal(signal);
        sending.fails();
        assert!(state(&address).starts_with("Hold:"), "{signal:?}");
    }
    for signal in [Signal::HUP, Signal::QUIT] {
        let (_simulator, address) = Simulator::tcp(&[], &SETTINGS);
        let mut sending = Sending::start(&[&job, "--tcp", &address]);
        sending.until("Run ");
        sending.signal(signal);
        sending.until("the machine is held");
        sending.signal(Signal::KILL);
        sending.fails();
        assert!(state(&address).starts_with("Hold:"), "{signal:?}");
    }
}

#[test]
fn a_machine_is_left_alone_when_its_job_has_ended() {
    let folder = tempdir().unwrap();
    let job = file(&folder, "job.nc", &short("G1 X3 F200"));
    let (_simulator, address) = Simulator::tcp(&[], &SETTINGS);
    Sending::start(&[&job, "--tcp", &address]).succeeds();
    assert_eq!(state(&address), "Idle");
}

#[test]
fn a_program_that_has_been_changed_is_not_continued() {
    let folder = tempdir().unwrap();
    let (_simulator, address) = Simulator::tcp(&[], &SETTINGS);
    let job = file(&folder, "job.nc", &short("T1 M6"));
    let mut sending = Sending::start(&[&job, "--tcp", &address]);
    sending.leave();
    sending.fails();
    file(&folder, "job.nc", &short("T1 M6\nG0 X1"));
    let log = Sending::start(&[&job, "--tcp", &address, "--resume"]).fails();
    assert!(log.contains("the program has been changed"), "{log}");
}

#[test]
fn a_new_tool_is_measured_by_lines_that_the_operator_types() {
    let folder = tempdir().unwrap();
    let (_simulator, address) = Simulator::tcp(&[], &SETTINGS);
    let job = file(
        &folder,
        "job.nc",
        "G21 G90\nG0 X1\nT2 M6\nG0 X2 Z5\nG0 Y40 F200\nG1 Y80\n",
    );
    let measure = |sending: &mut Sending| {
        sending.until("the machine waits");
        sending.press("t");
        sending.until("Enter sends one");
        sending.press("$J=G91 X7 F100\n");
        sending.until("ok");
        sending.until("Jog ");
        sending.until("Tool ");
        sending.press("G91\nG43.1 Z-2\nG0 X3\n");
        sending.until("ok");
        sending.until("ok");
        sending.until("error:40");
        sending.press("\n");
        sending.press("r");
        sending.until("Run ");
    };
    let mut sending = Sending::start(&[&job, "--tcp", &address]);
    measure(&mut sending);
    sending.press("hq");
    sending.fails();
    // A reset has taken the length away: the job begins at the change again.
    let mut sending = Sending::start(&[&job, "--tcp", &address, "--resume", "--confirmed"]);
    sending.until("approach  M61 Q0");
    measure(&mut sending);
    let log = sending.succeeds();
    assert!(log.contains("machine position 2.000 80.000 3.000"), "{log}");
}
