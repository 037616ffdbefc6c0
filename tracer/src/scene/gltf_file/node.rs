//! Nodes of a glTF file: meshes, cameras and lights with their transforms.

use std::collections::BTreeMap;
use std::collections::btree_map::Entry;

use glam::{DMat3, DMat4, DQuat, DVec3, Quat, Vec2, Vec3};
use gltf_json::accessor::Type;
use gltf_json::camera::Perspective;
use gltf_json::extensions::scene::khr_lights_punctual::Type as LightType;
use gltf_json::mesh::{Mode, Primitive, Semantic};
use gltf_json::root::Index;
use gltf_json::scene::Node;
use gltf_json::validation::Checked;

use super::deformation::{self, DISPLACEMENTS_MAX, Vertices};
use super::material::{MaterialEntry, UvSet};
use super::pose::{Hierarchy, Pose};
use super::{Document, Refusal, find};
use crate::scene::validate::{
    NAME_BYTES_MAX, OBJECTS_MAX, TRIANGLES_MAX, VERTICES_MAX, bounds_body,
};
use crate::scene::{
    Camera, Lens, Mesh, Object, ObjectPose, PunctualEmitter, PunctualLight, Scene, SceneUpdate,
    Shape,
};
use crate::text::printable;

/// The scene's contents from the nodes visited so far.
struct Contents<'a> {
    document: &'a Document,
    materials: &'a [MaterialEntry],
    pose: &'a Pose,
    scene: &'a mut Scene,
    camera: Option<Camera>,
    /// Matrices of each skin's joints.
    joints: BTreeMap<usize, Vec<DMat4>>,
    vertices: usize,
    triangles: usize,
    displacements: usize,
}

/// Adds the contents of all nodes of the file's scene in a pose; returns the first perspective
/// camera, if there is one.
pub(super) fn read(
    document: &Document,
    materials: &[MaterialEntry],
    hierarchy: &Hierarchy,
    pose: &Pose,
    scene: &mut Scene,
) -> Result<Option<Camera>, Refusal> {
    let mut contents = Contents {
        document,
        materials,
        pose,
        scene,
        camera: None,
        joints: BTreeMap::new(),
        vertices: 0,
        triangles: 0,
        displacements: 0,
    };
    for place in hierarchy.nodes() {
        contents.add(place)?;
    }
    let camera = contents.camera;
    if !scene.punctual_lights.is_empty() {
        // A file with lights of its own is not lit by the default sky as well.
        scene.environment.radiance = Vec3::ZERO;
    }
    Ok(camera)
}

