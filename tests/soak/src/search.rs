//! Histories from seeds, one after the other, and the shortest history that breaks a rule.

use std::{
    cell::Cell,
    fmt,
    time::{Duration, Instant},
};

use leadscrew::settings::StepRate;
use proptest::{
    prelude::*,
    test_runner::{Config, RngAlgorithm, TestError, TestRng, TestRunner},
};

use crate::{
    action::{Action, history},
    bench::{Bench, Fault},
    quiet::{panic_of, quietly},
    setup::{Setup, setup},
};

/// Most actions of one history.
const MAX_ACTIONS: usize = 80;
/// How often a history that breaks a rule is made shorter.
const SHORTENINGS: u32 = 2000;

/// How long histories are made.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Until {
    /// For a time of the computer.
    Elapsed(Duration),
    /// Until the machines have run for so many hours.
    MachineHours(f64),
    /// A number of histories.
    Histories(u64),
}

/// What has been done.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(crate) struct Done {
    pub(crate) histories: u64,
    pub(crate) actions: u64,
    pub(crate) machine_seconds: f64,
}

impl Done {
    fn is_enough(&self, until: Until, start: Instant) -> bool {
        match until {
            Until::Elapsed(time) => start.elapsed() >= time,
            Until::MachineHours(hours) => self.machine_seconds >= hours * 3600.0,
            Until::Histories(count) => self.histories >= count,
        }
    }
}

/// The shortest history that breaks a rule.
#[derive(Debug)]
pub(crate) struct Broken {
    pub(crate) seed: u64,
    pub(crate) rule: String,
    pub(crate) setup: Setup,
    pub(crate) actions: Vec<Action>,
}

impl fmt::Display for Broken {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        writeln!(f, "{}", self.rule)?;
        writeln!(
            f,
            "The shortest history that was found from seed {}, on the machine {:?}:",
            self.seed, self.setup
        )?;
        let mut actions = self.actions.iter();
        actions.try_for_each(|action| writeln!(f, "  {action:?}"))
    }
}

/// Makes a history of each seed from `seed` on, until one breaks a rule; `watch` is told after each that does not.
pub(crate) fn search(
    seed: u64,
    until: Until,
    step_rate: StepRate,
    fault: Option<Fault>,
    mut watch: impl FnMut(&Done),
) -> Result<Done, Box<Broken>> {
    let start = Instant::now();
    let mut done = Done::default();
    for seed in seed.. {
        let played = play(seed, step_rate, fault)?;
        done.histories += 1;
        done.actions += played.actions;
        done.machine_seconds += played.machine_seconds;
        watch(&done);
        if done.is_enough(until, start) {
            break;
        }
    }
    Ok(done)
}

/// Plays the history of one seed.
fn play(seed: u64, step_rate: StepRate, fault: Option<Fault>) -> Result<Done, Box<Broken>> {
    let config = Config {
        max_shrink_iters: SHORTENINGS,
        failure_persistence: None,
        ..Config::default()
    };
    let mut seed_bytes = [0; 32];
    seed_bytes[..8].copy_from_slice(&seed.to_le_bytes());
    let random = TestRng::from_seed(RngAlgorithm::ChaCha, &seed_bytes);
    let mut runner = TestRunner::new_with_rng(config, random);
    let strategy = (setup(), history(MAX_ACTIONS));
    let Ok(history) = strategy.new_tree(&mut runner) else {
        unreachable!("every action can be made");
    };
    let done = Cell::new(Done::default());
    let outcome = quietly(|| {
        runner.run_one(history, |(setup, actions)| {
            let machine_seconds = run(setup, &actions, step_rate, fault);
            done.set(Done {
                histories: 1,
                actions: actions.len() as u64,
                machine_seconds,
            });
            Ok(())
        })
    });
    match outcome {
        Err(TestError::Fail(_, (setup, actions))) => {
            let rule = |actions: &[Action]| panic_of(|| _ = run(setup, actions, step_rate, fault));
            let actions = only_needed(actions, |actions| rule(actions).is_some());
            Err(Box::new(Broken {
                seed,
                rule: rule(&actions).unwrap_or_else(|| {
                    "a rule is broken, but not when the same is done again".into()
                }),
                setup,
                actions,
            }))
        }
        _ => Ok(done.get()),
    }
}

