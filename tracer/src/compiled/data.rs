//! Plain-old-data structures of primitives, area lights, materials and cameras, in the layout of the
//! corresponding WGSL structs.

use bytemuck::{Pod, Zeroable};
use glam::{DVec3, Vec3, Vec4};

/// A sphere. A radius of 0 hides it.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct SphereData {
    /// Centre, metres.
    pub center: [f32; 3],
    /// Radius, metres; 0 if it is hidden.
    pub radius: f32,
    /// Unit axis of the stripe, in world space.
    pub stripe_axis: [f32; 3],
    /// Index of its material.
    pub material: u32,
    /// Unit axis through the number circles, in world space.
    pub number_axis: [f32; 3],
    /// 1 if next-event estimation connects points inside to area lights through the boundary
    /// ([`crate::scalar::refracted_nee`]), else 0. Requires a smooth boundary, and that the plane of
    /// every area light lies at least half a radius above the whole ball, facing it: then a light's solid
    /// angle from an inner point, by which it is sampled, is positive wherever it is from the exit point,
    /// and of similar size.
    pub allows_refracted_nee: u32,
}

impl SphereData {
    /// Iterations of the search for a refracted path to a light: the last moves the ray by less than
    /// 1e-4 of the outer point's distance from the ball, the order of its rounding to f32.
    pub const REFRACTED_NEE_STEPS: u32 = 6;
}

/// An axis-aligned box.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct BoxData {
    /// Minimum corner, metres.
    pub min: [f32; 3],
    /// Index of its material.
    pub material: u32,
    /// Maximum corner, metres.
    pub max: [f32; 3],
    /// Padding, 0.
    pub padding: u32,
}

/// A box with subtracted solids (CSG).
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct CsgBoxData {
    /// Minimum corner, metres.
    pub min: [f32; 3],
    /// Index of its first face, the box itself; its subtractions follow.
    pub first_face: u32,
    /// Maximum corner, metres.
    pub max: [f32; 3],
    /// Number of its faces, including the box.
    pub face_count: u32,
}

/// [`CsgFaceData::kind`] of the CSG box itself: `a` and `b` are its corners.
pub const CSG_FACE_OUTER_BOX: u32 = 0;
/// [`CsgFaceData::kind`] of a plane: `a` is its normal out of the body, `b[0]` its distance from the
/// origin along the normal, metres.
pub const CSG_FACE_PLANE: u32 = 1;
/// [`CsgFaceData::kind`] of a vertical cylinder: `a` is a point on its axis, `b[0]` its radius, metres.
pub const CSG_FACE_CYLINDER: u32 = 2;
/// [`CsgFaceData::kind`] of a subtracted box: `a` and `b` are its corners.
pub const CSG_FACE_INNER_BOX: u32 = 3;

/// [`CsgFaceData::kind`] of a vertical cone's exterior: `a` contains the x and y of its axis and the radius
/// at z = 0; `b` the increase of the radius per z, and the x and y of the vector from the axis to the plane
/// beyond which the subtraction begins.
pub const CSG_FACE_CONE_Z: u32 = 4;
/// [`CsgFaceData::kind`] of the exterior of a cone that opens from the apex `a` along `b`, whose length is
/// the slope of its side (radius per length).
pub const CSG_FACE_APEX_CONE: u32 = 5;
/// [`CSG_FACE_CONE_Z`] along x: y, z and x take the places of x, y and z.
pub const CSG_FACE_CONE_X: u32 = 6;
/// [`CSG_FACE_CONE_Z`] along y: z, x and y take the places of x, y and z.
pub const CSG_FACE_CONE_Y: u32 = 7;

/// A face of a CSG box.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct CsgFaceData {
    /// See the constants of `kind`.
    pub a: [f32; 3],
    /// [`CSG_FACE_OUTER_BOX`], [`CSG_FACE_PLANE`], [`CSG_FACE_CYLINDER`], [`CSG_FACE_INNER_BOX`],
    /// [`CSG_FACE_CONE_X`], [`CSG_FACE_CONE_Y`], [`CSG_FACE_CONE_Z`] or [`CSG_FACE_APEX_CONE`].
    pub kind: u32,
    /// See the constants of `kind`.
    pub b: [f32; 3],
    /// Index of its material.
    pub material: u32,
}

/// A disc.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct DiscData {
    /// Centre, metres.
    pub center: [f32; 3],
    /// Radius, metres.
    pub radius: f32,
    /// Unit normal.
    pub normal: [f32; 3],
    /// Index of its material.
    pub material: u32,
}

