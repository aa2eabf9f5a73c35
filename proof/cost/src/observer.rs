//! Observers of the program as QEMU executes it.

use std::fs;

use crate::{elf::Program, follow::Follower, profile::Profile, report};

/// Receives every executed instruction and memory access.
pub(crate) trait Observer: Send {
    /// The instruction `code` at `address` will be executed under the number that is returned.
    fn site(&mut self, address: u32, code: [u16; 2]) -> usize;
    /// The instruction with this number is about to be executed.
    fn execute(&mut self, number: usize);
    /// The instruction with this number, which is being executed, reads or writes `address`.
    fn touch(&mut self, number: usize, address: u32, is_store: bool);
    /// The program has ended: the report.
    fn finish(&mut self) -> Result<String, String>;
}

/// The value of an argument `key=value`.
pub(crate) fn value<'a>(arguments: &'a [String], key: &str) -> Result<&'a str, String> {
    let mut arguments = arguments.iter();
    arguments
        .find_map(|argument| argument.strip_prefix(key)?.strip_prefix('='))
        .ok_or_else(|| format!("{key}=… is missing"))
}

/// The observer that the `arguments` select.
pub(crate) fn asked_for(arguments: &[String]) -> Result<Box<dyn Observer>, String> {
    if value(arguments, "root").is_ok() {
        return Ok(Box::new(Follower::new(arguments)?));
    }
    let elf = value(arguments, "elf")?;
    let file = fs::read(elf).map_err(|error| format!("{elf}: {error}"))?;
    let program = Program::parse(&file).map_err(|error| format!("{elf}: {error}"))?;
    Ok(Box::new(Profile::new(program)))
}

impl Observer for Profile {
    fn site(&mut self, address: u32, code: [u16; 2]) -> usize {
        Self::site(self, address, code)
    }

    fn execute(&mut self, number: usize) {
        Self::execute(self, number);
    }

    fn touch(&mut self, _: usize, address: u32, is_store: bool) {
        Self::touch(self, address, is_store);
    }

    fn finish(&mut self) -> Result<String, String> {
        self.close();
        Ok(report::report(self).to_string())
    }
}
