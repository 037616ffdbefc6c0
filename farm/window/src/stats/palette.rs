//! Colours of nodes, stages and costs. Labels accompany them: no state is distinguished by colour alone.

use egui::Color32;

/// Colour of a node, distinguishable with every kind of colour vision (Okabe and Ito, "Color Universal
/// Design", 2008); darker for nodes beyond the seventh.
pub(super) fn node(index: usize) -> Color32 {
    let [r, g, b] = NODES[index % NODES.len()];
    let shade = SHADES[index / NODES.len() % SHADES.len()];
    Color32::from_rgb(shaded(r, shade), shaded(g, shade), shaded(b, shade))
}

/// Colour of a tile's cost, given as a multiple of the mean, from a quarter (dark blue) over the mean (green)
/// to four times (yellow): interpolated between five colours of viridis (van der Walt and Smith, 2015).
pub(super) fn cost(times_mean: f32) -> Color32 {
    let position = (times_mean.max(1e-6).log2() / COST_OCTAVES * 0.5 + 0.5).clamp(0.0, 1.0);
    let place = position * (COSTS.len() - 1) as f32;
    let (left, t) = ((place as usize).min(COSTS.len() - 2), place.fract());
    let t = if place >= (COSTS.len() - 1) as f32 {
        1.0
    } else {
        t
    };
    let mix = |i: usize| {
        let [a, b] = [COSTS[left][i], COSTS[left + 1][i]].map(f32::from);
        (a + (b - a) * t) as u8
    };
    Color32::from_rgb(mix(0), mix(1), mix(2))
}

/// Colours of a tile's latency stages, in their order: request, network, queue, trace, encode, decode.
pub(super) const STAGES: [Color32; 6] = [
    Color32::from_rgb(120, 120, 125),
    Color32::from_rgb(86, 180, 233),
    Color32::from_rgb(204, 121, 167),
    Color32::from_rgb(230, 159, 0),
    Color32::from_rgb(0, 158, 115),
    Color32::from_rgb(240, 228, 66),
];

/// Measured values, beside [`IDEAL`].
pub(super) const ACTUAL: Color32 = Color32::from_rgb(230, 159, 0);
/// Ideal values.
pub(super) const IDEAL: Color32 = Color32::from_rgb(86, 180, 233);
/// Lines that mark a limit.
pub(super) const LIMIT: Color32 = Color32::from_rgb(204, 121, 167);

fn shaded(channel: u8, shade: f32) -> u8 {
    (f32::from(channel) * shade).clamp(0.0, 255.0) as u8
}

const NODES: [[u8; 3]; 7] = [
    [230, 159, 0],
    [86, 180, 233],
    [0, 158, 115],
    [240, 228, 66],
    [0, 114, 178],
    [213, 94, 0],
    [204, 121, 167],
];
const SHADES: [f32; 3] = [1.0, 0.7, 0.45];
const COSTS: [[u8; 3]; 5] = [
    [68, 1, 84],
    [59, 82, 139],
    [33, 145, 140],
    [94, 201, 98],
    [253, 231, 37],
];
/// Powers of two between the mean and either end of the colour scale.
const COST_OCTAVES: f32 = 2.0;
