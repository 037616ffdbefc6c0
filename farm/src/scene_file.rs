//! Scenes by the names of their files.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use carom_protocol::SceneHash;
#[cfg(feature = "gltf")]
use carom_protocol::limits::POSES_MAX;
use carom_tracer::glam::Vec3;
#[cfg(feature = "gltf")]
use carom_tracer::scene::gltf_file::{AnimatedScene, AnimationTime};
use carom_tracer::scene::mesh_file::{ObjPart, ObjScene};
use carom_tracer::text::printable;
use carom_tracer::{AreaLight, Camera, Material, Mesh, Scene, SceneUpdate};

use crate::error::Error;

/// File name extensions that [`open_scene`] supports, in lower case.
pub const SCENE_FILES: [&str; 5] = ["json", "gltf", "glb", "obj", "ply"];

/// Opens the scene of a file by its extension: JSON as in [`carom_tracer::scene::file`], also without an
/// extension; glTF 2.0; or a mesh (OBJ with its materials, y up, or PLY with its colours, z up), grey where
/// it has neither, under a sky and a lamp, with the camera far enough away to see all of it.
///
/// # Errors
/// [`Error::Tracer`] with the file and its fault, or its unsupported extension.
pub fn open_scene(path: impl AsRef<Path>) -> Result<Scene, Error> {
    let path = path.as_ref();
    let ending = path.extension().map(|ending| ending.to_ascii_lowercase());
    let format = |message| carom_tracer::Error::Format {
        path: path.to_owned(),
        message,
    };
    let (meshes, up) = match ending.as_deref().map(|ending| ending.to_str()) {
        None | Some(Some("json" | "gltf" | "glb")) => return Ok(Scene::load(path)?),
        Some(Some("obj")) => (ObjScene::load(path)?, Vec3::Y),
        Some(Some("ply")) => (colored(Mesh::load(path)?), Vec3::Z),
        _ => {
            let endings = SCENE_FILES.map(|ending| format!(".{ending}")).join(", ");
            let sentence = format!("a scene's name must end with one of {endings}");
            return Err(format(sentence).into());
        }
    };
    let name = path.file_stem().unwrap_or_default().to_string_lossy();
    let scene = scene_of_meshes(&printable(&name, NAME_BYTES_MAX), meshes, up);
    let checked = scene.validate_visible();
    checked.map_err(|fault| format(fault.to_string()))?;
    Ok(scene)
}

/// A scene file that has been read, with the animations of glTF 2.0: gives the scene at any time without
/// reading the file again.
///
/// ```no_run
/// # fn main() -> carom_farm::Result<()> {
/// let mut file = carom_farm::SceneFile::open("windmill.glb")?;
/// let first = file.find_animation(None)?;
/// for frame in 0..48 {
///     let (scene, update) = file.seek(first, f64::from(frame) / 24.0)?;
///     # let _ = (scene, update);
///     // A still of `scene` with this update is this frame.
/// }
/// # Ok(())
/// # }
/// ```
#[derive(Debug)]
pub struct SceneFile {
    path: PathBuf,
    animations: Arc<[SceneAnimation]>,
    #[cfg(feature = "gltf")]
    animated: Option<Arc<AnimatedScene>>,
    rest: Arc<Scene>,
    /// The scene that updates refer to, and its time.
    #[cfg(feature = "gltf")]
    base: (Arc<Scene>, AnimationTime),
}

/// An animation of a scene file.
#[derive(Clone, Debug, PartialEq)]
pub struct SceneAnimation {
    /// Its name; may be empty.
    pub name: String,
    /// Seconds from its start to its last key frame, at least 0.
    pub duration_secs: f64,
}

impl SceneFile {
    /// Reads a file that [`open_scene`] opens.
    ///
    /// # Errors
    /// As [`open_scene`].
    pub fn open(path: impl AsRef<Path>) -> Result<Self, Error> {
        let path = path.as_ref();
        #[cfg(feature = "gltf")]
        if is_gltf(path) {
            let animated = AnimatedScene::load(path)?;
            let rest = Arc::clone(animated.rest());
            let animations = animated.animations().iter();
            let animations = animations.map(|animation| SceneAnimation {
                name: animation.name().to_owned(),
                duration_secs: animation.duration_secs(),
            });
            return Ok(Self {
                path: path.to_owned(),
                animations: animations.collect(),
                animated: Some(Arc::new(animated)),
                base: (Arc::clone(&rest), AnimationTime::Rest),
                rest,
            });
        }
        let rest = Arc::new(open_scene(path)?);
        Ok(Self {
            path: path.to_owned(),
            animations: Arc::new([]),
            #[cfg(feature = "gltf")]
            animated: None,
            #[cfg(feature = "gltf")]
            base: (Arc::clone(&rest), AnimationTime::Rest),
            rest,
        })
    }

