//! What a debug probe sees that the chip's bus does not carry: the processor's own registers. GDB's manual, "Remote
//! Protocol".

use std::{
    io::{BufRead as _, BufReader, Write as _},
    net::{SocketAddr, TcpStream},
    thread::{self, JoinHandle},
};

use anyhow::{Context as _, Result, ensure};

/// What is done while the core is halted.
#[derive(Debug, Clone)]
pub(crate) enum Probe {
    /// Words are read from these addresses.
    Read(Vec<u32>),
    /// A word is written.
    Write(u32, u32),
}

/// Connects to a running core, which halts the core, and lets it go on.
pub(crate) fn probe(address: SocketAddr, probe: Probe) -> JoinHandle<Result<Vec<u32>>> {
    thread::spawn(move || {
        let mut connection = Connection(BufReader::new(TcpStream::connect(address)?));
        let words = match probe {
            Probe::Read(addresses) => {
                let words = addresses.iter().map(|&it| connection.read(it));
                words.collect::<Result<Vec<_>>>()?
            }
            Probe::Write(address, word) => {
                let command = format!("M{address:x},4:{:08x}", word.swap_bytes());
                ensure!(
                    connection.ask(&command)? == "OK",
                    "{address:#x} is not written"
                );
                Vec::new()
            }
        };
        connection.ask("D")?;
        Ok(words)
    })
}

struct Connection(BufReader<TcpStream>);

impl Connection {
    fn read(&mut self, address: u32) -> Result<u32> {
        let digits = self.ask(&format!("m{address:x},4"))?;
        let word = u32::from_str_radix(&digits, 16);
        Ok(word
            .with_context(|| format!("{address:#x} is {digits:?}"))?
            .swap_bytes())
    }

    /// Sends a packet and returns the answer's text.
    fn ask(&mut self, command: &str) -> Result<String> {
        let sum = command.bytes().fold(0_u8, u8::wrapping_add);
        write!(self.0.get_mut(), "${command}#{sum:02x}")?;
        let mut skipped = Vec::new();
        self.0.read_until(b'$', &mut skipped)?;
        let mut packet = Vec::new();
        self.0.read_until(b'#', &mut packet)?;
        let mut sum = [0; 2];
        std::io::Read::read_exact(&mut self.0, &mut sum)?;
        self.0.get_mut().write_all(b"+")?;
        packet.pop();
        Ok(String::from_utf8_lossy(&packet).into_owned())
    }
}
