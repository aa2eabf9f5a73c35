//! `cargo xtask send`: a program to a machine, from a terminal.

mod machine;
mod record;
mod screen;

use std::{
    io::Read as _,
    os::{fd::AsFd as _, unix::net::UnixStream},
    path::Path,
    process::ExitCode,
    time::{Duration, Instant},
};

use anstream::println;
use anyhow::{Context, Result, anyhow, bail, ensure};
use common::options::{self, Send as Options, Verb};
use common::{text::duration, ui};
use grbl_client::{
    JobGuard, Link, Machine, MachineAnswers, guard,
    link::{self, LinkLost, PollFlags, Stopped},
    transmission::{Phase, Transmission},
};
use leadscrew::{axis::AXES, units::Nm};
use simulation::{
    forecast::{Forecast, RefusedLine},
    interrupt,
    machine_answers::{self, UNLIMITED_BAUD},
    output,
    program::{Program, encoding_warning},
    progress::{JobClock, JobReport},
    refusal,
    resume::{self, Entry, Plunge},
    sender::Response,
};

use record::{Record, RecordFile};
use screen::{Keyboard, Screen};

/// How often the machine is asked for a report.
const REPORT_INTERVAL: Duration = Duration::from_millis(200);
/// How often it is kept how far the job is.
const RECORD_PERIOD: Duration = Duration::from_secs(1);
/// How long a job that is stopped may take to end.
const STOP: Duration = Duration::from_secs(30);

/// How often it is looked whether a machine is back.
const RETRY: Duration = Duration::from_millis(500);

fn main() -> ExitCode {
    guard::become_guard_if_asked();
    common::main(|| match options::read() {
        Verb::Send(options) => run(&options).map_err(|error| {
            if error.is::<Stopped>() {
                anyhow!("it was stopped before the job was begun")
            } else {
                error
            }
        }),
        other => other.refuse(),
    })
}

fn run(options: &Options) -> Result<ExitCode> {
    // What is wrong with the program or the record is told before anything is connected.
    let lines = read(&options.file)?;
    let mut file = RecordFile::of_program(&options.file);
    let program = record::checksum(&lines);
    let mut kept = options.resume.then(|| file.read(program)).transpose()?;
    let mut stop = interrupt::interruptions()?;
    let mut keyboard = Keyboard::new();
    loop {
        let machine = connect(options, &mut stop)?;
        let hands = (&mut keyboard, &mut stop);
        let ended = send(options, machine, &lines, kept.as_ref(), &mut file, hands);
        match ended {
            Err(error) if options.wait && error.is::<LinkLost>() => {
                ui::warning(&format!("{error:#}"));
                kept = file.last.clone().or(kept);
            }
            ended => return ended,
        }
    }
}

/// Connects with the machine, which may have to be waited for.
fn connect(options: &Options, stop: &mut UnixStream) -> Result<Machine> {
    let to = &options.connection;
    let mut is_reported = false;
    loop {
        let link = Link::open(to.port.as_deref(), to.baud, to.tcp.as_deref(), to.timeout);
        match link.and_then(|link| Machine::connect(link, to.timeout, Some(stop))) {
            Err(error) if options.wait && !error.is::<Stopped>() => {
                if !is_reported {
                    is_reported = true;
                    ui::status("Waiting", &format!("{error:#} (Ctrl-C ends)"));
                }
                let files = [(stop.as_fd(), PollFlags::IN)];
                ensure!(!link::wait(&files, RETRY)?[0], Stopped);
            }
            connected => return connected,
        }
    }
}

/// Sends the job, or what is left of it.
fn send(
    options: &Options,
    mut machine: Machine,
    lines: &[Vec<u8>],
    kept: Option<&Record>,
    file: &mut RecordFile,
    (keyboard, stop): (&mut Keyboard, &mut UnixStream),
) -> Result<ExitCode> {
    let continues = kept.is_some() || options.from.is_some();
    if continues {
        machine::wait_for_standstill(&mut machine)?;
    }
    machine::make_ready(&mut machine, options.home)?;
    let answers = machine.answers()?;
    let began = kept.map_or(&answers, |record| &record.began);
    let forecast = forecast_of(options, began, lines, stop)?;
    let (approach, first) = if continues {
        let entry = find_entry(options, kept, &answers, lines, stop)?;
        show(&entry);
        ensure!(is_confirmed(options, keyboard, stop)?, "nothing was sent");
        (entry.approach, entry.line)
    } else {
        (Vec::new(), 0)
    };
    // Ctrl-C while the job was tried: it would be held only after its first lines.
    ensure!(!link::is_stopped(stop)?, Stopped);
    let mut job = Transmission::new(&approach, lines, first, options.despite_refusals);
    // It has the offset in it, which not every report has.
    job.status.clone_from(&machine.status);
    let settings = machine_answers::settings(began);
    let travel = |axis| settings.travel(axis).map(|ends| ends.map(Nm::to_mm_f64));
    job.travel_mm = (0..AXES).map(travel).collect();
    let mut run = Run {
        guard: JobGuard::of(&machine.link)?,
        job,
        machine,
        keyboard,
        screen: Screen::new(lines.len()),
        clock: JobClock::beginning_at(&forecast.times, first),
        forecast,
        first,
        file,
        record: Record {
            program: record::checksum(lines),
            answered: first,
            measured: None,
            stopped_at: None,
            began: began.clone(),
        },
        stop,
    };
    let ended = run.drive();
    run.screen.clear();
    run.finish(ended, options)
}

