//! Flaws: each prevents a proof.

use serde::Serialize;

/// The rule that a flaw breaks.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Rule {
    /// A deadline is missed.
    DeadlineMissed,
    /// A panic can be reached.
    ReachablePanic,
    /// A trap can be reached that is no panic.
    ReachableTrap,
    /// A loop has no bound.
    UnboundedLoop,
    /// Nothing counts a loop of a task without a deadline, and `schedule.toml` does not say what ends it.
    UncountedLoop,
    /// A loop runs more often than its comment says.
    WrongBound,
    /// A bound that nothing counts has no reason, or is that of one call where there may be several.
    BelievedBound,
    /// A loop has two entries.
    IrreducibleLoop,
    /// A function calls itself.
    Recursion,
    /// A call or jump to an address that is computed.
    IndirectCall,
    /// `SVC`, `WFI` and what else a task must not do.
    ForbiddenInstruction,
    /// An encoding that the decoder does not know.
    UnknownInstruction,
    /// Interrupts are off for longer than allowed, or the end is not found.
    CriticalSection,
    /// The binary contradicts the source: vector, priority, ceiling.
    Mismatch,
    /// A store to a register that the proof rests on, or to an address that is not known.
    Register,
    /// Two tasks write the same part of a static, and no lock keeps the more urgent one out.
    Race,
    /// A release that no task counts with.
    Release,
    /// A task with a deadline calls what is exempt.
    Exemption,
    /// A path through a task belongs to none of its modes.
    Mode,
    /// A bound is stated for a loop that waits.
    Wait,
    /// An access whose time is not in the model.
    UncostedAccess,
    /// Floating point in a task that is more urgent than `schedule.toml` allows.
    FloatingPoint,
    /// Code in RAM needs the flash.
    CodeInRam,
    /// The initialisation does things in another order than it has to.
    Startup,
    /// The watchdog is not fed where it has to be.
    Watchdog,
    /// A task has no entry in `schedule.toml`, or an entry no task.
    Configuration,
    /// A requirement of `schedule.toml` is not met.
    Requirement,
    /// The stacks do not fit.
    StackOverflow,
}

impl Rule {
    /// Whether deadlines are proven without it: a wish of the project, or of tasks without deadlines.
    pub const fn is_wish(self) -> bool {
        matches!(self, Self::Requirement | Self::UncountedLoop)
    }
}

/// A place in the program.
#[derive(Debug, Clone, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Default)]
pub struct Place {
    /// The instruction; 0: none.
    pub address: u32,
    /// Functions and lines, innermost first: `function (file:line)`.
    pub frames: Vec<String>,
}

/// One flaw: description, place and remedy.
#[derive(Debug, Clone, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize)]
pub struct Flaw {
    /// Which rule it breaks.
    pub rule: Rule,
    /// The flaw in one sentence.
    pub what: String,
    /// Where.
    pub place: Place,
    /// The remedy.
    pub remedy: String,
}

impl Flaw {
    pub(crate) fn new(
        rule: Rule,
        what: impl Into<String>,
        place: Place,
        remedy: impl Into<String>,
    ) -> Self {
        Self {
            rule,
            what: what.into(),
            place,
            remedy: remedy.into(),
        }
    }
}
