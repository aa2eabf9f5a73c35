//! The verb as it is typed.

use std::{fs, path::Path};

use clap::Parser;
use leadscrew::axis::AXES;
use serde_json::Value;

use super::{Options, run};

#[test]
fn quality_is_measured_where_it_is_asked_for() {
    let folder = tempfile::tempdir().unwrap();
    let names = ["part.nc", "out.json", "out.svg"];
    let [program, json, plot] = names.map(|name| folder.path().join(name));
    fs::write(&program, "G1 X10 F400\nY10\nG2 X15 Y15 I5 J0\n").unwrap();
    let [program, json, plot] = [program, json, plot].map(|path| path.display().to_string());
    let typed = |more: &[&str]| {
        let fixed = [
            "sim", &program, "--set", "$120=200", "--set", "$121=200", "--json", &json,
        ];
        let line = fixed.iter().chain(more);
        run(&Options::try_parse_from(line).unwrap()).unwrap();
        serde_json::from_slice::<Value>(&fs::read(&json).unwrap()).unwrap()
    };
    assert_eq!(typed(&[])["quality"], Value::Null);
    let quality = &typed(&["--quality", "--plot", &plot])["quality"];
    let number = |value: &Value| value.as_f64().unwrap();
    let axes = quality["axes"].as_array().unwrap();
    assert_eq!(axes.len(), 2);
    for (axis, letter) in axes.iter().zip(["X", "Y"]) {
        assert_eq!(axis["axis"], letter);
        assert!(number(&axis["interval_error"]["rms"]) < 0.02, "{axis}");
        let acceleration = number(&axis["acceleration_mm_s2"]["value"]);
        assert!((190.0..210.0).contains(&acceleration), "{axis}");
        assert_eq!(axis["acceleration_limit_mm_s2"], 200.0);
        assert!(number(&axis["jerk_mm_s3"]["value"]) > 0.0);
    }
    assert!(number(&quality["path"]["acceleration_mm_s2"]["value"]) > 190.0);
    let deviation = &quality["deviation"];
    assert!(number(&deviation["hausdorff_mm"]) < 1.3 * number(&deviation["floor_mm"]));
    // A right angle, and an arc that begins along the second line.
    assert_eq!(quality["corners"]["count"], 1);
    assert!((number(&quality["corners"]["most_of_allowed"]) - 1.0).abs() < 0.05);
    assert!((0.8..1.0).contains(&number(&quality["feed"]["part"])));
    assert!(number(&quality["job_time_s"]) > 2.7);
    assert_eq!(quality["is_path_known"], true);
    let drawn = fs::read_to_string(&plot).unwrap();
    for label in [
        "acceleration of X, mm/s²",
        "jerk of Y, 1000 mm/s³",
        "from the programmed path",
    ] {
        assert!(drawn.contains(label), "{label}");
    }
}

/// The figures of a program.
fn figures(folder: &Path, program: &str, more: &[&str]) -> Value {
    let [file, json] = ["part.nc", "out.json"].map(|name| folder.join(name).display().to_string());
    fs::write(&file, program).unwrap();
    let line = ["sim", &file, "--json", &json];
    let line = line.iter().chain(more);
    run(&Options::try_parse_from(line).unwrap()).unwrap();
    serde_json::from_slice(&fs::read(&json).unwrap()).unwrap()
}

