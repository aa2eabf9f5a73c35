//! Programs of many kinds, each with the settings of its machine.

use std::fmt::Write as _;

use fastrand::Rng;

/// From which numbers are drawn.
const SEED: u64 = 24;
/// A machine that is faster than a new one.
const MILL: &str =
    "$100=320\n$101=320\n$102=400\n$110=5000\n$111=5000\n$112=3000\n$120=500\n$121=500\nok\n";

/// Name, program and settings of each.
pub(super) fn all() -> Vec<(&'static str, Vec<u8>, Vec<u8>)> {
    let rng = &mut Rng::with_seed(SEED);
    let with = |more: &str| format!("{MILL}{more}");
    let utf_16 = |text: String| {
        let units = std::iter::once(0xfeff).chain(text.encode_utf16().collect::<Vec<_>>());
        units.flat_map(u16::to_le_bytes).collect::<Vec<u8>>()
    };
    [
        ("rounded", rounded(rng), with("$785=0.05\n")),
        (
            "jerk",
            rounded(rng),
            with("$800=4000\n$801=4000\n$802=4000\n"),
        ),
        ("timed", timed(rng), with("")),
        ("laser", relief(600), with("$32=1\n$30=1000\n")),
        ("tiny", tiny(rng), with("")),
        ("mistaken", mistaken(rng), with("")),
        ("holes", holes(), with("$341=0\n")),
        ("offsets", offsets(rng), with("$13=1\n")),
        ("statements", statements(rng), with("")),
        ("locked", rounded(rng), with("$22=1\n$23=7\n")),
        ("beyond", rounded(rng), with("$22=1\n$20=1\n$132=500\n")),
        ("crossed", rounded(rng), with("$795=1\n")),
        ("printed", printed(rng), with("$780=1\n")),
        ("compensated", compensated(), with("")),
        (
            "alarmed",
            "G0X1\nG38.2Z-2F200\nG1X9F500\nG1X2\n".into(),
            with(""),
        ),
    ]
    .into_iter()
    .map(|(name, text, settings)| (name, text.into_bytes(), settings.into_bytes()))
    .chain([
        (
            "powershell",
            timed(rng).replace('\n', "\r\n").into_bytes(),
            utf_16(with("$11=0.02\r\n")),
        ),
        ("empty", Vec::new(), Vec::new()),
    ])
    .collect()
}

/// A number with two places.
fn number(rng: &mut Rng, most: i32) -> f64 {
    f64::from(rng.i32(-100 * most..=100 * most)) / 100.0
}

/// Lines that each come from the numbers drawn.
fn lines(rng: &mut Rng, count: usize, line: impl Fn(&mut Rng, usize) -> String) -> String {
    (0..count).map(|index| line(rng, index) + "\n").collect()
}

/// Corners and arcs that are rounded and merged.
fn rounded(rng: &mut Rng) -> String {
    let moves = lines(rng, 120, |rng, index| {
        let [x, y, z] = [30, 30, 3].map(|most| number(rng, most));
        match index % 5 {
            0 => format!("G64P{}Q0.02", 0.01 * f64::from(rng.u8(1..20))),
            1 => format!(
                "G3X{x}Y{y}R{}F{}",
                0.6 * x.hypot(y) + 0.1,
                rng.u32(300..4000)
            ),
            2 => format!("G2X{x}Y{y}Z{z}R{}", 0.7 * x.hypot(y) + 0.1),
            3 => format!("G0X{x}Y{y}"),
            _ => format!("G1X{x}Y{y}Z{z}F{}", rng.u32(100..5000)),
        }
    });
    format!("G21G91G17\n{moves}G61\nG1X1\nM30\n")
}

/// Inverse time, dwells, spindle and coolant.
fn timed(rng: &mut Rng) -> String {
    let moves = lines(rng, 80, |rng, index| match index % 6 {
        0 => format!("G4P0.{}", rng.u8(1..9)),
        1 => format!("M{}S{}", 3 + rng.u8(0..2), rng.u32(100..1000)),
        2 => format!("M{}", 7 + rng.u8(0..3)),
        3 => format!(
            "G93G1X{}Y{}F{}",
            number(rng, 9),
            number(rng, 9),
            rng.u32(20..400)
        ),
        4 => format!("G94G1Z{}F{}", number(rng, 2), rng.u32(100..900)),
        _ => "G18G2X2Z0I1K0\nG17".into(),
    });
    format!("G91\nG91.1\n{moves}M5M9\n")
}

