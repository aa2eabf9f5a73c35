//! What the operator sees and presses: on a terminal a bar, the state and the keys; elsewhere lines.

use std::{
    io::IsTerminal as _,
    os::{fd::AsFd as _, unix::net::UnixStream},
    time::{Duration, Instant},
};

use anstream::println;
use anyhow::{Result, bail};
use common::text::duration;
use grbl_client::{
    Status,
    link::{self, PollFlags, Stopped},
    transmission::Transmission,
};
use indicatif::{ProgressBar, ProgressStyle};
use jiff::{SignedDuration, Zoned};
use leadscrew::axis::LETTERS;
use rustix::{
    io::Errno,
    termios::{LocalModes, OptionalActions, Termios},
};
use simulation::{output, progress::Progress};

/// How often the state is printed where nobody can see a bar.
const PRINT_EVERY: Duration = Duration::from_secs(10);

/// The operator's keyboard.
pub(crate) struct Keyboard {
    /// The modes of the terminal before.
    before: Option<Termios>,
    is_at_end: bool,
}

impl Keyboard {
    /// Makes keys count as they are pressed, where standard input is a terminal.
    pub(crate) fn new() -> Self {
        let input = std::io::stdin();
        let before = input
            .is_terminal()
            .then(|| rustix::termios::tcgetattr(&input).ok())
            .flatten();
        if let Some(before) = &before {
            let mut modes = before.clone();
            modes
                .local_modes
                .remove(LocalModes::ICANON | LocalModes::ECHO);
            let _ = rustix::termios::tcsetattr(&input, OptionalActions::Now, &modes);
        }
        Self {
            before,
            is_at_end: false,
        }
    }

    /// Whether somebody can press a key.
    pub(crate) fn has_operator(&self) -> bool {
        !self.is_at_end
    }

    /// Takes what has been pressed, once there is something.
    pub(crate) fn read(&mut self) -> Vec<u8> {
        let mut bytes = [0; 64];
        match rustix::io::read(std::io::stdin(), &mut bytes) {
            Ok(length @ 1..) => bytes[..length].to_vec(),
            Err(Errno::INTR | Errno::AGAIN) => Vec::new(),
            Ok(0) | Err(_) => {
                self.is_at_end = true;
                Vec::new()
            }
        }
    }

    /// Asks for a yes. Nobody says no.
    pub(crate) fn confirms(&mut self, question: &str, stop: &UnixStream) -> Result<bool> {
        println!("{question} [y/n]");
        while self.has_operator() {
            let input = std::io::stdin();
            let files = [
                (input.as_fd(), PollFlags::IN),
                (stop.as_fd(), PollFlags::IN),
            ];
            let ready = link::wait(&files, Duration::from_secs(1))?;
            if ready[1] {
                bail!(Stopped);
            }
            let pressed = if ready[0] { self.read() } else { Vec::new() };
            for key in pressed {
                match key {
                    b'y' | b'Y' => return Ok(true),
                    b'n' | b'N' | b'q' => return Ok(false),
                    _ => {}
                }
            }
        }
        Ok(false)
    }
}

impl Drop for Keyboard {
    fn drop(&mut self) {
        if let Some(before) = &self.before {
            let _ = rustix::termios::tcsetattr(std::io::stdin(), OptionalActions::Now, before);
        }
    }
}

/// The screen.
pub(crate) struct Screen {
    bar: ProgressBar,
    /// There is no bar: lines are printed.
    is_plain: bool,
    printed: Option<Instant>,
    state: String,
    lines: usize,
}

impl Screen {
    pub(crate) fn new(lines: usize) -> Self {
        let bar = output::progress(lines as u64, "lines");
        let template = "{bar:40.green/dim} {percent:>3} %\n{wide_msg}\n{prefix}";
        if let Ok(style) = ProgressStyle::with_template(template) {
            bar.set_style(style.progress_chars("━╸─"));
            bar.set_prefix(LEGEND);
        }
        Self {
            bar,
            is_plain: !std::io::stderr().is_terminal(),
            printed: None,
            state: String::new(),
            lines,
        }
    }

    /// Shows a message.
    pub(crate) fn print_line(&self, text: &str) {
        self.bar.suspend(|| println!("{text}"));
    }

