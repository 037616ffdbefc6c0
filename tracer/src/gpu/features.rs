//! Features of a scene that a kernel is built for: what it has none of is left out.

use crate::bvh::Bvh;
use crate::compiled::clusters::Clusters;
use crate::compiled::{
    AreaLightData, BoxData, CSG_FACE_APEX_CONE, CSG_FACE_CONE_X, CSG_FACE_CONE_Y, CSG_FACE_CONE_Z,
    CompiledScene, CsgBoxData, CsgFaceData, KIND_CONDUCTOR, KIND_DIELECTRIC, KIND_LAYERED,
    KIND_METALLIC_ROUGHNESS, LayerTextureData, MaterialData, PATTERN_NONE, PATTERN_NUMBER,
    ShapeKind, SphereData,
};
use crate::gpu::coplanar;

impl ShapeKind {
    const fn names(self) -> [&'static str; 3] {
        match self {
            Self::Sphere => ["sphere", "SPHERE", "spheres"],
            Self::Box => ["box", "BOX", "boxes"],
            Self::Disc => ["disc", "DISC", "discs"],
            Self::Rectangle => ["rectangle", "RECTANGLE", "rectangles"],
            Self::CsgFace => ["csg_face", "CSG_FACE", "csg_faces"],
            Self::Triangle => ["triangle", "TRIANGLE", "triangles"],
        }
    }

    /// The prefix or suffix of its functions in WGSL.
    pub(crate) const fn function(self) -> &'static str {
        self.names()[0]
    }

    /// The prefix of its constants in WGSL.
    pub(crate) const fn constant(self) -> &'static str {
        self.names()[1]
    }

    /// Its array in the scene.
    pub(crate) const fn array(self) -> &'static str {
        self.names()[2]
    }

    /// The buffer that holds its primitives, and what rays find them by: triangles, which are many and seldom
    /// change, have one of their own.
    pub(crate) const fn buffer(self) -> &'static str {
        match self {
            Self::Triangle => "mesh",
            _ => "scene",
        }
    }
}

/// Where the scene's arrays lie on the device.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(crate) enum SceneMemory {
    /// Constant memory: 5–7 times faster on software Vulkan, but small.
    Uniform,
    /// Any memory.
    Storage,
}

/// What the kernel finds for each pixel: the mean over its samples of
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(crate) enum KernelOutput {
    /// radiance,
    Radiance,
    /// radiance without what is in [`crate::Aovs::emission`],
    Reflected,
    /// or its [`crate::Aovs`].
    Aovs,
}

impl KernelOutput {
    pub(crate) const ALL: [Self; 3] = [Self::Radiance, Self::Reflected, Self::Aovs];

    /// Its name in WGSL.
    pub(crate) const fn constant(self) -> &'static str {
        match self {
            Self::Radiance => "OUTPUT_RADIANCE",
            Self::Reflected => "OUTPUT_REFLECTED",
            Self::Aovs => "OUTPUT_AOVS",
        }
    }

    /// Numbers of a pixel.
    pub(crate) const fn floats(self) -> usize {
        match self {
            Self::Radiance | Self::Reflected => 3,
            Self::Aovs => 10,
        }
    }

    /// Bytes of a pixel.
    pub(crate) const fn pixel_bytes(self) -> u64 {
        (self.floats() * size_of::<f32>()) as u64
    }
}

