//! Status reports: `<Run|MPos:1.000,0.000,0.000|FS:500,8000>`.

use std::{error::Error, fmt, str::FromStr};

/// A status report, taken apart. Every field is kept, whether it is one of Grbl's or not.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Report {
    /// The state, with its number where it has one: `Idle`, `Hold:0`.
    pub state: String,
    /// Name and value of every field, in order.
    pub fields: Vec<(String, String)>,
}

/// What is free in the machine: `Bf:15,128`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Room {
    /// Moves that could still wait.
    pub blocks: u32,
    /// Bytes that could still be received.
    pub bytes: u32,
}

/// A text is no status report.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct NoReport(String);

impl fmt::Display for NoReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "`{}` is no status report", self.0)
    }
}

impl Error for NoReport {}

impl FromStr for Report {
    type Err = NoReport;

    fn from_str(text: &str) -> Result<Self, NoReport> {
        Self::read(text).ok_or_else(|| NoReport(text.into()))
    }
}

impl Report {
    /// Reads a line without its end; `None` for what is no report, and for one that bytes are missing from. Grbl
    /// 0.9, whose fields have commas between them, is understood.
    #[must_use]
    pub fn read(line: &str) -> Option<Self> {
        let inner = line.strip_prefix('<')?.strip_suffix('>')?;
        let is_old = inner.contains(',') && !inner.contains('|');
        let mut parts = inner.split(if is_old { ',' } else { '|' });
        let state = parts.next()?;
        let is_state = state.starts_with(|first: char| first.is_ascii_uppercase());
        if !is_state || inner.contains(['<', '>']) {
            return None;
        }
        let mut fields: Vec<(String, String)> = Vec::new();
        for part in parts {
            match (part.split_once(':'), fields.last_mut()) {
                (Some((name, value)), _) => fields.push((name.into(), value.into())),
                (None, Some((_, value))) if is_old => {
                    value.push(',');
                    value.push_str(part);
                }
                (None, _) => return None,
            }
        }
        let state = state.into();
        let report = Self { state, fields };
        let places = ["MPos", "WPos", "WCO"];
        let is_whole = |name| {
            report
                .field(name)
                .is_none_or(|text| numbers(text).is_some())
        };
        places.into_iter().all(is_whole).then_some(report)
    }

    /// The state without its number: `Hold`.
    #[must_use]
    pub fn state_name(&self) -> &str {
        self.state.split(':').next().unwrap_or_default()
    }

    /// The value of a field.
    #[must_use]
    pub fn field(&self, name: &str) -> Option<&str> {
        let mut fields = self.fields.iter();
        let (_, value) = fields.find(|(known, _)| known == name)?;
        Some(value)
    }

    /// The numbers of a field.
    #[must_use]
    pub fn numbers(&self, name: &str) -> Option<Vec<f64>> {
        numbers(self.field(name)?)
    }

    /// The machine position, if the report has it: others have the work position.
    #[must_use]
    pub fn machine_position(&self) -> Option<Vec<f64>> {
        self.numbers("MPos")
    }

    /// X, Y and Z of the machine position, as they are written.
    #[must_use]
    pub fn xyz(&self) -> Option<&str> {
        let position = self.field("MPos")?;
        let of_more = position.match_indices(',').nth(2);
        Some(of_more.map_or(position, |(end, _)| &position[..end]))
    }

    /// The work position, if the report has it.
    #[must_use]
    pub fn work_position(&self) -> Option<Vec<f64>> {
        self.numbers("WPos")
    }

    /// The machine position of the work zero, which is in some reports.
    #[must_use]
    pub fn work_offset(&self) -> Option<Vec<f64>> {
        self.numbers("WCO")
    }

    /// The feed now.
    #[must_use]
    pub fn feed(&self) -> Option<f64> {
        let numbers = self.numbers("FS").or_else(|| self.numbers("F"))?;
        numbers.first().copied()
    }

    /// The speed of the spindle now, rpm.
    #[must_use]
    pub fn spindle_speed(&self) -> Option<f64> {
        self.numbers("FS")?.get(1).copied()
    }

    /// What is free in the machine, where `$10` asks for that.
    #[must_use]
    pub fn room(&self) -> Option<Room> {
        let (blocks, bytes) = self.field("Bf")?.split_once(',')?;
        Some(Room {
            blocks: blocks.parse().ok()?,
            bytes: bytes.parse().ok()?,
        })
    }

    /// The `N` word of the block that is carried out.
    #[must_use]
    pub fn line_number(&self) -> Option<u32> {
        self.field("Ln")?.parse().ok()
    }

    /// The inputs that are active, a letter for each: `P` probe, `X`, `Y`, `Z` limits, `D` door, `R` reset, `H` hold,
    /// `S` cycle start. None is reported of a machine where no input is.
    #[must_use]
    pub fn pins(&self) -> &str {
        self.field("Pn").unwrap_or_default()
    }