/// A rectangle: `center + a·half_u + b·half_v`, `a, b ∈ [−1, 1]`.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct RectangleData {
    /// Centre, metres.
    pub center: [f32; 3],
    /// Index of its material.
    pub material: u32,
    /// Half an edge, metres.
    pub half_u: [f32; 3],
    /// `1 / |half_u|²`.
    pub inv_u2: f32,
    /// Half the other edge, metres.
    pub half_v: [f32; 3],
    /// `1 / |half_v|²`.
    pub inv_v2: f32,
    /// Unit normal, along `half_u × half_v`.
    pub normal: [f32; 3],
    /// Padding, 0.
    pub padding: u32,
}

/// A triangle of a mesh. A degenerate one is hidden.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct TriangleData {
    /// A corner, metres.
    pub a: [f32; 3],
    /// Index of its material.
    pub material: u32,
    /// The next corner, metres.
    pub b: [f32; 3],
    /// Index of its vertex normals in [`super::CompiledMeshes::normals`]; [`TriangleData::FLAT`] for none.
    pub normals: u32,
    /// The last corner, metres.
    pub c: [f32; 3],
    /// Index of its texture coordinates in [`super::CompiledMeshes::uvs`]; [`TriangleData::FLAT`] for none.
    pub uvs: u32,
}

impl TriangleData {
    /// [`TriangleData::normals`] of a facet, [`TriangleData::uvs`] of a triangle without texture
    /// coordinates.
    pub const FLAT: u32 = u32::MAX;

    /// The corners, metres.
    pub fn corners(&self) -> [Vec3; 3] {
        [self.a, self.b, self.c].map(Vec3::from)
    }
}

/// Unit normals at the corners of a triangle.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct TriangleNormals {
    /// At [`TriangleData::a`].
    pub a: [f32; 3],
    /// Padding, 0.
    pub padding0: u32,
    /// At [`TriangleData::b`].
    pub b: [f32; 3],
    /// Padding, 0.
    pub padding1: u32,
    /// At [`TriangleData::c`].
    pub c: [f32; 3],
    /// Padding, 0.
    pub padding2: u32,
}

/// Texture coordinates at the corners of a triangle.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct TriangleUvs {
    /// At [`TriangleData::a`].
    pub a: [f32; 2],
    /// At [`TriangleData::b`].
    pub b: [f32; 2],
    /// At [`TriangleData::c`].
    pub c: [f32; 2],
    /// Texture length per surface length, m⁻¹: the square root of the ratio of areas; 0 for a degenerate
    /// triangle.
    pub density: f32,
    /// Padding, 0.
    pub padding: u32,
}

/// Linear colours at the corners of a triangle, as two words each: red (low) and green, blue (low) and
/// alpha, each 16 bits for [0, 1].
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq, Pod, Zeroable)]
pub struct TriangleColors {
    /// At [`TriangleData::a`].
    pub a: [u32; 2],
    /// At [`TriangleData::b`].
    pub b: [u32; 2],
    /// At [`TriangleData::c`].
    pub c: [u32; 2],
    /// Padding, 0.
    pub padding: [u32; 2],
}

impl TriangleColors {
    /// White and opaque.
    pub const WHITE: Self = Self {
        a: [u32::MAX; 2],
        b: [u32::MAX; 2],
        c: [u32::MAX; 2],
        padding: [0; 2],
    };

    /// Packs colours in [0, 1].
    pub fn new(corners: [Vec4; 3]) -> Self {
        let [a, b, c] = corners.map(|corner| {
            let [r, g, b, a] = (corner.to_array()).map(|share| (share * 65_535.0).round() as u32);
            [r | g << 16, b | a << 16]
        });
        let padding = [0; 2];
        Self { a, b, c, padding }
    }

    /// Colour at these barycentric coordinates.
    pub fn at(&self, [wa, wb, wc]: [f32; 3]) -> Vec4 {
        let corner = |[rg, ba]: [u32; 2]| {
            let share = |word: u32| (word & 0xffff) as f32 * (1.0 / 65_535.0);
            Vec4::new(share(rg), share(rg >> 16), share(ba), share(ba >> 16))
        };
        wa * corner(self.a) + wb * corner(self.b) + wc * corner(self.c)
    }
}