/// The key of a kernel: scenes with the same features share one.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(crate) struct Features {
    /// Primitives of each shape, in the order of [`ShapeKind::ALL`].
    pub(crate) counts: [u32; ShapeKind::ALL.len()],
    /// CSG boxes, which the faces belong to.
    pub(crate) csg_boxes: u32,
    /// Triangles with vertex normals.
    pub(crate) smooth_triangles: u32,
    /// Some are of dielectrics.
    pub(crate) has_dielectric_mesh: bool,
    /// Those with texture coordinates, if any material has a texture.
    pub(crate) uv_triangles: u32,
    /// Image textures and views of them, if any material has one.
    pub(crate) textures: u32,
    /// Materials that may have one: those of particles follow them.
    pub(crate) textured_materials: u32,
    /// Some have textures of their sheen or specular reflection.
    pub(crate) has_layer_factors: bool,
    /// Some clear coat has another normal than what is below.
    pub(crate) has_coat_normals: bool,
    /// Those up to the last with vertex colours.
    pub(crate) colored_triangles: u32,
    /// Rays pass some.
    pub(crate) has_opacity: bool,
    /// Pixels across and down the environment map; 0 without.
    pub(crate) environment_map: [u32; 2],
    pub(crate) area_lights: u32,
    /// Surfaces that emit, of each shape.
    pub(crate) emissive_surfaces: [u32; ShapeKind::ALL.len()],
    /// Their probability in light sampling.
    pub(crate) emissive_surface_sixteenths: u32,
    /// Some surface emits.
    pub(crate) has_emission: bool,
    /// Lights without extent.
    pub(crate) punctual_lights: u32,
    /// Their probability in light sampling, in halves.
    pub(crate) punctual_halves: u32,
    /// At least 1: an array has no length of 0.
    pub(crate) materials: u32,
    /// Rays find the primitives of a shape by a BVH.
    pub(crate) bvhs: [bool; ShapeKind::ALL.len()],
    /// Of boxes, if rays do not find them by a BVH, and of CSG boxes.
    pub(crate) box_clusters: Clusters,
    pub(crate) csg_clusters: Clusters,
    /// Some CSG box has a cone's exterior.
    pub(crate) has_csg_cone: bool,
    /// Some material has a dielectric coat.
    pub(crate) has_coat: bool,
    /// Some coat is rough.
    pub(crate) has_rough_coat: bool,
    /// Some material has a stripe.
    pub(crate) has_stripe: bool,
    /// Some ball has a number.
    pub(crate) has_number: bool,
    /// Some ball of metal or a dielectric has its number on discs of another material.
    pub(crate) has_number_disc: bool,
    /// Some material is wood, marked cloth or a cue.
    pub(crate) has_wood: bool,
    /// Some material is napped.
    pub(crate) has_sheen: bool,
    /// Some material is a conductor or a dielectric.
    pub(crate) has_microfacet: bool,
    /// Some material is a dielectric.
    pub(crate) has_dielectric: bool,
    /// Some material is that of glTF.
    pub(crate) has_metallic_roughness: bool,
    /// Some of that has a clear coat or a sheen.
    pub(crate) has_layers: bool,
    /// Some of that is a thin wall.
    pub(crate) has_thin_walls: bool,
    /// Some thin wall has a texture of its transmission.
    pub(crate) has_transmission_textures: bool,
    /// Some ball may allow refracted NEE: its material is a smooth dielectric and scatters light inside.
    pub(crate) has_refracted_nee: bool,
    pub(crate) output: KernelOutput,
    /// Balls are so far from the origin that the rounding of coordinates shows.
    pub(crate) is_compensated: bool,
    /// All discs lie in one plane, which a ray meets once, and are not so far from the origin for
    /// their size that rounding there shows.
    pub(crate) discs_coplanar: bool,
    /// The same of area lights.
    pub(crate) area_lights_coplanar: bool,
    /// Some area light may be before the face of another, or before another light.
    pub(crate) area_lights_occlude: bool,
    /// The radiance of some area light depends on the place.
    pub(crate) area_lights_graded: bool,
    /// Solid angles in metres would leave the range of f32.
    pub(crate) area_lights_scaled: bool,
    pub(crate) memory: SceneMemory,
    /// Blocks of pixels that a workgroup traces.
    pub(crate) workgroup_blocks: u32,
}

impl Features {
    /// Of a shape that has some.
    pub(crate) fn clusters(&self, shape: ShapeKind) -> Clusters {
        match shape {
            ShapeKind::Box => self.box_clusters,
            ShapeKind::CsgFace => self.csg_clusters,
            _ => Clusters::NONE,
        }
    }

