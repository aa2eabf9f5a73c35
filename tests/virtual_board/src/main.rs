//! The image of a board on its chip, modelled register by register: `cargo xtask rehearse` and `cargo xtask board run`.
//!
//! Functions and their order are tested, not times: each instruction takes one cycle of the core.

mod bench;
mod bootloader;
mod chip;
mod compare;
mod debugger;
mod eeprom;
mod job;
mod loader;
mod machine;
mod plant;
mod program;
mod rehearsal;
mod run;
mod script;
mod sender;
mod unmodelled;
mod usb_host;
mod watch;

use std::{
    net::TcpListener,
    path::{Path, PathBuf},
    process::ExitCode,
    sync::Arc,
};

use anyhow::{Context as _, Result, bail};
use board_data::Board;
use rigless::chip::uart::TcpPeer;

use crate::{
    bench::{Bench, Line, Link},
    program::{Lines, Program},
    rehearsal::{Extent, Job},
};

/// What `cargo xtask` passes on.
#[derive(Debug, Default)]
struct Options {
    board: String,
    axes: usize,
    elf: PathBuf,
    /// What loaders take: all is played with the first, and starts with the others.
    files: Vec<PathBuf>,
    jobs: Vec<Job>,
    extent: Extent,
    shows_lines: bool,
    /// The address at which the line to the sender is served, and whether by USB/IP.
    served: Option<(String, bool)>,
    /// Settings by which switches are mounted then, and the step events that are compared with those of the pins.
    switches: Option<Vec<String>>,
    against: Option<PathBuf>,
    /// RTT is served at another one.
    has_rtt: bool,
}

impl Options {
    fn read(mut arguments: impl Iterator<Item = String>) -> Result<Self> {
        let mut options = Self {
            axes: 3,
            ..Self::default()
        };
        while let Some(name) = arguments.next() {
            match name.as_str() {
                "--short" => options.extent = Extent::Short,
                "--start" => options.extent = Extent::Start,
                "--lines" => options.shows_lines = true,
                "--rtt" => options.has_rtt = true,
                _ => options.take(&name, arguments.next())?,
            }
        }
        Ok(options)
    }

    /// Takes an option with its value.
    fn take(&mut self, name: &str, value: Option<String>) -> Result<()> {
        let value = value.with_context(|| format!("{name} wants a value"))?;
        match name {
            "--board" => self.board = value,
            "--axes" => self.axes = value.parse()?,
            "--elf" => self.elf = value.into(),
            "--file" => self.files.push(value.into()),
            "--job" => self.jobs.push(Job::read(&value)?),
            "--tcp" => self.served = Some((value, false)),
            "--usbip" => self.served = Some((value, true)),
            "--against" => self.against = Some(value.into()),
            "--switches" => self.switches = Some(value.split(',').map(str::to_owned).collect()),
            other => bail!("{other} is no option"),
        }
        Ok(())
    }
}

fn main() -> ExitCode {
    match run() {
        Ok(code) => code,
        Err(error) => {
            eprintln!("error: {error:#}");
            ExitCode::FAILURE
        }
    }
}

fn run() -> Result<ExitCode> {
    let options = Options::read(std::env::args().skip(1))?;
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    let bench = |file: Option<&Path>| -> Result<Bench> {
        let mut bench = Bench {
            axes: options.axes,
            program: Program::read(&options.elf)?,
            images: Vec::new(),
            boot: bootloader::PLACE,
            shows_lines: options.shows_lines,
            board: Board::read(&Board::path(&options.board, &root), &root)?,
        };
        bench.images = rehearsal::images(&bench, &options.elf, file)?;
        Ok(bench)
    };
    if let Some((address, is_usbip)) = &options.served {
        let mut bench = bench(None)?;
        bench.boot = bench.vectors();
        let is_right = serve(&bench, address, *is_usbip, &options)?;
        return Ok(exit_code(is_right));
    }
    let lines = Lines::read(&options.elf)?;
    let mut is_right = true;
    for (number, file) in options.files.iter().enumerate() {
        let name = file.file_name().unwrap_or_default().display();
        println!("  {name}, as its loader writes it:");
        let (jobs, extent) = if number == 0 {
            (&options.jobs[..], options.extent)
        } else {
            (&[][..], Extent::Start)
        };
        is_right &= rehearsal::play(&Arc::new(bench(Some(file))?), &lines, jobs, extent)?;
    }
    Ok(exit_code(is_right))
}

fn exit_code(is_right: bool) -> ExitCode {
    if is_right {
        ExitCode::SUCCESS
    } else {
        ExitCode::FAILURE
    }
}

/// Serves a board's line to its sender at an address, until the program is to end. Returns whether the steps at the
/// pins are those that they are compared with.
fn serve(bench: &Bench, address: &str, is_usbip: bool, options: &Options) -> Result<bool> {
    let (host, port) = address
        .rsplit_once(':')
        .context("an address is HOST:PORT")?;
    if !matches!(host, "127.0.0.1" | "localhost") {
        bail!("a virtual board is served to this computer alone: 127.0.0.1:{port}");
    }
    let port = port.parse().context("a port is a number")?;
    let title = &bench.board.title;
    let line = if is_usbip {
        if bench.link() == Link::Uart {
            bail!("{title} has its sender at a UART: --tcp serves that");
        }
        let listener = TcpListener::bind((host, port));
        let listener = listener.with_context(|| format!("cannot listen at {address}"))?;
        let address = listener.local_addr()?;
        println!("{title} is served at usbip://{address}");
        println!("Attach by {}", usbip::command(address));
        Line::UsbIp(usbip::Server::new(listener)?)
    } else {
        let peer = TcpPeer::listen(port)?;
        println!("{title} is served at 127.0.0.1:{}", peer.port()?);
        Line::Tcp(peer)
    };
    let rtt = options.has_rtt.then(|| TcpListener::bind((host, 0)));
    let rtt = rtt.transpose()?;
    if let Some(rtt) = &rtt {
        println!("RTT is served at {}", rtt.local_addr()?);
    }
    let settings = options.switches.as_deref();
    let switches = settings.map(|it| rehearsal::switches(it, bench.axes));
    let switches = switches.unwrap_or_default();
    let wants_steps = options.against.is_some();
    let steps = bench.serve(line, &switches, rtt.as_ref(), wants_steps)?;
    let (Some(steps), Some(events)) = (steps, &options.against) else {
        return Ok(true);
    };
    let difference = job::difference(&steps, events)?;
    match &difference {
        None => println!(
            "all {} steps at the pins are those of the file",
            steps.len()
        ),
        Some(difference) => println!("{difference}"),
    }
    Ok(difference.is_none())
}
