//! Marbles on patches: a square lattice in layers, from which they settle.

use carom_mpm::{Marble, MarbleState, Marbles};
use glam::{DVec2, DVec3, Vec3};

use super::{ParticleMaterial, ParticlePatch};
use crate::{ParticleFault, Result};

/// No marbles.
pub(super) fn none() -> Result<Marbles> {
    let marble = Marble {
        radius_m: ParticleMaterial::MARBLE_RADIUS_M,
        ..Marble::default()
    };
    let fall = DVec3::new(0.0, 0.0, -9.81);
    Ok(Marbles::new(marble, fall, REST_M_S).map_err(ParticleFault::from)?)
}

/// Marbles where patches are covered with them and a place with room for a radius is clear. The upper layer lies over the
/// gaps of the lower.
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

/// Points on top and around of each, in m.
pub(super) fn tops(marbles: &Marbles) -> impl Iterator<Item = Vec3> + '_ {
    let radius_m = marbles.marble().radius_m as f32;
    let around = [Vec3::Z, Vec3::X, -Vec3::X, Vec3::Y, -Vec3::Y].map(|way| 0.9 * radius_m * way);
    let marbles = marbles.spheres().iter();
    marbles.flat_map(move |marble| around.map(|arm| marble.position.as_vec3() + arm))
}

/// Corners of the square around each, seen from above, in m.
pub(super) fn reach(marbles: &Marbles) -> impl Iterator<Item = DVec2> + '_ {
    let radius_m = marbles.marble().radius_m;
    let marbles = marbles.spheres().iter();
    marbles.flat_map(move |marble| {
        let at = marble.position.truncate();
        [at - radius_m, at + radius_m]
    })
}

/// Most marbles of a table: a shot through all of them takes some seconds.
pub(super) const MARBLES_MAX: usize = 2000;
const LAYERS: i32 = 2;
/// Between neighbours of a layer: a hair more than they are wide.
const STEP_M: f64 = 2.01 * ParticleMaterial::MARBLE_RADIUS_M;
/// Between layers: those of the upper lie in the gaps of the lower, at √2 radii, and a hair more.
const LAYER_M: f64 = 1.43 * ParticleMaterial::MARBLE_RADIUS_M;
/// Marbles that are slower rest.
const REST_M_S: f64 = 0.02;
