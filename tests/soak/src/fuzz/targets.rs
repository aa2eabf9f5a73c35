//! What gets the inputs. A target panics where the library does, or answers what it must not.

use leadscrew::{
    gcode::interpreter::{Interpreter, LineCommands},
    model::State,
    settings::{Settings, StepRate},
    sim::{Flash, Simulator},
    units::{TICKS_PER_MS, TICKS_PER_SECOND},
};

/// A part of the library that takes inputs.
pub(super) struct Target {
    pub(super) name: &'static str,
    pub(super) run: fn(&[u8]),
}

/// Every target.
pub(super) const TARGETS: [Target; 6] = [
    Target {
        name: "bytes",
        run: bytes,
    },
    Target {
        name: "lines",
        run: lines,
    },
    Target {
        name: "statements",
        run: statements,
    },
    Target {
        name: "hosts",
        run: hosts,
    },
    Target {
        name: "sessions",
        run: sessions,
    },
    Target {
        name: "flash",
        run: flash,
    },
];

const STEP_RATE: StepRate = StepRate::Proven(190_000);
/// Time of the machine after which an input is not followed any more, ticks.
const LONGEST_TICKS: u64 = 20 * TICKS_PER_SECOND as u64;
/// Changes of the pins after which an input is not followed any more.
const MOST_CHANGES: u32 = 20_000;

/// A machine that is switched on.
fn machine(flash: Option<Flash>) -> Box<Simulator> {
    let mut simulator = Box::new(match flash {
        Some(flash) => Simulator::power_up(flash, STEP_RATE),
        None => Simulator::new(&Settings::new(STEP_RATE)),
    });
    simulator.settle();
    simulator
}

/// Runs until nothing happens any more, or for long. Returns the bytes that the machine sends.
fn run_to_end(simulator: &mut Simulator) -> Vec<u8> {
    let end = simulator.now() + LONGEST_TICKS;
    let mut sent = Vec::new();
    for _ in 0..MOST_CHANGES {
        while let Some(byte) = simulator.send() {
            sent.push(byte);
        }
        simulator.settle();
        match simulator.due() {
            Some(due) if due <= end => _ = simulator.advance(due),
            _ if simulator.has_to_send() => {}
            _ => break,
        }
    }
    sent
}

/// Lets time pass. Returns the bytes that the machine sends.
fn pause(simulator: &mut Simulator, pause_ms: u32) -> Vec<u8> {
    let mut sent = Vec::new();
    let end = simulator.now() + u64::from(pause_ms) * u64::from(TICKS_PER_MS);
    for _ in 0..MOST_CHANGES {
        if simulator.now() >= end {
            break;
        }
        let next = simulator
            .due()
            .map_or(end, |due| due.clamp(simulator.now(), end));
        let _ = simulator.advance(next);
        while let Some(byte) = simulator.send() {
            sent.push(byte);
        }
        simulator.settle();
    }
    sent
}

fn receive(simulator: &mut Simulator, bytes: &[u8]) {
    for &byte in bytes {
        simulator.receive(byte);
        simulator.settle();
    }
}

/// Any bytes at once. The machine answers `?` afterwards.
fn bytes(input: &[u8]) {
    let mut simulator = machine(None);
    let mut sent = Vec::new();
    receive(&mut simulator, input);
    run_to_end(&mut simulator);
    // In the RepRap dialect realtime bytes count after a silence.
    for byte in [b"\x18", b"?"] {
        let _ = pause(&mut simulator, 200);
        receive(&mut simulator, byte);
        sent = run_to_end(&mut simulator);
    }
    assert!(sent.contains(&b'<'), "no report: {}", sent.escape_ascii());
}

/// Lines of G-code as the line assembler leaves them, one after the other. A line that is refused changes nothing.
fn lines(input: &[u8]) {
    let settings = Settings::new(STEP_RATE);
    let mut interpreter = Interpreter::new();
    let mut outcome = LineCommands::default();
    for line in input.split(|&byte| byte == b'\n') {
        let line: Vec<u8> = line
            .iter()
            .filter(|byte| byte.is_ascii_graphic())
            .map(u8::to_ascii_uppercase)
            .take(leadscrew::protocol::LINE_BYTES)
            .collect();
        let before = (*interpreter.modal(), interpreter.position());
        match interpreter.check(&line, &settings) {
            Ok(checked) => {
                interpreter.commit(&checked, &mut outcome);
                // As many commands as a line of cycles can have.
                for _ in 0..100_000 {
                    if interpreter.next_drilling_command().is_none() {
                        break;
                    }
                }
            }
            Err(_) => assert_eq!((*interpreter.modal(), interpreter.position()), before),
        }
    }
}

