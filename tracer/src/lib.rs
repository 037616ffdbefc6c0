//! Scene in, radiance out: the path tracer behind Carom.
//!
//! ```text
//! Scene ──compile──▶ CompiledScene ──┐
//!                      ▲ apply       ├──▶ Tracer::trace ──▶ TileRadiance ──▶ Film ──▶ PNG, EXR
//! SceneUpdate ─────────┘  TraceJob ──┘      (CPU, GPU)
//! ```
//!
//! The crate has no networking, windows or clocks. Its features `gpu` (compute shaders), `image-io`
//! (image files, and with them textures and environment maps) and `gltf` (glTF 2.0 files) are
//! enabled by default.

pub mod aov;
pub mod bvh;
pub mod compiled;
pub mod cpu;
pub mod denoise;
#[cfg(feature = "image-io")]
pub mod environment_file;
pub mod error;
pub mod film;
pub mod fresnel;
#[cfg(feature = "gpu")]
pub mod gpu;
pub mod image;
#[cfg(feature = "image-io")]
pub mod image_file;
pub mod metrics;
pub mod reference;
pub mod regularisation;
pub mod reproject;
pub mod sampling;
pub mod scalar;
pub mod scene;
pub mod settings;
pub mod sheen;
pub mod simd;
pub mod text;
pub mod texture;
#[cfg(feature = "image-io")]
pub mod texture_file;
pub mod tile;
pub mod tonemap;
pub mod tracer;

pub use aov::{Aovs, TileAovs};
pub use compiled::CompiledScene;
pub use cpu::CpuTracer;
pub use error::{Error, SceneError, SettingsError};
pub use film::Film;
pub use glam;
#[cfg(feature = "gpu")]
pub use gpu::GpuTracer;
pub use image::RadianceImage;
pub use scalar::ScalarTracer;
pub use scene::{
    AreaLight, Axis, Camera, ClothMarks, ColorSpace, CsgSolid, Cuboid, Environment, EnvironmentMap,
    ImageSource, ImageTexture, Layers, Lens, Material, MaterialTextures, Medium, Mesh, Object,
    ObjectHandle, ObjectPose, Opacity, ParticleCloud, ParticleForm, Plane, ProceduralTexture,
    PunctualEmitter, PunctualLight, Scene, SceneIdentity, SceneUpdate, Shape, Sights, Sphere,
    Stripe, Subtraction, Wrap,
};
pub use settings::{Preset, RenderSettings};
pub use tile::{ImageSize, Tile, TileGrid, TileRange};
pub use tracer::{DeviceInfo, DeviceKind, TileRadiance, TileSrgb8, TraceJob, TraceStats, Tracer};
