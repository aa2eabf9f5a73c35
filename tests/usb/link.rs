//! The link is lost and comes back: what is sent meanwhile is dropped, and nothing of it is sent later.

use otg::{Core, System};

use crate::{board::silicons, opened};

#[test]
fn a_suspended_bus_loses_the_link_once_and_drops_the_output() {
    for silicon in silicons() {
        let (mut core, mut board, mut host) = opened(silicon);
        assert!(!board.requests.take_link_loss());
        assert!(board.sent.append(b"before"));
        board.periods(&mut core, 2);
        core.suspend(true);
        for _ in 0..20 {
            assert!(board.sent.append(&[b'x'; 600]));
            board.period(&mut core);
        }
        assert!(board.requests.take_link_loss());
        board.periods(&mut core, 20);
        assert!(!board.requests.take_link_loss() && board.sent.is_empty());
        core.suspend(false);
        board.periods(&mut core, 3);
        assert!(board.sent.append(b"after"));
        board.periods(&mut core, 2);
        assert_eq!(host.take(&mut core), Some(b"after".to_vec()), "{silicon:?}");
        assert!(!board.requests.take_link_loss());
        assert_eq!(core.violations(), [""; 0]);
    }
}

#[test]
fn a_closed_port_loses_the_link_and_an_opened_one_is_welcomed() {
    for silicon in silicons() {
        let (mut core, mut board, mut host) = opened(silicon);
        for _ in 0..3 {
            assert!(board.sent.append(b"before"));
            board.periods(&mut core, 2);
            let device = &mut |core: &mut Core| board.period(core);
            assert_eq!(host.set_lines(&mut core, 0, device), Ok(()));
            board.periods(&mut core, 10);
            assert!(board.requests.take_link_loss() && !board.requests.take_greeting());
            assert!(board.sent.append(b"nobody"));
            board.periods(&mut core, 3);
            assert!(board.sent.is_empty() && host.take(&mut core).is_none());
            let device = &mut |core: &mut Core| board.period(core);
            assert_eq!(host.open(&mut core, System::Linux, device), Ok(()));
            board.periods(&mut core, 2);
            assert!(!board.requests.take_link_loss() && board.requests.take_greeting());
            assert!(board.sent.append(b"after"));
            board.periods(&mut core, 2);
            assert_eq!(host.take(&mut core), Some(b"after".to_vec()), "{silicon:?}");
            assert_eq!(board.requests.reset_count(), 0);
        }
        assert_eq!(core.violations(), [""; 0]);
    }
}

#[test]
fn a_host_that_sets_no_lines_is_served_all_the_same() {
    let (mut core, mut board, mut host) = opened(silicons()[0]);
    let device = &mut |core: &mut Core| board.period(core);
    assert_eq!(host.set_lines(&mut core, 0, device), Ok(()));
    board.periods(&mut core, 10);
    // Whoever sends listens.
    assert!(host.offer(&mut core, b"?"));
    board.periods(&mut core, 2);
    assert!(board.sent.append(b"<Idle>"));
    board.periods(&mut core, 2);
    assert_eq!(host.take(&mut core), Some(b"<Idle>".to_vec()));
}

#[test]
fn a_reset_of_the_bus_loses_the_link_and_leaves_no_output_behind() {
    for silicon in silicons() {
        for system in System::ALL {
            let (mut core, mut board, mut host) = opened(silicon);
            assert!(board.sent.append(b"before"));
            board.periods(&mut core, 2);
            assert!(board.sent.append(b"before, too"));
            let device = &mut |core: &mut Core| board.period(core);
            assert_eq!(host.enumerate(&mut core, system, device), Ok(()));
            board.periods(&mut core, 5);
            assert!(board.requests.take_link_loss());
            assert_eq!(host.take(&mut core), None, "{silicon:?} {system:?}");
            assert!(board.sent.append(b"after"));
            board.periods(&mut core, 2);
            assert_eq!(host.take(&mut core), Some(b"after".to_vec()));
            assert_eq!(core.violations(), [""; 0]);
        }
    }
}

#[test]
fn a_line_that_nobody_ends_is_ended_and_counts_as_damaged() {
    for (sent, received, lost) in [
        (&b"G1X1\nG1X20"[..], &b"G1X1\nG1X20\n"[..], 1),
        (b"G1X1\n", b"G1X1\n", 0),
    ] {
        let (mut core, mut board, mut host) = opened(silicons()[0]);
        assert!(host.offer(&mut core, sent));
        board.periods(&mut core, 2);
        core.suspend(true);
        board.periods(&mut core, 2);
        assert_eq!(
            (board.lines(), board.requests.lost()),
            (received.to_vec(), lost)
        );
        assert_eq!(board.requests.take_losses_before(received.len()), lost == 1);
    }
}

#[test]
fn a_break_is_requested_once_for_each_and_its_end_is_none() {
    for silicon in silicons() {
        let (mut core, mut board, host) = opened(silicon);
        for ms in [100, 0, 0xffff, 0] {
            let device = &mut |core: &mut Core| board.period(core);
            assert_eq!(host.send_break(&mut core, ms, device), Ok(()));
            assert_eq!(
                board.requests.take_line_break(),
                ms != 0,
                "{silicon:?} {ms}"
            );
        }
    }
}
