//! Serving over a pair of sockets.

use std::os::{fd::AsFd as _, unix::net::UnixStream};

use leadscrew::settings::Settings;
use simulation::machine::Machine;

use super::*;

impl Port for UnixStream {
    fn line(&self) -> Option<BorrowedFd<'_>> {
        Some(self.as_fd())
    }
}

fn server(recorder: &mut ()) -> Server<'_, ()> {
    Server::new(Simulator::new(&Settings::default()), None, recorder)
}

#[test]
fn an_idle_machine_waits_for_bytes_alone() {
    let mut recorder = ();
    let mut server = server(&mut recorder);
    // As if it had been switched on a while ago: the welcome has been sent.
    server.start -= Duration::from_secs(1);
    server.run().unwrap();
    assert!(server.unsent.starts_with(b"\r\nGrbl"));
    assert_eq!(server.timeout(), None);
    // A motion is run by the millisecond.
    server.start -= Duration::from_secs(1);
    server.machine.send(b"G1X10F100\n");
    server.run().unwrap();
    server.start -= Duration::from_secs(1);
    server.run().unwrap();
    let timeout = server.timeout().unwrap();
    assert!(
        timeout.tv_sec == 0 && timeout.tv_nsec < 3_000_000,
        "{timeout:?}"
    );
}

#[test]
fn a_machine_with_a_clock_passes_time_in_silence() {
    let mut recorder = ();
    let mut settings = Settings::default();
    leadscrew::settings::assign(&mut settings, b"780=1").unwrap();
    let mut server = Server::new(Simulator::new(&settings), None, &mut recorder);
    server.run().unwrap();
    server.machine.send(b"N0 M110 N0*125\nN1 G1 X3*96");
    for _ in 0..3 {
        server.start -= Duration::from_secs(1);
        server.run().unwrap();
        let timeout = server.timeout().unwrap();
        assert!(timeout.tv_sec == 0 && timeout.tv_nsec <= 10_000_000);
    }
    // The lost end of the line has been missed after a second.
    let text = String::from_utf8(server.unsent).unwrap();
    assert!(text.contains("Resend: 1\r\n"), "{text}");
}

#[test]
fn a_machine_that_is_served_is_recorded() {
    let mut recorder = ();
    let server = server(&mut recorder);
    let (mut port, sender) = UnixStream::pair().unwrap();
    port.set_nonblocking(true).unwrap();
    let (stop, stopper) = UnixStream::pair().unwrap();
    let talk = std::thread::spawn(move || {
        let (mut writer, reader) = (sender.try_clone().unwrap(), sender);
        std::io::Write::write_all(&mut writer, b"G1X0.1F600\nG999\n?\nG4P0.001\n").unwrap();
        let lines = std::io::BufRead::lines(std::io::BufReader::new(reader));
        let answers = lines.map(|line| line.unwrap());
        let count = answers
            .filter(|line| line == "ok" || line.starts_with("error"))
            .take(4)
            .count();
        drop(stopper);
        count
    });
    let figures = server.serve(&mut port, &stop).unwrap();
    assert_eq!(talk.join().unwrap(), 4);
    assert_eq!((figures.lines, figures.steps_axis[0]), (4, 25));
    assert_eq!(figures.end.mpos_mm[0], 0.1);
    assert_eq!(figures.responses.refused(), 1);
    let messages: Vec<_> = figures.messages.iter().map(|(_, text)| text).collect();
    assert!(
        messages.iter().all(|text| !text.starts_with('<')),
        "{messages:?}"
    );
}

#[test]
fn bytes_on_the_line_make_a_machine_due() {
    let mut machine = Machine::amid(Simulator::new(&Settings::default()), Vec::new());
    machine.run_for(0.1);
    assert_eq!(machine.due_s(), None);
    machine.send(b"\n");
    assert!(machine.due_s().unwrap() > machine.now_s());
}
