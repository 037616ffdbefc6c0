//! Features of a scene, by which its kernel is specialised: code that the scene does not need is
//! left out.

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

    /// Prefix or suffix of the shape's functions in WGSL.
    pub(crate) const fn function(self) -> &'static str {
        self.names()[0]
    }

    /// Prefix of the shape's constants in WGSL.
    pub(crate) const fn constant(self) -> &'static str {
        self.names()[1]
    }

    /// Name of the shape's array in WGSL.
    pub(crate) const fn array(self) -> &'static str {
        self.names()[2]
    }

    /// Name of the buffer that holds the shape's primitives and its acceleration structure.
    /// Triangles have a buffer of their own, as they are many and seldom change.
    pub(crate) const fn buffer(self) -> &'static str {
        match self {
            Self::Triangle => "mesh",
            _ => "scene",
        }
    }
}

/// Address space of the scene's arrays on the device.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(crate) enum SceneMemory {
    /// Uniform (constant) memory: 5–7 times as fast on software Vulkan, but limited in size.
    Uniform,
    /// Storage memory, of any size.
    Storage,
}

/// What the kernel computes for each pixel, as the mean over its samples.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(crate) enum KernelOutput {
    /// Radiance.
    Radiance,
    /// Radiance without the light that [`crate::Aovs::emission`] holds.
    Reflected,
    /// The [`crate::Aovs`] of the first hit.
    Aovs,
}

impl KernelOutput {
    pub(crate) const ALL: [Self; 3] = [Self::Radiance, Self::Reflected, Self::Aovs];

    /// Name of its constant in WGSL.
    pub(crate) const fn constant(self) -> &'static str {
        match self {
            Self::Radiance => "OUTPUT_RADIANCE",
            Self::Reflected => "OUTPUT_REFLECTED",
            Self::Aovs => "OUTPUT_AOVS",
        }
    }

    /// Floats per pixel.
    pub(crate) const fn floats(self) -> usize {
        match self {
            Self::Radiance | Self::Reflected => 3,
            Self::Aovs => 10,
        }
    }

    /// Bytes per pixel.
    pub(crate) const fn pixel_bytes(self) -> u64 {
        (self.floats() * size_of::<f32>()) as u64
    }
}

