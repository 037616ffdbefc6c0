//! Surface nets: one vertex in each grid cell that the surface crosses, at the mean of its crossings of the
//! cell's edges, and a quad for each crossed edge between the cells around it (Gibson, "Constrained Elastic
//! Surface Nets", MICCAI 1998).
//!
//! Each crossed edge has its quad independently of others, so that the net is closed. Where the surface
//! comes close to itself, an edge of the net may have four triangles, two of each orientation.

use glam::{IVec3, Vec3};

use super::SurfaceMesh;
use super::density::{ABOVE_FLOOR, DensityGrid, EDGE, NODES};

/// Isovalue of the density; larger values are inside.
const LEVEL: f32 = 0.5;
/// Iterations of smoothing; each moves vertices towards the mean of their neighbours and back (Taubin, "A
/// Signal Processing Approach to Fair Surface Design", SIGGRAPH 1995), which preserves volume.
const SMOOTHING_TURNS: u32 = 3;
/// Steps of an iteration, as fractions of the way to the mean of the neighbours.
const SMOOTHING: [f32; 2] = [0.5, -0.53];
/// Iterations of bilateral smoothing along the normals (Fleishman, Drori and Cohen-Or, "Bilateral Mesh
/// Denoising", ACM TOG 22(3), 2003), which preserves rims and drops, whose normals differ from vertex to
/// vertex.
const FAIRING_TURNS: u32 = 12;
/// Iterations of averaging normals with similar normals of neighbours, which keeps rims round.
const NORMAL_TURNS: u32 = 8;

/// Nodes along the edge of a block padded by the next nodes along each axis.
const PADDED: usize = EDGE as usize + 1;

/// Index of the vertex in a cell without one.
const NONE: u32 = u32::MAX;

/// Net under construction.
struct Net<'a> {
    grid: &'a DensityGrid,
    /// Per block, whether any node of it, or of the next blocks along the axes, is inside.
    is_reached: Vec<bool>,
    /// Index of the vertex in each cell, block by block; a cell is identified by its lowest node.
    vertex_of: Vec<u32>,
    positions: Vec<Vec3>,
    is_on_floor: Vec<bool>,
    /// Quads with corners counterclockwise as seen from outside.
    quads: Vec<[u32; 4]>,
}

/// Extracts the isosurface of a grid.
pub(super) fn surface(grid: &DensityGrid) -> SurfaceMesh {
    let mut net = Net {
        grid,
        is_reached: reached(grid),
        vertex_of: Vec::new(),
        positions: Vec::new(),
        is_on_floor: Vec::new(),
        quads: Vec::new(),
    };
    for (place, (block, values)) in grid.blocks().enumerate() {
        net.add_vertices(place, block, values);
    }
    for (place, (block, values)) in grid.blocks().enumerate() {
        net.add_quads(place, block, values);
    }
    for _ in 0..SMOOTHING_TURNS {
        for share in SMOOTHING {
            net.smooth(share);
        }
    }
    for _ in 0..FAIRING_TURNS {
        net.fair();
    }
    let normals = net.normals(NORMAL_TURNS);
    SurfaceMesh {
        triangles: net.triangles(),
        positions: net.positions,
        normals,
    }
}

fn reached(grid: &DensityGrid) -> Vec<bool> {
    let inside = grid
        .blocks()
        .map(|(_, values)| values.iter().any(|value| *value > LEVEL));
    let inside: Vec<bool> = inside.collect();
    let is_inside = |block: IVec3| grid.find(block).is_some_and(|place| inside[place]);
    let blocks = grid.blocks();
    let reached = blocks.map(|(block, _)| (0..8).any(|corner| is_inside(block + offset(corner))));
    reached.collect()
}

