//! Procedural textures, one surface point per lane: the formulas of [`crate::texture`].

use fearless_simd::prelude::*;

use super::lanes::{Float, LANES, Mask, Vec3x, Word};
use super::rows::Rows;
use crate::compiled::{
    MaterialData, PATTERN_BRICKS, PATTERN_CLOTH, PATTERN_CUE, PATTERN_NONE, PATTERN_NUMBER,
    PATTERN_PLANKS, PATTERN_PRINT, PATTERN_SCOREBOARD, PATTERN_WOOD,
};
use crate::texture::{
    BRICK_M, CHALK_ALBEDO, CIRCLE_ALBEDO, CIRCLE_SINE, CUE_COLLAR_ALBEDO, CUE_ENDS_M,
    CUE_FERRULE_ALBEDO, CUE_TIP_ALBEDO, CUE_WRAP_ALBEDO, INK_ALBEDO, JOINT_M, LINE_HALF_M,
    LINE_SHARE, LINT_HALF_M, LINT_SHARE, LINT_SQUARE_M, MARK_REACH_M, PLANK_GAP, PLANK_M,
    PRINT_PAPER, PRINT_SUN, PRINT_SUN_ALBEDO, PRINT_VIEW, SIGHT_ALBEDO, SIGHT_HALF_M,
    SINE_OF_TURNS, SPOT_RADIUS_M, SPOT_SHARE, WEAVE_FADES_PER_M, WEAVE_PER_M, WEAVE_SHARE,
    WOOD_TURNS_PER_M, WORN_M2, WORN_SHARE, is_ink, is_scoreboard_ink,
};

/// One row per primitive that scatters, in the order of ids.
pub(super) type TextureRow = [f32; 16];

const PATTERN: usize = 0;
const NUMBER: usize = 1;
const GRAIN_AXIS: usize = 2;
const SIGHTS: usize = 3;
const DARK: usize = 6;
/// Axis of a ball's number, or of a cue.
const AXIS: usize = 9;
/// Local z axis of a ball; for a cue the coordinate of the tip's end along its axis, in all three numbers.
const UP: usize = 12;
const SCALE: usize = 15;

/// Row of a material. `axes` are [`AXIS`] and [`UP`], which balls and the sides of truncated cones have.
pub(super) fn texture_row(
    material: &MaterialData,
    axes: Option<([f32; 3], [f32; 3])>,
) -> TextureRow {
    let mut row = [0.0; 16];
    row[PATTERN] = match (material.pattern, axes) {
        (PATTERN_NUMBER, None) => PATTERN_NONE,
        (pattern, _) => pattern,
    } as f32;
    // Cue surfaces other than the sides of cones count as its butt, infinitely far from the tip.
    let (axis, up) = axes.unwrap_or(([0.0; 3], [-f32::MAX; 3]));
    row[NUMBER] = material.number as f32;
    row[GRAIN_AXIS] = material.grain_axis as f32;
    row[SIGHTS..][..3].copy_from_slice(&material.sights);
    row[DARK..][..3].copy_from_slice(&material.stripe_albedo);
    row[AXIS..][..3].copy_from_slice(&axis);
    row[UP..][..3].copy_from_slice(&up);
    row[SCALE] = material.scale;
    row
}

/// Albedo with the texture applied, for a footprint of `footprint_m` metres. `normal` points out of balls.
#[inline(always)]
pub(super) fn textured<S: Simd>(
    simd: S,
    table: &[TextureRow],
    id: Word<S>,
    [position, normal]: [Vec3x<S>; 2],
    footprint_m: Float<S>,
    albedo: Vec3x<S>,
) -> Vec3x<S> {
    let rows = Rows::new(table, id);
    let pattern = rows.number(simd, PATTERN);
    if pattern.simd_eq(PATTERN_NONE as f32).all_true() {
        return albedo;
    }
    let mut textured = albedo;
    let numbered_lanes = pattern.simd_eq(PATTERN_NUMBER as f32);
    if numbered_lanes.any_true() {
        textured = numbered(simd, &rows, numbered_lanes, normal, textured);
    }
    let planks = pattern.simd_eq(PATTERN_PLANKS as f32);
    let wooden = planks | pattern.simd_eq(PATTERN_WOOD as f32);
    if wooden.any_true() {
        let wood = wood(simd, &rows, planks, [position, albedo], footprint_m);
        textured = Vec3x::select(wooden, wood, textured);
    }
    let cues = pattern.simd_eq(PATTERN_CUE as f32);
    if cues.any_true() {
        let cue = cue(simd, &rows, position, albedo);
        textured = Vec3x::select(cues, cue, textured);
    }
    let bricked = pattern.simd_eq(PATTERN_BRICKS as f32);
    if bricked.any_true() {
        let bricks = bricks(simd, &rows, position, albedo);
        textured = Vec3x::select(bricked, bricks, textured);
    }
    let scoreboards = pattern.simd_eq(PATTERN_SCOREBOARD as f32);
    if scoreboards.any_true() {
        let ink = scoreboard_ink(simd, &rows, scoreboards, position);
        textured = Vec3x::select(ink, rows.triple(simd, DARK), textured);
    }
    let printed = pattern.simd_eq(PATTERN_PRINT as f32);
    if printed.any_true() {
        let print = print(simd, &rows, position, albedo);
        textured = Vec3x::select(printed, print, textured);
    }
    let woven = pattern.simd_eq(PATTERN_CLOTH as f32);
    if woven.any_true() {
        let cloth = cloth(simd, &rows, [position, albedo], footprint_m);
        textured = Vec3x::select(woven, cloth, textured);
    }
    textured
}

