//! Procedural textures: numbers on balls, wood grain, marks on cloth, the parts of a cue, bricks,
//! scoreboards and prints.
//!
//! All are functions of position, so edges are sharp at every distance and antialiased by a pixel's
//! samples. Waves and lines too fine for a pixel are faded by its footprint: the width in m of the
//! surface that a camera ray covers, and 0 for later path segments. Waves are `wave(t) = sin 2πt`;
//! the same formulas are implemented in SIMD and WGSL.

use std::f64::consts::TAU;
#[cfg(feature = "gpu")]
use std::fmt::Write as _;

use glam::DVec3;

use crate::compiled::{MaterialData, PATTERN_PLANKS};

/// Sine of the half angle of the white circle around a ball's number.
pub const CIRCLE_SINE: f32 = 0.37;
/// Albedo of the circle.
pub const CIRCLE_ALBEDO: [f32; 3] = [0.8, 0.78, 0.7];
/// Albedo of the number.
pub const INK_ALBEDO: [f32; 3] = [0.012, 0.012, 0.012];
/// Albedo of the sights (diamonds) in the rails, mother-of-pearl.
pub const SIGHT_ALBEDO: [f32; 3] = [0.78, 0.76, 0.7];
/// Half the length and half the width in m of a sight, a rhombus.
pub const SIGHT_HALF_M: [f32; 2] = [0.0135, 0.0065];
/// Spatial frequencies in m⁻¹ of the rings, fibres and pores of wood of scale 1.
pub const WOOD_TURNS_PER_M: [f32; 3] = [17.0, 151.0, 463.0];
/// Width in m of a floor's planks.
pub const PLANK_M: f32 = 0.13;
/// Width of the gap beside a plank, as a fraction of the plank's width.
pub const PLANK_GAP: f32 = 0.025;

/// Length and height in m of a brick including its joints.
pub const BRICK_M: [f32; 2] = [0.225, 0.075];
/// Width in m of a joint.
pub const JOINT_M: f32 = 0.01;

/// Distance of a dial's numbers from its centre; the dial's radius is 1.
pub const DIAL_NUMBERS_AT: f32 = 0.66;
/// Scale of a dial's numbers: digits are 1.5 times this high.
pub const DIAL_DIGIT: f32 = 0.17;
/// Radius from which the marks at a dial's numbers extend outwards.
pub const DIAL_MARKS_FROM: f32 = 0.84;
/// Half the width of such a mark.
pub const DIAL_MARK_HALF: f32 = 0.025;
/// Distance between the centres of adjacent dials.
pub const DIAL_SPACING: f32 = 2.3;

/// Half the width and height of a print inside its frame; half the height with the frame is 1.
pub const PRINT_PAPER: [f32; 2] = [1.44, 0.94];
/// Half the width and height of the picture inside the mat.
pub const PRINT_VIEW: [f32; 2] = [1.2, 0.7];
/// Centre (x, y) and radius of the print's sun.
pub const PRINT_SUN: [f32; 3] = [0.42, 0.12, 0.24];
/// Albedo of the print's sun.
pub const PRINT_SUN_ALBEDO: [f32; 3] = [0.8, 0.4, 0.14];

/// Albedo of chalk and of the lines on the cloth.
pub const CHALK_ALBEDO: [f32; 3] = [0.5, 0.56, 0.6];
/// Half the width in m of a line on the cloth.
pub const LINE_HALF_M: f32 = 0.0022;
/// Fraction of chalk's colour at the centre of a line; it falls linearly to 0 at its sides.
pub const LINE_SHARE: f32 = 0.6;
/// Radius in m of a spot on the cloth.
pub const SPOT_RADIUS_M: f32 = 0.006;
/// Factor of the cloth's albedo at a spot.
pub const SPOT_SHARE: f32 = 0.12;
/// Maximum fraction of chalk's colour in the worn area around the foot spot, where racks are
/// broken.
pub const WORN_SHARE: f32 = 0.07;
/// Square in m² of the worn area's radius, at which the fraction is half its maximum.
pub const WORN_M2: f32 = 0.0016;
/// Maximum distance in m of marks from the height 0.
pub const MARK_REACH_M: f32 = 0.001;

/// Spatial frequency in m⁻¹ of a cloth's weave, one period per pair of threads.
pub const WEAVE_PER_M: f32 = 1100.0;
/// Amplitude of the weave, relative to the cloth's albedo.
pub const WEAVE_SHARE: f32 = 0.2;
/// Spatial frequency in m⁻¹ by which weave and lint are faded: early enough for a few samples per
/// pixel not to show them as noise.
pub const WEAVE_FADES_PER_M: f32 = 4000.0;
/// Edge length in m of the square cells of cloth, each of which has one fibre of lint.
pub const LINT_SQUARE_M: f32 = 0.04;
/// Half the length and half the width in m of a fibre of lint.
pub const LINT_HALF_M: [f32; 2] = [0.0016, 0.000_1];
/// Fraction of chalk's colour in a fibre of lint.
pub const LINT_SHARE: f32 = 0.25;