/// The lines of a program.
fn read(path: &Path) -> Result<Vec<Vec<u8>>> {
    ensure!(
        path != Path::new("-"),
        "standard input is for keys: give the program as a file"
    );
    let mut program = Program::open(path)?;
    let mut lines = Vec::new();
    while let Some(line) = program.next_line()? {
        lines.push(line);
    }
    ensure!(!lines.is_empty(), "{} is empty", path.display());
    if let Some(line) = program.foreign_line() {
        ui::warning(&encoding_warning(line));
    }
    Ok(lines)
}

/// Fails at Ctrl-C.
fn go_on(stop: &UnixStream) -> Result<()> {
    ensure!(!link::is_stopped(stop)?, Stopped);
    Ok(())
}

/// Runs the job on the virtual machine.
fn forecast_of(
    options: &Options,
    began: &MachineAnswers,
    lines: &[Vec<u8>],
    stop: &UnixStream,
) -> Result<Forecast> {
    let baud = if options.connection.port.is_some() {
        options.connection.baud
    } else {
        UNLIMITED_BAUD
    };
    ui::status("Trying", "the job on the virtual machine");
    let bar = output::progress(lines.len() as u64, "lines");
    let forecast = Forecast::of(began, lines, baud, |answered| {
        bar.set_position(answered as u64);
        go_on(stop)
    });
    bar.finish_and_clear();
    let forecast = forecast.context("the job was tried on the virtual machine")?;
    if !forecast.refused.is_empty() {
        for RefusedLine { line, error } in &forecast.refused {
            let response = Response::Error(*error);
            println!("{}", refusal(*line as u64, &lines[line - 1], response));
        }
        let count = forecast.refused.len();
        ensure!(
            options.despite_refusals,
            "{count} lines would be refused, and nothing was sent: --despite-refusals sends the job all the same"
        );
        ui::warning(&format!("{count} lines will be refused"));
    }
    let estimate = forecast.times.probing.map_or(String::new(), |line| {
        let line = line + 1;
        format!(", an estimate: where the probe in line {line} makes contact is unknown")
    });
    let (count, time) = (lines.len(), duration(forecast.times.total_s));
    let what = format!("{count} lines, {time}{estimate}");
    ui::status("Job", &what);
    Ok(forecast)
}

/// Finds where the job is continued.
fn find_entry(
    options: &Options,
    kept: Option<&Record>,
    answers: &MachineAnswers,
    lines: &[Vec<u8>],
    stop: &UnixStream,
) -> Result<Entry> {
    let wanted = match (kept, options.from) {
        (Some(record), _) => {
            // The line may be faster than it was thought: then more moves wait in the machine.
            // Where the operator has measured a tool, its path is another than that of the virtual machine.
            let place = record.stopped_at.as_deref();
            let place = place.filter(|_| record.measured.is_none());
            let forecast =
                Forecast::passing(place, &record.began, lines, UNLIMITED_BAUD, |_| go_on(stop))?;
            let undone = forecast.stopped_in(record.answered).min(lines.len() - 1);
            // A reset has taken away what the operator has measured: he does so again.
            record.measured.map_or(undone, |line| line.min(undone))
        }
        (None, Some(line)) => line as usize - 1,
        (None, None) => bail!("neither --resume nor --from is given"),
    };
    let plunge = Plunge {
        feed_mm_min: options.plunge,
        spin_up_s: options.spin_up.as_secs_f32(),
        reports_tool: kept.is_some_and(|record| record.measured.is_some()),
    };
    let began = kept.map(|record| &record.began);
    let entry = resume::entry_of_answers(lines, wanted, began, answers, plunge)?;
    if entry.line < wanted {
        let (first, wanted) = (entry.line + 1, wanted + 1);
        println!("Line {wanted} cannot begin a job; it is continued at line {first}.");
    }
    Ok(entry)
}

/// Shows what will happen before anything moves.
fn show(entry: &Entry) {
    ui::status("Continue", &format!("at line {}", entry.line + 1));
    println!("modes     {}", entry.modes);
    println!("tool      T{}", entry.tool);
    println!("position  {}", entry.position.join(" "));
    for line in &entry.approach {
        println!("approach  {line}");
    }
}

