//! The verb as it is typed.

use std::{env, fs, process};

use clap::Parser;
use serde_json::Value;

use super::{Options, run};

/// What follows `cargo xtask sim`.
#[derive(Parser)]
struct Typed {
    #[command(flatten)]
    options: Options,
}

#[test]
fn quality_is_measured_where_it_is_asked_for() {
    let folder = env::temp_dir().join(format!("leadscrew-quality-{}", process::id()));
    fs::create_dir_all(&folder).unwrap();
    let [program, json, plot] = ["part.nc", "out.json", "out.svg"].map(|name| folder.join(name));
    fs::write(&program, "G1 X10 F400\nY10\nG2 X15 Y15 I5 J0\n").unwrap();
    let [program, json, plot] = [program, json, plot].map(|path| path.display().to_string());
    let typed = |more: &[&str]| {
        let fixed = [
            "sim", &program, "--set", "$120=500", "--set", "$121=500", "--json", &json,
        ];
        let line = fixed.iter().chain(more);
        run(&Typed::try_parse_from(line).unwrap().options).unwrap();
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
        assert!((480.0..520.0).contains(&acceleration), "{axis}");
        assert_eq!(axis["acceleration_limit_mm_s2"], 500.0);
        assert!(number(&axis["jerk_mm_s3"]["value"]) > 0.0);
    }
    assert!(number(&quality["path"]["acceleration_mm_s2"]["value"]) > 480.0);
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
        "acceleration, mm/s²",
        "jerk, 1000 mm/s³",
        "from the programmed path",
    ] {
        assert!(drawn.contains(label), "{label}");
    }
    fs::remove_dir_all(&folder).unwrap();
}