/// `$` statements, each answered once.
fn statements(input: &[u8]) {
    let mut simulator = machine(None);
    run_to_end(&mut simulator);
    for statement in input.split(|byte| matches!(byte, b'\n' | b'\r')) {
        let text = statement
            .iter()
            .filter(|byte| byte.is_ascii_graphic() && !b"!~?".contains(byte));
        let text: Vec<u8> = text.copied().collect();
        receive(&mut simulator, b"$");
        receive(&mut simulator, &text);
        receive(&mut simulator, b"\n");
        let sent = run_to_end(&mut simulator);
        let sent = String::from_utf8_lossy(&sent);
        let mut answers = sent.lines();
        let answers = answers
            .by_ref()
            .filter(|line| *line == "ok" || line.starts_with("error:"));
        match simulator.snapshot().state {
            State::Idle | State::Check => {
                assert_eq!(answers.count(), 1, "{}: {sent}", text.escape_ascii());
            }
            // It moves, sleeps, or waits for something.
            _ => {
                receive(&mut simulator, b"\x18");
                run_to_end(&mut simulator);
                receive(&mut simulator, b"$X\n");
                run_to_end(&mut simulator);
            }
        }
    }
}

/// Lines of hosts of 3D printers, with numbers and checksums or without: one `ok` each.
fn hosts(input: &[u8]) {
    let mut simulator = machine_for_hosts();
    for line in input.split(|byte| matches!(byte, b'\n' | b'\r')) {
        // Behind a line end these would be requests, which no `ok` answers.
        let begin = line
            .iter()
            .position(|byte| matches!(byte, b' '..=b'}') && !b"!?".contains(byte));
        let line = begin.map_or(&[][..], |begin| &line[begin..]);
        receive(&mut simulator, line);
        receive(&mut simulator, b"\n");
        let mut sent = run_to_end(&mut simulator);
        // An emergency is answered by the clock.
        sent.extend(pause(&mut simulator, 100));
        let sent = String::from_utf8_lossy(&sent);
        let answers = sent.lines().filter(|line| line.starts_with("ok")).count();
        // It moves or waits for long, or a reset has dropped the line.
        let is_other = sent.contains("echo:busy") || sent.contains("start");
        let settings = simulator.session().settings();
        if is_other || settings.dialect != 1 || simulator.snapshot().state != State::Idle {
            simulator = machine_for_hosts();
            continue;
        }
        let is_text = line.first().is_some_and(u8::is_ascii_alphanumeric);
        let expected = usize::from(is_text)..=1;
        assert!(
            expected.contains(&answers),
            "{}: {sent}",
            line.escape_ascii()
        );
    }
}

/// A machine in the dialect of hosts.
fn machine_for_hosts() -> Box<Simulator> {
    let mut simulator = machine(None);
    run_to_end(&mut simulator);
    receive(&mut simulator, b"$780=1\n");
    run_to_end(&mut simulator);
    simulator
}

/// Bytes with time between them: those from 0xb0 on are pauses, 0xa8 to 0xaf losses of power.
fn sessions(input: &[u8]) {
    let mut simulator = machine(None);
    for &byte in input {
        match byte {
            0xb0.. => {
                let _ = pause(&mut simulator, u32::from(byte - 0xaf).pow(2));
            }
            0xa8..=0xaf => simulator = machine(Some(simulator.into_flash())),
            byte => receive(&mut simulator, &[byte]),
        }
    }
    run_to_end(&mut simulator);
    assert_eq!(simulator.late(), 0, "late events");
}

/// Lines that store something, up to a byte 0, and changed bytes of the flash: two bytes of the place, and the new
/// byte. A machine with this flash is switched on, answers, and stores a setting.
fn flash(input: &[u8]) {
    let end = input
        .iter()
        .position(|&byte| byte == 0)
        .unwrap_or(input.len());
    let mut simulator = machine(None);
    for line in input[..end].split(|&byte| byte == b'\n') {
        receive(&mut simulator, line);
        receive(&mut simulator, b"\n");
        run_to_end(&mut simulator);
        if simulator.snapshot().state != State::Idle {
            receive(&mut simulator, b"\x18\n$X\n");
            run_to_end(&mut simulator);
        }
    }
    let mut flash = simulator.into_flash();
    let contents = flash.contents_mut();
    let used = contents
        .iter()
        .rposition(|&byte| byte != 0xff)
        .map_or(1, |last| last + 8);
    let (changes, _) = input.get(end + 1..).unwrap_or_default().as_chunks();
    for &[low, high, new] in changes {
        let place = usize::from(u16::from_le_bytes([low, high])) % used;
        if let Some(byte) = contents.get_mut(place) {
            *byte = new;
        }
    }
    let mut simulator = machine(Some(flash));
    run_to_end(&mut simulator);
    for line in ["\x18", "$X\n", "$20=0\n", "$22=0\n"] {
        receive(&mut simulator, line.as_bytes());
        run_to_end(&mut simulator);
    }
    // A startup line may have begun a long move.
    if simulator.snapshot().state != State::Idle {
        return;
    }
    receive(&mut simulator, b"$27=7.5\n");
    run_to_end(&mut simulator);
    let mut simulator = machine(Some(simulator.into_flash()));
    run_to_end(&mut simulator);
    let pull_off_mm = simulator.session().settings().homing_pull_off_mm;
    assert_eq!(pull_off_mm, 7.5, "a setting that is not stored");
}
