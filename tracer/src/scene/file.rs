//! Scenes as JSON files.
//!
//! A file holds one [`Scene`], field by field; lengths are in metres, radiance and albedo are
//! linear Rec. 709 triples, +z is up. Unknown fields are refused, so that a misspelt one is not
//! ignored. Optional are `area_lights`, a sphere's `rotation` (x, y, z, w), a mesh's `normals`,
//! `uvs`, `center` and `rotation`, and a coat's `internal_reflectance` and `stripe`. Textures name
//! PNG or JPEG files beside the scene file (`"image": { "file": "wood.png" }`) or contain them as
//! base64 (`"encoded"`).
//!
//! ```
//! use carom_tracer::Scene;
//!
//! let scene = Scene::from_json(r#"{
//!     "camera": { "eye": [0, -2, 1], "target": [0, 0, 0], "up": [0, 0, 1], "fov_x_deg": 44 },
//!     "environment": { "radiance": [0.03, 0.036, 0.05] },
//!     "materials": {
//!         "cloth": { "diffuse": { "albedo": [0.03, 0.21, 0.09] } },
//!         "nine": {
//!             "smooth_plastic": {
//!                 "albedo": [0.8, 0.78, 0.7],
//!                 "ior": 1.5,
//!                 "stripe": { "albedo": [0.8, 0.52, 0.02], "half_width": 0.5 }
//!             }
//!         }
//!     },
//!     "objects": [
//!         { "name": "ball 9", "material": "nine", "shape": { "sphere": {
//!             "center": [0, 0, 0.028575], "radius": 0.028575, "rotation": [0, 0, 0, 1] } } },
//!         { "name": "bed", "material": "cloth", "shape": { "box": {
//!             "min": [-1.27, -0.635, -0.05], "max": [1.27, 0.635, 0] } } },
//!         { "name": "pocket", "material": "cloth", "shape": { "disc": {
//!             "center": [1.27, 0.635, 0.0005], "normal": [0, 0, 1], "radius": 0.058 } } },
//!         { "name": "wall", "material": "cloth", "shape": { "rectangle": {
//!             "center": [0, 3, 0], "half_u": [3, 0, 0], "half_v": [0, 0, 2] } } },
//!         { "name": "gable", "material": "cloth", "shape": { "mesh": {
//!             "positions": [[-3, 3, 2], [3, 3, 2], [0, 3, 4]], "triangles": [[0, 1, 2]] } } }
//!     ],
//!     "area_lights": [
//!         { "name": "lamp", "center": [0, 0, 1], "half_u": [0.45, 0, 0], "half_v": [0, -0.18, 0],
//!           "radiance": [17, 15.5, 13] }
//!     ]
//! }"#)?;
//! assert_eq!(scene.objects[0].name, "ball 9");
//! assert_eq!(Scene::from_json(&scene.to_json()?)?, scene);
//! # Ok::<(), carom_tracer::Error>(())
//! ```

mod texture_files;

pub(in crate::scene) use texture_files::read_named_file;

use std::fs::{self, File};
use std::io::{self, Read as _, Write};
use std::path::{Component, Path};

use serde::Serialize as _;
use serde_json::ser::{Formatter, PrettyFormatter, Serializer};

use crate::scene::Scene;
use crate::{Error, SceneError};

/// Maximum size of a scene file in bytes, more than a scene without meshes takes at all limits of
/// [`super::validate`], provided that its names need no escapes. Larger files are refused before
/// they are parsed. About a million triangles fit; scenes with more are built in code.
pub const SCENE_BYTES_MAX: usize = 64 << 20;