/// Lanes whose ball is hit on the disc with its number, at the direction `n` from its centre.
#[inline(always)]
pub(super) fn are_on_discs<S: Simd>(
    simd: S,
    table: &[TextureRow],
    id: Word<S>,
    n: Vec3x<S>,
) -> Mask<S> {
    let rows = Rows::new(table, id);
    let numbered_lanes = rows.number(simd, PATTERN).simd_eq(PATTERN_NUMBER as f32);
    let (x, y) = in_circle(simd, &rows, n);
    numbered_lanes & x.mul_add(x, y * y).simd_lt(1.0)
}

/// Coordinates of directions from balls' centres in the circles of their numbers, of radius 1.
#[inline(always)]
fn in_circle<S: Simd>(simd: S, rows: &Rows<'_, 16>, n: Vec3x<S>) -> (Float<S>, Float<S>) {
    let (axis, up) = (rows.triple(simd, AXIS), rows.triple(simd, UP));
    let one = Float::splat(simd, 1.0);
    // A ball has its number on two opposite sides; the sign makes both readable.
    let side = one.copysign(n.dot(axis));
    let x = n.dot(up.cross(axis)) * side * (1.0 / CIRCLE_SINE);
    (x, n.dot(up) * (1.0 / CIRCLE_SINE))
}

/// Draws ball numbers. The few lanes within a circle are looked up one by one.
#[inline(always)]
fn numbered<S: Simd>(
    simd: S,
    rows: &Rows<'_, 16>,
    lanes: Mask<S>,
    n: Vec3x<S>,
    albedo: Vec3x<S>,
) -> Vec3x<S> {
    let (x, y) = in_circle(simd, rows, n);
    let circle = lanes & x.mul_add(x, y * y).simd_lt(1.0);
    let bits = circle.to_bitmask();
    if bits == 0 {
        return albedo;
    }
    let (x, y) = (x.to_array(), y.to_array());
    let number = rows.number(simd, NUMBER).to_array();
    let mut ink = 0;
    for lane in 0..LANES {
        if bits >> lane & 1 == 1 && is_ink(number[lane] as u32, x[lane], y[lane]) {
            ink |= 1 << lane;
        }
    }
    let ink = Mask::from_bitmask(simd, ink);
    let white = Vec3x::splat(simd, CIRCLE_ALBEDO);
    let texture = Vec3x::select(ink, Vec3x::splat(simd, INK_ALBEDO), white);
    Vec3x::select(circle, texture, albedo)
}

/// Sine of an angle in turns, by a polynomial over the first quarter turn.
#[inline(always)]
fn wave<S: Simd>(turns: Float<S>) -> Float<S> {
    let x = turns - (turns + 0.5).floor();
    // sin(π − x) = sin x folds the half turn onto its first quarter, where the polynomial is accurate.
    let t = x.abs().min(0.5 - x.abs());
    let t2 = t * t;
    let [c1, c3, c5, c7] = SINE_OF_TURNS;
    let sine = t * t2.mul_add(c7, c5).mul_add(t2, c3).mul_add(t2, c1);
    x.simd_lt(0.0).select(-sine, sine)
}

/// See [`crate::texture`] for this and the following functions.
#[inline(always)]
fn faded<S: Simd>(turns_per_m: f32, footprint_m: Float<S>) -> Float<S> {
    let turns = (footprint_m * turns_per_m).min(1.0);
    let left = 1.0 - turns * turns;
    left * left
}