/// Leaves out actions without which a rule is broken all the same, half of them at first and then fewer, until each one
/// that is left is needed. While proptest makes a history shorter, it leaves actions out first and makes them simpler
/// then: in the end some may be needed no longer, and some only as long as others are there.
fn only_needed(mut actions: Vec<Action>, is_broken: impl Fn(&[Action]) -> bool) -> Vec<Action> {
    let mut count = actions.len().div_ceil(2);
    while count > 0 {
        let before = actions.len();
        let mut end = before;
        while end > 0 {
            let begin = end.saturating_sub(count);
            let mut shorter = actions.clone();
            shorter.drain(begin..end);
            if is_broken(&shorter) {
                actions = shorter;
            }
            end = begin;
        }
        if actions.len() == before {
            count /= 2;
        }
    }
    actions
}

/// Plays a history; panics if a rule is broken. Returns the time of the machine, s.
pub(crate) fn run(
    setup: Setup,
    actions: &[Action],
    step_rate: StepRate,
    fault: Option<Fault>,
) -> f64 {
    let mut bench = Bench::new(setup, step_rate, fault);
    for action in actions {
        bench.act(action);
    }
    bench.finish();
    bench.seconds()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::setup::Kind;

    const STEP_RATE: StepRate = StepRate::Proven(190_000);
    /// From here on each fault soon comes in a history that does not need a contact or an offset as well.
    const SEED: u64 = 3000;

    #[test]
    fn each_fault_is_found_and_its_history_is_short() {
        for (fault, rule, longest) in [
            (Fault::StepLost, "steps of the motors", 4),
            (Fault::AnswerLost, "a line has no answer", 2),
            (Fault::ReportLate, "a `?` waits", 2),
            (Fault::RecordLost, "neither old nor new", 1),
            (Fault::MotorsSwapped, "is programmed to", 1),
            (Fault::LossUnseen, "a line that has lost a byte", 2),
            (Fault::BreakUnseen, "a break holds nothing", 3),
            (Fault::BeamInHold, "the beam stays on in a hold", 2),
            (Fault::BeamInRapid, "the beam is on in a rapid", 1),
            (Fault::SpindleBehindDoor, "stay on behind the door", 2),
            (Fault::CoolantStays, "coolant", 2),
            (Fault::OffsetUntold, "reports have no WCO", 4),
            (Fault::ProbeMoved, "but the probe has changed at", 4),
            (Fault::AnswerGarbled, "an unknown line", 2),
            (Fault::SecondStepLost, "second motors", 2),
            (Fault::AllAreJogs, "a jog is an alarm", 2),
            (Fault::HoldBehindDoorLost, "a hold behind the door", 4),
            (Fault::PathLeft, "the path begins elsewhere", 1),
        ] {
            let broken = search(SEED, Until::Histories(300), STEP_RATE, Some(fault), |_| {});
            let broken = broken.expect_err(&format!("{fault:?} is not found"));
            assert!(broken.rule.contains(rule), "{fault:?}: {broken}");
            assert!(broken.actions.len() <= longest, "{fault:?}: {broken}");
        }
    }

    #[test]
    fn after_g40_the_tool_stays_beside_the_programmed_position_up_to_the_next_move() {
        let setup = Setup::plain(Kind::Laser);
        let lines = ["G1F3000", "G41.1D1.5G1X-1", "G40"].map(|line| Action::Line(line.into()));
        run(setup, &lines, STEP_RATE, None);
    }

    #[test]
    fn what_was_being_stored_in_inches_is_looked_at_in_inches() {
        let setup = Setup {
            is_reprap: true,
            ..Setup::plain(Kind::Marks)
        };
        let line = |text: &str| Action::Line(text.into());
        let write = Action::PowerFailsInWrite {
            text: "G10L2P1X1Y-1".into(),
            words: 78,
            seed: 15_390_837_487_648_707_265,
        };
        run(
            setup,
            &[line("G10L2P3R30"), line("G20"), write],
            STEP_RATE,
            None,
        );
    }

    #[test]
    fn a_history_is_the_same_each_time() {
        let once = search(7, Until::Histories(3), STEP_RATE, None, |_| {}).unwrap();
        let again = search(7, Until::Histories(3), STEP_RATE, None, |_| {}).unwrap();
        assert_eq!(once, again);
        assert!(once.actions > 3 && once.machine_seconds > 1.0, "{once:?}");
    }

    #[test]
    fn hours_of_the_machine_and_numbers_of_histories_are_kept() {
        let hours = search(1, Until::MachineHours(0.02), STEP_RATE, None, |_| {}).unwrap();
        assert!(hours.machine_seconds >= 72.0, "{hours:?}");
        let mut calls = 0;
        let done = search(1, Until::Histories(2), STEP_RATE, None, |_| calls += 1).unwrap();
        assert_eq!((done.histories, calls), (2, 2));
    }
}