impl Contents<'_> {
    fn add(&mut self, place: usize) -> Result<(), Refusal> {
        let node = &self.document.root.nodes[place];
        let world_from_node = self.pose.world_from_node(place).unwrap_or_default();
        let given = node.name.as_deref().unwrap_or("node");
        let name = printable(&format!("{place} {given}"), NAME_BYTES_MAX);
        if let Some(mesh) = node.mesh {
            self.add_mesh(mesh, place, &name, world_from_node)?;
        }
        if let (None, Some(perspective)) = (self.camera, camera(self.document, node)?) {
            self.camera = Some(perspective_camera(perspective, world_from_node));
        }
        if let Some(light) = light(node) {
            self.add_light(light, &name, world_from_node)?;
        }
        Ok(())
    }

    /// Adds a light. Candela and lux are interpreted as W·sr⁻¹ and W·m⁻², consistent with the
    /// radiance of emission.
    fn add_light(
        &mut self,
        index: usize,
        node: &str,
        world_from_node: DMat4,
    ) -> Result<(), Refusal> {
        let lights = self.document.root.extensions.as_ref();
        let lights = lights.and_then(|all| all.khr_lights_punctual.as_ref());
        let light = find(lights.map_or(&[], |all| &all.lights), index, "light")?;
        let strength = light.intensity * Vec3::from(light.color);
        let center = world_from_node.w_axis.truncate().as_vec3();
        // Lights shine along their node's −z axis.
        let direction = world_from_node.transform_vector3(DVec3::NEG_Z);
        let direction = direction.normalize_or_zero().as_vec3();
        let emitter = match (&light.type_, &light.spot) {
            (Checked::Valid(LightType::Directional), _) => PunctualEmitter::Distant {
                direction,
                irradiance: strength,
            },
            (Checked::Valid(LightType::Point), _) => PunctualEmitter::Point {
                center,
                intensity: strength,
            },
            (Checked::Valid(LightType::Spot), Some(spot)) => PunctualEmitter::Spot {
                center,
                direction,
                intensity: strength,
                inner_deg: spot.inner_cone_angle.to_degrees(),
                // π/2 rounded to f32 converts to slightly more than 90°.
                outer_deg: spot.outer_cone_angle.to_degrees().min(90.0),
            },
            _ => return Err(format!("light {index} is of no type that glTF knows")),
        };
        self.scene
            .add_punctual_light(PunctualLight::new(emitter).named(node));
        Ok(())
    }

    fn add_mesh(
        &mut self,
        mesh: Index<gltf_json::Mesh>,
        node: usize,
        name: &str,
        world_from_node: DMat4,
    ) -> Result<(), Refusal> {
        let place = mesh.value();
        let mesh = find(&self.document.root.meshes, place, "mesh")?;
        let placement = match self.document.root.nodes[node].skin {
            None => MeshPlacement::Rigid(world_from_node),
            Some(skin) => {
                let skin = skin.value();
                if !self.joints.contains_key(&skin) {
                    let joints = deformation::joints(self.document, skin, self.pose)?;
                    self.joints.insert(skin, joints);
                }
                MeshPlacement::Skinned(skin)
            }
        };
        let weights = self.pose.weights(self.document, node)?;
        for (index, primitive) in mesh.primitives.iter().enumerate() {
            let what = format!("mesh {place}, primitive {index}");
            let (default, given) = self.materials.split_last().expect("a default material");
            let entry = match primitive.material {
                Some(material) => find(given, material.value(), format_args!("{what}: material"))?,
                None => default,
            };
            let shape = self.shape(primitive, entry.uvs.as_ref(), placement, &weights, &what)?;
            let body = entry.body.as_ref().filter(|_| bounds_body(&shape));
            self.scene.objects.push(Object {
                name: name.to_owned(),
                material: body.unwrap_or(&entry.name).clone(),
                shape: Shape::Mesh(shape),
            });
            if self.scene.objects.len() > OBJECTS_MAX {
                return Err(format!("{what}: it has more than {OBJECTS_MAX} objects"));
            }
        }
        Ok(())
    }

    fn shape(
        &mut self,
        primitive: &Primitive,
        uvs: Option<&UvSet>,
        placement: MeshPlacement,
        weights: &[f64],
        what: &str,
    ) -> Result<Mesh, Refusal> {
        let document = self.document;
        let mut vertices = Vertices::read(document, primitive, what)?;
        let count = vertices.positions.len();
        self.vertices += count;
        if self.vertices > VERTICES_MAX {
            return Err(format!("{what}: it has more than {VERTICES_MAX} vertices"));
        }
        if let Some(targets) = &primitive.targets {
            self.displacements += vertices.morph(document, targets, weights, what)?;
            if self.displacements > DISPLACEMENTS_MAX {
                return Err(format!(
                    "{what}: morph targets displace more than {DISPLACEMENTS_MAX} vertices"
                ));
            }
        }
        let (center, is_mirrored) = match placement {
            MeshPlacement::Rigid(world_from_node) => {
                let linear = DMat3::from_mat4(world_from_node);
                vertices.transform(linear);
                let center = world_from_node.w_axis.truncate().as_vec3();
                (center, linear.determinant() < 0.0)
            }
            MeshPlacement::Skinned(skin) => {
                // Only the joints determine the position: the transform of the mesh's own node is
                // ignored (section 3.7.3).
                vertices.skin(document, primitive, &self.joints[&skin], what)?;
                (Vec3::ZERO, false)
            }
        };
        let corners = match primitive.indices {
            Some(indices) => document.indices(indices, what)?,
            None => (0..count as u32).collect(),
        };
        let triangles = triangles(&primitive.mode, &corners, is_mirrored, what)?;
        self.triangles += triangles.len();
        if self.triangles > TRIANGLES_MAX {
            return Err(format!(
                "{what}: it has more than {TRIANGLES_MAX} triangles"
            ));
        }
        let rounded = |vectors: &[DVec3]| vectors.iter().map(|v| v.as_vec3()).collect();
        let mut mesh = Mesh::new(rounded(&vertices.positions), triangles)
            .normals(rounded(&vertices.normals))
            .at(center);
        let attribute = |semantic| primitive.attributes.get(&Checked::Valid(semantic)).copied();
        if let Some(uvs) = uvs {
            let set = attribute(Semantic::TexCoords(uvs.index)).ok_or_else(|| {
                format!(
                    "{what} has no texture coordinates {}, which its material uses",
                    uvs.index
                )
            })?;
            let numbers = document.numbers(set, Type::Vec2, what)?;
            let pairs = numbers.as_chunks().0.iter();
            mesh = mesh.uvs(
                pairs
                    .map(|uv: &[f32; 2]| uvs.apply(Vec2::from(*uv)))
                    .collect(),
            );
        }
        if let Some(colors) = attribute(Semantic::Colors(0)) {
            mesh = mesh.colors(document.colors(colors, what)?);
        }
        Ok(mesh)
    }
}