#[inline(always)]
fn line_share<S: Simd>(distance_m: Float<S>, half_m: f32, footprint_m: Float<S>) -> Float<S> {
    let half = footprint_m * 0.5 + half_m;
    half_m / half * (1.0 - distance_m / half).max(0.0)
}

#[inline(always)]
fn wood<S: Simd>(
    simd: S,
    rows: &Rows<'_, 16>,
    planks: Mask<S>,
    [p, light]: [Vec3x<S>; 2],
    footprint_m: Float<S>,
) -> Vec3x<S> {
    let (zero, one) = (Float::splat(simd, 0.0), Float::splat(simd, 1.0));
    let sights = rows.triple(simd, SIGHTS);
    let has_sights = sights.x.simd_gt(0.0);
    let has_rails = sights.y.simd_gt(0.0);
    let is_end = (p.x.abs() - sights.y).simd_gt(p.y.abs() - sights.z);
    let grain = rows.number(simd, GRAIN_AXIS);
    let grain = has_rails.select(is_end.select(one, zero), grain);
    let upright = grain.simd_gt(1.5);
    let along_y = grain.simd_gt(0.5) & !upright;

    let place = p;
    let scale = rows.number(simd, SCALE);
    let (p, footprint) = (p * scale, footprint_m * scale);
    let mut a = upright.select(p.z, along_y.select(p.y, p.x));
    let b = upright.select(p.x + p.y, along_y.select(p.x, p.y));
    let height = upright.select(zero, p.z);
    let mut tone = zero;
    let mut gap = Mask::splat(simd, false);
    if planks.any_true() {
        let across = b * (1.0 / PLANK_M);
        let plank = across.floor();
        gap = planks & (across - plank).simd_lt(PLANK_GAP);
        tone = planks.select(wave(plank * 0.381_966) * 0.28, zero);
        a = planks.select(a + plank * 1.7, a);
    }
    let bend =
        wave(a.mul_add(0.61, Float::splat(simd, 0.2))) * 0.45 + wave(a.mul_add(1.7, b * 2.3)) * 0.2;
    let ring = wave(b * 17.0 + height * 11.0 + bend);
    let sway = wave(a.mul_add(1.3, b * 3.1)) * 0.8;
    let fibre = wave(b * 151.0 + height * 83.0 + sway + a * 2.0);
    let pore = wave(b * 463.0 + height * 211.0 + wave(a * 4.1) * 1.1);
    let [rings, fibres, pores] = WOOD_TURNS_PER_M;
    let grain = ring * faded(rings, footprint) * 0.27
        + fibre * faded(fibres, footprint) * 0.14
        + pore * faded(pores, footprint) * 0.09;
    let shade = (grain + tone + 0.45).max(zero).min(one);
    let dark = rows.triple(simd, DARK);
    let wood = (dark - light).mul_add(shade, light);
    let wood = Vec3x::select(gap, dark * Float::splat(simd, 0.3), wood);
    if !has_sights.any_true() {
        return wood;
    }
    let p = place;
    let along = is_end.select(p.y, p.x);
    let off = is_end.select(p.x.abs() - sights.y, p.y.abs() - sights.z);
    let nearest = (along / sights.x + 0.5).floor();
    let count = is_end.select(Float::splat(simd, 1.5), Float::splat(simd, 3.5));
    // Three sights on an end rail; six on a side rail, where a pocket replaces the middle one of seven.
    let exists = nearest.abs().simd_lt(count) & (is_end | nearest.simd_ne(0.0));
    let diamond = (along - nearest * sights.x).abs() * (1.0 / SIGHT_HALF_M[0])
        + off.abs() * (1.0 / SIGHT_HALF_M[1]);
    let sight = has_sights & exists & diamond.simd_lt(1.0) & p.z.simd_gt(0.0);
    Vec3x::select(sight, Vec3x::splat(simd, SIGHT_ALBEDO), wood)
}

#[inline(always)]
fn bricks<S: Simd>(simd: S, rows: &Rows<'_, 16>, p: Vec3x<S>, light: Vec3x<S>) -> Vec3x<S> {
    let (zero, one) = (Float::splat(simd, 0.0), Float::splat(simd, 1.0));
    let [length, height] = BRICK_M;
    let course = (p.z / height).floor();
    let along = (p.x + p.y) / length + course * 0.5;
    let brick = along.floor();
    let joint =
        ((along - brick) * length).simd_lt(JOINT_M) | (p.z - course * height).simd_lt(JOINT_M);
    let kiln = [
        wave(brick * 0.381_966 + course * 0.271),
        wave(course * 0.754_878 - brick * 0.137),
    ];
    let fired = wave(kiln[0] * 5.3 + kiln[1] * 7.7) * 0.5 + 0.5;
    let speckle = wave(p.z * 31.0 + fired * 1.3) * wave((p.x + p.y) * 17.0 + fired);
    let shade = (fired + speckle * 0.12).max(zero).min(one);
    let bricks = (rows.triple(simd, DARK) - light).mul_add(shade, light);
    Vec3x::select(joint, rows.triple(simd, SIGHTS), bricks)
}

