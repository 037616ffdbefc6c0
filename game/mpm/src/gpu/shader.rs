//! Shader sources, assembled from parts: constants of the CPU's code, shared structures, and the
//! constitutive models in use only.

use std::fmt::Write as _;

use crate::grid::SURFACE_CELLS;
use crate::material::{EXPANSION_MAX, EXPANSION_MIN, Material, PLASTIC_VOLUME, STRETCH_MIN};
use crate::simulation::TRAVEL_CELLS_MAX;
use crate::touch::{MARGIN_CELLS, PARTING, PARTING_MAX_M_S, SHARE_MIN};

/// Distance along an axis, in cells, that a particle may move before particles must be sorted again: less
/// than a tile's margin, as the speeds of nodes bound those of particles only up to rounding.
pub(super) const DRIFT_MAX: f32 = 0.9;

/// Largest number of workgroups along x of a dispatch, below WebGPU's and Vulkan's guaranteed 65,535.
pub(super) const GROUPS_X_MAX: u32 = 32_768;

/// Resources of kernels with their binding numbers, which are the same in all kernels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u32)]
pub(super) enum Resource {
    Params = 0,
    Control = 1,
    Counters = 2,
    Chunks = 3,
    Particles = 4,
    Sums = 5,
    Velocities = 6,
    Materials = 7,
    FrictionSums = 8,
    Frictions = 9,
    Balls = 10,
    Obstacles = 11,
    Table = 12,
    Keys = 13,
    Nodes = 14,
    NextChunks = 15,
    NextParticles = 16,
    DispatchSizes = 17,
    Touches = 18,
}

/// Parameters of the shader sources.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Features {
    /// Names of the models of [`MODELS`] in use.
    pub(super) models: Vec<&'static str>,
    /// Number of materials, at least 1.
    pub(super) materials: usize,
    /// Coefficient of friction if all materials have the same one.
    pub(super) friction: Option<f32>,
    /// Particles of a chunk, which is the workgroup size of kernels over particles.
    pub(super) chunk: u32,
}

/// Names of the models in the order of their kinds, which are also those of their WGSL functions and files.
pub(super) const MODELS: [&str; 4] = ["jelly", "water", "sand", "snow"];

/// Kind of a material: the index of its model in [`MODELS`].
pub(super) fn kind(material: &Material) -> usize {
    match material {
        Material::Jelly(_) => 0,
        Material::Water(_) => 1,
        Material::Sand(_) => 2,
        Material::Snow(_) => 3,
    }
}

impl Features {
    pub(super) fn new(materials: &[Material], chunk: u32) -> Self {
        let is_used = |model: &&str| materials.iter().any(|m| MODELS[kind(m)] == *model);
        let first = materials.first().map_or(0.0, Material::friction);
        let is_one = materials.iter().all(|m| m.friction() == first);
        Self {
            models: MODELS.into_iter().filter(is_used).collect(),
            materials: materials.len().max(1),
            friction: is_one.then_some(first),
            chunk,
        }
    }

    fn constants(&self) -> String {
        let mut text = String::new();
        for (name, value) in [
            ("SURFACE_CELLS", SURFACE_CELLS as f32),
            ("MARGIN_CELLS", MARGIN_CELLS),
            ("PARTING", PARTING),
            ("PARTING_MAX", PARTING_MAX_M_S),
            ("SHARE_MIN", SHARE_MIN),
            ("EXPANSION_MAX", EXPANSION_MAX),
            ("EXPANSION_MIN", EXPANSION_MIN),
            ("STRETCH_MIN", STRETCH_MIN),
            ("PLASTIC_VOLUME_MIN", PLASTIC_VOLUME[0]),
            ("PLASTIC_VOLUME_MAX", PLASTIC_VOLUME[1]),
            ("TRAVEL_CELLS_MAX", TRAVEL_CELLS_MAX as f32),
            ("DRIFT_MAX", DRIFT_MAX),
            ("FRICTION", self.friction.unwrap_or(0.0)),
        ] {
            // Writing to a string never fails.
            _ = writeln!(text, "const {name}: f32 = {value:?}f;");
        }
        let has_deformation = self.models.iter().any(|model| *model != "water");
        _ = writeln!(text, "const CHUNK: u32 = {}u;", self.chunk);
        _ = writeln!(text, "const GROUPS_X_MAX: u32 = {GROUPS_X_MAX}u;");
        _ = writeln!(text, "const MATERIALS: u32 = {}u;", self.materials);
        _ = writeln!(text, "const HAS_DEFORMATION: bool = {has_deformation};");
        text
    }

