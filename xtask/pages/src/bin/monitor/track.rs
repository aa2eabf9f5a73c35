//! Bytes of a machine to what they tell: positions, states, answers.
//!
//! Pure. A line counts when all of it can be read: what lost bytes have joined or cut is passed over.

use grbl_client::{Line, Lines, Status};

use crate::values::{self, Modes, NamedValue};

/// X, Y and Z.
pub(crate) const AXES: usize = 3;
const MM_PER_INCH: f64 = 25.4;

/// What a line tells.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Sighting {
    /// A line of the position stream: X and Y, and Z if it has one, steps.
    Steps([i32; 2], Option<i32>),
    /// A status report.
    Report(Report),
    /// `ok` or `error:N`.
    Answer(String),
    /// `ALARM:N`.
    Alarm(String),
    /// The welcome of Grbl.
    Welcome,
    /// Anything else.
    Other(String),
}

/// A status report.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Report {
    /// The state: `Run`, `Hold:0`.
    pub(crate) state: String,
    /// The machine position, mm.
    pub(crate) machine_mm: [f64; AXES],
    /// The machine position of the axes behind Z, degrees.
    pub(crate) rotary: Vec<f64>,
    /// The work position, mm.
    pub(crate) work_mm: [f64; AXES],
    /// The speed, mm/min, if the report has one.
    pub(crate) speed_mm_min: Option<f64>,
    /// What else it has, in words.
    pub(crate) values: Vec<NamedValue>,
}

/// The lines of a machine, and what earlier ones say about later ones.
#[derive(Debug, Default)]
pub(crate) struct Track {
    lines: Lines,
    status: Status,
    /// The answer to `$G`.
    pub(crate) modes: Modes,
    /// `$13`.
    is_in_inches: bool,
    /// `$100`, `$101`, `$102`.
    steps_per_mm: [Option<f64>; AXES],
}

impl Track {
    /// Of a machine that has told its status and its settings.
    pub(crate) fn new(status: Status, settings: &[String]) -> Self {
        let mut track = Self {
            status,
            ..Self::default()
        };
        for line in settings {
            track.read(line);
        }
        track
    }

    /// Reads bytes, and tells each line that they complete.
    pub(crate) fn push(&mut self, bytes: &[u8], mut receive: impl FnMut(&mut Self, Sighting)) {
        self.lines.push(bytes);
        while let Some(line) = self.lines.next_line() {
            let text = line.trim_end();
            // Noise is no text.
            if !text.is_empty() && !text.contains(char::REPLACEMENT_CHARACTER) {
                let sighting = self.read(text);
                receive(self, sighting);
            }
        }
    }

    /// Returns the resolution of each axis, steps/mm, where the machine has told those of X and Y.
    pub(crate) fn steps_per_mm(&self) -> Option<[f64; AXES]> {
        let [x, y, z] = self.steps_per_mm;
        Some([x?, y?, z.unwrap_or(1.0)])
    }

    fn read(&mut self, text: &str) -> Sighting {
        if let Some([x, y, z]) = steps(text) {
            return Sighting::Steps([x.unwrap_or(0), y.unwrap_or(0)], z);
        }
        match Line::read(text) {
            Line::Response(_) => return Sighting::Answer(text.into()),
            Line::Alarm(_) => return Sighting::Alarm(text.into()),
            Line::Welcome => return Sighting::Welcome,
            Line::Report(report) => {
                self.status.take(report);
                if let Some(report) = self.report() {
                    return Sighting::Report(report);
                }
            }
            Line::Setting(number, value) => self.setting(number, value),
            Line::Answer("GC", words) => {
                self.modes = Modes {
                    words: words.split(' ').map(str::to_owned).collect(),
                    are_old: false,
                }
            }
            _ => {}
        }
        Sighting::Other(text.into())
    }

    /// What the last report tells, if that is a position. Before an offset has been told, it is taken for 0.
    pub(crate) fn report(&self) -> Option<Report> {
        let Status { report, .. } = &self.status;
        let (machine, work) = (self.status.machine_position(), self.status.work_position());
        let machine = machine.or_else(|| work.clone())?;
        let scale = if self.is_in_inches { MM_PER_INCH } else { 1.0 };
        // Axes that the machine does not have stay at 0.
        let place = |values: &[f64]| {
            std::array::from_fn(|axis| values.get(axis).copied().unwrap_or_default() * scale)
        };
        Some(Report {
            state: report.state.clone(),
            machine_mm: place(&machine),
            work_mm: place(work.as_ref().unwrap_or(&machine)),
            rotary: machine.into_iter().skip(AXES).collect(),
            speed_mm_min: report.feed().map(|feed| feed * scale),
            values: values::of(&self.status, &self.modes, self.is_in_inches),
        })
    }

    /// Takes a setting that the machine has told.
    fn setting(&mut self, number: u16, value: &str) {
        match (number, value.parse::<f64>()) {
            (13, Ok(value)) => self.is_in_inches = value != 0.0,
            (100..=102, Ok(value)) if value > 0.0 => {
                self.steps_per_mm[usize::from(number - 100)] = Some(value);
            }
            _ => {}
        }
    }
}

