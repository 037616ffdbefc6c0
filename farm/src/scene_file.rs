//! Scenes by the names of their files.

use std::path::Path;

use carom_tracer::glam::Vec3;
use carom_tracer::text::printable;
use carom_tracer::{AreaLight, Camera, Material, Mesh, Scene};

use crate::error::Error;

/// Endings of the names of files that [`open_scene`] opens, in lower case.
pub const SCENE_FILES: [&str; 5] = ["json", "gltf", "glb", "obj", "ply"];

/// The scene of a file, by the ending of its name: JSON as [`carom_tracer::scene::file`] has it, also
/// without an ending, glTF 2.0, or a mesh (OBJ, which has y upright, or PLY, which has z), in grey, under a sky
/// and a lamp, with the camera so far away that all of it is seen.
///
/// # Errors
/// [`Error::Tracer`] with the file and what is wrong in it, or that its name ends otherwise.
pub fn open_scene(path: impl AsRef<Path>) -> Result<Scene, Error> {
    let path = path.as_ref();
    let ending = path.extension().map(|ending| ending.to_ascii_lowercase());
    let format = |message| carom_tracer::Error::Format {
        path: path.to_owned(),
        message,
    };
    let up = match ending.as_deref().map(|ending| ending.to_str()) {
        None | Some(Some("json" | "gltf" | "glb")) => return Ok(Scene::load(path)?),
        Some(Some("obj")) => Vec3::Y,
        Some(Some("ply")) => Vec3::Z,
        _ => {
            let endings = SCENE_FILES.map(|ending| format!(".{ending}")).join(", ");
            let sentence = format!("a scene's name must end with one of {endings}");
            return Err(format(sentence).into());
        }
    };
    let name = path.file_stem().unwrap_or_default().to_string_lossy();
    let scene = scene_of_mesh(&printable(&name, NAME_BYTES_MAX), Mesh::load(path)?, up);
    let checked = scene.validate_visible();
    checked.map_err(|fault| format(fault.to_string()))?;
    Ok(scene)
}

/// A mesh in the middle of the picture, lit from the upper left.
fn scene_of_mesh(name: &str, mesh: Mesh, up: Vec3) -> Scene {
    let bounds = mesh.positions.iter().copied();
    let (min, max) = bounds.fold((Vec3::MAX, Vec3::MIN), |(min, max), at| {
        (min.min(at), max.max(at))
    });
    let center = 0.5 * (min + max);
    let radius = (0.5 * (max - min)).length().max(RADIUS_MIN_M);
    // Meshes with y upright have their front at +z, those with z upright at −y.
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
    scene.add_named(name, mesh, Material::grey(0.7));
    scene.add_light(lamp);
    scene
}

/// Bytes of a mesh's name that messages show.
const NAME_BYTES_MAX: usize = 64;
/// A mesh that is smaller, or a single point, is seen from as far as one of this radius.
const RADIUS_MIN_M: f32 = 1e-3;
/// Distance of the camera, whose view is 26° high at 16:9, in radii of what it sees all of.
const VIEW_RADII: f32 = 4.5;
const LAMP_RADII: f32 = 3.5;
const LAMP_EDGE_RADII: f32 = 1.75;
/// Sky and lamp together show white as nearly white.
const LAMP_RADIANCE: [f32; 3] = [10.0, 9.6, 9.0];
const SKY_RADIANCE: [f32; 3] = [0.36, 0.4, 0.44];

#[cfg(test)]
mod tests {
    use super::*;

    const TRIANGLE: &str = "v 10 20 30\nv 14 20 30\nv 10 23 30\nf 1 2 3\n";

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