/// How the vertices of a mesh are transformed to world space.
#[derive(Clone, Copy)]
enum MeshPlacement {
    /// By the matrix of the mesh's node.
    Rigid(DMat4),
    /// By the joints of the skin with this index.
    Skinned(usize),
}

/// The update that takes the scene in one pose to another; `None` if more differs than the poses of
/// objects and the camera.
pub(super) fn update(
    document: &Document,
    hierarchy: &Hierarchy,
    from: &Pose,
    to: &Pose,
) -> Result<Option<SceneUpdate>, Refusal> {
    let mut update = SceneUpdate::default();
    let mut is_same_skin: BTreeMap<usize, bool> = BTreeMap::new();
    let mut object = 0;
    for place in hierarchy.nodes() {
        let node = &document.root.nodes[place];
        let [before, after] =
            [from, to].map(|pose| pose.world_from_node(place).unwrap_or_default());
        if light(node).is_some() && before != after {
            return Ok(None);
        }
        if let (None, Some(camera)) = (update.camera, camera(document, node)?) {
            update.camera = Some(perspective_camera(camera, after));
        }
        let Some(mesh) = node.mesh else { continue };
        let first: u32 = object;
        object += document.root.meshes[mesh.value()].primitives.len() as u32;
        if from.weights(document, place)? != to.weights(document, place)? {
            return Ok(None);
        }
        if let Some(skin) = node.skin {
            let skin = skin.value();
            let is_same = match is_same_skin.entry(skin) {
                Entry::Occupied(known) => *known.get(),
                Entry::Vacant(place) => {
                    let [before, after] =
                        [from, to].map(|pose| deformation::joints(document, skin, pose));
                    *place.insert(before? == after?)
                }
            };
            if !is_same {
                return Ok(None);
            }
        } else if before != after {
            let Some(rotation) = rotation(before, after) else {
                return Ok(None);
            };
            update
                .poses
                .extend((first..object).map(|object| ObjectPose {
                    object,
                    position: after.w_axis.truncate().as_vec3(),
                    rotation,
                    visible: true,
                }));
        }
    }
    Ok(Some(update))
}

/// The rotation by which the linear parts of two transforms differ, if they differ by a rotation
/// only.
fn rotation(before: DMat4, after: DMat4) -> Option<Quat> {
    let [before, after] = [before, after].map(DMat3::from_mat4);
    if before == after {
        return Some(Quat::IDENTITY);
    }
    if before.determinant() == 0.0 {
        return None;
    }
    let between = after * before.inverse();
    // A rotation is orthogonal: RᵀR − I vanishes.
    let unlike = between.transpose() * between - DMat3::IDENTITY;
    let off = unlike
        .to_cols_array()
        .into_iter()
        .map(f64::abs)
        .fold(0.0, f64::max);
    let is_rotation = off < ROTATION_ERROR_MAX && between.determinant() > 0.0;
    let rotation =
        is_rotation.then(|| DQuat::from_mat3(&between).normalize().as_quat().normalize());
    rotation.filter(|rotation| rotation.is_finite())
}

/// Tolerance for the file's values, which are rounded to 24 bits.
const ROTATION_ERROR_MAX: f64 = 1e-5;