/// Lanes on the ink of a scoreboard. The few lanes on one are looked up one by one.
#[inline(always)]
fn scoreboard_ink<S: Simd>(simd: S, rows: &Rows<'_, 16>, lanes: Mask<S>, p: Vec3x<S>) -> Mask<S> {
    let place = rows.triple(simd, SIGHTS);
    let across = ((place.x - p.y) / place.z).to_array();
    let up = ((p.z - place.y) / place.z).to_array();
    let bits = lanes.to_bitmask();
    let mut ink = 0;
    for lane in 0..LANES {
        if bits >> lane & 1 == 1 && is_scoreboard_ink(across[lane], up[lane]) {
            ink |= 1 << lane;
        }
    }
    Mask::from_bitmask(simd, ink)
}

#[inline(always)]
fn print<S: Simd>(simd: S, rows: &Rows<'_, 16>, p: Vec3x<S>, sky: Vec3x<S>) -> Vec3x<S> {
    let q = (p - rows.triple(simd, SIGHTS)) * rows.number(simd, SCALE);
    let (x, y) = (q.x + q.y, q.z);
    let hills = rows.triple(simd, DARK);
    let [sun_x, sun_y, radius] = PRINT_SUN;
    let (aside, above) = (x - sun_x, y - sun_y);
    let is_sun = aside.mul_add(aside, above * above).simd_lt(radius * radius);
    let mut albedo = Vec3x::select(is_sun, Vec3x::splat(simd, PRINT_SUN_ALBEDO), sky);
    for range in [1.0_f32, 2.0, 3.0] {
        let ridge = wave(x * (0.17 + 0.13 * range) + 0.37 * range) * 0.09
            + wave(x * (0.9 + 0.4 * range) + 0.61 * range) * 0.035;
        let shade = (hills - sky).mul_add(Float::splat(simd, range / 3.0), sky);
        albedo = Vec3x::select(y.simd_lt(ridge + (0.33 - 0.25 * range)), shade, albedo);
    }
    for (half, border) in [(PRINT_VIEW, CIRCLE_ALBEDO), (PRINT_PAPER, INK_ALBEDO)] {
        let is_beyond = x.abs().simd_gt(half[0]) | y.abs().simd_gt(half[1]);
        albedo = Vec3x::select(is_beyond, Vec3x::splat(simd, border), albedo);
    }
    albedo
}

#[inline(always)]
fn cue<S: Simd>(simd: S, rows: &Rows<'_, 16>, p: Vec3x<S>, shaft: Vec3x<S>) -> Vec3x<S> {
    let from_tip_m = p.dot(rows.triple(simd, AXIS)) - rows.number(simd, UP);
    let butt = rows.triple(simd, DARK);
    let tip = Vec3x::splat(simd, CUE_TIP_ALBEDO);
    let ferrule = Vec3x::splat(simd, CUE_FERRULE_ALBEDO);
    let collar = Vec3x::splat(simd, CUE_COLLAR_ALBEDO);
    let wrap = Vec3x::splat(simd, CUE_WRAP_ALBEDO);
    let parts = [tip, ferrule, shaft, collar, butt, wrap];
    let mut albedo = butt;
    for (end, part) in CUE_ENDS_M.into_iter().zip(parts).rev() {
        albedo = Vec3x::select(from_tip_m.simd_lt(end), part, albedo);
    }
    albedo
}