    /// Source of the function that calls a material's model, with a branch only for each model in use.
    fn advance_material(&self) -> String {
        let mut text =
            "fn advance_material(material: Material, strain: Strain) -> Response {\n".to_owned();
        let (last, others) = self.models.split_last().unwrap_or((&"water", &[]));
        for model in others {
            let kind = MODELS.iter().position(|m| m == model).unwrap_or_default();
            _ = writeln!(
                text,
                "    if (material.kind == {kind}u) {{\n        return {model}(material, strain);\n    }}"
            );
        }
        _ = writeln!(text, "    return {last}(material, strain);\n}}");
        text
    }

    fn model_parts(&self) -> Vec<&'static str> {
        let uses = |models: &[&str]| self.models.iter().any(|model| models.contains(model));
        let mut parts = vec![include_str!("shaders/stress.wgsl")];
        if uses(&["jelly", "sand", "snow"]) {
            parts.push(include_str!("shaders/svd.wgsl"));
        }
        if uses(&["sand", "snow"]) {
            parts.push(include_str!("shaders/numbers.wgsl"));
        }
        if uses(&["jelly", "water"]) {
            parts.push(include_str!("shaders/viscosity.wgsl"));
        }
        for (model, part) in [
            ("jelly", include_str!("shaders/jelly.wgsl")),
            ("water", include_str!("shaders/water.wgsl")),
            ("sand", include_str!("shaders/sand.wgsl")),
            ("snow", include_str!("shaders/snow.wgsl")),
        ] {
            if uses(&[model]) {
                parts.push(part);
            }
        }
        parts
    }

    fn join(&self, parts: &[&str]) -> String {
        let head = [
            self.constants(),
            include_str!("shaders/structs.wgsl").to_owned(),
        ];
        head.iter()
            .map(String::as_str)
            .chain(parts.iter().copied())
            .collect::<Vec<_>>()
            .join("\n")
    }

    /// Source of the transfer from grid to particles and back to the grid.
    pub(super) fn transfer(&self) -> String {
        let advance = self.advance_material();
        let mut parts = self.model_parts();
        parts.push(&advance);
        parts.push(include_str!("shaders/kernel.wgsl"));
        parts.push(if self.friction.is_some() {
            include_str!("shaders/friction_stub.wgsl")
        } else {
            include_str!("shaders/friction.wgsl")
        });
        parts.push(include_str!("shaders/touch.wgsl"));
        parts.push(include_str!("shaders/transfer.wgsl"));
        self.join(&parts)
    }

    fn node_friction(&self) -> &'static str {
        if self.friction.is_some() {
            include_str!("shaders/node_friction_stub.wgsl")
        } else {
            include_str!("shaders/node_friction.wgsl")
        }
    }

    /// Source of the grid update.
    pub(super) fn grid(&self) -> String {
        let obstacle = include_str!("shaders/obstacle.wgsl");
        self.join(&[
            obstacle,
            self.node_friction(),
            include_str!("shaders/grid.wgsl"),
        ])
    }

    /// Source of the coupling with balls and the choice of the next substep.
    pub(super) fn coupling(&self) -> String {
        self.join(&[
            include_str!("shaders/obstacle.wgsl"),
            self.node_friction(),
            include_str!("shaders/control.wgsl"),
            include_str!("shaders/coupling.wgsl"),
        ])
    }

    /// Source of the five kernels that sort particles.
    pub(super) fn order(&self) -> String {
        let control = include_str!("shaders/control.wgsl");
        self.join(&[control, include_str!("shaders/order.wgsl")])
    }
}

