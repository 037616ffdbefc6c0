//! Deformation of a glTF file's meshes: first morph targets, then skins (sections 3.7.2.2 and 3.7.3
//! of the specification).

use glam::{DMat3, DMat4, DVec3, Vec3};
use gltf_json::accessor::Type;
use gltf_json::mesh::{MorphTarget, Primitive, Semantic};
use gltf_json::validation::Checked;

use super::pose::Pose;
use super::{Document, Refusal, find};

/// Vertices of a mesh.
pub(super) struct Vertices {
    pub(super) positions: Vec<DVec3>,
    /// One per position, or none at all.
    pub(super) normals: Vec<DVec3>,
}

/// Maximum number of sets of four joints per vertex.
const JOINT_SETS_MAX: u32 = 8;
/// Maximum total number of displaced vertices over all active morph targets of a scene; a face with
/// 50 targets has half a million.
pub(super) const DISPLACEMENTS_MAX: usize = 1 << 26;

impl Vertices {
    /// The vertices of a primitive as they are in the file.
    pub(super) fn read(
        document: &Document,
        primitive: &Primitive,
        what: &str,
    ) -> Result<Self, Refusal> {
        let attribute = |semantic| primitive.attributes.get(&Checked::Valid(semantic)).copied();
        let positions =
            attribute(Semantic::Positions).ok_or_else(|| format!("{what} has no positions"))?;
        let positions = triples(&document.numbers(positions, Type::Vec3, what)?);
        let normals = match attribute(Semantic::Normals) {
            Some(normals) => triples(&document.numbers(normals, Type::Vec3, what)?),
            None => Vec::new(),
        };
        Ok(Self { positions, normals })
    }

    /// Adds the displacements of a primitive's morph targets, multiplied by `weights`; returns the
    /// number of displacements.
    pub(super) fn morph(
        &mut self,
        document: &Document,
        targets: &[MorphTarget],
        weights: &[f64],
        what: &str,
    ) -> Result<usize, Refusal> {
        let mut displacements = 0;
        let shares = targets.iter().zip(weights).enumerate();
        for (place, (target, weight)) in shares.filter(|(_, (_, weight))| **weight != 0.0) {
            let what = format!("{what}, morph target {place}");
            let parts = [
                (target.positions, &mut self.positions),
                (target.normals, &mut self.normals),
            ];
            for (accessor, of) in parts {
                let Some(accessor) = accessor.filter(|_| !of.is_empty()) else {
                    continue;
                };
                let by = triples(&document.numbers(accessor, Type::Vec3, &what)?);
                if by.len() != of.len() {
                    return Err(format!(
                        "{what} has {} displacements of {} vertices",
                        by.len(),
                        of.len()
                    ));
                }
                displacements += by.len();
                for (vertex, by) in of.iter_mut().zip(by) {
                    *vertex += *weight * by;
                }
            }
        }
        Ok(displacements)
    }

    /// Transforms positions and normals by a matrix.
    pub(super) fn transform(&mut self, matrix: DMat3) {
        for position in &mut self.positions {
            *position = matrix * *position;
        }
        let matrix_of_normals = normal_matrix(matrix);
        for normal in &mut self.normals {
            *normal = direction(matrix_of_normals * *normal);
        }
    }

