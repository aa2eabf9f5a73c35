//! A device is set up by every system on every core, whatever comes between.

use leadscrew::usb::registers::{CSRST, GRSTCTL};
use otg::{Core, Handshake, Host, HostError, System};
use usb_machine::PERIOD_US;

use crate::{
    board::{Board, NAME, silicons},
    opened,
};

#[test]
fn every_system_sets_the_device_up_on_every_core() {
    for silicon in silicons() {
        for system in System::ALL {
            for wait in [0, 1, 7] {
                let (mut core, mut board, mut host) =
                    (Core::new(silicon), Board::new(), Host::default());
                board.control_wait = wait;
                let result = host.enumerate(&mut core, system, &mut |core| board.period(core));
                assert_eq!(result, Ok(()), "{silicon:?} {system:?} {wait}");
                assert_eq!(core.violations(), [""; 0], "{silicon:?} {system:?}");
                assert_eq!(core.address(), 9);
                let strings = ["Leadscrew", NAME, "0123456789ABCDEF000000FF"];
                assert_eq!(host.strings, strings);
                assert_eq!(host.device[8..12], [0x09, 0x12, 0x01, 0x00]);
            }
        }
    }
}

#[test]
fn the_port_says_that_it_takes_a_break_and_that_the_board_has_its_own_supply() {
    let (_, _, host) = opened(silicons()[0]);
    let configuration = &host.configuration;
    assert_eq!(configuration.len(), 75);
    assert_eq!(configuration[7] & 0x40, 0x40);
    let mut descriptors = Vec::new();
    let mut rest = &configuration[..];
    while let [length, ..] = rest {
        let (first, others) = rest.split_at(usize::from(*length));
        descriptors.push(first);
        rest = others;
    }
    // CDC 1.2 PSTN, table 4: state and coding, and a break.
    assert!(descriptors.contains(&&[4, 0x24, 2, 6][..]));
    let endpoints = { descriptors.iter() }
        .filter(|it| it[1] == 5)
        .map(|it| it[2]);
    assert_eq!(endpoints.collect::<Vec<_>>(), [0x82, 0x81, 0x01]);
}

#[test]
fn a_core_that_does_not_end_its_reset_keeps_nobody_waiting_and_connects_later() {
    for silicon in silicons() {
        let (mut core, mut board, mut host) = (Core::new(silicon), Board::new(), Host::default());
        core.is_stuck = true;
        board.periods(&mut core, 1000);
        assert!(!core.is_connected());
        core.is_stuck = false;
        let result = host.enumerate(&mut core, System::Linux, &mut |core| board.period(core));
        assert_eq!(result, Ok(()), "{silicon:?}");
    }
}

#[test]
fn a_flush_or_a_withdrawal_that_does_not_end_begins_the_core_anew() {
    for silicon in silicons() {
        for begin in [Core::reset_bus, |core: &mut Core| core.suspend(true)] {
            let (mut core, mut board, mut host) = opened(silicon);
            assert!(board.sent.append(b"before"));
            board.periods(&mut core, 2);
            begin(&mut core);
            core.is_stuck = true;
            board.periods(&mut core, 50);
            assert_ne!(core.peek(GRSTCTL).unwrap_or(0) & CSRST, 0, "{silicon:?}");
            core.is_stuck = false;
            board.periods(&mut core, 200);
            let result = host.enumerate(&mut core, System::Windows, &mut |core| board.period(core));
            assert_eq!(result, Ok(()), "{silicon:?}");
        }
    }
}

#[test]
fn a_request_that_is_too_long_is_refused_and_the_next_ones_are_answered() {
    for silicon in silicons() {
        let (mut core, mut board, host) = opened(silicon);
        let device = &mut |core: &mut Core| board.period(core);
        let too_long = [0x40, 1, 0, 0, 0, 0, 200, 0];
        let refused = host.write(&mut core, too_long, &[1; 200], device);
        assert_eq!(refused, Err(HostError::Stalled), "{silicon:?}");
        let unknown = host.read(&mut core, [0xc0, 1, 0, 0, 0, 0, 8, 0], device);
        assert_eq!(unknown, Err(HostError::Stalled));
        let status = host.read(&mut core, [0x80, 0, 0, 0, 0, 0, 2, 0], device);
        assert_eq!(status, Ok(vec![1, 0]));
        assert_eq!(core.violations(), [""; 0]);
    }
}

