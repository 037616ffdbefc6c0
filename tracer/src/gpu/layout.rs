//! The bytes that a kernel reads: what [`crate::compiled`] holds, one array behind another.

use bytemuck::{Pod, Zeroable, bytes_of, cast_slice};

use crate::compiled::{
    BoxData, CameraFrame, CompiledScene, DiscData, LampData, MaterialData, RectangleData,
    SphereData,
};
use crate::gpu::features::{Features, ShapeKind};
use crate::{Error, ImageSize};

/// What stands before the scene's arrays.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub(crate) struct SceneHeader {
    pub(crate) camera: CameraFrame,
    pub(crate) environment: [f32; 3],
    /// 0, which the shader's compiler cannot know.
    pub(crate) zero: u32,
}

/// What one dispatch does: samples `sample_begin..sample_end` of `samples` in blocks of pixels.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub(crate) struct DispatchData {
    pub(crate) tile_count: u32,
    pub(crate) block_count: u32,
    pub(crate) sample_begin: u32,
    pub(crate) sample_end: u32,
    pub(crate) samples: u32,
    pub(crate) first_sample: u32,
    pub(crate) seed: u32,
    pub(crate) scatterings_max: u32,
}

/// A tile, and how many blocks and pixels come before it.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq, Pod, Zeroable)]
pub(crate) struct TileEntry {
    pub(crate) x: u32,
    pub(crate) y: u32,
    pub(crate) width: u32,
    pub(crate) height: u32,
    pub(crate) first_block: u32,
    pub(crate) first_pixel: u32,
}

/// Length of [`scene_bytes`].
pub(crate) fn scene_bytes_len(features: &Features) -> u64 {
    let shapes = features
        .shapes()
        .map(|shape| features.count(shape) as usize * element_bytes(shape));
    let arrays = shapes.sum::<usize>()
        + features.lamps as usize * size_of::<LampData>()
        + features.materials as usize * size_of::<MaterialData>();
    (size_of::<SceneHeader>() + arrays) as u64
}

fn element_bytes(shape: ShapeKind) -> usize {
    match shape {
        ShapeKind::Sphere => size_of::<SphereData>(),
        ShapeKind::Box => size_of::<BoxData>(),
        ShapeKind::Disc => size_of::<DiscData>(),
        ShapeKind::Rectangle => size_of::<RectangleData>(),
    }
}

/// The scene as the kernel's `SceneData`.
///
/// # Errors
/// [`Error::InvalidScene`] if a primitive's material does not exist: the kernel does not check.
pub(crate) fn scene_bytes(scene: &CompiledScene, size: ImageSize) -> Result<Vec<u8>, Error> {
    check_materials(scene)?;
    let header = SceneHeader {
        camera: scene.camera_frame(size),
        environment: scene.environment.to_array(),
        zero: 0,
    };
    let mut bytes = bytes_of(&header).to_vec();
    bytes.extend_from_slice(cast_slice(&scene.spheres));
    bytes.extend_from_slice(cast_slice(&scene.boxes));
    bytes.extend_from_slice(cast_slice(&scene.discs));
    bytes.extend_from_slice(cast_slice(&scene.rectangles));
    bytes.extend_from_slice(cast_slice(&scene.lamps));
    bytes.extend_from_slice(cast_slice(&scene.materials));
    if scene.materials.is_empty() {
        bytes.extend_from_slice(bytes_of(&MaterialData::zeroed()));
    }
    Ok(bytes)
}

fn check_materials(scene: &CompiledScene) -> Result<(), Error> {
    let spheres = scene.spheres.iter().map(|sphere| sphere.material);
    let boxes = scene.boxes.iter().map(|solid| solid.material);
    let discs = scene.discs.iter().map(|disc| disc.material);
    let rectangles = scene.rectangles.iter().map(|rectangle| rectangle.material);
    let highest = spheres.chain(boxes).chain(discs).chain(rectangles).max();
    match highest {
        Some(material) if material as usize >= scene.materials.len() => {
            Err(Error::InvalidScene(format!(
                "a surface has material {material}, but there are {}",
                scene.materials.len()
            )))
        }
        _ => Ok(()),
    }
}
