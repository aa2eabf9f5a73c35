//! Ctrl-C as something to wait for, so that whatever is in progress can be finished.

use std::os::unix::net::UnixStream;

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
