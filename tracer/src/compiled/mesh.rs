//! Meshes as triangles in world space.

use std::any::Any;
use std::collections::BTreeMap;
use std::fmt;
use std::ops::Range;
use std::sync::{Arc, Mutex, PoisonError};

use bytemuck::Zeroable as _;
use glam::{DQuat, DVec3, Vec3};

use super::data::{TriangleColors, TriangleData, TriangleNormals, TriangleUvs};
use super::particle_surface::SurfaceMesh;
use crate::SceneError;
use crate::scene::{Mesh, ObjectPose, ParticleCloud, ParticleForm};

/// Meshes of a scene. Their arrays, and what back ends derive from them, are shared between copies of the
/// scene until meshes move.
#[derive(Clone, Debug, Default)]
pub struct CompiledMeshes {
    /// Triangles, mesh by mesh in the order of the scene's objects, then those of particle surfaces.
    pub triangles: Arc<Vec<TriangleData>>,
    /// Vertex normals of the triangles that have any.
    pub normals: Arc<Vec<TriangleNormals>>,
    /// Texture coordinates of the triangles that have any.
    pub uvs: Arc<Vec<TriangleUvs>>,
    /// Vertex colours of the triangles up to the last that has any; all later ones are white.
    pub colors: Arc<Vec<TriangleColors>>,
    /// Largest sum of a vertex's absolute coordinates, metres.
    pub reach: f32,
    placed: Vec<PlacedMesh>,
    /// Clouds whose surfaces are included, with their materials.
    surfaces: Vec<(u32, ParticleCloud)>,
    /// Triangles in the layout of the CPU tracer.
    pub(crate) layout: LayoutCache,
}

/// A mesh of a compiled scene, with its ranges in the arrays.
#[derive(Clone, Debug)]
struct PlacedMesh {
    /// Pose in the scene.
    base: ObjectPose,
    /// Current pose.
    pose: ObjectPose,
    triangles: Range<usize>,
    normals: Range<usize>,
    /// Triangles and normals in the base pose, if the mesh is elsewhere.
    unmoved: Option<(Vec<TriangleData>, Vec<TriangleNormals>)>,
}

impl CompiledMeshes {
    /// Appends an object's mesh; returns the index of its first triangle.
    pub(super) fn push(&mut self, object: u32, mesh: &Mesh, material: u32) -> u32 {
        let (triangles, normals) = (self.triangles.len(), self.normals.len());
        let world_from_mesh = mesh.rotation.as_dquat().normalize();
        let center = mesh.center.as_dvec3();
        let point = |p: Vec3| center + world_from_mesh * p.as_dvec3();
        let points: Vec<Vec3> = (mesh.positions.iter().map(|&p| point(p).as_vec3())).collect();
        let directions: Vec<Vec3> = (mesh.normals.iter())
            .map(|n| (world_from_mesh * n.as_dvec3().normalize()).as_vec3())
            .collect();
        let has_normals = !directions.is_empty();
        let first = [
            has_normals.then_some(normals as u32),
            (!mesh.uvs.is_empty()).then_some(self.uvs.len() as u32),
        ];
        let added = triangle_data(&mesh.triangles, &points, material, first);
        Arc::make_mut(&mut self.triangles).extend(added);
        if has_normals {
            let added = triangle_normals(&mesh.triangles, &directions);
            Arc::make_mut(&mut self.normals).extend(added);
        }
        if !mesh.uvs.is_empty() {
            let added = mesh
                .triangles
                .iter()
                .map(|corners| triangle_uvs(mesh, corners));
            Arc::make_mut(&mut self.uvs).extend(added);
        }
        self.push_colors(triangles, mesh);
        let base = ObjectPose {
            object,
            position: mesh.center,
            rotation: mesh.rotation,
            visible: true,
        };
        self.placed.push(PlacedMesh {
            base,
            pose: base,
            triangles: triangles..self.triangles.len(),
            normals: normals..self.normals.len(),
            unmoved: None,
        });
        self.reach = self.reach.max(reach(&self.triangles[triangles..]));
        triangles as u32
    }

