//! The vocabulary that all layers share: modes, commands, states, requests, queue sizes, times.
//!
//! Plain values, and the atomics that carry requests.

mod alarm;
mod bootloader;
mod command;
pub mod core_xy;
mod cutter;
mod levels;
mod modes;
mod motors;
mod notice;
mod outputs;
mod overrides;
mod power;
pub mod queues;
mod requests;
mod reset_cause;
mod self_test;
mod state;
pub mod timing;
mod xy_rotation;

pub use alarm::Alarm;
pub use bootloader::{Bootloader, Bootloaders};
pub use command::{Circle, Command, FeedRate, Laser, Probing, Target};
pub use cutter::{Cutter, Side};
pub use levels::Levels;
pub use modes::{Coolant, PathControl, PerSystem, Plane, Rotation, Spindle, WorkCoordinates};
pub use motors::{GANGED_AXES, HAS_SECOND_MOTORS, LIMIT_SWITCHES, StandingMotors};
pub use notice::{Notice, Notices};
pub use outputs::Outputs;
pub use overrides::{Override, OverrideSwitches, Overrides, TOOL_CHANGE};
pub use power::Power;
pub use requests::{Awaited, OVERRIDES, ReceivedPosition, Release, Requests, ToolChangeSpan};
pub use reset_cause::ResetCause;
pub use self_test::SelfTestFault;
pub use state::{Probed, State};
pub use xy_rotation::XyRotation;

/// Whether the firmware energises the coils of motors itself, in place of drivers with step and direction.
pub const HAS_PHASES: bool = cfg!(feature = "phases");

/// Whether `$791` may choose half steps: also where a simulator records the coils.
pub const HAS_HALF_STEPS: bool = cfg!(any(feature = "phases", not(target_os = "none")));

/// Whether `$790` may choose arcs in whole steps, and `$794` the stored program.
pub const HAS_ARC_MACHINE: bool = cfg!(arc_machine);

/// Whether the firmware understands the RepRap dialect. The receiver of such firmware takes longer for a
/// byte.
pub const HAS_REPRAP: bool = cfg!(any(feature = "reprap", not(target_os = "none")));
