//! Programs of others beside tests: an environment of Python, filled by pip, in the folder of build results.

use std::{
    fmt, fs,
    hash::{DefaultHasher, Hash as _, Hasher as _},
    path::{Path, PathBuf},
    process::{self, Command, Stdio},
};

use anyhow::{Context, Result, bail, ensure};

use crate::{cargo, ui};

/// The system's Python, for what needs no package.
pub fn plain_python() -> Result<PathBuf> {
    ensure!(
        cargo::is_there("python3"),
        Unavailable(
            "python3 is not installed (Debian, Ubuntu: `sudo apt-get install python3`)".into()
        )
    );
    Ok("python3".into())
}

/// The oldest Python that will do.
const OLDEST_PYTHON: (u32, u32) = (3, 9);

/// Why something cannot be had on this computer, which is no fault of the project: the error of [`python`] then is one
/// of these.
#[derive(Debug)]
pub struct Unavailable(String);

impl fmt::Display for Unavailable {
    fn fmt(&self, to: &mut fmt::Formatter<'_>) -> fmt::Result {
        to.write_str(&self.0)
    }
}

/// A Python in a folder beside `home` with the packages of a list, which the user is told as `what`.
///
/// Each list and each version of Python have a folder of their own, which is filled under another name and never
/// changed: another process may be using it.
pub fn python(home: &Path, list: &Path, what: &str) -> Result<PathBuf> {
    environment(&plain_python()?, home, list, what)
}

fn environment(system: &Path, home: &Path, list: &Path, what: &str) -> Result<PathBuf> {
    let wanted = fs::read(list).with_context(|| format!("cannot read {}", list.display()))?;
    let version = python_version(system)?;
    let mut hasher = DefaultHasher::new();
    (&wanted, &version).hash(&mut hasher);
    let home = suffixed(home, &format!("{:016x}", hasher.finish()));
    let program = home.join("bin/python");
    if !home.exists() {
        ui::status("Installing", &format!("{what} with pip"));
        let own = suffixed(&home, &process::id().to_string());
        let filled = fill(&own, system, list, what).and_then(|()| move_to(&own, &home));
        // What has failed, or came second.
        let _ = fs::remove_dir_all(&own);
        filled?;
    }
    ensure!(
        cargo::is_there(&program.to_string_lossy()),
        "{} does not start: remove {}",
        program.display(),
        home.display()
    );
    Ok(program)
}

/// A path with more behind its name.
fn suffixed(path: &Path, suffix: &str) -> PathBuf {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    path.with_file_name(format!("{name}-{suffix}"))
}

/// Makes an environment with the packages of a list.
fn fill(folder: &Path, system: &Path, list: &Path, what: &str) -> Result<()> {
    // Of a process that had this one's number.
    let _ = fs::remove_dir_all(folder);
    fs::create_dir_all(folder).with_context(|| format!("cannot make {}", folder.display()))?;
    quietly(Command::new(system).args(["-m", "venv"]).arg(folder)).context(Unavailable(
        "Python cannot make an environment (Debian, Ubuntu: `sudo apt-get install python3-venv`)"
            .into(),
    ))?;
    // The list is whole: what it does not name is not used.
    let mut pip = Command::new(folder.join("bin/python"));
    pip.args([
        "-m",
        "pip",
        "install",
        "--no-deps",
        "--disable-pip-version-check",
    ]);
    quietly(pip.arg("--requirement").arg(list))
        .with_context(|| Unavailable(format!("pip cannot install {what}")))
}

/// Gives a folder its name, unless another process was first, which has made the same.
fn move_to(own: &Path, home: &Path) -> Result<()> {
    match fs::rename(own, home) {
        Err(error) if !home.exists() => {
            Err(error).with_context(|| format!("cannot make {}", home.display()))
        }
        _ => Ok(()),
    }
}

/// The version of a Python, which is new enough.
fn python_version(python: &Path) -> Result<String> {
    let asked = Command::new(python).arg("--version").output()?;
    let output_text = String::from_utf8_lossy(&asked.stdout);
    let version = output_text.trim().trim_start_matches("Python ").to_owned();
    let mut numbers = version.split('.').map_while(|part| part.parse().ok());
    let found = (numbers.next().unwrap_or(0), numbers.next().unwrap_or(0));
    let (major, minor) = OLDEST_PYTHON;
    ensure!(
        found >= OLDEST_PYTHON,
        Unavailable(format!(
            "Python {version} is too old: {major}.{minor} or newer is needed"
        ))
    );
    Ok(version)
}

/// Whether all that is wanted has been installed.
pub fn is_noted(home: &Path, wanted: &str) -> bool {
    fs::read_to_string(home.join("installed")).is_ok_and(|installed| installed == wanted)
}

/// Notes that all that is wanted has been installed.
pub fn note(home: &Path, wanted: &str) -> Result<()> {
    fs::write(home.join("installed"), wanted).context("cannot take note of the installation")
}

