//! The decoder against LLVM's disassembler, on every instruction of real programs.

mod support;

use std::{
    env, fs,
    path::{Path, PathBuf},
    process::Command,
};

use cost::{
    decode::{self, Class, Flow, Instruction},
    elf::Program,
};

/// One line of the disassembly.
struct Line {
    address: u32,
    code: [u16; 2],
    size: u8,
    /// Without its condition, width and type.
    name: String,
    operands: String,
}

#[test]
fn decoder_agrees_with_llvm_objdump() {
    let Some(objdump) = objdump() else {
        println!("skipped: llvm-objdump is not installed (rustup component add llvm-tools)");
        return;
    };
    let mut checked = 0;
    let mut differences = Vec::new();
    for elf in programs() {
        let disassembly = Command::new(&objdump)
            .args(["-d", "--no-print-imm-hex", "--no-symbolic-operands"])
            .arg(&elf)
            .output()
            .expect("llvm-objdump runs");
        let text = String::from_utf8_lossy(&disassembly.stdout);
        let program = Program::parse(&fs::read(&elf).expect("it was found"));
        let program = program.expect("the programs have symbols and vectors");
        let lines: Vec<Line> = text.lines().filter_map(parse).collect();
        let code: usize = program.code.iter().map(|(_, bytes)| bytes.len()).sum();
        assert!(
            code < 256 || lines.len() > code / 8,
            "llvm-objdump showed little of {}",
            elf.display()
        );
        differences.extend(lines.iter().filter_map(|line| {
            let difference = check(line).err()?;
            let Line {
                address,
                name,
                operands,
                ..
            } = line;
            Some(format!("{address:08x} {name} {operands}: {difference}"))
        }));
        checked += lines.len();
    }
    differences.truncate(20);
    assert!(differences.is_empty(), "{}", differences.join("\n"));
    println!("{checked} instructions agree");
}

fn objdump() -> Option<PathBuf> {
    let host = env::consts::ARCH;
    let folder = support::sysroot()?.join("lib/rustlib");
    let hosts = fs::read_dir(folder).ok()?.filter_map(Result::ok);
    hosts
        .filter(|entry| entry.file_name().to_string_lossy().starts_with(host))
        .map(|entry| entry.path().join("bin/llvm-objdump"))
        .find(|path| path.exists())
}

/// The sequences, and whatever was built for the chip in this target folder.
fn programs() -> Vec<PathBuf> {
    let sources = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/sequences");
    let sequences = support::scratch().join("sequences.elf");
    let mut found = Vec::new();
    if support::compile(
        &sources.join("program.rs"),
        &sources.join("link.x"),
        &sequences,
    )
    .is_some()
    {
        found.push(sequences);
    }
    let target = support::plugin();
    let target = target.ancestors().nth(3).expect("target/profile/deps");
    for profile in ["debug", "release", "debug/deps", "release/deps"] {
        let folder = target.join(support::TARGET).join(profile);
        let entries = fs::read_dir(folder).into_iter().flatten();
        found.extend(entries.filter_map(Result::ok).map(|entry| entry.path()));
    }
    found.retain(|path| {
        path.is_file() && fs::read(path).is_ok_and(|bytes| Program::parse(&bytes).is_ok())
    });
    found
}

/// `" 8000040: f64e 5088    \tmovw\tr0, #60808"`.
fn parse(line: &str) -> Option<Line> {
    let (address, rest) = line.split_once(": ")?;
    let address = u32::from_str_radix(address.trim(), 16).ok()?;
    let mut columns = rest.split('\t');
    let halves: Vec<&str> = columns.next()?.split_whitespace().collect();
    let half = |index: usize| u16::from_str_radix(halves.get(index)?, 16).ok();
    let name = columns.next()?.trim();
    if name.starts_with('.') || name.starts_with('<') || halves.iter().any(|half| half.len() != 4) {
        return None;
    }
    let operands = columns.collect::<Vec<_>>().join(" ");
    let operands = operands.split('@').next().unwrap_or_default().trim();
    Some(Line {
        address,
        code: [half(0)?, half(1).unwrap_or(0)],
        size: 2 * halves.len() as u8,
        name: plain_name(name),
        operands: operands.to_owned(),
    })
}

/// `ldrbeq.w` and `ldrb` are the same instruction.
fn plain_name(name: &str) -> String {
    const CONDITIONS: [&str; 15] = [
        "eq", "ne", "hs", "lo", "mi", "pl", "vs", "vc", "hi", "ls", "ge", "lt", "gt", "le", "al",
    ];
    // Names that end as if they had a condition.
    const WHOLE: [&str; 11] = [
        "teq", "svc", "movs", "muls", "lsls", "vcvt", "smlal", "umlal", "umaal", "vmls", "vnmls",
    ];
    let base = name.split(['.', ' ']).next().unwrap_or(name);
    if WHOLE.contains(&base) || base.starts_with("it") || base.len() < 3 {
        return base.to_owned();
    }
    let stem = CONDITIONS.iter().find_map(|end| base.strip_suffix(end));
    stem.unwrap_or(base).to_owned()
}