impl Scene {
    /// Reads and checks a scene file in this format or, if its name ends with `.gltf` or `.glb`, in
    /// glTF 2.0 (`Scene::load_gltf`).
    ///
    /// # Errors
    /// [`Error::Io`] if the file cannot be read; [`Error::Format`] if it is larger than
    /// [`SCENE_BYTES_MAX`], is not a scene, or breaks a rule of [`super::validate`].
    pub fn load(path: impl AsRef<Path>) -> Result<Self, Error> {
        let path = path.as_ref();
        #[cfg(feature = "gltf")]
        if is_gltf(path) {
            return Self::load_gltf(path);
        }
        let bytes = read_scene_file(path).map_err(|source| Error::io(path, source))?;
        let text = text(bytes).map_err(|fault| Error::format(path, fault.to_string()))?;
        let mut scene = Self::parse(&text).map_err(|fault| fault.in_file(path))?;
        texture_files::read(&mut scene, path)?;
        scene.validate().map_err(|fault| fault.in_file(path))?;
        Ok(scene)
    }

    fn parse(text: &str) -> Result<Self, Error> {
        limit(text.len()).map_err(Error::InvalidScene)?;
        serde_json::from_str(text).map_err(|error| parse_error(&error))
    }

    /// Writes the scene as [`Scene::to_json`] to a file, which is overwritten.
    ///
    /// # Errors
    /// [`Error::InvalidScene`] if the scene is invalid, before the file is touched; [`Error::Io`]
    /// if it cannot be written.
    pub fn save(&self, path: impl AsRef<Path>) -> Result<(), Error> {
        let path = path.as_ref();
        fs::write(path, self.to_json()?).map_err(|source| Error::io(path, source))
    }

    /// Reads and checks a scene in this format.
    ///
    /// # Errors
    /// [`Error::InvalidScene`] with line and column if the text is not a scene, or with the object
    /// that breaks a rule of [`super::validate`].
    pub fn from_json(text: &str) -> Result<Self, Error> {
        let scene = Self::parse(text)?;
        scene.validate()?;
        Ok(scene)
    }

    /// The scene as indented JSON with each vector on one line. Reading it back gives exactly the
    /// same values.
    ///
    /// # Errors
    /// [`Error::InvalidScene`] if the scene breaks a rule of [`super::validate`].
    pub fn to_json(&self) -> Result<String, Error> {
        self.validate()?;
        let mut json = Vec::new();
        self.serialize(&mut Serializer::with_formatter(
            &mut json,
            Layout::default(),
        ))
        .expect("plain data always serialises to memory");
        json.push(b'\n');
        Ok(String::from_utf8(json).expect("serde_json writes UTF-8"))
    }
}

#[cfg(feature = "gltf")]
fn is_gltf(path: &Path) -> bool {
    let extension = path.extension().and_then(|extension| extension.to_str());
    extension.is_some_and(|text| ["gltf", "glb"].contains(&text.to_ascii_lowercase().as_str()))
}

/// An error with the position of what the parser refused, and advice.
fn parse_error(error: &serde_json::Error) -> Error {
    let place = format!(" at line {} column {}", error.line(), error.column());
    let what = error.to_string();
    let what = what.strip_suffix(&place).unwrap_or(&what);
    let advice = match error.classify() {
        serde_json::error::Category::Data => "the format is described in `scene::file`",
        serde_json::error::Category::Eof => "the file ends too early",
        _ => "JSON has no NaN, infinity, comments or trailing commas",
    };
    let (line, column) = (error.line(), error.column());
    Error::InvalidScene(SceneError::rule(format!(
        "line {line}, column {column}: {what} ({advice})"
    )))
}

fn read_scene_file(path: &Path) -> io::Result<Vec<u8>> {
    if fs::metadata(path)?.is_dir() {
        return Err(io::Error::new(
            io::ErrorKind::IsADirectory,
            "it is a directory: name a scene file in it",
        ));
    }
    read_limited(path, SCENE_BYTES_MAX as u64)
}

/// Reads at most one byte more than the limit, so that a device or a growing file cannot fill
/// memory.
pub(in crate::scene) fn read_limited(path: &Path, bytes_max: u64) -> io::Result<Vec<u8>> {
    let mut bytes = Vec::new();
    let file = File::open(path)?;
    file.take(bytes_max + 1).read_to_end(&mut bytes)?;
    Ok(bytes)
}