/// Reads `X:45,Y:22`, or with `,Z:7` behind it.
fn steps(text: &str) -> Option<[Option<i32>; AXES]> {
    let mut found = [None; AXES];
    let mut words = text.split(',');
    for (letter, place) in ["X:", "Y:", "Z:"].into_iter().zip(&mut found) {
        let Some(word) = words.next() else {
            break;
        };
        let digits = word.strip_prefix(letter)?;
        // `parse` would take a plus as well, which nobody sends.
        *place = Some(digits.parse().ok().filter(|_| !digits.starts_with('+'))?);
    }
    let is_whole = found[1].is_some() && words.next().is_none();
    is_whole.then_some(found)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn seen(track: &mut Track, bytes: &str) -> Vec<Sighting> {
        let mut seen = Vec::new();
        track.push(bytes.as_bytes(), |_, sighting| seen.push(sighting));
        seen
    }

    #[test]
    fn positions_and_reports_are_read_however_their_bytes_come() {
        let bytes = "X:45,Y:-22\r\nX:1,Y:2,Z:-3\r\nok\r\n\
            <Run|MPos:1.000,2.000,3.000|FS:500,0|WCO:0.500,0.000,1.000>\r\nALARM:1\r\n";
        let mut track = Track::default();
        let whole = seen(&mut track, bytes);
        assert_eq!(whole[0], Sighting::Steps([45, -22], None));
        assert_eq!(whole[1], Sighting::Steps([1, 2], Some(-3)));
        assert_eq!(whole[2], Sighting::Answer("ok".into()));
        let Sighting::Report(report) = &whole[3] else {
            panic!("{whole:?}");
        };
        assert_eq!(report.state, "Run");
        assert_eq!(report.machine_mm, [1.0, 2.0, 3.0]);
        assert_eq!(report.work_mm, [0.5, 2.0, 2.0]);
        assert_eq!(report.rotary, Vec::<f64>::new());
        assert_eq!(report.speed_mm_min, Some(500.0));
        assert_eq!(whole[4], Sighting::Alarm("ALARM:1".into()));
        for size in 1..9 {
            let mut track = Track::default();
            let mut pieces = Vec::new();
            for piece in bytes.as_bytes().chunks(size) {
                pieces.extend(seen(&mut track, str::from_utf8(piece).unwrap()));
            }
            assert_eq!(pieces, whole, "{size}");
        }
    }

    #[test]
    fn truncated_and_joined_lines_are_no_positions() {
        let mut track = Track::default();
        for line in [
            "X:4X:45,Y:22",
            "X:45,Y:",
            "X:45",
            "X:,Y:1",
            "Y:22",
            "X:45,Y:22ok",
            "X:45,Y:22,Z:1,A:2",
            "X:45,Z:22",
            "X:45, Y:22",
            "X:+45,Y:22",
            "X:4.5,Y:22",
            "X:99999999999,Y:0",
            "<Run|MPos:1.000,2.0<Run|FS:0,0>",
            "<Run|MPos:x,1,2|FS:0,0>",
            "Run|MPos:1.000,2.000,3.000>",
            "<Run|MPos:1.000,2.000,3.000|FS:5",
            "<|MPos:1.000,2.000,3.000>",
        ] {
            let found = seen(&mut track, &format!("{line}\n"));
            assert_eq!(found, [Sighting::Other(line.into())]);
        }
    }

    #[test]
    fn foreign_bytes_are_passed_over() {
        let mut track = Track::default();
        track.push(b"\xff\xfe\x00\x01garbage\xc0\n", |_, sighting| {
            panic!("{sighting:?}")
        });
        track.push(&[b'x'; 5000], |_, sighting| panic!("{sighting:?}"));
        assert_eq!(
            seen(&mut track, "X:1,Y:1\nX:1,Y:2\n"),
            [Sighting::Steps([1, 2], None)]
        );
        assert!(track.lines.is_empty());
        let host = "T:20.0 /0.0 X:1.00 Y:2.00 Z:3.00 E:0.00 Count X:1 Y:2 Z:3";
        assert_eq!(
            seen(&mut track, &format!("{host}\n")),
            [Sighting::Other(host.into())]
        );
    }

    #[test]
    fn reports_of_other_machines_are_read() {
        let mut track = Track::default();
        let mut report = |line: &str| match seen(&mut track, &format!("{line}\r\n")).remove(0) {
            Sighting::Report(report) => report,
            other => panic!("{other:?}"),
        };
        let old = report("<Idle,MPos:5.529,0.560,7.000,WPos:1.529,-5.440,-0.000>");
        assert_eq!(
            (old.machine_mm, old.work_mm),
            ([5.529, 0.56, 7.0], [1.529, -5.44, 0.0])
        );
        assert_eq!((old.state.as_str(), old.speed_mm_min), ("Idle", None));
        let two_axes = report("<Hold:0|MPos:1.000,2.000|F:30>");
        assert_eq!(
            (two_axes.machine_mm, two_axes.speed_mm_min),
            ([1.0, 2.0, 0.0], Some(30.0))
        );
        assert_eq!(two_axes.state, "Hold:0");
        let four = report("<Idle|MPos:1.000,2.000,3.000,-45.000|FS:0,0>");
        assert_eq!(four.rotary, [-45.0]);
        report("<Idle|WPos:0.000,0.000,0.000|WCO:10.000,20.000,30.000>");
        let work = report("<Run|WPos:1.000,2.000,3.000|FS:0,0>");
        assert_eq!(work.machine_mm, [11.0, 22.0, 33.0]);
    }

    #[test]
    fn settings_tell_the_unit_and_the_resolution() {
        let mut track = Track::default();
        seen(&mut track, "$100=250.000 (x, step/mm)\r\n");
        assert_eq!(track.steps_per_mm(), None);
        seen(&mut track, "$101=80\r\n$13=1\r\n");
        assert_eq!(track.steps_per_mm(), Some([250.0, 80.0, 1.0]));
        let report = seen(&mut track, "<Run|MPos:1.0000,0.0000,2.0000|FS:10.0,0>\n");
        let [Sighting::Report(report)] = &report[..] else {
            panic!("{report:?}");
        };
        assert_eq!(report.machine_mm, [25.4, 0.0, 50.8]);
        assert_eq!(report.speed_mm_min, Some(254.0));
    }
}
