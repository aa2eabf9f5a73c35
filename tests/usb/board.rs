//! The tasks of USB between the model of the core and the queues of the sender's line.

use leadscrew::{
    model::{Requests, queues::SENT_RING},
    protocol::{ByteReader, ByteWriter, Bytes, Incoming, IncomingWriter},
    tasks::{Platform, Task},
    usb::{Driver, SenderQueues, UsbControl},
};
use otg::{Core, SetupEnd, Silicon, Version};
use usb_machine::{Bus, PERIOD_US};

/// The name of the board, and its serial number.
pub(crate) const NAME: &str = "A board";
pub(crate) const UNIQUE: [u32; 3] = [0x0123_4567, 0x89ab_cdef, 0x0000_00ff];

/// Every kind of core, as far as the manuals leave it open.
pub(crate) fn silicons() -> Vec<Silicon> {
    let mut all = Vec::new();
    for version in [Version::V1, Version::V2] {
        for setup_end in [SetupEnd::Entry, SetupEnd::TransferFirst, SetupEnd::Missing] {
            for keeps_enabled in [false, true] {
                all.push(Silicon {
                    version,
                    setup_end,
                    keeps_enabled,
                });
            }
        }
    }
    all
}

/// Counts the releases of `wake` and of `prepare`.
#[derive(Debug, Default)]
pub(crate) struct Releases {
    pub(crate) wake: u32,
    pub(crate) prepare: u32,
}

impl Platform for Releases {
    fn pend(&mut self, task: Task) {
        match task {
            Task::SegmentStart => {}
            Task::Prepare => self.prepare += 1,
            Task::Wake => self.wake += 1,
        }
    }

    fn now_ticks(&self) -> u32 {
        0
    }

    fn set_duty(&mut self, _duty: u16) {}
}

/// The board without a machine behind it.
pub(crate) struct Board {
    driver: Driver<'static>,
    control: UsbControl<'static>,
    pub(crate) requests: &'static Requests,
    reception: IncomingWriter<'static>,
    pub(crate) received: ByteReader<'static>,
    pub(crate) sent: ByteWriter<'static>,
    sent_out: ByteReader<'static>,
    pub(crate) releases: Releases,
    /// `usb_control` is released.
    is_released: bool,
    /// Periods for which other tasks keep `usb_control` waiting.
    pub(crate) control_wait: u32,
    waited: u32,
}

impl Board {
    /// A board out of a reset.
    pub(crate) fn new() -> Self {
        let (driver, control) = usb_machine::tasks(NAME, UNIQUE);
        let incoming: &'static mut Incoming = Box::leak(Box::new(Incoming::new()));
        let (requests, reception, received) = incoming.split();
        let sent: &'static mut Bytes<SENT_RING> = Box::leak(Box::new(Bytes::new()));
        let (sent, sent_out) = sent.split();
        Self {
            driver,
            control,
            requests,
            reception,
            received,
            sent,
            sent_out,
            releases: Releases::default(),
            is_released: false,
            control_wait: 0,
            waited: 0,
        }
    }

    /// A period passes: `usb` runs, and `usb_control` when it is released and has its turn.
    pub(crate) fn period(&mut self, core: &mut Core) {
        core.pass(PERIOD_US);
        let (requests, mut received) = self.reception.parts();
        let mut line = SenderQueues {
            requests,
            received: &mut received,
            sent: &mut self.sent_out,
        };
        let releases = &mut self.releases;
        self.is_released |= self.driver.serve(&mut Bus(core), &mut line, releases);
        if self.is_released && self.waited >= self.control_wait {
            (self.is_released, self.waited) = (false, 0);
            self.control.serve(requests);
        } else {
            self.waited += u32::from(self.is_released);
        }
    }

    /// Some periods pass.
    pub(crate) fn periods(&mut self, core: &mut Core, count: usize) {
        for _ in 0..count {
            self.period(core);
        }
    }

    /// The received bytes of lines.
    pub(crate) fn lines(&mut self) -> Vec<u8> {
        std::iter::from_fn(|| self.received.dequeue()).collect()
    }
}