    /// Overrides of feed, rapids and spindle, %, which are in some reports.
    #[must_use]
    pub fn overrides(&self) -> Option<[u16; 3]> {
        let numbers = self.field("Ov")?.split(',').map(str::parse);
        let numbers: Vec<u16> = numbers.collect::<Result<_, _>>().ok()?;
        numbers.try_into().ok()
    }

    /// What is switched on, a letter for each: `S` spindle clockwise, `C` the other way, `F` flood, `M` mist. Known
    /// of reports with [overrides](Self::overrides), none in which it is missing when nothing is.
    #[must_use]
    pub fn accessories(&self) -> Option<&str> {
        self.field("A").or(self.field("Ov").map(|_| ""))
    }

    /// Whether the machine waits in a hold or with the door open, at rest.
    #[must_use]
    pub fn is_held(&self) -> bool {
        matches!(
            self.state.as_str(),
            "Hold:0" | "Hold" | "Door:0" | "Door:1" | "Door" | "Tool"
        )
    }

    /// Whether nothing moves.
    #[must_use]
    pub fn is_at_rest(&self) -> bool {
        self.is_held() || matches!(self.state_name(), "Idle" | "Alarm" | "Check" | "Sleep")
    }
}

/// The newest report, with what earlier ones have had and it has not.
#[derive(Debug, Clone, PartialEq)]
pub struct Status {
    /// The newest report; before the first one its state is empty.
    pub report: Report,
    offset: Option<Vec<f64>>,
    /// Overrides of feed, rapids and spindle, %.
    pub overrides: [u16; 3],
    accessories: String,
}

impl Default for Status {
    fn default() -> Self {
        Self {
            report: Report::default(),
            offset: None,
            overrides: [100; 3],
            accessories: String::new(),
        }
    }
}

impl Status {
    /// Takes a line. Returns whether it was a report.
    pub fn read(&mut self, line: &str) -> bool {
        let report = Report::read(line);
        report.map(|report| self.take(report)).is_some()
    }

    /// Takes a report.
    pub fn take(&mut self, report: Report) {
        self.offset = report.work_offset().or(self.offset.take());
        self.overrides = report.overrides().unwrap_or(self.overrides);
        if let Some(accessories) = report.accessories() {
            self.accessories = accessories.into();
        }
        self.report = report;
    }

    /// The machine position, once it can be told.
    #[must_use]
    pub fn machine_position(&self) -> Option<Vec<f64>> {
        let reported = self.report.machine_position();
        reported.or_else(|| self.shifted(self.report.work_position()?, 1.0))
    }

    /// The work position, once it can be told.
    #[must_use]
    pub fn work_position(&self) -> Option<Vec<f64>> {
        let reported = self.report.work_position();
        reported.or_else(|| self.shifted(self.report.machine_position()?, -1.0))
    }

    /// What was on in the newest report that says so, a letter for each.
    #[must_use]
    pub fn accessories(&self) -> &str {
        &self.accessories
    }

    /// The machine position of the work zero, once it has been told.
    #[must_use]
    pub fn work_offset(&self) -> Option<&[f64]> {
        self.offset.as_deref()
    }

    fn shifted(&self, mut from: Vec<f64>, sign: f64) -> Option<Vec<f64>> {
        let offset = self.offset.as_ref()?;
        for (value, offset) in from.iter_mut().zip(offset) {
            *value += sign * offset;
        }
        Some(from)
    }
}

