//! One job: from the texts of its program and its settings to its page.

use std::path::Path;

use crate::page;
use anyhow::{Context as _, Result};
use leadscrew::{
    settings::{Settings, StepRate},
    sim::Simulator,
    units::TICKS_PER_SECOND,
};
use serde::Serialize;
use simulation::{
    Recording, RefusalRow, SwitchPositions,
    figures::Figures,
    playing::{self, Playing},
    program::{Program, encoding_warning},
    settings::{Dump, Loaded, decoded},
};

/// Causes of refusals in the summary: a file that is no program has one in each line.
const MOST_CAUSES: usize = 100;

/// A job.
#[derive(Default)]
pub(crate) struct Run {
    /// The program, the settings, and the names of both.
    texts: [Vec<u8>; 4],
    begun: Option<RunningJob>,
    /// The summary and the page.
    outcomes: [Vec<u8>; 2],
}

/// A job that has begun.
struct RunningJob {
    playing: Playing<Box<Simulator>, Recording>,
    name: String,
    has_switches: bool,
    settings: Settings,
    warnings: Vec<String>,
}

/// What the page says beside the view of the job.
#[derive(Serialize)]
struct Summary<'a> {
    hash: &'a str,
    events: u64,
    late: u64,
    lines: u64,
    refused: u64,
    motion_time_s: f64,
    /// `Idle`.
    end: &'a str,
    causes: Vec<RefusalRow>,
    warnings: Vec<String>,
}

impl Run {
    /// Makes room for a text of some bytes.
    pub(crate) fn room(&mut self, which: usize, bytes: usize) -> &mut [u8] {
        let text = &mut self.texts[which];
        text.clear();
        text.resize(bytes, 0);
        text
    }

    /// Begins the job, for a firmware that is proven for a step rate, 0 for none, perhaps amid switches.
    pub(crate) fn begin(&mut self, step_rate_hz: u32, has_switches: bool) -> Result<()> {
        self.begun = None;
        self.outcomes = Default::default();
        let [program, settings, name, file] = self.texts.each_mut().map(std::mem::take);
        let [name, file] = [name, file].map(|name| String::from_utf8_lossy(&name).into_owned());
        let dump = Dump::read(&decoded(&settings));
        let file = (!file.is_empty()).then(|| Path::new(&file));
        let loaded = Loaded::of_dump(StepRate::of_image(step_rate_hz), file, &dump)?;
        let mut simulator = Box::new(Simulator::new(&loaded.settings));
        if has_switches {
            SwitchPositions::of(&loaded.settings).mount_on(&mut simulator);
        }
        playing::unlock(&mut simulator);
        let recording = Recording::new(simulator.session());
        let program = Program::from_bytes(name.clone(), program);
        self.begun = Some(RunningJob {
            playing: Playing::new(program, simulator, recording),
            name,
            has_switches,
            settings: loaded.settings,
            warnings: dump.left_out().into_iter().collect(),
        });
        Ok(())
    }

    /// Goes on for at most so many changes of the machine. Returns whether the job has come to its end.
    ///
    /// # Panics
    /// If no job has begun.
    pub(crate) fn pump(&mut self, changes: u32) -> bool {
        let begun = self.begun.as_mut().expect("a job has begun");
        begun.playing.pump(changes)
    }

    /// Bytes of the program that have been read.
    pub(crate) fn read(&self) -> u64 {
        self.begun.as_ref().map_or(0, |begun| begun.playing.read())
    }

    /// The time of the machine, s.
    pub(crate) fn seconds(&self) -> f64 {
        let now = |begun: &RunningJob| begun.playing.simulator().now();
        self.begun.as_ref().map_or(0, now) as f64 / f64::from(TICKS_PER_SECOND)
    }

    /// Makes summary and page.
    pub(crate) fn finish(&mut self) -> Result<()> {
        let begun = self.begun.take().context("no job has begun")?;
        let RunningJob {
            playing,
            name,
            has_switches,
            settings,
            mut warnings,
        } = begun;
        let (figures, recording) = playing.finish()?;
        if figures.lines == 0 {
            warnings.push(format!("{name} is empty"));
        }
        warnings.extend(figures.foreign_line.map(encoding_warning));
        warnings.extend(figures.refusals.alarm().map(ToString::to_string));
        if !has_switches && figures.misses_switches() {
            warnings.push("the machine has no switches and no probe".into());
        }
        let summary = serde_json::to_vec(&summary(&figures, warnings))?;
        let job = recording.finish(&figures, &name, &settings);
        self.outcomes = [summary, page::write(&job).into_bytes()];
        Ok(())
    }

