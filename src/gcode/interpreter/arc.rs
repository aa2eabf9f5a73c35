//! Arcs: from the words of a line to a circle.
//!
//! The circle's centre relative to the start is exact where it is programmed (`I J K`) and rounded
//! to the nanometre where it is computed (`R`). Double precision, once per arc.

use super::{Move, offsets::Frame};
use crate::{
    axis::Axes,
    decimal::Decimal,
    gcode::{ArcDistance, LineError, ParsedLine, Units, Word, Words},
    model::{Circle, Plane, Rotation},
    units::{MM_PER_INCH, MicroDegrees, Nm},
};

/// Differences of the radii at both ends up to this are always accepted, in mm and in inches (LinuxCNC 2.9, measured with
/// its `rs274`; Grbl's 0.005 mm are less).
const RADIUS_TOLERANCE_MM: f32 = 0.028_284;
const RADIUS_TOLERANCE_INCHES: f32 = 0.002_828_4;
/// The same where an end is no farther from the centre than [`RADIUS_SHORTFALL_MM`], for Grbl: LinuxCNC has no arc then.
const ZERO_RADIUS_TOLERANCE_MM: f32 = 0.005;
/// Differences above so many times that are never accepted.
const RADIUS_LIMIT_FACTOR: f32 = 100.0;
/// Differences in between are accepted up to this part of the larger radius.
const RADIUS_PART: f32 = 0.001;
/// Most by which `R` may be shorter than half of the distance, mm (LinuxCNC 2.9, measured).
const RADIUS_SHORTFALL_MM: f64 = 0.001_27;
/// Most by which a diameter may be shorter than the distance, as a part of its square: less than the
/// single precision of Grbl can distinguish.
const DIAMETER_SLACK: f64 = 1.0e-6;

/// Returns the arc from `start` to `target`, in work coordinates where `frame` rotates them; removes
/// the words that belong to it.
///
/// # Errors
/// Grbl's 26 and 32 to 35; 23 and 39 for the number of turns.
#[inline(never)]
pub(super) fn movement(
    parsed: &ParsedLine,
    unused: &mut Words,
    rotation: Rotation,
    frame: &Frame,
    start: Axes<Nm>,
    target: Axes<Nm>,
) -> Result<Move, LineError> {
    let (first, second, _) = parsed.modal.plane.axes();
    let has_offset = [first, second].map(|axis| unused.contains(Word::offset_of(axis)));
    // Without axis words in the plane an arc with a centre is a full circle, as LinuxCNC has it.
    let has_centre = has_offset != [false; 2] && !unused.contains(Word::R);
    if !has_centre && !parsed.has_axis(first) && !parsed.has_axis(second) {
        return Err(if parsed.axes == 0 {
            LineError::NoAxisWords
        } else {
            LineError::NoAxisWordsInPlane
        });
    }
    let chord = [target[first] - start[first], target[second] - start[second]];
    let centre = if unused.contains(Word::R) {
        unused.remove(Word::R);
        centre_from_radius(chord, parsed.length(parsed.radius), rotation)?
    } else {
        let is_absolute = parsed.modal.arc_distance == ArcDistance::Absolute;
        if has_offset == [false; 2] || is_absolute && has_offset != [true; 2] {
            return Err(LineError::NoOffsetsInPlane);
        }
        unused.remove(Word::IJK);
        let centre = [first, second].map(|axis| {
            let offset = parsed.length(offset_word(parsed, axis));
            if is_absolute {
                offset + frame.path_origin(axis) - start[axis]
            } else {
                offset
            }
        });
        check_radii(chord, centre, parsed.modal.units)?;
        if centre == [Nm(0); 2] && !parsed.has_axis(first) && !parsed.has_axis(second) {
            return Err(LineError::InvalidTarget);
        }
        centre
    };
    let turns = turns(parsed, unused)?;
    // Without a radius at its start or end there is no angle: Grbl moves straight to the target.
    if centre == [Nm(0); 2] || centre == chord {
        return Ok(Move::Straight);
    }
    let plane = parsed.modal.plane;
    let (centre, tilt) = match plane {
        Plane::Xy => (frame.rotation.rotate(centre), MicroDegrees::ZERO),
        Plane::Zx | Plane::Yz => (centre, frame.rotation.angle()),
    };
    Ok(Move::Arc(Circle {
        plane,
        centre,
        rotation,
        turns,
        tilt,
    }))
}