/// As [`read_limited`], but only for regular files: reading a pipe could block.
pub(in crate::scene) fn read_limited_file(path: &Path, bytes_max: u64) -> Result<Vec<u8>, Error> {
    let read = fs::metadata(path).and_then(|metadata| match metadata.is_file() {
        true => read_limited(path, bytes_max),
        false => Err(io::Error::new(io::ErrorKind::InvalidInput, "it is no file")),
    });
    read.map_err(|source| Error::io(path, source))
}

/// Whether a file name in a scene refers to a file in the scene's folder or below.
pub(in crate::scene) fn lies_beside(name: &Path) -> bool {
    let is_below = |part| matches!(part, Component::Normal(_) | Component::CurDir);
    name.components().all(is_below)
}

fn text(bytes: Vec<u8>) -> Result<String, SceneError> {
    limit(bytes.len())?;
    String::from_utf8(bytes).map_err(|error| {
        let valid = error.utf8_error().valid_up_to();
        let before = error.as_bytes()[..valid].iter();
        let line = 1 + before.filter(|&&b| b == b'\n').count();
        SceneError::rule(format!(
            "line {line}: byte {valid} is not UTF-8: save the scene as UTF-8 text"
        ))
    })
}

fn limit(bytes: usize) -> Result<(), SceneError> {
    match bytes <= SCENE_BYTES_MAX {
        true => Ok(()),
        false => Err(SceneError::rule(format!(
            "it is longer than {SCENE_BYTES_MAX} bytes, the most that a scene file may hold: draw fewer objects"
        ))),
    }
}

/// serde_json's indented layout, except that vectors stay on one line: only the scene's own lists
/// (objects, area lights, …) are broken into lines.
#[derive(Default)]
struct Layout {
    pretty: PrettyFormatter<'static>,
    objects_open: u32,
}

impl Layout {
    fn in_vector(&self) -> bool {
        self.objects_open > 1
    }
}

impl Formatter for Layout {
    fn begin_array<W: ?Sized + Write>(&mut self, w: &mut W) -> io::Result<()> {
        if self.in_vector() {
            return w.write_all(b"[");
        }
        self.pretty.begin_array(w)
    }

    fn begin_array_value<W: ?Sized + Write>(&mut self, w: &mut W, first: bool) -> io::Result<()> {
        if self.in_vector() {
            return w.write_all(if first { b"" } else { b", " });
        }
        self.pretty.begin_array_value(w, first)
    }

    fn end_array_value<W: ?Sized + Write>(&mut self, w: &mut W) -> io::Result<()> {
        self.pretty.end_array_value(w)
    }

    fn end_array<W: ?Sized + Write>(&mut self, w: &mut W) -> io::Result<()> {
        if self.in_vector() {
            return w.write_all(b"]");
        }
        self.pretty.end_array(w)
    }

    fn begin_object<W: ?Sized + Write>(&mut self, w: &mut W) -> io::Result<()> {
        self.objects_open += 1;
        self.pretty.begin_object(w)
    }

    fn end_object<W: ?Sized + Write>(&mut self, w: &mut W) -> io::Result<()> {
        self.objects_open -= 1;
        self.pretty.end_object(w)
    }

    fn begin_object_key<W: ?Sized + Write>(&mut self, w: &mut W, first: bool) -> io::Result<()> {
        self.pretty.begin_object_key(w, first)
    }

    fn begin_object_value<W: ?Sized + Write>(&mut self, w: &mut W) -> io::Result<()> {
        self.pretty.begin_object_value(w)
    }

    fn end_object_value<W: ?Sized + Write>(&mut self, w: &mut W) -> io::Result<()> {
        self.pretty.end_object_value(w)
    }
}

#[cfg(test)]
mod tests {
    use glam::{Quat, Vec3};

    use std::collections::BTreeMap;

    use super::*;
    use crate::scene::validate::OBJECTS_MAX;
    use crate::scene::{Material, Object, Shape};

