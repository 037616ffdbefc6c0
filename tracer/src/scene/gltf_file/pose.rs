//! Poses: the transforms of a glTF file's nodes at a time, and the weights of morph targets.

use std::collections::BTreeMap;

use glam::{DMat4, DQuat, DVec3};
use gltf_json::Root;
use gltf_json::animation::Property;
use gltf_json::mesh::Primitive;
use gltf_json::scene::Node;

use super::animation::Animation;
use super::{Document, Refusal, find};

/// The nodes of the file's scene, parents before their children.
#[derive(Debug)]
pub(super) struct Hierarchy {
    /// Each node with its parent.
    nodes: Vec<(usize, Option<usize>)>,
}

/// The state of all nodes of the file's scene at a time.
#[derive(Clone, Debug)]
pub(super) struct Pose {
    world_from_node: Vec<Option<DMat4>>,
    /// Weights of morph targets, for nodes with animated weights.
    weights: BTreeMap<usize, Vec<f64>>,
}

/// A node's transform relative to its parent.
#[derive(Clone, Copy)]
struct Placement {
    translation: DVec3,
    rotation: DQuat,
    scale: DVec3,
}

/// Converts from glTF's y-up to z-up coordinates.
const Z_UP: DMat4 = DMat4::from_cols_array(&[
    1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, -1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0,
]);

impl Hierarchy {
    pub(super) fn read(document: &Document) -> Result<Self, Refusal> {
        let root = &document.root;
        let place = root.scene.map_or(0, |scene| scene.value());
        let scene = find(&root.scenes, place, "scene")?;
        let mut is_reached = vec![false; root.nodes.len()];
        // Depth-first; reversed, as a stack returns the last node first.
        let roots = scene.nodes.iter().rev();
        let mut stack: Vec<_> = roots.map(|node| (node.value(), None)).collect();
        let mut nodes = Vec::new();
        while let Some((place, parent)) = stack.pop() {
            let node = find(&root.nodes, place, "node")?;
            if std::mem::replace(&mut is_reached[place], true) {
                return Err(format!(
                    "node {place} is reached twice: a node must have one parent, and none below itself"
                ));
            }
            nodes.push((place, parent));
            let children = node.children.iter().flatten().rev();
            stack.extend(children.map(|child| (child.value(), Some(place))));
        }
        Ok(Self { nodes })
    }

    /// The nodes' indices, parents first.
    pub(super) fn nodes(&self) -> impl Iterator<Item = usize> + '_ {
        self.nodes.iter().map(|(node, _)| *node)
    }

    /// The pose at rest, or at a time of an animation in seconds.
    pub(super) fn pose(&self, document: &Document, at: Option<(&Animation, f64)>) -> Pose {
        let nodes = &document.root.nodes;
        let mut placements: Vec<_> = nodes.iter().map(placement).collect();
        let mut weights = BTreeMap::new();
        let channels = at.map_or(&[][..], |(animation, _)| animation.channels());
        for channel in channels {
            let value = channel.track.at(at.map_or(0.0, |(_, secs)| secs));
            let placement = &mut placements[channel.node];
            match (channel.property, value.as_slice()) {
                (Property::Translation, [x, y, z]) => {
                    placement.translation = DVec3::new(*x, *y, *z);
                }
                (Property::Scale, [x, y, z]) => placement.scale = DVec3::new(*x, *y, *z),
                (Property::Rotation, [x, y, z, w]) => {
                    placement.rotation = DQuat::from_xyzw(*x, *y, *z, *w);
                }
                _ => _ = weights.insert(channel.node, value),
            }
        }
        let mut world_from_node = vec![None; nodes.len()];
        for &(place, parent) in &self.nodes {
            let world_from_parent = parent.and_then(|parent| world_from_node[parent]);
            let parent_from_node = match nodes[place].matrix {
                Some(matrix) => DMat4::from_cols_array(&matrix.map(f64::from)),
                None => placements[place].matrix(),
            };
            world_from_node[place] = Some(world_from_parent.unwrap_or(Z_UP) * parent_from_node);
        }
        Pose {
            world_from_node,
            weights,
        }
    }
}

impl Pose {
    /// The matrix from a node to world space; `None` if the scene does not contain the node.
    pub(super) fn world_from_node(&self, node: usize) -> Option<DMat4> {
        *self.world_from_node.get(node)?
    }

    /// Weights of the morph targets of a node's mesh: from the animation, or else the node, or else
    /// the mesh, or else 0.
    pub(super) fn weights(&self, document: &Document, place: usize) -> Result<Vec<f64>, Refusal> {
        if let Some(weights) = self.weights.get(&place) {
            return Ok(weights.clone());
        }
        let node = &document.root.nodes[place];
        let mesh = node
            .mesh
            .and_then(|mesh| document.root.meshes.get(mesh.value()));
        let of_mesh = mesh.and_then(|mesh| mesh.weights.as_ref());
        let targets = document.targets(node)?;
        match node.weights.as_ref().or(of_mesh) {
            Some(weights) if weights.len() != targets => Err(format!(
                "node {place} has {} weights, but its mesh has {targets} morph targets",
                weights.len()
            )),
            Some(weights) => Ok(weights.iter().map(|weight| f64::from(*weight)).collect()),
            None => Ok(vec![0.0; targets]),
        }
    }
}

impl Placement {
    fn matrix(self) -> DMat4 {
        DMat4::from_scale_rotation_translation(self.scale, self.rotation, self.translation)
    }
}

fn placement(node: &Node) -> Placement {
    let vector =
        |v: Option<[f32; 3]>, default| v.map_or(default, |v| DVec3::from(v.map(f64::from)));
    let rotation = node.rotation.as_ref();
    let rotation = rotation.map_or([0.0, 0.0, 0.0, 1.0], |rotation| rotation.0);
    Placement {
        translation: vector(node.translation, DVec3::ZERO),
        rotation: DQuat::from_array(rotation.map(f64::from)),
        scale: vector(node.scale, DVec3::ONE),
    }
}

impl Document {
    /// Number of morph targets of a node's mesh.
    pub(super) fn targets(&self, node: &Node) -> Result<usize, Refusal> {
        let Some(index) = node.mesh else { return Ok(0) };
        find(&self.targets, index.value(), "mesh").copied()
    }
}

/// Number of morph targets of each mesh, which must be the same for all of its primitives.
pub(super) fn targets(root: &Root) -> Result<Vec<usize>, Refusal> {
    let count = |primitive: &Primitive| primitive.targets.as_ref().map_or(0, Vec::len);
    let of_mesh = |(place, mesh): (usize, &gltf_json::Mesh)| {
        let mut counts = mesh.primitives.iter().map(count);
        let first = counts.next().unwrap_or(0);
        match counts.find(|other| *other != first) {
            Some(other) => Err(format!(
                "mesh {place} has primitives of {first} and of {other} morph targets: all must have as many"
            )),
            None => Ok(first),
        }
    };
    root.meshes.iter().enumerate().map(of_mesh).collect()
}