/// The `I`, `J` or `K` word of an axis.
fn offset_word(parsed: &ParsedLine, axis: usize) -> Decimal {
    parsed.offsets.get(axis).copied().unwrap_or_default()
}

/// The number of turns begun: the `P` word, 1 without.
fn turns(parsed: &ParsedLine, unused: &mut Words) -> Result<u16, LineError> {
    if !unused.contains(Word::P) {
        return Ok(1);
    }
    unused.remove(Word::P);
    if !parsed.p.is_whole() {
        return Err(LineError::NotInteger);
    }
    match u16::try_from(parsed.p.trunc()) {
        Ok(turns @ 1..) => Ok(turns),
        _ => Err(LineError::ValueOutOfRange),
    }
}

/// The centre of the arc of a given radius, relative to its start.
///
/// Of the two circles through both ends, a positive radius takes the one with the shorter arc.
fn centre_from_radius(
    chord: [Nm; 2],
    radius: Nm,
    rotation: Rotation,
) -> Result<[Nm; 2], LineError> {
    if chord == [Nm(0); 2] {
        return Err(LineError::InvalidTarget);
    }
    let [x, y] = chord.map(Nm::to_mm_f64);
    let r = radius.to_mm_f64();
    let chord_sqr = x * x + y * y;
    let diameter_sqr = 4.0 * r * r;
    let mut remainder = diameter_sqr - chord_sqr;
    if remainder < 0.0 {
        let is_short = 0.5 * libm::sqrt(chord_sqr) - libm::fabs(r) > RADIUS_SHORTFALL_MM;
        if is_short && remainder < -DIAMETER_SLACK * diameter_sqr {
            return Err(LineError::ArcRadius);
        }
        remainder = 0.0;
    }
    // Distance of the centre from the middle of the chord, as a part of the chord's length. The
    // centre of the shorter counter-clockwise arc lies to the left of the chord.
    let part = libm::sqrt(remainder / chord_sqr);
    let to_left = (rotation == Rotation::CounterClockwise) == (radius >= Nm(0));
    let part = if to_left { part } else { -part };
    Ok([
        Nm::from_mm_f64(0.5 * (x - y * part)),
        Nm::from_mm_f64(0.5 * (y + x * part)),
    ])
}

/// Checks that both ends are equally far from the centre, within LinuxCNC's tolerance.
fn check_radii(chord: [Nm; 2], centre: [Nm; 2], units: Units) -> Result<(), LineError> {
    let [x, y] = chord.map(Nm::to_mm_f64);
    let [i, j] = centre.map(Nm::to_mm_f64);
    // Difference of the squared radii without the cancellation of large squares.
    let difference_sqr = x * (x - 2.0 * i) + y * (y - 2.0 * j);
    if difference_sqr == 0.0 {
        return Ok(());
    }
    let radius = libm::hypotf(i as f32, j as f32);
    let end_radius = libm::hypotf((x - i) as f32, (y - j) as f32);
    let difference = (difference_sqr as f32).abs() / (radius + end_radius);
    let tolerance = match units {
        _ if radius.min(end_radius) < RADIUS_SHORTFALL_MM as f32 => ZERO_RADIUS_TOLERANCE_MM,
        Units::Millimetres => RADIUS_TOLERANCE_MM,
        Units::Inches => RADIUS_TOLERANCE_INCHES * MM_PER_INCH,
    };
    let is_accepted = difference <= tolerance
        || difference <= RADIUS_LIMIT_FACTOR * tolerance
            && difference <= RADIUS_PART * radius.max(end_radius);
    if is_accepted {
        Ok(())
    } else {
        Err(LineError::InvalidTarget)
    }
}
