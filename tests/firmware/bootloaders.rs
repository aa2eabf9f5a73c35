//! The firmware behind a bootloader that leaves priorities in groups: which task preempts which, as QEMU logs it.
//!
//! A bootloader is some instructions in the flash behind the firmware: it makes its state, and jumps to the firmware
//! as bootloaders do, without a reset. Instructions: ARMv7-M reference manual, A7.7.

use std::{
    collections::BTreeMap,
    env, fs,
    path::PathBuf,
    process,
    sync::atomic::{AtomicU32, Ordering::Relaxed},
};

use crate::machine::Machine;

/// Where the bootloader is, and the firmware.
const BOOTLOADER: u32 = 0x080e_0000;
const FIRMWARE: u32 = 0x0800_0000;
/// Vectors of the processor and of the chip.
const VECTORS: usize = 16 + 82;
/// Its instructions, behind its vectors and what these lead to.
const HANDLER: u32 = BOOTLOADER + 4 * VECTORS as u32;
const ENTRY: u32 = HANDLER + 4;
/// The RAM, at whose end is the bootloader's stack.
const RAM: [u32; 2] = [0x2000_0000, 0x2002_0000];
/// What is left in RAM.
const PATTERN: u32 = 0xdead_beef;

const VTOR: u32 = 0xe000_ed08;
const AIRCR: u32 = 0xe000_ed0c;
/// Number of files made, for names that differ.
static COUNT: AtomicU32 = AtomicU32::new(0);

/// The bootloader that leaves other vectors, another stack, a RAM that has been used, and priorities in groups.
fn bootloader(priority_group: u32) -> Code {
    let mut code = Code::default();
    code.mask_interrupts();
    code.store(VTOR, BOOTLOADER);
    code.fill_ram();
    code.store(AIRCR, 0x05fa_0000 | priority_group << 8);
    code.unmask_interrupts();
    code.jump_to_firmware();
    code
}

/// Starts the firmware behind the bootloader, which is in a file.
fn start(priority_group: u32, options: &[&str]) -> Option<(Machine, File)> {
    let file = File::new("bin");
    fs::write(&file.0, bootloader(priority_group).image()).expect("a file can be written");
    let device = |device: String| ["-device".into(), device];
    let file_name = file.0.display();
    let content = device(format!(
        "loader,file={file_name},addr={BOOTLOADER:#x},force-raw=on"
    ));
    // The lowest bit says that the code is Thumb.
    let entry = device(format!("loader,addr={:#x},cpu-num=0", ENTRY | 1));
    let options = options.iter().map(|option| (*option).to_owned());
    let options: Vec<_> = content.into_iter().chain(entry).chain(options).collect();
    Some((Machine::start("FIRMWARE_ELF", &options)?, file))
}

/// A file that is removed at the end.
struct File(PathBuf);

impl File {
    fn new(extension: &str) -> Self {
        let number = COUNT.fetch_add(1, Relaxed);
        let name = format!(
            "leadscrew-bootloader-{}-{number}.{extension}",
            process::id()
        );
        Self(env::temp_dir().join(name))
    }
}

impl Drop for File {
    fn drop(&mut self) {
        let _ = fs::remove_file(&self.0);
    }
}

/// Instructions.
#[derive(Default)]
struct Code(Vec<u16>);

impl Code {
    /// MOVW, encoding T3, and MOVT, encoding T1: any word into one of the registers up to 7.
    fn load(&mut self, register: u16, word: u32) {
        for (opcode, half) in [(0xf240, word & 0xffff), (0xf2c0, word >> 16)] {
            let half = half as u16;
            self.0.push(opcode | half >> 12 | (half >> 11 & 1) << 10);
            self.0
                .push((half >> 8 & 7) << 12 | register << 8 | half & 0xff);
        }
    }

    /// STR, encoding T1.
    fn store(&mut self, address: u32, word: u32) {
        self.load(0, address);
        self.load(1, word);
        self.0.push(0x6001);
    }

    /// CPSID i.
    fn mask_interrupts(&mut self) {
        self.0.push(0xb672);
    }

