//! The link to the sender by USB, in the place of `serial.rs`: the chip's OTG full-speed core, and TIM11, which releases
//! `usb`.
//!
//! The core interrupts nobody. While flash is erased, it answers the host with NAK, and nothing is lost.

use core::mem::MaybeUninit;

use super::{
    chosen::TIMERS_MHZ,
    pac,
    release::ChipPlatform,
    vectors::USB_CONTROL,
    wiring::{Pin, Pull},
};
use leadscrew::{
    model::Requests,
    protocol::{ByteReader, IncomingWriter},
    tasks::{Platform, Task},
    usb::{
        self, ControlBus, ControlBusAllocator, Driver, LONGEST_NAME, Mailbox, Registers,
        SERIAL_NUMBER_LENGTH, SenderQueues, serial_number,
    },
};

/// Time between two runs of `usb`, µs.
pub(super) const USB_PERIOD_US: u16 = 500;

/// D- and D+, and their alternate function: data sheets, alternate function mapping, the same on all F4.
const DATA_PINS: [Pin; 2] = [Pin::new('A', 11), Pin::new('A', 12)];
const OTG_FUNCTION: u32 = 10;

/// The registers of the core: RM0090 2.3.
const OTG_FS: *mut u32 = 0x5000_0000 as *mut u32;
/// The unique number of the chip: RM0090 39.1.
const UNIQUE_NUMBER: *const [u32; 3] = 0x1fff_7a10 as *const [u32; 3];

/// The name of the board, as the host shows it.
const BOARD_NAME: &str = env!("LEADSCREW_BOARD_TITLE");
const _: () = assert!(
    BOARD_NAME.len() <= LONGEST_NAME,
    "the host shows no longer name"
);

/// The registers, for `usb` alone.
struct OtgCore;

#[expect(
    unsafe_code,
    reason = "registers by offset, as the driver of the library has them"
)]
impl Registers for OtgCore {
    #[inline(always)]
    #[expect(clippy::inline_always, reason = "the offset is a constant")]
    fn read(&mut self, offset: usize) -> u32 {
        // SAFETY: the driver has offsets of registers that exist; `usb` alone touches them.
        unsafe { OTG_FS.byte_add(offset).read_volatile() }
    }

    #[inline(always)]
    #[expect(clippy::inline_always, reason = "the offset is a constant")]
    fn write(&mut self, offset: usize, value: u32) {
        // SAFETY: as above.
        unsafe { OTG_FS.byte_add(offset).write_volatile(value) };
    }
}

/// What both tasks of USB share.
pub(crate) struct UsbMemory {
    mailbox: Mailbox,
    allocator: MaybeUninit<ControlBusAllocator<'static>>,
    serial_number: [u8; SERIAL_NUMBER_LENGTH],
}

impl UsbMemory {
    /// Returns the memory before anything is in it.
    pub(crate) const fn new() -> Self {
        Self {
            mailbox: Mailbox::new(),
            allocator: MaybeUninit::uninit(),
            serial_number: [0; SERIAL_NUMBER_LENGTH],
        }
    }

    /// Makes the ends of both tasks.
    ///
    /// # Panics
    ///
    /// If `usb-device` refuses sizes or names, which are the same in each start.
    #[inline(never)]
    #[expect(unsafe_code, reason = "the chip's number is at an address")]
    pub(crate) fn split(&'static mut self, port: UsbPort) -> (UsbLink, UsbControl) {
        // SAFETY: three words of the system memory, which is only read.
        self.serial_number = serial_number(unsafe { UNIQUE_NUMBER.read_volatile() });
        let serial_number = str::from_utf8(&self.serial_number).unwrap_or_default();
        let allocator = self.allocator.write(ControlBus::allocator(&self.mailbox));
        let control = usb::UsbControl::new(allocator, BOARD_NAME, serial_number);
        let control = control.expect("the sizes and names are allowed");
        let link = UsbLink {
            driver: Driver::new(&self.mailbox),
            timer: port.0,
        };
        (link, UsbControl(control))
    }
}

