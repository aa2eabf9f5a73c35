//! Jobs at a machine that says what it is told to.

use super::*;

fn job(program: &[&str]) -> Transmission {
    let lines: Vec<_> = program
        .iter()
        .map(|line| line.as_bytes().to_vec())
        .collect();
    Transmission::new(&[], &lines, 0, false)
}

fn sent(job: &mut Transmission) -> String {
    String::from_utf8_lossy(&job.take_output()).into_owned()
}

fn receive(job: &mut Transmission, lines: &[&str]) {
    for line in lines {
        job.receive(line);
    }
}

const RUN: &str = "<Run|MPos:0.000,0.000,0.000|FS:0,0>";
const HELD: &str = "<Hold:0|MPos:0.000,0.000,0.000|FS:0,0>";
const BRAKING: &str = "<Hold:1|MPos:0.000,0.000,0.000|FS:0,0>";
const IDLE: &str = "<Idle|MPos:0.000,0.000,0.000|FS:0,0>";

#[test]
fn a_job_is_done_when_the_machine_is_at_rest_after_its_last_line() {
    let mut job = job(&["G0 X1", "G0 X2"]);
    assert_eq!(sent(&mut job), "G0 X1\nG0 X2\n");
    receive(&mut job, &["ok", IDLE, "ok", IDLE]);
    assert_eq!(job.phase, Phase::Running);
    assert_eq!(sent(&mut job), "G4 P0.01\n");
    receive(&mut job, &[IDLE, "ok", RUN]);
    assert_eq!(job.phase, Phase::Running);
    receive(&mut job, &[IDLE]);
    assert_eq!((&job.phase, job.answered()), (&Phase::Done, 2));
}

#[test]
fn no_more_bytes_are_in_flight_than_the_machine_keeps() {
    let line = "X".repeat(60);
    let mut job = job(&[line.as_str(); 5]);
    assert_eq!(sent(&mut job).len(), 122);
    assert_eq!(sent(&mut job), "");
    receive(&mut job, &["ok"]);
    assert_eq!(sent(&mut job).len(), 61);
}

#[test]
fn a_refused_line_ends_the_job_with_a_reset_at_rest() {
    let mut job = job(&["G0 X1", "G999", "G0 X2"]);
    sent(&mut job);
    receive(&mut job, &["ok", "error:20", "ok"]);
    assert_eq!(sent(&mut job), "!?");
    receive(&mut job, &[RUN, BRAKING]);
    assert_eq!(sent(&mut job), "");
    receive(&mut job, &[HELD]);
    assert_eq!(sent(&mut job), "\u{18}");
    receive(&mut job, &["", "Grbl 1.1h ['$' for help]"]);
    let Phase::Failed(reason) = &job.phase else {
        panic!("{:?}", job.phase);
    };
    assert!(reason.starts_with("line 2 (G999): error:20, "), "{reason}");
}

#[test]
fn a_refused_line_is_only_reported_where_that_is_asked_for_but_never_one_of_the_approach() {
    let lines = [b"G0 X1".to_vec(), b"G999".to_vec(), b"G0 X2".to_vec()];
    let mut job = Transmission::new(&["G53 G0 Z0".into()], &lines, 1, true);
    assert_eq!(sent(&mut job), "G53 G0 Z0\n");
    receive(&mut job, &["ok"]);
    assert_eq!(sent(&mut job), "G999\nG0 X2\n");
    receive(&mut job, &["error:20"]);
    assert_eq!((&job.phase, job.answered()), (&Phase::Running, 2));
    assert_eq!((job.refused, job.oldest()), (1, Some((3, &b"G0 X2"[..]))));
    assert!(job.take_notes()[0].starts_with("line 2 (G999): error:20"));
    let mut job = Transmission::new(&["G53 G0 Z0".into()], &lines, 1, true);
    sent(&mut job);
    receive(&mut job, &["error:9"]);
    assert!(matches!(&job.phase, Phase::Stopping(reason) if reason.starts_with("the approach")));
    assert_eq!(job.answered(), 1);
}

#[test]
fn answers_after_a_reset_are_of_lines_that_were_not_carried_out() {
    let mut job = job(&["G0 X1", "M5", "G0 X2"]);
    sent(&mut job);
    receive(&mut job, &["ok"]);
    job.stop("stop".into());
    receive(&mut job, &[HELD, "ok", "Grbl 1.1h ['$' for help]"]);
    assert_eq!(
        (job.phase.clone(), job.answered()),
        (Phase::Failed("stop".into()), 1)
    );
}

#[test]
fn a_pause_waits_for_the_operator_and_ends_the_job_where_there_is_none() {
    let mut job = job(&["T1 M6"]);
    sent(&mut job);
    receive(&mut job, &["[MSG:Tool change: T1]", HELD, HELD]);
    let notes = job.take_notes();
    assert_eq!(
        notes,
        [
            "[MSG:Tool change: T1]",
            "the machine waits: r resumes, q stops",
            "t: type lines, to jog and probe with the new tool"
        ]
    );
    assert_eq!(job.waits(), Some("Tool change: T1"));
    job.press(Key::Resume);
    assert_eq!(sent(&mut job), "~");
    receive(&mut job, &[RUN]);
    assert_eq!(job.waits(), None);
    job.has_operator = false;
    receive(&mut job, &["[MSG:Tool change: T2]", HELD]);
    let Phase::Stopping(reason) = &job.phase else {
        panic!("{:?}", job.phase);
    };
    assert!(reason.contains("Tool change: T2"), "{reason}");
}