/// Whether the machine is known to be where it says.
fn is_confirmed(options: &Options, keyboard: &mut Keyboard, stop: &UnixStream) -> Result<bool> {
    if options.confirmed {
        return Ok(true);
    }
    let question = if options.home {
        "Is this tool in the spindle, and the way free?"
    } else {
        "The machine has not been homed now. Is it where it says, is this tool in the spindle, and the way free?"
    };
    keyboard.confirms(question, stop)
}

/// A job on its way.
struct Run<'a> {
    guard: JobGuard,
    job: Transmission,
    machine: Machine,
    keyboard: &'a mut Keyboard,
    screen: Screen,
    forecast: Forecast,
    clock: JobClock,
    /// The first line of the program that is sent, counted from 0.
    first: usize,
    file: &'a mut RecordFile,
    record: Record,
    stop: &'a mut UnixStream,
}

impl Run<'_> {
    /// Moves bytes, keys and time until the job has ended.
    fn drive(&mut self) -> Result<()> {
        let (mut asked, mut kept) = (None::<Instant>, None::<Instant>);
        let (mut answered, mut ticked) = (0, Instant::now());
        let mut stopping = None::<Instant>;
        loop {
            self.job.has_operator = self.keyboard.has_operator();
            if asked.is_none_or(|asked| asked.elapsed() >= REPORT_INTERVAL) {
                asked = Some(Instant::now());
                self.job.ask();
            }
            let output = self.job.take_output();
            self.machine.link.send(&output)?;
            if self.job.answered() != answered {
                answered = self.job.answered();
                self.job.undone = self.forecast.times.first_undone(answered).max(self.first);
            }
            let passed_s = ticked.elapsed().as_secs_f64();
            ticked = Instant::now();
            let report = JobReport::from(&self.job);
            self.clock.tick(&self.forecast.times, report, passed_s);
            self.show();
            if kept.is_none_or(|kept| kept.elapsed() >= RECORD_PERIOD) {
                kept = Some(Instant::now());
                self.keep();
            }
            match &self.job.phase {
                Phase::Running => {}
                Phase::Stopping(reason) | Phase::Resetting(reason) => {
                    let since = stopping.get_or_insert_with(Instant::now);
                    ensure!(
                        since.elapsed() < STOP,
                        "{reason}, and the machine does not come to rest"
                    );
                }
                Phase::Done => return Ok(()),
                Phase::Failed(reason) => bail!("{reason}"),
            }
            self.exchange()?;
        }
    }

    fn show(&mut self) {
        for note in self.job.take_notes() {
            self.screen.print_line(&note);
        }
        if !self.job.status.report.state.is_empty() {
            self.screen.show(&self.job, &self.clock.progress);
        }
    }

    /// Waits for bytes and keys, and takes them.
    fn exchange(&mut self) -> Result<()> {
        let input = std::io::stdin();
        let mut files = vec![
            (self.machine.link.as_fd(), PollFlags::IN),
            (self.stop.as_fd(), PollFlags::IN),
        ];
        if self.keyboard.has_operator() {
            files.push((input.as_fd(), PollFlags::IN));
        }
        let ready = link::wait(&files, REPORT_INTERVAL / 4)?;
        if ready[0] {
            self.machine.link.receive()?;
            while let Some(line) = self.machine.link.line()? {
                self.job.receive(&line);
            }
        }
        if ready[1] {
            let mut signals = [0; 16];
            let count = self.stop.read(&mut signals).unwrap_or_default();
            ensure!(
                self.job.phase == Phase::Running,
                "the job was left while it was being stopped"
            );
            (0..count).for_each(|_| self.job.interrupt());
        }
        if ready.get(2) == Some(&true) {
            for key in self.keyboard.read() {
                self.job.key(key);
            }
        }
        Ok(())
    }

    /// Keeps how far the job is.
    fn keep(&mut self) {
        self.record.answered = self.job.answered();
        self.record.measured = self.job.measured;
        self.record.stopped_at.clone_from(&self.job.stopped_at);
        self.file.write(&self.record);
    }

    /// Tells how the job has ended.
    fn finish(mut self, ended: Result<()>, options: &Options) -> Result<ExitCode> {
        // In every other case the machine may still move.
        if matches!(self.job.phase, Phase::Done | Phase::Failed(_)) {
            self.guard.dismiss();
        }
        for note in self.job.take_notes() {
            println!("{note}");
        }
        if let Err(error) = ended {
            self.keep();
            let (line, name) = (self.clock.progress.line + 1, options.file.display());
            let option = if self.file.is_lost {
                "--from LINE"
            } else {
                "--resume"
            };
            return Err(error.context(format!(
                "{name} was interrupted in line {line}: {option} continues it"
            )));
        }
        self.file.remove();
        let position = self.job.status.machine_position().unwrap_or_default();
        let position: Vec<_> = position.iter().map(|value| format!("{value:.3}")).collect();
        ui::status(
            "Done",
            &format!(
                "{} lines, machine position {}",
                self.job.answered(),
                position.join(" ")
            ),
        );
        Ok(ExitCode::from(u8::from(!self.forecast.refused.is_empty())))
    }
}
