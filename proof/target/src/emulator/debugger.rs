//! QEMU's connection for debuggers: reads and writes the emulated memory.
//!
//! The machine stands still from the beginning of a connection to its end, except between
//! [`Debugger::resume`] and [`Debugger::interrupt`]. GDB's manual, "Remote Protocol".
//!
//! While the machine runs, QEMU takes any byte for a request to stop, and drops the byte; a request
//! before the receipt for QEMU's last packet is dropped too. So each packet of QEMU is waited for,
//! and has its receipt before anything else is sent.

use std::{
    fmt::Write as _,
    io::{BufReader, Read, Write},
    os::unix::net::UnixStream,
    path::Path,
    time::Duration,
};

use anyhow::{Context, Result, ensure};

use super::patience::Patient;

/// How long QEMU may take to reply.
const TIMEOUT: Duration = Duration::from_secs(20);
/// Bytes that are asked for at once: QEMU's packets have 4096 characters, two for each byte.
const CHUNK: usize = 1024;

/// A connection.
pub struct Debugger(BufReader<Patient>);

impl Debugger {
    /// Connects to the QEMU of a process that listens at `socket`, which stops the machine.
    pub(crate) fn connect(socket: &Path, process: u32) -> Result<Self> {
        let stream = UnixStream::connect(socket).context("QEMU does not listen to debuggers")?;
        Self::over(stream, process)
    }

    fn over(stream: UnixStream, process: u32) -> Result<Self> {
        let stream = Patient::new(stream, process, TIMEOUT)?;
        let mut debugger = Self(BufReader::new(stream));
        // That the machine has stopped is said, to nobody's wish, by QEMU up to 8.0 alone. All of them answer a question
        // when it has.
        debugger.send("qAttached")?;
        while is_stop(&debugger.receive()?) {}
        Ok(debugger)
    }

    /// Lets the machine run.
    pub fn resume(&mut self) -> Result<()> {
        self.send("c")
    }

    /// Stops it.
    pub fn interrupt(&mut self) -> Result<()> {
        const INTERRUPT: u8 = 3;
        self.put(&[INTERRUPT])?;
        self.wait_for_stop()
    }

    /// Reads memory, or a register of a peripheral.
    pub fn read(&mut self, address: u32, bytes: &mut [u8]) -> Result<()> {
        for (chunk, start) in bytes.chunks_mut(CHUNK).zip((address..).step_by(CHUNK)) {
            let digits = self.exchange(&format!("m{start:x},{:x}", chunk.len()))?;
            let is_whole = digits.len() == 2 * chunk.len() && digits.is_ascii();
            ensure!(is_whole, "QEMU does not read memory: {digits}");
            for (byte, index) in chunk.iter_mut().zip((0..).step_by(2)) {
                *byte = u8::from_str_radix(&digits[index..index + 2], 16)
                    .with_context(|| format!("QEMU reads nonsense: {digits}"))?;
            }
        }
        Ok(())
    }

    /// Writes words to memory.
    pub fn write(&mut self, address: u32, words: &[u32]) -> Result<()> {
        let mut command = format!("M{address:x},{:x}:", 4 * words.len());
        for word in words {
            write!(command, "{:08x}", word.swap_bytes())?;
        }
        let reply = self.exchange(&command)?;
        ensure!(reply == "OK", "QEMU does not write to memory: {reply}");
        Ok(())
    }

    /// Ends the connection and lets the machine run.
    pub fn detach(mut self) -> Result<()> {
        self.exchange("D").map(drop)
    }

    /// Waits until QEMU says that the machine has stopped.
    fn wait_for_stop(&mut self) -> Result<()> {
        let packet = self.receive()?;
        ensure!(is_stop(&packet), "QEMU does not stop the machine: {packet}");
        Ok(())
    }

    /// Sends a command and returns the reply.
    fn exchange(&mut self, command: &str) -> Result<String> {
        self.send(command)?;
        self.receive()
    }

    /// Sends a command.
    fn send(&mut self, command: &str) -> Result<()> {
        let sum = command.bytes().fold(0_u8, u8::wrapping_add);
        self.put(format!("${command}#{sum:02x}").as_bytes())
    }

    fn put(&mut self, bytes: &[u8]) -> Result<()> {
        let put = self.0.get_mut().stream.write_all(bytes);
        put.context("QEMU takes no commands")
    }

    /// Receives a packet, `$text#sum`, and says so.
    fn receive(&mut self) -> Result<String> {
        let packet = packet(&mut self.0).context("QEMU does not reply")?;
        self.put(b"+")?;
        Ok(packet)
    }
}