    /// The scene without its animations.
    pub fn scene(&self) -> &Arc<Scene> {
        &self.rest
    }

    /// Its animations, in the file's order.
    pub fn animations(&self) -> &Arc<[SceneAnimation]> {
        &self.animations
    }

    /// The names of a glTF file's perspective cameras; may be empty. [`Scene::camera`] is the first.
    pub fn cameras(&self) -> Vec<&str> {
        #[cfg(feature = "gltf")]
        if let Some(animated) = &self.animated {
            return animated.cameras().collect();
        }
        Vec::new()
    }

    /// One of [`SceneFile::cameras`] by its index, at a time of an animation in seconds, or without one.
    ///
    /// # Errors
    /// [`Error::Tracer`] if there is no such camera or animation, the time is not finite, or the camera sees nothing then.
    pub fn camera(&self, camera: usize, time: Option<(usize, f64)>) -> Result<Camera, Error> {
        #[cfg(feature = "gltf")]
        if let Some(animated) = &self.animated {
            let time = time.map_or(AnimationTime::Rest, |(animation, secs)| {
                AnimationTime::At(animation, secs)
            });
            return Ok(animated.camera(camera, time)?);
        }
        let _ = time;
        let message = format!("it has no camera {camera}: only glTF files have cameras to choose");
        let path = self.path.clone();
        Err(carom_tracer::Error::Format { path, message }.into())
    }

    /// A key that identifies the scene at all times among those of other files, for
    /// [`crate::Film::of_states`].
    pub fn key(&self) -> String {
        let SceneHash(rest) = SceneHash::of(&self.rest);
        #[cfg(feature = "gltf")]
        if let Some(animated) = &self.animated {
            return format!("{rest:?} {:?}", animated.content_hash());
        }
        format!("{rest:?}")
    }

    /// The index of an animation by its name, or else by its number, the first being 0; without a name,
    /// that of the first.
    ///
    /// # Errors
    /// [`Error::Tracer`] with the animations of the file.
    pub fn find_animation(&self, name: Option<&str>) -> Result<usize, Error> {
        #[cfg(feature = "gltf")]
        if let (Some(animated), Some(name)) = (&self.animated, name) {
            return Ok(animated.find_animation(name)?);
        }
        #[cfg(not(feature = "gltf"))]
        let _ = name;
        match self.animations.is_empty() {
            false => Ok(0),
            true => Err(self.without_animation()),
        }
    }

    /// The scene at `secs` of an animation, clamped to its start and end.
    ///
    /// # Errors
    /// [`Error::Tracer`] if there is no such animation, the time is not finite, or the scene cannot be drawn then.
    pub fn scene_at(&self, animation: usize, secs: f64) -> Result<Scene, Error> {
        #[cfg(feature = "gltf")]
        if let Some(animated) = &self.animated {
            return Ok(animated.scene(AnimationTime::At(animation, secs))?);
        }
        let _ = (animation, secs);
        Err(self.without_animation())
    }

    /// The scene at `secs` of an animation, as an update of a scene that stays the same from call to call
    /// as long as updates can express the difference: they move up to 64 objects and the camera.
    /// Deformation by a skin, morph targets or a scale, and a moving light, need another scene.
    ///
    /// # Errors
    /// As [`SceneFile::scene_at`].
    pub fn seek(
        &mut self,
        animation: usize,
        secs: f64,
    ) -> Result<(Arc<Scene>, SceneUpdate), Error> {
        #[cfg(feature = "gltf")]
        if let Some(animated) = &self.animated {
            let to = AnimationTime::At(animation, secs);
            // Where an update of the base cannot express the change, the scene at `to` becomes the new
            // base.
            let update = animated.update(self.base.1, to)?;
            if let Some(update) = update.filter(|update| update.poses.len() <= POSES_MAX) {
                return Ok((Arc::clone(&self.base.0), update));
            }
            let scene = Arc::new(animated.scene(to)?);
            self.base = (Arc::clone(&scene), to);
            return Ok((scene, SceneUpdate::default()));
        }
        let _ = (animation, secs);
        Err(self.without_animation())
    }

    fn without_animation(&self) -> Error {
        let sentence = "it has no animation: leave the time out".to_owned();
        let path = self.path.clone();
        carom_tracer::Error::Format {
            path,
            message: sentence,
        }
        .into()
    }
}

/// The clone shares what has been read; the updates of its [`SceneFile::seek`] start from the scene without
/// animations.
impl Clone for SceneFile {
    fn clone(&self) -> Self {
        Self {
            path: self.path.clone(),
            animations: Arc::clone(&self.animations),
            #[cfg(feature = "gltf")]
            animated: self.animated.clone(),
            #[cfg(feature = "gltf")]
            base: (Arc::clone(&self.rest), AnimationTime::Rest),
            rest: Arc::clone(&self.rest),
        }
    }
}

