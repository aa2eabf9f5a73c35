//! The firmware's blocks of memory, `FIGURES` and `CONTACTS` of `src/board/qemu/memory.rs`.
//!
//! QEMU's connection for debuggers stops the machine while it lasts, so each access has its own.

use std::{
    collections::BTreeMap,
    env, fs,
    io::{Read, Write},
    os::unix::net::UnixStream,
    path::{Path, PathBuf},
    process,
    sync::atomic::{AtomicU32, Ordering::Relaxed},
    thread,
    time::Duration,
};

use leadscrew::model::Levels;
use object::{Object, ObjectSymbol};

use crate::machine::{TIMEOUT, wait_for};

/// Words of `FIGURES` before the positions, and before what is switched.
const STEPS: u64 = 11;
const SWITCHED: u64 = 17;
/// Words of `CONTACTS` before the limit switches at the low ends, the high ends, and the plate.
const AT_MOST: u64 = 1;
const AT_LEAST: u64 = 7;
const PLATE: u64 = 13;
/// Words before the level of the sender's line.
const LINE: u64 = 14;

/// Number of connections made, for names that differ.
static COUNT: AtomicU32 = AtomicU32::new(0);

/// The switched outputs, and the PWM.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Switched {
    /// Bit 0 spindle, 1 counter-clockwise, 2 flood, 3 mist, 4 drivers.
    pub(crate) bits: u32,
    /// The highest duty since power-up.
    pub(crate) highest_duty: u32,
}

/// The memory of one emulated board.
pub(crate) struct Memory {
    socket: PathBuf,
    figures: u64,
    /// The contacts, a bit each as in [`Levels`].
    pub(crate) contacts: u64,
    fault: u64,
    /// The addresses of all symbols, those of the linker script included.
    symbols: BTreeMap<String, u64>,
    /// The firmware's functions, by their names: address and length.
    functions: BTreeMap<String, (u64, u64)>,
}

impl Memory {
    /// The memory of a board that is yet to be started with this firmware.
    pub(crate) fn of(elf: &Path) -> Self {
        let bytes = fs::read(elf).expect("the firmware can be read");
        let file = object::File::parse(&*bytes).expect("the firmware is an ELF file");
        let address = |name| {
            let found = file.symbols().find(|symbol| symbol.name() == Ok(name));
            found.expect("the firmware has the symbol").address()
        };
        let symbols = file.symbols().filter(|symbol| !symbol.is_undefined());
        let symbols = symbols
            .filter_map(|symbol| Some((symbol.name().ok()?.to_owned(), symbol.address() & !1)));
        let functions = file.symbols().filter(ObjectSymbol::is_definition);
        let functions = functions.filter_map(|symbol| {
            // The lowest bit says that the code is Thumb.
            let place = (symbol.address() & !1, symbol.size());
            Some((symbol.name().ok()?.to_owned(), place))
        });
        let name = format!(
            "leadscrew-{}-{}",
            process::id(),
            COUNT.fetch_add(1, Relaxed)
        );
        Self {
            socket: env::temp_dir().join(name),
            figures: address("FIGURES"),
            contacts: address("CONTACTS"),
            fault: address("FAULT"),
            symbols: symbols.collect(),
            functions: functions.collect(),
        }
    }

    /// Address at which QEMU listens.
    pub(crate) fn listen(&self) -> String {
        format!("unix:{},server=on,wait=off", self.socket.display())
    }

    /// Physical positions of the axes: steps from power-up.
    pub(crate) fn steps(&self) -> [i32; 6] {
        self.read(self.figures + 4 * STEPS).map(u32::cast_signed)
    }

    /// Waits until an axis is so many steps from where it was at power-up.
    pub(crate) fn wait_for_steps(&self, axis: usize, is_there: impl Fn(i32) -> bool) {
        wait_for(|| {
            let steps = self.steps()[axis];
            is_there(steps).then_some(()).ok_or(steps)
        });
    }

    /// The switched outputs.
    pub(crate) fn switched(&self) -> Switched {
        let [bits, _, highest_duty] = self.read(self.figures + 4 * SWITCHED);
        Switched { bits, highest_duty }
    }

    /// Closes these contacts and opens all others that no axis closes.
    pub(crate) fn close(&self, contacts: Levels) {
        self.write(self.contacts, u32::from(contacts.0));
    }

    /// Mounts a limit switch that closes at this step and below.
    pub(crate) fn mount_low(&self, axis: usize, steps: i32) {
        self.write(
            self.contacts + 4 * (AT_MOST + axis as u64),
            steps.cast_unsigned(),
        );
    }

    /// Mounts a limit switch that closes at this step and above.
    pub(crate) fn mount_high(&self, axis: usize, steps: i32) {
        self.write(
            self.contacts + 4 * (AT_LEAST + axis as u64),
            steps.cast_unsigned(),
        );
    }

    /// Puts a plate under the probe, that closes it at this step of Z and below.
    pub(crate) fn put_plate(&self, steps: i32) {
        self.write(self.contacts + 4 * PLATE, steps.cast_unsigned());
    }

    /// Pulls the line from the sender low, or releases it.
    pub(crate) fn pull_line(&self, low: bool) {
        self.write(self.contacts + 4 * LINE, low.into());
    }

    /// Resets the chip, as its reset pin does; RAM and flash keep what is in them.
    pub(crate) fn reset_chip(&self) {
        /// `system_reset`, in hexadecimal digits.
        const SYSTEM_RESET: &str = "73797374656d5f7265736574";
        assert_eq!(self.access(&format!("qRcmd,{SYSTEM_RESET}")), "OK");
    }

