//! Random lines over all codes, most of them right.

use proptest::prelude::*;

/// A coordinate, mostly within the travel.
fn mm() -> impl Strategy<Value = String> {
    prop_oneof![
        6 => "-[0-9]{1,2}(\\.[0-9]{1,3})?",
        2 => "[0-9](\\.[0-9]{1,3})?",
        1 => "-?[0-9]{3}",
    ]
}

/// Words of some axes.
fn axes() -> impl Strategy<Value = String> {
    let word = |letter: char| {
        (any::<bool>(), mm()).prop_map(move |(is_programmed, mm)| {
            if is_programmed {
                format!("{letter}{mm}")
            } else {
                String::new()
            }
        })
    };
    (word('X'), word('Y'), word('Z')).prop_map(|(x, y, z)| x + &y + &z)
}

/// Lines of every code, most of them right.
pub(crate) fn any_line() -> impl Strategy<Value = String> {
    let with_axes = |codes: &'static [&'static str]| {
        (prop::sample::select(codes), axes()).prop_map(|(code, axes)| format!("{code}{axes}"))
    };
    prop_oneof![
        12 => with_axes(&["", "G0", "G1", "G1F3000", "G53G0", "G91", "G90", "N7G1F2000"]),
        4 => with_axes(&[
            "G2I-3F3000", "G3I2J2F2000", "G2R40F3000", "G3R-30F2000", "G2K1F3000", "G3P2I1F4000",
            "G90.1G2I-50J-50F2000",
        ]),
        3 => with_axes(&["G38.2F2000", "G38.3F2000", "G38.4F2000", "G38.5F2000"]),
        4 => with_axes(&[
            "G10L2P0", "G10L2P3R30", "G10L2P0R-17.5", "G10L20P0", "G10L20P9", "G10L2P1R0", "G52",
            "G92", "G43.1", "G28", "G30", "G0G28", "G91G28", "G43.2",
        ]),
        2 => with_axes(&["G10L1P2", "G10L10P2", "G10L11P3R1.5", "G10L1P2R-1"]),
        2 => with_axes(&["G81R-1Z-3F3000", "G83R-2Q1F2000", "G73R-2Q0.5Z-4", "G82R-1P0.1Z-2", "G85R1"]),
        2 => with_axes(&["G41D2G1", "G42D3G1", "G41.1D1.5G1", "G40G1"]),
        6 => prop::sample::select(&[
            "G17", "G18", "G19", "G20", "G21", "G40", "G49", "G54", "G55", "G56", "G57", "G58", "G59",
            "G59.1", "G59.2", "G59.3", "G61", "G61.1", "G64", "G64P0.1", "G64P0.2Q0.1", "G80", "G90",
            "G91", "G90.1", "G91.1", "G93", "G94", "G97", "G98", "G99", "G28.1", "G30.1", "G92.1",
            "G92.2", "G92.3", "G43", "G43H2", "G43H9", "G43.2H2", "G50",
        ][..]).prop_map(str::to_owned),
        4 => prop::sample::select(&[
            "M0", "M1", "M2", "M30", "M3S500", "M4S100", "M5", "M7", "M8", "M9", "M48", "M49", "M50P0",
            "M51P0", "M53P0", "M6", "T2", "T3M6", "T0M6", "M61Q2", "T1M6G43", "G4P0.05", "S900", "F1500",
            "%", "O1234", ":12", "(MSG,hello)", "",
        ][..]).prop_map(str::to_owned),
        2 => with_axes(&["$J=G91F3000", "$J=F2000", "$J=G53F3000", "$J=G21G91F9000"]),
        2 => prop::sample::select(&[
            "$G", "$#", "$", "$$", "$I", "$TT", "$TT2=T2P2Z4D1.5", "$TT2=", "$X", "$C", "$RST=#",
            "$N", "$110=6000", "$32=1", "$32=0", "$SLP", "$EE",
        ][..]).prop_map(str::to_owned),
        1 => "([GMTFSNPRLXYZIJKQHD](-?[0-9]{1,3}\\.?[0-9]{0,3})){0,5}",
    ]
}