/// The key of a specialised kernel: scenes with equal features share one. Probabilities are stored as
/// integers, so that it can be hashed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(crate) struct Features {
    /// Number of primitives of each shape, in the order of [`ShapeKind::ALL`].
    pub(crate) counts: [u32; ShapeKind::ALL.len()],
    /// Number of CSG boxes, whose faces are counted in `counts`.
    pub(crate) csg_boxes: u32,
    /// Number of triangles with vertex normals.
    pub(crate) smooth_triangles: u32,
    /// Whether some triangle has a dielectric material.
    pub(crate) has_dielectric_mesh: bool,
    /// Number of triangles with texture coordinates; 0 if no material has a texture.
    pub(crate) uv_triangles: u32,
    /// Number of image textures (including views of the same image); 0 if no triangle has texture
    /// coordinates.
    pub(crate) textures: u32,
    /// Number of materials that may have textures; the materials of particles come after them.
    pub(crate) textured_materials: u32,
    /// Whether some material has a texture of its sheen or specular reflection.
    pub(crate) has_layer_factors: bool,
    /// Whether some clear coat has a normal of its own.
    pub(crate) has_coat_normals: bool,
    /// Number of triangles up to the last one with vertex colours.
    pub(crate) colored_triangles: u32,
    /// Whether some surface is partly transparent to rays (alpha test).
    pub(crate) has_opacity: bool,
    /// Width and height of the environment map in pixels; 0 without one.
    pub(crate) environment_map: [u32; 2],
    pub(crate) area_lights: u32,
    /// Number of emissive surfaces of each shape.
    pub(crate) emissive_surfaces: [u32; ShapeKind::ALL.len()],
    /// Probability with which light sampling selects emissive surfaces, in sixteenths.
    pub(crate) emissive_surface_sixteenths: u32,
    /// Whether some surface is emissive.
    pub(crate) has_emission: bool,
    /// Number of punctual lights (without extent).
    pub(crate) punctual_lights: u32,
    /// Probability with which light sampling selects punctual lights rather than other lights that
    /// are not emissive surfaces, in halves.
    pub(crate) punctual_halves: u32,
    /// Number of materials, at least 1: WGSL has no arrays of length 0.
    pub(crate) materials: u32,
    /// Whether rays find the primitives of each shape by a BVH.
    pub(crate) bvhs: [bool; ShapeKind::ALL.len()],
    /// Clusters of boxes, none if these have a BVH, and of CSG boxes.
    pub(crate) box_clusters: Clusters,
    pub(crate) csg_clusters: Clusters,
    /// Whether some CSG box has the exterior of a cone as a face.
    pub(crate) has_csg_cone: bool,
    /// Whether some material has a dielectric coat.
    pub(crate) has_coat: bool,
    /// Whether some coat is rough.
    pub(crate) has_rough_coat: bool,
    /// Whether some material has a stripe.
    pub(crate) has_stripe: bool,
    /// Whether some ball has a number.
    pub(crate) has_number: bool,
    /// Whether some ball of metal or a dielectric has its number on discs of another material.
    pub(crate) has_number_disc: bool,
    /// Whether some material has a procedural pattern other than a number (wood, planks, cloth
    /// marks, cue, …).
    pub(crate) has_wood: bool,
    /// Whether some material has the sheen of napped cloth.
    pub(crate) has_sheen: bool,
    /// Whether some material is a conductor or a dielectric.
    pub(crate) has_microfacet: bool,
    /// Whether some material is a dielectric.
    pub(crate) has_dielectric: bool,
    /// Whether some material follows glTF's metallic-roughness model.
    pub(crate) has_metallic_roughness: bool,
    /// Whether some metallic-roughness material has a clear coat or a sheen.
    pub(crate) has_layers: bool,
    /// Whether some metallic-roughness material is a thin wall.
    pub(crate) has_thin_walls: bool,
    /// Whether some thin wall has a transmission texture.
    pub(crate) has_transmission_textures: bool,
    /// Whether some ball may allow refracted next-event estimation: its material is a smooth
    /// dielectric that scatters light inside.
    pub(crate) has_refracted_nee: bool,
    pub(crate) output: KernelOutput,
    /// Whether balls are so far from the origin that the rounding of coordinates would be visible.
    pub(crate) is_compensated: bool,
    /// Whether all discs lie in one plane, which a ray is intersected with once, and are large
    /// enough in relation to their distance from the origin for rounding not to matter.
    pub(crate) discs_coplanar: bool,
    /// The same for area lights.
    pub(crate) area_lights_coplanar: bool,
    /// Whether some area light may lie in front of another's face, or in front of a light of
    /// another kind.
    pub(crate) area_lights_occlude: bool,
    /// Whether the radiance of some area light varies over its surface.
    pub(crate) area_lights_graded: bool,
    /// Whether intermediate results of solid angles in metres would leave the range of f32.
    pub(crate) area_lights_scaled: bool,
    pub(crate) memory: SceneMemory,
    /// Blocks of pixels per workgroup.
    pub(crate) workgroup_blocks: u32,
}

impl Features {
    /// The clusters of a shape.
    pub(crate) fn clusters(&self, shape: ShapeKind) -> Clusters {
        match shape {
            ShapeKind::Box => self.box_clusters,
            ShapeKind::CsgFace => self.csg_clusters,
            _ => Clusters::NONE,
        }
    }

    /// The features of `scene`, with its arrays in uniform memory.
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