/// Ends of the tip, ferrule, shaft, collar, forearm and wrap of a cue, in m from the end of its
/// tip; the rest is the butt.
pub const CUE_ENDS_M: [f32; 6] = [0.008, 0.033, 0.738, 0.75, 1.02, 1.33];
/// Albedo of a cue's chalked tip.
pub const CUE_TIP_ALBEDO: [f32; 3] = [0.06, 0.19, 0.36];
/// Albedo of a cue's ferrule.
pub const CUE_FERRULE_ALBEDO: [f32; 3] = [0.8, 0.78, 0.7];
/// Albedo of a cue's collar.
pub const CUE_COLLAR_ALBEDO: [f32; 3] = [0.62, 0.47, 0.2];
/// Albedo of a cue's linen wrap.
pub const CUE_WRAP_ALBEDO: [f32; 3] = [0.03, 0.032, 0.038];

/// Half the width of a stroke, in the units of [`Stroke`].
const STROKE_HALF: f32 = 0.125;
/// Number of strokes of a digit.
pub const STROKES: usize = 4;

/// A line segment from `a` to `b`; or, if `radius` is above 0, an arc around `a` whose middle is in
/// the direction `b` and whose half angle has the cosine `cos_half` (−1: a full circle). Digits are
/// 0.84 wide and 1.5 high, centred on the origin.
#[derive(Clone, Copy, Debug)]
pub struct Stroke {
    a: [f32; 2],
    b: [f32; 2],
    radius: f32,
    cos_half: f32,
}

const fn line(a: [f32; 2], b: [f32; 2]) -> Stroke {
    Stroke {
        a,
        b,
        radius: 0.0,
        cos_half: 0.0,
    }
}

const fn arc(a: [f32; 2], radius: f32, b: [f32; 2], cos_half: f32) -> Stroke {
    Stroke {
        a,
        b,
        radius,
        cos_half,
    }
}

/// An unused stroke, far from every point of a number.
const NOTHING: Stroke = line([9.0, 9.0], [9.0, 9.0]);

/// The strokes of the digits 0 to 9.
pub const DIGITS: [[Stroke; STROKES]; 10] = [
    [
        arc([0.0, 0.33], 0.37, [0.0, 1.0], 0.0),
        arc([0.0, -0.33], 0.37, [0.0, -1.0], 0.0),
        line([-0.37, -0.33], [-0.37, 0.33]),
        line([0.37, -0.33], [0.37, 0.33]),
    ],
    [
        line([0.08, -0.7], [0.08, 0.7]),
        line([0.08, 0.7], [-0.22, 0.45]),
        NOTHING,
        NOTHING,
    ],
    [
        // From 195° over the top to −35°.
        arc([0.0, 0.34], 0.36, [0.173_648, 0.984_808], -0.422_618),
        line([0.295, 0.134], [-0.36, -0.7]),
        line([-0.36, -0.7], [0.4, -0.7]),
        NOTHING,
    ],
    [
        // From 155° to −90°, and from 90° to −155°.
        arc([-0.02, 0.36], 0.34, [0.843_391, 0.537_3], -0.537_3),
        arc([-0.02, -0.34], 0.37, [0.843_391, -0.537_3], -0.537_3),
        NOTHING,
        NOTHING,
    ],
    [
        line([0.17, -0.7], [0.17, 0.7]),
        line([0.17, 0.7], [-0.42, -0.3]),
        line([-0.42, -0.3], [0.42, -0.3]),
        NOTHING,
    ],
    [
        line([0.34, 0.7], [-0.27, 0.7]),
        line([-0.27, 0.7], [-0.34, 0.04]),
        // From 140° to −140°.
        arc([-0.02, -0.28], 0.42, [1.0, 0.0], -0.766_044),
        NOTHING,
    ],
    [
        arc([0.0, -0.31], 0.39, [1.0, 0.0], -1.0),
        line([-0.36, -0.16], [0.16, 0.7]),
        line([-0.32, -0.97], [0.32, -0.97]),
        NOTHING,
    ],
    [
        line([-0.38, 0.7], [0.38, 0.7]),
        line([0.38, 0.7], [-0.1, -0.7]),
        NOTHING,
        NOTHING,
    ],
    [
        arc([0.0, 0.37], 0.32, [1.0, 0.0], -1.0),
        arc([0.0, -0.33], 0.38, [1.0, 0.0], -1.0),
        NOTHING,
        NOTHING,
    ],
    [
        arc([0.0, 0.31], 0.39, [1.0, 0.0], -1.0),
        line([0.36, 0.16], [-0.16, -0.7]),
        line([-0.32, -0.97], [0.32, -0.97]),
        NOTHING,
    ],
];

