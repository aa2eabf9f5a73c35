//! The expected instruction, from its name and operands in a disassembly.

mod operands;

use std::fmt;

use operands::{address, list, register, registers};
use schedule::{Instruction, Operation, decode};

/// The condition of what is executed always.
const ALWAYS: u8 = 14;

/// One line of the disassembly.
pub(crate) struct Line {
    pub(crate) address: u32,
    pub(crate) code: [u16; 2],
    pub(crate) size: u8,
    /// As it is printed, without width and type.
    name: String,
    operands: String,
}

impl fmt::Display for Line {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:08x} {} {}", self.address, self.name, self.operands)
    }
}

/// The kinds of instructions that a name tells apart.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Kind {
    Plain,
    Multiply,
    Divide,
    Load,
    Store,
    LoadExclusive,
    StoreExclusive,
    ClearExclusive,
    Jump,
    Call,
    JumpOnZero,
    JumpRegister,
    CallRegister,
    JumpComputed,
    TableJump,
    IfThen,
    Nothing,
    Wait,
    Interrupts,
    ReadSpecial,
    WriteSpecial,
    Barrier,
    Trap,
    Supervisor,
    Float(u8),
    FloatLoad,
    FloatStore,
}

impl Kind {
    fn of(operation: &Operation) -> Self {
        match *operation {
            Operation::Constant { .. }
            | Operation::ConstantTop { .. }
            | Operation::Copy { .. }
            | Operation::Add { .. }
            | Operation::AddRegister { .. }
            | Operation::Or { .. }
            | Operation::Compare { .. }
            | Operation::CompareRegisters { .. }
            | Operation::Plain { .. } => Self::Plain,
            Operation::Multiply { .. } => Self::Multiply,
            Operation::Divide { .. } => Self::Divide,
            Operation::Load { .. } => Self::Load,
            Operation::Store { .. } => Self::Store,
            Operation::LoadExclusive { .. } => Self::LoadExclusive,
            Operation::StoreExclusive { .. } => Self::StoreExclusive,
            Operation::ClearExclusive => Self::ClearExclusive,
            Operation::Jump(_) => Self::Jump,
            Operation::Call(_) => Self::Call,
            Operation::JumpOnZero { .. } => Self::JumpOnZero,
            Operation::JumpRegister(_) => Self::JumpRegister,
            Operation::CallRegister(_) => Self::CallRegister,
            Operation::JumpComputed => Self::JumpComputed,
            Operation::TableJump { .. } => Self::TableJump,
            Operation::IfThen(_) => Self::IfThen,
            Operation::Nothing => Self::Nothing,
            Operation::Wait => Self::Wait,
            Operation::Interrupts { .. } => Self::Interrupts,
            Operation::ReadSpecial { .. } => Self::ReadSpecial,
            Operation::WriteSpecial { .. } => Self::WriteSpecial,
            Operation::Barrier => Self::Barrier,
            Operation::Trap => Self::Trap,
            Operation::Supervisor => Self::Supervisor,
            Operation::Float { cycles, .. } => Self::Float(cycles),
            Operation::FloatLoad { .. } => Self::FloatLoad,
            Operation::FloatStore { .. } => Self::FloatStore,
        }
    }

    /// The kind of an instruction by its name without condition.
    fn named(name: &str, operands: &str) -> Self {
        let to_pc = operands.starts_with("pc");
        match name {
            "b" => Self::Jump,
            "bl" => Self::Call,
            "bx" => Self::JumpRegister,
            "blx" => Self::CallRegister,
            "cbz" | "cbnz" => Self::JumpOnZero,
            "mov" | "add" if to_pc => Self::JumpComputed,
            "tbb" | "tbh" => Self::TableJump,
            "nop" | "yield" | "sev" | "hint" | "dbg" | "pld" | "pli" | "pldw" => Self::Nothing,
            "wfi" | "wfe" => Self::Wait,
            "cpsid" | "cpsie" => Self::Interrupts,
            "mrs" => Self::ReadSpecial,
            "msr" => Self::WriteSpecial,
            "dmb" | "dsb" | "isb" => Self::Barrier,
            "udf" | "bkpt" | "trap" => Self::Trap,
            "svc" => Self::Supervisor,
            "clrex" => Self::ClearExclusive,
            "sdiv" | "udiv" => Self::Divide,
            "push" => Self::Store,
            "pop" => Self::Load,
            _ if name.starts_with("it") => Self::IfThen,
            _ if name.starts_with("ldrex") => Self::LoadExclusive,
            _ if name.starts_with("strex") => Self::StoreExclusive,
            _ if name.starts_with("ld") => Self::Load,
            _ if name.starts_with("st") => Self::Store,
            _ if name.starts_with('v') => Self::float(name, operands),
            _ if is_multiplication(name) => Self::Multiply,
            _ => Self::Plain,
        }
    }

