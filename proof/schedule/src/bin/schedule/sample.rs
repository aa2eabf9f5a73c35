//! A report made by hand, for the tests of what shows reports.

use std::collections::BTreeMap;

use schedule::{
    Curve, Flaw, KnownFigures, Line, Place, Report, Requirement, Rule, Section, Stack, Task,
    UndeadlinedWait, Wcet,
};

/// Clock of the core, Hz.
const CLOCK_HZ: u64 = 168_000_000;

/// A firmware of four axes that is proven.
pub(super) fn report() -> Report {
    Report {
        board: "netduino-plus-2".into(),
        elf_sha256: "61b1428ba915cf8d727fe41e8b7eb74029be32e919e97a62bc05b3f8a9335c7c".into(),
        axes: 4,
        clock_hz: CLOCK_HZ,
        step_rate_hz: 150_000,
        baud: 115_200,
        tasks: tasks(),
        utilisation: 0.662,
        proven_step_rate_hz: [
            ("115200", 176_000),
            ("250000", 171_000),
            ("500000", 160_000),
            ("1000000", 134_000),
        ]
        .map(|(baud, rate)| (baud.to_owned(), rate))
        .into(),
        undeadlined_waits: vec![UndeadlinedWait {
            step_rate_hz: 150_000,
            baud: 115_200,
            cycles: Some(709_800),
        }],
        step_wcet_cycles: 150,
        step_edge_jitter_us: 0.52,
        stack_worst_bytes: 5_912,
        stack: stack(),
        stack_available_bytes: 14_336,
        sections: sections(),
        curve: curve(),
        requirements: requirements(),
        assumptions: vec!["No DMA stream is active, so no access to memory waits for one.".into()],
        figures: vec![KnownFigures {
            formulas: [("task.step.period".to_owned(), "event_spacing".to_owned())].into(),
            claim: "Two step events are a slot apart.".into(),
            known: "held by the code, by the argument there".into(),
            by: vec!["src/stepper/placement.rs".into()],
        }],
        ..Report::default()
    }
}

/// The same with things that are wrong.
pub(super) fn flawed() -> Report {
    let flaw = |rule, what: &str, frame: &str, remedy: &str| Flaw {
        rule,
        what: what.into(),
        place: Place {
            address: 0x0800_c1d4,
            frames: vec![frame.into(), "app::app::step (src/app.rs:124)".into()],
        },
        remedy: remedy.into(),
    };
    Report {
        flaws: vec![
            flaw(
                Rule::UnboundedLoop,
                "a loop that `serial_rx` reaches has no bound",
                "leadscrew::protocol::realtime::receive (src/protocol/realtime.rs:77)",
                "write `// wcet-bound: N` on the line of the loop, or count in a fixed range",
            ),
            flaw(
                Rule::ReachablePanic,
                "a panic can be reached from `step`: <index> & \"bounds\"",
                "leadscrew::stepper::ring::EventReader::take (src/stepper/ring.rs:31)",
                "use `get`, a mask or an iterator instead of the index",
            ),
        ],
        ..report()
    }
}

fn task(name: &str, vector: &str, priority: u8, period: f64, wcet: [u64; 3]) -> Task {
    let [warm, cold, uncached] = wcet;
    Task {
        name: name.into(),
        vector: vector.into(),
        priority,
        period_cycles: Some(period),
        period_source: "10 / baud".into(),
        wcet: Some(Wcet {
            warm,
            cold,
            uncached,
        }),
        wcet_cycles: Some(cold),
        via: "cold".into(),
        blocking_cycles: 54,
        blocking_source: "rtic::pend in leadscrew::app::interpret (src/app.rs:207)".into(),
        share: cold as f64 / period,
        icache_lines: cold as usize / 9,
        stack_bytes: 104,
        worst_path: path(cold),
        ..Task::default()
    }
}

/// Gives a task its response time, deadline and slack.
fn answers(mut task: Task, response: u64, deadline: f64) -> Task {
    task.response_cycles = Some(response);
    task.deadline_cycles = Some(deadline);
    task.slack_us = Some((deadline - response as f64) / (CLOCK_HZ as f64 / 1e6));
    task
}