    /// What `scene` requires, its arrays in constant memory.
    pub(crate) fn new(scene: &CompiledScene) -> Self {
        let any = |has: fn(&MaterialData) -> bool| scene.materials.iter().any(has);
        let has_textures = !(scene.textures.is_empty() || scene.meshes.uvs.is_empty());
        let textured = |count: usize| if has_textures { count as u32 } else { 0 };
        let layers = || scene.textures.layers.iter();
        let shares_light_sampling = !(scene.environment_map.is_empty()
            && scene.punctual_lights.is_empty())
            || scene.emissive_surfaces.sixteenths > 0;
        Self {
            counts: ShapeKind::ALL.map(|shape| scene.count(shape) as u32),
            csg_boxes: scene.csg_boxes.len() as u32,
            smooth_triangles: scene.meshes.normals.len() as u32,
            has_dielectric_mesh: scene.has_dielectric_mesh(),
            environment_map: [scene.environment_map.width, scene.environment_map.height],
            uv_triangles: textured(scene.meshes.uvs.len()),
            textures: textured(scene.textures.images.len()),
            textured_materials: textured(scene.textures.materials.len()),
            has_layer_factors: has_textures && layers().any(LayerTextureData::has_factors),
            has_coat_normals: has_textures && layers().any(|layers| layers.has_coat_normal == 1),
            colored_triangles: scene.meshes.colors.len() as u32,
            has_opacity: scene.alpha_test().is_some(),
            area_lights: scene.area_lights.len() as u32,
            emissive_surfaces: emissive_surfaces(scene),
            emissive_surface_sixteenths: scene.emissive_surfaces.sixteenths,
            has_emission: scene.has_emission(),
            punctual_lights: scene.punctual_lights.len() as u32,
            punctual_halves: punctual_halves(scene),
            materials: scene.materials.len().max(1) as u32,
            bvhs: ShapeKind::ALL.map(|shape| bvh(scene, shape).is_some()),
            box_clusters: match bvh(scene, ShapeKind::Box) {
                Some(_) => Clusters::NONE,
                None => scene.box_clusters,
            },
            csg_clusters: scene.csg_clusters,
            has_csg_cone: scene.csg_faces.iter().any(|face| {
                matches!(
                    face.kind,
                    CSG_FACE_CONE_X | CSG_FACE_CONE_Y | CSG_FACE_CONE_Z | CSG_FACE_APEX_CONE
                )
            }),
            has_coat: any(|material| material.kind == KIND_LAYERED && material.ior > 0.0),
            has_rough_coat: any(MaterialData::has_rough_coat),
            has_stripe: any(|material| material.stripe_half_width > 0.0),
            has_number: any(|material| material.pattern == PATTERN_NUMBER),
            has_number_disc: any(|material| material.number_disc().is_some()),
            has_wood: any(|m| !matches!(m.pattern, PATTERN_NONE | PATTERN_NUMBER)),
            has_sheen: any(|m| m.kind == KIND_LAYERED && m.sheen != [0.0; 3]),
            has_microfacet: any(|m| matches!(m.kind, KIND_CONDUCTOR | KIND_DIELECTRIC)),
            has_dielectric: any(|material| material.kind == KIND_DIELECTRIC),
            has_metallic_roughness: any(|m| m.kind == KIND_METALLIC_ROUGHNESS),
            has_layers: any(MaterialData::has_layers),
            has_thin_walls: any(MaterialData::is_thin_wall),
            has_transmission_textures: has_textures && !scene.textures.transmission.is_empty(),
            has_refracted_nee: has_refracted_nee(scene),
            output: KernelOutput::Radiance,
            is_compensated: needs_compensation(scene),
            discs_coplanar: coplanar::discs_coplanar(scene),
            area_lights_graded: (scene.area_lights.iter()).any(AreaLightData::is_graded),
            area_lights_coplanar: coplanar::area_lights_coplanar(scene),
            area_lights_occlude: coplanar::area_lights_occlude(scene)
                || (shares_light_sampling && !scene.area_lights.is_empty()),
            area_lights_scaled: needs_scale(scene),
            memory: SceneMemory::Uniform,
            workgroup_blocks: 1,
        }
    }

    /// Blocks of a workgroup on a device that takes `blocks_max`: one where a BVH makes neighbouring rays take unlike
    /// times, for which others would wait: 28 % longer for a mesh of 20,000 triangles on an H100.
    pub(crate) fn workgroup_blocks(&self, blocks_max: u32) -> u32 {
        match self.bvhs.contains(&true) {
            true => 1,
            false => blocks_max,
        }
    }