    /// Appends the vertex colours of a mesh whose first triangle has index `triangles`.
    fn push_colors(&mut self, triangles: usize, mesh: &Mesh) {
        if !mesh.colors.is_empty() {
            let colors = Arc::make_mut(&mut self.colors);
            colors.resize(triangles, TriangleColors::WHITE);
            colors.extend(mesh.triangles.iter().map(|corners| {
                TriangleColors::new(corners.map(|corner| mesh.colors[corner as usize]))
            }));
        }
    }

    /// Whether an object is a mesh.
    pub(super) fn has(&self, object: u32) -> bool {
        self.place_of(object).is_some()
    }

    /// Moves meshes to `poses`, and all others to their poses in the scene. Returns whether any has
    /// moved since the last call.
    pub(super) fn place(&mut self, poses: &[ObjectPose]) -> bool {
        let moved = self.placed.iter().enumerate();
        let moved = moved.filter(|(_, mesh)| mesh.unmoved.is_some());
        let mut wanted: BTreeMap<usize, ObjectPose> =
            moved.map(|(place, mesh)| (place, mesh.base)).collect();
        let posed = poses.iter();
        wanted.extend(posed.filter_map(|pose| Some((self.place_of(pose.object)?, *pose))));
        let mut has_moved = false;
        for (place, pose) in wanted {
            let mesh = &mut self.placed[place];
            // Skipped also because `Arc::make_mut` would copy triangles that other scenes share.
            if pose == mesh.pose {
                continue;
            }
            has_moved = true;
            let triangles = &mut Arc::make_mut(&mut self.triangles)[mesh.triangles.clone()];
            let normals = match mesh.normals.is_empty() {
                true => &mut [],
                false => &mut Arc::make_mut(&mut self.normals)[mesh.normals.clone()],
            };
            mesh.move_to(pose, triangles, normals);
        }
        if has_moved {
            self.reach = reach(&self.triangles);
            // A new cache instead of clearing the old one, which unmoved copies of the scene share.
            self.layout = LayoutCache::default();
        }
        has_moved
    }

    /// Replaces the particle surfaces behind the scene's own triangles by those of `clouds`, which are
    /// valid and have these materials, padded with hidden triangles to a power of two, as kernels are
    /// specialised for the number of primitives. Returns whether any surface has changed.
    ///
    /// # Errors
    /// As [`SurfaceMesh::new`], with the index of the cloud in the update; the meshes are unchanged then.
    pub(super) fn set_surfaces(
        &mut self,
        clouds: &[(u32, usize, &ParticleCloud)],
    ) -> Result<bool, SceneError> {
        let before = self
            .surfaces
            .iter()
            .map(|(material, cloud)| (*material, cloud));
        if before.eq(clouds
            .iter()
            .map(|(material, _, cloud)| (*material, *cloud)))
        {
            return Ok(false);
        }
        let meshes = clouds.iter().filter_map(|(material, index, cloud)| {
            let ParticleForm::Surface {
                smoothing_m,
                floor_m,
            } = cloud.form
            else {
                return None;
            };
            let mesh = SurfaceMesh::new(cloud, smoothing_m, floor_m);
            let mesh = mesh.map_err(|fault| fault.of_cloud(*index));
            Some(mesh.map(|mesh| (*material, mesh)))
        });
        let meshes = meshes.collect::<Result<Vec<_>, _>>()?;
        let own = self.placed.last();
        let [triangles_own, normals_own] =
            own.map_or([0; 2], |mesh| [mesh.triangles.end, mesh.normals.end]);
        let triangles = Arc::make_mut(&mut self.triangles);
        let normals = Arc::make_mut(&mut self.normals);
        triangles.truncate(triangles_own);
        normals.truncate(normals_own);
        self.layout = LayoutCache::default();
        for (material, mesh) in &meshes {
            let first = [Some(normals.len() as u32), None];
            let positions = &mesh.positions;
            triangles.extend(triangle_data(&mesh.triangles, positions, *material, first));
            normals.extend(triangle_normals(&mesh.triangles, &mesh.normals));
        }
        hide_up_to_slots(triangles, normals, triangles_own);
        self.reach = reach(triangles);
        self.surfaces = (clouds.iter())
            .map(|(material, _, cloud)| (*material, (*cloud).clone()))
            .collect();
        Ok(true)
    }