impl Stroke {
    /// Distance of a point from the stroke's centre line.
    fn distance(&self, x: f32, y: f32) -> f32 {
        let (px, py) = (x - self.a[0], y - self.a[1]);
        if self.radius > 0.0 {
            let length = (px * px + py * py).sqrt();
            let along = px * self.b[0] + py * self.b[1];
            let beyond = if along >= self.cos_half * length {
                0.0
            } else {
                9.0
            };
            return (length - self.radius).abs() + beyond;
        }
        let (ex, ey) = (self.b[0] - self.a[0], self.b[1] - self.a[1]);
        let share = (px * ex + py * ey) / (ex * ex + ey * ey).max(1e-9);
        let share = share.clamp(0.0, 1.0);
        let (dx, dy) = (px - share * ex, py - share * ey);
        (dx * dx + dy * dy).sqrt()
    }
}

/// Scale of the digits of a number of one digit, and of two, in a circle of radius 1.
pub const DIGIT_SCALE: [f32; 2] = [0.66, 0.52];
/// Distance of each of two digits from the circle's centre, in the units of [`Stroke`].
pub const DIGIT_SHIFT: f32 = 0.56;

/// Whether a number from 0 to 99 has ink at a point of its circle, whose radius is 1; y points up.
pub fn is_ink(number: u32, x: f32, y: f32) -> bool {
    if number < 10 {
        return is_digit(number, x / DIGIT_SCALE[0], y / DIGIT_SCALE[0]);
    }
    let (x, y) = (x / DIGIT_SCALE[1], y / DIGIT_SCALE[1]);
    is_digit(number / 10, x + DIGIT_SHIFT, y) || is_digit(number % 10, x - DIGIT_SHIFT, y)
}

fn is_digit(digit: u32, x: f32, y: f32) -> bool {
    let strokes = &DIGITS[digit as usize % 10];
    strokes
        .iter()
        .any(|stroke| stroke.distance(x, y) < STROKE_HALF)
}

/// Whether a scoreboard has ink at a point, in units of its dials' radius; y points up.
pub fn is_scoreboard_ink(x: f32, y: f32) -> bool {
    let dial = (x / DIAL_SPACING + 0.5).floor().clamp(-1.0, 1.0);
    let numbers: u32 = if dial == 0.0 { 12 } else { 10 };
    let x = x - DIAL_SPACING * dial;
    let from_middle = (x * x + y * y).sqrt();
    if from_middle > 1.0 {
        return true;
    }
    // Clockwise from the top, as on a clock; the added turn keeps the value positive.
    let turns = x.atan2(y) / std::f32::consts::TAU + 1.0;
    let nearest = (turns * numbers as f32 + 0.5) as u32 % numbers;
    let (sin, cos) = (std::f32::consts::TAU * nearest as f32 / numbers as f32).sin_cos();
    if from_middle > DIAL_MARKS_FROM {
        return (x * cos - y * sin).abs() < DIAL_MARK_HALF;
    }
    let number = if nearest == 0 && numbers == 12 {
        12
    } else {
        nearest
    };
    let (x, y) = (x - DIAL_NUMBERS_AT * sin, y - DIAL_NUMBERS_AT * cos);
    is_ink(number, x / DIAL_DIGIT, y / DIAL_DIGIT)
}

/// Coordinates of a ball's point (as the unit vector `n` from its centre) in the circles around
/// ±`axis`, which have radius 1 and are upright along `up`.
pub fn in_circle(n: DVec3, axis: DVec3, up: DVec3) -> [f32; 2] {
    // Mirrored on the far side, so that the number is legible on both.
    let side = n.dot(axis);
    let (across, along) = (n.dot(up.cross(axis)) * side.signum(), n.dot(up));
    [across as f32 / CIRCLE_SINE, along as f32 / CIRCLE_SINE]
}

/// Albedo of a numbered ball at the unit vector `n` from its centre, `base` outside the circles,
/// which are centred on ±`axis` and upright along `up`.
pub fn numbered(number: u32, n: DVec3, axis: DVec3, up: DVec3, base: DVec3) -> DVec3 {
    let [x, y] = in_circle(n, axis, up);
    if x * x + y * y >= 1.0 {
        return base;
    }
    let albedo = if is_ink(number, x, y) {
        INK_ALBEDO
    } else {
        CIRCLE_ALBEDO
    };
    DVec3::from(albedo.map(f64::from))
}

/// Coefficients of `t`, `t³`, `t⁵` and `t⁷` of a polynomial for `sin 2πt`, for `t` from 0 to ¼; its
/// error in f32 is below 8e-7.
pub(crate) const SINE_OF_TURNS: [f32; 4] = [6.283_164, -41.337_143, 81.340_8, -70.993_744];