#[test]
fn nothing_of_the_job_is_sent_while_lines_are_typed() {
    let mut job = job(&["T1 M6", &"X".repeat(115), "G0 X1", "G0 X2"]);
    assert_eq!(sent(&mut job).lines().count(), 2);
    receive(&mut job, &["[MSG:Tool change: T1]", HELD]);
    job.key(b't');
    // Too early for a line, and no key either.
    job.key(b'q');
    assert_eq!(job.take_output(), [0xa3]);
    receive(&mut job, &["<Tool|MPos:0.000,0.000,0.000|FS:0,0>"]);
    b"G43.1Z1\n\nr".iter().for_each(|key| job.key(*key));
    assert_eq!(sent(&mut job), "G43.1Z1\n~");
    assert_eq!(job.measured, Some(0));
    // Its answer is none to the job.
    receive(&mut job, &["ok", "<Tool|MPos:0.000,0.000,0.000|FS:0,0>"]);
    assert_eq!((job.answered(), sent(&mut job)), (0, String::new()));
    job.key(b'r');
    receive(&mut job, &[RUN, "ok", "ok"]);
    assert_eq!(sent(&mut job), "~G0 X1\nG0 X2\n");
}

#[test]
fn an_alarm_while_lines_are_typed_waits_only_for_an_operator_who_is_there() {
    const ALARM: &str = "<Alarm|MPos:0.000,0.000,0.000|FS:0,0>";
    let mut job = job(&["T1 M6", "G0 X1"]);
    sent(&mut job);
    receive(&mut job, &["[MSG:Tool change: T1]", HELD]);
    job.key(b't');
    receive(&mut job, &["<Tool|MPos:0.000,0.000,0.000|FS:0,0>"]);
    b"G38.2Z-5\n".iter().for_each(|key| job.key(*key));
    receive(&mut job, &["ALARM:5", "ok", ALARM]);
    assert_eq!(job.phase, Phase::Running);
    job.has_operator = false;
    receive(&mut job, &[ALARM]);
    assert_eq!(job.phase, Phase::Failed("the machine is locked".into()));
}

#[test]
fn ctrl_c_holds_first_and_then_stops() {
    let mut job = job(&["G0 X1"]);
    sent(&mut job);
    job.interrupt();
    assert_eq!(
        (sent(&mut job).as_str(), &job.phase),
        ("!", &Phase::Running)
    );
    job.interrupt();
    assert!(matches!(job.phase, Phase::Stopping(_)));
    let mut alone = self::job(&["G0 X1"]);
    alone.has_operator = false;
    alone.interrupt();
    assert!(matches!(alone.phase, Phase::Stopping(_)));
}

#[test]
fn an_alarm_and_a_reset_from_elsewhere_end_the_job() {
    let mut limit = job(&["G0 X1"]);
    receive(&mut limit, &["ALARM:1"]);
    assert!(matches!(&limit.phase, Phase::Failed(reason) if reason.contains("ALARM:1, ")));
    let mut reset = job(&["G0 X1"]);
    receive(&mut reset, &["Grbl 1.1h ['$' for help]"]);
    assert_eq!(
        reset.phase,
        Phase::Failed("the machine has been reset".into())
    );
}

/// Why a job has failed.
fn reason(job: &Transmission) -> &str {
    match &job.phase {
        Phase::Failed(reason) => reason,
        phase => panic!("{phase:?}"),
    }
}

#[test]
fn an_alarm_is_reported_with_the_lines_that_may_have_raised_it() {
    let lines = ["G0 X1", "G1 X250", "X1", "X2"];
    let mut travel = job(&lines);
    assert_eq!(sent(&mut travel).lines().count(), 4);
    travel.travel_mm = vec![Some([-200.0, 0.0]), None, Some([-50.0, 0.0])];
    let report = "<Idle|MPos:0.000,0.000,0.000|FS:0,0|WCO:-5.000,0.000,-10.000>";
    receive(&mut travel, &[report, "ok", "ALARM:2"]);
    let place = "line 2 (G1 X250): ALARM:2, the target is outside the machine's travel \
        (it is X -200.000 to 0.000, Z -50.000 to 0.000; the work zero is at X -5.000 Y 0.000 Z -10.000): reset";
    assert!(reason(&travel).starts_with(place), "{}", reason(&travel));
    // Those that have been answered may not have been carried out.
    let mut limit = job(&lines);
    sent(&mut limit);
    limit.undone = 1;
    receive(&mut limit, &["ok", "ok", "ok", "ALARM:1"]);
    let place = "line 2 to line 4: ALARM:1, a limit switch closed";
    assert!(reason(&limit).starts_with(place), "{}", reason(&limit));
    let lines = lines.map(|line| line.as_bytes().to_vec());
    let mut resumed = Transmission::new(&["G53 G0 Z0".into()], &lines, 2, false);
    sent(&mut resumed);
    receive(&mut resumed, &["ok"]);
    sent(&mut resumed);
    receive(&mut resumed, &["ALARM:5"]);
    let place = "line 3 (X1): ALARM:5, the probe made no contact: ";
    assert!(reason(&resumed).starts_with(place), "{}", reason(&resumed));
    let mut before = Transmission::new(&["G53 G0 Z0".into()], &lines, 2, false);
    sent(&mut before);
    receive(&mut before, &["ALARM:1"]);
    let place = "the approach (G53 G0 Z0): ALARM:1";
    assert!(reason(&before).starts_with(place), "{}", reason(&before));
}

#[test]
fn keys_are_the_realtime_bytes_of_the_protocol() {
    let mut job = job(&[]);
    sent(&mut job);
    for (key, byte) in [
        (b'!', b'!'),
        (b'~', b'~'),
        (b'+', 0x91),
        (b'-', 0x92),
        (b'0', 0x90),
        (b'l', 0x97),
    ] {
        job.press(Key::of(key).unwrap());
        assert_eq!(job.take_output(), [byte], "{key}");
    }
    assert_eq!(Key::of(b'x'), None);
}
