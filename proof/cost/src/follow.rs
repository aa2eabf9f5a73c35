//! The checker of `schedule` as an observer.
//!
//! Arguments: `elf`, `root` (the project), `board`, its `clock`, `axes`, and, where they are not those of
//! `schedule.toml`, `rate` and `baud`.

use std::path::{Path, PathBuf};

use schedule::{
    Decoder, Image, Input,
    replay::{Checker, Plan},
};

use crate::observer::{Observer, value};

/// See the module.
pub(crate) struct Follower {
    checker: Checker,
    elf: PathBuf,
}

impl Follower {
    /// Follows the tasks of a program that have deadlines.
    pub(crate) fn new(arguments: &[String]) -> Result<Self, String> {
        let elf = PathBuf::from(value(arguments, "elf")?);
        let number = |key: &str| {
            let value = value(arguments, key).ok();
            let number = value.map(str::parse::<u32>);
            number
                .transpose()
                .map_err(|error| format!("{key}: {error}"))
        };
        let input = Input {
            elf: &elf,
            root: Path::new(value(arguments, "root")?),
            board: value(arguments, "board")?,
            features: &[],
            clock: value(arguments, "clock")?.parse()?,
            axes: number("axes")?.unwrap_or(3) as u8,
            step_rate_hz: number("rate")?,
            baud: number("baud")?,
            measured: None,
        };
        let checker = Checker::new(Plan::read(&input)?)?;
        Ok(Self { checker, elf })
    }
}

impl Observer for Follower {
    fn site(&mut self, address: u32, code: [u16; 2]) -> usize {
        let decode = || Decoder::new().decode(address, code).ok();
        self.checker.site(address, decode)
    }

    fn execute(&mut self, number: usize) {
        self.checker.execute(number);
    }

    fn touch(&mut self, number: usize, address: u32, _is_store: bool) {
        self.checker.touch(number, address);
    }

    fn finish(&mut self) -> Result<String, String> {
        // The value is not kept: it cannot move to QEMU's processor thread.
        let image = Image::load(&self.elf)?;
        // As the report names it, also where there is no line of source.
        let frames = |address| image.place(address).frames;
        let summary = self.checker.summary(frames);
        serde_json::to_string_pretty(&summary).map_err(|error| error.to_string())
    }
}