fn wave(turns: f64) -> f64 {
    (TAU * turns).sin()
}

/// The factor by which averaging over a footprint reduces a wave of this spatial frequency:
/// approximately `sin πx / πx`, with x the number of periods in the footprint.
fn faded(turns_per_m: f32, footprint_m: f64) -> f64 {
    let turns = (f64::from(turns_per_m) * footprint_m).min(1.0);
    // Exact at 0 and at 1, the first zero of the sinc; the sinc's small lobes beyond are cut off.
    (1.0 - turns * turns) * (1.0 - turns * turns)
}

/// Coverage of a line at a distance from its centre, falling linearly to 0 at both sides. The
/// footprint widens the line and reduces its coverage in proportion, so that the line's total stays
/// the same.
fn line_share(distance_m: f64, half_m: f32, footprint_m: f64) -> f64 {
    let half = f64::from(half_m) + 0.5 * footprint_m;
    f64::from(half_m) / half * (1.0 - distance_m / half).max(0.0)
}

/// Albedo of wood at a point in world space.
pub fn wood(material: &MaterialData, p: DVec3, footprint_m: f64) -> DVec3 {
    let triple = |v: [f32; 3]| DVec3::from(v.map(f64::from));
    let [spacing, line_x, line_y] = material.sights.map(f64::from);
    let mut axis = material.grain_axis;
    if line_x > 0.0 {
        // Four rails with mitred corners: the grain runs along the nearer one.
        let is_end = p.x.abs() - line_x > p.y.abs() - line_y;
        axis = u32::from(is_end);
        let (along, off, line) = if is_end {
            (p.y, p.x, line_x)
        } else {
            (p.x, p.y, line_y)
        };
        let sights = if is_end { 1.5 } else { 3.5 };
        let nearest = (along / spacing).round();
        let is_sight =
            spacing > 0.0 && nearest.abs() < sights && (is_end || nearest != 0.0) && p.z > 0.0;
        let [long, wide] = SIGHT_HALF_M.map(f64::from);
        // A rhombus: |x| / a + |y| / b < 1.
        let inside = (along - nearest * spacing).abs() / long + (off.abs() - line).abs() / wide;
        if is_sight && inside < 1.0 {
            return triple(SIGHT_ALBEDO);
        }
    }
    let p = p * f64::from(material.scale);
    let faded = |turns| faded(turns, footprint_m * f64::from(material.scale));
    let [of_ring, of_fibre, of_pore] = WOOD_TURNS_PER_M.map(faded);
    let (mut a, b) = match axis {
        0 => (p.x, p.y),
        1 => (p.y, p.x),
        _ => (p.z, p.x + p.y),
    };
    let (mut tone, height) = (0.0, if axis == 2 { 0.0 } else { p.z });
    if material.pattern == PATTERN_PLANKS {
        let plank = (b / f64::from(PLANK_M)).floor();
        if b / f64::from(PLANK_M) - plank < f64::from(PLANK_GAP) {
            return 0.3 * triple(material.stripe_albedo);
        }
        // Multiples of the golden ratio's fraction are equidistributed, so tones vary without a
        // period in any run of planks.
        tone = 0.28 * wave(0.381_966 * plank);
        // Each plank is cut from a different place in the tree.
        a += 1.7 * plank;
    }
    // `bend` distorts the rings as a tree's growth does; all three waves run nearly parallel to the
    // grain.
    let bend = 0.45 * wave(0.61 * a + 0.2) + 0.2 * wave(1.7 * a + 2.3 * b);
    let ring = wave(17.0 * b + 11.0 * height + bend);
    let fibre = wave(151.0 * b + 83.0 * height + 0.8 * wave(1.3 * a + 3.1 * b) + 2.0 * a);
    let pore = wave(463.0 * b + 211.0 * height + 1.1 * wave(4.1 * a));
    let grain = 0.27 * of_ring * ring + 0.14 * of_fibre * fibre + 0.09 * of_pore * pore;
    let dark = (0.45 + grain + tone).clamp(0.0, 1.0);
    triple(material.albedo).lerp(triple(material.stripe_albedo), dark)
}