    /// CPSIE i.
    fn unmask_interrupts(&mut self) {
        self.0.push(0xb662);
    }

    /// A loop: STR r2, [r0]; ADDS r0, #4; CMP r0, r1; BNE.
    fn fill_ram(&mut self) {
        let [start, end] = RAM;
        self.load(0, start);
        self.load(1, end);
        self.load(2, PATTERN);
        self.0.extend([0x6002, 0x3004, 0x4288, 0xd1fb]);
    }

    /// MSR MSP, r1, the end of RAM; LDR r0, [r0, #4]; BX r0.
    fn jump_to_firmware(&mut self) {
        let [_, end] = RAM;
        self.load(0, FIRMWARE);
        self.load(1, end - 0x100);
        self.0.extend([0xf381, 0x8808, 0x6840, 0x4700]);
    }

    /// Vectors, all of which lead to BX LR, and the code.
    fn image(&self) -> Vec<u8> {
        let mut image = [HANDLER | 1; VECTORS].map(u32::to_le_bytes).concat();
        let [_, end] = RAM;
        image[..4].copy_from_slice(&end.to_le_bytes());
        let instructions = [0x4770, 0xbf00].iter().chain(&self.0);
        image.extend(instructions.flat_map(|half| half.to_le_bytes()));
        image
    }
}

/// How often an exception, in a log of QEMU, preempts another one, by their vectors.
fn preemptions(log: &str) -> BTreeMap<[usize; 2], usize> {
    let mut running = Vec::new();
    let mut preemptions = BTreeMap::new();
    for line in log.lines() {
        if line.contains("taking pending") {
            let number = line
                .split(' ')
                .next_back()
                .and_then(|word| word.parse().ok());
            let number = number.expect("an exception has a number");
            if let Some(&below) = running.last() {
                *preemptions.entry([number, below]).or_default() += 1;
            }
            running.push(number);
        } else if line.contains("Exception return: ") {
            running.pop();
        }
    }
    preemptions
}

#[test]
fn an_exception_preempts_what_runs_and_not_what_has_ended() {
    let log = "...taking pending nonsecure exception 40
        ...taking pending nonsecure exception 53
        Exception return: magic PC fffffff1 previous exception 53
        ...successful exception return
        ...taking pending nonsecure exception 15
        Exception return: magic PC fffffff1 previous exception 15
        Exception return: magic PC fffffff9 previous exception 40
        ...tailchaining to pending exception
        ...taking pending nonsecure exception 49";
    let expected = BTreeMap::from([([53, 40], 1), ([15, 40], 1)]);
    assert_eq!(preemptions(log), expected);
}

#[test]
fn tasks_preempt_each_other_however_a_bootloader_groups_priorities() {
    // The vectors that `src/app.rs` binds.
    const SERIAL_RX: usize = 16 + 37;
    const SEGMENT_START: usize = 16 + 72;
    const PREPARE: usize = 16 + 24;
    const INTERPRET: usize = 16 + 33;
    for priority_group in [0, 5] {
        let log = File::new("log");
        let options = ["-d", "int", "-D", &log.0.to_string_lossy()];
        let Some((mut machine, _file)) = start(priority_group, &options) else {
            return;
        };
        machine.wait_for_welcome();
        machine.make_fast();
        machine.set(&["G91", "F3000"]);
        for _ in 0..5 {
            machine.send(&b"G1X1Y.5\nG1X-1Y-.5\n".repeat(4));
            for _ in 0..8 {
                assert_eq!(machine.receive(), "ok");
            }
        }
        machine.wait_for_idle();
        drop(machine);
        let preemptions = preemptions(&fs::read_to_string(&log.0).expect("QEMU writes its log"));
        for pair in [
            [SERIAL_RX, PREPARE],
            [SEGMENT_START, PREPARE],
            [PREPARE, INTERPRET],
        ] {
            let count = preemptions.get(&pair).copied().unwrap_or(0);
            assert!(
                count > 0,
                "PRIGROUP {priority_group}: {pair:?} of {preemptions:?}"
            );
        }
    }
}
