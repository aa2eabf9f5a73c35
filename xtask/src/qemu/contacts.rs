//! Contacts on the emulated board: written into the firmware's memory through QEMU's connection for
//! debuggers, which stops the machine while it lasts.

use std::{
    fmt::Write as _,
    io::{Read, Write},
    os::unix::net::UnixStream,
    path::Path,
    time::Duration,
};

use anyhow::{Context, Result, ensure};

/// How long QEMU may take to reply.
const PATIENCE: Duration = Duration::from_secs(20);

/// Writes words to the memory of the machine whose QEMU listens at `socket`.
pub(super) fn write(socket: &Path, address: u64, words: &[u32]) -> Result<()> {
    let mut stream = UnixStream::connect(socket).context("QEMU does not listen to debuggers")?;
    stream.set_read_timeout(Some(PATIENCE))?;
    let mut command = format!("M{address:x},{:x}:", 4 * words.len());
    for word in words {
        write!(command, "{:08x}", word.swap_bytes())?;
    }
    let reply = exchange(&mut stream, &command)?;
    ensure!(reply == "OK", "QEMU does not write to memory: {reply}");
    exchange(&mut stream, "D").map(drop)
}

/// Sends a command in the debuggers' protocol and returns the reply. That the machine has stopped is
/// said unasked.
fn exchange(stream: &mut UnixStream, command: &str) -> Result<String> {
    let sum = command.bytes().fold(0_u8, u8::wrapping_add);
    write!(stream, "${command}#{sum:02x}").context("QEMU takes no commands")?;
    loop {
        let packet = receive(stream).context("QEMU does not reply")?;
        stream.write_all(b"+").context("QEMU takes no receipts")?;
        if !packet.starts_with('T') {
            return Ok(packet);
        }
    }
}

/// Receives a packet: `$text#sum`.
fn receive(stream: &mut UnixStream) -> Result<String> {
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
