//! What tools show and leave: progress bars and files of JSON.

use std::{
    ffi::OsString,
    fs::{self, File, Metadata, Permissions},
    io::{BufWriter, IntoInnerError, Write},
    os::unix::fs::PermissionsExt as _,
    path::{Path, PathBuf},
    time::Duration,
};

use anyhow::{Context, Result, anyhow, bail};
use indicatif::{ProgressBar, ProgressStyle};
use serde::Serialize;
use tempfile::NamedTempFile;

/// Bytes that are written together.
const BUFFER: usize = 1 << 18;

/// A file that is there when it is whole, and until then lies beside its place under another name.
pub struct Output {
    path: PathBuf,
    writer: Writer,
}

enum Writer {
    /// What will be renamed.
    Temporary(BufWriter<NamedTempFile>),
    /// What is no file, as a pipe, is written as it comes.
    Through(BufWriter<File>),
}

impl Output {
    /// Creates it, and fails at once where it could not be in the end.
    pub fn create(path: &Path) -> Result<Self> {
        let writer =
            Self::open(path).with_context(|| format!("cannot create {}", path.display()))?;
        // Of a link, the file that it names is written.
        let path = fs::canonicalize(path).unwrap_or_else(|_| path.to_owned());
        Ok(Self { path, writer })
    }

    fn open(path: &Path) -> Result<Writer> {
        let metadata = fs::metadata(path).ok();
        if metadata.as_ref().is_some_and(Metadata::is_dir) {
            bail!("it is a folder");
        }
        if metadata.as_ref().is_some_and(|known| !known.is_file()) {
            let file = File::options().write(true).open(path)?;
            return Ok(Writer::Through(BufWriter::with_capacity(BUFFER, file)));
        }
        if metadata.is_some() {
            // A file that must not be written is not replaced either.
            File::options().append(true).open(path)?;
        }
        let path = fs::canonicalize(path).unwrap_or_else(|_| path.to_owned());
        let name = path.file_name().context("it has no name")?;
        let folder = path
            .parent()
            .filter(|folder| !folder.as_os_str().is_empty());
        let mut prefix = OsString::from(".");
        prefix.push(name);
        prefix.push(".");
        let file = tempfile::Builder::new()
            .prefix(&prefix)
            .suffix(".partial")
            .permissions(Permissions::from_mode(0o666))
            .tempfile_in(folder.unwrap_or(Path::new(".")))
            .map_err(|error| anyhow!("{}", error.kind()))?;
        Ok(Writer::Temporary(BufWriter::with_capacity(BUFFER, file)))
    }

    /// Where it lies until it is whole.
    pub fn partial(&self) -> Option<PathBuf> {
        match &self.writer {
            Writer::Temporary(writer) => Some(writer.get_ref().path().to_owned()),
            Writer::Through(_) => None,
        }
    }

    /// Writes what is still buffered, and gives the file its name.
    pub fn finish(self) -> Result<()> {
        let path = self.path.display().to_string();
        let finish = || -> Result<()> {
            match self.writer {
                Writer::Temporary(writer) => {
                    let file = writer.into_inner().map_err(IntoInnerError::into_error)?;
                    file.persist(&self.path).map_err(|error| error.error)?;
                }
                Writer::Through(mut writer) => writer.flush()?,
            }
            Ok(())
        };
        finish().with_context(|| format!("cannot write {path}"))
    }

    /// Writes a value as JSON, streaming, and gives the file its name.
    pub fn finish_json(mut self, value: &impl Serialize) -> Result<()> {
        serde_json::to_writer(&mut self, value)
            .map_err(std::io::Error::from)
            .and_then(|()| writeln!(self))
            .with_context(|| format!("cannot write {}", self.path.display()))?;
        self.finish()
    }
}

impl Write for Output {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        match &mut self.writer {
            Writer::Temporary(writer) => writer.write(bytes),
            Writer::Through(writer) => writer.write(bytes),
        }
    }

    fn flush(&mut self) -> std::io::Result<()> {
        match &mut self.writer {
            Writer::Temporary(writer) => writer.flush(),
            Writer::Through(writer) => writer.flush(),
        }
    }
}

/// Writes a value as JSON, streaming.
pub fn write_json(path: &Path, value: &impl Serialize) -> Result<()> {
    Output::create(path)?.finish_json(value)
}

/// A progress bar over `length` of something; invisible when standard error is no terminal.
pub fn progress(length: u64, unit: &str) -> ProgressBar {
    let template = format!(
        "{{bar:40.green/dim}} {{percent:>3}} %  {{human_pos}} of {{human_len}} {unit}, {{eta}} left {{msg}}"
    );
    let style = ProgressStyle::with_template(&template)
        .expect("the template is fixed")
        .progress_chars("━╸─");
    let bar = ProgressBar::new(length).with_style(style);
    bar.enable_steady_tick(Duration::from_millis(200));
    bar
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_is_there_when_it_is_whole() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("out.csv");
        fs::write(&path, "before").unwrap();
        let mut output = Output::create(&path).unwrap();
        output.write_all(b"half").unwrap();
        output.flush().unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"before");
        let partial = output.partial().unwrap();
        assert_eq!(fs::read(&partial).unwrap(), b"half");
        assert_eq!(partial.parent(), path.parent());
        output.finish().unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"half");
        assert!(!partial.exists());
        drop(Output::create(&path).unwrap());
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
    }

    #[test]
    fn what_cannot_be_written_fails_at_once() {
        let folder = tempfile::tempdir().unwrap();
        for path in [folder.path().to_owned(), folder.path().join("no/out.csv")] {
            let error = Output::create(&path).err().unwrap().to_string();
            assert_eq!(error, format!("cannot create {}", path.display()));
        }
    }

    #[test]
    fn a_link_stays_one_and_a_device_is_written_through() {
        let folder = tempfile::tempdir().unwrap();
        let [file, link] = ["file", "link"].map(|name| folder.path().join(name));
        fs::write(&file, "").unwrap();
        std::os::unix::fs::symlink(&file, &link).unwrap();
        write_json(&link, &7).unwrap();
        assert_eq!(fs::read(&file).unwrap(), b"7\n");
        assert!(fs::symlink_metadata(&link).unwrap().is_symlink());
        let output = Output::create(Path::new("/dev/null")).unwrap();
        assert_eq!(output.partial(), None);
        output.finish().unwrap();
    }
}
