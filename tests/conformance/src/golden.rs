//! The recorded runs, and what has to be known of their programs.

use std::{
    collections::BTreeMap,
    fs,
    path::{Path, PathBuf},
};

use anyhow::{Context, Result};
use leadscrew::{
    axis::AXES,
    gcode::interpreter::{Interpreter, LineCommands},
    model::Levels,
    settings::Settings,
    sim::{Closes, Switch},
};
use serde::Deserialize;

use simulation::{program::Program, sender, settings};

/// One recorded file.
#[derive(Debug, Deserialize)]
struct Recording {
    program: String,
    category: String,
    runs: BTreeMap<String, Run>,
    /// Where the probe closed, in words.
    #[serde(default)]
    probe_model: Option<String>,
}

/// One recorded run.
#[derive(Debug, Clone, Deserialize)]
pub(super) struct Run {
    /// The answers, as runs of equal ones.
    pub(super) responses: Vec<(String, u64)>,
    /// Everything else, after how many answers.
    pub(super) messages: Vec<(u64, String)>,
    /// Step pulses per axis.
    pub(super) steps_axis: Vec<u64>,
    /// Net steps per axis.
    pub(super) final_steps: Vec<i64>,
    /// From the first to the last step, s.
    pub(super) motion_time_s: f64,
    /// Share of the time in which Grbl's look-ahead had run dry.
    pub(super) planner_low_fraction: f64,
    /// What `?` said in the end.
    pub(super) final_status: String,
    /// What `$G` said.
    #[serde(rename = "final_GC")]
    pub(super) final_modes: Vec<String>,
    /// What `$#` said.
    pub(super) final_params: Vec<String>,
    /// Whether the program came to its end.
    #[serde(default)]
    pub(super) complete: bool,
    /// Whether laser mode was on.
    #[serde(default)]
    laser_mode: bool,
}

/// A program, a set of settings, and what Grbl did with them.
#[derive(Debug)]
pub(super) struct Case {
    /// Folder of the recording.
    pub(super) category: String,
    /// The program, relative to the data's folder.
    pub(super) program: String,
    /// Name of the set of settings.
    pub(super) settings_name: String,
    /// What was recorded.
    pub(super) run: Run,
    /// Height at and below which the probe is closed, mm.
    probe_mm: Option<f64>,
}

impl Case {
    /// The settings of the run.
    pub(super) fn settings(&self) -> Result<Settings> {
        let mut values = settings::named_set(&self.settings_name)?;
        if self.run.laser_mode {
            settings::apply(&mut values, "$32=1")?;
        }
        Ok(values)
    }

    /// The probe's contact.
    pub(super) fn switches(&self, settings: &Settings) -> Vec<Switch> {
        let scale = settings.steps_per_mm.0.get(2);
        let scale = scale.map_or(0.0, |scale| scale.millionths() as f64 * 1e-6);
        let probe = self.probe_mm.map(|mm| Switch {
            axis: 2,
            closes: Closes::DownFrom((mm * scale).round() as i32),
            input: Levels::PROBE,
        });
        probe.into_iter().collect()
    }
}

/// Reads the only model of a probe that the recordings have.
fn probe_height(model: &str) -> Result<f64> {
    let height = model.split_once("Z <= ").and_then(|(_, tail)| {
        let end = tail.find(' ').unwrap_or(tail.len());
        tail[..end].parse().ok()
    });
    height.with_context(|| format!("{model:?} does not say where the probe closes"))
}

/// Reads every recording in `dir`, or those of some categories.
pub(super) fn load(dir: &Path, categories: &[String]) -> Result<Vec<Case>> {
    let mut cases = Vec::new();
    for folder in sorted(&dir.join("golden"))? {
        let category = folder.file_name().unwrap_or_default().to_string_lossy();
        let wanted = categories.is_empty() || categories.iter().any(|name| *name == category);
        if !wanted || !folder.is_dir() {
            continue;
        }
        for file in sorted(&folder)? {
            if !file.to_string_lossy().ends_with(".grbl.json") {
                continue;
            }
            let name = file.display();
            let text = fs::read(&file).with_context(|| format!("cannot read {name}"))?;
            let recording: Recording =
                serde_json::from_slice(&text).with_context(|| format!("{name} is no recording"))?;
            let probe_mm = recording.probe_model.as_deref().map(probe_height);
            let probe_mm = probe_mm.transpose().with_context(|| format!("in {name}"))?;
            for (settings_name, run) in recording.runs {
                cases.push(Case {
                    category: recording.category.clone(),
                    program: recording.program.clone(),
                    settings_name,
                    run,
                    probe_mm,
                });
            }
        }
    }
    Ok(cases)
}

/// What is in a folder, in order.
pub(super) fn sorted(dir: &Path) -> Result<Vec<PathBuf>> {
    let entries = fs::read_dir(dir).with_context(|| format!("cannot read {}", dir.display()))?;
    let mut paths = entries
        .map(|entry| Ok(entry?.path()))
        .collect::<Result<Vec<_>>>()?;
    paths.sort();
    Ok(paths)
}

