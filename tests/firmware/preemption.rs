//! Which task preempts which, as QEMU logs exceptions.

use std::{collections::BTreeMap, env, fs, path::PathBuf, process};

use crate::machine::Machine;

/// QEMU's log, which is removed at the end.
struct Log(PathBuf);

impl Drop for Log {
    fn drop(&mut self) {
        let _ = fs::remove_file(&self.0);
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
fn tasks_preempt_each_other() {
    // The vectors that `src/app.rs` binds.
    const SERIAL_RX: usize = 16 + 37;
    const SEGMENT_START: usize = 16 + 72;
    const PREPARE: usize = 16 + 24;
    const INTERPRET: usize = 16 + 33;
    let log = Log(env::temp_dir().join(format!("leadscrew-preemption-{}.log", process::id())));
    let options = ["-d", "int", "-D", &log.0.to_string_lossy()].map(str::to_owned);
    let Some(mut machine) = Machine::start("FIRMWARE_ELF", &options) else {
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
        assert!(count > 0, "{pair:?} of {preemptions:?}");
    }
}