#[test]
fn a_core_xy_machine_keeps_the_limits_of_its_motors_on_the_programmed_path() {
    let folder = tempfile::tempdir().unwrap();
    let plot = folder.path().join("belts.svg").display().to_string();
    let settings = [
        "$795=1",
        "$100=80",
        "$102=80",
        "$120=500",
        "$121=300",
        "$122=200",
        "$800=20000",
        "$801=20000",
    ];
    let set: Vec<_> = settings
        .into_iter()
        .flat_map(|set| ["--set", set])
        .collect();
    let program = "G1 X20 Y20 F1500\nX25\nG2 X35 Y30 I10 J0\nG3 X35 Y10 Z3 I0 J-10\nG1 Y5\nG18 G2 X45 Z3 I5 K0\nG1 X0 Y0 Z0\n";
    let more = [&set[..], &["--quality", "--plot", &plot]].concat();
    let whole = figures(folder.path(), program, &more);
    assert_eq!(refused(&whole), Vec::<&str>::new());
    let quality = &whole["quality"];
    assert_eq!(quality["violations"], Value::Array(Vec::new()));
    assert_eq!(quality["is_path_known"], true);
    let axes = quality["axes"].as_array().unwrap();
    let names: Vec<_> = axes
        .iter()
        .map(|axis| axis["axis"].as_str().unwrap())
        .collect();
    assert_eq!(names, ["motor X", "motor Y", "Z"]);
    for (axis, limit) in axes.iter().zip([500.0, 300.0, 200.0]) {
        assert_eq!(axis["acceleration_limit_mm_s2"], limit);
        assert!(
            axis["acceleration_mm_s2"]["of_limit"].as_f64().unwrap() > 0.5,
            "{axis}"
        );
    }
    // Chords of the arc in the plane of X and Z stay within $12, 0.002 mm.
    let deviation = &quality["deviation"];
    let [off, floor] = ["hausdorff_mm", "floor_mm"].map(|name| deviation[name].as_f64().unwrap());
    assert!(off < floor + 0.002, "{deviation}");
    let drawn = fs::read_to_string(&plot).unwrap();
    assert!(drawn.contains("acceleration of motor X, mm/s²"));
    assert!(drawn.contains("jerk of motor Y, 1000 mm/s³"));
}

#[test]
fn the_jerk_of_arcs_is_within_the_bounds_that_the_settings_page_has() {
    let set = [
        "$11=0.01",
        "$110=5000",
        "$111=5000",
        "$120=500",
        "$121=500",
        "$800=10000",
        "$801=10000",
        "$802=10000",
    ];
    let mut more: Vec<_> = set.into_iter().flat_map(|set| ["--set", set]).collect();
    more.push("--quality");
    let acceleration = 500.0_f64;
    // Lines with arcs between corners, where axes step back and forth; the same; and an S-curve from arc to arc.
    for (program, radius_mm, jumps) in [
        (
            "G1 X-1.5 Y0.16 F3000\nX-1.78 Y0.3\nX-1.9 Y0.345\nX-1.954 Y0.362\nX-3.594 Y0.108\n\
            G3 X-3.643 Y0.118 R0.1\nG1 X-3.92 Y0.94\nX-4.1 Y1.252\n",
            0.1,
            1.0,
        ),
        (
            "G1 X1.613 Y-0.306 F3000\nX2.144 Y-0.393\nX2.242 Y-0.363\nX2.377 Y-0.367\nX2.505 Y-0.383\n\
            X2.541 Y-0.317\nG3 X2.745 Y-0.028 R0.709\nG1 X3.129 Y0.759\n",
            0.709,
            1.0,
        ),
        (
            "G1 X0 Y8 F3000\nG2 X2 Y8 I1 J0\nG3 X4 Y8 I1 J0\nG2 X6 Y8 I1 J0\nG1 X6 Y0\n",
            1.0,
            2.0,
        ),
    ] {
        let folder = tempfile::tempdir().unwrap();
        let whole = figures(folder.path(), program, &more);
        let quality = &whole["quality"];
        assert_eq!(quality["violations"], Value::Array(Vec::new()), "{program}");
        for part in quality["axes"]
            .as_array()
            .unwrap()
            .iter()
            .take(2)
            .chain([&quality["path"]])
        {
            let of_limit = part["jerk_mm_s3"]["of_limit"].as_f64().unwrap();
            assert!(of_limit <= 1.02, "{program}: {part}");
        }
        let arcs = &quality["arcs"];
        let [jerk, jump] = ["jerk_mm_s3", "jump_mm_s2"].map(|name| arcs[name].as_f64().unwrap());
        assert!(jerk <= (acceleration.powi(3) / radius_mm).sqrt(), "{arcs}");
        assert!(jump <= jumps * acceleration, "{arcs}");
    }
}