fn tasks() -> Vec<Task> {
    let mut step = task("step", "SysTick", 5, 560.0, [150, 220, 230]);
    step.spacing_cycles = Some(336.0);
    step.burst = 8.0;
    let serial = task("serial_rx", "USART1", 4, 14_583.3, [190, 260, 300]);
    let start = task("segment_start", "I2C1_EV", 3, 33_600.0, [280, 390, 450]);
    let mut inputs = task("inputs", "TIM7", 3, 16_800.0, [310, 480, 560]);
    inputs.blocking_cycles = 66;
    let mut prepare = task(
        "prepare",
        "TIM6_DAC",
        2,
        168_000.0,
        [36_000, 40_000, 58_000],
    );
    prepare.uses_float = true;
    prepare.blocking_cycles = 312;
    prepare.blocking_source =
        "the lock of `snapshot` in leadscrew::app::report (src/app.rs:233)".into();
    let wake = Task {
        name: "wake".into(),
        vector: "I2C3_ER".into(),
        priority: 1,
        ..Task::default()
    };
    vec![
        answers(step, 311, 336.0),
        answers(serial, 1_031, 14_583.3),
        answers(start, 3_760, 16_800.0),
        answers(inputs, 3_760, 16_800.0),
        answers(prepare, 82_300, 134_400.0),
        wake,
    ]
}

/// A worst path that costs so much.
fn path(cycles: u64) -> Vec<Line> {
    let lines = [
        ("src/board/step_output.rs", 98, "StepOutput::write", 30),
        ("src/stepper/ring.rs", 31, "EventReader::take", 22),
        ("src/app.rs", 124, "step", 18),
        ("heapless-0.9.3/src/spsc.rs", 402, "Consumer::dequeue", 15),
        ("src/board/step_output.rs", 120, "StepOutput::set_up", 10),
        ("core/src/sync/atomic.rs", 2_540, "atomic_load", 5),
    ];
    let lines = lines.map(|(file, line, function, share)| Line {
        file: file.into(),
        line,
        function: function.into(),
        cycles: cycles * share / 100,
        count: 1,
    });
    lines.into()
}

fn sections() -> Vec<Section> {
    let section = |place: &str, ceiling, priority, cycles, exempt: Option<&str>| Section {
        place: place.into(),
        ceiling,
        priority,
        cycles,
        exempt: exempt.map(str::to_owned),
    };
    vec![
        section(
            "cortex_m::interrupt::free (src/board/flash.rs:88)",
            None,
            1,
            84_000_000,
            Some("erases a sector, at rest only"),
        ),
        section("snapshot lock (src/app.rs:233)", Some(2), 1, 297, None),
        section("spawn (src/app.rs:207)", None, 1, 39, None),
    ]
}

fn stack() -> Vec<Stack> {
    let level = |priority, task: &str, bytes| Stack {
        priority,
        task: task.into(),
        bytes,
    };
    vec![
        level(5, "step", 104),
        level(4, "serial_rx", 136),
        level(3, "inputs", 216),
        level(2, "prepare", 2_104),
        level(1, "interpret", 3_320),
        level(0, "idle", 32),
    ]
}

fn curve() -> Vec<Curve> {
    let tasks = [
        ("step", 2.0, 0.37),
        ("serial_rx", 86.8, 80.5),
        ("segment_start", 100.0, 83.4),
        ("inputs", 100.0, 83.4),
        ("prepare", 800.0, 560.0),
    ];
    let point = |step: u32| {
        let rate = f64::from(step) * 5_000.0;
        let busy = rate * 2.0 * 220.0 / CLOCK_HZ as f64;
        let slack = |name: &str, deadline: f64, at_rest: f64| match name {
            "step" => Some(at_rest),
            _ if busy > 0.95 => None,
            "prepare" => Some(deadline - 240.0 / (1.0 - busy)),
            _ => Some(deadline - (deadline - at_rest) * 0.5 / (1.0 - busy)),
        };
        Curve {
            step_rate_hz: step * 5_000,
            slack_us: tasks
                .map(|(name, deadline, rest)| (name.to_owned(), slack(name, deadline, rest)))
                .into(),
            deadline_us: tasks
                .map(|(name, deadline, _)| (name.to_owned(), deadline))
                .into(),
        }
    };
    (1..=50).map(point).collect()
}

fn requirements() -> Vec<Requirement> {
    let requirement = |what: &str, unit: &str, required, found| Requirement {
        what: what.into(),
        unit: unit.into(),
        required,
        found,
        is_met: true,
    };
    vec![
        requirement("step rate at 115200 baud", "Hz", 150_000.0, 176_000.0),
        requirement("step rate at 1000000 baud", "Hz", 120_000.0, 134_000.0),
        requirement("pin-edge jitter", "µs", 0.7, 0.52),
        requirement("worst step interrupt, warm cache", "cycles", 200.0, 150.0),
    ]
}

/// A report with nothing in it.
pub(super) fn empty() -> Report {
    Report {
        clock_hz: CLOCK_HZ,
        proven_step_rate_hz: BTreeMap::new(),
        ..Report::default()
    }
}