#[test]
fn a_setup_in_the_middle_of_a_transfer_ends_the_transfer() {
    let configuration = [0x80, 6, 0, 2, 0, 0, 75, 0];
    let coding = [0x21, 0x20, 0, 0, 0, 0, 7, 0];
    for silicon in silicons() {
        for begun in [configuration, coding] {
            for periods in 0..8 {
                for wait in [0, 3] {
                    let (mut core, mut board, host) = opened(silicon);
                    board.control_wait = wait;
                    let device = &mut |core: &mut Core| board.period(core);
                    assert_eq!(host.setup(&mut core, begun, device), Ok(()));
                    (0..periods).for_each(|_| device(&mut core));
                    let status = host.read(&mut core, [0x80, 0, 0, 0, 0, 0, 2, 0], device);
                    assert_eq!(status, Ok(vec![1, 0]), "{silicon:?} {periods} {wait}");
                    let all = host.read(&mut core, configuration, device);
                    assert_eq!(all.map(|all| all.len()), Ok(75));
                    assert_eq!(core.violations(), [""; 0], "{silicon:?} {periods} {wait}");
                }
            }
        }
    }
}

#[test]
fn a_request_that_ends_in_the_period_of_the_next_one_leaves_nothing_behind() {
    for silicon in silicons() {
        let (mut core, mut board, host) = opened(silicon);
        let device = &mut |core: &mut Core| board.period(core);
        for _ in 0..3 {
            // The host fetches the end of the first, and sends the second at once.
            assert_eq!(host.set_lines(&mut core, 3, device), Ok(()));
            let all = host.read(&mut core, [0x80, 6, 0, 2, 0, 0, 75, 0], device);
            assert_eq!(all.map(|all| all.len()), Ok(75), "{silicon:?}");
            // The same, but the host is slow to fetch the answer.
            assert_eq!(host.set_lines(&mut core, 3, device), Ok(()));
            let setup = host.setup(&mut core, [0x80, 6, 0, 2, 0, 0, 75, 0], device);
            assert_eq!(setup, Ok(()));
            (0..5).for_each(|_| device(&mut core));
        }
        assert_eq!(core.violations(), [""; 0], "{silicon:?}");
    }
}

#[test]
fn a_device_has_address_0_10_ms_after_a_reset_of_the_bus_whatever_other_tasks_do() {
    for silicon in silicons() {
        let (mut core, mut board, _) = opened(silicon);
        assert_eq!(core.address(), 9);
        board.control_wait = 1000;
        core.reset_bus();
        board.periods(&mut core, 20);
        let device_request = [0x80, 6, 0, 1, 0, 0, 64, 0];
        assert_eq!(core.setup(0, device_request), Handshake::Ack, "{silicon:?}");
    }
}

#[test]
fn a_halt_is_reported_and_its_end_begins_with_data0() {
    for silicon in silicons() {
        let (mut core, mut board, mut host) = opened(silicon);
        let device = &mut |core: &mut Core| board.period(core);
        assert!(host.offer(&mut core, b"a"));
        (0..3).for_each(|_| device(&mut core));
        let halt = |endpoint| [2, 3, 0, 0, endpoint, 0, 0, 0];
        let status = |endpoint| [0x82, 0, 0, 0, endpoint, 0, 2, 0];
        for endpoint in [1, 0x81] {
            assert_eq!(host.write(&mut core, halt(endpoint), &[], device), Ok(()));
            let read = host.read(&mut core, status(endpoint), device);
            assert_eq!(read, Ok(vec![1, 0]), "{endpoint:x}");
        }
        (0..3).for_each(|_| device(&mut core));
        assert!(!host.offer(&mut core, b"b") && host.take(&mut core).is_none());
        assert_eq!(host.clear_halts(&mut core, device), Ok(()));
        (0..3).for_each(|_| device(&mut core));
        assert!(host.offer(&mut core, b"c"), "{silicon:?}");
        (0..3).for_each(|_| device(&mut core));
        assert_eq!(board.lines(), b"ac");
        assert!(board.sent.append(b"ok"));
        board.periods(&mut core, 3);
        assert_eq!(host.take(&mut core), Some(b"ok".to_vec()));
        assert_eq!(core.violations(), [""; 0], "{silicon:?}");
    }
}

#[test]
fn a_device_is_there_within_100_ms_of_power() {
    for silicon in silicons() {
        let (mut core, mut board) = (Core::new(silicon), Board::new());
        let periods = (0..).take_while(|_| {
            board.period(&mut core);
            !core.is_connected()
        });
        let us = periods.count() as u64 * PERIOD_US;
        assert!((28_000..100_000).contains(&us), "{us}");
    }
}