impl Net<'_> {
    fn add_vertices(&mut self, place: usize, block: IVec3, values: &[f32]) {
        let first = self.vertex_of.len();
        self.vertex_of.resize(first + NODES, NONE);
        if !self.is_reached[place] {
            return;
        }
        let padded = self.padded(block, values);
        for index in 0..NODES as i32 {
            let cell = IVec3::new(index % EDGE, index / EDGE % EDGE, index / EDGE / EDGE);
            let corners: [f32; 8] =
                std::array::from_fn(|corner| padded[padded_index(cell + offset(corner))]);
            let Some(within) = mean_crossing(&corners) else {
                continue;
            };
            self.vertex_of[first + index as usize] = self.positions.len() as u32;
            let cell = block * EDGE + cell;
            let mut position = self.grid.position(cell.as_vec3() + within);
            let is_on_floor = cell.z < ABOVE_FLOOR;
            if is_on_floor {
                position.z = self.grid.position(Vec3::splat(1.5)).z;
            }
            self.positions.push(position);
            self.is_on_floor.push(is_on_floor);
        }
    }

    /// Densities of a block and of the next nodes along each axis; 0 in blocks that are not stored.
    fn padded(&self, block: IVec3, values: &[f32]) -> [f32; PADDED * PADDED * PADDED] {
        let mut padded = [0.0; PADDED * PADDED * PADDED];
        for corner in 0..8 {
            let step = offset(corner);
            let found = self.grid.find(block + step);
            let values = match (corner, found) {
                (0, _) => values,
                (_, Some(found)) => self.grid.values_of(found),
                (_, None) => continue,
            };
            let count = IVec3::select(step.cmpeq(IVec3::ZERO), IVec3::splat(EDGE), IVec3::ONE);
            for z in 0..count.z {
                for y in 0..count.y {
                    for x in 0..count.x {
                        let node = IVec3::new(x, y, z);
                        padded[padded_index(node + step * EDGE)] = values[node_index(node)];
                    }
                }
            }
        }
        padded
    }

    /// Adds the quads of the crossed grid edges that start at a block's nodes, upwards along each axis.
    fn add_quads(&mut self, place: usize, block: IVec3, values: &[f32]) {
        if !self.is_reached[place] {
            return;
        }
        let padded = self.padded(block, values);
        for index in 0..NODES as i32 {
            let node = IVec3::new(index % EDGE, index / EDGE % EDGE, index / EDGE / EDGE);
            let is_inside = padded[padded_index(node)] > LEVEL;
            for axis in 0..3 {
                let along = IVec3::AXES[axis];
                if is_inside == (padded[padded_index(node + along)] > LEVEL) {
                    continue;
                }
                let [u, v] = [IVec3::AXES[(axis + 1) % 3], IVec3::AXES[(axis + 2) % 3]];
                // Counterclockwise as seen from the edge's upper end, which is outside if its lower end is
                // inside.
                let cells = [node - u - v, node - v, node, node - u];
                let mut corners = cells.map(|cell| self.vertex(place, block, cell));
                if !is_inside {
                    corners.reverse();
                }
                self.quads.push(corners);
            }
        }
    }

    /// Vertex of a cell, which may lie in the previous block along any axis.
    fn vertex(&self, place: usize, block: IVec3, cell: IVec3) -> u32 {
        if cell.cmpge(IVec3::ZERO).all() {
            return self.vertex_of[place * NODES + node_index(cell)];
        }
        let before = IVec3::select(cell.cmplt(IVec3::ZERO), IVec3::NEG_ONE, IVec3::ZERO);
        let found = self.grid.find(block + before);
        // Stored blocks include the margin.
        let found = found.expect("the block of each cell that the surface crosses");
        self.vertex_of[found * NODES + node_index(cell - before * EDGE)]
    }

    /// Moves each vertex by `share` of the way to the mean of its neighbours; those on the floor stay on
    /// it.
    fn smooth(&mut self, share: f32) {
        let mut sums = vec![(Vec3::ZERO, 0.0f32); self.positions.len()];
        for [a, b, c, d] in &self.quads {
            // Each edge occurs once in either of its quads: all neighbours are counted twice, which does
            // not change their mean.
            for [one, other] in [[a, b], [b, c], [c, d], [d, a]] {
                for [to, from] in [[one, other], [other, one]] {
                    let sum = &mut sums[*to as usize];
                    sum.0 += self.positions[*from as usize];
                    sum.1 += 1.0;
                }
            }
        }
        let vertices = self.positions.iter_mut().zip(&self.is_on_floor);
        for ((position, is_on_floor), (sum, count)) in vertices.zip(sums) {
            let mut way = share * (sum / count - *position);
            if *is_on_floor {
                way.z = 0.0;
            }
            *position += way;
        }
    }

    /// Moves each vertex along its normal towards the neighbours with similar normals (bilateral filter).
    fn fair(&mut self) {
        let normals = self.normals(1);
        // The vertex itself counts with weight 1 and offset 0.
        let mut sums = vec![(0.0f32, 1.0f32); self.positions.len()];
        for [a, b, c, d] in &self.quads {
            for [one, other] in [[a, b], [b, c], [c, d], [d, a]] {
                let [one, other] = [*one as usize, *other as usize];
                let weight = likeness(normals[one], normals[other]);
                let way = self.positions[other] - self.positions[one];
                sums[one].0 += weight * way.dot(normals[one]);
                sums[other].0 -= weight * way.dot(normals[other]);
                sums[one].1 += weight;
                sums[other].1 += weight;
            }
        }
        let vertices = self.positions.iter_mut().zip(&self.is_on_floor);
        for (((position, is_on_floor), normal), (sum, weight)) in vertices.zip(normals).zip(sums) {
            let mut way = normal * (sum / weight);
            if *is_on_floor {
                way.z = 0.0;
            }
            *position += way;
        }
    }

    /// Vertex normals from the quads around each vertex, averaged with similar neighbours `turns` times.
    /// Quads on the floor are excluded, so that normals at the rim are those of the sides and the edge with
    /// the floor stays sharp.
    fn normals(&self, turns: u32) -> Vec<Vec3> {
        let is_floor =
            |quad: &[u32; 4]| quad.iter().all(|corner| self.is_on_floor[*corner as usize]);
        let sides: Vec<&[u32; 4]> = self.quads.iter().filter(|quad| !is_floor(quad)).collect();
        let mut normals = vec![Vec3::ZERO; self.positions.len()];
        for quad in &sides {
            let [a, b, c, d] = quad.map(|corner| self.positions[corner as usize]);
            // Twice the vector area of the quad, planar or not: quads are weighted by area.
            let normal = (c - a).cross(d - b);
            for corner in **quad {
                normals[corner as usize] += normal;
            }
        }
        let unit = |normal: Vec3| {
            let length = normal.length();
            if length > 0.0 {
                normal / length
            } else {
                Vec3::NEG_Z
            }
        };
        let mut normals: Vec<Vec3> = normals.into_iter().map(unit).collect();
        for _ in 0..turns {
            let mut sums = normals.clone();
            for quad in &sides {
                let around = quad.map(|corner| normals[corner as usize]);
                for (corner, own) in quad.iter().zip(around) {
                    for other in around {
                        sums[*corner as usize] += likeness(own, other) * other;
                    }
                }
            }
            normals = sums.into_iter().map(unit).collect();
        }
        normals
    }

    /// Splits each quad into two triangles along its shorter diagonal.
    fn triangles(&self) -> Vec<[u32; 3]> {
        let square = |from: u32, to: u32| {
            let [from, to] = [from, to].map(|corner| self.positions[corner as usize]);
            (to - from).length_squared()
        };
        let halves =
            self.quads
                .iter()
                .flat_map(|&[a, b, c, d]| match square(a, c) <= square(b, d) {
                    true => [[a, b, c], [a, c, d]],
                    false => [[a, b, d], [b, c, d]],
                });
        halves.collect()
    }
}