    const SCENE: &str = r#"{
        "camera": { "eye": [0, -2, 1], "target": [0, 0, 0], "up": [0, 0, 1], "fov_x_deg": 44 },
        "environment": { "radiance": [0.03, 0.036, 0.05] },
        "materials": { "ball": { "smooth_plastic": { "albedo": [0.8, 0.7, 0.1], "ior": 1.5 } } },
        "objects": [
            { "name": "a", "material": "ball", "shape": { "sphere": {
                "center": [0, 0, 0.1], "radius": 0.1 } } }
        ]
    }"#;

    fn refusal(text: &str) -> String {
        Scene::from_json(text).expect_err(text).to_string()
    }

    #[test]
    fn each_slip_is_refused_with_its_place() {
        for (from, to, sentence) in [
            (
                "0.05]",
                "NaN]",
                "line 3, column 52: expected value (JSON has no NaN",
            ),
            ("0.05]", "1e999]", "line 3, column 56: number out of range"),
            (
                "0.05]",
                "1e39]",
                "the environment's radiance is [0.03, 0.036, inf]",
            ),
            (
                "\"radius\": 0.1",
                "\"radius\": 0",
                "object 0 `a`: its radius is 0 m",
            ),
            (
                "\"ior\": 1.5",
                "\"ior\": 0",
                "material `ball`: its ior is 0",
            ),
            (
                "\"name\"",
                "\"nmae\"",
                "line 6, column 20: unknown field `nmae`, expected",
            ),
            (
                ", \"radius\": 0.1",
                "",
                "line 7, column 39: missing field `radius`",
            ),
            (
                "\"material\": \"ball\"",
                "\"material\": \"bal\"",
                "its material `bal` is not among",
            ),
            (
                "\"sphere\"",
                "\"cone\"",
                "unknown variant `cone`, expected one of `sphere`",
            ),
            ("}\n        ]\n    }", "}", "the file ends too early"),
        ] {
            let text = SCENE.replacen(from, to, 1);
            assert_ne!(text, SCENE, "{from}");
            let refusal = refusal(&text);
            assert!(
                refusal.contains(sentence),
                "`{sentence}` is not in `{refusal}`"
            );
        }
    }

    #[test]
    fn a_name_is_given_to_one_material_only() {
        let twice = SCENE.replace(
            "\"materials\": {",
            "\"materials\": { \"ball\": { \"diffuse\": { \"albedo\": [0, 0, 0] } },",
        );
        assert!(refusal(&twice).contains("the material `ball` is given twice"));
    }

    #[test]
    fn keys_of_older_scene_files_still_load() {
        let light = r#"[{ "name": "l", "center": [0, 0, 1], "half_u": [1, 0, 0],
            "half_v": [0, -1, 0], "radiance": [1, 1, 1] }]"#;
        let scene = |key: &str| {
            let text = SCENE.replace("\"objects\"", &format!("\"{key}\": {light}, \"objects\""));
            Scene::from_json(&text).unwrap()
        };
        assert_eq!(scene("lamps"), scene("area_lights"));

        let (old, new) = (
            r#"{ "carved": { "min": [0, 0, 0], "max": [1, 1, 1], "cuts": [
                { "form": { "beyond": { "point": [0, 0, 0], "normal": [0, 0, 1] } } },
                { "form": { "bore": { "center": [0, 0, 0], "radius": 0.1 } } },
                { "form": { "hollow": { "min": [0, 0, 0], "max": [1, 1, 1] } } },
                { "form": { "turned": { "center": [0, 0, 0], "radius": 0.1 } } }] } }"#,
            r#"{ "csg_box": { "min": [0, 0, 0], "max": [1, 1, 1], "subtractions": [
                { "solid": { "half_space": { "point": [0, 0, 0], "normal": [0, 0, 1] } } },
                { "solid": { "cylinder": { "center": [0, 0, 0], "radius": 0.1 } } },
                { "solid": { "box": { "min": [0, 0, 0], "max": [1, 1, 1] } } },
                { "solid": { "cone_exterior": { "center": [0, 0, 0], "radius": 0.1 } } }] } }"#,
        );
        let [old, new] = [old, new].map(|text| serde_json::from_str::<Shape>(text).unwrap());
        assert_eq!(old, new);

        let coated = |key: &str| {
            let planks = r#"{ "planks": { "light": [1, 1, 1], "dark": [0, 0, 0] } }"#;
            let text = format!(r#"{{ "coated": {{ "ior": 1.5, "{key}": {planks} }} }}"#);
            serde_json::from_str::<Material>(&text).unwrap()
        };
        assert_eq!(coated("paint"), coated("texture"));
    }

    #[test]
    fn too_many_objects_are_refused() {
        let mut scene = Scene::from_json(SCENE).unwrap();
        scene.objects = vec![scene.objects[0].clone(); OBJECTS_MAX + 1];
        let sentence = "131073 objects: at most 131072";
        assert!(scene.to_json().unwrap_err().to_string().contains(sentence));
        scene.objects.pop();
        scene.validate().unwrap();
    }

    #[test]
    fn over_long_text_is_refused_before_it_is_parsed() {
        let refusal = refusal(&"[".repeat(SCENE_BYTES_MAX + 1));
        assert!(refusal.contains("longer than 67108864 bytes"), "{refusal}");
    }

    #[test]
    fn the_longest_scene_fits_into_a_file() {
        let mut scene = Scene::from_json(SCENE).unwrap();
        let name = "n".repeat(crate::scene::validate::NAME_BYTES_MAX);
        scene.materials = BTreeMap::from([(name.clone(), scene.materials["ball"])]);
        let third = -1.0f32 / 3.0;
        let shape = Shape::Sphere {
            center: Vec3::splat(third),
            radius: 1.0 / 3.0,
            rotation: Quat::from_xyzw(third, third, third, third).normalize(),
        };
        scene.objects = vec![Object {
            material: name.clone(),
            name,
            shape,
        }];
        let one = scene.to_json().unwrap().len();
        scene.objects.push(scene.objects[0].clone());
        let bytes = one + (scene.to_json().unwrap().len() - one) * OBJECTS_MAX;
        assert!(bytes < SCENE_BYTES_MAX, "{bytes}");
    }

    #[test]
    fn faults_of_files_control_no_terminal() {
        let field = SCENE.replace("\"objects\"", "\"\u{9b}2J\\u001b]0;owned\"");
        let name = SCENE.replace("\"center\": [0, 0, 0.1]", "\"center\": [0, 0, 1e30]");
        let name = name.replace("\"name\": \"", "\"name\": \"\\u001b[2J");
        let long = SCENE.replace("\"objects\"", &format!("\"{}\"", "x".repeat(1 << 20)));
        for text in [field, name, long] {
            let sentence = refusal(&text);
            assert!(!sentence.contains(char::is_control), "{sentence:?}");
            assert!(sentence.len() < 1100);
        }
    }

    #[test]
    fn what_is_saved_is_loaded_bit_by_bit() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("scene.json");
        let mut scene = Scene::from_json(SCENE).unwrap();
        scene.camera.eye.x = f32::from_bits(0x3dcc_cccf);
        scene.camera.target.y = 1e-30;
        scene.save(&path).unwrap();
        assert_eq!(Scene::load(&path).unwrap(), scene);
    }

    #[test]
    fn files_that_are_no_scenes_are_refused_by_name() {
        let directory = tempfile::tempdir().unwrap();
        let refusal = |path: &Path| Scene::load(path).unwrap_err().to_string();
        let absent = directory.path().join("absent.json");
        assert!(refusal(&absent).contains("absent.json: No such file"));
        assert!(refusal(directory.path()).contains("it is a directory"));

        let latin = directory.path().join("latin.json");
        fs::write(&latin, b"{\n\"name\": \"caf\xe9\"}").unwrap();
        let sentence = "latin.json: line 2: byte 14 is not UTF-8";
        assert!(refusal(&latin).contains(sentence), "{}", refusal(&latin));

        let huge = directory.path().join("huge.json");
        File::create(&huge).unwrap().set_len(1 << 40).unwrap();
        assert!(refusal(&huge).contains("longer than 67108864 bytes"));

        let slip = directory.path().join("slip.json");
        fs::write(&slip, SCENE.replace("44", "0")).unwrap();
        let sentence = "slip.json: the scene cannot be drawn: the camera's fov_x_deg is 0";
        assert!(refusal(&slip).contains(sentence), "{}", refusal(&slip));
    }
}
