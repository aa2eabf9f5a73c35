//! The switches, the probe plate and the block on it that a virtual machine may have.

use std::array;

use leadscrew::{
    axis::{AXES, X, Y, Z},
    model::Levels,
    settings::Settings,
    sim::{Closes, ProbeBlock, Simulator, Switch},
};

/// How far the lower switches are beyond the travel, mm.
const BEYOND_MM: f64 = 1.0;
/// How high the plate for the probe is above the low end of Z, mm.
const PLATE_MM: f64 = 10.0;
/// Where the block begins and ends in X and Y, from the low ends and in parts of the travel: not below the middle, where
/// the machine stands at power-up. How high it is above the plate, in parts of the travel of Z.
const BLOCK_SPAN: [f64; 2] = [0.125, 0.375];
const BLOCK_HEIGHT: f64 = 0.1;

/// Where switches close, in steps from where the machine stands at power-up: the middle.
pub struct SwitchPositions {
    /// The limit switch of each axis at its lower end and below. It is farther away than the travel:
    /// an axis that was homed above has all of its travel.
    pub low: [i32; AXES],
    /// The limit switch of each axis at its upper end and above.
    pub high: [i32; AXES],
    /// The plate for the probe, above the lower end of Z.
    pub plate: i32,
    /// The block on the plate, for the probe as well.
    pub block: Option<ProbeBlock>,
}

impl SwitchPositions {
    /// Of a machine with as much travel as these settings say.
    pub fn of(settings: &Settings) -> Self {
        let steps = |axis: usize, distance_mm: f64| {
            let scale = settings.steps_per_mm[axis].millionths() as f64 * 1e-6;
            (distance_mm * scale).round() as i32
        };
        let half_mm = settings
            .max_travel_mm
            .0
            .map(|travel| f64::from(travel) / 2.0);
        let block = |part: f64| [X, Y].map(|axis| steps(axis, half_mm[axis] * (2.0 * part - 1.0)));
        let ([left, front], [right, back]) = (block(BLOCK_SPAN[0]), block(BLOCK_SPAN[1]));
        let plate = steps(Z, -half_mm[Z] + PLATE_MM);
        let height = steps(Z, 2.0 * half_mm[Z] * BLOCK_HEIGHT);
        Self {
            low: array::from_fn(|axis| steps(axis, -half_mm[axis] - BEYOND_MM)),
            high: array::from_fn(|axis| steps(axis, half_mm[axis])),
            plate,
            block: Some(ProbeBlock {
                low: [left, front, plate],
                high: [right, back, plate + height],
                input: Levels::PROBE,
            }),
        }
    }

    /// Mounts the switches, the plate and the block on a machine.
    pub fn mount_on(&self, simulator: &mut Simulator) {
        let limits = (0..AXES).flat_map(|axis| {
            let ends = [
                Closes::From(self.high[axis]),
                Closes::DownFrom(self.low[axis]),
            ];
            ends.map(|closes| (axis, closes, Levels::limits(1 << axis)))
        });
        let plate = (Z, Closes::DownFrom(self.plate), Levels::PROBE);
        for (axis, closes, input) in limits.chain([plate]) {
            let is_mounted = simulator.mount(Switch {
                axis,
                closes,
                input,
            });
            assert!(
                is_mounted,
                "there is room for two switches of each axis and the plate"
            );
        }
        if let Some(block) = self.block {
            simulator.put(block);
        }
    }
}
