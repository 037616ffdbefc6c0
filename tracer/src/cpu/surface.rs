//! Surface properties at hits: point, normal and material, looked up by primitive id.

use fearless_simd::prelude::*;

use super::lanes::{Float, Mask, Vec3x, Word};
use super::medium::FreeFlight;
use super::metallic_roughness::{MetallicRoughness, MetallicRoughnessTable};
use super::microfacet::{MicrofacetBsdf, MicrofacetRow, SCATTERED, microfacet_row, untagged};
use super::rays::{INSIDE, inverse};
use super::refracted_nee::{NeeBoundaryRow, nee_boundary_row};
use super::rows::Rows;
use super::shapes::Chord;
use super::sheen::{Sheen, SheenRow};
use super::texture::{TextureRow, are_on_discs, texture_row, textured};
use super::triangle_surface::{TriangleHit, TriangleSurfaces};
use crate::compiled::{
    CSG_FACE_APEX_CONE, CSG_FACE_CONE_X, CSG_FACE_CONE_Y, CSG_FACE_CONE_Z, CSG_FACE_CYLINDER,
    CSG_FACE_OUTER_BOX, CSG_FACE_PLANE, CompiledScene, KIND_DIELECTRIC, KIND_LAYERED,
    KIND_METALLIC_ROUGHNESS, MaterialData, PATTERN_NONE, ShapeKind,
};

/// Surface table: one row per primitive that scatters, in the order of ids; then one per material, for
/// triangles; then one per ball, for the discs with their numbers.
pub(super) struct Surfaces {
    rows: Vec<SurfaceRow>,
    /// Number of balls with a second row for the discs with their numbers; 0 if no ball needs it.
    balls: u32,
    /// Index of the first of those rows.
    discs_first: u32,
    triangles: TriangleSurfaces,
    /// Empty if all materials are diffuse, bare or coated.
    microfacet: Vec<MicrofacetRow>,
    /// Empty without procedural textures.
    texture: Vec<TextureRow>,
    /// Distance of the camera's near plane, on which its rays begin, metres.
    near_m: f32,
    /// Whether some coat is rough.
    pub(super) has_rough_coat: bool,
    /// Empty if no cloth has a sheen.
    sheen: Vec<SheenRow>,
    /// Empty without glTF's material.
    metallic_roughness: MetallicRoughnessTable,
    /// Whether there are dielectrics, so that paths continue inside bodies.
    pub(super) has_dielectric: bool,
    /// Empty if no ball allows refracted next-event estimation.
    pub(super) nee_boundaries: Vec<NeeBoundaryRow>,
}

/// Geometry, then material; the meaning of the first six numbers depends on [`KIND`].
type SurfaceRow = [f32; 20];

/// Centre of a sphere, minimum corner of a box, normal of flat shapes.
const FIRST: usize = 0;
/// Radius of a sphere, maximum corner of a box.
const SECOND: usize = 3;
const KIND: usize = 6;
const IOR: usize = 7;
const ALBEDO: usize = 8;
const DIFFUSE_SCALE: usize = 11;
const STRIPE_ALBEDO: usize = 12;
const STRIPE_HALF_WIDTH: usize = 15;
const STRIPE_AXIS: usize = 16;
const COAT_ALPHA: usize = 19;

const KIND_SPHERE: f32 = 0.0;
const KIND_BOX: f32 = 1.0;
const KIND_FLAT: f32 = 2.0;
/// Inside of a vertical cylindrical hole.
const KIND_CYLINDER: f32 = 3.0;
/// Inside of a box.
const KIND_INNER_BOX: f32 = 4.0;
/// Cones along the coordinate axes.
const KIND_CONE_X: f32 = 5.0;
const KIND_CONE_Y: f32 = 6.0;
const KIND_CONE_Z: f32 = 7.0;
/// Cone with an arbitrary axis.
const KIND_APEX_CONE: f32 = 8.0;
/// Triangle, whose row has the material alone.
const KIND_TRIANGLE: f32 = 9.0;