/// Offset of a cell's corner from its lowest node, a bit per axis.
fn offset(corner: usize) -> IVec3 {
    let corner = corner as i32;
    IVec3::new(corner & 1, corner >> 1 & 1, corner >> 2)
}

fn node_index(node: IVec3) -> usize {
    ((node.z * EDGE + node.y) * EDGE + node.x) as usize
}

fn padded_index(node: IVec3) -> usize {
    const EDGE: i32 = PADDED as i32;
    ((node.z * EDGE + node.y) * EDGE + node.x) as usize
}

/// Mean of the surface's crossings of a cell's edges, relative to its lowest corner in edge lengths; `None`
/// if it does not cross.
fn mean_crossing(corners: &[f32; 8]) -> Option<Vec3> {
    let inside = corners.map(|value| value > LEVEL);
    if inside == [inside[0]; 8] {
        return None;
    }
    let (mut sum, mut count) = (Vec3::ZERO, 0.0);
    for axis in 0..3 {
        for from in (0..8).filter(|corner| corner >> axis & 1 == 0) {
            let to = from | 1 << axis;
            if inside[from] != inside[to] {
                let share = (LEVEL - corners[from]) / (corners[to] - corners[from]);
                let mut place = offset(from).as_vec3();
                place[axis] = share;
                sum += place;
                count += 1.0;
            }
        }
    }
    Some(sum / count)
}

/// Similarity of two unit normals: 1 if they are equal, 0 beyond 26°, as for small drops.
fn likeness(one: Vec3, other: Vec3) -> f32 {
    let share = ((one.dot(other) - LIKE_COSINE) / (1.0 - LIKE_COSINE)).max(0.0);
    share * share
}

const LIKE_COSINE: f32 = 0.9;
