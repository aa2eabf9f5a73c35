//! The virtual machine on the chip's processor: `cargo xtask sim FILE --on-target`.
//!
//! Reads `program.nc` and `settings.txt` from the emulator's folder by semihosting and writes
//! `figures.txt` there: one fact a line, as `proof/target/src/on_target.rs` reads them. The same code, so
//! the same figures and the same event hash as on the host, bit for bit.
#![cfg_attr(target_os = "none", no_std, no_main)]

#[cfg(not(target_os = "none"))]
fn main() {
    println!("skipped on the host: `cargo xtask sim FILE --on-target` runs it in QEMU");
}

#[cfg(target_os = "none")]
mod target {
    use core::fmt::{self, Write as _};

    use defmt_semihosting as _;
    use leadscrew::{
        settings::{self, Settings, StepRate},
        sim::{Edge, Simulator, StepStatistics, Stream, StreamEnd, Watcher},
    };
    use semihosting::{
        fs::File,
        io::{Read as _, Write as _},
        process,
    };
    use stm32f4xx_hal as _;

    #[panic_handler]
    fn panic(info: &core::panic::PanicInfo) -> ! {
        semihosting::eprintln!("{info}");
        process::exit(101)
    }

    /// A file, byte by byte.
    struct Bytes {
        file: File,
        chunk: [u8; 512],
        next: usize,
        length: usize,
    }

    impl Bytes {
        fn new(file: File) -> Self {
            Self {
                file,
                chunk: [0; 512],
                next: 0,
                length: 0,
            }
        }
    }

    impl Iterator for Bytes {
        type Item = u8;

        fn next(&mut self) -> Option<u8> {
            if self.next == self.length {
                self.next = 0;
                self.length = self
                    .file
                    .read(&mut self.chunk)
                    .expect("the file is readable");
            }
            let byte = self.chunk[..self.length].get(self.next).copied();
            self.next += 1;
            byte
        }
    }

    /// A file that is written in pieces: each write stops the processor for long.
    struct Lines {
        file: File,
        text: heapless::String<1024>,
    }

    impl Lines {
        fn flush(&mut self) {
            let written = self.file.write_all(self.text.as_bytes());
            written.expect("the file is writable");
            self.text.clear();
        }
    }

    impl fmt::Write for Lines {
        fn write_str(&mut self, text: &str) -> fmt::Result {
            if self.text.len() + text.len() > self.text.capacity() {
                self.flush();
            }
            self.text.push_str(text).map_err(|_| fmt::Error)
        }
    }

    /// Counts steps and writes down what the machine says.
    struct Witness {
        tally: StepStatistics,
        lines: Lines,
    }

    impl Watcher for Witness {
        fn edge(&mut self, edge: &Edge) {
            self.tally.add(edge);
        }

        fn answer(&mut self, _: u64, answer: &[u8]) {
            let answer = str::from_utf8(answer).unwrap_or("?");
            let _ = writeln!(self.lines, "answer {answer}");
        }

        fn message(&mut self, _: &Simulator, answers: u64, message: &[u8]) {
            let message = str::from_utf8(message).unwrap_or("?");
            let _ = writeln!(self.lines, "message {answers} {message}");
        }
    }

    fn settings(file: File) -> Settings {
        let mut settings = Settings::default();
        let mut statement = heapless::Vec::<u8, 80>::new();
        let mut bytes = Bytes::new(file);
        // The first line is the step rate.
        for byte in bytes.by_ref().take_while(|byte| *byte != b'\n') {
            statement.push(byte).expect("a rate is short");
        }
        let rate = str::from_utf8(&statement).ok();
        let rate = rate.and_then(|rate| rate.parse().ok());
        settings.step_rate = StepRate::of_image(rate.expect("the host gives a rate"));
        statement.clear();
        for byte in bytes {
            if byte == b'\n' {
                let assigned = settings::assign(&mut settings, &statement);
                assigned.expect("the host has checked the settings");
                statement.clear();
            } else {
                statement.push(byte).expect("settings are short");
            }
        }
        settings
    }

    fn report(
        witness: &mut Witness,
        end: StreamEnd,
        stream: &Stream<&mut Simulator, Bytes>,
    ) -> fmt::Result {
        let Witness { tally, lines } = witness;
        writeln!(lines, "end {end:?}")?;
        writeln!(lines, "lines {}", stream.lines)?;
        writeln!(lines, "state {:?}", stream.simulator.snapshot().state)?;
        for steps in &stream.simulator.snapshot().steps {
            writeln!(lines, "steps {steps}")?;
        }
        for pulses in &tally.pulses {
            writeln!(lines, "pulses {pulses}")?;
        }
        writeln!(lines, "ticks {}", tally.motion_ticks())?;
        writeln!(lines, "events {}", tally.events)?;
        writeln!(lines, "late {}", stream.simulator.late())?;
        writeln!(lines, "hash {:016x}", tally.hash)?;
        lines.flush();
        Ok(())
    }

    #[cortex_m_rt::entry]
    fn main() -> ! {
        let Ok(program) = File::open(c"program.nc") else {
            semihosting::println!("skipped: `cargo xtask sim FILE --on-target` gives the program");
            process::exit(0)
        };
        let settings = settings(File::open(c"settings.txt").expect("the host gives settings"));
        let file = File::create(c"figures.txt").expect("the folder is writable");
        let mut witness = Witness {
            tally: StepStatistics::new(),
            lines: Lines {
                file,
                text: heapless::String::new(),
            },
        };
        let mut simulator = Simulator::off();
        simulator.switch_on(&settings, None);
        let mut stream =
            Stream::new(&mut simulator, Bytes::new(program), 115_200).with_statements_at_rest();
        let end = stream.run(&mut witness);
        report(&mut witness, end, &stream).expect("the figures can be written");
        process::exit(0)
    }
}