/// Surface properties at the hits of a packet.
pub(super) struct Hit<S: Simd> {
    pub(super) position: Vec3x<S>,
    /// Unit shading normal, on the side from which the ray came.
    pub(super) normal: Vec3x<S>,
    /// Geometric normal on the same side where it differs from `normal`, 0 elsewhere; `None` in scenes
    /// without shading normals.
    pub(super) geometric: Option<Vec3x<S>>,
    /// Origins of rays that pass the surface, if they differ from `position` in any lane.
    beyond: Option<Vec3x<S>>,
    pub(super) albedo: Vec3x<S>,
    /// Index of refraction of the coat; 0 for a bare surface.
    pub(super) ior: Float<S>,
    pub(super) diffuse_scale: Float<S>,
    /// GGX width of the coat, 0 for a smooth one; `None` if the scene has no rough coat.
    pub(super) coat_alpha: Option<Float<S>>,
    /// Metals and dielectrics, if any lane hit one.
    pub(super) microfacet: Option<MicrofacetBsdf<S>>,
    /// Cloth, if any lane hit it.
    pub(super) sheen: Option<Sheen<S>>,
    /// glTF's material, if any lane hit it.
    pub(super) metallic_roughness: Option<MetallicRoughness<S>>,
}

impl<S: Simd> Hit<S> {
    /// Origin of a ray towards `wi`.
    #[inline(always)]
    pub(super) fn origin(&self, wi: Vec3x<S>) -> Vec3x<S> {
        match self.beyond {
            Some(beyond) => {
                let mut passed = self.normal.dot(wi).simd_lt(0.0);
                if let Some(surface) = &self.metallic_roughness {
                    // Directions below the base's normal may be those of its clear coat, and are not
                    // transmitted.
                    passed &= !surface.lanes;
                }
                Vec3x::select(passed, beyond, self.position)
            }
            None => self.position,
        }
    }
}

impl Surfaces {
    pub(super) fn new(scene: &CompiledScene) -> Self {
        let row = |first, second, kind, material: u32, axis| {
            row(
                first,
                second,
                kind,
                &scene.materials[material as usize],
                axis,
            )
        };
        let flat = |normal, material| row(normal, [0.0; 3], KIND_FLAT, material, [0.0; 3]);
        let mut rows = Vec::with_capacity(scene.primitives.len());
        for s in &scene.spheres {
            let radius = [s.radius, 0.0, 0.0];
            rows.push(row(
                s.center,
                radius,
                KIND_SPHERE,
                s.material,
                s.stripe_axis,
            ));
        }
        for b in &scene.boxes {
            rows.push(row(b.min, b.max, KIND_BOX, b.material, [0.0; 3]));
        }
        rows.extend(scene.discs.iter().map(|d| flat(d.normal, d.material)));
        rows.extend(scene.rectangles.iter().map(|r| flat(r.normal, r.material)));
        rows.extend(scene.csg_faces.iter().map(|face| {
            let kind = match face.kind {
                CSG_FACE_OUTER_BOX => KIND_BOX,
                CSG_FACE_PLANE => KIND_FLAT,
                CSG_FACE_CYLINDER => KIND_CYLINDER,
                CSG_FACE_CONE_X => KIND_CONE_X,
                CSG_FACE_CONE_Y => KIND_CONE_Y,
                CSG_FACE_CONE_Z => KIND_CONE_Z,
                CSG_FACE_APEX_CONE => KIND_APEX_CONE,
                _ => KIND_INNER_BOX,
            };
            row(face.a, face.b, kind, face.material, [0.0; 3])
        }));
        let triangles_first = rows.len() as u32;
        if !scene.meshes.triangles.is_empty() {
            let materials = 0..scene.materials.len() as u32;
            rows.extend(
                materials
                    .map(|material| row([0.0; 3], [0.0; 3], KIND_TRIANGLE, material, [0.0; 3])),
            );
        }
        let discs_first = rows.len() as u32;
        let discs = number_discs(scene).zip(&scene.spheres);
        rows.extend(discs.map(|(material, s)| {
            let radius = [s.radius, 0.0, 0.0];
            self::row(s.center, radius, KIND_SPHERE, material, s.stripe_axis)
        }));
        Self {
            balls: rows.len() as u32 - discs_first,
            discs_first,
            rows,
            triangles: TriangleSurfaces::new(scene, triangles_first, triangles_first),
            microfacet: microfacet_rows(scene),
            texture: texture_rows(scene),
            near_m: scene.camera.near_m,
            has_rough_coat: scene.materials.iter().any(MaterialData::has_rough_coat),
            sheen: sheen_rows(scene),
            metallic_roughness: MetallicRoughnessTable::new(scene, || shapes_and_materials(scene)),
            has_dielectric: (scene.materials.iter()).any(|m| m.kind == KIND_DIELECTRIC),
            nee_boundaries: nee_boundary_rows(scene),
        }
    }

