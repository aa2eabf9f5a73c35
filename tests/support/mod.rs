//! What the tests share.
#![allow(dead_code, reason = "each test uses a part of it")]

#[cfg(not(target_os = "none"))]
pub(crate) use host::*;

#[cfg(not(target_os = "none"))]
mod host {
    use leadscrew::{
        axis::{AXES, Axes},
        settings::Settings,
        sim::Edge,
        units::StepsPerMm,
    };

    /// 80 steps/mm, 5000 mm/min, 500 mm/s² on every axis.
    pub(crate) fn fast() -> Settings {
        Settings {
            steps_per_mm: Axes::all(StepsPerMm::from_millionths(80_000_000).unwrap()),
            max_rate_mm_min: Axes::all(5000.0),
            acceleration_mm_s2: Axes::all(500.0),
            ..Settings::default()
        }
    }

    /// Steps forwards minus steps backwards of each axis.
    pub(crate) fn net_steps(edges: &[Edge]) -> Axes<i32> {
        let mut steps = Axes::all(0);
        for edge in edges {
            for axis in 0..AXES {
                if edge.raise & 1 << axis != 0 {
                    steps[axis] += if edge.directions & 1 << axis == 0 {
                        1
                    } else {
                        -1
                    };
                }
            }
        }
        steps
    }
}