/// The core with its clocks and pins, and the timer of `usb`.
pub(crate) struct UsbPort(pac::TIM11);

impl UsbPort {
    /// Sets up pins and timer. The clocks of both must run.
    pub(super) fn new(timer: pac::TIM11) -> Self {
        for pin in DATA_PINS {
            pin.make_fast_alternate(OTG_FUNCTION, Pull::None);
        }
        timer.psc().write(|w| w.psc().set(TIMERS_MHZ - 1));
        timer.arr().write(|w| w.arr().set(USB_PERIOD_US - 1));
        timer.cr1().write(|w| w.urs().set_bit());
        timer.egr().write(|w| w.ug().set_bit());
        timer.dier().write(|w| w.uie().set_bit());
        timer.cr1().write(|w| w.urs().set_bit().cen().set_bit());
        Self(timer)
    }
}

/// The driver and the timer, of `usb`.
pub(crate) struct UsbLink {
    driver: Driver<'static>,
    timer: pac::TIM11,
}

impl UsbLink {
    /// Runs `usb`. The queues are resources of their own: so the proof knows where they are.
    pub(crate) fn serve(
        &mut self,
        reception: &mut IncomingWriter<'static>,
        sent: &mut ByteReader<'static>,
    ) {
        if self.timer.sr().read().uif().bit_is_set() {
            self.timer.sr().write(|w| w.uif().clear_bit());
        }
        let (requests, mut received) = reception.parts();
        let mut line = SenderQueues {
            requests,
            received: &mut received,
            sent,
        };
        let mut releases = Releases::default();
        if self.driver.serve(&mut OtgCore, &mut line, &mut releases) {
            rtic::pend(USB_CONTROL);
        }
        if releases.has_prepare {
            ChipPlatform.pend(Task::Prepare);
        }
        if releases.has_wake {
            ChipPlatform.pend(Task::Wake);
        }
    }
}

/// The tasks that a run of `usb` releases at its end, each once; all have lower priorities.
#[derive(Default)]
struct Releases {
    has_prepare: bool,
    has_wake: bool,
}

impl Platform for Releases {
    fn pend(&mut self, task: Task) {
        match task {
            // `usb` begins no segment.
            Task::SegmentStart => {}
            Task::Prepare => self.has_prepare = true,
            Task::Wake => self.has_wake = true,
        }
    }

    fn now_ticks(&self) -> u32 {
        ChipPlatform.now_ticks()
    }

    fn set_duty(&mut self, duty: u16) {
        ChipPlatform.set_duty(duty);
    }
}

/// The device as the host sees it, of `usb_control`.
pub(crate) struct UsbControl(usb::UsbControl<'static>);

impl UsbControl {
    /// Runs `usb_control`.
    pub(crate) fn serve(&mut self, requests: &Requests) {
        if self.0.serve(requests) {
            ChipPlatform.pend(Task::Wake);
        }
    }
}

/// The sending half of a board whose `usb` sends.
pub(crate) struct Transmitter;

#[expect(clippy::unused_self, reason = "a USART needs it")]
impl Transmitter {
    /// Returns whether no byte waits for this task.
    pub(super) const fn is_done(&self) -> bool {
        true
    }

    /// Sends nothing.
    pub(super) const fn send_next(&mut self, _: &Requests) {}

    /// Sends nothing.
    pub(super) const fn send_all(&mut self, _: &Requests) {}
}

/// The receiver for the time of an erase of flash: the core waits.
#[cfg(not(feature = "eeprom"))]
pub(super) struct FlashEraseReceiver;

#[cfg(not(feature = "eeprom"))]
#[expect(clippy::unused_self, reason = "a USART needs it")]
impl FlashEraseReceiver {
    /// Returns a receiver.
    pub(super) const fn new(_: IncomingWriter<'static>) -> Self {
        Self
    }

    /// Receives nothing.
    #[inline(always)]
    pub(super) const fn receive(&mut self) {}
}
