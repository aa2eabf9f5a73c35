//! Shared by the tests: the machine behind its serial line, a rig that plays commands without a session, and rules
//! that a trace must keep.
#![allow(dead_code, unused_imports, reason = "each test uses a part of it")]

mod cases;
mod cell;
mod limits;
mod machine;
mod path;
mod profile;
mod pulses;
mod recording;
mod rig;
mod trace;

pub(crate) use {
    cases::*, cell::*, host::*, limits::*, machine::*, path::*, profile::*, pulses::*,
    recording::*, rig::*, trace::*,
};

mod host {
    use leadscrew::{
        axis::Axes,
        model::{Circle, Command, FeedRate, Plane, Requests, Rotation, Target, core_xy},
        protocol::Bytes,
        settings::{Settings, StepRate},
        sim::Drive,
        units::{Nm, StepsPerMm},
    };

    /// Required step rate: steps of all axes together, per second.
    pub(crate) const PROVEN: StepRate = StepRate::Proven(150_000);

    /// A realtime byte arrives at a drive without a session.
    pub(crate) fn receive(drive: &mut Drive, requests: &Requests, byte: u8) {
        let mut line = Bytes::<4>::new();
        drive.receive(Ok(byte), requests, &mut line.split().0);
        assert!(line.is_empty(), "{byte:#x} is no realtime byte");
    }

    /// 80 steps/mm, 5000 mm/min, 500 mm/s² on every axis.
    pub(crate) fn fast() -> Settings {
        with(&[80.0], &[5000.0], &[500.0])
    }

    /// Resolutions in steps/mm, rates in mm/min, accelerations in mm/s²; the last is for the rest.
    pub(crate) fn with(steps_per_mm: &[f64], rate: &[f32], acceleration: &[f32]) -> Settings {
        fn pick<T: Copy>(values: &[T], axis: usize) -> T {
            values[axis.min(values.len() - 1)]
        }
        Settings {
            steps_per_mm: Axes::from_fn(|axis| {
                let millionths = (pick(steps_per_mm, axis) * 1.0e6).round() as u64;
                StepsPerMm::from_millionths(millionths).unwrap()
            }),
            max_rate_mm_min: Axes::from_fn(|axis| pick(rate, axis)),
            acceleration_mm_s2: Axes::from_fn(|axis| pick(acceleration, axis)),
            ..Settings::new(PROVEN)
        }
    }

    /// A position from its first coordinates, mm; the rest is 0.
    pub(crate) fn at(mm: &[f64]) -> Axes<Nm> {
        Axes::from_fn(|axis| Nm::from_mm_f64(mm.get(axis).copied().unwrap_or(0.0)))
    }

    pub(crate) fn line(mm: &[f64], mm_min: f32) -> Command {
        line_at(at(mm), FeedRate::Feed(mm_min))
    }

    pub(crate) fn line_at(target: impl Into<Target>, feed_rate: FeedRate) -> Command {
        Command::Line {
            target: target.into(),
            feed_rate,
            line: 0,
        }
    }

    /// An arc of up to one turn.
    pub(crate) fn arc(
        plane: Plane,
        rotation: Rotation,
        target: &[f64],
        centre: [f64; 2],
        mm_min: f32,
    ) -> Command {
        Command::Arc {
            target: at(target).into(),
            circle: Circle {
                plane,
                centre: centre.map(Nm::from_mm_f64),
                rotation,
                turns: 1,
                tilt: leadscrew::units::MicroDegrees::ZERO,
            },
            feed_rate: FeedRate::Feed(mm_min),
            line: 0,
        }
    }

    /// The steps of the motors at which commands end.
    pub(crate) fn target_steps(settings: &Settings, target: &Axes<Nm>) -> Axes<i32> {
        let target = if settings.core_xy {
            core_xy::motors_of(*target)
        } else {
            *target
        };
        settings.steps_per_mm.zip(target, |resolution, nm| {
            resolution.steps_as_grbl(nm, nm.to_mm()).0.0
        })
    }

    /// End position of a command.
    pub(crate) fn target(command: &Command) -> Option<Axes<Nm>> {
        match command {
            Command::Line { target, .. } | Command::Arc { target, .. } => Some(target.position),
            _ => None,
        }
    }

    /// The same command with a line number.
    pub(crate) fn numbered(command: &Command, number: u32) -> Command {
        let mut command = *command;
        if let Command::Line { line, .. } | Command::Arc { line, .. } = &mut command {
            *line = number;
        }
        command
    }

    /// Numbers commands from 1.
    pub(crate) fn number(commands: &[Command]) -> Vec<Command> {
        (1..).zip(commands).map(|(n, c)| numbered(c, n)).collect()
    }
}