    /// Samples of a pixel whose camera rays are traced together before all else; 0 where each is when its turn comes.
    /// More leave fewer threads waiting for the last of a batch, and cost a little each: denoised pictures are of few.
    pub(crate) const fn first_hits(&self) -> u32 {
        match self.output {
            // Of BVHs, and of devices where it was not seen to pay: software Vulkan takes 14 % longer.
            _ if self.workgroup_blocks == 1 => 0,
            KernelOutput::Radiance => 32,
            KernelOutput::Reflected => 16,
            KernelOutput::Aovs => 0,
        }
    }

    /// Whether a workgroup of several blocks keeps primitives in its own memory, of which it has 32 KiB: 12 KiB are
    /// its pixels'.
    pub(crate) const fn copies_primitives(&self) -> bool {
        const BYTES_MAX: usize = 16 << 10;
        let bytes = self.count(ShapeKind::CsgFace) as usize * size_of::<CsgFaceData>()
            + self.csg_boxes as usize * size_of::<CsgBoxData>()
            + self.count(ShapeKind::Box) as usize * size_of::<BoxData>()
            + self.count(ShapeKind::Sphere) as usize * size_of::<SphereData>();
        self.workgroup_blocks > 1 && bytes <= BYTES_MAX
    }

    /// How many primitives of a shape there are.
    pub(crate) const fn count(&self, shape: ShapeKind) -> u32 {
        self.counts[shape as usize]
    }

    /// Whether light is looked for elsewhere than at area lights.
    pub(crate) const fn shares_light_sampling(&self) -> bool {
        self.has_environment_map() || self.punctual_lights > 0 || self.has_emissive_surfaces()
    }

    /// Whether light sampling aims at surfaces that emit.
    pub(crate) const fn has_emissive_surfaces(&self) -> bool {
        self.emissive_surface_sixteenths > 0
    }

    /// Surfaces that emit and are no triangles.
    pub(crate) fn emissive_shapes(&self) -> u32 {
        self.emissive_surfaces.iter().sum::<u32>() - self.emissive_triangles()
    }

    /// The shapes that some of them are of.
    pub(crate) fn emissive_kinds(&self) -> impl Iterator<Item = ShapeKind> + use<> {
        let counts = self.emissive_surfaces;
        let shapes = ShapeKind::ALL.into_iter();
        shapes.filter(move |shape| counts[*shape as usize] > 0)
    }

    /// Triangles that emit.
    pub(crate) const fn emissive_triangles(&self) -> u32 {
        self.emissive_surfaces[ShapeKind::Triangle as usize]
    }

    /// Whether there is an environment map.
    pub(crate) const fn has_environment_map(&self) -> bool {
        self.environment_map[0] > 0
    }

    /// Whether textures have more than [`crate::compiled::MaterialTextureData`].
    pub(crate) const fn has_layer_textures(&self) -> bool {
        self.has_layer_factors || self.has_coat_normals
    }

    /// Whether some triangle may be shaded with another normal than its own.
    pub(crate) const fn has_shading_normals(&self) -> bool {
        self.smooth_triangles > 0 || self.uv_triangles > 0
    }

    /// The shapes whose primitives have numbers in kernels: triangles only where there are some.
    pub(crate) fn numbered_shapes(&self) -> impl Iterator<Item = ShapeKind> + use<> {
        let has_triangles = self.count(ShapeKind::Triangle) > 0;
        let shapes = ShapeKind::ALL.into_iter();
        shapes.filter(move |shape| *shape != ShapeKind::Triangle || has_triangles)
    }

    /// The shapes that occur in the scene's own buffer.
    pub(crate) fn shapes_of_scene(&self) -> impl Iterator<Item = ShapeKind> + use<> {
        self.shapes().filter(|shape| *shape != ShapeKind::Triangle)
    }

    /// The shapes that occur.
    pub(crate) fn shapes(&self) -> impl Iterator<Item = ShapeKind> + use<> {
        let features = *self;
        ShapeKind::ALL
            .into_iter()
            .filter(move |shape| features.count(*shape) > 0)
    }

    /// Whether rays find the primitives of a shape by a BVH.
    pub(crate) const fn has_bvh(&self, shape: ShapeKind) -> bool {
        self.bvhs[shape as usize]
    }

    /// Surfaces that a ray is tested against, or about as many as going down BVHs costs.
    pub(crate) fn primitives(&self) -> u32 {
        let tested = ShapeKind::ALL.map(|shape| self.tested(shape));
        tested.iter().sum::<u32>() + self.area_lights
    }