/// What a program contains, as far as it decides how exact a comparison can be.
#[derive(Debug, Default, Clone, PartialEq)]
pub(super) struct Traits {
    /// Arcs.
    pub(super) arcs: u64,
    /// `G20` words.
    pub(super) has_inches: bool,
    /// Points on which single precision can go either way.
    pub(super) ties: [Ties; AXES],
    /// The lines.
    pub(super) lines: Vec<String>,
}

/// Ends of moves that lie half-way between two steps of an axis, as far as single precision can
/// tell.
#[derive(Debug, Default, Clone, Copy, PartialEq)]
pub(super) struct Ties {
    /// How many.
    pub(super) points: u64,
    /// 1 when the last end of all is one.
    pub(super) end: u64,
    /// Bound of the error that Grbl's position of the axis has by now, mm.
    error_mm: f64,
}

impl Traits {
    /// Reads a program.
    pub(super) fn of(path: &Path, settings: &Settings) -> Result<Self> {
        let mut program = Program::recorded(path)?;
        let mut reader = Reader::new(settings);
        while let Some(line) = program.next_line()? {
            reader.read_line(&line);
        }
        Ok(reader.traits)
    }
}

/// Follows a program.
struct Reader<'a> {
    settings: &'a Settings,
    interpreter: Interpreter,
    is_arc: bool,
    is_incremental: bool,
    traits: Traits,
}

impl<'a> Reader<'a> {
    fn new(settings: &'a Settings) -> Self {
        Self {
            settings,
            interpreter: Interpreter::new(),
            is_arc: false,
            is_incremental: false,
            traits: Traits::default(),
        }
    }

    fn read_line(&mut self, line: &[u8]) {
        let text = String::from_utf8_lossy(line).into_owned();
        self.traits.lines.push(text);
        let code = sender::code(line);
        let Ok(checked) = self.interpreter.check(&code, self.settings) else {
            return;
        };
        for number in sender::g_numbers(&code) {
            match number {
                2.0 | 3.0 => self.is_arc = true,
                0.0 | 1.0 | 80.0 => self.is_arc = false,
                20.0 => self.traits.has_inches = true,
                90.0 => self.is_incremental = false,
                91.0 => self.is_incremental = true,
                _ => {}
            }
        }
        let moves = code.iter().any(|byte| b"XYZ".contains(byte));
        self.traits.arcs += u64::from(self.is_arc && moves);
        let before = self.interpreter.position();
        self.interpreter
            .commit(&checked, &mut LineCommands::default());
        let after = self.interpreter.position();
        for axis in (0..AXES).filter(|axis| before[*axis] != after[*axis]) {
            self.read_end(axis, after[axis].to_mm_f64());
        }
    }

    /// Whether single precision knows on which step a move ends.
    fn read_end(&mut self, axis: usize, mm: f64) {
        let scale = self.settings.steps_per_mm[axis].millionths() as f64 * 1e-6;
        let ties = &mut self.traits.ties[axis];
        // Reading, unit and offset round once each, and adding to the last position rounds again.
        let rounding = unit_in_last_place(mm) * 1.5;
        if self.is_incremental {
            ties.error_mm += rounding;
        } else {
            ties.error_mm = rounding;
        }
        let steps = mm * scale;
        let error = ties.error_mm * scale + unit_in_last_place(steps);
        ties.end = u64::from((steps.abs().fract() - 0.5).abs() <= error);
        ties.points += ties.end;
    }
}

/// Distance of neighbouring numbers of single precision.
fn unit_in_last_place(value: f64) -> f64 {
    let value = (value.abs() as f32).max(f32::MIN_POSITIVE);
    f64::from(f32::from_bits(value.to_bits() + 1) - value)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn traits(text: &str) -> Traits {
        let settings = Settings::default();
        let mut reader = Reader::new(&settings);
        for line in text.lines() {
            reader.read_line(line.as_bytes());
        }
        reader.traits
    }

    #[test]
    fn arcs_are_modal_and_comments_do_not_count() {
        assert_eq!(traits("G1 X1 F9\n(G2 X3)\nX4 ; G3 X1").arcs, 0);
        assert_eq!(traits("g02 X1 I.5 F9\nX2 I.5\nG1 X0\nX5").arcs, 2);
        assert!(traits("G20 G91").has_inches);
        assert!(!traits("G28 X200").has_inches);
    }

    #[test]
    fn the_probe_closes_where_the_recording_says() {
        let model = "probe pin closes when machine Z <= -5.000 mm";
        assert_eq!(probe_height(model).unwrap(), -5.0);
        assert!(probe_height("nowhere").is_err());
    }

    #[test]
    fn points_between_steps_are_counted() {
        // 250 steps/mm: a step is 4 µm.
        let found = traits("G0 X0.002 Y0.004\nX0.003\nX0.006");
        assert_eq!((found.ties[0].points, found.ties[0].end), (2, 1));
        assert_eq!(found.ties[1].points, 0);
        // 100 moves of 0.1 mm end 12.5 steps on, give or take what single precision loses.
        let steps = "G91\n".to_owned() + &"X0.1\n".repeat(1000) + "X0.00202";
        assert_eq!(traits(&steps).ties[0].end, 1);
    }
}