/// Compares what the decoder says with what the name and the operands say.
fn check(line: &Line) -> Result<(), String> {
    let decoded = decode::decode(line.address, line.code[0], line.code[1]);
    let Some(instruction) = decoded else {
        return if line.name == "udf" || is_double(line) {
            Ok(())
        } else {
            Err("not decoded".into())
        };
    };
    if instruction.size != line.size {
        return Err(format!("size {}", instruction.size));
    }
    let class = expected_class(line);
    if instruction.class != class {
        return Err(format!("{:?}, expected {class:?}", instruction.class));
    }
    if class == Class::Load {
        check_load(line, &instruction)?;
    }
    let flow = expected_flow(line);
    if instruction.flow == flow {
        Ok(())
    } else {
        Err(format!("{:?}, expected {flow:?}", instruction.flow))
    }
}

/// Double precision, which this processor does not have.
fn is_double(line: &Line) -> bool {
    line.name.starts_with('v') && line.operands.starts_with('d')
}

fn expected_class(line: &Line) -> Class {
    let name = line.name.as_str();
    let register_offset = line.operands.split_once('[').is_some_and(|(_, address)| {
        let second = address.split(',').nth(1).unwrap_or_default().trim();
        second.starts_with(['r', 's', 'l'])
    });
    match name {
        "sdiv" | "udiv" => Class::Divide,
        "ldrd" | "strd" => Class::Multiple(2),
        "push" | "pop" | "vpush" | "vpop" => Class::Multiple(words(&line.operands)),
        "vldr" | "vstr" => Class::Multiple(if line.operands.starts_with('d') { 2 } else { 1 }),
        "tbb" | "tbh" => Class::TableBranch,
        "mrs" | "msr" | "cpsid" | "cpsie" => Class::Special,
        "dmb" | "dsb" | "isb" => Class::Barrier,
        "vdiv" | "vsqrt" => Class::FloatDivide,
        "vmla" | "vmls" | "vnmla" | "vnmls" | "vfma" | "vfms" | "vfnma" | "vfnms" => {
            Class::FloatMultiplyAdd
        }
        "b" | "bl" | "bx" | "blx" | "cbz" | "cbnz" => Class::Branch,
        "mov" | "add" if line.operands.starts_with("pc") => Class::Branch,
        "vmov" if line.operands.split(", ").count() >= 3 => Class::Special,
        _ if name.starts_with("it") => Class::IfThen(name.len() as u8 - 1),
        _ if name.starts_with("ldrex") || name.starts_with("strex") => Class::Exclusive,
        _ if ["ldm", "stm", "vldm", "vstm"]
            .iter()
            .any(|stem| name.starts_with(stem)) =>
        {
            Class::Multiple(words(&line.operands))
        }
        _ if name.starts_with("ldr") => Class::Load,
        _ if name.starts_with("str") && register_offset => Class::StoreIndexed,
        _ if name.starts_with("str") => Class::Store,
        _ => Class::Plain,
    }
}

/// Words that the registers in braces hold.
fn words(operands: &str) -> u8 {
    let list = operands.split('{').nth(1).unwrap_or_default();
    let registers = list.trim_end_matches('}').split(", ");
    registers
        .map(|part| {
            let width = if part.starts_with('d') { 2 } else { 1 };
            let count = part.split_once('-').map_or(1, |(first, last)| {
                let number = |name: &str| name[1..].parse::<u8>().expect("a register");
                number(last) - number(first) + 1
            });
            width * count
        })
        .sum()
}

fn register(name: &str) -> Option<u8> {
    match name {
        "sp" => Some(13),
        "lr" => Some(14),
        "pc" => Some(15),
        _ => name.strip_prefix('r')?.parse().ok(),
    }
}

/// The registers a load writes and those its address is made of.
fn check_load(line: &Line, instruction: &Instruction) -> Result<(), String> {
    let (target, address) = line.operands.split_once(", ").ok_or("no operands")?;
    let loaded = 1 << register(target).ok_or("no target")?;
    let address: u16 = address
        .split(|letter: char| !letter.is_ascii_alphanumeric())
        .filter_map(register)
        .filter(|&register| register != 15)
        .fold(0, |mask, register| mask | 1 << register);
    if (instruction.loaded, instruction.address) == (loaded, address) {
        Ok(())
    } else {
        Err(format!(
            "loads {:04x} from {:04x}, expected {loaded:04x} from {address:04x}",
            instruction.loaded, instruction.address
        ))
    }
}

fn expected_flow(line: &Line) -> Flow {
    let last = line.operands.split(", ").last().unwrap_or_default();
    let target = || {
        let hexadecimal = last.split_whitespace().next().unwrap_or_default();
        let digits = hexadecimal.trim_start_matches("0x");
        u32::from_str_radix(digits, 16).expect("a branch has a target")
    };
    let into_pc = line.operands.contains("pc}");
    let first_is_pc = line.operands.starts_with("pc");
    match line.name.as_str() {
        "b" | "cbz" | "cbnz" => Flow::Jump(target()),
        "bl" => Flow::Call(target()),
        "blx" => Flow::CallComputed,
        "bx" | "mov" if last == "lr" && (line.name == "bx" || first_is_pc) => Flow::Return,
        "bx" | "tbb" | "tbh" => Flow::JumpComputed,
        "ldr" if first_is_pc && line.operands.contains("[sp") => Flow::Return,
        "ldr" | "mov" | "add" if first_is_pc => Flow::JumpComputed,
        "pop" if into_pc => Flow::Return,
        name if name.starts_with("ldm") && into_pc => Flow::Return,
        _ => Flow::Next,
    }
}