#[cfg(feature = "gltf")]
fn is_gltf(path: &Path) -> bool {
    let ending = path.extension().and_then(|ending| ending.to_str());
    ending.is_some_and(|ending| ["gltf", "glb"].contains(&ending.to_ascii_lowercase().as_str()))
}

/// A single mesh; if it has vertex colours, with a white material.
fn colored(mesh: Mesh) -> ObjScene {
    let material = (!mesh.colors.is_empty()).then(|| Material::grey(1.0));
    let part = ObjPart {
        name: String::new(),
        material,
        mesh,
    };
    ObjScene {
        parts: vec![part],
        textures: Vec::new(),
    }
}

/// A scene of meshes in the middle of the picture, lit from the upper left. Unnamed meshes get `name`.
fn scene_of_meshes(name: &str, mut meshes: ObjScene, up: Vec3) -> Scene {
    let bounds = meshes.parts.iter().flat_map(|part| &part.mesh.positions);
    let bounds = bounds.copied();
    let (min, max) = bounds.fold((Vec3::MAX, Vec3::MIN), |(min, max), at| {
        (min.min(at), max.max(at))
    });
    let center = 0.5 * (min + max);
    let radius = (0.5 * (max - min)).length().max(RADIUS_MIN_M);
    // By convention, meshes with y up face +z, those with z up face −y.
    let front = if up == Vec3::Y { Vec3::Z } else { Vec3::NEG_Y };
    let right = up.cross(front);
    let toward = |aside: f32, above: f32| (front + aside * right + above * up).normalize();
    let camera = Camera::looking_at(center + VIEW_RADII * radius * toward(0.5, 0.45), center);
    let edge = LAMP_EDGE_RADII * radius;
    let lamp = AreaLight::new(edge, edge)
        .at(center + LAMP_RADII * radius * toward(-1.5, 2.2))
        .facing(center)
        .radiance(LAMP_RADIANCE);
    let mut scene = Scene::new().camera(camera.upright(up)).sky(SKY_RADIANCE);
    for part in &mut meshes.parts {
        if part.name.is_empty() {
            name.clone_into(&mut part.name);
        }
    }
    meshes.add_to(&mut scene, Material::grey(0.7));
    scene.add_light(lamp);
    scene
}

/// Maximum bytes of a mesh's name.
const NAME_BYTES_MAX: usize = 64;
/// Minimum radius in metres for the placement of camera and lamp, for tiny meshes and single points.
const RADIUS_MIN_M: f32 = 1e-3;
/// Distance of the camera, whose vertical field of view is 26° at 16:9, in radii of the bounding sphere.
const VIEW_RADII: f32 = 4.5;
const LAMP_RADII: f32 = 3.5;
const LAMP_EDGE_RADII: f32 = 1.75;
/// Radiance of lamp and sky, chosen so that white appears nearly white.
const LAMP_RADIANCE: [f32; 3] = [10.0, 9.6, 9.0];
const SKY_RADIANCE: [f32; 3] = [0.36, 0.4, 0.44];

#[cfg(test)]
mod tests {
    use super::*;

    const TRIANGLE: &str = "v 10 20 30\nv 14 20 30\nv 10 23 30\nf 1 2 3\n";
    /// A triangle that slides along x by 2 m in 2 s, and in the second animation is scaled so.
    #[cfg(feature = "gltf")]
    const SLIDE: &str = include_str!("../tests/slide.gltf");

    fn write(folder: &Path, name: &str, text: &str) -> std::path::PathBuf {
        let path = folder.join(name);
        std::fs::write(&path, text).unwrap();
        path
    }

    #[test]
    fn a_mesh_is_in_the_middle_of_its_picture_and_lit() {
        let folder = tempfile::tempdir().unwrap();
        let scene = open_scene(write(folder.path(), "wing.OBJ", TRIANGLE)).unwrap();
        assert_eq!(scene.objects[0].name, "wing");
        let camera = scene.camera;
        assert_eq!(camera.target, Vec3::new(12.0, 21.5, 30.0));
        assert_eq!(camera.up, Vec3::Y);
        // A sphere of radius r fits into half an angle a from r / sin a away.
        let half_height = (0.5 * camera.fov_x_deg).to_radians().tan() * 9.0 / 16.0;
        let distance = camera.eye.distance(camera.target);
        assert!(2.5 / half_height.atan().sin() <= distance, "{distance}");
        assert!(camera.eye.z > 30.0, "seen from its front");
        assert!(scene.area_lights[0].center.y > 21.5);
    }