    /// The summary or the page.
    pub(crate) fn outcome(&self, which: usize) -> &[u8] {
        &self.outcomes[which]
    }
}

fn summary(figures: &Figures, warnings: Vec<String>) -> Summary<'_> {
    let causes = figures.refusals.causes();
    Summary {
        hash: &figures.event_hash,
        events: figures.events,
        late: figures.late,
        lines: figures.lines,
        refused: figures.responses.refused(),
        motion_time_s: figures.motion_time_s,
        end: &figures.end.state,
        causes: causes
            .into_iter()
            .take(MOST_CAUSES)
            .map(RefusalRow::of)
            .collect(),
        warnings,
    }
}

#[cfg(test)]
mod tests {
    use serde_json::Value;

    use super::*;

    fn put(run: &mut Run, texts: [&str; 4]) {
        for (which, text) in texts.iter().enumerate() {
            run.room(which, text.len()).copy_from_slice(text.as_bytes());
        }
    }

    /// Plays a program by some changes at a time.
    fn played(run: &mut Run, changes: u32) -> (Value, Vec<u8>) {
        run.begin(190_000, false).unwrap();
        while !run.pump(changes) {}
        run.finish().unwrap();
        let summary = serde_json::from_slice(run.outcome(0)).unwrap();
        (summary, run.outcome(1).to_vec())
    }

    const PROGRAM: &str = "G21\nG0X3Y2\nG1X9F400\nG999\nM106\nM30\n";

    #[test]
    fn a_job_pumped_in_pieces_gives_the_figures_and_the_page_of_the_whole() {
        let mut run = Run::default();
        let texts = [PROGRAM, "$110=400\nok\n", "a.nc", "mill.txt"];
        let [whole, pieces] = [u32::MAX, 7].map(|changes| {
            put(&mut run, texts);
            played(&mut run, changes)
        });
        assert_eq!(whole, pieces);
        assert_eq!(
            (&whole.0["lines"], &whole.0["refused"]),
            (&6.into(), &2.into())
        );
        assert_eq!(whole.0["causes"][0]["what"], "G999");
        assert!(
            String::from_utf8(whole.1)
                .unwrap()
                .contains("<title>a.nc</title>")
        );
    }

    #[test]
    fn settings_that_are_refused_begin_nothing() {
        let mut run = Run::default();
        put(
            &mut run,
            [PROGRAM, "$110=400\n$3=300\n$1=1,5\n", "a.nc", "mill.txt"],
        );
        let error = format!("{:#}", run.begin(190_000, false).unwrap_err());
        assert!(
            error.starts_with("mill.txt: 2 lines are refused"),
            "{error}"
        );
        assert!(
            error.contains("line 2: $3=300") && error.contains("line 3: $1=1,5"),
            "{error}"
        );
        assert!(run.finish().is_err());
    }

    #[test]
    fn a_machine_homes_amid_switches_only() {
        for (has_switches, refused) in [(false, true), (true, false)] {
            let mut run = Run::default();
            let settings = "$22=1\n$130=20\n$131=20\n$132=20\n$24=300\n$25=900\n";
            put(&mut run, ["$H\nG53G0X-5\n", settings, "a.nc", ""]);
            run.begin(190_000, has_switches).unwrap();
            while !run.pump(u32::MAX) {}
            run.finish().unwrap();
            let summary: Value = serde_json::from_slice(run.outcome(0)).unwrap();
            assert_eq!(summary["refused"] != 0, refused, "{summary}");
            let warnings = summary["warnings"].to_string();
            assert_eq!(warnings.contains("no switches"), refused, "{warnings}");
        }
    }

    #[test]
    fn what_is_left_out_of_the_settings_is_reported() {
        let mut run = Run::default();
        put(&mut run, ["", "$36=1\n$22=1\n", "a.nc", "mill.txt"]);
        let (summary, _) = played(&mut run, u32::MAX);
        let warnings = summary["warnings"].to_string();
        assert!(
            warnings.contains("$36") && warnings.contains("a.nc is empty"),
            "{warnings}"
        );
    }

    #[test]
    fn a_machine_that_is_switched_on_locked_is_unlocked() {
        let mut run = Run::default();
        put(&mut run, [PROGRAM, "$22=1\n$23=7\n", "a.nc", ""]);
        run.begin(190_000, false).unwrap();
        while !run.pump(1000) {}
        assert!(run.read() == PROGRAM.len() as u64 && run.seconds() > 0.1);
        run.finish().unwrap();
        let summary: Value = serde_json::from_slice(run.outcome(0)).unwrap();
        assert_eq!(summary["causes"][0]["answer"], "error:20", "{summary}");
    }
}