    fn float(name: &str, operands: &str) -> Self {
        match name {
            "vpush" | "vstr" => Self::FloatStore,
            "vpop" | "vldr" => Self::FloatLoad,
            _ if name.starts_with("vldm") => Self::FloatLoad,
            _ if name.starts_with("vstm") => Self::FloatStore,
            "vdiv" | "vsqrt" => Self::Float(decode::DIVIDE),
            "vmla" | "vmls" | "vnmla" | "vnmls" | "vfma" | "vfms" | "vfnma" | "vfnms" => {
                Self::Float(decode::MULTIPLY_ADD)
            }
            "vmov" if operands.split(", ").count() >= 3 => Self::Float(decode::MOVE_TWO),
            _ => Self::Float(2),
        }
    }
}

fn is_multiplication(name: &str) -> bool {
    let stems = [
        "mul", "mla", "mls", "smul", "smla", "smls", "smmul", "smmla", "smmls",
    ];
    let others = ["umull", "umlal", "umaal", "smuad", "smusd", "usad"];
    stems
        .iter()
        .chain(&others)
        .any(|stem| name.starts_with(stem))
}

/// Names that end as if they had a condition, or as if they set the flags.
const WHOLE: [&str; 28] = [
    "teq", "svc", "vcvt", "smlal", "umlal", "umaal", "vmls", "vnmls", "mls", "vabs", "vfms",
    "vfnms", "mrs", "smmls", "smlalbb", "smlalbt", "smlaltb", "smlaltt", "vmrs", "lsls", "movs",
    "muls", "vcvtb", "vcvtt", "bics", "adcs", "sbcs", "rsbs",
];

/// The name without its condition, and the condition.
fn split(name: &str) -> (&str, u8) {
    const CONDITIONS: [&str; 14] = [
        "eq", "ne", "hs", "lo", "mi", "pl", "vs", "vc", "hi", "ls", "ge", "lt", "gt", "le",
    ];
    if WHOLE.contains(&name) || name.starts_with("it") || name.len() < 3 {
        return (name, ALWAYS);
    }
    let ends = CONDITIONS.iter().zip(0..);
    let mut found = ends.filter_map(|(end, condition)| Some((name.strip_suffix(end)?, condition)));
    found
        .find(|(stem, _)| !stem.is_empty())
        .unwrap_or((name, ALWAYS))
}

impl Line {
    /// `" 8000040: f64e 5088    \tmovw\tr0, #60808"`.
    pub(crate) fn parse(line: &str) -> Option<Self> {
        let (address, rest) = line.split_once(": ")?;
        let address = u32::from_str_radix(address.trim(), 16).ok()?;
        let mut columns = rest.split('\t');
        let halves = halves(columns.next()?)?;
        let name = columns.next()?.trim();
        if name.starts_with(['.', '<']) {
            return None;
        }
        let operands = columns.collect::<Vec<_>>().join(" ");
        let operands = operands.split('@').next().unwrap_or_default().trim();
        Some(Self {
            address,
            code: [*halves.first()?, halves.get(1).copied().unwrap_or(0)],
            size: 2 * halves.len() as u8,
            name: name.split(['.', ' ']).next()?.to_owned(),
            operands: operands.to_owned(),
        })
    }

    /// Compares what the decoder says with what the name and the operands say.
    pub(crate) fn check(&self, decoded: Option<Instruction>) -> Result<(), String> {
        let (name, condition) = split(&self.name);
        let Some(instruction) = decoded else {
            let is_double = name.starts_with('v') && self.operands.starts_with('d');
            return if name == "udf" || is_double {
                Ok(())
            } else {
                Err("not decoded".to_owned())
            };
        };
        let operation = &instruction.operation;
        let same = |what: &str, found: String, expected: String| {
            if found == expected {
                Ok(())
            } else {
                Err(format!("{what} {found}, expected {expected}"))
            }
        };
        let kind = Kind::named(name, &self.operands);
        let text = |value: &dyn fmt::Debug| format!("{value:?}");
        same("size", text(&instruction.bytes), text(&self.size))?;
        same("kind", text(&Kind::of(operation)), text(&kind))?;
        same("condition", text(&instruction.condition), text(&condition))?;
        same("target", text(&target(operation)), text(&self.target(kind)))?;
        let expected = (self.writes(kind, name), self.reads(kind));
        same(
            "registers",
            text(&(writes(operation), reads(operation))),
            text(&expected),
        )?;
        same(
            "words",
            text(&words(operation)),
            text(&self.words(kind, name)),
        )?;
        if let Some(found) = operation.access() {
            let expected = address(&self.operands, name, self.address, self.words(kind, name));
            same("address", text(&Some(found)), text(&expected))?;
        }
        same(
            "flags",
            text(&instruction.sets_flags),
            text(&self.sets_flags(name)),
        )
    }

    fn target(&self, kind: Kind) -> Option<u32> {
        if !matches!(kind, Kind::Jump | Kind::Call | Kind::JumpOnZero) {
            return None;
        }
        let last = self.operands.split(", ").last()?;
        let digits = last.split_whitespace().next()?.trim_start_matches("0x");
        u32::from_str_radix(digits, 16).ok()
    }

