//! Coplanarity of discs and of area lights, which lets a kernel omit intersection tests.

use glam::Vec3;

use crate::compiled::{AreaLightData, CompiledScene, DiscData};

/// Largest ratio of coordinate to smallest extent at which the rounding error of a point in a
/// plane, 4 · 2⁻²⁴ of its coordinates, is below a thousandth of that extent (4096 · 2⁻²² = 2⁻¹⁰).
const COORDINATE_PER_EXTENT_MAX: f32 = 4096.0;
/// Distance from a plane, relative to the largest coordinate, that counts as rounding error.
const ROUNDING: f32 = 4.0 * f32::EPSILON;

/// Whether all discs lie in one plane, so that a ray is intersected with that plane only once.
pub(crate) fn discs_coplanar(scene: &CompiledScene) -> bool {
    let plane = |disc: &DiscData| (disc.center.into(), disc.normal.into());
    let extents = scene.discs.iter().map(|disc| disc.radius);
    in_one_plane(scene.discs.iter().map(plane), extents, farthest(scene))
}

/// Whether all area lights lie in one plane; see [`discs_coplanar`].
pub(crate) fn area_lights_coplanar(scene: &CompiledScene) -> bool {
    let plane = |light: &AreaLightData| (light.center.into(), light.normal.into());
    let area_lights = scene.area_lights.iter();
    let extents = area_lights.flat_map(|light| [light.length_u, light.length_v]);
    in_one_plane(
        scene.area_lights.iter().map(plane),
        extents,
        farthest(scene),
    )
}

/// Whether a point of some area light lies in front of another's face: only there can it block the
/// light that this other one emits.
pub(crate) fn area_lights_occlude(scene: &CompiledScene) -> bool {
    let rounding = ROUNDING * farthest(scene);
    let before = |light: &AreaLightData, other: &AreaLightData| {
        let (center, normal) = (Vec3::from(other.center), Vec3::from(other.normal));
        corners(light).any(|corner| (corner - center).dot(normal) > rounding)
    };
    let area_lights = scene.area_lights.iter().enumerate();
    let mut pairs = area_lights.flat_map(|(i, light)| {
        let others = scene
            .area_lights
            .iter()
            .enumerate()
            .filter(move |(j, _)| *j != i);
        others.map(move |(_, other)| (light, other))
    });
    pairs.any(|(light, other)| before(light, other))
}

/// Whether all planes, each given by a point and a unit normal, are the same one, and the smallest
/// extent is large enough for a rounded intersection point to tell which surface it lies on.
fn in_one_plane(
    mut planes: impl Iterator<Item = (Vec3, Vec3)>,
    extents: impl Iterator<Item = f32>,
    farthest: f32,
) -> bool {
    let Some((point, normal)) = planes.next() else {
        return false;
    };
    if farthest > COORDINATE_PER_EXTENT_MAX * extents.fold(f32::INFINITY, f32::min) {
        return false;
    }
    planes.all(|(center, other)| {
        let is_parallel = normal == other || normal == -other;
        is_parallel && (center - point).dot(normal).abs() <= ROUNDING * farthest
    })
}

fn corners(light: &AreaLightData) -> impl Iterator<Item = Vec3> + use<> {
    let center = Vec3::from(light.center);
    let [u, v] = light.half_edges().map(Vec3::from);
    [u + v, u - v, v - u, -u - v]
        .into_iter()
        .map(move |corner| center + corner)
}

/// The largest absolute coordinate of the camera and all surfaces, in metres.
pub(crate) fn farthest(scene: &CompiledScene) -> f32 {
    let reach = |center: [f32; 3], extent: f32| Vec3::from(center).abs().max_element() + extent;
    let length = |v: [f32; 3]| Vec3::from(v).length();
    let surfaces = scene.extents(length);
    let area_lights = scene.area_lights.iter();
    let area_lights = area_lights.map(|l| (l.center, l.length_u + l.length_v));
    let surfaces = surfaces
        .chain(area_lights)
        .map(|(center, extent)| reach(center, extent));
    let eye = reach(scene.camera.eye.to_array(), 0.0);
    surfaces.fold(eye.max(scene.meshes.reach), f32::max)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gpu::probe;

    fn area_lights(moved: Vec3, tilt: Vec3) -> CompiledScene {
        let mut scene = probe::scene();
        scene.area_lights[1].center += moved;
        scene.area_lights[1].half_u += tilt;
        CompiledScene::new(&scene).unwrap()
    }

    #[test]
    fn lights_side_by_side_are_coplanar() {
        assert!(area_lights_coplanar(&area_lights(Vec3::ZERO, Vec3::ZERO)));
        assert!(area_lights_coplanar(&area_lights(
            Vec3::new(0.3, -2.0, 0.0),
            Vec3::ZERO
        )));
        assert!(!area_lights_coplanar(&area_lights(
            Vec3::new(0.0, 0.0, 1e-3),
            Vec3::ZERO
        )));
        assert!(!area_lights_coplanar(&area_lights(
            Vec3::ZERO,
            Vec3::new(0.0, 0.0, 1e-3)
        )));
        // So far away that points on the plane are rounded to half a metre.
        assert!(!area_lights_coplanar(&area_lights(
            Vec3::new(5e6, 0.0, 0.0),
            Vec3::ZERO
        )));
    }

    #[test]
    fn light_occludes_another_only_before_its_face() {
        assert!(!area_lights_occlude(&area_lights(Vec3::ZERO, Vec3::ZERO)));
        // They shine downwards: the lower one is in front of the upper one's face, whichever it is.
        assert!(area_lights_occlude(&area_lights(
            Vec3::new(0.0, 0.0, -0.1),
            Vec3::ZERO
        )));
        assert!(area_lights_occlude(&area_lights(
            Vec3::new(0.0, 0.0, 0.1),
            Vec3::ZERO
        )));
        assert!(area_lights_occlude(&area_lights(
            Vec3::ZERO,
            Vec3::new(0.0, 0.0, 0.1)
        )));
    }
}