    /// Turns that the loops of a ray take at most: those that go from subtraction to subtraction come round again, and
    /// some rays through a BVH meet four times as much as most.
    pub(crate) fn turns_per_ray(&self) -> f64 {
        let in_bvhs = ShapeKind::ALL
            .into_iter()
            .filter(|shape| self.has_bvh(*shape));
        let bvhs: u32 = in_bvhs.map(|shape| self.tested(shape)).sum();
        1.05 * f64::from(self.primitives() + 3 * bvhs + 2 * self.count(ShapeKind::CsgFace))
    }

    fn tested(&self, shape: ShapeKind) -> u32 {
        let count = self.count(shape);
        match self.has_bvh(shape) {
            true => bvh_min(shape) as u32 + 8 * count.ilog2(),
            false => count,
        }
    }
}

/// From so many on, rays find the primitives of a shape faster by a BVH: on an H200 by 1.04 (discs) to
/// 1.3 there, and for 10,000 by 10 (balls), 61, 83, 110 and 78:
/// `carom-bench bvh --backend gpu --size 960x540`.
const fn bvh_min(shape: ShapeKind) -> usize {
    match shape {
        ShapeKind::Sphere => 256,
        ShapeKind::Box => 96,
        ShapeKind::Disc => 48,
        ShapeKind::Rectangle | ShapeKind::Triangle => 32,
        ShapeKind::CsgFace => usize::MAX,
    }
}

/// The BVH by which rays find the primitives of a shape, where they do.
pub(crate) fn bvh(scene: &CompiledScene, shape: ShapeKind) -> Option<&Bvh> {
    scene.bvh(shape, bvh_min(shape))
}

fn emissive_surfaces(scene: &CompiledScene) -> [u32; ShapeKind::ALL.len()] {
    let mut counts = [0; ShapeKind::ALL.len()];
    for surface in scene.emissive_surfaces.surfaces.iter() {
        counts[surface.shape as usize] += 1;
    }
    counts
}

/// Beside surfaces that emit.
fn punctual_halves(scene: &CompiledScene) -> u32 {
    let others = 1.0 - scene.emissive_surfaces.probability();
    match others > 0.0 {
        true => (2.0 * scene.punctual_probability / others).round() as u32,
        false => 0,
    }
}

/// Whether some ball may have [`crate::compiled::SphereData::allows_refracted_nee`], wherever it moves.
fn has_refracted_nee(scene: &CompiledScene) -> bool {
    let scatters = |material: &MaterialData| {
        material.kind == KIND_DIELECTRIC && material.alpha == 0.0 && material.sampling_density > 0.0
    };
    let mut balls = scene.spheres.iter();
    let material = |ball: &SphereData| scene.materials.get(ball.material as usize);
    !scene.area_lights.is_empty() && balls.any(|ball| material(ball).is_some_and(scatters))
}

/// Whether area lights are so small or so far away that eighth powers of lengths in metres, which solid
/// angles are made of, are not well within the range of f32.
fn needs_scale(scene: &CompiledScene) -> bool {
    const METRES: std::ops::Range<f32> = 1e-3..1e3;
    let area_lights = scene.area_lights.iter();
    let mut lengths = area_lights.flat_map(|light| [light.length_u, light.length_v]);
    coplanar::farthest(scene) >= METRES.end || lengths.any(|length| length < METRES.start)
}

/// Whether the difference of two coordinates, rounded, is off by more than 2⁻¹⁵ of a radius. A
/// pool table's balls (28.6 mm) reach that 15 m from the origin.
fn needs_compensation(scene: &CompiledScene) -> bool {
    const COORDINATE_PER_RADIUS_MAX: f32 = 512.0;
    let visible = scene.spheres.iter().filter(|sphere| sphere.radius > 0.0);
    let radius_min = visible.map(|s| s.radius).fold(f32::INFINITY, f32::min);
    let centers = scene.spheres.iter().map(|s| s.center);
    let coordinates = centers.chain([scene.camera.eye.to_array()]).flatten();
    let farthest = coordinates.map(f32::abs).fold(0.0, f32::max);
    farthest > radius_min * COORDINATE_PER_RADIUS_MAX
}