/// Albedo of a brick wall at a point in world space.
pub fn bricks(material: &MaterialData, p: DVec3) -> DVec3 {
    let triple = |v: [f32; 3]| DVec3::from(v.map(f64::from));
    let [length, height] = BRICK_M.map(f64::from);
    let course = (p.z / height).floor();
    // Running bond: each course is shifted by half a brick. One of x and y is constant on a wall.
    let along = (p.x + p.y) / length + 0.5 * course;
    let brick = along.floor();
    let joint = f64::from(JOINT_M);
    if (along - brick) * length < joint || p.z - course * height < joint {
        return triple(material.sights);
    }
    // Tones of neighbouring bricks are hashed, as the sum of two waves would repeat along rows,
    // visible from afar as stripes.
    // Golden ratio and 1 / plastic number, its analogue in two dimensions: multiples of both are
    // equidistributed.
    let kiln = [
        wave(0.381_966 * brick + 0.271 * course),
        wave(0.754_878 * course - 0.137 * brick),
    ];
    let fired = 0.5 + 0.5 * wave(5.3 * kiln[0] + 7.7 * kiln[1]);
    let speckle = wave(31.0 * p.z + 1.3 * fired) * wave(17.0 * (p.x + p.y) + fired);
    let dark = (fired + 0.12 * speckle).clamp(0.0, 1.0);
    triple(material.albedo).lerp(triple(material.stripe_albedo), dark)
}

/// Albedo of a scoreboard at a point in world space.
pub fn scoreboard(material: &MaterialData, p: DVec3) -> DVec3 {
    let [y, z, radius] = material.sights.map(f64::from);
    let (across, up) = ((y - p.y) / radius, (p.z - z) / radius);
    let albedo = if is_scoreboard_ink(across as f32, up as f32) {
        material.stripe_albedo
    } else {
        material.albedo
    };
    DVec3::from(albedo.map(f64::from))
}

/// Albedo of a framed print at a point in world space.
pub fn print(material: &MaterialData, p: DVec3) -> DVec3 {
    let triple = |v: [f32; 3]| DVec3::from(v.map(f64::from));
    let q = (p - triple(material.sights)) * f64::from(material.scale);
    // One of x and y is constant on a wall along an axis, so their sum is the coordinate along the
    // wall.
    let (x, y) = (q.x + q.y, q.z);
    let is_beyond = |[half_x, half_y]: [f32; 2]| x.abs() > half_x.into() || y.abs() > half_y.into();
    if is_beyond(PRINT_PAPER) {
        return triple(INK_ALBEDO);
    }
    if is_beyond(PRINT_VIEW) {
        return triple(CIRCLE_ALBEDO);
    }
    // From near to far: the first mountain range that covers the point hides those behind it.
    for range in [3.0, 2.0, 1.0] {
        let ridge = 0.09 * wave((0.17 + 0.13 * range) * x + 0.37 * range)
            + 0.035 * wave((0.9 + 0.4 * range) * x + 0.61 * range);
        if y < 0.33 - 0.25 * range + ridge {
            return triple(material.albedo).lerp(triple(material.stripe_albedo), range / 3.0);
        }
    }
    let [sun_x, sun_y, radius] = PRINT_SUN.map(f64::from);
    let (aside, above) = (x - sun_x, y - sun_y);
    if aside * aside + above * above < radius * radius {
        triple(PRINT_SUN_ALBEDO)
    } else {
        triple(material.albedo)
    }
}

/// Albedo of a cue at a distance in m from the end of its tip.
pub fn cue(material: &MaterialData, from_tip_m: f64) -> DVec3 {
    let part = CUE_ENDS_M
        .iter()
        .filter(|end| from_tip_m >= f64::from(**end));
    let albedo = match part.count() {
        0 => CUE_TIP_ALBEDO,
        1 => CUE_FERRULE_ALBEDO,
        2 => material.albedo,
        3 => CUE_COLLAR_ALBEDO,
        5 => CUE_WRAP_ALBEDO,
        _ => material.stripe_albedo,
    };
    DVec3::from(albedo.map(f64::from))
}