#[test]
fn quality_and_trace_are_those_of_axes_that_follow_with_backlash() {
    let folder = tempfile::tempdir().unwrap();
    let trace = folder.path().join("steps.csv").display().to_string();
    let settings = ["$160=0.1", "$161=0.05", "$23=2", "$12=0.002"];
    let set: Vec<_> = settings
        .into_iter()
        .flat_map(|set| ["--set", set])
        .collect();
    let more = [&set[..], &["--quality", "--trace", &trace]].concat();
    let program = "G1 X-10 F600\nX5 Y3\nG2 I4 J3\nG1 X2 Y-1\n";
    let whole = figures(folder.path(), program, &more);
    let quality = &whole["quality"];
    assert_eq!(quality["violations"], Value::Array(Vec::new()));
    assert_eq!(quality["is_path_known"], true);
    let deviation = &quality["deviation"];
    let [off, floor] = ["hausdorff_mm", "floor_mm"].map(|name| deviation[name].as_f64().unwrap());
    assert!(off < floor + 0.002, "{deviation}");
    let rows = fs::read_to_string(&trace).unwrap();
    let last = rows.lines().last().unwrap();
    assert_eq!(
        last.split(',').skip(1).take(2).collect::<Vec<_>>(),
        ["500", "-250"]
    );
}

fn refused(figures: &Value) -> Vec<&str> {
    let answers = figures["responses"].as_array().unwrap().iter();
    let texts = answers.map(|answer| answer[1].as_str().unwrap());
    texts.filter(|text| *text != "ok").collect()
}

#[test]
fn a_program_that_homes_probes_and_sets_runs_amid_switches() {
    let folder = tempfile::tempdir().unwrap();
    let program =
        "$110=600\n$H\nG38.2 G91 Z-195 F600\n$G\n$$\n$#\nG90 G53 G0 Z-5\n$J=G91 X-1 F500\nG4 P1\n";
    let homes = ["--set", "$22=1", "--set", "$25=2000", "--set", "$24=200"];
    let whole = figures(
        folder.path(),
        program,
        &[&homes[..], &["--switches"]].concat(),
    );
    assert_eq!(refused(&whole), Vec::<&str>::new());
    assert_eq!(whole["final"]["state"], "Idle");
    let messages = whole["messages"].to_string();
    assert!(
        messages.contains("[PRB:") && messages.contains(":1]"),
        "{messages}"
    );
    assert!(messages.contains("$110=600"), "{messages}");
}

#[test]
fn homing_squares_a_skewed_gantry_and_both_sides_are_reported() {
    let folder = tempfile::tempdir().unwrap();
    let homes = [
        "--switches",
        "--set",
        "$22=1",
        "--set",
        "$101=80",
        "--set",
        "$25=2000",
    ];
    let sides = |program: &str, more: &[&str]| {
        let whole = figures(folder.path(), program, &[&homes[..], more].concat());
        assert_eq!(refused(&whole), Vec::<&str>::new());
        whole["second_motors"].clone()
    };
    assert_eq!(sides("$H\n", &[]), Value::Null);
    let skewed = ["--second", "Y=3", "--second", "Z=-1.5"];
    // Without homing both motors move as one.
    let moved = &sides("G1 Y10 Z-5 F600\n", &skewed)[0];
    assert_eq!(moved["ahead_steps"], serde_json::json!([240, 240]));
    assert_eq!([&moved["first_mm"], &moved["second_mm"]], [10.0, 13.0]);
    for direction in ["$23=0", "$23=7"] {
        let more = [&skewed[..], &["--set", direction]].concat();
        let homed = sides("$H\n", &more);
        let homed = homed.as_array().unwrap();
        assert_eq!(homed.len(), 2);
        for (sides, (axis, before)) in homed.iter().zip([("Y", 240), ("Z", -375)]) {
            assert_eq!(
                (&sides["axis"], &sides["ahead_steps"][0]),
                (&axis.into(), &before.into())
            );
            let ahead = sides["ahead_steps"][1].as_i64().unwrap();
            assert!(ahead.abs() <= 1, "{sides}");
            let [first, second] =
                ["first_mm", "second_mm"].map(|name| sides[name].as_f64().unwrap());
            let home = if direction == "$23=0" { -1.0 } else { -199.0 };
            assert!(
                (first - home).abs() < 0.02 && (second - home).abs() < 0.02,
                "{sides}"
            );
        }
    }
}