/// An area light: a rectangle that emits on the side of its normal.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct AreaLightData {
    /// Centre, metres.
    pub center: [f32; 3],
    /// Mean radiance over channels and area, relative to that of the scene's brightest area light, 0 to 1.
    pub brightness: f32,
    /// Unit vector along the first edge.
    pub axis_u: [f32; 3],
    /// Half the length of the first edge, metres.
    pub length_u: f32,
    /// Unit vector along the second edge.
    pub axis_v: [f32; 3],
    /// Half the length of the second edge, metres.
    pub length_v: f32,
    /// Unit normal on the emitting side.
    pub normal: [f32; 3],
    /// Padding, 0.
    pub padding: u32,
    /// Mean radiance, W·sr⁻¹·m⁻².
    pub radiance: [f32; 3],
    /// Padding, 0.
    pub more_padding: u32,
    /// Increase of the radiance from the centre to the end of the first edge, where the product of `slope`
    /// and the offset is 1.
    pub gradient: [f32; 3],
    /// Padding, 0.
    pub padding_of_gradient: u32,
    /// `axis_u / length_u`, m⁻¹.
    pub slope: [f32; 3],
    /// Padding, 0.
    pub padding_of_slope: u32,
}

impl AreaLightData {
    /// Whether its radiance varies along the first edge.
    pub fn is_graded(&self) -> bool {
        self.gradient != [0.0; 3]
    }

    /// Radiance emitted at a point of the light, W·sr⁻¹·m⁻².
    pub fn radiance_at(&self, point: DVec3) -> DVec3 {
        let [center, radiance, gradient, slope] =
            [self.center, self.radiance, self.gradient, self.slope]
                .map(|three| Vec3::from(three).as_dvec3());
        let u = (point - center).dot(slope).clamp(-1.0, 1.0);
        radiance + u * gradient
    }

    /// Solid angle, sr, below which a light is sampled by area: there the exact solid angle is a difference
    /// of nearly equal numbers, and both sampling methods hardly differ.
    pub const SOLID_ANGLE_MIN: f64 = 1e-3;

    /// Half edges `u` and `v`, metres: the area light is `center + a·u + b·v`, `a, b ∈ [−1, 1]`.
    pub fn half_edges(&self) -> [[f32; 3]; 2] {
        let [u, v] = [(self.axis_u, self.length_u), (self.axis_v, self.length_v)];
        [u, v].map(|(axis, length)| axis.map(|c| c * length))
    }
}

/// [`MaterialData::kind`] of a diffuse surface, bare or coated.
pub const KIND_LAYERED: u32 = 0;
/// [`MaterialData::kind`] of a metal.
pub const KIND_CONDUCTOR: u32 = 1;
/// [`MaterialData::kind`] of a dielectric.
pub const KIND_DIELECTRIC: u32 = 2;

/// [`MaterialData::kind`] of glTF's material.
pub const KIND_METALLIC_ROUGHNESS: u32 = 3;

/// [`MaterialData::pattern`] of plain and striped materials.
pub const PATTERN_NONE: u32 = 0;
/// [`MaterialData::pattern`] of numbered balls.
pub const PATTERN_NUMBER: u32 = 1;
/// [`MaterialData::pattern`] of wood.
pub const PATTERN_WOOD: u32 = 2;
/// [`MaterialData::pattern`] of planks.
pub const PATTERN_PLANKS: u32 = 3;
/// [`MaterialData::pattern`] of a table's cloth with its marks.
pub const PATTERN_CLOTH: u32 = 4;
/// [`MaterialData::pattern`] of a cue.
pub const PATTERN_CUE: u32 = 5;
/// [`MaterialData::pattern`] of bricks.
pub const PATTERN_BRICKS: u32 = 6;
/// [`MaterialData::pattern`] of a scoreboard.
pub const PATTERN_SCOREBOARD: u32 = 7;
/// [`MaterialData::pattern`] of a print.
pub const PATTERN_PRINT: u32 = 8;

/// Last number of [`MaterialData::sights`]: opaque.
pub const OPACITY_OPAQUE: f32 = 0.0;
/// Last number of [`MaterialData::sights`]: opaque where alpha is at least the cutoff.
pub const OPACITY_MASK: f32 = 1.0;
/// Last number of [`MaterialData::sights`]: alpha is the probability of a hit.
pub const OPACITY_BLEND: f32 = 2.0;

