//! Serves the bootloader of a chip to a page: `dfuse-model CHIP [FAULT=NUMBER ...]`, on a free port, which it prints.

use std::{
    env,
    error::Error,
    io::{self, Write as _},
    net::TcpListener,
};

use dfuse_model::{Chip, Device, serve};

const USAGE: &str = "usage: dfuse-model CHIP [unplugged-after=TRANSFERS] [no-erase=SECTOR] [stuck=ADDRESS] \
                     [protected=1] [busy-polls=NUMBER] [poll-ms=MS]";

fn main() -> Result<(), Box<dyn Error>> {
    let mut device = device(env::args().skip(1)).ok_or(USAGE)?;
    let listener = TcpListener::bind("127.0.0.1:0")?;
    println!("http://{}", listener.local_addr()?);
    io::stdout().flush()?;
    serve(&mut device, &listener)?;
    Ok(())
}

/// The device that is asked for.
fn device(mut arguments: impl Iterator<Item = String>) -> Option<Device> {
    let mut device = Device::new(Chip::named(&arguments.next()?)?);
    for argument in arguments {
        let (name, value) = argument.split_once('=')?;
        let number: u32 = match value.strip_prefix("0x") {
            Some(digits) => u32::from_str_radix(digits, 16).ok()?,
            None => value.parse().ok()?,
        };
        match name {
            "unplugged-after" => device.faults.unplugged_after = Some(number.into()),
            "no-erase" => device.faults.no_erase = Some(number as usize),
            "stuck" => device.faults.stuck = Some(number),
            "protected" => device.faults.is_protected = number != 0,
            "busy-polls" => device.faults.busy_polls = number,
            "poll-ms" => device.poll_ms = number,
            _ => return None,
        }
    }
    Some(device)
}