#[test]
fn a_second_motor_that_cannot_be_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let program = folder.path().join("part.nc").display().to_string();
    fs::write(&program, "$H\n").unwrap();
    for (more, error) in [
        (&["--second", "Y=1", "--second", "y=2"][..], "more than one"),
        (&["--second", "Y=100"], "100 mm from the ends"),
        (&["--second", "X", "--set", "$795=1"], "CoreXY"),
    ] {
        let line = [&["sim", program.as_str(), "--switches"], more].concat();
        let options = Options::try_parse_from(line).unwrap();
        let message = run(&options).unwrap_err().to_string();
        assert!(message.contains(error), "{message}");
    }
    assert!(Options::try_parse_from(["sim", &program, "--second", "Y"]).is_err());
    let served = ["sim", "--pty", "tty", "--switches", "--second", "Y"];
    assert!(Options::try_parse_from(served).is_err());
}

#[test]
fn a_program_begins_unlocked_unless_it_is_asked_for_otherwise() {
    let folder = tempfile::tempdir().unwrap();
    let homes = ["--set", "$22=1"];
    let unlocked = figures(folder.path(), "G1 X1 F600\n", &homes);
    assert_eq!(refused(&unlocked), Vec::<&str>::new());
    assert_eq!(unlocked["steps_axis"][0], 250);
    assert_eq!(unlocked["messages"], Value::Array(Vec::new()));
    let locked = figures(
        folder.path(),
        "G1 X1 F600\n",
        &[&homes[..], &["--locked"]].concat(),
    );
    assert_eq!(refused(&locked), ["error:9"]);
}

#[test]
fn a_flash_keeps_what_is_set_and_what_a_program_stores() {
    let folder = tempfile::tempdir().unwrap();
    let flash = folder.path().join("chip").display().to_string();
    let flash = ["--flash", flash.as_str(), "--switches"];
    let arguments = [&flash[..], &["--set", "$100=80"]].concat();
    let set = figures(folder.path(), "G10 L2 P1 X5\nG1 X0 F600\n", &arguments);
    assert_eq!(set["final"]["steps"][0], 5 * 80);
    let kept = figures(folder.path(), "G1 X1 F600\n", &flash);
    assert_eq!(kept["final"]["steps"][0], 6 * 80);
    let settings = folder.path().join("more.settings");
    fs::write(&settings, "$100=100\n").unwrap();
    let settings = ["--settings", &settings.display().to_string()].map(str::to_owned);
    let more: Vec<_> = flash
        .iter()
        .copied()
        .chain(settings.iter().map(String::as_str))
        .collect();
    let changed = figures(folder.path(), "G1 X1 F600\n", &more);
    assert_eq!(changed["final"]["steps"][0], 6 * 100);
}

#[test]
fn positions_are_reported_in_the_settings_of_the_end() {
    let folder = tempfile::tempdir().unwrap();
    let changed = figures(folder.path(), "$100=80\nG1 X2 F600\n", &[]);
    assert_eq!(changed["final"]["mpos_mm"][0], 2.0);
}

/// The settings of most pictures.
const MILL: &str = "examples/mill.settings";

