//! Ctrl-C as something to wait for, so that whatever is in progress can be finished.

use std::{fs, io::Read as _, os::unix::net::UnixStream, path::PathBuf, process, thread};

use anyhow::{Context, Result};

/// Returns what becomes readable with Ctrl-C.
pub fn interruptions() -> Result<UnixStream> {
    let catch = || {
        let (read, write) = UnixStream::pair()?;
        for signal in [signal_hook::consts::SIGINT, signal_hook::consts::SIGTERM] {
            signal_hook::low_level::pipe::register(signal, write.try_clone()?)?;
        }
        std::io::Result::Ok(read)
    };
    catch().context("cannot catch Ctrl-C")
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