    /// Shows where the job is, by the lines that the machine has carried out.
    pub(crate) fn show(&mut self, job: &Transmission, progress: &Progress) {
        let left = SignedDuration::from_secs_f64(progress.left_s);
        let end = Zoned::now().checked_add(left);
        let end = end.ok().filter(|_| !job.status.report.is_held());
        let state = state(&job.status, progress, self.lines, end.as_ref());
        self.bar.set_position(progress.line as u64);
        let typed = job.manual_lines.text.as_ref();
        let typed = typed.map_or(String::new(), |text| format!("\n> {text}"));
        self.bar.set_message(format!("{state}{typed}"));
        let is_due = self
            .printed
            .is_none_or(|printed| printed.elapsed() >= PRINT_EVERY);
        if self.is_plain && (is_due || self.state != job.status.report.state) {
            self.printed = Some(Instant::now());
            self.state.clone_from(&job.status.report.state);
            println!("{state}");
        }
    }

    /// Takes the bar away.
    pub(crate) fn clear(&self) {
        self.bar.finish_and_clear();
    }
}

/// The keys and what they do.
const LEGEND: &str =
    "h hold  r resume  q stop  t type  + - 0 feed  f m l rapids  S s spindle  c coolant";

/// The state of a job in a line, with the time of day at which it ends.
fn state(status: &Status, progress: &Progress, lines: usize, end: Option<&Zoned>) -> String {
    let position = status.work_position().or_else(|| status.machine_position());
    let position = position.unwrap_or_default();
    let position = LETTERS
        .iter()
        .zip(position)
        .map(|(letter, value)| format!("{}{value:.3}", char::from(*letter)));
    let position: Vec<_> = position.collect();
    // Whole seconds, also below a minute.
    let left = match progress.left_s.round() {
        seconds if seconds < 60.0 => format!("{seconds} s"),
        seconds => duration(seconds),
    };
    let about = if progress.is_estimated { "about " } else { "" };
    let end = end.map_or(String::new(), |end| {
        format!(", ends {about}{}", end.strftime("%H:%M"))
    });
    let report = &status.report;
    let speeds = report.field("FS").or_else(|| report.field("F"));
    let speeds = speeds.unwrap_or_default().split(',').zip(["F", "S"]);
    let speeds: Vec<_> = speeds
        .map(|(value, letter)| format!("{letter}{value}"))
        .collect();
    let names = ["feed", "rapids", "spindle"];
    let overrides = names.iter().zip(status.overrides);
    let overrides = overrides.filter(|(_, percent)| *percent != 100);
    let overrides: Vec<_> = overrides
        .map(|(name, percent)| format!("  {name} {percent} %"))
        .collect();
    let overrides = overrides.concat();
    let state = &report.state;
    let line = (progress.line + 1).min(lines);
    format!(
        "{state:<7} line {line} of {lines}  {about}{left} left{end}  {}  {}{overrides}",
        position.join(" "),
        speeds.join(" "),
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use grbl_client::transmission::KEYS;

    #[test]
    fn every_key_is_shown_and_no_other() {
        let shown = LEGEND.split(' ').filter(|word| word.len() == 1);
        let known = KEYS.map(|(key, _)| char::from(key).to_string());
        assert!(shown.eq(known.iter().map(String::as_str)), "{known:?}");
    }

    fn progress(line: usize, left_s: f64) -> Progress {
        Progress {
            line,
            left_s,
            ..Progress::default()
        }
    }

    #[test]
    fn a_line_tells_state_progress_position_and_overrides() {
        let mut status = Status::default();
        status.read("<Run|MPos:1.000,2.000,-3.000|FS:500,8000|WCO:0.000,0.000,1.000>");
        status.read("<Run|MPos:1.000,2.000,-3.000|FS:500,8000|Ov:110,50,90>");
        let end: Zoned = "2026-11-29T14:05:00[UTC]".parse().unwrap();
        assert_eq!(
            state(&status, &progress(5, 63.2), 20, Some(&end)),
            "Run     line 6 of 20  1 min 3 s left, ends 14:05  X1.000 Y2.000 Z-4.000  F500 S8000  feed 110 %  \
             rapids 50 %  spindle 90 %"
        );
        status.read("<Hold:0|MPos:1.000,2.000,-3.000|F:0|Ov:100,100,100>");
        assert_eq!(
            state(&status, &progress(20, 3.4), 20, None),
            "Hold:0  line 20 of 20  3 s left  X1.000 Y2.000 Z-4.000  F0"
        );
        let estimated = Progress {
            is_estimated: true,
            ..progress(5, 63.2)
        };
        let state = state(&status, &estimated, 20, Some(&end));
        let expected = "line 6 of 20  about 1 min 3 s left, ends about 14:05  X1";
        assert!(state.contains(expected), "{state}");
    }
}
