//! Plain old data that back ends read of each primitive, area light, material and camera, laid out as
//! WGSL has its structs.

use bytemuck::{Pod, Zeroable};
use glam::{DVec3, Vec3, Vec4};

/// A ball. A radius of 0 hides it.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct SphereData {
    /// Centre, metres.
    pub center: [f32; 3],
    /// Radius, metres; 0 if hidden.
    pub radius: f32,
    /// Unit axis of the stripe in world space.
    pub stripe_axis: [f32; 3],
    /// Index of its material.
    pub material: u32,
    /// Unit axis through the circles of its number in world space.
    pub number_axis: [f32; 3],
    /// 1 if light that is scattered inside aims at area lights through the boundary
    /// ([`crate::scalar::refracted_nee`]), else 0: it is smooth, and all area lights look down on the whole ball
    /// from half a radius above or more, so that none is seen from inside, straight, that is not from
    /// where light leaves, or much larger.
    pub allows_refracted_nee: u32,
}

impl SphereData {
    /// Steps of the search for a refracted path to a light: the last moves the ray by less than
    /// 1e-4 of the outer point's distance from the ball, which is what rounding to f32 does to it.
    pub const REFRACTED_NEE_STEPS: u32 = 6;
}

/// An axis-aligned box.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct BoxData {
    /// Smallest corner, metres.
    pub min: [f32; 3],
    /// Index of its material.
    pub material: u32,
    /// Largest corner, metres.
    pub max: [f32; 3],
    /// 0.
    pub padding: u32,
}

/// A box with solids subtracted.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct CsgBoxData {
    /// Smallest corner, metres.
    pub min: [f32; 3],
    /// Index of its first face, that of the box itself; its subtractions follow.
    pub first_face: u32,
    /// Largest corner, metres.
    pub max: [f32; 3],
    /// How many faces it has, the box's among them.
    pub face_count: u32,
}

/// [`CsgFaceData::kind`] of a CSG box itself: `a` and `b` are its corners.
pub const CSG_FACE_OUTER_BOX: u32 = 0;
/// [`CsgFaceData::kind`] of a plane: `a` is its normal out of the body, `b[0]` its distance from the
/// origin along it.
pub const CSG_FACE_PLANE: u32 = 1;
/// [`CsgFaceData::kind`] of a cylinder: `a` is a point of its axis, `b[0]` its radius.
pub const CSG_FACE_CYLINDER: u32 = 2;
/// [`CsgFaceData::kind`] of a subtracted box: `a` and `b` are its corners.
pub const CSG_FACE_INNER_BOX: u32 = 3;

/// [`CsgFaceData::kind`] of an upright cone's exterior: `a` is its axis in x and y and the radius at z = 0, `b` is
/// by how much that grows with z, and the x and y from the axis to the plane that it begins beyond.
pub const CSG_FACE_CONE_Z: u32 = 4;
/// All outside a cone that opens from the apex `a` along `b`, whose length is the slope of its side.
pub const CSG_FACE_APEX_CONE: u32 = 5;
/// [`CSG_FACE_CONE_Z`] along x: in its numbers y, z and x stand for x, y and z.
pub const CSG_FACE_CONE_X: u32 = 6;
/// [`CSG_FACE_CONE_Z`] along y: in its numbers z, x and y stand for x, y and z.
pub const CSG_FACE_CONE_Y: u32 = 7;

/// A surface of a CSG box.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct CsgFaceData {
    /// See the kinds.
    pub a: [f32; 3],
    /// [`CSG_FACE_OUTER_BOX`], [`CSG_FACE_PLANE`], [`CSG_FACE_CYLINDER`], [`CSG_FACE_INNER_BOX`],
    /// [`CSG_FACE_CONE_X`], [`CSG_FACE_CONE_Y`], [`CSG_FACE_CONE_Z`] or [`CSG_FACE_APEX_CONE`].
    pub kind: u32,
    /// See the kinds.
    pub b: [f32; 3],
    /// Index of its material.
    pub material: u32,
}

/// A round disc.
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
    /// 0.
    pub padding: u32,
}

/// A triangle of a mesh. One without area is hidden.
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
    /// [`TriangleData::normals`] of a facet, [`TriangleData::uvs`] of one without.
    pub const FLAT: u32 = u32::MAX;

    /// Its corners, metres.
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
    /// 0.
    pub padding0: u32,
    /// At [`TriangleData::b`].
    pub b: [f32; 3],
    /// 0.
    pub padding1: u32,
    /// At [`TriangleData::c`].
    pub c: [f32; 3],
    /// 0.
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
    /// Side of a square of texture over that of the square of surface that it covers, m⁻¹; 0 of a triangle without
    /// area.
    pub density: f32,
    /// 0.
    pub padding: u32,
}