    /// Material of each mesh and particle surface; all triangles of one share it.
    pub(crate) fn materials(&self) -> impl Iterator<Item = u32> {
        let firsts = self.placed.iter().map(|mesh| mesh.triangles.start);
        let own = firsts.filter_map(|first| Some(self.triangles.get(first)?.material));
        own.chain(self.surfaces.iter().map(|(material, _)| *material))
    }

    fn place_of(&self, object: u32) -> Option<usize> {
        self.placed
            // Sorted, as meshes are appended in the order of the scene's objects.
            .binary_search_by_key(&object, |mesh| mesh.base.object)
            .ok()
    }

    /// Index of the first triangle of the mesh that contains `triangle`; all particle surfaces count as one
    /// mesh.
    pub(crate) fn first_of_mesh(&self, triangle: u32) -> u32 {
        let own = self
            .placed
            .last()
            .map_or(0, |mesh| mesh.triangles.end as u32);
        if triangle >= own {
            return own;
        }
        let next = (self.placed).partition_point(|mesh| mesh.triangles.start <= triangle as usize);
        self.placed[next - 1].triangles.start as u32
    }

    /// First triangle and current pose of each mesh.
    pub(crate) fn poses(&self) -> impl Iterator<Item = (u32, ObjectPose)> {
        let meshes = self.placed.iter();
        meshes.map(|mesh| (mesh.triangles.start as u32, mesh.pose))
    }
}

impl PlacedMesh {
    fn move_to(
        &mut self,
        pose: ObjectPose,
        triangles: &mut [TriangleData],
        normals: &mut [TriangleNormals],
    ) {
        let (base_triangles, base_normals) = self
            .unmoved
            .get_or_insert_with(|| (triangles.to_vec(), normals.to_vec()));
        // From the base pose each time, so that rounding errors do not accumulate over movements.
        triangles.copy_from_slice(base_triangles);
        normals.copy_from_slice(base_normals);
        let movement = Movement::new(&self.base, &pose);
        self.pose = pose;
        if pose == self.base {
            self.unmoved = None;
            return;
        }
        for triangle in triangles {
            for corner in [&mut triangle.a, &mut triangle.b, &mut triangle.c] {
                *corner = match pose.visible {
                    true => movement.point(*corner),
                    // A degenerate triangle is never hit.
                    false => pose.position.to_array(),
                };
            }
        }
        for normals in normals {
            for normal in [&mut normals.a, &mut normals.b, &mut normals.c] {
                *normal = movement.direction(*normal);
            }
        }
    }
}

/// Rigid motion from one pose to another.
struct Movement {
    from: DVec3,
    to: DVec3,
    turn: DQuat,
}

impl Movement {
    fn new(from: &ObjectPose, to: &ObjectPose) -> Self {
        let rotation = |pose: &ObjectPose| pose.rotation.as_dquat().normalize();
        Self {
            from: from.position.as_dvec3(),
            to: to.position.as_dvec3(),
            turn: rotation(to) * rotation(from).inverse(),
        }
    }

    fn point(&self, p: [f32; 3]) -> [f32; 3] {
        let from_center = Vec3::from(p).as_dvec3() - self.from;
        (self.to + self.turn * from_center).as_vec3().to_array()
    }

    fn direction(&self, v: [f32; 3]) -> [f32; 3] {
        let direction = self.turn * Vec3::from(v).as_dvec3();
        direction.as_vec3().to_array()
    }
}

