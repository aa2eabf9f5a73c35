//! What a run shows: answers, messages, and where the machine ended.
//!
//! The JSON form is fixed: other tools read it. Answers are kept as runs of equal ones, so a
//! program of a million accepted lines takes no memory.

use leadscrew::{model::Alarm, settings::Settings};
use serde::{Serialize, Serializer, ser::SerializeSeq};

use crate::{Refusals, job_times::JobTimes, sender::Response};

/// The answers to all lines, in order.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Responses {
    runs: Vec<(Response, u64)>,
}

impl Responses {
    /// Adds the answer to the next line.
    pub fn push(&mut self, response: Response) {
        match self.runs.last_mut() {
            Some((last, count)) if *last == response => *count += 1,
            _ => self.runs.push((response, 1)),
        }
    }

    /// The answers with their line numbers, from 1.
    pub fn iter(&self) -> impl Iterator<Item = (u64, Response)> {
        let each = self
            .runs
            .iter()
            .flat_map(|(response, count)| (0..*count).map(|_| *response));
        (1..).zip(each)
    }

    /// Number of lines that were refused.
    pub fn refused(&self) -> u64 {
        let errors = self.runs.iter().filter(|(run, _)| *run != Response::Ok);
        errors.map(|(_, count)| count).sum()
    }
}

impl Serialize for Responses {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut sequence = serializer.serialize_seq(None)?;
        for answer in self.iter() {
            sequence.serialize_element(&answer)?;
        }
        sequence.end()
    }
}

/// Where the machine ended.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct Final {
    /// State, with Grbl's name.
    pub state: String,
    /// Machine position, mm.
    pub mpos_mm: Vec<f64>,
    /// Step counters: of the motors, on a `CoreXY` machine.
    pub steps: Vec<i32>,
}

impl Final {
    /// The positions in mm follow from those in steps.
    pub fn new(state: String, steps: &[i32], settings: &Settings) -> Self {
        let scales = settings.steps_per_mm.iter();
        let mm = steps.iter().zip(scales).map(|(steps, scale)| {
            // Millionths of a step per mm: whole, so the quotient is the nearest number.
            f64::from(*steps) * 1e6 / scale.millionths() as f64
        });
        let mut mpos_mm: Vec<f64> = mm.collect();
        if let (true, [a, b, ..]) = (settings.core_xy, mpos_mm.as_mut_slice()) {
            (*a, *b) = (0.5 * (*a + *b), 0.5 * (*a - *b));
        }
        Self {
            state,
            mpos_mm,
            steps: steps.to_vec(),
        }
    }
}

/// Everything a run shows.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct Figures {
    /// Number of lines sent.
    pub lines: u64,
    /// The answers.
    pub responses: Responses,
    /// Everything else the machine said, after how many answers.
    pub messages: Vec<(u64, String)>,
    /// Where it ended.
    #[serde(rename = "final")]
    pub end: Final,
    /// Step pulses per axis.
    pub steps_axis: Vec<u64>,
    /// From the first to the last step, s.
    pub motion_time_s: f64,
    /// Step events: axes that step together count once.
    pub events: u64,
    /// Step events that came late.
    pub late: u64,
    /// Hash over all step events, 16 hexadecimal digits.
    pub event_hash: String,
    /// What the time goes into: for the reader.
    #[serde(skip)]
    pub times: JobTimes,
    /// Why lines were refused: for the reader.
    #[serde(skip)]
    pub refusals: Refusals,
    /// The first line of the program that is not UTF-8: for the reader.
    #[serde(skip)]
    pub foreign_line: Option<u64>,
}

impl Figures {
    /// The sum of `times`, from the start of the first motion to the end of the last motion, s. Where `times` is
    /// unknown: the time from the first step to the last step.
    pub fn whole_time_s(&self) -> f64 {
        match self.times.total_s() {
            0.0 => self.motion_time_s,
            total_s => total_s,
        }
    }

    /// Whether an alarm rose.
    pub fn has_alarm(&self) -> bool {
        let mut messages = self.messages.iter();
        self.end.state == "Alarm" || messages.any(|(_, text)| text.starts_with("ALARM:"))
    }

    /// Whether homing or a probe found nothing.
    pub fn misses_switches(&self) -> bool {
        let missing = [Alarm::HomingNotFound, Alarm::ProbeContact].map(|alarm| alarm.to_string());
        let mut messages = self.messages.iter();
        messages.any(|(_, text)| missing.contains(text))
    }

    /// Whether every line was accepted and no alarm rose.
    pub fn is_clean(&self) -> bool {
        self.responses.refused() == 0 && !self.has_alarm()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_json_form_is_the_documented_one() {
        let mut responses = Responses::default();
        for response in [Response::Ok, Response::Ok, Response::Error(20)] {
            responses.push(response);
        }
        let figures = Figures {
            lines: 3,
            responses,
            messages: vec![(2, "[MSG:Pgm End]".into())],
            end: Final {
                state: "Idle".into(),
                mpos_mm: vec![1.5, 0.0, -2.0],
                steps: vec![375, 0, -500],
            },
            steps_axis: vec![375, 0, 500],
            motion_time_s: 0.25,
            events: 800,
            late: 0,
            event_hash: "cbf29ce484222325".into(),
            ..Figures::default()
        };
        let expected = r#"{"lines":3,"responses":[[1,"ok"],[2,"ok"],[3,"error:20"]],"messages":[[2,"[MSG:Pgm End]"]],"final":{"state":"Idle","mpos_mm":[1.5,0.0,-2.0],"steps":[375,0,-500]},"steps_axis":[375,0,500],"motion_time_s":0.25,"events":800,"late":0,"event_hash":"cbf29ce484222325"}"#;
        assert_eq!(serde_json::to_string(&figures).unwrap(), expected);
        assert!(!figures.is_clean());
    }

    #[test]
    fn the_parts_of_the_time_are_not_more_than_the_whole() {
        // The steps are within the motions: the first one is not at once.
        let mut figures = Figures {
            motion_time_s: 0.25,
            ..Figures::default()
        };
        assert_eq!(figures.whole_time_s(), 0.25);
        figures.times.cutting_s = 0.26;
        figures.times.rapid_s = 0.5;
        assert_eq!(figures.whole_time_s(), 0.26 + 0.5);
    }
}
