//! The lines to machines, as the worker has them: bytes for the machine against bytes from it.

mod serial;
mod socket;
mod virtual_machine;

use serde::{Deserialize, Serialize};

pub(crate) use serial::{choose_port, has_serial};
pub use virtual_machine::VirtualMachine;

/// How a machine is reached.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub enum Transport {
    /// The virtual machine, in real time.
    Virtual,
    /// A serial port of this computer, by Web Serial.
    Serial {
        /// Which of the ports that the page may use.
        index: u32,
        /// How many there were: with another number, this one is not plugged in.
        ports: u32,
        /// Bits per second.
        baud: u32,
    },
    /// A controller with a WebSocket of its own.
    Socket {
        /// `ws://192.168.0.20:81/`.
        address: String,
    },
}

/// A line to a machine.
pub(crate) trait Wire {
    /// Sends bytes, and returns those that have come since the last time; the clock is in ms.
    ///
    /// # Errors
    /// Why the line is broken, as a sentence.
    fn exchange(&mut self, output: &[u8], now_ms: u64) -> Result<Vec<u8>, String>;
}

/// Opens a line.
pub(crate) fn open(transport: &Transport, now_ms: u64) -> Result<Box<dyn Wire>, String> {
    Ok(match transport {
        Transport::Virtual => Box::new(VirtualMachine::new(now_ms)),
        Transport::Serial { index, ports, baud } => {
            Box::new(serial::Serial::open((*index, *ports), *baud))
        }
        Transport::Socket { address } => Box::new(socket::Socket::open(address)?),
    })
}
