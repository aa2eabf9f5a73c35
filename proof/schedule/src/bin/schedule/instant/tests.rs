//! The simulation against schedules that are known.

use super::*;
use crate::sample;

fn player(priority: u8, cost: u32, period: u32) -> Player {
    Player {
        task: 0,
        priority,
        cost: cost.into(),
        spacing: period.into(),
        period: period.into(),
        burst: 0.0,
    }
}

/// Numbers without a pattern, the same each time.
struct Numbers(u64);

impl Numbers {
    fn below(&mut self, limit: u32) -> u32 {
        self.0 = self
            .0
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 33) as u32 % limit
    }
}

/// The textbook's response time (Joseph and Pandya 1986), by counting the releases before `w`.
fn response(players: &[Player], index: usize, blocking: f64) -> Option<f64> {
    let own = &players[index];
    let mut last = blocking + own.cost;
    for _ in 0..10_000 {
        let others = players.iter().filter(|other| other.priority > own.priority);
        let interference = others.map(|other| {
            let count = (0..MOST_RELEASES)
                .take_while(|n| other.release(*n) < last)
                .count();
            count as f64 * other.cost
        });
        let next = blocking + own.cost + interference.sum::<f64>();
        if next == last {
            return Some(last);
        }
        last = next;
    }
    None
}

#[test]
fn a_schedule_known_by_heart() {
    // Liu and Layland's example: 1 of 2, 1 of 5 with a section of 1 before them.
    let blocker = Blocker {
        place: String::new(),
        ceiling: 9,
        length: 1.0,
    };
    let instant = play(vec![player(2, 1, 4), player(1, 3, 12)], Some(blocker), 12.0);
    let slice = |runner, start, end| Slice { runner, start, end };
    assert_eq!(
        instant.slices,
        [
            slice(Runner::Blocker, 0.0, 1.0),
            slice(Runner::Player(0), 1.0, 2.0),
            slice(Runner::Player(1), 2.0, 4.0),
            slice(Runner::Player(0), 4.0, 5.0),
            slice(Runner::Player(1), 5.0, 6.0),
            slice(Runner::Player(0), 8.0, 9.0),
        ]
    );
    assert_eq!(instant.first_finish(1), Some(6.0));
}

#[test]
fn the_example_of_the_documents_is_right() {
    let text = include_str!("../../../../../../docs/scheduling.md");
    let blocker = Blocker {
        place: String::new(),
        ceiling: 3,
        length: 100.0,
    };
    let players = vec![
        player(3, 200, 1000),
        player(2, 300, 3000),
        player(1, 1200, 10_000),
    ];
    let instant = play(players, Some(blocker), 9000.0);
    for (index, response) in [300.0, 600.0, 2000.0].into_iter().enumerate() {
        assert_eq!(instant.first_finish(index), Some(response));
        assert!(text.contains(&format!("= **{response}**")), "{response}");
    }
}

#[test]
fn a_task_above_the_ceiling_does_not_wait() {
    let blocker = Blocker {
        place: String::new(),
        ceiling: 1,
        length: 5.0,
    };
    let instant = play(
        vec![player(2, 2, 100), player(1, 3, 100)],
        Some(blocker),
        50.0,
    );
    assert_eq!(instant.first_finish(0), Some(2.0));
    assert_eq!(instant.first_finish(1), Some(10.0));
}

#[test]
fn the_simulation_agrees_with_the_formula_on_random_task_sets() {
    let mut numbers = Numbers(1);
    let mut compared = 0;
    for _ in 0..2000 {
        let count = 2 + numbers.below(4) as u8;
        let mut players: Vec<_> = (1..=count)
            .map(|priority| {
                let period = 40 + numbers.below(400);
                let mut player = player(priority, 1 + numbers.below(40), period);
                if numbers.below(2) == 0 {
                    player.spacing = f64::from(10 + numbers.below(30)).min(player.period);
                    player.burst = f64::from(numbers.below(5));
                }
                player
            })
            .collect();
        players.reverse();
        let length = f64::from(numbers.below(30));
        let blocker = Blocker {
            place: String::new(),
            ceiling: u8::MAX,
            length,
        };
        let instant = play(players.clone(), Some(blocker), 4000.0);
        for index in 0..players.len() {
            let Some(time) = response(&players, index, length).filter(|time| *time < 4000.0) else {
                continue;
            };
            assert_eq!(instant.first_finish(index), Some(time), "{players:?}");
            compared += 1;
        }
    }
    assert!(compared > 4000, "{compared} compared");
}

#[test]
fn no_time_is_lost_and_none_is_given_twice() {
    let instant = Instant::of_the_most_urgent(&sample::report());
    let mut last = 0.0;
    for slice in &instant.slices {
        assert!(slice.start >= last && slice.end > slice.start, "{slice:?}");
        last = slice.end;
    }
    let done = |index| {
        instant
            .jobs
            .iter()
            .filter(move |job| job.player == index && job.finish.is_some())
    };
    for (index, player) in instant.players.iter().enumerate() {
        let ran: f64 = instant
            .slices
            .iter()
            .filter(|slice| slice.runner == Runner::Player(index))
            .map(|slice| slice.end - slice.start)
            .sum();
        let least = done(index).count() as f64 * player.cost;
        assert!(
            ran + 1e-3 >= least && ran < least + 2.0 * player.cost,
            "{ran} {least}"
        );
    }
}

#[test]
fn a_response_time_that_is_too_short_is_a_contradiction() {
    let mut report = sample::report();
    assert_eq!(
        Instant::of_the_least_urgent(&report).contradiction(&report),
        None
    );
    report.tasks[1].response_cycles = Some(300);
    let text = Instant::of_the_least_urgent(&report)
        .contradiction(&report)
        .unwrap();
    assert!(
        text.contains("`serial_rx` is given as 300 cycles"),
        "{text}"
    );
}