/// A material. The meaning of several fields depends on [`MaterialData::kind`] and
/// [`MaterialData::pattern`]. Diffuse materials have `ior` 0 and `diffuse_scale` 1.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct MaterialData {
    /// Albedo.
    pub albedo: [f32; 3],
    /// Index of refraction of the coat or the body; 0 for neither.
    pub ior: f32,
    /// Albedo inside the stripe. For glTF's material the strength of its clear coat, the coat's GGX width
    /// and the transmission.
    pub stripe_albedo: [f32; 3],
    /// Half width of the stripe, which is where `|n · stripe_axis|` is below it; 0 for none.
    pub stripe_half_width: f32,
    /// `1 / (η² (1 − F_dr,int))`. For glTF's material the dielectric part's reflectance at grazing
    /// incidence.
    pub diffuse_scale: f32,
    /// [`KIND_LAYERED`], [`KIND_CONDUCTOR`], [`KIND_DIELECTRIC`] or [`KIND_METALLIC_ROUGHNESS`].
    pub kind: u32,
    /// GGX width α; 0 for a smooth surface. Textures multiply its square root.
    pub alpha: f32,
    /// Rate of the exponential distribution of free-flight distances inside, m⁻¹; 0 without scattering. For
    /// glTF's material the density with which [`super::EmissiveSurfaces`] draw points on its surfaces, m⁻².
    pub sampling_density: f32,
    /// Real part of a metal's index of refraction. For glTF's material the dielectric part's reflectance at
    /// normal incidence; if a texture multiplies it, it is not yet clamped to `diffuse_scale`.
    pub eta: [f32; 3],
    /// [`PATTERN_NONE`], [`PATTERN_NUMBER`], [`PATTERN_WOOD`], [`PATTERN_PLANKS`], [`PATTERN_CLOTH`],
    /// [`PATTERN_CUE`], [`PATTERN_BRICKS`], [`PATTERN_SCOREBOARD`] or [`PATTERN_PRINT`]. `stripe_albedo` is
    /// the albedo of a wood's rings, a cue's butt, the darkest bricks, a scoreboard's ink and a print's
    /// nearest hills; for a cloth, the x of its spots.
    pub pattern: u32,
    /// Imaginary part of a metal's index of refraction. For glTF's material the emitted radiance,
    /// W·sr⁻¹·m⁻².
    pub k: [f32; 3],
    /// Number on a ball. For metals and dielectrics the index of the material of the discs with a ball's
    /// number; 0 for none.
    pub number: u32,
    /// Extinction coefficient σt of the interior medium, m⁻¹. For glTF's material the largest channel of
    /// the sheen's directional albedo at cosines whose square roots are 0, 1/5 and 2/5; where that exceeds
    /// 1, the sheen is divided by it.
    pub extinction: [f32; 3],
    /// Coordinate axis of the grain of wood and planks: 0, 1 or 2.
    pub grain_axis: u32,
    /// Scattering coefficient of the interior medium over `sampling_density`. For glTF's material the
    /// continuation of `extinction` for 3/5, 4/5 and 1.
    pub scattering: [f32; 3],
    /// Width of the sheen distribution.
    pub sheen_roughness: f32,
    /// Sheen colour over 2π.
    pub sheen: [f32; 3],
    /// Metallic share of glTF's material.
    pub metallic: f32,
    /// For wood the spacing of sights (0 for none), their x in end rails and y in side rails, metres; 0
    /// without mitred rails. For a cloth the x of its line and the radius of its D. For bricks the albedo
    /// of their mortar. For a scoreboard y and z of its centre and the radius of its dials, for a print its
    /// centre, metres. For glTF's material alpha, its cutoff, and [`OPACITY_OPAQUE`], [`OPACITY_MASK`] or
    /// [`OPACITY_BLEND`].
    pub sights: [f32; 3],
    /// Reciprocal of the scale of wood's pattern, or of half a print's height, m⁻¹; for a cloth the largest
    /// albedo of its base.
    pub scale: f32,
}

/// A camera for one image size: the ray through film position `(x, y)`, in pixels from the top left, leaves
/// `eye` along `corner + x·dx + y·dy` (not normalised). Through point `l` of the lens, in the unit disc, it
/// leaves `eye + lens_steps·(l.x·dx + l.y·dy)` as if it went through film position `(x, y) − lens_film·l`,
/// so that all rays of a film position meet at the focus distance.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct CameraFrame {
    /// Pinhole or centre of the lens, metres.
    pub eye: [f32; 3],
    /// Radius of the lens in units of the length of `dx`; 0 for a pinhole.
    pub lens_steps: f32,
    /// Direction of the film's top left corner.
    pub corner: [f32; 3],
    /// `lens_steps` over the focus distance in metres: radius of the lens projected onto the film from the
    /// focus, in pixels.
    pub lens_film: f32,
    /// Step of one pixel to the right.
    pub dx: [f32; 3],
    /// Distance of the near plane along the viewing direction, metres: rays begin at
    /// `eye + near_m·direction`.
    pub near_m: f32,
    /// Step of one pixel down.
    pub dy: [f32; 3],
    /// Padding, 0.
    pub padding3: u32,
}
