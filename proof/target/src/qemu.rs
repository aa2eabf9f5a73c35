//! `cargo xtask qemu`: the firmware itself, on the emulated board.

use std::{
    path::Path,
    process::ExitCode,
    time::{Duration, Instant},
};

use anstream::println;
use anyhow::{Result, bail, ensure};
use common::options::Qemu as Options;
use common::{cargo, text, ui};
use grbl_client::{
    Report, Response, Sender,
    meaning::{self, LineOfAlarm},
    realtime,
    sender::Received,
};
use indicatif::ProgressBar;
use leadscrew::settings::{Settings, StepRate};
use simulation::{
    alarm_row,
    figures::{Figures, Final},
    output,
    playing::RaisedAlarm,
    program::Program,
    refusal,
    settings::{self, Loaded},
    summary,
};
use target::emulator::{Emulator, Patience, Pins};

pub(crate) fn run(options: &Options) -> Result<ExitCode> {
    // What cannot be read is reported before anything is built.
    let load = |rate| settings::load_for(rate, options.settings.as_deref(), &options.set);
    load(StepRate::Proven(u32::MAX))?;
    let program = Program::open(&options.file)?;
    cargo::need_qemu()?;
    let (board, machine) = firmware::boards::emulated()?;
    let elf = match &options.elf {
        Some(elf) => elf.to_path_buf(),
        None => firmware::firmware(&board)?,
    };
    let loaded = load(crate::step_rate(&elf)?)?;
    ui::status("Booting", &format!("{} under QEMU", board.name));
    let start = Instant::now();
    let bar = output::progress(program.length(), "bytes");
    drop(program);
    let played = play_file(&options.file, &elf, &machine, &loaded, bar.clone());
    bar.finish_and_clear();
    let figures = played?;
    summary::print(&figures);
    text::row("took", &format!("{:.2} s", start.elapsed().as_secs_f64()));
    if let Some(path) = &options.json {
        output::write_json(path, &figures)?;
    }
    Ok(ExitCode::from(u8::from(!figures.is_clean())))
}

/// Boots a firmware and plays a program on it; prints refused lines where `bar` is shown.
pub(crate) fn play_file(
    path: &Path,
    elf: &Path,
    machine: &str,
    loaded: &Loaded,
    bar: ProgressBar,
) -> Result<Figures> {
    let program = Program::open(path)?;
    let mut emulator = Emulator::start(elf, machine)?;
    play(&mut emulator, program, loaded, bar)
}

/// Silence after which the machine is asked for its state.
const QUIET: Duration = Duration::from_millis(100);
/// Silence after which it is given up, and time for which a moving machine may stay where it is.
const TIMEOUT: Duration = Duration::from_secs(30);

/// Streams a program and waits until everything is executed.
pub(crate) fn play(
    emulator: &mut Emulator,
    program: Program,
    loaded: &Loaded,
    bar: ProgressBar,
) -> Result<Figures> {
    emulator.wait_for_welcome(TIMEOUT)?;
    let patience = emulator.patience(TIMEOUT);
    let mut host = Host {
        emulator,
        sender: Sender::default(),
        figures: Figures::default(),
        bar,
        state: String::new(),
        report: String::new(),
        heard: patience,
        changed: patience,
    };
    for statement in &loaded.statements {
        host.emulator.set(statement, TIMEOUT)?;
    }
    host.stream(program)?;
    host.wait_for_standstill()?;
    let Host {
        emulator,
        figures,
        state,
        ..
    } = host;
    let pins = emulator.pins()?;
    Ok(with_pins(figures, &pins, state, &loaded.settings))
}

/// The figures of what was answered, with what the pins did.
fn with_pins(answered: Figures, pins: &Pins, state: String, settings: &Settings) -> Figures {
    Figures {
        end: Final::new(state, &pins.steps, settings),
        steps_axis: pins.pulses.clone(),
        motion_time_s: pins.motion_time_s,
        events: pins.events,
        // The emulated timer does not go on before the step interrupt has run.
        late: 0,
        event_hash: format!("{:016x}", pins.hash),
        lines: answered.lines,
        responses: answered.responses,
        messages: answered.messages,
        times: answered.times,
        refusals: answered.refusals,
        foreign_line: answered.foreign_line,
    }
}

/// The sender's side of a run.
struct Host<'a> {
    emulator: &'a mut Emulator,
    sender: Sender,
    figures: Figures,
    bar: ProgressBar,
    /// State in the newest status report.
    state: String,
    /// The newest status report, and when it was another one.
    report: String,
    changed: Patience,
    /// When anything arrived last.
    heard: Patience,
}

impl Host<'_> {
    fn stream(&mut self, mut program: Program) -> Result<()> {
        let mut next = program.next_line()?;
        loop {
            while let Some(line) = next.take_if(|line| self.sender.may_send(line)) {
                self.emulator.send(&line)?;
                self.emulator.send(b"\n")?;
                self.sender.send(line);
                self.bar.set_position(program.read());
                next = program.next_line()?;
            }
            if next.is_none() && self.sender.is_done() {
                self.figures.lines = self.sender.sent();
                return Ok(());
            }
            self.listen()?;
            if self.state == "Hold:0" {
                // A program pause: whoever stands at the machine presses cycle start.
                self.state.clear();
                self.emulator.send(&[realtime::RESUME])?;
            }
        }
    }

    fn wait_for_standstill(&mut self) -> Result<()> {
        self.state.clear();
        self.changed.restart();
        self.emulator.send(&[realtime::REPORT])?;
        loop {
            self.listen()?;
            match self.state.as_str() {
                "Idle" | "Alarm" => return Ok(()),
                _ => ensure!(
                    !self.changed.is_over(),
                    "the machine does not come to rest: {}",
                    self.report
                ),
            }
        }
    }

    /// Takes what has arrived; asks for the state when it was quiet for a while.
    fn listen(&mut self) -> Result<()> {
        let Some(line) = self.emulator.receive(QUIET)? else {
            ensure!(
                !self.heard.is_over(),
                "the firmware does not answer any more, after {} lines",
                self.sender.answered()
            );
            return self.emulator.send(&[realtime::REPORT]);
        };
        self.heard.restart();
        if let Some(report) = Report::read(&line) {
            self.state = report.state;
            if line != self.report {
                self.report = line;
                self.changed.restart();
            }
            return Ok(());
        }
        match self.sender.receive(&line) {
            Received::Answer(answered) => {
                self.figures.responses.push(answered.response);
                let (number, line) = (answered.number, &answered.line);
                if answered.response != Response::Ok
                    && self.figures.refusals.add(number, line, answered.response)
                {
                    let text = refusal(number, line, answered.response);
                    self.bar.suspend(|| println!("{text}"));
                }
            }
            Received::Surplus(response) => bail!("the firmware answers {response} to nothing"),
            Received::Message if line.is_empty() => {}
            Received::Message => {
                if let Some(number) = line.strip_prefix("ALARM:") {
                    let place = match meaning::line_of_alarm(number) {
                        Some(LineOfAlarm::Unanswered) => self.sender.oldest(),
                        Some(LineOfAlarm::InExecution) | None => None,
                    };
                    let place = place.unwrap_or((self.sender.answered(), b""));
                    let alarm = RaisedAlarm::at(number, place);
                    self.bar.suspend(|| println!("{}", alarm_row(&alarm)));
                    self.figures.refusals.raise(alarm);
                }
                self.figures.messages.push((self.sender.answered(), line));
            }
        }
        Ok(())
    }
}