    /// Row of each hit: for the disc with a ball's number that of the disc, else `id`.
    #[inline(always)]
    fn with_discs<S: Simd>(
        &self,
        simd: S,
        origin: Vec3x<S>,
        direction: Vec3x<S>,
        id: Word<S>,
        within: Mask<S>,
    ) -> Word<S> {
        let balls = id.simd_lt(self.balls) & !within;
        if !balls.any_true() {
            return id;
        }
        let row = balls.select(id, Word::splat(simd, 0)) + self.discs_first;
        let rows = Rows::new(&self.rows, row);
        // The geometry in both rows of a ball is the same, so that either may be read here.
        let radius = rows.triple(simd, SECOND).x;
        let chord = Chord::new(origin, direction, rows.triple(simd, FIRST), radius);
        let n = chord.first_from_center(direction, within) * (1.0 / radius);
        (balls & are_on_discs(simd, &self.texture, row, n)).select(row, id)
    }

    #[inline(always)]
    fn sheen_at<S: Simd>(&self, simd: S, id: Word<S>) -> Option<Sheen<S>> {
        if self.sheen.is_empty() {
            return None;
        }
        Sheen::new(simd, &self.sheen, id)
    }

    /// Whether the scene has triangles or glTF's material, which [`Surfaces::hit`] handles only if
    /// `GENERAL`.
    pub(super) fn is_general(&self) -> bool {
        !self.triangles.is_empty() || !self.metallic_roughness.is_empty()
    }

    #[inline(always)]
    fn metallic_roughness_at<S: Simd>(
        &self,
        simd: S,
        id: Word<S>,
        triangles: Option<&TriangleHit<S>>,
    ) -> Option<MetallicRoughness<S>> {
        if self.metallic_roughness.is_empty() {
            return None;
        }
        MetallicRoughness::new(simd, &self.metallic_roughness, id, triangles)
    }

    /// Free flights of the rays inside the dielectrics of ids `start`, towards a boundary at `distance`.
    /// Lanes outside `within` have weight 1.
    #[inline(always)]
    pub(super) fn sample_distance<S: Simd>(
        &self,
        simd: S,
        within: Mask<S>,
        start: Word<S>,
        distance: Float<S>,
        u: Float<S>,
    ) -> FreeFlight<S> {
        let body = within.select(untagged(start), Word::splat(simd, 0));
        let body = self.triangles.rows(simd, body);
        FreeFlight::new(simd, &self.microfacet, body, within, distance, u)
    }

    /// [`Surfaces::hit`] for any scene, as a function of its own, whose code its callers share.
    #[inline(never)]
    pub(super) fn general_hit<S: Simd>(
        &self,
        simd: S,
        origin: Vec3x<S>,
        direction: Vec3x<S>,
        distance: Float<S>,
        tag: Word<S>,
        footprint: f32,
    ) -> Hit<S> {
        simd.vectorize(
            #[inline(always)]
            || self.hit::<S, true>(simd, origin, direction, distance, tag, footprint),
        )
    }

