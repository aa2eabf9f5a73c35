//! Ctrl-C, and what else ends a program, as something to wait for: whatever is in progress can be finished.

use std::{fs, io::Read as _, os::unix::net::UnixStream, path::PathBuf, process, thread};

use anyhow::{Context, Result};
use signal_hook::consts::{SIGHUP, SIGINT, SIGQUIT, SIGTERM};

/// Returns what becomes readable with Ctrl-C, with Ctrl-\, when the terminal is closed, and when another process ends
/// this one. Under `nohup` the terminal may be closed.
pub fn interruptions() -> Result<UnixStream> {
    let catch = || {
        let (read, write) = UnixStream::pair()?;
        let status = fs::read_to_string("/proc/self/status").unwrap_or_default();
        let signals = [SIGINT, SIGTERM, SIGQUIT, SIGHUP].into_iter();
        for signal in signals.filter(|signal| !is_ignored(*signal, &status)) {
            signal_hook::low_level::pipe::register(signal, write.try_clone()?)?;
        }
        std::io::Result::Ok(read)
    };
    catch().context("cannot catch Ctrl-C")
}

/// Set where a program is another one's, and has to end when that one is killed.
pub const OWNED: &str = "LEADSCREW_OWNED";

/// Has the program end with the one that has started it, if that wants it so: on Linux.
pub fn end_with_owner() -> Result<()> {
    #[cfg(target_os = "linux")]
    if std::env::var_os(OWNED).is_some() {
        let signal = Some(rustix::process::Signal::TERM);
        rustix::process::set_parent_process_death_signal(signal)
            .context("cannot end with the program that has started this one")?;
    }
    Ok(())
}

/// Whether a process ignores a signal, by what Linux says of the process.
fn is_ignored(signal: i32, status: &str) -> bool {
    let mut lines = status.lines();
    let ignored = lines.find_map(|line| line.strip_prefix("SigIgn:"));
    let ignored = ignored.and_then(|mask| u64::from_str_radix(mask.trim(), 16).ok());
    ignored.is_some_and(|mask| mask >> (signal - 1) & 1 != 0)
}

/// The exit status of a program that Ctrl-C has ended, as shells have it.
const INTERRUPTED: i32 = 130;

/// Has Ctrl-C end the program, without files, and empty folders, that are not whole yet.
pub fn remove_when(mut interrupted: UnixStream, unfinished: Vec<PathBuf>) {
    thread::spawn(move || {
        if interrupted.read_exact(&mut [0]).is_ok() {
            for path in unfinished {
                let _ = fs::remove_file(&path).or_else(|_| fs::remove_dir(&path));
            }
            process::exit(INTERRUPTED);
        }
    });
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_signal_that_is_ignored_stays_ignored() {
        let status = "Name:\tsend\nSigBlk:\t0000000000000000\nSigIgn:\t0000000000001001\n";
        assert!(is_ignored(SIGHUP, status));
        assert!(!is_ignored(SIGQUIT, status));
        assert!(!is_ignored(SIGHUP, ""));
    }
}
