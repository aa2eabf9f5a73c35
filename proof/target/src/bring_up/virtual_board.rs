//! The program on a virtual board: facts over RTT, bytes over the wire, both by TCP.

use std::{
    io::{BufRead, BufReader, Read},
    net::TcpStream,
    process::{Child, Stdio},
    time::Duration,
};

use anyhow::{Context, Result, bail};
use common::{cargo, tools, ui};
use firmware::boards::Board;

use super::{
    exchange::exchange_all,
    facts::{BEGIN, END, Facts, READY, take_until},
};

/// How long the program may say nothing: longer than its scripts and resets take on a slow computer.
const TIMEOUT: Duration = Duration::from_mins(5);
/// Longest silence of the wire.
const SILENCE: Duration = Duration::from_mins(1);

/// Runs the program, and returns what it says.
pub(super) fn run(board: &Board, elf: &std::path::Path) -> Result<Facts> {
    let mut command = tools::command(tools::VIRTUAL_BOARD)?;
    command.args(["--board", &board.argument()]);
    command.args(["--axes", &cargo::axes().to_string()]);
    command.arg("--elf").arg(elf);
    command.args(["--tcp", "127.0.0.1:0", "--rtt"]);
    command.stdin(Stdio::null()).stdout(Stdio::piped());
    let mut process = command
        .spawn()
        .context("the virtual board does not start")?;
    let facts = measure(board, &mut process);
    let _ = process.kill();
    let _ = process.wait();
    facts
}

fn measure(board: &Board, process: &mut Child) -> Result<Facts> {
    let output = process.stdout.take().context("it has no output")?;
    let mut lines = BufReader::new(output).lines();
    let mut connect = || -> Result<TcpStream> {
        let line = lines.next().context("it has ended")??;
        let (_, address) = line.rsplit_once(' ').context("it is not served")?;
        Ok(TcpStream::connect(address)?)
    };
    let mut from = connect()?;
    let mut output = Output {
        stream: connect()?,
        text: String::new(),
    };
    output.stream.set_read_timeout(Some(TIMEOUT))?;
    from.set_read_timeout(Some(SILENCE))?;
    let mut to = from.try_clone()?;
    ui::status("Measuring", &board.name);
    let mut facts = Facts::default();
    facts.put("virtual", 1);
    output.take(BEGIN)?;
    facts.read(&output.take(READY)?)?;
    facts.put("port", 1);
    exchange_all(&mut from, &mut to, &mut facts)?;
    facts.read(&output.take(END)?)?;
    Ok(facts)
}

/// The output of the program.
struct Output {
    stream: TcpStream,
    text: String,
}

impl Output {
    /// Returns what comes before a line.
    fn take(&mut self, last: &str) -> Result<String> {
        let mut chunk = [0; 1024];
        loop {
            if let Some(part) = take_until(&mut self.text, last) {
                return Ok(part);
            }
            let length = self.stream.read(&mut chunk).unwrap_or(0);
            if length == 0 {
                bail!(
                    "the program does not come to its end; it has said\n{}",
                    self.text
                );
            }
            self.text += &String::from_utf8_lossy(&chunk[..length]);
        }
    }
}