    /// Surface of the primitive in `tag` at `distance` along the ray, or the point inside the body where
    /// the path was scattered. `footprint` is the width of the surface that a ray covers at a distance of 1
    /// m, metres; 0 for the finest level of textures.
    #[inline(always)]
    #[expect(
        clippy::too_many_lines,
        reason = "one packet's values, all in registers"
    )]
    pub(super) fn hit<S: Simd, const GENERAL: bool>(
        &self,
        simd: S,
        origin: Vec3x<S>,
        direction: Vec3x<S>,
        distance: Float<S>,
        tag: Word<S>,
        footprint: f32,
    ) -> Hit<S> {
        let (mut id, mut within, mut microfacet) = (tag, Mask::splat(simd, false), None);
        let mut scattered = None;
        if !self.microfacet.is_empty() {
            id = untagged(tag);
            within = (tag & INSIDE).simd_ne(0);
            if self.balls > 0 {
                id = self.with_discs(simd, origin, direction, id, within);
            }
            scattered = Some((tag & SCATTERED).simd_ne(0));
        }
        // By reference: moving the value into an `Option` would copy it twice.
        let met;
        let triangles = if GENERAL && self.triangles.are_met(id) {
            met = (self.triangles).hit(simd, origin, direction, id, scattered, footprint);
            Some(&met)
        } else {
            None
        };
        let mut boundary = None;
        if let Some(triangles) = triangles {
            id = triangles.row;
            boundary = triangles.boundary;
        }
        if !self.microfacet.is_empty() {
            // A mesh tells by its winding whether the ray was inside; other bodies by the tag.
            let mut tags = tag & (INSIDE | SCATTERED);
            if let (Some(triangles), Some(boundary)) = (triangles, &boundary) {
                let [inside, outside] = [INSIDE, 0].map(|tag| Word::splat(simd, tag));
                let side = boundary.is_left.select(inside, outside);
                tags = triangles.lanes.select(side, tags);
            }
            microfacet = MicrofacetBsdf::new(simd, &self.microfacet, tags | id);
        }
        let rows = Rows::new(&self.rows, id);
        let kind = rows.number(simd, KIND);
        let first = rows.triple(simd, FIRST);
        let second = rows.triple(simd, SECOND);
        let mut position = direction.mul_add(distance, origin);
        let mut normal = first;

        let sphere = kind.simd_eq(KIND_SPHERE);
        if sphere.any_true() {
            let chord = Chord::new(origin, direction, first, second.x);
            // Position and normal come from the chord, not from o + t·d: for a distant eye that sum has
            // rounded away the digits that tell the sides of the sphere apart.
            let from_center = chord.first_from_center(direction, within);
            position = Vec3x::select(sphere, first + from_center, position);
            normal = Vec3x::select(sphere, from_center * (1.0 / second.x), normal);
        }
        let inner_box = kind.simd_eq(KIND_INNER_BOX);
        let boxed = kind.simd_eq(KIND_BOX) | inner_box;
        if boxed.any_true() {
            within |= inner_box;
            // The intersection test does not return the face; finding it again here costs once per path
            // instead of once per test.
            let face = Face::new(simd, origin, direction, first, second, within);
            position = Vec3x::select(boxed, face.put(simd, position), position);
            normal = Vec3x::select(boxed, face.normal, normal);
        }
        normal = round_normal(kind, position, first, second, normal);
        let mut geometric = None;
        if let Some(triangles) = triangles {
            position = Vec3x::select(triangles.lanes, triangles.position, position);
            normal = Vec3x::select(triangles.lanes, triangles.normal, normal);
            geometric = (self.triangles.has_shading_normals()).then_some(triangles.geometric);
        }
        if let Some(microfacet) = &microfacet {
            // A path scattered inside a sphere is not on an end of the chord.
            let inside = direction.mul_add(distance, origin);
            position = Vec3x::select(microfacet.is_scattered(), inside, position);
        }
        let beyond = boundary.zip(triangles);
        let beyond = beyond
            .map(|(boundary, triangles)| Vec3x::select(triangles.lanes, boundary.beyond, position));
        let mut albedo = rows.triple(simd, ALBEDO);
        let ior = rows.number(simd, IOR);
        if ior.simd_gt(0.0).any_true() {
            let axis = rows.triple(simd, STRIPE_AXIS);
            let half_width = rows.number(simd, STRIPE_HALF_WIDTH);
            // The stripe is a band of latitudes around the ball's equator.
            let striped = normal.dot(axis).abs().simd_lt(half_width);
            albedo = Vec3x::select(striped, rows.triple(simd, STRIPE_ALBEDO), albedo);
        }
        if let Some(color) = triangles.and_then(|triangles| triangles.color) {
            albedo = albedo.scale(color);
        }
        if !self.texture.is_empty() {
            // Rays start on the near plane, while `footprint` is per metre from the eye.
            let footprint = (distance + self.near_m) * footprint;
            albedo = textured(
                simd,
                &self.texture,
                id,
                [position, normal],
                footprint,
                albedo,
            );
        }
        // Flat shapes and the inside of bodies are hit from either side.
        let behind = normal.dot(direction).simd_gt(0.0);
        Hit {
            position,
            normal: Vec3x::select(behind, -normal, normal),
            geometric,
            beyond,
            albedo,
            ior,
            diffuse_scale: rows.number(simd, DIFFUSE_SCALE),
            coat_alpha: if self.has_rough_coat {
                Some(rows.number(simd, COAT_ALPHA))
            } else {
                None
            },
            microfacet,
            sheen: self.sheen_at(simd, id),
            metallic_roughness: if GENERAL {
                self.metallic_roughness_at(simd, id, triangles)
            } else {
                None
            },
        }
    }
}