/// Returns whether a packet says that the machine has stopped.
fn is_stop(packet: &str) -> bool {
    packet.starts_with('T')
}

/// Reads up to the end of a packet and returns its text.
fn packet(stream: &mut impl Read) -> Result<String> {
    let mut next = || {
        let mut byte = [0];
        stream.read_exact(&mut byte).map(|()| byte[0])
    };
    while next()? != b'$' {}
    let mut text = Vec::new();
    loop {
        match next()? {
            b'#' => break,
            byte => text.push(byte),
        }
    }
    let _sum = (next()?, next()?);
    Ok(String::from_utf8_lossy(&text).into_owned())
}

#[cfg(test)]
mod tests {
    use std::{
        process,
        thread::{self, JoinHandle},
    };

    use super::*;

    const STOPPED: &str = "$T02thread:01;#04";
    const ATTACHED: (&str, &str) = ("", "$qAttached#8f");
    /// QEMU's answer.
    const YES: &str = "+$1#31";

    /// QEMU's side of a conversation: the packets sent, and the packets expected next.
    fn qemu(conversation: Vec<(&'static str, &'static str)>) -> (UnixStream, JoinHandle<()>) {
        let (mut qemu, ours) = UnixStream::pair().unwrap();
        qemu.set_read_timeout(Some(TIMEOUT)).unwrap();
        let play = move || {
            for (says, hears) in conversation {
                qemu.write_all(says.as_bytes()).unwrap();
                let mut heard = vec![0; hears.len()];
                qemu.read_exact(&mut heard).unwrap();
                assert_eq!(String::from_utf8_lossy(&heard), hears);
            }
            let mut output = Vec::new();
            qemu.read_to_end(&mut output).unwrap();
            assert_eq!(String::from_utf8_lossy(&output), "");
        };
        (ours, thread::spawn(play))
    }

    #[test]
    fn a_running_machine_hears_nothing_but_the_wish_to_stop_it() {
        let (stream, qemu) = qemu(vec![
            ATTACHED,
            // Up to QEMU 8.0.
            (STOPPED, "+"),
            (YES, "+"),
            ("", "$c#63"),
            // The receipt of a command comes alone, before the machine stops.
            ("+", "\x03"),
            (STOPPED, "+"),
            ("", "$m20000000,4#4f"),
            ("+$01020304#8a", "+"),
            ("", "$M20000000,4:04030201#f3"),
            ("+$OK#9a", "+"),
            ("", "$D#44"),
            ("+$OK#9a", "+"),
        ]);
        let mut debugger = Debugger::over(stream, process::id()).unwrap();
        debugger.resume().unwrap();
        debugger.interrupt().unwrap();
        let mut bytes = [0; 4];
        debugger.read(0x2000_0000, &mut bytes).unwrap();
        assert_eq!(bytes, [1, 2, 3, 4]);
        debugger.write(0x2000_0000, &[0x0102_0304]).unwrap();
        debugger.detach().unwrap();
        qemu.join().unwrap();
    }

    #[test]
    fn long_memory_is_read_in_packets_that_qemu_can_send() {
        let first: &str = format!("+${}#00", "11".repeat(CHUNK)).leak();
        let (stream, qemu) = qemu(vec![
            ATTACHED,
            (YES, "+"),
            ("", "$m20000000,400#af"),
            (first, "+"),
            ("", "$m20000400,1#50"),
            ("+$22#64", "+"),
        ]);
        let mut debugger = Debugger::over(stream, process::id()).unwrap();
        let mut bytes = [0; CHUNK + 1];
        debugger.read(0x2000_0000, &mut bytes).unwrap();
        assert_eq!(bytes[..CHUNK], [0x11; CHUNK]);
        assert_eq!(bytes[CHUNK], 0x22);
        drop(debugger);
        qemu.join().unwrap();
    }

    #[test]
    fn a_stop_that_nobody_wished_is_no_memory() {
        let (stream, qemu) = qemu(vec![
            ATTACHED,
            (YES, "+"),
            ("", "$m20000000,1#4c"),
            (STOPPED, "+"),
        ]);
        let mut debugger = Debugger::over(stream, process::id()).unwrap();
        let refusal = debugger.read(0x2000_0000, &mut [0]).unwrap_err();
        assert!(refusal.to_string().contains("T02thread"), "{refusal}");
        drop(debugger);
        qemu.join().unwrap();
    }
}
