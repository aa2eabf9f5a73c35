//! How a machine is brought to rest before a job.

use std::time::{Duration, Instant};

use anstream::println;
use anyhow::{Error, Result, bail, ensure};
use grbl_client::{
    Machine,
    link::Stopped,
    realtime::{HOLD, RESET},
};

/// How long a machine may take to brake.
const STOP_TIMEOUT: Duration = Duration::from_secs(30);
/// How long it may search its switches.
const HOMING_TIMEOUT: Duration = Duration::from_mins(10);

/// Makes the machine ready for a job: homed or unlocked where that is asked for, at rest.
///
/// # Errors
/// It is in motion, in alarm, or in a hold.
pub(crate) fn make_ready(machine: &mut Machine, homes: bool) -> Result<()> {
    if homes {
        println!("The machine is homed: Ctrl-C stops it.");
        let homed = machine.ask_for("$H", HOMING_TIMEOUT);
        if homed.as_ref().is_err_and(Error::is::<Stopped>) {
            // A machine that homes takes no hold.
            machine.link.send(&[RESET])?;
        }
        homed?;
        machine.report()?;
    }
    match machine.status.report.state_name() {
        "Idle" | "Check" => Ok(()),
        "Alarm" => bail!(
            "the machine is locked: --home homes it, or unlock it with $X if you know where it is"
        ),
        _ => bail!(
            "the machine is in the state {}: a job begins at rest",
            machine.status.report.state
        ),
    }
}

/// Stops a machine that is still busy with an interrupted job, and resets the machine at standstill. No line of the
/// job remains in the machine.
pub(crate) fn wait_for_standstill(machine: &mut Machine) -> Result<()> {
    // The last report may be from before its last lines, or between two of them.
    machine.link.send(&[HOLD])?;
    let start = Instant::now();
    machine.report()?;
    while !machine.status.report.is_at_rest() {
        ensure!(
            start.elapsed() < STOP_TIMEOUT,
            "the machine does not come to rest: it is in the state {}",
            machine.status.report.state
        );
        machine.report()?;
    }
    machine.reset()
}