/// Material of each row.
fn materials(scene: &CompiledScene) -> impl Iterator<Item = &MaterialData> {
    shapes_and_materials(scene).map(|(_, material)| material)
}

fn shapes_and_materials(scene: &CompiledScene) -> impl Iterator<Item = (ShapeKind, &MaterialData)> {
    let spheres = scene
        .spheres
        .iter()
        .map(|s| (ShapeKind::Sphere, s.material));
    let boxes = scene.boxes.iter().map(|b| (ShapeKind::Box, b.material));
    let discs = scene.discs.iter().map(|d| (ShapeKind::Disc, d.material));
    let rectangles = scene
        .rectangles
        .iter()
        .map(|r| (ShapeKind::Rectangle, r.material));
    let faces = scene
        .csg_faces
        .iter()
        .map(|f| (ShapeKind::CsgFace, f.material));
    let indices = spheres.chain(boxes).chain(discs).chain(rectangles);
    let of_triangles = match scene.meshes.triangles.is_empty() {
        true => &[],
        false => &scene.materials[..],
    };
    let materials = indices
        .chain(faces)
        .map(|(shape, index)| (shape, &scene.materials[index as usize]));
    let of_triangles = of_triangles.iter();
    materials
        .chain(of_triangles.map(|material| (ShapeKind::Triangle, material)))
        .chain(number_discs(scene).map(|material| (ShapeKind::Sphere, material)))
}

/// Per ball the material of the discs with its number, or its own; empty if no ball has such discs.
fn number_discs(scene: &CompiledScene) -> impl Iterator<Item = &MaterialData> {
    let has_discs = (scene.materials.iter()).any(|m| m.number_disc().is_some());
    let balls = if has_discs { &scene.spheres[..] } else { &[] };
    balls.iter().map(|ball| {
        let own = &scene.materials[ball.material as usize];
        let disc = own.number_disc();
        disc.map_or(own, |disc| &scene.materials[disc as usize])
    })
}

fn microfacet_rows(scene: &CompiledScene) -> Vec<MicrofacetRow> {
    let is_other = |m: &MaterialData| matches!(m.kind, KIND_LAYERED | KIND_METALLIC_ROUGHNESS);
    if scene.materials.iter().all(is_other) {
        return Vec::new();
    }
    materials(scene).map(microfacet_row).collect()
}

fn nee_boundary_rows(scene: &CompiledScene) -> Vec<NeeBoundaryRow> {
    if scene
        .spheres
        .iter()
        .all(|ball| ball.allows_refracted_nee == 0)
    {
        return Vec::new();
    }
    materials(scene)
        .zip(&scene.spheres)
        .map(|(material, ball)| nee_boundary_row(ball, material))
        .collect()
}

fn texture_rows(scene: &CompiledScene) -> Vec<TextureRow> {
    if scene.materials.iter().all(|m| m.pattern == PATTERN_NONE) {
        return Vec::new();
    }
    let balls = (scene.spheres.iter()).map(|ball| Some((ball.number_axis, ball.stripe_axis)));
    let discs = number_discs(scene).zip(balls.clone());
    let others = scene.boxes.len() + scene.discs.len() + scene.rectangles.len();
    let faces = (0..scene.csg_faces.len() as u32).map(|face| {
        let (axis, end) = scene.cone_axis(face)?;
        Some((axis.as_vec3().to_array(), [end as f32; 3]))
    });
    let of_triangles = match scene.meshes.triangles.is_empty() {
        true => 0,
        false => scene.materials.len(),
    };
    let axes = balls.chain(std::iter::repeat_n(None, others)).chain(faces);
    let axes = axes.chain(std::iter::repeat_n(None, of_triangles));
    let axes = axes.chain(discs.map(|(_, axes)| axes));
    materials(scene)
        .zip(axes)
        .map(|(material, axes)| texture_row(material, axes))
        .collect()
}

