//! A pseudo-terminal: what a program opens as a serial port.

use std::{
    fs,
    os::{
        fd::{AsFd, BorrowedFd, OwnedFd},
        unix::fs::symlink,
    },
    path::{Path, PathBuf},
};

use anyhow::{Context, Result};
use rustix::{
    fs::{Mode, OFlags},
    pty::OpenptFlags,
    termios::OptionalActions,
};

/// A link that goes when the program ends.
pub struct Link(PathBuf);

impl Drop for Link {
    fn drop(&mut self) {
        let _ = fs::remove_file(&self.0);
    }
}

/// A pseudo-terminal in raw mode.
pub struct Pty {
    controller: OwnedFd,
    /// Kept open so that the line stays up while no sender has it.
    _terminal: OwnedFd,
    name: PathBuf,
}

impl Pty {
    /// Opens a new one, to which `path` becomes a link.
    pub fn at(path: &Path) -> Result<(Self, Link)> {
        let is_there = fs::symlink_metadata(path);
        let may_go = is_there.is_ok_and(|metadata| metadata.is_symlink());
        if may_go {
            // A link that an earlier run left behind.
            fs::remove_file(path).with_context(|| format!("cannot replace {}", path.display()))?;
        }
        let pty = Self::open()?;
        symlink(&pty.name, path).with_context(|| {
            format!(
                "cannot create {} as a link to {}",
                path.display(),
                pty.name.display()
            )
        })?;
        Ok((pty, Link(path.to_owned())))
    }

    /// The end that is not the terminal.
    pub fn controller(&self) -> BorrowedFd<'_> {
        self.controller.as_fd()
    }

    fn open() -> Result<Self> {
        let open = || -> rustix::io::Result<Self> {
            let controller = rustix::pty::openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY)?;
            rustix::pty::grantpt(&controller)?;
            rustix::pty::unlockpt(&controller)?;
            let name = rustix::pty::ptsname(&controller, Vec::new())?;
            let name = PathBuf::from(name.to_string_lossy().into_owned());
            let terminal = rustix::fs::open(&name, OFlags::RDWR | OFlags::NOCTTY, Mode::empty())?;
            let mut mode = rustix::termios::tcgetattr(&terminal)?;
            mode.make_raw();
            rustix::termios::tcsetattr(&terminal, OptionalActions::Now, &mode)?;
            let flags = rustix::fs::fcntl_getfl(&controller)?;
            rustix::fs::fcntl_setfl(&controller, flags | OFlags::NONBLOCK)?;
            Ok(Self {
                controller,
                _terminal: terminal,
                name,
            })
        };
        open().context("cannot open a pseudo-terminal")
    }
}