/// Runs a command to its end; what it says is told only when it fails.
pub fn quietly(command: &mut Command) -> Result<()> {
    let output = command.stdin(Stdio::null()).output()?;
    if output.status.success() {
        return Ok(());
    }
    let output_text = [output.stdout, output.stderr].concat();
    let output_text = String::from_utf8_lossy(&output_text);
    let last: Vec<_> = output_text.lines().rev().take(5).collect();
    let last: Vec<_> = last.into_iter().rev().collect();
    bail!("{}", last.join("\n"));
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_noted_is_installed_until_something_else_is_wanted() {
        let home = tempfile::tempdir().unwrap();
        assert!(!is_noted(home.path(), "printrun==2"));
        note(home.path(), "printrun==2").unwrap();
        assert!(is_noted(home.path(), "printrun==2"));
        assert!(!is_noted(home.path(), "printrun==3"));
    }

    /// A Python of a version that makes environments with itself in them, and fails at a step.
    #[cfg(unix)]
    fn false_python(folder: &Path, version: &str, fails_at: &str) -> PathBuf {
        let script = format!(
            "#!/bin/sh
case \"$*\" in
  '-m {fails_at} '*) echo no {fails_at}; exit 1 ;;
  --version) echo Python {version} ;;
  '-m venv '*) mkdir -p \"$3/bin\"; cp \"$0\" \"$3/bin/python\" ;;
esac
"
        );
        let (text, program) = (folder.join("text"), folder.join("python3"));
        fs::write(&text, script).unwrap();
        // By another process: a program that is open for writing cannot be started.
        let mut install = Command::new("install");
        quietly(install.args(["-m", "755"]).arg(&text).arg(&program)).unwrap();
        program
    }

    #[test]
    #[cfg(unix)]
    fn an_environment_is_made_once_for_each_list_and_python_and_never_changed() {
        let folder = tempfile::tempdir().unwrap();
        let (home, list) = (folder.path().join("python"), folder.path().join("list"));
        fs::write(&list, "printrun==2").unwrap();
        let make = |version, fails_at| {
            let system = false_python(folder.path(), version, fails_at);
            environment(&system, &home, &list, "Printrun")
        };
        let first = make("3.9.2", "nothing").unwrap();
        // Nothing is installed any more.
        assert_eq!(make("3.9.2", "venv").unwrap(), first);
        let second = make("3.10.0", "nothing").unwrap();
        fs::write(&list, "printrun==3").unwrap();
        let third = make("3.10.0", "nothing").unwrap();
        assert!(first != second && second != third);
        assert!([&first, &second, &third].iter().all(|it| it.exists()));
        fs::remove_file(&third).unwrap();
        let message = make("3.10.0", "nothing").unwrap_err().to_string();
        assert!(message.contains("does not start: remove "), "{message}");
    }

    #[test]
    #[cfg(unix)]
    fn what_python_or_pip_cannot_do_is_distinguished_from_faults() {
        let folder = tempfile::tempdir().unwrap();
        let (home, list) = (folder.path().join("python"), folder.path().join("list"));
        fs::write(&list, "printrun==2").unwrap();
        for (version, fails_at, reason) in [
            (
                "3.8.19",
                "nothing",
                "Python 3.8.19 is too old: 3.9 or newer is needed",
            ),
            ("3.9.0", "venv", "python3-venv`): no venv"),
            ("3.9.0", "pip", "pip cannot install Printrun: no pip"),
        ] {
            let system = false_python(folder.path(), version, fails_at);
            let error = environment(&system, &home, &list, "Printrun").unwrap_err();
            let message = format!("{error:#}");
            assert!(message.contains(reason), "{message}");
            assert!(error.is::<Unavailable>(), "{message}");
        }
        let left = fs::read_dir(folder.path()).unwrap().count();
        assert_eq!(left, 3, "the list, and the Python with its text");
        let system = false_python(folder.path(), "3.9.0", "nothing");
        // A file where a folder has to be, and no list.
        for (home, list) in [
            (list.join("python"), &list),
            (home, &folder.path().join("none")),
        ] {
            let error = environment(&system, &home, list, "Printrun").unwrap_err();
            assert!(!error.is::<Unavailable>(), "{error:#}");
        }
    }

    #[test]
    fn the_environment_of_the_process_that_was_first_is_used() {
        let folder = tempfile::tempdir().unwrap();
        let home = folder.path().join("python");
        for name in ["first", "second"] {
            let own = folder.path().join(name);
            fs::create_dir(&own).unwrap();
            fs::write(own.join("name"), name).unwrap();
            move_to(&own, &home).unwrap();
        }
        assert_eq!(fs::read_to_string(home.join("name")).unwrap(), "first");
        assert!(move_to(&folder.path().join("third"), &folder.path().join("there")).is_err());
    }

    #[test]
    fn a_command_that_fails_is_reported_with_its_last_words() {
        assert!(quietly(Command::new("sh").args(["-c", "echo fine"])).is_ok());
        let mut broken = Command::new("sh");
        broken.args(["-c", "for i in 1 2 3 4 5 6; do echo $i; done; exit 1"]);
        let error = quietly(&mut broken).unwrap_err();
        assert_eq!(error.to_string(), "2\n3\n4\n5\n6");
    }
}