    /// Blocks per workgroup on a device that allows `blocks_max`. One block where a BVH makes the
    /// times of neighbouring rays diverge, as all threads of a workgroup wait for the slowest: with
    /// 16 blocks, a mesh of 20,000 triangles took 28 % longer on an H100.
    pub(crate) fn workgroup_blocks(&self, blocks_max: u32) -> u32 {
        match self.bvhs.contains(&true) {
            true => 1,
            false => blocks_max,
        }
    }

    /// Number of a pixel's samples whose camera rays are traced together, before their paths
    /// continue; 0 where each camera ray is traced when its path begins. Larger batches leave fewer
    /// threads idle at the end of each, at a small cost per sample; denoised frames have few
    /// samples.
    pub(crate) const fn first_hits(&self) -> u32 {
        match self.output {
            // Kernels with BVHs, and devices where it does not pay: software Vulkan takes 14 %
            // longer.
            _ if self.workgroup_blocks == 1 => 0,
            KernelOutput::Radiance => 32,
            KernelOutput::Reflected => 16,
            KernelOutput::Aovs => 0,
        }
    }

    /// Whether a workgroup of several blocks copies primitives to its 32 KiB of workgroup memory,
    /// 12 KiB of which hold its pixels.
    pub(crate) const fn copies_primitives(&self) -> bool {
        const BYTES_MAX: usize = 16 << 10;
        let bytes = self.count(ShapeKind::CsgFace) as usize * size_of::<CsgFaceData>()
            + self.csg_boxes as usize * size_of::<CsgBoxData>()
            + self.count(ShapeKind::Box) as usize * size_of::<BoxData>()
            + self.count(ShapeKind::Sphere) as usize * size_of::<SphereData>();
        self.workgroup_blocks > 1 && bytes <= BYTES_MAX
    }

    /// Number of primitives of a shape.
    pub(crate) const fn count(&self, shape: ShapeKind) -> u32 {
        self.counts[shape as usize]
    }

    /// Whether light sampling selects among other lights than area lights.
    pub(crate) const fn shares_light_sampling(&self) -> bool {
        self.has_environment_map() || self.punctual_lights > 0 || self.has_emissive_surfaces()
    }

    /// Whether light sampling includes emissive surfaces.
    pub(crate) const fn has_emissive_surfaces(&self) -> bool {
        self.emissive_surface_sixteenths > 0
    }

    /// Number of emissive surfaces other than triangles.
    pub(crate) fn emissive_shapes(&self) -> u32 {
        self.emissive_surfaces.iter().sum::<u32>() - self.emissive_triangles()
    }

    /// The shapes of which there are emissive surfaces.
    pub(crate) fn emissive_kinds(&self) -> impl Iterator<Item = ShapeKind> + use<> {
        let counts = self.emissive_surfaces;
        let shapes = ShapeKind::ALL.into_iter();
        shapes.filter(move |shape| counts[*shape as usize] > 0)
    }

    /// Number of emissive triangles.
    pub(crate) const fn emissive_triangles(&self) -> u32 {
        self.emissive_surfaces[ShapeKind::Triangle as usize]
    }

    /// Whether there is an environment map.
    pub(crate) const fn has_environment_map(&self) -> bool {
        self.environment_map[0] > 0
    }

    /// Whether there is layer texture data beside [`crate::compiled::MaterialTextureData`].
    pub(crate) const fn has_layer_textures(&self) -> bool {
        self.has_layer_factors || self.has_coat_normals
    }

    /// Whether some triangle may have a shading normal that differs from its geometric normal.
    pub(crate) const fn has_shading_normals(&self) -> bool {
        self.smooth_triangles > 0 || self.uv_triangles > 0
    }

    /// The shapes whose primitives are numbered in kernels: all, but triangles only where there are
    /// some.
    pub(crate) fn numbered_shapes(&self) -> impl Iterator<Item = ShapeKind> + use<> {
        let has_triangles = self.count(ShapeKind::Triangle) > 0;
        let shapes = ShapeKind::ALL.into_iter();
        shapes.filter(move |shape| *shape != ShapeKind::Triangle || has_triangles)
    }