    /// The registers that an instruction writes, without writeback.
    fn writes(&self, kind: Kind, name: &str) -> u16 {
        let mut operands = self.operands.split(", ");
        let mut one = || {
            operands
                .next()
                .and_then(register)
                .map_or(0, |to| 1_u16 << to)
        };
        match kind {
            Kind::Plain if is_comparison(name) => 0,
            Kind::Multiply if is_long(name) => one() | one(),
            Kind::Load if name == "ldrd" => one() | one(),
            Kind::Load if name.starts_with("ldm") || name == "pop" => list(&self.operands),
            Kind::Plain
            | Kind::Multiply
            | Kind::Divide
            | Kind::Load
            | Kind::LoadExclusive
            | Kind::StoreExclusive
            | Kind::ReadSpecial => one(),
            Kind::Float(cycles) if name == "vmov" || name == "vmrs" => match one() {
                // The floating-point registers come first.
                0 => 0,
                first if cycles == decode::MOVE_TWO => first | one(),
                first => first,
            },
            _ => 0,
        }
    }

    /// The registers that it stores.
    fn reads(&self, kind: Kind) -> u16 {
        if kind != Kind::Store {
            return 0;
        }
        if self.operands.contains('{') {
            return list(&self.operands);
        }
        let before = self.operands.split('[').next().unwrap_or_default();
        registers(before)
    }

    fn words(&self, kind: Kind, name: &str) -> u8 {
        match kind {
            Kind::Load | Kind::Store if name == "ldrd" || name == "strd" => 2,
            Kind::Load | Kind::Store if self.operands.contains('{') => {
                list(&self.operands).count_ones() as u8
            }
            Kind::Load | Kind::Store => 1,
            Kind::FloatLoad | Kind::FloatStore => operands::float_words(&self.operands),
            Kind::IfThen => self.name.len() as u8 - 1,
            _ => 0,
        }
    }

    fn sets_flags(&self, name: &str) -> bool {
        const KEEP: [&str; 7] = ["mls", "mrs", "vabs", "vcls", "smmls", "vmls", "vnmls"];
        if is_comparison(name) {
            return true;
        }
        match name {
            "vmrs" | "msr" => {
                let to = self.operands.to_ascii_lowercase();
                to.starts_with("apsr")
            }
            _ => name.ends_with('s') && !name.starts_with('v') && !KEEP.contains(&name),
        }
    }
}

fn is_comparison(name: &str) -> bool {
    matches!(name, "cmp" | "cmn" | "tst" | "teq")
}

/// Whether a multiplication has a result of two registers.
fn is_long(name: &str) -> bool {
    ["umull", "smull", "umlal", "smlal", "umaal", "smlsld"]
        .iter()
        .any(|stem| name.starts_with(stem))
}

/// `f64e 5088`, or byte by byte as older versions print.
fn halves(code: &str) -> Option<Vec<u16>> {
    let parts: Vec<&str> = code.split_whitespace().collect();
    let parse = |text: &str| u16::from_str_radix(text, 16).ok();
    match parts.first()?.len() {
        4 => parts.iter().map(|part| parse(part)).collect(),
        2 => parts
            .chunks_exact(2)
            .map(|pair| Some(parse(pair[0])? | parse(pair[1])? << 8))
            .collect(),
        _ => None,
    }
    .filter(|halves: &Vec<u16>| (1..=2).contains(&halves.len()))
}

fn target(operation: &Operation) -> Option<u32> {
    match *operation {
        Operation::Jump(to) | Operation::Call(to) | Operation::JumpOnZero { to, .. } => Some(to),
        _ => None,
    }
}

fn writes(operation: &Operation) -> u16 {
    match *operation {
        Operation::Constant { to, .. }
        | Operation::ConstantTop { to, .. }
        | Operation::Copy { to, .. }
        | Operation::Add { to, .. }
        | Operation::AddRegister { to, .. }
        | Operation::Or { to, .. }
        | Operation::ReadSpecial { to, .. }
        | Operation::StoreExclusive { to, .. } => 1 << to,
        Operation::Plain { writes }
        | Operation::Multiply { writes, .. }
        | Operation::Divide { writes }
        | Operation::Load { writes, .. }
        | Operation::LoadExclusive { writes, .. }
        | Operation::Float { writes, .. } => writes,
        _ => 0,
    }
}

fn reads(operation: &Operation) -> u16 {
    match *operation {
        Operation::Store { reads, .. } => reads,
        _ => 0,
    }
}

fn words(operation: &Operation) -> u8 {
    match *operation {
        Operation::Load { words, .. }
        | Operation::Store { words, .. }
        | Operation::FloatLoad { words, .. }
        | Operation::FloatStore { words, .. }
        | Operation::IfThen(words) => words,
        _ => 0,
    }
}