fn sheen_rows(scene: &CompiledScene) -> Vec<SheenRow> {
    // The sheen of glTF's material is in its own table.
    let is_napped = |m: &MaterialData| m.kind == KIND_LAYERED && m.sheen != [0.0; 3];
    if !scene.materials.iter().any(is_napped) {
        return Vec::new();
    }
    materials(scene)
        .map(|m| match is_napped(m) {
            true => [m.sheen[0], m.sheen[1], m.sheen[2], m.sheen_roughness],
            false => [0.0, 0.0, 0.0, 1.0],
        })
        .collect()
}

fn row(
    first: [f32; 3],
    second: [f32; 3],
    kind: f32,
    m: &MaterialData,
    axis: [f32; 3],
) -> SurfaceRow {
    let mut row = [0.0; 20];
    row[FIRST..][..3].copy_from_slice(&first);
    row[SECOND..][..3].copy_from_slice(&second);
    row[KIND] = kind;
    if m.kind == KIND_LAYERED {
        row[IOR] = m.ior;
        row[COAT_ALPHA] = m.alpha;
    }
    row[ALBEDO..][..3].copy_from_slice(&m.albedo);
    row[DIFFUSE_SCALE] = m.diffuse_scale;
    row[STRIPE_ALBEDO..][..3].copy_from_slice(&m.stripe_albedo);
    // Only balls have stripes.
    if kind == KIND_SPHERE {
        row[STRIPE_HALF_WIDTH] = m.stripe_half_width;
    }
    row[STRIPE_AXIS..][..3].copy_from_slice(&axis);
    row
}

/// `normal`, replaced by that of the cylinder or cone in lanes that hit one.
#[inline(always)]
fn round_normal<S: Simd>(
    kind: Float<S>,
    position: Vec3x<S>,
    first: Vec3x<S>,
    second: Vec3x<S>,
    mut normal: Vec3x<S>,
) -> Vec3x<S> {
    let (x, y) = (position.x - first.x, position.y - first.y);
    let cylinder = kind.simd_eq(KIND_CYLINDER);
    if cylinder.any_true() {
        // By the point's own distance from the axis instead of the radius, so that the length is 1 despite
        // rounding.
        let per_radius = -1.0 / x.mul_add(x, y * y).sqrt();
        let inwards = Vec3x::new(x * per_radius, y * per_radius, x * 0.0);
        normal = Vec3x::select(cylinder, inwards, normal);
    }
    let cone = kind.simd_eq(KIND_CONE_Z);
    if cone.any_true() {
        let outwards = cone_normal(position, first, second);
        normal = Vec3x::select(cone, outwards, normal);
    }
    let cone = kind.simd_eq(KIND_CONE_X);
    if cone.any_true() {
        // Cyclic permutation, which preserves handedness; the permutation after the call is its inverse.
        let axis_last = Vec3x::new(position.y, position.z, position.x);
        let n = cone_normal(axis_last, first, second);
        normal = Vec3x::select(cone, Vec3x::new(n.z, n.x, n.y), normal);
    }
    let cone = kind.simd_eq(KIND_CONE_Y);
    if cone.any_true() {
        let axis_last = Vec3x::new(position.z, position.x, position.y);
        let n = cone_normal(axis_last, first, second);
        normal = Vec3x::select(cone, Vec3x::new(n.y, n.z, n.x), normal);
    }
    let cone = kind.simd_eq(KIND_APEX_CONE);
    if cone.any_true() {
        let from_apex = position - first;
        // `second` is the axis times the slope of the side (radius per length), so that the unnormalised
        // normal is unit(aside) − second.
        let along = from_apex.dot(second) / second.length_squared();
        let aside = second.mul_add(-along, from_apex);
        let outwards = aside * (1.0 / aside.length_squared().sqrt()) - second;
        let outwards = outwards * (1.0 / outwards.length_squared().sqrt());
        normal = Vec3x::select(cone, outwards, normal);
    }
    normal
}