/// Colours at the corners of a triangle, linear: red and green, blue and alpha, each a 16-bit share of 1, red and blue lowest.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq, Pod, Zeroable)]
pub struct TriangleColors {
    /// At [`TriangleData::a`].
    pub a: [u32; 2],
    /// At [`TriangleData::b`].
    pub b: [u32; 2],
    /// At [`TriangleData::c`].
    pub c: [u32; 2],
    /// 0.
    pub padding: [u32; 2],
}

impl TriangleColors {
    /// White, and there.
    pub const WHITE: Self = Self {
        a: [u32::MAX; 2],
        b: [u32::MAX; 2],
        c: [u32::MAX; 2],
        padding: [0; 2],
    };

    /// Of colours in [0, 1].
    pub fn new(corners: [Vec4; 3]) -> Self {
        let [a, b, c] = corners.map(|corner| {
            let [r, g, b, a] = (corner.to_array()).map(|share| (share * 65_535.0).round() as u32);
            [r | g << 16, b | a << 16]
        });
        let padding = [0; 2];
        Self { a, b, c, padding }
    }

    /// Where corners have these weights.
    pub fn at(&self, [wa, wb, wc]: [f32; 3]) -> Vec4 {
        let corner = |[rg, ba]: [u32; 2]| {
            let share = |word: u32| (word & 0xffff) as f32 * (1.0 / 65_535.0);
            Vec4::new(share(rg), share(rg >> 16), share(ba), share(ba >> 16))
        };
        wa * corner(self.a) + wb * corner(self.b) + wc * corner(self.c)
    }
}

/// An area light, as a rectangle that emits along its normal.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct AreaLightData {
    /// Centre, metres.
    pub center: [f32; 3],
    /// Mean radiance over that of the scene's brightest area light, 0 to 1.
    pub brightness: f32,
    /// Unit vector along an edge.
    pub axis_u: [f32; 3],
    /// Half that edge, metres.
    pub length_u: f32,
    /// Unit vector along the other edge.
    pub axis_v: [f32; 3],
    /// Half the other edge, metres.
    pub length_v: f32,
    /// Unit normal, the side that emits.
    pub normal: [f32; 3],
    /// 0.
    pub padding: u32,
    /// Mean radiance, W·sr⁻¹·m⁻².
    pub radiance: [f32; 3],
    /// 0.
    pub more_padding: u32,
    /// How much higher it is where `slope`, times what lies between the centre and a point, is 1.
    pub gradient: [f32; 3],
    /// 0.
    pub padding_of_gradient: u32,
    /// `axis_u / length_u`.
    pub slope: [f32; 3],
    /// 0.
    pub padding_of_slope: u32,
}

impl AreaLightData {
    /// Whether its radiance depends on the place.
    pub fn is_graded(&self) -> bool {
        self.gradient != [0.0; 3]
    }

    /// Radiance of a point on it.
    pub fn radiance_at(&self, point: DVec3) -> DVec3 {
        let [center, radiance, gradient, slope] =
            [self.center, self.radiance, self.gradient, self.slope]
                .map(|three| Vec3::from(three).as_dvec3());
        let u = (point - center).dot(slope).clamp(-1.0, 1.0);
        radiance + u * gradient
    }

    /// One that subtends less, in sr, is sampled by area: there the solid angle is a difference of
    /// nearly equal numbers, and the two ways of sampling hardly differ.
    pub const SOLID_ANGLE_MIN: f64 = 1e-3;

