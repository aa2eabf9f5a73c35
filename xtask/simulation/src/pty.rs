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
    io::FdFlags,
    pty::OpenptFlags,
    termios::OptionalActions,
};

use crate::lock::Lock;

/// A link that goes when the program ends.
pub struct Link {
    path: PathBuf,
    _lock: Lock,
}

impl Link {
    /// Makes it lead to another terminal, at once for whoever opens it.
    pub fn lead_to(&self, pty: &Pty) -> Result<()> {
        let mut temporary = self.path.clone().into_os_string();
        temporary.push(".next");
        let is_made =
            symlink(&pty.name, &temporary).and_then(|()| fs::rename(&temporary, &self.path));
        is_made.with_context(|| format!("cannot replace {}", self.path.display()))
    }
}

impl Drop for Link {
    fn drop(&mut self) {
        let _ = fs::remove_file(&self.path);
    }
}

/// Whether a path is of a pseudo-terminal, as Linux, the BSDs and macOS name them.
fn is_terminal(path: &Path) -> bool {
    let path = path.to_string_lossy();
    ["/dev/pts/", "/dev/ttys", "/dev/ttyp"]
        .iter()
        .any(|begin| path.starts_with(begin))
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
        let lock = Lock::of(path)?;
        // A link that an earlier run left behind; others lead to what is none of this.
        if fs::read_link(path).is_ok_and(|to| is_terminal(&to)) {
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
        let link = Link {
            path: path.to_owned(),
            _lock: lock,
        };
        Ok((pty, link))
    }

    /// The end that is not the terminal.
    pub fn controller(&self) -> BorrowedFd<'_> {
        self.controller.as_fd()
    }

    /// The path of the terminal.
    pub fn name(&self) -> &Path {
        &self.name
    }

    /// Opens a new one.
    pub fn open() -> Result<Self> {
        let open = || -> rustix::io::Result<Self> {
            let controller = rustix::pty::openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY)?;
            rustix::pty::grantpt(&controller)?;
            rustix::pty::unlockpt(&controller)?;
            let name = rustix::pty::ptsname(&controller, Vec::new())?;
            let name = PathBuf::from(name.to_string_lossy().into_owned());
            // The line breaks when this program closes it, whatever others it has started.
            rustix::io::fcntl_setfd(&controller, FdFlags::CLOEXEC)?;
            let flags = OFlags::RDWR | OFlags::NOCTTY | OFlags::CLOEXEC;
            let terminal = rustix::fs::open(&name, flags, Mode::empty())?;
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_link_that_is_served_or_leads_elsewhere_is_not_replaced() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("tty");
        let first = Pty::at(&path).unwrap();
        let name = fs::read_link(&path).unwrap();
        let error = Pty::at(&path).err().unwrap().to_string();
        assert!(
            error.contains(&format!("process {}", std::process::id())),
            "{error}"
        );
        assert_eq!(fs::read_link(&path).unwrap(), name);
        drop(first);
        assert!(fs::read_link(&path).is_err());
        symlink("/dev/pts/987654", &path).unwrap();
        drop(Pty::at(&path).unwrap());
        symlink("/dev/null", &path).unwrap();
        assert!(Pty::at(&path).is_err());
        assert_eq!(fs::read_link(&path).unwrap(), Path::new("/dev/null"));
    }
}
