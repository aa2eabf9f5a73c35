//! A lock file beside a file that only one process may serve, with the name of the holder.

use std::{
    fs::{self, File, TryLockError},
    io::{self, Read as _, Write as _},
    os::unix::fs::{MetadataExt as _, OpenOptionsExt as _},
    path::{Path, PathBuf},
    process,
};

use anyhow::{Context, Result, bail};

use crate::holder::named;

/// A file `PATH.lock` with the number of the process that has it; it goes with the lock.
pub struct Lock {
    path: PathBuf,
    _file: File,
}

impl Lock {
    /// Takes the lock of a path, or says which process has it.
    pub fn of(path: &Path) -> Result<Self> {
        let mut name = path.as_os_str().to_owned();
        name.push(".lock");
        let lock = PathBuf::from(name);
        let open = || {
            File::options()
                .read(true)
                .write(true)
                .create(true)
                .truncate(false)
                // Somebody may have laid a link there, to a file that is not to be written.
                .custom_flags(rustix::fs::OFlags::NOFOLLOW.bits().cast_signed())
                .open(&lock)
        };
        loop {
            let mut file = open().with_context(|| format!("cannot create {}", lock.display()))?;
            match file.try_lock() {
                Ok(()) => {}
                Err(TryLockError::WouldBlock) => {
                    let mut holder = String::new();
                    // One that has just begun has not written it yet.
                    let _ = file.read_to_string(&mut holder);
                    let holder = match holder.trim().parse() {
                        Ok(number) => named(number),
                        Err(_) => "another process".into(),
                    };
                    bail!("{holder} has {}", path.display());
                }
                Err(TryLockError::Error(error)) => {
                    return Err(error).context(format!("cannot lock {}", lock.display()));
                }
            }
            // A holder that has just ended may have removed the file.
            if !is_at(&file, &lock) {
                continue;
            }
            file.set_len(0)
                .and_then(|()| writeln!(file, "{}", process::id()))
                .with_context(|| format!("cannot write {}", lock.display()))?;
            return Ok(Self {
                path: lock,
                _file: file,
            });
        }
    }
}

impl Drop for Lock {
    fn drop(&mut self) {
        let _ = fs::remove_file(&self.path);
    }
}

/// Whether an open file is still the one of a path.
fn is_at(file: &File, path: &Path) -> bool {
    let identity = |metadata: io::Result<fs::Metadata>| {
        metadata
            .ok()
            .map(|metadata| (metadata.dev(), metadata.ino()))
    };
    identity(file.metadata()) == identity(fs::metadata(path))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_second_holder_learns_of_the_first() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("tty");
        let lock = Lock::of(&path).unwrap();
        let error = Lock::of(&path).err().unwrap().to_string();
        assert_eq!(
            error,
            format!("{} has {}", named(process::id()), path.display())
        );
        drop(lock);
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0);
        let victim = folder.path().join("victim");
        fs::write(&victim, "text").unwrap();
        std::os::unix::fs::symlink(&victim, folder.path().join("tty.lock")).unwrap();
        assert!(Lock::of(&path).is_err());
        assert_eq!(fs::read_to_string(&victim).unwrap(), "text");
        fs::remove_file(folder.path().join("tty.lock")).unwrap();
        // What a process leaves behind that was killed.
        fs::write(folder.path().join("tty.lock"), "1234567890\n").unwrap();
        Lock::of(&path).unwrap();
    }
}