/// Anticlockwise triangles from the corners of a primitive.
fn triangles(
    mode: &Checked<Mode>,
    corners: &[u32],
    is_mirrored: bool,
    what: &str,
) -> Result<Vec<[u32; 3]>, Refusal> {
    let mut triangles: Vec<[u32; 3]> = match mode {
        Checked::Valid(Mode::Triangles) => corners.as_chunks().0.to_vec(),
        Checked::Valid(Mode::TriangleStrip) => {
            let strip = corners.windows(3).enumerate();
            strip
                // In a strip, every other triangle has the opposite winding.
                .map(|(i, three)| match i % 2 {
                    0 => [three[0], three[1], three[2]],
                    _ => [three[1], three[0], three[2]],
                })
                .collect()
        }
        Checked::Valid(Mode::TriangleFan) => match corners {
            [first, others @ ..] => {
                let pairs = others.windows(2);
                pairs.map(|pair| [*first, pair[0], pair[1]]).collect()
            }
            [] => Vec::new(),
        },
        Checked::Valid(mode) => {
            return Err(format!(
                "{what} is made of {mode:?}: only triangles are drawn"
            ));
        }
        Checked::Invalid => return Err(format!("{what} has no mode that glTF knows")),
    };
    if is_mirrored {
        triangles.iter_mut().for_each(|corners| corners.swap(1, 2));
    }
    Ok(triangles)
}

/// A node of the file's scene that has a perspective camera.
#[derive(Debug)]
pub(super) struct NodeCamera {
    pub(super) node: usize,
    pub(super) name: String,
}

/// All perspective cameras of the file's scene.
pub(super) fn cameras(
    document: &Document,
    hierarchy: &Hierarchy,
) -> Result<Vec<NodeCamera>, Refusal> {
    let mut cameras = Vec::new();
    for place in hierarchy.nodes() {
        let node = &document.root.nodes[place];
        if let (Some(index), Some(_)) = (node.camera, camera(document, node)?) {
            let own = document.root.cameras[index.value()].name.as_deref();
            let name = own.or(node.name.as_deref()).unwrap_or_default();
            cameras.push(NodeCamera {
                node: place,
                name: printable(name, NAME_BYTES_MAX),
            });
        }
    }
    Ok(cameras)
}

/// The camera of a node in a pose.
pub(super) fn camera_of(document: &Document, pose: &Pose, place: usize) -> Result<Camera, Refusal> {
    let perspective = camera(document, &document.root.nodes[place])?;
    let perspective = perspective.ok_or_else(|| format!("node {place} has no camera"))?;
    let world_from_node = pose.world_from_node(place).unwrap_or_default();
    Ok(perspective_camera(perspective, world_from_node))
}

/// The perspective camera of a node, if it has one.
fn camera<'a>(document: &'a Document, node: &Node) -> Result<Option<&'a Perspective>, Refusal> {
    let Some(index) = node.camera else {
        return Ok(None);
    };
    let place = index.value();
    let camera = find(&document.root.cameras, place, "camera")?;
    Ok(camera.perspective.as_ref())
}

/// The index of a node's light, if it has one.
fn light(node: &Node) -> Option<usize> {
    let extensions = node.extensions.as_ref()?;
    Some(extensions.khr_lights_punctual.as_ref()?.light.value())
}

/// A camera whose horizontal field of view is that of the file's aspect ratio, whatever the aspect
/// ratio of the image.
fn perspective_camera(perspective: &Perspective, world_from_node: DMat4) -> Camera {
    let aspect = f64::from(perspective.aspect_ratio.unwrap_or(16.0 / 9.0));
    let half_width = aspect * (0.5 * f64::from(perspective.yfov)).tan();
    let direction = |v: DVec3| world_from_node.transform_vector3(v).normalize_or_zero();
    let eye = world_from_node.w_axis.truncate();
    Camera {
        eye: eye.as_vec3(),
        target: (eye + direction(DVec3::NEG_Z)).as_vec3(),
        up: direction(DVec3::Y).as_vec3(),
        fov_x_deg: (2.0 * half_width.atan()).to_degrees() as f32,
        lens: Lens::default(),
        near_m: 0.0,
    }
}

/// A camera that sees all meshes from the front and above.
pub(super) fn framed(scene: &Scene) -> Camera {
    let (mut min, mut max) = (Vec3::INFINITY, Vec3::NEG_INFINITY);
    for object in &scene.objects {
        if let Shape::Mesh(mesh) = &object.shape {
            for position in &mesh.positions {
                min = min.min(mesh.center + *position);
                max = max.max(mesh.center + *position);
            }
        }
    }
    if !(min.is_finite() && max.is_finite()) {
        return Camera::looking_at([0.0, -4.0, 2.0], [0.0; 3]);
    }
    let (center, radius) = (0.5 * (min + max), (0.5 * (max - min).length()).max(1e-3));
    let from = Vec3::new(0.5, -1.0, 0.45).normalize();
    Camera::looking_at(center + 3.0 * radius * from, center)
}