    /// Transforms the vertices from mesh space to world space by linear blend skinning.
    pub(super) fn skin(
        &mut self,
        document: &Document,
        primitive: &Primitive,
        joints: &[DMat4],
        what: &str,
    ) -> Result<(), Refusal> {
        let count = self.positions.len();
        let mut blended = vec![DMat4::ZERO; count];
        let mut sums = vec![0.0; count];
        let attribute = |semantic| primitive.attributes.get(&Checked::Valid(semantic)).copied();
        for set in 0..=JOINT_SETS_MAX {
            let (indices, weights) =
                match [Semantic::Joints(set), Semantic::Weights(set)].map(attribute) {
                    [Some(indices), Some(weights)] => (indices, weights),
                    [None, None] if set > 0 => break,
                    _ => {
                        return Err(format!(
                            "{what} has a skin: it must have JOINTS_{set} and WEIGHTS_{set}"
                        ));
                    }
                };
            if set == JOINT_SETS_MAX {
                return Err(format!(
                    "{what} has more than {JOINT_SETS_MAX} sets of joints"
                ));
            }
            let indices = document.numbers(indices, Type::Vec4, what)?;
            let weights = document.numbers(weights, Type::Vec4, what)?;
            for (kind, numbers) in [("joints", &indices), ("weights", &weights)] {
                if numbers.len() != 4 * count {
                    let found = numbers.len() / 4;
                    return Err(format!(
                        "{what} has {kind} of {found} vertices, but {count} vertices"
                    ));
                }
            }
            for (place, (index, weight)) in indices.iter().zip(&weights).enumerate() {
                let vertex = place / 4;
                if !(*weight >= 0.0 && weight.is_finite()) {
                    return Err(format!(
                        "{what}: vertex {vertex} follows a joint by {weight}: it must be at least 0"
                    ));
                }
                let joint = joints.get(*index as usize);
                let joint = joint.filter(|_| *index >= 0.0 && index.fract() == 0.0);
                let joint = joint.ok_or_else(|| {
                    let joints = joints.len();
                    format!(
                        "{what}: vertex {vertex} follows joint {index}, but its skin has {joints}"
                    )
                })?;
                blended[vertex] += f64::from(*weight) * *joint;
                sums[vertex] += f64::from(*weight);
            }
        }
        if let Some(vertex) = sums.iter().position(|sum| *sum < 1e-6) {
            return Err(format!(
                "{what}: vertex {vertex} follows none of its joints"
            ));
        }
        for (vertex, (matrix, sum)) in blended.iter_mut().zip(sums).enumerate() {
            // Normalised, as quantised weights do not sum to exactly 1, which would scale the
            // vertex.
            *matrix *= 1.0 / sum;
            let position = &mut self.positions[vertex];
            *position = matrix.transform_point3(*position);
            if let Some(normal) = self.normals.get_mut(vertex) {
                *normal = direction(normal_matrix(DMat3::from_mat4(*matrix)) * *normal);
            }
        }
        Ok(())
    }
}

/// The matrices of a skin's joints, from mesh space to world space: that of each joint times its
/// inverse bind matrix.
pub(super) fn joints(
    document: &Document,
    place: usize,
    pose: &Pose,
) -> Result<Vec<DMat4>, Refusal> {
    let skin = find(&document.root.skins, place, "skin")?;
    let what = format!("skin {place}");
    let world_from_joint = skin.joints.iter().map(|joint| {
        let joint = joint.value();
        let world_from_joint = pose.world_from_node(joint);
        world_from_joint
            .ok_or_else(|| format!("{what}: its joint, node {joint}, is not in the scene"))
    });
    let mut joints: Vec<DMat4> = world_from_joint.collect::<Result<_, _>>()?;
    let Some(inverse) = skin.inverse_bind_matrices else {
        return Ok(joints);
    };
    let inverse = document.numbers(inverse, Type::Mat4, &what)?;
    if inverse.len() < 16 * joints.len() {
        return Err(format!(
            "{what} has {} joints, but {} inverse bind matrices",
            joints.len(),
            inverse.len() / 16
        ));
    }
    if let Some(place) = inverse.iter().position(|number| !number.is_finite()) {
        let value = inverse[place];
        return Err(format!(
            "{what}: inverse bind matrix {} has {value}",
            place / 16
        ));
    }
    let matrices = inverse.as_chunks::<16>().0.iter();
    for (joint, joint_from_mesh) in joints.iter_mut().zip(matrices) {
        *joint *= DMat4::from_cols_array(&joint_from_mesh.map(f64::from));
    }
    Ok(joints)
}

/// The cofactor matrix transforms normals like the inverse transpose, but also exists for singular
/// matrices. The sign keeps normals on their side under mirroring.
fn normal_matrix(matrix: DMat3) -> DMat3 {
    let DMat3 {
        x_axis: x,
        y_axis: y,
        z_axis: z,
    } = matrix;
    let side = if matrix.determinant() < 0.0 {
        -1.0
    } else {
        1.0
    };
    side * DMat3::from_cols(y.cross(z), z.cross(x), x.cross(y))
}

/// A vanishing normal belongs to degenerate triangles only, so any direction will do.
fn direction(normal: DVec3) -> DVec3 {
    if normal == DVec3::ZERO {
        return DVec3::Z;
    }
    normal.try_normalize().unwrap_or(normal)
}

fn triples(numbers: &[f32]) -> Vec<DVec3> {
    let triples = numbers.as_chunks::<3>().0.iter();
    triples
        .map(|triple| Vec3::from(*triple).as_dvec3())
        .collect()
}
