//! Worst-case execution and response times of an RTIC application, from its ELF file.
//!
//! The ELF is read into an image and decoded into functions of blocks, and the longest path of each
//! function is found. The longest paths, the priorities of the application and the releases of its
//! tasks give a response time for each task. Code without a bound is a [`Flaw`], never a guess.
//! `proof/README.md` has the order of the analysis, module by module.
#![forbid(unsafe_code)]
#![allow(
    clippy::must_use_candidate,
    reason = "a library of the tools beside it"
)]

mod analyse;
mod annotations;
mod believed;
mod bounds;
mod budget;
mod busy_waits;
mod calibration;
mod calls;
#[cfg(test)]
#[path = "../../../tests/support/cases.rs"]
mod cases;
mod certificate;
mod code_in_ram;
mod config;
mod confirm;
mod counted_loops;
mod crosscheck;
pub mod decode;
mod errata;
mod figures;
mod findings;
mod flaw;
mod formula;
mod functions;
mod graph;
mod guarded_stores;
mod image;
mod instruction;
mod library_flaws;
mod loops;
mod memo;
mod model;
mod modes;
mod paths;
mod persistence;
mod persistent_window;
mod pin_edge_jitter;
mod preempting_tasks;
mod program;
mod races;
mod registers;
mod releases;
pub mod replay;
mod report;
mod requirements;
mod response;
mod restored_masks;
mod row_demand;
mod rta;
mod rtic;
mod sections;
mod source_files;
mod stack;
mod startup;
mod substitution;
mod system;
mod task_lines;
mod tasks_without_deadline;
#[cfg(test)]
mod testing;
mod totals;
mod unanalysed_code;
mod value_analysis;
mod values;
mod walks;
mod wcet;
mod worst_path;

pub use analyse::{Input, analyse, certify};
pub use annotations::Annotations;
pub use calibration::Measured;
pub use config::{Config, LongRows, Point, Replay};
pub use confirm::confirm;
pub use decode::Decoder;
pub use flaw::{Flaw, Place, Rule};
pub use formula::Formula;
pub use graph::{raises, restores};
pub use image::{Extent, Frame, Image};
pub use instruction::{Address, Instruction, Operation, Writeback};
pub use model::{Cache, Clock, Model, lines};
pub use program::{Block, Bound, Count, Edge, Function, Loop, Program, Region, Runs, Store, Total};
pub use report::{
    BelievedLoop, Curve, KnownFigures, Line, LoopCounts, Report, Requirement, Section, Stack,
    Stream, SubstitutedRuns, Task, TasksWithoutDeadline, UncountedLoops, UndeadlinedWait, Wcet,
    Window, link,
};
pub use rtic::{App, AppTask};
pub use source_files::SourceFile;
pub use task_lines::lines_of_tasks;
pub use wcet::Functions;

#[cfg(test)]
use cases::cases;