#[inline(always)]
fn cloth<S: Simd>(
    simd: S,
    rows: &Rows<'_, 16>,
    [p, light]: [Vec3x<S>; 2],
    footprint_m: Float<S>,
) -> Vec3x<S> {
    let (u, v) = (p.z.mul_add(0.3, p.x), p.z.mul_add(0.8, p.y));
    let (bend, sway) = (wave(u * 2.3 + v * 1.1), wave(u * 0.9 - v * 2.1));
    let nap = wave(v * 37.0 + bend * 3.0) * wave(u * 23.0 + sway * 2.0);
    let shade = bend * sway * 0.05 + nap * 0.015 + 1.0;
    let most = rows.number(simd, SCALE);
    let chalk = Vec3x::splat(simd, CHALK_ALBEDO) * most;
    let mut colour = light * shade;
    let of_weave = faded(WEAVE_FADES_PER_M, footprint_m);
    let near = footprint_m.simd_gt(0.0) & of_weave.simd_gt(0.0);
    if near.any_true() {
        let woven = colour * (weave(u, v) * of_weave * WEAVE_SHARE + 1.0);
        let of_lint = lint(u, v, footprint_m) * of_weave * LINT_SHARE;
        let linted = (chalk - woven).mul_add(of_lint, woven);
        colour = Vec3x::select(near, linted, colour);
    }
    let marked = p.z.abs().simd_lt(MARK_REACH_M);
    if marked.any_true() {
        let marks = marks(simd, rows, p, footprint_m, [colour, chalk]);
        colour = Vec3x::select(marked, marks, colour);
    }
    Vec3x::new(colour.x.min(most), colour.y.min(most), colour.z.min(most))
}

#[inline(always)]
fn weave<S: Simd>(u: Float<S>, v: Float<S>) -> Float<S> {
    let (warp, weft) = (wave(v * 61.0 + u * 13.0), wave(u * 53.0 - v * 17.0));
    let over = wave(u * WEAVE_PER_M + warp * 0.3) * wave(v * WEAVE_PER_M + weft * 0.3);
    over * (warp * weft * 0.25 + 0.75)
}

#[inline(always)]
fn lint<S: Simd>(u: Float<S>, v: Float<S>, footprint_m: Float<S>) -> Float<S> {
    let i = (u * (1.0 / LINT_SQUARE_M)).floor();
    let j = (v * (1.0 / LINT_SQUARE_M)).floor();
    let a = wave(i * 0.381_966 + j * 0.271_828);
    let b = wave(j * 0.754_878 - i * 0.137_035);
    let x = u - (i + 0.5 + a * 0.4) * LINT_SQUARE_M;
    let y = v - (j + 0.5 + b * 0.4) * LINT_SQUARE_M;
    let turns = a * 2.3 + b * 3.7;
    let (sin, cos) = (wave(turns), wave(turns + 0.25));
    let (along, across) = ((x * cos + y * sin).abs(), (x * sin - y * cos).abs());
    let [half_length, half_width] = LINT_HALF_M;
    line_share(along, half_length, footprint_m) * line_share(across, half_width, footprint_m)
}

/// Adds wear, lines and spots to a table's cloth.
#[inline(always)]
fn marks<S: Simd>(
    simd: S,
    rows: &Rows<'_, 16>,
    p: Vec3x<S>,
    footprint_m: Float<S>,
    [colour, chalk]: [Vec3x<S>; 2],
) -> Vec3x<S> {
    let (sights, spots) = (rows.triple(simd, SIGHTS), rows.triple(simd, DARK));
    let (line_x, d_radius) = (sights.x, sights.y);
    let y2 = p.y * p.y;
    let along = p.x - spots.x;
    let from_foot = along.mul_add(along, y2) * (1.0 / WORN_M2);
    let worn = WORN_SHARE / (from_foot + 1.0);
    // Falls as 1 / (1 + d²), without an edge that would be visible as a ring.
    let colour = (chalk - colour).mul_add(worn, colour);
    let from_line = p.x + line_x;
    let from_arc = from_line.mul_add(from_line, y2).sqrt() - d_radius;
    let has_line = line_x.simd_gt(0.0);
    let in_d = d_radius.simd_gt(0.0) & from_line.simd_lt(0.0);
    let far = Float::splat(simd, 1.0);
    let off = has_line.select(from_line.abs(), far);
    let off = off.min(in_d.select(from_arc.abs(), far));
    let share = line_share(off, LINE_HALF_M, footprint_m) * LINE_SHARE;
    let colour = (chalk - colour).mul_add(share, colour);
    let (a, b, c) = (p.x - spots.x, p.x - spots.y, p.x - spots.z);
    let nearest = (a * a).min(b * b).min(c * c) + y2;
    let aside = p.y.abs() - d_radius;
    let on_line = from_line.mul_add(from_line, y2.min(aside * aside));
    let nearest = has_line.select(nearest.min(on_line), nearest);
    let spot = nearest.simd_lt(SPOT_RADIUS_M * SPOT_RADIUS_M);
    let share = spot.select(Float::splat(simd, SPOT_SHARE), Float::splat(simd, 1.0));
    colour * share
}
