//! Marbles on patches: laid as a square lattice in layers, from which they settle.

use carom_mpm::{Marble, MarbleState, Marbles};
use glam::{DVec2, DVec3, Vec3};

use super::{ParticleMaterial, ParticlePatch};
use crate::{ParticleFault, Result};

/// An empty set of marbles.
pub(super) fn none() -> Result<Marbles> {
    let marble = Marble {
        radius_m: ParticleMaterial::MARBLE_RADIUS_M,
        ..Marble::default()
    };
    let fall = DVec3::new(0.0, 0.0, -9.81);
    Ok(Marbles::new(marble, fall, REST_M_S).map_err(ParticleFault::from)?)
}

/// Marbles on the patches that are covered with them, where `is_clear` holds for a position and a
/// radius. The upper layer lies over the gaps of the lower.
pub(super) fn laid(
    patches: &[ParticlePatch],
    is_clear: impl Fn(DVec3, f64) -> bool,
) -> Result<Marbles> {
    let mut marbles = none()?;
    let radius_m = ParticleMaterial::MARBLE_RADIUS_M;
    let covered = patches
        .iter()
        .filter(|patch| patch.material == ParticleMaterial::Marbles);
    for patch in covered {
        for layer in 0..LAYERS {
            let shift = f64::from(layer) * 0.5;
            // One lattice for the whole table, so that adjoining patches continue it.
            let [first, end] = [0.0, ParticlePatch::EDGE_M].map(|edge| {
                ((patch.corner() + edge) / STEP_M - shift - 0.5)
                    .ceil()
                    .as_ivec2()
            });
            for [x, y] in (first.x..end.x).flat_map(|x| (first.y..end.y).map(move |y| [x, y])) {
                let at = (DVec2::new(x.into(), y.into()) + 0.5 + shift) * STEP_M;
                let position = at.extend(radius_m + f64::from(layer) * LAYER_M);
                if is_clear(position, radius_m) {
                    let sphere = MarbleState {
                        position,
                        velocity: DVec3::ZERO,
                        spin: DVec3::ZERO,
                    };
                    marbles.add(sphere).map_err(ParticleFault::from)?;
                }
            }
        }
    }
    Ok(marbles)
}

/// Points at the top and around each marble, in m.
pub(super) fn tops(marbles: &Marbles) -> impl Iterator<Item = Vec3> + '_ {
    let radius_m = marbles.marble().radius_m as f32;
    let around = [Vec3::Z, Vec3::X, -Vec3::X, Vec3::Y, -Vec3::Y].map(|way| 0.9 * radius_m * way);
    let marbles = marbles.spheres().iter();
    marbles.flat_map(move |marble| around.map(|arm| marble.position.as_vec3() + arm))
}

/// Corners of the bounding square of each marble seen from above, in m.
pub(super) fn reach(marbles: &Marbles) -> impl Iterator<Item = DVec2> + '_ {
    let radius_m = marbles.marble().radius_m;
    let marbles = marbles.spheres().iter();
    marbles.flat_map(move |marble| {
        let at = marble.position.truncate();
        [at - radius_m, at + radius_m]
    })
}

/// Maximum number of marbles on a table: a shot through all of them takes some seconds.
pub(super) const MARBLES_MAX: usize = 2000;
const LAYERS: i32 = 2;
/// Spacing within a layer: slightly more than the diameter, so that none overlap.
const STEP_M: f64 = 2.01 * ParticleMaterial::MARBLE_RADIUS_M;
/// Spacing of layers: a marble in the gap of four touching ones lies √2 radii higher, and slightly more
/// is left.
const LAYER_M: f64 = 1.43 * ParticleMaterial::MARBLE_RADIUS_M;
/// Speed below which marbles count as at rest.
const REST_M_S: f64 = 0.02;
