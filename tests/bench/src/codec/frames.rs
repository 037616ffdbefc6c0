//! The frames of `carom-bench codec`: the pool table with six balls rolling, or seen from a turning
//! camera, traced once and cached.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::Context;
use carom_protocol::SceneHash;
use carom_tracer::film::{trace_image, trace_tiles};
use carom_tracer::scene::Camera;
use carom_tracer::{
    CompiledScene, ImageSize, ObjectPose, RadianceImage, RenderSettings, Scene, SceneUpdate, Shape,
    Tile, Tracer,
};
use glam::{Quat, Vec3};

use crate::BenchError;
use crate::scenes;

/// Quality of a frame.
#[derive(Clone, Copy)]
pub(super) struct FrameQuality {
    samples: u32,
    denoise: bool,
}

impl FrameQuality {
    /// Traced with this many samples per pixel.
    pub(super) fn traced(samples: u32) -> Self {
        let denoise = false;
        Self { samples, denoise }
    }

    /// Traced with this many samples per pixel and denoised.
    pub(super) fn denoised(samples: u32) -> Self {
        let denoise = true;
        Self { samples, denoise }
    }
}

/// A name, frames, and whether each is encoded relative to the one before.
pub(super) type Motion = (&'static str, Vec<Arc<RadianceImage>>, bool);

/// Traces frames, or reads cached ones.
pub(super) struct TestFrames {
    size: ImageSize,
    tracer: Arc<dyn Tracer>,
    scene: Scene,
    compiled: CompiledScene,
    folder: PathBuf,
}

impl TestFrames {
    pub(super) fn new(
        size: ImageSize,
        tracer: Arc<dyn Tracer>,
        folder: Option<&Path>,
    ) -> Result<Self, BenchError> {
        let scene = scenes::scene(None)?.scene;
        let folder = folder.map_or_else(
            || std::env::temp_dir().join("carom-bench-codec"),
            Path::to_path_buf,
        );
        std::fs::create_dir_all(&folder)
            .map_err(|why| BenchError::Input(format!("{}: {why}", folder.display())))?;
        Ok(Self {
            size,
            tracer,
            compiled: CompiledScene::new(&scene)?,
            scene,
            folder,
        })
    }

    /// The sequences of frames. All have the same seed: a pixel whose paths meet nothing that has moved
    /// does not change.
    pub(super) fn motions(&self, picture: FrameQuality) -> Result<Vec<Motion>, BenchError> {
        let start = self.frame(picture, 0, 0)?;
        let frames = |balls: [u32; 2], turns: [u32; 2]| -> Result<Vec<_>, BenchError> {
            Ok(vec![
                Arc::clone(&start),
                self.frame(picture, balls[0], turns[0])?,
                self.frame(picture, balls[1], turns[1])?,
            ])
        };
        let balls = frames([1, 2], [0, 0])?;
        Ok(vec![
            ("cut", balls.clone(), false),
            ("still", vec![Arc::clone(&start); 2], true),
            ("six balls", balls, true),
            ("camera", frames([0, 0], [1, 2])?, true),
        ])
    }

    /// The picture `balls` frames after the balls began to roll, and `turns` frames after the camera
    /// began to turn.
    fn frame(
        &self,
        picture: FrameQuality,
        balls: u32,
        turns: u32,
    ) -> Result<Arc<RadianceImage>, BenchError> {
        let mut scene = self.compiled.clone();
        scene.apply(&self.update(balls as f32 * FRAME_SECS, turns as f32 * FRAME_SECS))?;
        let settings = RenderSettings {
            samples: picture.samples,
            denoise: picture.denoise,
            ..RenderSettings::default()
        };
        let path = self.path(picture, balls, turns);
        if let Some(kept) = self.kept(&path, &scene, settings)? {
            return Ok(Arc::new(kept));
        }
        eprintln!("tracing {}", path.display());
        let image = trace_image(self.tracer.as_ref(), &scene, self.size, settings)?.image();
        image.write_exr(&path).context("keeping a traced frame")?;
        Ok(Arc::new(image))
    }

    fn path(&self, picture: FrameQuality, balls: u32, turns: u32) -> PathBuf {
        let hash = SceneHash::of(&self.scene).0;
        let hash = u32::from_le_bytes([hash[0], hash[1], hash[2], hash[3]]);
        let (ImageSize { width, height }, samples) = (self.size, picture.samples);
        let filtered = if picture.denoise { "_denoised" } else { "" };
        let name =
            format!("{hash:08x}_{width}x{height}_{samples}spp{filtered}_{balls}_{turns}.exr");
        self.folder.join(name)
    }

    /// A cached frame, if a row in its middle is traced with the same result now.
    fn kept(
        &self,
        path: &Path,
        scene: &CompiledScene,
        settings: RenderSettings,
    ) -> Result<Option<RadianceImage>, BenchError> {
        let Ok(kept) = RadianceImage::read_exr(path) else {
            return Ok(None);
        };
        let (width, height) = (self.size.width.min(8), self.size.height.min(8));
        let (x, y) = (
            (self.size.width - width) / 2,
            (self.size.height - height) / 2,
        );
        let tile = Tile {
            x,
            y,
            width,
            height,
        };
        let film = trace_tiles(self.tracer.as_ref(), scene, self.size, settings, &[tile])?;
        let now = film.image();
        let row = (y * self.size.width + x) as usize;
        let row = row..row + width as usize;
        let same = kept.size == self.size && kept.pixels[row.clone()] == now.pixels[row];
        Ok(same.then_some(kept))
    }

    fn update(&self, ball_secs: f32, camera_secs: f32) -> SceneUpdate {
        let poses = BALLS.iter().zip(0..).map(|(ball, index)| {
            let [speed, heading_deg] = *ball;
            let (object, center) = self.ball(index);
            let (sin, cos) = heading_deg.to_radians().sin_cos();
            let heading = Vec3::new(cos, sin, 0.0);
            let way = speed * ball_secs;
            ObjectPose {
                object,
                position: center + way * heading,
                rotation: Quat::from_axis_angle(Vec3::Z.cross(heading), way / BALL_RADIUS),
                visible: true,
            }
        });
        let camera = self.scene.camera;
        let turned = Quat::from_rotation_z(camera_secs * TURN_DEG_PER_SEC.to_radians());
        SceneUpdate {
            camera: Some(Camera {
                eye: camera.target + turned * (camera.eye - camera.target),
                ..camera
            }),
            poses: poses.collect(),
            ..SceneUpdate::default()
        }
    }

    /// Index of the object `ball0`, `ball1` and so on, and its position.
    fn ball(&self, number: u32) -> (u32, Vec3) {
        let name = format!("ball{number}");
        let mut objects = self.scene.objects.iter().zip(0..);
        let found = objects.find_map(|(object, index)| match object.shape {
            Shape::Sphere { center, .. } if object.name == name => Some((index, center)),
            _ => None,
        });
        found.expect("the built-in table has 16 balls")
    }
}

const FRAME_SECS: f32 = 1.0 / 60.0;
const BALL_RADIUS: f32 = 0.028_575;
/// Speed of the camera: a slow look around.
const TURN_DEG_PER_SEC: f32 = 20.0;
/// Speed of each ball in m/s and its direction in degrees: as after a soft break. None meets another
/// within two frames.
const BALLS: [[f32; 2]; 6] = [
    [2.0, 20.0],
    [1.2, 200.0],
    [0.8, 100.0],
    [1.5, -60.0],
    [0.4, 150.0],
    [0.2, 0.0],
];
