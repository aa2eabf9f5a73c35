//! The sender's USART: each received byte is compared with the expected byte, and answered.
//!
//! Receiving and sending are the firmware's. `proof/target/src/bring_up/exchange.rs` is the other side.

use core::{
    cell::UnsafeCell,
    fmt::Write as _,
    sync::atomic::{AtomicU32, Ordering::Relaxed},
};

use leadscrew::protocol::IncomingWriter;
use rtt_target::{ChannelMode, UpChannel};

use super::{
    Facts,
    chosen::Usart,
    clock, emulation,
    fault_port::FaultPort,
    flash,
    line::{Line, is_silent},
    pac, priorities,
    sequence::{FROM_BOARD, Sequence, TO_BOARD},
    serial::{FlashEraseReceiver, Receiver},
    stream, vectors,
};

/// Bytes each way: a minute and a half on a board, a moment in the emulator.
const BYTES: u32 = 1 << 20;
const EMULATED_BYTES: u32 = 1 << 13;
/// Says that what comes on the serial line from here on are answers.
const MARK: &str = "\r\n[bring-up]\r\n";
/// Asks for a byte, in the emulator.
const BYTE_REQUEST: &str = "\r\n[byte]\r\n";
/// Number of the RTT channel.
const CHANNEL: usize = 0;

/// What the handler of the USART has.
struct Handler {
    receiver: Receiver,
    reception: IncomingWriter<'static>,
}

struct Shared(UnsafeCell<Option<Handler>>);

#[expect(unsafe_code, reason = "a handler has no arguments")]
// SAFETY: the handler alone uses it once interrupts are on.
unsafe impl Sync for Shared {}

static HANDLER: Shared = Shared(UnsafeCell::new(None));
/// Runs of the handler before it has a receiver.
static SERVED_EARLY: AtomicU32 = AtomicU32::new(0);

/// Returns how often the interrupt has run before the exchange, wrapping.
pub(super) fn served_early() -> u32 {
    SERVED_EARLY.load(Relaxed)
}

#[expect(unsafe_code, reason = "a handler has no arguments")]
fn handler() -> &'static mut Option<Handler> {
    // SAFETY: as tells `Shared`.
    unsafe { &mut *HANDLER.0.get() }
}

/// Unmasks the vector to which those of all other USARTs hand on, with the priority of the firmware.
pub(super) fn unmask(nvic: &mut pac::NVIC) {
    vectors::unmask(nvic, &[pac::Interrupt::USART1], priorities::SERIAL);
}

#[unsafe(no_mangle)]
#[expect(unsafe_code, reason = "a vector that RTIC does not manage")]
extern "C" fn USART1() {
    if let Some(Handler {
        receiver,
        reception,
    }) = handler()
    {
        receiver.serve(reception);
    } else {
        // Somebody sends already: what nobody reads would run this for ever.
        SERVED_EARLY.store(served_early().wrapping_add(1), Relaxed);
        discard();
    }
}

/// Drops the byte that has come, if there is one, and an overrun: RM0090 30.6.1.
#[expect(unsafe_code, reason = "nobody receives yet")]
fn discard() {
    // SAFETY: the receiver is not used before the exchange.
    let usart = unsafe { &*Usart::ptr() };
    let _ = usart.sr().read();
    let _ = usart.dr().read();
}

/// In the emulator, asks for a byte and leaves it in the receiver: the byte must not stop anything that follows.
#[expect(unsafe_code, reason = "nobody receives yet")]
pub(super) fn await_early_byte() {
    if emulation::is_emulated() {
        let _ = FaultPort.write_str(BYTE_REQUEST);
        // SAFETY: reads a register without side effects.
        let usart = unsafe { &*Usart::ptr() };
        while usart.sr().read().rxne().bit_is_clear() {}
    }
}

/// Sends the facts, exchanges bytes with whoever is at the serial line, and sends what came of it.
pub(super) fn end(facts: &mut Facts, receiver: Receiver, registers: pac::FLASH) -> ! {
    let (mut line, reception) = Line::take();
    let during_erase = FlashEraseReceiver::new(reception.second());
    *handler() = Some(Handler {
        receiver,
        reception,
    });
    let bytes = if emulation::is_emulated() {
        EMULATED_BYTES
    } else {
        BYTES
    };
    facts.put("serial.expected", bytes.into());
    facts.put("stream.expected", stream::length().into());
    let _ = FaultPort.write_str(MARK);
    FaultPort::drain();
    await_early_byte();
    // What comes before is of faults that were made.
    print("facts\n");
    print(facts.text());
    // Not a byte that the next steps ask for.
    discard();
    print("ready\n");
    facts.clear();
    #[expect(unsafe_code, reason = "the handler has what it needs")]
    // SAFETY: nothing shares anything under a lock of priorities.
    unsafe {
        cortex_m::interrupt::enable();
    }
    exchange(facts, &mut line, bytes);
    stream::send(facts, &mut line);
    flash::measure(facts, &mut line, registers, during_erase);
    print(facts.text());
    print("end\n");
    if emulation::is_emulated() {
        semihosting::process::exit(0)
    }
    loop {
        cortex_m::asm::nop();
    }
}

/// Sends text to whoever reads the facts, and waits for him.
fn print(text: &str) {
    if emulation::is_emulated() {
        semihosting::print!("{text}");
        return;
    }
    #[expect(unsafe_code, reason = "the channel of the panic handler")]
    // SAFETY: nothing else has it but a panic, which never returns.
    let channel = unsafe { UpChannel::conjure(CHANNEL) };
    if let Some(mut channel) = channel {
        channel.set_mode(ChannelMode::BlockIfFull);
        channel.write(text.as_bytes());
    }
}

/// Takes so many bytes, or those that come before a silence, and answers each.
fn exchange(facts: &mut Facts, line: &mut Line, bytes: u32) {
    let (mut count, mut wrong) = (0, 0);
    let (mut expected, mut answer) = (Sequence::new(TO_BOARD), Sequence::new(FROM_BOARD));
    let mut last = clock::now();
    while count < bytes || !line.is_sent() {
        line.send_next();
        if count != 0 && is_silent(last) {
            break;
        }
        // A byte whose answer does not fit is not taken: the queue of those that come has room for more. What
        // comes behind the last asks for something else.
        if count == bytes || !line.has_room() {
            continue;
        }
        if let Some(byte) = line.next_byte() {
            last = clock::now();
            count += 1;
            wrong += i64::from(byte != expected.next_byte());
            line.queue(answer.next_byte());
        }
    }
    FaultPort::drain();
    facts.put("serial.received", count.into());
    facts.put("serial.wrong", wrong);
    facts.put("serial.lost", line.lost().into());
}
