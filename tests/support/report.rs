//! Status reports: `<State|MPos:0.000,0.000,0.000|FS:0,0>`.

/// A status report.
#[derive(Debug, Clone)]
pub(crate) struct Report {
    /// Without the angle brackets.
    pub(crate) line: String,
}

impl Report {
    /// Reads a line of the machine; none if it is no report.
    pub(crate) fn parse(line: &str) -> Option<Self> {
        let line = line.strip_prefix('<')?.strip_suffix('>')?.to_owned();
        Some(Self { line })
    }

    /// The state, with its substate: `Hold:0`.
    pub(crate) fn state(&self) -> &str {
        self.line.split('|').next().unwrap_or_default()
    }

    /// The fields behind the state: names and values.
    pub(crate) fn fields(&self) -> impl Iterator<Item = (&str, &str)> {
        let fields = self.line.split('|').skip(1);
        fields.map(|field| field.split_once(':').expect("a name and a value"))
    }

    /// The value of a field; none if the report is without it.
    pub(crate) fn field(&self, name: &str) -> Option<&str> {
        self.fields()
            .find_map(|(found, value)| (found == name).then_some(value))
    }

    /// X, Y and Z of the machine position, as they are written.
    pub(crate) fn position(&self) -> String {
        let position = self.field("MPos").expect("a machine position");
        position.split(',').take(3).collect::<Vec<_>>().join(",")
    }
}