/// Normal of a cone's exterior about the third axis: of the cone or of the plane that bounds the
/// subtraction, whichever is nearer.
#[inline(always)]
fn cone_normal<S: Simd>(position: Vec3x<S>, first: Vec3x<S>, second: Vec3x<S>) -> Vec3x<S> {
    let (x, y) = (position.x - first.x, position.y - first.y);
    let from_axis = x.mul_add(x, y * y).sqrt();
    let (across, taper) = (1.0 / from_axis, second.x);
    let on_cone = Vec3x::new(x * across, y * across, -taper);
    let on_plane = Vec3x::new(second.y, second.z, taper * 0.0);
    let off_cone = from_axis - position.z.mul_add(taper, first.z);
    let beyond_squared = second.y.mul_add(second.y, second.z * second.z);
    // Both distances are squared and scaled by |beyond|², which avoids a square root and a division.
    let off_plane = x.mul_add(second.y, y * second.z) - beyond_squared;
    let plane = (off_plane * off_plane).simd_lt(off_cone * off_cone * beyond_squared);
    let outwards = Vec3x::select(plane, on_plane, on_cone);
    outwards * (1.0 / outwards.length_squared().sqrt())
}

/// Face of a box through which a ray enters, or leaves if it starts inside.
struct Face<S: Simd> {
    /// Outward from the box for entries, on the side from which the ray came.
    normal: Vec3x<S>,
    /// Corner of the box on that face.
    corner: Vec3x<S>,
}

impl<S: Simd> Face<S> {
    #[inline(always)]
    fn new(
        simd: S,
        origin: Vec3x<S>,
        direction: Vec3x<S>,
        min: Vec3x<S>,
        max: Vec3x<S>,
        within: Mask<S>,
    ) -> Self {
        let (zero, one) = (Float::splat(simd, 0.0), Float::splat(simd, 1.0));
        // copysign instead of a comparison: a ray parallel to a face has a component ±0, whose sign its
        // inverse shares.
        let forward = Vec3x::new(
            one.copysign(direction.x),
            one.copysign(direction.y),
            one.copysign(direction.z),
        );
        let front = towards(forward, min, max);
        let back = towards(forward, max, min);
        let inverse = inverse(simd, direction);
        let entry = (front - origin).scale(inverse);
        let exit = (back - origin).scale(inverse);
        let entered = entry.x.max(entry.y).max(entry.z).simd_gt(0.0) & !within;
        // The face of the last slab entered or of the first slab left. Exits are negated, so that one
        // maximum search serves both.
        let rank = Vec3x::select(entered, entry, -exit);
        let by_x = rank.x.simd_ge(rank.y) & rank.x.simd_ge(rank.z);
        let by_y = rank.y.simd_ge(rank.z) & !by_x;
        let by_z = !(by_x | by_y);
        Self {
            normal: Vec3x::new(
                by_x.select(-forward.x, zero),
                by_y.select(-forward.y, zero),
                by_z.select(-forward.z, zero),
            ),
            corner: Vec3x::select(entered, front, back),
        }
    }

    /// Moves a point exactly onto the plane of the face.
    #[inline(always)]
    fn put(&self, simd: S, point: Vec3x<S>) -> Vec3x<S> {
        let zero = Float::splat(simd, 0.0);
        Vec3x::new(
            // A point off the plane by rounding would let the next ray start inside the box, or see another
            // box that touches it.
            self.normal.x.simd_ne(zero).select(self.corner.x, point.x),
            self.normal.y.simd_ne(zero).select(self.corner.y, point.y),
            self.normal.z.simd_ne(zero).select(self.corner.z, point.z),
        )
    }
}

/// Coordinates of `up` on axes along which the ray ascends, of `down` on the others.
#[inline(always)]
fn towards<S: Simd>(forward: Vec3x<S>, up: Vec3x<S>, down: Vec3x<S>) -> Vec3x<S> {
    Vec3x::new(
        forward.x.simd_gt(0.0).select(up.x, down.x),
        forward.y.simd_gt(0.0).select(up.y, down.y),
        forward.z.simd_gt(0.0).select(up.z, down.z),
    )
}