    /// Half of both edges: the area light is `center + a·u + b·v`, `a, b ∈ [−1, 1]`.
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

/// The last of [`MaterialData::sights`] of a surface that is all there.
pub const OPACITY_OPAQUE: f32 = 0.0;
/// The same of one that is there where its alpha is not below the cutoff.
pub const OPACITY_MASK: f32 = 1.0;
/// The same of one that is there with its alpha as probability.
pub const OPACITY_BLEND: f32 = 2.0;

/// A material. Diffuse ones have `ior` 0 and `diffuse_scale` 1.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct MaterialData {
    /// Albedo.
    pub albedo: [f32; 3],
    /// Index of refraction of the coat or the body; 0 for none.
    pub ior: f32,
    /// Albedo inside the stripe. Of glTF's material the strength of its clear coat, the coat's GGX width and the share of light
    /// that passes the base.
    pub stripe_albedo: [f32; 3],
    /// The stripe is where `|n · stripe_axis|` is below this; 0 for none.
    pub stripe_half_width: f32,
    /// `1 / (η² (1 − F_dr,int))`. Of glTF's material what is no metal reflects at grazing angles.
    pub diffuse_scale: f32,
    /// [`KIND_LAYERED`], [`KIND_CONDUCTOR`], [`KIND_DIELECTRIC`] or [`KIND_METALLIC_ROUGHNESS`].
    pub kind: u32,
    /// GGX width α; 0 where smooth. Textures multiply its square root.
    pub alpha: f32,
    /// The rate of the exponential law that distances inside are drawn from, m⁻¹; 0 where nothing
    /// scatters. Of glTF's material the density with which [`super::EmissiveSurfaces`] draw points of surfaces of it, m⁻².
    pub sampling_density: f32,
    /// Index of refraction of a metal, real part. Of glTF's material the reflectance towards the normal of what is no metal, where
    /// a texture multiplies it before it is limited to `diffuse_scale`.
    pub eta: [f32; 3],
    /// [`PATTERN_NONE`], [`PATTERN_NUMBER`], [`PATTERN_WOOD`], [`PATTERN_PLANKS`], [`PATTERN_CLOTH`], [`PATTERN_CUE`],
    /// [`PATTERN_BRICKS`], [`PATTERN_SCOREBOARD`] or [`PATTERN_PRINT`]. The rings of wood, the butt of a cue, the darkest brick,
    /// the ink of a scoreboard and the nearest hills of a print have the stripe's albedo; a cloth has the x of its spots there.
    pub pattern: u32,
    /// Imaginary part. Of glTF's material the radiance that it emits.
    pub k: [f32; 3],
    /// A ball's number. Of metals and dielectrics the index of the material of the discs with a ball's number; 0 for none.
    pub number: u32,
    /// Extinction coefficient σt of the medium inside, m⁻¹. Of glTF's material the most that the sheen would reflect of a channel to
    /// cosines whose square roots are 0, 1/5 and 2/5; above 1 the sheen is divided by it.
    pub extinction: [f32; 3],
    /// The axis of the grain of wood and planks: 0, 1 or 2.
    pub grain_axis: u32,
    /// Scattering coefficient of the medium over `sampling_density`. Of glTF's material the same for 3/5, 4/5 and 1.
    pub scattering: [f32; 3],
    /// Width of a sheen.
    pub sheen_roughness: f32,
    /// Strength of a sheen, over 2π.
    pub sheen: [f32; 3],
    /// Share of metal of glTF's material.
    pub metallic: f32,
    /// Spacing of sights, 0 for none, and their x in end rails and y in side rails, metres; 0 where there
    /// are no mitred rails. Of a cloth the x of its line and the radius of its D. Of bricks the albedo of their mortar. Of a
    /// scoreboard y and z of its middle and the radius of its dials, of a print its middle, metres. Of glTF's material its alpha,
    /// the cutoff of that and [`OPACITY_OPAQUE`], [`OPACITY_MASK`] or [`OPACITY_BLEND`].
    pub sights: [f32; 3],
    /// Reciprocal of the size of wood's pattern, or of half a print's height; of a cloth the most that its base may reflect.
    pub scale: f32,
}

/// A camera for one image size: the ray through film position `(x, y)`, in pixels from the top
/// left, leaves `eye` along `corner + x·dx + y·dy` (not of unit length). Through point `l` of the lens, in the unit disc,
/// it leaves `eye + lens_steps·(l.x·dx + l.y·dy)` as if it went through film position `(x, y) − lens_film·l`, so that it
/// meets the others at the focus distance.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct CameraFrame {
    /// The pinhole or the middle of the lens, metres.
    pub eye: [f32; 3],
    /// Radius of the lens in steps of `dx`; 0 for a pinhole.
    pub lens_steps: f32,
    /// Direction of the film's top left corner.
    pub corner: [f32; 3],
    /// `lens_steps` over the focus distance in metres: the radius of the lens as the point in focus sees it, in pixels.
    pub lens_film: f32,
    /// Step of one pixel to the right.
    pub dx: [f32; 3],
    /// Distance of the near plane along the view, metres: rays begin at `eye + near_m·direction`.
    pub near_m: f32,
    /// Step of one pixel down.
    pub dy: [f32; 3],
    /// 0.
    pub padding3: u32,
}