/// Triangles between points; `first` are the indices of the first triangle's normals and texture
/// coordinates, if any.
fn triangle_data(
    triangles: &[[u32; 3]],
    points: &[Vec3],
    material: u32,
    first: [Option<u32>; 2],
) -> impl Iterator<Item = TriangleData> {
    triangles.iter().zip(0u32..).map(move |(corners, index)| {
        let [a, b, c] = corners.map(|corner| points[corner as usize].to_array());
        let [normals, uvs] =
            first.map(|first| first.map_or(TriangleData::FLAT, |first| first + index));
        TriangleData {
            a,
            b,
            c,
            material,
            normals,
            uvs,
        }
    })
}

fn triangle_normals(
    triangles: &[[u32; 3]],
    directions: &[Vec3],
) -> impl Iterator<Item = TriangleNormals> {
    triangles.iter().map(|corners| {
        let [a, b, c] = corners.map(|corner| directions[corner as usize].to_array());
        TriangleNormals {
            a,
            b,
            c,
            ..TriangleNormals::zeroed()
        }
    })
}

/// Appends degenerate triangles until the number of triangles after the first `own` is a power of two.
fn hide_up_to_slots(
    triangles: &mut Vec<TriangleData>,
    normals: &mut Vec<TriangleNormals>,
    own: usize,
) {
    let count = triangles.len() - own;
    if let (Some(last), Some(normal)) = (triangles.last().copied(), normals.last().copied())
        && count > 0
    {
        let hidden = TriangleData {
            b: last.a,
            c: last.a,
            ..last
        };
        let slots = count.next_power_of_two().max(SURFACE_SLOTS_MIN);
        triangles.extend(std::iter::repeat_n(hidden, slots - count));
        normals.extend(std::iter::repeat_n(normal, slots - count));
    }
}

/// Least number of triangles of particle surfaces, including hidden ones.
const SURFACE_SLOTS_MIN: usize = 1024;

fn triangle_uvs(mesh: &Mesh, corners: &[u32; 3]) -> TriangleUvs {
    let [a, b, c] = corners.map(|corner| mesh.positions[corner as usize].as_dvec3());
    let [ta, tb, tc] = corners.map(|corner| mesh.uvs[corner as usize].as_dvec2());
    let area = (b - a).cross(c - a).length();
    let covered = (tb - ta).perp_dot(tc - ta).abs();
    // Both areas are those of parallelograms; their ratio is that of the triangles.
    let density = if area > 0.0 {
        (covered / area).sqrt()
    } else {
        0.0
    };
    TriangleUvs {
        a: ta.as_vec2().to_array(),
        b: tb.as_vec2().to_array(),
        c: tc.as_vec2().to_array(),
        density: density.min(f64::from(f32::MAX)) as f32,
        padding: 0,
    }
}

/// Largest sum of a vertex's absolute coordinates, metres.
fn reach(triangles: &[TriangleData]) -> f32 {
    let corners = triangles.iter().flat_map(TriangleData::corners);
    let sums = corners.map(|corner| corner.abs().element_sum());
    sums.fold(0.0, f32::max)
}

/// Data that a back end has derived from a scene's triangles, cached from image to image.
#[derive(Clone, Default)]
pub(crate) struct LayoutCache(Arc<Mutex<Option<CachedLayout>>>);

type CachedLayout = Arc<dyn Any + Send + Sync>;

impl LayoutCache {
    /// The cached layout, made if there is none. Two threads may make it at the same time: holding the lock
    /// meanwhile could block threads of the pool that `make` itself works with.
    pub(crate) fn get_or_make<T: Any + Send + Sync>(&self, make: impl FnOnce() -> T) -> Arc<T> {
        let cached = || self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let found = cached().clone();
        if let Some(layout) = found.and_then(|layout| layout.downcast().ok()) {
            return layout;
        }
        let made = Arc::new(make());
        *cached() = Some(made.clone());
        made
    }
}

impl fmt::Debug for LayoutCache {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("LayoutCache")
    }
}