    /// The shapes that occur in the scene's buffer.
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

    /// Equivalent number of surfaces that a ray is tested against, counting the traversal of BVHs
    /// at its cost.
    pub(crate) fn primitives(&self) -> u32 {
        let tested = ShapeKind::ALL.map(|shape| self.tested(shape));
        tested.iter().sum::<u32>() + self.area_lights
    }

    /// An upper bound on the loop iterations of one ray: loops over subtractions restart at each
    /// one, and some rays meet four times as many BVH nodes as most.
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
            // At the threshold a BVH costs as much as a linear search; from there on its depth
            // counts.
            true => bvh_min(shape) as u32 + 8 * count.ilog2(),
            false => count,
        }
    }
}

/// Number of primitives from which a BVH is faster. Measured on an H200: at these numbers by 1.04
/// (discs) to 1.3; for 10,000 primitives by 10 (balls), 61, 83, 110 and 78
/// (`carom-bench bvh --backend gpu --size 960x540`).
const fn bvh_min(shape: ShapeKind) -> usize {
    match shape {
        ShapeKind::Sphere => 256,
        ShapeKind::Box => 96,
        ShapeKind::Disc => 48,
        ShapeKind::Rectangle | ShapeKind::Triangle => 32,
        ShapeKind::CsgFace => usize::MAX,
    }
}

/// The BVH by which kernels find the primitives of a shape, if they use one.
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

/// Probability of punctual lights among the lights that are not emissive surfaces, in halves.
fn punctual_halves(scene: &CompiledScene) -> u32 {
    let others = 1.0 - scene.emissive_surfaces.probability();
    match others > 0.0 {
        true => (2.0 * scene.punctual_probability / others).round() as u32,
        false => 0,
    }
}

/// Whether some ball may have [`crate::compiled::SphereData::allows_refracted_nee`], wherever it
/// moves.
fn has_refracted_nee(scene: &CompiledScene) -> bool {
    let scatters = |material: &MaterialData| {
        material.kind == KIND_DIELECTRIC && material.alpha == 0.0 && material.sampling_density > 0.0
    };
    let mut balls = scene.spheres.iter();
    let material = |ball: &SphereData| scene.materials.get(ball.material as usize);
    !scene.area_lights.is_empty() && balls.any(|ball| material(ball).is_some_and(scatters))
}

/// Whether area lights are so small or so far away that eighth powers of lengths in metres, which
/// occur in the computation of solid angles, come near the limits of f32's range.
fn needs_scale(scene: &CompiledScene) -> bool {
    const METRES: std::ops::Range<f32> = 1e-3..1e3;
    let area_lights = scene.area_lights.iter();
    let mut lengths = area_lights.flat_map(|light| [light.length_u, light.length_v]);
    coplanar::farthest(scene) >= METRES.end || lengths.any(|length| length < METRES.start)
}

/// Whether the rounding error of a difference of two coordinates exceeds 2⁻¹⁵ of a radius
/// (512 · 2⁻²⁴ = 2⁻¹⁵). A pool table's balls (28.6 mm) reach that 15 m from the origin.
fn needs_compensation(scene: &CompiledScene) -> bool {
    const COORDINATE_PER_RADIUS_MAX: f32 = 512.0;
    let visible = scene.spheres.iter().filter(|sphere| sphere.radius > 0.0);
    let radius_min = visible.map(|s| s.radius).fold(f32::INFINITY, f32::min);
    let centers = scene.spheres.iter().map(|s| s.center);
    let coordinates = centers.chain([scene.camera.eye.to_array()]).flatten();
    let farthest = coordinates.map(f32::abs).fold(0.0, f32::max);
    farthest > radius_min * COORDINATE_PER_RADIUS_MAX
}