/// Numbers between commas; `None` where one cannot be read.
#[must_use]
pub fn numbers(text: &str) -> Option<Vec<f64>> {
    let number = |text: &str| {
        text.trim()
            .parse()
            .ok()
            .filter(|number: &f64| number.is_finite())
    };
    text.split(',').map(number).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn report(line: &str) -> Report {
        line.parse().unwrap()
    }

    #[test]
    fn every_field_of_grbl_is_read() {
        let full = report(
            "<Hold:1|MPos:1.000,-2.500,0.000|Bf:15,128|Ln:99999|FS:500,8000|Pn:XYZPDHRS|WCO:0.000,1.551,5.664|Ov:100,50,110|A:SFM>",
        );
        assert_eq!((full.state.as_str(), full.state_name()), ("Hold:1", "Hold"));
        assert_eq!(full.machine_position(), Some(vec![1.0, -2.5, 0.0]));
        assert_eq!(full.xyz(), Some("1.000,-2.500,0.000"));
        assert_eq!(full.work_position(), None);
        let (blocks, bytes) = (15, 128);
        assert_eq!(full.room(), Some(Room { blocks, bytes }));
        assert_eq!(full.line_number(), Some(99_999));
        assert_eq!(full.feed(), Some(500.0));
        assert_eq!(full.spindle_speed(), Some(8000.0));
        assert_eq!(full.pins(), "XYZPDHRS");
        assert_eq!(full.work_offset(), Some(vec![0.0, 1.551, 5.664]));
        assert_eq!(full.overrides(), Some([100, 50, 110]));
        assert_eq!(full.accessories(), Some("SFM"));
        let short = report("<Idle|WPos:0.000,0.000,0.000|F:30>");
        assert_eq!(short.work_position(), Some(vec![0.0; 3]));
        assert_eq!(short.xyz(), None);
        assert_eq!((short.feed(), short.spindle_speed()), (Some(30.0), None));
        assert_eq!((short.room(), short.overrides()), (None, None));
        assert_eq!((short.pins(), short.accessories()), ("", None));
        let all_off = report("<Idle|MPos:0.000,0.000,0.000|FS:0,0|Ov:100,100,100>");
        assert_eq!(all_off.accessories(), Some(""));
    }

    #[test]
    fn reports_of_other_firmware_are_read() {
        let hal = report(
            "<Alarm:11|MPos:0.000,0.000,0.000,-45.000|Bf:35,1023|FS:0,0,0|Pn:PT|WCS:G54|A:|Sc:|MPG:0|H:0|T:0|TLR:0|FW:grblHAL>",
        );
        assert_eq!(hal.state_name(), "Alarm");
        assert!(hal.is_at_rest());
        assert_eq!(hal.machine_position().unwrap()[3], -45.0);
        assert_eq!(hal.xyz(), Some("0.000,0.000,0.000"));
        assert_eq!(hal.field("FW"), Some("grblHAL"));
        let fluid = report(
            "<Run|MPos:561.700,708.660,-40.480|FS:1187,10000|Ov:100,100,100|A:S|SD:32.31,/sd/PiNC//Aum_Sun_V25_new.nc>",
        );
        assert_eq!(fluid.feed(), Some(1187.0));
        assert_eq!(fluid.fields.last().unwrap().0, "SD");
        let old = report("<Idle,MPos:5.529,0.560,7.000,WPos:1.529,-5.440,-0.000,Buf:0,RX:0,Ln:0>");
        assert_eq!(old.machine_position(), Some(vec![5.529, 0.56, 7.0]));
        assert_eq!(old.work_position(), Some(vec![1.529, -5.44, -0.0]));
        assert_eq!(old.line_number(), Some(0));
        assert_eq!(report("<Alarm>").fields, []);
        // Seen of a board without a spindle: what cannot be read is not known.
        let empty = report("<Idle|MPos:0.000,0.000,0.000|FS:,0>");
        assert_eq!(empty.feed(), None);
    }

    #[test]
    fn a_truncated_or_joined_line_is_no_report() {
        for line in [
            "ok",
            "<Idle|MPos:1",
            "<Run|MPos:1.000,2.000,3.000|FS:5",
            "Run|MPos:1.000,2.000,3.000>",
            "<Run|MPos:1.000,2.0<Run|FS:0,0>",
            "<Idle|F<Run|FS:0,0>",
            "<Run|MPos:x,1,2|FS:0,0>",
            "<Run|MPos:1.000,,2.000|FS:0,0>",
            "<Run|WPos:inf,0,0>",
            "<Run|WCO:1.0.0>",
            "<|MPos:1.000,2.000,3.000>",
            "<Idle|what>",
            "<Idle,0.000>",
            "<>",
            "",
        ] {
            assert_eq!(Report::read(line), None, "{line}");
            assert!(!Status::default().read(line), "{line}");
        }
        let error = "ok".parse::<Report>().unwrap_err();
        assert_eq!(error.to_string(), "`ok` is no status report");
    }

    #[test]
    fn both_positions_are_known_whichever_the_reports_have() {
        for (first, second) in [
            (
                "<Idle|MPos:5.000,1.000,0.000|FS:0,0|WCO:2.000,0.000,0.000>",
                "<Run|MPos:6.000,1.000,0.000|FS:500,0>",
            ),
            (
                "<Idle|WPos:3.000,1.000,0.000|FS:0,0|WCO:2.000,0.000,0.000>",
                "<Run|WPos:4.000,1.000,0.000|FS:500,0>",
            ),
        ] {
            let mut status = Status::default();
            assert!(status.read(first) && status.read(second));
            assert_eq!(status.machine_position().unwrap(), [6.0, 1.0, 0.0]);
            assert_eq!(status.work_position().unwrap(), [4.0, 1.0, 0.0]);
            assert_eq!(status.work_offset(), Some(&[2.0, 0.0, 0.0][..]));
            assert_eq!(status.report.state, "Run");
        }
    }

    #[test]
    fn what_has_not_been_reported_is_not_known_and_what_has_is_kept() {
        let mut status = Status::default();
        assert!(status.read("<Hold:0|WPos:0.000,0.000,0.000|FS:0,0|Ov:110,25,100>"));
        assert_eq!(status.machine_position(), None);
        assert!(status.read("<Hold:0|WPos:0.000,0.000,0.000|FS:0,0>"));
        assert_eq!(status.overrides, [110, 25, 100]);
    }

    #[test]
    fn a_hold_that_still_brakes_is_not_at_rest() {
        for (state, is_held, is_at_rest) in [
            ("Hold:1", false, false),
            ("Hold:0", true, true),
            ("Door:2", false, false),
            ("Idle", false, true),
            ("Run", false, false),
        ] {
            let report = report(&format!("<{state}>"));
            let found = (report.is_held(), report.is_at_rest());
            assert_eq!(found, (is_held, is_at_rest), "{state}");
        }
    }
}