/// Albedo of cloth at a point in world space: worn patches, nap, a table's marks, and, near the
/// camera, weave and lint.
pub fn cloth(material: &MaterialData, p: DVec3, footprint_m: f64) -> DVec3 {
    let triple = |v: [f32; 3]| DVec3::from(v.map(f64::from));
    let most = f64::from(material.scale);
    // Both coordinates depend on z too, so that vertical cloth has a pattern as well.
    let (u, v) = (p.x + 0.3 * p.z, p.y + 0.8 * p.z);
    let (bend, sway) = (wave(2.3 * u + 1.1 * v), wave(0.9 * u - 2.1 * v));
    let nap = wave(37.0 * v + 3.0 * bend) * wave(23.0 * u + 2.0 * sway);
    let shade = 1.0 + 0.05 * bend * sway + 0.015 * nap;
    let chalk = triple(CHALK_ALBEDO) * most;
    let mut colour = shade * triple(material.albedo);
    let of_weave = faded(WEAVE_FADES_PER_M, footprint_m);
    if footprint_m > 0.0 && of_weave > 0.0 {
        colour *= 1.0 + f64::from(WEAVE_SHARE) * of_weave * weave(u, v);
        let of_lint = f64::from(LINT_SHARE) * of_weave * lint(u, v, footprint_m);
        colour = colour.lerp(chalk, of_lint);
    }
    if p.z.abs() < f64::from(MARK_REACH_M) {
        let [line_x, d_radius, _] = material.sights.map(f64::from);
        let spots = triple(material.stripe_albedo);
        let from_foot = ((p.x - spots.x) * (p.x - spots.x) + p.y * p.y) / f64::from(WORN_M2);
        colour = colour.lerp(chalk, f64::from(WORN_SHARE) / (1.0 + from_foot));
        let from_line = p.x + line_x;
        let from_arc = (from_line * from_line + p.y * p.y).sqrt() - d_radius;
        let mut aside = f64::INFINITY;
        if line_x > 0.0 {
            aside = from_line.abs();
        }
        if d_radius > 0.0 && from_line < 0.0 {
            aside = aside.min(from_arc.abs());
        }
        let share = f64::from(LINE_SHARE) * line_share(aside, LINE_HALF_M, footprint_m);
        colour = colour.lerp(chalk, share);
        let from_spot = |x: f64, y: f64| (p.x - x) * (p.x - x) + (p.y.abs() - y) * (p.y.abs() - y);
        let on_axis = spots.map(|x| from_spot(x, 0.0)).min_element();
        let on_line = from_spot(-line_x, 0.0).min(from_spot(-line_x, d_radius));
        let nearest = on_axis.min(if line_x > 0.0 { on_line } else { on_axis });
        if nearest < f64::from(SPOT_RADIUS_M * SPOT_RADIUS_M) {
            colour *= f64::from(SPOT_SHARE);
        }
    }
    colour.min(DVec3::splat(most))
}

/// Pattern of warp and weft threads of varying thickness, in [−1, 1].
fn weave(u: f64, v: f64) -> f64 {
    let threads = f64::from(WEAVE_PER_M);
    let (warp, weft) = (wave(61.0 * v + 13.0 * u), wave(53.0 * u - 17.0 * v));
    let over = wave(threads * u + 0.3 * warp) * wave(threads * v + 0.3 * weft);
    over * (0.75 + 0.25 * warp * weft)
}

/// Coverage of lint: one fibre of pseudo-random position and direction in each square cell of the
/// cloth.
fn lint(u: f64, v: f64, footprint_m: f64) -> f64 {
    let square = f64::from(LINT_SQUARE_M);
    let (i, j) = ((u / square).floor(), (v / square).floor());
    // Hashes of the cell's indices, for offset and direction of its fibre.
    let a = wave(0.381_966 * i + 0.271_828 * j);
    let b = wave(0.754_878 * j - 0.137_035 * i);
    let x = u - (i + 0.5 + 0.4 * a) * square;
    let y = v - (j + 0.5 + 0.4 * b) * square;
    let turns = 2.3 * a + 3.7 * b;
    let (sin, cos) = (wave(turns), wave(turns + 0.25));
    let (along, across) = ((x * cos + y * sin).abs(), (x * sin - y * cos).abs());
    let [half_length, half_width] = LINT_HALF_M;
    line_share(along, half_length, footprint_m) * line_share(across, half_width, footprint_m)
}

/// WGSL constants of cloth.
#[cfg(feature = "gpu")]
fn cloth_wgsl() -> String {
    let ([x, y, z], [length, width]) = (CHALK_ALBEDO, LINT_HALF_M);
    format!(
        "const CHALK_ALBEDO: vec3f = vec3f({x:?}, {y:?}, {z:?});\n\
         const LINT_HALF_M: vec2f = vec2f({length:?}, {width:?});\n\
         const WEAVE_PER_M: f32 = {WEAVE_PER_M:?};\n\
         const WEAVE_SHARE: f32 = {WEAVE_SHARE:?};\n\
         const WEAVE_FADES_PER_M: f32 = {WEAVE_FADES_PER_M:?};\n\
         const LINT_SQUARE_M: f32 = {LINT_SQUARE_M:?};\n\
         const LINT_SHARE: f32 = {LINT_SHARE:?};\n\
         const LINE_HALF_M: f32 = {LINE_HALF_M:?};\n\
         const LINE_SHARE: f32 = {LINE_SHARE:?};\n\
         const SPOT_RADIUS_M: f32 = {SPOT_RADIUS_M:?};\n\
         const SPOT_SHARE: f32 = {SPOT_SHARE:?};\n\
         const MARK_REACH_M: f32 = {MARK_REACH_M:?};\n\
         const WORN_SHARE: f32 = {WORN_SHARE:?};\n\
         const WORN_M2: f32 = {WORN_M2:?};\n"
    )
}