/// The picture of a program in a folder is what its command draws now.
fn check_picture(program: &str, settings: &str, shown: &str) {
    if AXES > 3 {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let plot = folder.path().join("picture.svg");
    let root = common::cargo::root();
    let [program, settings, shown] =
        [program, settings, shown].map(|path| root.join(path).display().to_string());
    let plot_option = plot.display().to_string();
    let typed = [
        "sim",
        &program,
        "--settings",
        &settings,
        "--plot",
        &plot_option,
    ];
    run(&Options::try_parse_from(typed).unwrap()).unwrap();
    let same = fs::read_to_string(plot).unwrap() == fs::read_to_string(&shown).unwrap();
    assert!(same, "draw {shown} again, by the command beside it");
}

#[test]
fn the_picture_of_a_plate_is_what_its_command_draws() {
    check_picture("examples/plate.nc", MILL, "docs/plate.svg");
}

#[test]
fn the_pictures_of_cycles_are_what_their_commands_draw() {
    check_picture("examples/cycles.nc", MILL, "docs/cycles.svg");
    check_picture("examples/drilling.nc", MILL, "docs/drilling.svg");
}

#[test]
fn the_picture_of_compensation_is_what_its_command_draws() {
    check_picture("examples/compensation.nc", MILL, "docs/compensation.svg");
}

#[test]
fn the_picture_of_the_experiment_is_what_its_command_draws() {
    check_picture(
        "examples/pico.nc",
        "examples/pico.settings",
        "docs/pico.svg",
    );
    check_picture(
        "docs/step-arcs.nc",
        "examples/pico.settings",
        "docs/step-arcs.svg",
    );
}

#[test]
fn quality_and_picture_follow_a_compensated_contour() {
    let folder = tempfile::tempdir().unwrap();
    let plot = folder.path().join("contour.svg").display().to_string();
    let program = "G41.1 D4 F600\nG1 X10\nY10\nG3 X0 Y10 I-5\nG1 Y0\nX-10\nG40 G1 X-10 Y9\n";
    let settings = [
        "--set",
        "$100=80",
        "--set",
        "$101=80",
        "--quality",
        "--plot",
        &plot,
    ];
    let whole = figures(folder.path(), program, &settings);
    assert_eq!(refused(&whole), Vec::<&str>::new());
    let deviation = &whole["quality"]["deviation"];
    let [distance, floor] =
        ["hausdorff_mm", "floor_mm"].map(|key| deviation[key].as_f64().unwrap());
    assert!(distance < 1.5 * floor, "{distance} {floor}");
    let drawn = fs::read_to_string(&plot).unwrap();
    for label in [
        "programmed contour (G41, G42)",
        "cut there by a tool of 4 mm",
    ] {
        assert!(drawn.contains(label), "{label}");
    }
}

/// As many posts write a drilling program: settings of the machine first, inches, a hole given twice.
const DRILLING: &str = "G0 G49 G40 G17 G80 G50 G90
M6 T0
G20
M3 S600
M8
G0 G43 H0 Z0.2
G73 X-2 Y-1 Z-0.5 Q0.15 R0.1 F12
X-1.5
X-1
X-1
X-0.5
X0
X0.5
X1
X1.5
X2
X2.5
G80
M5 M9
M30
";

#[test]
fn a_drilling_program_drills_its_eleven_holes() {
    let folder = tempfile::tempdir().unwrap();
    let plot = folder.path().join("holes.svg").display().to_string();
    let settings = [
        "--set", "$100=80", "--set", "$102=80", "--set", "$28=0.25", "--plot", &plot,
    ];
    let whole = figures(folder.path(), DRILLING, &settings);
    assert_eq!(refused(&whole), Vec::<&str>::new());
    // Up to 0.2 in, eleven times to -0.5 in and up again, and three times lifted by 0.25 mm in each.
    let inches = 0.2 + 11.0 * 2.0 * 0.7;
    let expected = (inches * 25.4 + 11.0 * 3.0 * 2.0 * 0.25) * 80.0;
    let steps = whole["steps_axis"][2].as_f64().unwrap();
    assert!((steps - expected).abs() < 100.0, "{steps}, not {expected}");
    let drawn = fs::read_to_string(&plot).unwrap();
    assert!(drawn.contains("holes: 11 × G73"));
    // Named at the first one in each view, and once in the legend.
    assert_eq!(drawn.matches("G73").count(), 3);
}