/// A relief as lasers burn it.
pub(super) fn relief(count: usize) -> String {
    let mut text = "G21G91\nM4S0\nG1F6000\n".to_owned();
    for line in 0..count {
        let (row, column) = (line / 200, line % 200);
        let power = (row * 37 + column * 101) % 1000;
        let step_mm = if row % 2 == 0 { 0.5 } else { -0.5 };
        let _ = match column {
            0 => writeln!(text, "G0Y0.1"),
            _ => writeln!(text, "G1X{step_mm}S{power}"),
        };
    }
    text
}

/// Moves so short, and comments so long, that the line is too slow.
fn tiny(rng: &mut Rng) -> String {
    let moves = lines(rng, 900, |rng, index| {
        let comment = "-".repeat(rng.usize(0..90));
        let x = if index % 40 < 20 { 0.02 } else { -0.02 };
        format!("G1X{x}Y0.0{} ({comment})", rng.u8(1..9))
    });
    format!("G91F3000\n{moves}")
}

/// Lines of which many are refused.
fn mistaken(rng: &mut Rng) -> String {
    let wrong = [
        "G999",
        "X",
        "G1X1Y",
        "G2X1",
        "T300",
        "#1=3",
        "o100 call",
        "G1 G2 X1",
        "M98P5",
        "G1X1\u{b5}5",
        "A9",
        "G1F-1",
        "(open",
        "G10L9P1",
        "$999=1",
        "G43.7",
        "N99999999G0",
        "G38.2X1",
    ];
    lines(rng, 150, |rng, index| {
        if index % 3 == 0 {
            wrong[rng.usize(..wrong.len())].into()
        } else {
            format!(
                "G1X{}Y{}F{}",
                number(rng, 20),
                number(rng, 20),
                rng.u32(500..4000)
            )
        }
    })
}

/// Canned cycles and tool changes.
fn holes() -> String {
    let mut text = "G21G90G98\nT1M6\nM3S900\nG0Z9\n".to_owned();
    for cycle in [
        "G73Q1", "G81", "G82P0.1", "G83Q1.5", "G84", "G85", "G86P0.05", "G89P0.02",
    ] {
        let _ = writeln!(text, "G90{cycle}X5Y5Z-3R2F300\nG91X6L3\nG90G99Y12\nG80");
    }
    text + "T2M6\nM61Q3\nM30\n"
}

/// Inches, work coordinates, rotation and tool offsets.
fn offsets(rng: &mut Rng) -> String {
    let moves = lines(rng, 90, |rng, index| match index % 9 {
        0 => format!(
            "G10L2P{}X{}Y{}R{}",
            rng.u8(1..10),
            number(rng, 1),
            number(rng, 1),
            rng.u8(0..90)
        ),
        1 => format!("G5{}", rng.u8(4..10)),
        2 => format!("G10L1P{}Z{}", rng.u8(1..5), number(rng, 1)),
        3 => format!("G43H{}", rng.u8(1..5)),
        4 => format!("G92X{}", number(rng, 1)),
        5 => "G28.1".into(),
        6 => format!("G91G28Z{}\nG90", number(rng, 1)),
        _ => format!(
            "G1X{}Y{}Z{}F90",
            number(rng, 2),
            number(rng, 2),
            number(rng, 1)
        ),
    });
    format!("G20G90\n{moves}G92.1\nG49\nG53G0X0Y0\n")
}

/// Statements and jogs among the moves.
fn statements(rng: &mut Rng) -> String {
    lines(rng, 60, |rng, index| match index % 6 {
        0 => format!("$110={}", rng.u32(500..5000)),
        1 => format!("$J=G91X{}F{}", number(rng, 9), rng.u32(100..4000)),
        2 => "$G".into(),
        3 => "$#".into(),
        4 => format!("$120={}", rng.u32(50..900)),
        _ => format!("G91G1X{}Y{}F2000", number(rng, 9), number(rng, 9)),
    })
}

/// What slicers write for printers.
fn printed(rng: &mut Rng) -> String {
    let moves = lines(rng, 100, |rng, index| match index % 10 {
        0 => "M105".into(),
        1 => "M400".into(),
        2 => "G92 E0".into(),
        3 => "M204 P500 ; slower".into(),
        _ => format!(
            "G1 X{} Y{} F{}",
            number(rng, 30).abs(),
            number(rng, 30).abs(),
            rng.u32(600..6000)
        ),
    });
    format!("; a cube\nG90\nM82\nG21\n{moves}M84\n")
}

/// A contour beside which the cutter stays.
fn compensated() -> String {
    "G21G90F800\nG0X-5Y-5\nG41.1D3\nG1X0Y0\nY20\nG2X10Y30I10J0\nG1X30\nY0\nX0\nG40X-9Y-9\n\
     G42.1D2\nG1X0Y0\nX20\nY15\nX0Y0\nG40Y-9\nM2\n"
        .into()
}