/// WGSL constants of prints.
#[cfg(feature = "gpu")]
fn print_wgsl() -> String {
    let numbers = |v: &[f32]| {
        v.iter()
            .map(|c| format!("{c:?}"))
            .collect::<Vec<_>>()
            .join(", ")
    };
    format!(
        "const PRINT_PAPER: vec2f = vec2f({});\n\
         const PRINT_VIEW: vec2f = vec2f({});\n\
         const PRINT_SUN: vec3f = vec3f({});\n\
         const PRINT_SUN_ALBEDO: vec3f = vec3f({});\n",
        numbers(&PRINT_PAPER),
        numbers(&PRINT_VIEW),
        numbers(&PRINT_SUN),
        numbers(&PRINT_SUN_ALBEDO),
    )
}

/// WGSL constants of all textures.
#[cfg(feature = "gpu")]
pub(crate) fn wgsl() -> String {
    let triple = |v: [f32; 3]| format!("vec3f({:?}, {:?}, {:?})", v[0], v[1], v[2]);
    let mut text = cloth_wgsl() + &print_wgsl();
    _ = write!(
        text,
        "const CIRCLE_SINE: f32 = {CIRCLE_SINE:?};\n\
         const CIRCLE_ALBEDO: vec3f = {};\n\
         const INK_ALBEDO: vec3f = {};\n\
         const SIGHT_ALBEDO: vec3f = {};\n\
         const SIGHT_HALF_M: vec2f = vec2f({:?}, {:?});\n\
         const WOOD_TURNS_PER_M: vec3f = {};\n\
         const PLANK_M: f32 = {PLANK_M:?};\n\
         const PLANK_GAP: f32 = {PLANK_GAP:?};\n\
         const SINE_OF_TURNS: vec4f = vec4f({});\n\
         const BRICK_M: vec2f = vec2f({});\n\
         const JOINT_M: f32 = {JOINT_M:?};\n\
         const DIAL_NUMBERS_AT: f32 = {DIAL_NUMBERS_AT:?};\n\
         const DIAL_DIGIT: f32 = {DIAL_DIGIT:?};\n\
         const DIAL_MARKS_FROM: f32 = {DIAL_MARKS_FROM:?};\n\
         const DIAL_MARK_HALF: f32 = {DIAL_MARK_HALF:?};\n\
         const DIAL_SPACING: f32 = {DIAL_SPACING:?};\n\
         const CUE_ENDS_M = array<f32, {}>({});\n\
         const CUE_TIP_ALBEDO: vec3f = {};\n\
         const CUE_FERRULE_ALBEDO: vec3f = {};\n\
         const CUE_COLLAR_ALBEDO: vec3f = {};\n\
         const CUE_WRAP_ALBEDO: vec3f = {};\n\
         const STROKE_HALF: f32 = {STROKE_HALF:?};\n\
         const STROKES: u32 = {STROKES}u;\n\
         const DIGIT_SCALE: vec2f = vec2f({:?}, {:?});\n\
         const DIGIT_SHIFT: f32 = {DIGIT_SHIFT:?};\n",
        triple(CIRCLE_ALBEDO),
        triple(INK_ALBEDO),
        triple(SIGHT_ALBEDO),
        SIGHT_HALF_M[0],
        SIGHT_HALF_M[1],
        triple(WOOD_TURNS_PER_M),
        SINE_OF_TURNS.map(|c| format!("{c:?}")).join(", "),
        BRICK_M.map(|c| format!("{c:?}")).join(", "),
        CUE_ENDS_M.len(),
        CUE_ENDS_M.map(|end| format!("{end:?}")).join(", "),
        triple(CUE_TIP_ALBEDO),
        triple(CUE_FERRULE_ALBEDO),
        triple(CUE_COLLAR_ALBEDO),
        triple(CUE_WRAP_ALBEDO),
        DIGIT_SCALE[0],
        DIGIT_SCALE[1],
    );
    let strokes = || DIGITS.iter().flatten();
    _ = write!(
        text,
        "const STROKE_ENDS = array<vec4f, {}>(",
        strokes().count()
    );
    for stroke in strokes() {
        let ([ax, ay], [bx, by]) = (stroke.a, stroke.b);
        _ = write!(text, "vec4f({ax:?}, {ay:?}, {bx:?}, {by:?}), ");
    }
    _ = write!(
        text,
        ");\nconst STROKE_ARCS = array<vec2f, {}>(",
        strokes().count()
    );
    for stroke in strokes() {
        _ = write!(text, "vec2f({:?}, {:?}), ", stroke.radius, stroke.cos_half);
    }
    text + ");\n"
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Fraction of the circle covered by a number's ink, and its extent.
    fn coverage(number: u32) -> (f32, f32) {
        let (mut inked, mut reach) = (0, 0.0f32);
        for i in 0..200 * 200 {
            let (x, y) = (
                (i % 200) as f32 / 100.0 - 0.995,
                (i / 200) as f32 / 100.0 - 0.995,
            );
            if is_ink(number, x, y) {
                inked += 1;
                reach = reach.max((x * x + y * y).sqrt());
            }
        }
        (
            inked as f32 / (200.0 * 200.0 * std::f32::consts::FRAC_PI_4),
            reach,
        )
    }

    #[test]
    fn the_sine_of_turns_is_right_to_8e_7() {
        let [c1, c3, c5, c7] = SINE_OF_TURNS;
        for step in 0..=10_000_u16 {
            let t = f32::from(step) / 40_000.0;
            let t2 = t * t;
            let sine = t * (c1 + t2 * (c3 + t2 * (c5 + t2 * c7)));
            let error = f64::from(sine) - wave(f64::from(t));
            assert!(error.abs() < 8e-7, "{t}: {error}");
        }
    }

    #[test]
    fn numbers_fill_their_circles_and_stay_inside() {
        for number in 1..=15 {
            let (share, reach) = coverage(number);
            assert!((0.06..0.45).contains(&share), "{number} covers {share}");
            assert!((0.4..0.99).contains(&reach), "{number} reaches to {reach}");
        }
    }

    #[test]
    fn no_two_numbers_look_alike() {
        let look = |number: u32| -> Vec<bool> {
            (0..40 * 40)
                .map(|i| {
                    is_ink(
                        number,
                        (i % 40) as f32 / 20.0 - 1.0,
                        (i / 40) as f32 / 20.0 - 1.0,
                    )
                })
                .collect()
        };
        for a in 1..=15u32 {
            for b in a + 1..=15 {
                let (a_look, b_look) = (look(a), look(b));
                let different = a_look.iter().zip(&b_look).filter(|(a, b)| a != b).count();
                assert!(different > 25, "{a} and {b} differ in {different} places");
            }
        }
    }

    #[test]
    fn both_circles_of_a_ball_read_from_left_to_right() {
        let base = DVec3::ZERO;
        let ink = DVec3::from(INK_ALBEDO.map(f64::from));
        // The 7 has a bar at its top and its foot left of the middle.
        for axis in [DVec3::X, DVec3::NEG_X] {
            let right = DVec3::Z.cross(axis);
            let at = |x: f64, y: f64| {
                let n = axis + 0.37 * 0.66 * (x * right + y * DVec3::Z);
                numbered(7, n.normalize(), DVec3::X, DVec3::Z, base)
            };
            assert_eq!((at(-0.3, 0.75), at(0.3, 0.75)), (ink, ink));
            assert_eq!(at(-0.08, -0.68), ink);
            assert_ne!(at(0.25, -0.68), ink);
        }
    }

    #[test]
    fn a_wall_has_the_mortar_that_its_joints_take() {
        let material = MaterialData {
            albedo: [0.4; 3],
            stripe_albedo: [0.1; 3],
            sights: [0.9; 3],
            ..bytemuck::Zeroable::zeroed()
        };
        let count = 600;
        let at = |i: i32| 3.0 * f64::from(i) / f64::from(count) - 1.5;
        let mortar = (0..count * count).filter(|i| {
            let albedo = bricks(&material, DVec3::new(at(i % count), 7.0, at(i / count))).x;
            assert!(albedo > 0.89 || (0.09..0.41).contains(&albedo), "{albedo}");
            albedo > 0.89
        });
        let share = mortar.count() as f32 / (count * count) as f32;
        let [length, height] = BRICK_M;
        let wanted = 1.0 - (1.0 - JOINT_M / length) * (1.0 - JOINT_M / height);
        assert!((share - wanted).abs() < 0.01, "{share} {wanted}");
    }

    #[test]
    fn a_scoreboard_has_its_numbers_where_a_clock_has_them() {
        let is_number = |dial: f32, number: u32, place: f32, of: f32| {
            let (sin, cos) = (std::f32::consts::TAU * place / of).sin_cos();
            (0..40 * 40).all(|i| {
                let (x, y) = (
                    (i % 40) as f32 / 20.0 - 0.975,
                    (i / 40) as f32 / 20.0 - 0.975,
                );
                let (across, up) = (0.13 * x, 0.13 * y);
                let is_found = is_scoreboard_ink(
                    dial * DIAL_SPACING + DIAL_NUMBERS_AT * sin + across,
                    DIAL_NUMBERS_AT * cos + up,
                );
                is_found == is_ink(number, across / DIAL_DIGIT, up / DIAL_DIGIT)
            })
        };
        assert!((1..=12).all(|hour| is_number(0.0, hour, hour as f32, 12.0)));
        for dial in [-1.0, 1.0] {
            assert!((0..10).all(|number| is_number(dial, number, number as f32, 10.0)));
        }
        assert!(!is_number(0.0, 3, 9.0, 12.0));
        assert!(is_scoreboard_ink(0.5 * DIAL_SPACING, 0.3) && !is_scoreboard_ink(0.1, 0.1));
    }
}
