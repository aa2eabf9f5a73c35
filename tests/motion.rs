//! Moves as the step pins show them: exact counts, limits kept, path kept.

mod support;

use leadscrew::{
    axis::Axes,
    planner::{Command, Entry, Pace, Router},
    protocol::realtime::Requests,
    settings::Settings,
    sim::{Drive, Edge},
    units::Nm,
};

fn line(x: f64, y: f64, z: f64, mm_min: f32) -> Command {
    let mut target = Axes::all(Nm(0));
    for (axis, mm) in [x, y, z].into_iter().enumerate() {
        target[axis] = Nm::from_mm_f64(mm);
    }
    Command::Line {
        target: target.into(),
        pace: Pace::Feed(mm_min),
        line: 0,
    }
}

fn execute(settings: &Settings, commands: &[Command]) -> Vec<Edge> {
    let requests = Requests::new();
    let mut drive = Drive::new(settings);
    let mut router = Router::new(settings);
    let mut commands = commands.iter();
    let mut waiting = None;
    let mut edges = Vec::new();
    let mut now = 0;
    loop {
        while waiting.is_none() {
            let Some(command) = commands.next() else {
                break;
            };
            waiting = router.work(command).map(|work| Entry { epoch: 0, work });
        }
        if let Some(entry) = waiting.take()
            && let Err(entry) = drive.entries.enqueue(entry)
        {
            waiting = Some(entry);
        }
        drive.release_prepare();
        while drive.prepare(&requests, now) {}
        match drive.due() {
            Some(due) => {
                now = due;
                edges.extend(drive.step());
            }
            None if waiting.is_none() && commands.len() == 0 => return edges,
            None => {}
        }
    }
}

#[test]
fn a_line_makes_its_steps() {
    let settings = support::fast();
    let edges = execute(&settings, &[line(10.0, -5.0, 2.5, 3000.0)]);
    let steps = support::net_steps(&edges);
    assert_eq!(&steps.0[..3], [800, -400, 200]);
}
