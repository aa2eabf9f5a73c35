//! A board as Rust: the constants that `src/board/` is compiled with.

use std::{
    fmt::Write as _,
    hash::{DefaultHasher, Hash as _, Hasher as _},
    iter,
};

use crate::{Board, EepromPins, FlashSector, Input, Pin, Pull, SignedPin, Wiring};

/// The symbol of an image's [`fingerprint`].
pub const FINGERPRINT: &str = "_board_fingerprint";

/// Returns a number that tells images apart: of a board, all of whose file that [`rust`] makes source of, and of a
/// number of axes.
///
/// # Panics
///
/// If the board has no pins for that many axes.
pub fn fingerprint(board: &Board, axes: usize) -> u32 {
    let mut hasher = DefaultHasher::new();
    (&board.name, axes, tables(board, axes)).hash(&mut hasher);
    hasher.finish() as u32
}

/// Returns the source of a board with a number of axes, for `src/board/chosen.rs`.
///
/// # Panics
///
/// If the board has no pins for that many axes.
pub fn rust(board: &Board, axes: usize) -> String {
    // Cargo builds again when the file changes.
    let file = board.file.to_string_lossy();
    let tables = tables(board, axes);
    format!("/// The board's file.\nconst _: &[u8] = include_bytes!({file:?});\n\n{tables}")
}

