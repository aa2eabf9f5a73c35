//! QEMU with the firmware in it: its serial line, and its memory.

use std::{
    env, fs,
    io::{BufRead, BufReader, Write},
    os::{
        fd::OwnedFd,
        unix::net::{UnixListener, UnixStream},
    },
    path::{Path, PathBuf},
    process::{self, Child, Command, Stdio},
    sync::atomic::{AtomicU32, Ordering},
    thread,
    time::Duration,
};

use anyhow::{Context, Result, bail, ensure};
use grbl_client::{Line, Response};
use leadscrew::{axis::AXES, units::TICKS_PER_SECOND};
use object::{Object, ObjectSymbol};
use serde_json::{Value, json};
use simulation::machine::SwitchPositions;

use super::{Debugger, Patience, patience::Patient, serial::Serial};

/// Where the firmware keeps what its pins have done: 17 words.
const FIGURES: &str = "FIGURES";
const WORDS: usize = 17;
/// Where it finds which contacts are closed: by hand, then where six limit switches close at their
/// lower and upper switches, then the plate for the probe.
const CONTACTS: &str = "CONTACTS";
/// The USART of the sender where the board is the one that QEMU emulates.
pub const FIRST_USART: u8 = 1;
/// QEMU's socket for debuggers.
const DEBUGGER: &str = "debugger";
/// Emulators that this program has started.
static STARTED: AtomicU32 = AtomicU32::new(0);
/// How long QEMU may take to start, and to answer.
const START: Duration = Duration::from_secs(20);

/// A running emulator.
pub struct Emulator {
    qemu: Child,
    /// Holds its sockets.
    folder: PathBuf,
    serial: Serial,
    control: BufReader<Patient>,
    figures: u64,
    contacts: u64,
}

/// The recorded edges of the pins.
#[derive(Debug, PartialEq)]
pub struct Pins {
    /// Events that began a pulse.
    pub events: u64,
    /// Their hash.
    pub hash: u64,
    /// From the first of them to the last, s.
    pub motion_time_s: f64,
    /// Pulses of each axis.
    pub pulses: Vec<u64>,
    /// Position of each axis, steps.
    pub steps: Vec<i32>,
}

impl Emulator {
    /// Boots a firmware.
    pub fn start(elf: &Path, machine: &str) -> Result<Self> {
        Self::start_with(elf, machine, FIRST_USART, &[])
    }

    /// Boots a firmware whose sender is on a USART, with more options for QEMU.
    pub fn start_with(elf: &Path, machine: &str, usart: u8, options: &[&str]) -> Result<Self> {
        let (figures, contacts) = (symbol(elf, FIGURES)?, symbol(elf, CONTACTS)?);
        let number = STARTED.fetch_add(1, Ordering::Relaxed);
        let folder = env::temp_dir().join(format!("leadscrew-{}-{number}", process::id()));
        fs::create_dir_all(&folder)
            .with_context(|| format!("cannot create {}", folder.display()))?;
        let (serial, control) = (folder.join("serial"), folder.join("control"));
        let debugger = format!(
            "unix:{},server=on,wait=off",
            folder.join(DEBUGGER).display()
        );
        let socket = |path: &Path| format!("unix:{},server=off", path.display());
        let listeners = [listen(&serial)?, listen(&control)?];
        let mut qemu = Command::new("qemu-system-arm")
            .args(["-M", machine, "-nographic", "-monitor", "none"])
            .args(["-qmp", &socket(&control)])
            // QEMU gives each USART the next serial line.
            .args((FIRST_USART..usart).flat_map(|_| ["-serial", "null"]))
            .args(["-serial", &socket(&serial), "-gdb", &debugger])
            .args(options)
            .arg("-kernel")
            .arg(elf)
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .spawn()
            .context("cannot start qemu-system-arm")?;
        let [serial, control] = listeners;
        let connected = accept(&serial, &mut qemu)
            .and_then(|serial| Ok((serial, accept(&control, &mut qemu)?)));
        let connected = connected.and_then(|(serial, control)| {
            let control = Patient::new(control, qemu.id(), START)?;
            Ok((Serial::new(serial)?, control))
        });
        let (serial, control) = connected.inspect_err(|_| {
            let _ = qemu.kill();
            let _ = qemu.wait();
        })?;
        let mut emulator = Self {
            qemu,
            folder,
            serial,
            control: BufReader::new(control),
            figures,
            contacts,
        };
        emulator.execute("qmp_capabilities", &json!({}))?;
        Ok(emulator)
    }

