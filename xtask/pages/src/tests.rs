//! Pages of jobs: how large they are.

use std::io::Cursor;

use leadscrew::{
    settings::{Settings, StepRate, assign},
    sim::Simulator,
};
use simulation::{Job, Recording};
use simulation::{
    play::{self, Run},
    program::Program,
};

use crate::{cases::rounds, page};

/// Runs a program.
fn run(settings: &Settings, program: &str) -> Job {
    let mut simulator = Box::new(Simulator::new(settings));
    let mut recording = Recording::new(simulator.session());
    let program = Program::from_reader(
        "a test".into(),
        Cursor::new(program.to_owned().into_bytes()),
    );
    let run = Run::silent(&mut recording);
    let figures = play::stream(program, &mut simulator, run).expect("it comes to an end");
    recording.finish(&figures, "test.nc", settings)
}

fn mill() -> Settings {
    let mut settings = Settings::new(StepRate::Proven(190_000));
    for statement in [
        "100=320", "101=320", "102=400", "110=5000", "111=5000", "112=3000", "120=500", "121=500",
    ] {
        assign(&mut settings, statement.as_bytes()).expect("the mill's settings are accepted");
    }
    settings
}

#[test]
fn nothing_and_standstill_have_a_page_too() {
    for program in ["", "(nothing)\n", "G4P0.1\n", "G999\n"] {
        let job = run(&mill(), program);
        assert_eq!(job.path.vertices, 0, "{program}");
        assert!(page::write(&job).contains("pack-path"));
    }
}

/// A relief as lasers burn it: lines of a raster whose power changes each millimetre.
fn relief(lines: usize) -> String {
    let line = |number: usize| {
        let (row, column) = (number / 200, number % 200);
        let power = (row * 37 + column * 101) % 1000;
        match column {
            0 => "G0Y0.1\n".to_owned(),
            _ if row % 2 == 0 => format!("G1X0.5S{power}\n"),
            _ => format!("G1X-0.5S{power}\n"),
        }
    };
    let head = "G21G91\nM4S0\nG1F6000\n".to_owned();
    std::iter::once(head).chain((0..lines).map(line)).collect()
}

#[test]
fn a_page_of_200_000_lines_has_at_most_2_megabytes() {
    let mut settings = mill();
    assign(&mut settings, b"32=1").expect("a laser may be set");
    let size = |lines: usize| page::write(&run(&settings, &relief(lines))).len();
    let lines = rounds(2000) as usize;
    let [few, many] = [lines, 3 * lines].map(size);
    // 2 MB for 200 000 lines, with 150 KB for the page itself and its curves.
    let most = 2 * lines * (2_000_000 - 150_000) / 200_000;
    assert!(
        many - few <= most,
        "{} bytes for {} lines",
        many - few,
        2 * lines
    );
}

#[test]
fn the_page_itself_is_small() {
    let job = run(&mill(), "G0X1\n");
    let size = page::write(&job).len();
    assert!(size < 105_000, "{size} bytes");
}

#[test]
fn the_path_of_a_core_xy_machine_is_that_of_its_tool() {
    let mut settings = mill();
    assign(&mut settings, b"795=1").expect("a machine may have belts");
    let points = run(&settings, "G1X10F600\nY5\n").waypoints();
    let is_of_x = |point: &simulation::Waypoint| point.place[1] == 0.0;
    assert!(points.iter().take_while(|point| is_of_x(point)).count() > 2);
    let last = points.last().expect("it moves");
    assert_eq!(last.place[..3], [10.0, 5.0, 0.0]);
}
