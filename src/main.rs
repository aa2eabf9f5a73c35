//! The firmware on the target; on the host, the same machine on standard input and output.
#![cfg_attr(target_os = "none", no_std, no_main)]
#![warn(clippy::unwrap_used)]

#[cfg(target_os = "none")]
mod app;
#[cfg(target_os = "none")]
mod board;

/// Executes the G-code on standard input in virtual time and prints what the machine answers.
#[cfg(not(target_os = "none"))]
fn main() -> std::io::Result<()> {
    use std::io::{BufWriter, Read, Write, stdin, stdout};

    use leadscrew::{
        settings::Settings,
        sim::{Edge, Simulator, Stream, Watcher},
    };

    struct Printer<W: Write>(W, std::io::Result<()>);

    impl<W: Write> Printer<W> {
        fn print(&mut self, line: &[u8]) {
            let written = self
                .0
                .write_all(line)
                .and_then(|()| self.0.write_all(b"\n"));
            if let Err(error) = written {
                self.1 = Err(error);
            }
        }
    }

    impl<W: Write> Watcher for Printer<W> {
        fn edge(&mut self, _edge: &Edge) {}

        fn answer(&mut self, _line: u64, answer: &[u8]) {
            self.print(answer);
        }

        fn message(&mut self, _: &Simulator, _answers: u64, message: &[u8]) {
            self.print(message);
        }
    }

    let program = stdin().lock().bytes().map_while(Result::ok);
    let mut printer = Printer(BufWriter::new(stdout().lock()), Ok(()));
    let mut simulator = Simulator::new(&Settings::default());
    Stream::new(&mut simulator, program, 115_200).run(&mut printer);
    printer.0.flush()?;
    printer.1
}