    #[test]
    fn an_obj_has_its_materials_and_a_ply_its_colours() {
        let folder = tempfile::tempdir().unwrap();
        write(
            folder.path(),
            "paint.mtl",
            "newmtl red\nKd 0.5 0.125 0\nKe 2 1 0\n",
        );
        let faces = TRIANGLE.replace("f 1 2 3", "usemtl red\nf 1 2 3\nf 3 2 1");
        let text = format!("mtllib paint.mtl\n{faces}");
        let scene = open_scene(write(folder.path(), "sign.obj", &text)).unwrap();
        let object = &scene.objects[0];
        assert_eq!(object.name, "red");
        let Material::MetallicRoughness {
            base_color,
            emission,
            ..
        } = scene.materials[&object.material]
        else {
            panic!("{:?}", scene.materials);
        };
        assert_eq!(base_color, Vec3::new(0.5, 0.125, 0.0));
        assert_eq!(emission, Vec3::new(2.0, 1.0, 0.0));
        let ply = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n\
            property uchar red\nproperty uchar green\nproperty uchar blue\nelement face 1\n\
            property list uchar int vertex_index\nend_header\n0 0 0 255 0 0\n1 0 0 0 255 0\n0 1 0 0 0 255\n3 0 1 2\n";
        let scene = open_scene(write(folder.path(), "wing.ply", ply)).unwrap();
        assert_eq!(scene.objects[0].name, "wing");
        let material = scene.materials[&scene.objects[0].material];
        assert_eq!(material, Material::grey(1.0));
        let why = open_scene(write(
            folder.path(),
            "bare.obj",
            &text.replace("red", "blue"),
        ));
        let why = why.unwrap_err().to_string();
        assert!(
            why.contains("bare.obj: line 5: the material `blue` is in none"),
            "{why}"
        );
    }

    #[test]
    fn json_is_told_by_its_name_or_by_none() {
        let folder = tempfile::tempdir().unwrap();
        let json = Scene::load(concat!(
            env!("CARGO_MANIFEST_DIR"),
            "/src/commands/pool.json"
        ));
        let json = json.unwrap();
        for name in ["pool.json", "pool"] {
            let path = write(folder.path(), name, &json.to_json().unwrap());
            assert_eq!(open_scene(path).unwrap(), json);
        }
    }

    #[cfg(feature = "gltf")]
    #[test]
    fn an_animation_is_an_update_where_it_can_be_and_a_scene_elsewhere() {
        let folder = tempfile::tempdir().unwrap();
        let mut file = SceneFile::open(write(folder.path(), "slide.gltf", SLIDE)).unwrap();
        let durations: Vec<_> = file
            .animations()
            .iter()
            .map(|one| one.duration_secs)
            .collect();
        assert_eq!(
            (file.animations()[0].name.as_str(), durations),
            ("slide", vec![2.0, 2.0])
        );
        let slide = file.find_animation(None).unwrap();
        let rest = Arc::clone(file.scene());
        for (secs, x) in [(0.5, -0.5), (1.5, 0.5), (9.0, 1.0)] {
            let (scene, update) = file.seek(slide, secs).unwrap();
            assert!(Arc::ptr_eq(&scene, &rest));
            assert_eq!(update.poses[0].position, Vec3::new(x, 0.0, 0.0));
        }
        let (shrunk, update) = file.seek(1, 0.0).unwrap();
        assert!(!Arc::ptr_eq(&shrunk, &rest) && update == SceneUpdate::default());
        assert_eq!(*shrunk, file.scene_at(1, 0.0).unwrap());
        assert_eq!(
            shrunk.camera, rest.camera,
            "the view stays where it was at rest"
        );
        let why = file.find_animation(Some("jump")).unwrap_err().to_string();
        assert!(
            why.contains("slide.gltf") && why.contains("0 `slide`, 1 ``"),
            "{why}"
        );
        assert!(file.seek(0, f64::NAN).is_err());
        let mesh = SceneFile::open(write(folder.path(), "still.obj", TRIANGLE)).unwrap();
        let why = mesh.find_animation(None).unwrap_err().to_string();
        assert!(why.contains("still.obj: it has no animation"), "{why}");
    }

    #[test]
    fn what_is_no_scene_is_refused_with_the_file_and_the_reason() {
        let folder = tempfile::tempdir().unwrap();
        for (name, text, reason) in [
            (
                "a.fbx",
                "",
                "must end with one of .json, .gltf, .glb, .obj, .ply",
            ),
            ("a.json", "{", "line 1"),
            ("a.obj", "v 0 0 nan\n", "line 1"),
            ("a.ply", "plz", "a.ply"),
            ("empty.obj", "", "empty.obj"),
        ] {
            let why = open_scene(write(folder.path(), name, text)).unwrap_err();
            let why = why.to_string();
            assert!(why.contains(name) && why.contains(reason), "{why}");
        }
        let why = open_scene(folder.path().join("none.ply")).unwrap_err();
        assert!(why.to_string().contains("none.ply"), "{why}");
    }
}