/// The same without the file, whose place is of no matter to a chip.
fn tables(board: &Board, axes: usize) -> String {
    let wiring = board
        .wiring(axes)
        .expect("the caller has asked how many axes there are");
    let usart = wiring.serial.usart;
    let last = board.memory(axes).last;
    let clocks = board.chip.clocks;
    let mut text = format!(
        "/// The USART of the sender.
pub(super) type Usart = pac::USART{usart};

/// The clock of the timers 2 to 7 and 12 to 14.
pub(super) const SLOW_TIMERS_HZ: u32 = {};

/// The clocks of the buses APB1 and APB2.
pub(super) const BUSES_HZ: [u32; 2] = [{}, {}];

/// Number and first address of the last sector of the flash without settings.
#[allow(dead_code, reason = \"the bring-up erases it\")]
pub(super) const LAST_SECTOR: (u8, usize) = ({}, {});

/// Clocks, pins and memory of the board.
pub(super) static WIRING: Wiring = Wiring {{
",
        megahertz(clocks.apb1_timers_mhz()),
        megahertz(clocks.core_mhz / u32::from(clocks.apb1_divider)),
        megahertz(clocks.core_mhz / u32::from(clocks.apb2_divider)),
        last.sector,
        hexadecimal(last.address)
    );
    for (field, value) in fields(board, wiring) {
        let _ = writeln!(text, "    {field}: {value},");
    }
    text.push_str("};\n");
    text.push_str(&functions(wiring));
    text.push_str(&forwarding(usart));
    text
}

/// Returns the fields of `Wiring` in `src/board/wiring.rs`.
fn fields(board: &Board, wiring: &Wiring) -> [(&'static str, String); 17] {
    let clocks = board.chip.clocks;
    let accessories = format!(
        "AccessoryPins {{ spindle: {}, counter_clockwise: {}, flood: {}, mist: {} }}",
        optional(wiring.spindle),
        optional(wiring.counter_clockwise),
        optional(wiring.flood),
        optional(wiring.mist)
    );
    let inputs = list(&wiring.inputs, |(function, pin)| input(*function, *pin));
    let at_boot = list(&wiring.at_boot, |(at, high)| {
        format!("({}, {high})", pin(*at))
    });
    [
        ("crystal_hz", megahertz(board.crystal_mhz)),
        ("is_crystal_bypassed", board.is_crystal_bypassed.to_string()),
        ("core_hz", megahertz(clocks.core_mhz)),
        ("flash_wait_states", clocks.flash_wait_states.to_string()),
        ("transmit", pin(wiring.serial.transmit)),
        ("receive", pin(wiring.serial.receive)),
        (
            "serial_function",
            wiring.serial.alternate_function().to_string(),
        ),
        ("motors", motors(wiring)),
        (
            "enable",
            format!("&[{}]", list(&wiring.enable, |at| output(*at))),
        ),
        ("accessories", accessories),
        ("pwm", pwm(board, wiring)),
        ("inputs", format!("&[{inputs}]")),
        ("at_boot", format!("&[{at_boot}]")),
        ("chip", format!("{:?}", board.part_name)),
        (
            "dev_ids",
            format!(
                "&[{}]",
                list(&board.chip.dev_ids, |id| format!("{id:#05x}"))
            ),
        ),
        (
            "bootloaders",
            format!(
                "leadscrew::model::Bootloaders {{ dfu: {}, uf2: {} }}",
                board.has_usb_bootloader(),
                board.uf2_family.is_some()
            ),
        ),
        settings(board, wiring),
    ]
}

/// Returns the field of where the settings are.
fn settings(board: &Board, wiring: &Wiring) -> (&'static str, String) {
    if let Some(EepromPins { clock, data, .. }) = wiring.eeprom {
        let pins = format!(
            "EepromPins {{ clock: {}, data: {} }}",
            pin(clock),
            pin(data)
        );
        return ("eeprom", pins);
    }
    let memory = board.memory(wiring.axes());
    let journal = list(memory.journal.as_slice().as_flattened(), |page| {
        let FlashSector {
            sector, address, ..
        } = page;
        format!(
            "JournalPage {{ sector: {sector}, address: {} }}",
            hexadecimal(*address)
        )
    });
    ("journal", format!("[{journal}]"))
}

/// Returns the outputs of the motors.
fn motors(wiring: &Wiring) -> String {
    let pins = |pins: &[Pin]| format!("[{}]", list(pins, |at| pin(*at)));
    if wiring.phases.is_empty() {
        let (step, direction) = (pins(&wiring.step), pins(&wiring.direction));
        let second = list(&wiring.second, |motor| {
            format!(
                "super::wiring::SecondMotor {{ axis: {}, step: {}, direction: {}, is_reversed: {} }}",
                motor.axis,
                pin(motor.step),
                pin(motor.direction.pin),
                motor.direction.is_active_low
            )
        });
        format!("MotorPins {{ step: {step}, direction: {direction}, second: &[{second}] }}")
    } else {
        let phases = list(&wiring.phases, |coils| pins(coils));
        format!("MotorPins {{ phases: [{phases}] }}")
    }
}

/// Returns the functions that take and start the board's own peripherals.
fn functions(wiring: &Wiring) -> String {
    let usart = wiring.serial.usart;
    let mut text = format!(
        "
/// The USART of the sender, of all peripherals.
macro_rules! sender {{
    ($device:ident) => {{
        $device.USART{usart}
    }};
}}
pub(super) use sender;

/// Starts the clocks of the ports.
pub(super) fn enable_ports(rcc: &mut Rcc) {{
"
    );
    for port in wiring.ports() {
        let letter = char::from(b'A' + port);
        let _ = writeln!(text, "    pac::GPIO{letter}::enable(rcc);");
    }
    text += "}

/// Starts the clocks of the board's USART and of its PWM.
pub(super) fn enable_clocks(rcc: &mut Rcc) {
";
    let pwm = wiring.pwm.map(|(_, output)| format!("TIM{}", output.timer));
    for peripheral in iter::once(format!("USART{usart}")).chain(pwm) {
        let _ = writeln!(text, "    pac::{peripheral}::enable(rcc);");
    }
    text + "}\n"
}

/// Returns a frequency in Hz as Rust writes it.
fn megahertz(mhz: u32) -> String {
    format!("{mhz}_000_000")
}

/// Returns an address as Rust writes it: `0x0800_4000`.
fn hexadecimal(address: u32) -> String {
    format!("{:#06x}_{:04x}", address >> 16, address & 0xffff)
}

/// The task binds the vector of USART1: that of another one calls it.
fn forwarding(usart: u8) -> String {
    let (forwarded, body) = if usart == 1 {
        (String::new(), "    let _ = (nvic, priority);\n".to_owned())
    } else {
        (
            format!("super::vectors::forward_vectors!(USART{usart} => USART1);"),
            format!(
                "    super::vectors::unmask(nvic, &[pac::Interrupt::USART{usart}], priority);\n"
            ),
        )
    };
    format!(
        "
/// Has the vector of the sender call that of USART1, where it is another.
#[allow(unused_macros, reason = \"over USB there is no such vector\")]
macro_rules! forward_sender {{
    () => {{ {forwarded} }};
}}
#[allow(unused_imports, reason = \"over USB there is no such vector\")]
pub(super) use forward_sender;

/// Unmasks the vector of the sender, where RTIC does not.
#[allow(dead_code, reason = \"over USB there is no such vector\")]
pub(super) fn unmask_sender(nvic: &mut pac::NVIC, priority: u8) {{
{body}}}
"
    )
}

fn list<T>(values: &[T], one: impl Fn(&T) -> String) -> String {
    values.iter().map(one).collect::<Vec<_>>().join(", ")
}

fn pin(pin: Pin) -> String {
    format!("Pin::new('{}', {})", pin.letter(), pin.number)
}

fn output(signed: SignedPin) -> String {
    format!(
        "Output {{ pin: {}, is_active_low: {} }}",
        pin(signed.pin),
        signed.is_active_low
    )
}

fn optional(signed: Option<SignedPin>) -> String {
    signed.map_or("None".into(), |signed| format!("Some({})", output(signed)))
}

fn pwm(board: &Board, wiring: &Wiring) -> String {
    let Some((at, output)) = wiring.pwm else {
        return "None".into();
    };
    format!(
        "Some(Pwm {{ pin: {}, function: {}, timer: {}, channel: {}, prescaler: {}, has_break: {} }})",
        pin(at),
        output.alternate_function(),
        hexadecimal(output.base()),
        output.channel,
        output.prescaler(board.chip.clocks),
        output.has_break()
    )
}

fn input(function: Input, signed: SignedPin) -> String {
    let levels = match function {
        Input::Probe => "Levels::PROBE".into(),
        Input::Limit(axis) => format!("Levels::limits(1 << {axis})"),
        Input::SecondLimit(axis) => format!("Levels::second_limits(1 << {axis})"),
        Input::Hold => "Levels::HOLD".into(),
        Input::Start => "Levels::START".into(),
        Input::Door => "Levels::DOOR".into(),
        Input::Reset => "Levels::RESET".into(),
    };
    let pull = match signed.pull {
        Pull::None => "Pull::None",
        Pull::Up => "Pull::Up",
        Pull::Down => "Pull::Down",
    };
    format!(
        "Input {{ levels: {levels}, pin: {}, is_active_low: {}, pull: {pull} }}",
        pin(signed.pin),
        signed.is_active_low
    )
}
