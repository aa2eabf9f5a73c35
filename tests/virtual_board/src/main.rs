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
use board_data::{Board, Input};
use rigless::{chip::uart::TcpPeer, image::Image};

use crate::{
    bench::Bench,
    plant::Closes,
    program::{Lines, Program},
    rehearsal::Job,
};

/// What `cargo xtask` passes on.
#[derive(Debug, Default)]
struct Options {
    board: String,
    axes: usize,
    elf: PathBuf,
    /// What the bootloader takes.
    file: Option<PathBuf>,
    jobs: Vec<Job>,
    /// Only what matters most.
    is_short: bool,
    shows_lines: bool,
    /// The address at which the serial line is served, and settings by which switches are mounted then.
    tcp: Option<String>,
    switches: Option<Vec<String>>,
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
                "--short" => options.is_short = true,
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
            "--file" => self.file = Some(value.into()),
            "--job" => self.jobs.push(Job::read(&value)?),
            "--tcp" => self.tcp = Some(value),
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
    let board = Board::read(&Board::path(&options.board, &root), &root)?;
    let mut bench = Bench {
        axes: options.axes,
        program: Program::read(&options.elf)?,
        images: Vec::new(),
        boot: bootloader::PLACE,
        shows_lines: options.shows_lines,
        board,
    };
    if let Some(address) = &options.tcp {
        bench.images = vec![
            Image::read(&options.elf, None)?,
            chip::memory::made(&bench.board)?,
        ];
        bench.boot = bench.vectors();
        let settings = options.switches.as_deref();
        let switches = settings.map(|it| rehearsal::switches(it, bench.axes));
        serve(
            &bench,
            address,
            &switches.unwrap_or_default(),
            options.has_rtt,
        )?;
        return Ok(ExitCode::SUCCESS);
    }
    bench.images = rehearsal::images(&bench, &options.elf, options.file.as_deref())?;
    let lines = Lines::read(&options.elf)?;
    let is_right = rehearsal::play(&Arc::new(bench), &lines, &options.jobs, options.is_short)?;
    Ok(if is_right {
        ExitCode::SUCCESS
    } else {
        ExitCode::FAILURE
    })
}

/// Serves a board's serial line at an address, until the program is ended.
fn serve(bench: &Bench, address: &str, switches: &[(Input, Closes)], has_rtt: bool) -> Result<()> {
    let (host, port) = address
        .rsplit_once(':')
        .context("an address is HOST:PORT")?;
    if !matches!(host, "127.0.0.1" | "localhost") {
        bail!("a virtual board is served to this computer alone: 127.0.0.1:{port}");
    }
    let peer = TcpPeer::listen(port.parse().context("a port is a number")?)?;
    println!(
        "{} is served at 127.0.0.1:{}",
        bench.board.title,
        peer.port()?
    );
    let rtt = has_rtt.then(|| TcpListener::bind((host, 0))).transpose()?;
    if let Some(rtt) = &rtt {
        println!("RTT is served at {}", rtt.local_addr()?);
    }
    bench.serve(peer, switches, rtt.as_ref())
}
