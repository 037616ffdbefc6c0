//! Nodes of a glTF file: meshes, cameras and lights where they stand.

use glam::{DMat3, DMat4, DQuat, DVec3, Vec2, Vec3};
use gltf_json::accessor::Type;
use gltf_json::camera::Perspective;
use gltf_json::extensions::scene::khr_lights_punctual::Type as LightType;
use gltf_json::mesh::{Mode, Primitive, Semantic};
use gltf_json::root::Index;
use gltf_json::scene::Node;
use gltf_json::validation::Checked;

use super::material::{MaterialEntry, UvSet};
use super::{Document, Refusal};
use crate::scene::validate::{NAME_BYTES_MAX, OBJECTS_MAX, TRIANGLES_MAX, VERTICES_MAX};
use crate::scene::{Camera, Lens, Mesh, Object, PunctualEmitter, PunctualLight, Scene, Shape};
use crate::text::printable;

/// What nodes have added so far.
struct Contents<'a> {
    document: &'a Document,
    materials: &'a [MaterialEntry],
    scene: &'a mut Scene,
    camera: Option<Camera>,
    vertices: usize,
    triangles: usize,
}

/// Adds all that the nodes of the file's scene hold.
pub(super) fn read(
    document: &Document,
    materials: &[MaterialEntry],
    scene: &mut Scene,
) -> Result<(), Refusal> {
    let mut contents = Contents {
        document,
        materials,
        scene,
        camera: None,
        vertices: 0,
        triangles: 0,
    };
    let root = &document.root;
    let mut is_reached = vec![false; root.nodes.len()];
    let mut stack: Vec<(Index<Node>, DMat4)> = roots(document)?
        .into_iter()
        .rev()
        .map(|node| (node, Z_UP))
        .collect();
    while let Some((index, world_from_parent)) = stack.pop() {
        let place = index.value();
        let node = root.nodes.get(place);
        let node = node.ok_or_else(|| format!("node {place} does not exist"))?;
        if std::mem::replace(&mut is_reached[place], true) {
            return Err(format!(
                "node {place} is reached twice: a node must have one parent, and none below itself"
            ));
        }
        let world_from_node = world_from_parent * transform(node);
        contents.add(place, node, world_from_node)?;
        let children = node.children.iter().flatten().rev();
        stack.extend(children.map(|child| (*child, world_from_node)));
    }
    let camera = contents.camera;
    if !scene.punctual_lights.is_empty() {
        // What the file lights is lit by that alone.
        scene.environment.radiance = Vec3::ZERO;
    }
    scene.camera = camera.unwrap_or_else(|| framed(scene));
    Ok(())
}

/// From glTF's +y upwards to +z upwards.
const Z_UP: DMat4 = DMat4::from_cols_array(&[
    1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, -1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0,
]);

fn roots(document: &Document) -> Result<Vec<Index<Node>>, Refusal> {
    let root = &document.root;
    let place = root.scene.map_or(0, |scene| scene.value());
    match root.scenes.get(place) {
        Some(scene) => Ok(scene.nodes.clone()),
        None => Err(format!("scene {place} does not exist")),
    }
}

fn transform(node: &Node) -> DMat4 {
    if let Some(matrix) = node.matrix {
        return DMat4::from_cols_array(&matrix.map(f64::from));
    }
    let vector =
        |v: Option<[f32; 3]>, default| v.map_or(default, |v| DVec3::from(v.map(f64::from)));
    let rotation = node
        .rotation
        .as_ref()
        .map_or([0.0, 0.0, 0.0, 1.0], |rotation| rotation.0);
    DMat4::from_scale_rotation_translation(
        vector(node.scale, DVec3::ONE),
        DQuat::from_array(rotation.map(f64::from)),
        vector(node.translation, DVec3::ZERO),
    )
}

