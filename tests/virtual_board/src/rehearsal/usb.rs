//! The link by USB: every system sets the device up, and what becomes of a motion when the link is lost.

use otg::System;

use super::RESET;
use crate::{
    bench::Link,
    script::{Act, PowerUp, Wanted},
    usb_host::HostAction::{self, Close, Enumerate, Open, Resume, Suspend},
};

/// Losses of the link, with what brings it back, and whether the sender is welcomed then.
const LOSSES: [(&str, &[HostAction], bool); 3] = [
    ("the port is closed", &[Close, Open], true),
    ("the host sleeps", &[Suspend, Resume], false),
    ("the bus is reset", &[Enumerate(System::Linux)], true),
];

/// What hosts do, and the states in which the machine is afterwards, where there is a host.
pub(super) fn script(link: Link, right: PowerUp, is_short: bool) -> Vec<Act> {
    if link == Link::Uart {
        return Vec::new();
    }
    let mut script = vec![Act::Part("hosts at USB")];
    for system in System::ALL {
        script.extend([
            Act::Case(format!("{system:?}"), right),
            Act::Host(Enumerate(system)),
            Act::Await("Grbl 1.1h"),
            Act::line("G21G91"),
            Act::line("G1X1F600"),
            Act::State("Idle"),
            Act::Want(Wanted::Position),
        ]);
    }
    let losses = if is_short { &LOSSES[..1] } else { &LOSSES };
    for &(name, actions, is_welcomed) in losses {
        script.extend([
            Act::Case(name.into(), right),
            Act::Await("Grbl 1.1h"),
            Act::line("G21G91"),
            Act::line("G1X20F600"),
        ]);
        script.extend({ actions.iter() }.flat_map(|it| [Act::Pause(200), Act::Host(*it)]));
        script.extend(is_welcomed.then_some(Act::Await("Grbl 1.1h")));
        script.extend([
            // Nothing goes on by itself.
            Act::State("Hold:0"),
            Act::Want(Wanted::Position),
            Act::Bytes(b"~"),
            Act::State("Idle"),
            Act::Want(Wanted::Position),
            Act::Bytes(RESET),
            Act::Await("Grbl "),
            Act::Want(Wanted::Resets(&[])),
        ]);
    }
    script
}