    /// Returns the number of faults since power-up.
    pub(crate) fn faults(&self) -> u32 {
        let [_, _, faults] = self.read(self.fault);
        faults
    }

    /// Where a function begins whose symbol has this in it.
    pub(crate) fn function(&self, part: &str) -> u64 {
        self.extent(part).0
    }

    fn extent(&self, part: &str) -> (u64, u64) {
        let exact = self.functions.get(part);
        let mut found = self
            .functions
            .iter()
            .filter(|(name, _)| name.contains(part));
        let found = exact.or_else(|| found.next().map(|(_, place)| place));
        *found.unwrap_or_else(|| panic!("no function {part}"))
    }

    /// Waits until a function runs, and returns where it is.
    pub(crate) fn place_in(&self, part: &str) -> u64 {
        let (start, length) = self.extent(part);
        wait_for(|| {
            let at = program_counter(&self.access("g"));
            let is_in_it = (start..start + length).contains(&at);
            is_in_it.then_some(at).ok_or(at)
        })
    }

    /// The address of a symbol, if the firmware has it.
    pub(crate) fn symbol(&self, name: &str) -> Option<u64> {
        self.symbols.get(name).copied()
    }

    /// Words of the memory, or registers.
    pub(crate) fn read<const N: usize>(&self, address: u64) -> [u32; N] {
        let reply = self.access(&format!("m{address:x},{:x}", 4 * N));
        std::array::from_fn(|word| {
            let digits = &reply[8 * word..8 * word + 8];
            let word =
                u32::from_str_radix(digits, 16).expect("the debugger replies in hexadecimal");
            word.swap_bytes()
        })
    }

    /// Puts a word into the flash, or the memory.
    pub(crate) fn write(&self, address: u64, word: u32) {
        self.stop().write(address, word);
    }

    /// Stops the machine, executes a command and lets the machine go on.
    fn access(&self, command: &str) -> String {
        self.stop().exchange(command)
    }

    /// Stops the machine, as soon as QEMU listens.
    pub(crate) fn stop(&self) -> Stopped {
        let stream = wait_for(|| {
            let connected = UnixStream::connect(&self.socket);
            if connected.is_err() {
                thread::sleep(Duration::from_millis(5));
            }
            connected
        });
        stream
            .set_read_timeout(Some(TIMEOUT))
            .expect("a socket can wait");
        Stopped { stream }
    }
}

/// The program counter, of a debugger's list of registers.
fn program_counter(registers: &str) -> u64 {
    /// Its number among the registers, each of eight digits.
    const COUNTER: usize = 15;
    let digits = &registers[8 * COUNTER..8 * COUNTER + 8];
    let word = u32::from_str_radix(digits, 16).expect("registers are in hexadecimal");
    word.swap_bytes().into()
}

impl Drop for Memory {
    fn drop(&mut self) {
        let _ = fs::remove_file(&self.socket);
    }
}

/// A machine that is stopped as long as this lives: the connection of a debugger.
pub(crate) struct Stopped {
    stream: UnixStream,
}

impl Stopped {
    /// Puts a word into the flash, or the memory.
    pub(crate) fn write(&mut self, address: u64, word: u32) {
        self.execute(&format!("M{address:x},4:{:08x}", word.swap_bytes()));
    }

    /// Lets the machine run, up to the instruction at this address.
    pub(crate) fn run_to(&mut self, address: u64) {
        self.run_to_first(&[address]);
    }

    /// Lets the machine run, up to the instruction at one of these addresses, and returns which it is.
    pub(crate) fn run_to_first(&mut self, addresses: &[u64]) -> u64 {
        /// It has stopped by the signal `SIGTRAP`, not by the connection.
        const AT_BREAKPOINT: &str = "T05";
        for address in addresses {
            self.execute(&format!("Z1,{address:x},2"));
        }
        self.send("c");
        while !self.receive().starts_with(AT_BREAKPOINT) {}
        for address in addresses {
            self.execute(&format!("z1,{address:x},2"));
        }
        program_counter(&self.exchange("g"))
    }

    fn execute(&mut self, command: &str) {
        assert_eq!(self.exchange(command), "OK", "{command}");
    }

    /// Sends a command in the debuggers' protocol and returns the reply. That the machine has stopped is
    /// said unasked.
    fn exchange(&mut self, command: &str) -> String {
        self.send(command);
        loop {
            let packet = self.receive();
            if !packet.starts_with('T') {
                return packet;
            }
        }
    }

    /// Sends a packet: `$text#sum`.
    fn send(&mut self, text: &str) {
        let sum = text.bytes().fold(0_u8, u8::wrapping_add);
        write!(self.stream, "${text}#{sum:02x}").expect("QEMU takes commands");
    }

    /// Receives such a packet.
    fn receive(&mut self) -> String {
        let mut next = || {
            let mut byte = [0];
            let read = self.stream.read_exact(&mut byte);
            read.expect("QEMU replies in time");
            byte[0]
        };
        while next() != b'$' {}
        let text = std::iter::from_fn(|| Some(next()).filter(|byte| *byte != b'#'));
        let text = String::from_utf8(text.collect()).expect("replies are text");
        next();
        next();
        self.stream.write_all(b"+").expect("QEMU takes receipts");
        text
    }
}

impl Drop for Stopped {
    fn drop(&mut self) {
        // After a failure, a second one would hide it.
        if !thread::panicking() {
            self.exchange("D");
        }
    }
}