    /// Sends bytes.
    pub fn send(&mut self, bytes: &[u8]) -> Result<()> {
        self.serial.send(bytes)
    }

    /// Receives a line, without its end; `None` when none has come in time.
    pub fn receive(&mut self, limit: Duration) -> Result<Option<String>> {
        let patience = self.patience(limit);
        loop {
            let line = self.serial.receive(patience.left())?;
            if line.is_some() || patience.is_over() {
                return Ok(line);
            }
        }
    }

    /// Begins to wait for QEMU.
    pub fn patience(&self, limit: Duration) -> Patience {
        Patience::new(self.qemu.id(), limit)
    }

    /// Waits for the line with which the firmware says that it is there.
    pub fn wait_for_welcome(&mut self, patience: Duration) -> Result<()> {
        loop {
            let line = self.receive(patience)?;
            let line = line.context("the firmware does not start: no welcome line has come")?;
            if Line::read(&line) == Line::Welcome {
                return Ok(());
            }
        }
    }

    /// Changes a setting.
    pub fn set(&mut self, statement: &str, patience: Duration) -> Result<()> {
        self.send(format!("${statement}\n").as_bytes())?;
        loop {
            let line = self.receive(patience)?;
            let line = line.context("the firmware does not answer")?;
            match Response::parse(&line) {
                Some(Response::Ok) => return Ok(()),
                Some(error) => bail!("the firmware refuses ${statement}: {error}"),
                None => {}
            }
        }
    }

    /// The serial line, for another to use, who has to read it at all times.
    pub fn line(&mut self) -> Result<OwnedFd> {
        self.serial.hand_over()
    }

    /// Mounts switches and a plate for the probe.
    pub fn mount(&self, switches: &SwitchPositions) -> Result<()> {
        const LIMITS: usize = 6;
        let mut words = [[i32::MIN; LIMITS], [i32::MAX; LIMITS]];
        words[0][..AXES].copy_from_slice(&switches.low);
        words[1][..AXES].copy_from_slice(&switches.high);
        let by_hand = [0];
        let words = [&by_hand, words.as_flattened(), &[switches.plate]].concat();
        let words: Vec<u32> = words.into_iter().map(i32::cast_unsigned).collect();
        let mut debugger = self.debugger()?;
        debugger.write(self.contacts as u32, &words)?;
        debugger.detach()
    }

    /// Stops the machine, and returns the connection that does.
    pub fn debugger(&self) -> Result<Debugger> {
        Debugger::connect(&self.folder.join(DEBUGGER), self.qemu.id())
    }

    /// Closes these contacts, the bits of [`leadscrew::model::Levels`], whatever the axes do.
    pub fn close(&self, contacts: u16) -> Result<()> {
        let mut debugger = self.debugger()?;
        debugger.write(self.contacts as u32, &[contacts.into()])?;
        debugger.detach()
    }

    /// Ends QEMU in an orderly way, as its plugins need it to.
    pub fn quit(mut self, limit: Duration) -> Result<()> {
        self.execute("quit", &json!({}))?;
        let patience = self.patience(limit);
        while self.qemu.try_wait()?.is_none() {
            ensure!(
                !patience.is_over(),
                "QEMU did not end in {} s",
                limit.as_secs()
            );
            thread::sleep(Duration::from_millis(5));
        }
        Ok(())
    }

    /// Reads what the pins have done from the firmware's memory.
    pub fn pins(&mut self) -> Result<Pins> {
        let file = self.folder.join("memory");
        let place = json!({
            "val": self.figures,
            "size": WORDS * 4,
            "filename": file.display().to_string(),
        });
        self.execute("pmemsave", &place)?;
        Pins::read(&fs::read(&file).context("QEMU has saved no memory")?)
    }