impl Contents<'_> {
    fn add(&mut self, place: usize, node: &Node, world_from_node: DMat4) -> Result<(), Refusal> {
        let given = node.name.as_deref().unwrap_or("node");
        let name = printable(&format!("{place} {given}"), NAME_BYTES_MAX);
        if let Some(mesh) = node.mesh {
            self.add_mesh(mesh, &name, world_from_node)?;
        }
        if let Some(camera) = node.camera {
            let index = camera.value();
            let camera = self.document.root.cameras.get(index);
            let camera = camera.ok_or_else(|| format!("camera {index} does not exist"))?;
            if let (None, Some(perspective)) = (self.camera, &camera.perspective) {
                self.camera = Some(perspective_camera(perspective, world_from_node));
            }
        }
        let light = node
            .extensions
            .as_ref()
            .and_then(|all| all.khr_lights_punctual.as_ref());
        if let Some(light) = light {
            self.add_light(light.light.value(), &name, world_from_node)?;
        }
        Ok(())
    }

    /// Candela and lux are taken as W·sr⁻¹ and W·m⁻², as the radiance of emission is.
    fn add_light(
        &mut self,
        index: usize,
        node: &str,
        world_from_node: DMat4,
    ) -> Result<(), Refusal> {
        let lights = self.document.root.extensions.as_ref();
        let lights = lights.and_then(|all| all.khr_lights_punctual.as_ref());
        let light = lights.and_then(|all| all.lights.get(index));
        let light = light.ok_or_else(|| format!("light {index} does not exist"))?;
        let strength = light.intensity * Vec3::from(light.color);
        let center = world_from_node.w_axis.truncate().as_vec3();
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
                // A right angle in radians is a little more than 90° once it is rounded.
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
        node: &str,
        world_from_node: DMat4,
    ) -> Result<(), Refusal> {
        let place = mesh.value();
        let mesh = self.document.root.meshes.get(place);
        let mesh = mesh.ok_or_else(|| format!("mesh {place} does not exist"))?;
        for (index, primitive) in mesh.primitives.iter().enumerate() {
            let what = format!("mesh {place}, primitive {index}");
            let default = self.materials.len() - 1;
            let material = primitive
                .material
                .map_or(default, |material| material.value());
            let entry = self.materials[..default].get(material);
            let entry = match primitive.material {
                Some(_) => {
                    entry.ok_or_else(|| format!("{what}: material {material} does not exist"))?
                }
                None => &self.materials[default],
            };
            let shape = self.shape(primitive, entry.uvs.as_ref(), world_from_node, &what)?;
            self.scene.objects.push(Object {
                name: node.to_owned(),
                material: entry.name.clone(),
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
        world_from_node: DMat4,
        what: &str,
    ) -> Result<Mesh, Refusal> {
        let document = self.document;
        let attribute = |semantic| primitive.attributes.get(&Checked::Valid(semantic)).copied();
        let positions =
            attribute(Semantic::Positions).ok_or_else(|| format!("{what} has no positions"))?;
        let positions = document.numbers(positions, Type::Vec3, what)?;
        let count = positions.len() / 3;
        self.vertices += count;
        if self.vertices > VERTICES_MAX {
            return Err(format!("{what}: it has more than {VERTICES_MAX} vertices"));
        }
        let corners = match primitive.indices {
            Some(indices) => document.indices(indices, what)?,
            None => (0..count as u32).collect(),
        };
        let linear = DMat3::from_mat4(world_from_node);
        let determinant = linear.determinant();
        let triangles = triangles(&primitive.mode, &corners, determinant < 0.0, what)?;
        self.triangles += triangles.len();
        if self.triangles > TRIANGLES_MAX {
            return Err(format!(
                "{what}: it has more than {TRIANGLES_MAX} triangles"
            ));
        }
        let turned = |matrix: DMat3, v: &[f32; 3]| matrix * Vec3::from(*v).as_dvec3();
        let triples = |numbers: &[f32], matrix: DMat3| {
            let triples = numbers.as_chunks().0.iter();
            triples
                .map(|v| turned(matrix, v).as_vec3())
                .collect::<Vec<Vec3>>()
        };
        let mut mesh = Mesh::new(triples(&positions, linear), triangles)
            .at(world_from_node.w_axis.truncate().as_vec3());
        if let Some(normals) = attribute(Semantic::Normals).filter(|_| determinant != 0.0) {
            let normals = document.numbers(normals, Type::Vec3, what)?;
            let cofactor = linear.inverse().transpose() * determinant.abs();
            mesh = mesh.normals(triples(&normals, cofactor));
        }
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
        Ok(mesh)
    }
}

/// Triangles that go round anticlockwise, of corners in a mode.
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

/// Its picture is as wide as the file says, whatever size is drawn.
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
    }
}

/// A camera that sees all objects from above their front.
fn framed(scene: &Scene) -> Camera {
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