#[cfg(test)]
mod tests {
    use std::mem::offset_of;

    use naga::valid::{Capabilities, ValidationFlags, Validator};

    use super::*;
    use crate::gpu::layout::{BallRow, Chunk, Control, Counters, MaterialRow, ObstacleRow, Params};

    /// Each set of models, with one friction and with several.
    fn variants() -> impl Iterator<Item = Features> {
        (1..32_u32)
            .filter(|bits| bits % 16 > 0)
            .map(|bits| Features {
                models: (0..4)
                    .filter(|i| bits >> i & 1 == 1)
                    .map(|i| MODELS[i])
                    .collect(),
                materials: bits.count_ones() as usize,
                friction: (bits < 16).then_some(0.5),
                chunk: 128,
            })
    }

    fn validated(text: &str) -> naga::Module {
        let module = naga::front::wgsl::parse_str(text)
            .unwrap_or_else(|error| panic!("{}", error.emit_to_string(text)));
        let mut validator = Validator::new(ValidationFlags::all(), Capabilities::empty());
        if let Err(error) = validator.validate(&module) {
            panic!("{}", error.emit_to_string(text));
        }
        module
    }

    #[test]
    fn kernels_of_all_materials_are_valid_and_have_nothing_of_others() {
        for features in variants() {
            for text in [features.grid(), features.coupling(), features.order()] {
                validated(&text);
            }
            let transfer = features.transfer();
            validated(&transfer);
            for model in MODELS {
                let has = transfer.contains(&format!("fn {model}("));
                assert_eq!(has, features.models.contains(&model), "{features:?}");
            }
            let has_svd = features.models.iter().any(|model| *model != "water");
            assert_eq!(transfer.contains("fn svd("), has_svd, "{features:?}");
        }
    }

    /// The size of a structure and the offset of one of its last members.
    fn layout(module: &naga::Module, name: &str, member: &str) -> (usize, usize) {
        let mut types = module.types.iter().map(|(_, ty)| ty);
        let ty = types.find(|ty| ty.name.as_deref() == Some(name));
        let Some(naga::TypeInner::Struct { members, span }) = ty.map(|ty| &ty.inner) else {
            panic!("{name} is no structure of the kernel");
        };
        let member = members.iter().find(|m| m.name.as_deref() == Some(member));
        (*span as usize, member.expect("a member").offset as usize)
    }

    #[test]
    fn structures_are_alike_in_shaders_and_in_rust() {
        let features = Features::new(&[Material::Water(crate::Water::default())], 128);
        let modules = [features.transfer(), features.coupling()].map(|text| validated(&text));
        for (name, member, size, offset) in [
            (
                "Params",
                "obstacles",
                size_of::<Params>(),
                offset_of!(Params, obstacles),
            ),
            (
                "Control",
                "orderings",
                size_of::<Control>(),
                offset_of!(Control, orderings),
            ),
            (
                "Counters",
                "high",
                size_of::<Counters>(),
                offset_of!(Counters, high),
            ),
            ("Chunk", "len", size_of::<Chunk>(), offset_of!(Chunk, len)),
            (
                "Ball",
                "turn",
                size_of::<BallRow>(),
                offset_of!(BallRow, turn),
            ),
            (
                "Obstacle",
                "axis_x",
                size_of::<ObstacleRow>(),
                offset_of!(ObstacleRow, axes),
            ),
            (
                "Material",
                "bulk",
                size_of::<MaterialRow>(),
                offset_of!(MaterialRow, bulk),
            ),
        ] {
            for module in &modules {
                assert_eq!(layout(module, name, member), (size, offset), "{name}");
            }
        }
    }
}