    /// Has QEMU execute a command of its machine protocol.
    fn execute(&mut self, command: &str, arguments: &Value) -> Result<()> {
        let request = json!({"execute": command, "arguments": arguments});
        let sent = self
            .control
            .get_mut()
            .stream
            .write_all(format!("{request}\n").as_bytes());
        sent.context("QEMU cannot be controlled")?;
        loop {
            let mut line = String::new();
            let length = self.control.read_line(&mut line);
            let length = length.context("QEMU does not answer")?;
            ensure!(length > 0, "QEMU has ended");
            let reply: Value = serde_json::from_str(&line).context("QEMU answers nonsense")?;
            ensure!(
                reply.get("error").is_none(),
                "QEMU refuses {command}: {reply}"
            );
            if reply.get("return").is_some() {
                return Ok(());
            }
        }
    }
}

impl Drop for Emulator {
    fn drop(&mut self) {
        let _ = self.qemu.kill();
        let _ = self.qemu.wait();
        let _ = fs::remove_dir_all(&self.folder);
    }
}

/// Opens a socket that QEMU is to connect to.
pub(crate) fn listen(path: &Path) -> Result<UnixListener> {
    let listener = UnixListener::bind(path)
        .with_context(|| format!("cannot open a socket at {}", path.display()))?;
    listener.set_nonblocking(true)?;
    Ok(listener)
}

/// Waits for QEMU to connect.
pub(crate) fn accept(listener: &UnixListener, qemu: &mut Child) -> Result<UnixStream> {
    let patience = Patience::new(qemu.id(), START);
    loop {
        if let Ok((stream, _)) = listener.accept() {
            stream.set_nonblocking(false)?;
            return Ok(stream);
        }
        if let Some(status) = qemu.try_wait()? {
            bail!("QEMU has ended ({status})");
        }
        ensure!(!patience.is_over(), "QEMU does not start");
        thread::sleep(Duration::from_millis(2));
    }
}

/// The address of a symbol.
pub fn symbol(elf: &Path, name: &str) -> Result<u64> {
    let bytes = fs::read(elf).with_context(|| format!("cannot read {}", elf.display()))?;
    let file = object::File::parse(&*bytes)
        .with_context(|| format!("{} is no ELF file", elf.display()))?;
    let found = file.symbols().find(|symbol| symbol.name() == Ok(name));
    let found = found.with_context(|| format!("{} has no symbol {name}", elf.display()))?;
    Ok(found.address())
}

impl Pins {
    /// Reads the firmware's words: events, hash, ticks, pulses and steps of six axes.
    fn read(bytes: &[u8]) -> Result<Self> {
        ensure!(bytes.len() == WORDS * 4, "QEMU has saved half the memory");
        let words: Vec<u32> = bytes
            .chunks_exact(4)
            .map(|word| u32::from_le_bytes([word[0], word[1], word[2], word[3]]))
            .collect();
        let double = |low: usize| u64::from(words[low + 1]) << 32 | u64::from(words[low]);
        Ok(Self {
            events: words[0].into(),
            hash: double(1),
            motion_time_s: double(3) as f64 / f64::from(TICKS_PER_SECOND),
            pulses: words[5..5 + AXES]
                .iter()
                .map(|word| (*word).into())
                .collect(),
            steps: words[11..11 + AXES]
                .iter()
                .map(|word| word.cast_signed())
                .collect(),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_of_the_firmware_become_figures() {
        let mut bytes = Vec::new();
        for word in 0..WORDS as u32 {
            let word = if word == 11 { u32::MAX } else { word };
            bytes.extend(word.to_le_bytes());
        }
        let pins = Pins::read(&bytes).unwrap();
        assert_eq!(pins.events, 0);
        assert_eq!(pins.hash, 2 << 32 | 1);
        assert_eq!(pins.pulses[0], 5);
        assert_eq!(pins.steps[0], -1);
        assert_eq!(pins.steps[1], 12);
        assert!(Pins::read(&bytes[1..]).is_err());
    }
}
