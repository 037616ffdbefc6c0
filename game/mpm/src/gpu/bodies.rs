//! Conversion of bodies to the kernels' coordinates: cells from the region's first node.

use glam::{DMat3, DVec3, IVec3};

use crate::body::{Ball, Bodies, Grip, Obstacle, Solid};
use crate::gpu::layout::{BallRow, ObstacleRow};
use crate::storage::BLOCK_EDGE;

/// Height in m that stands for no floor, lower than any ball falls: f32 of the kernels must stay finite.
const FLOOR_M_MIN: f64 = -1e6;

/// The frame of a region's nodes.
#[derive(Clone, Copy)]
pub(super) struct Frame {
    /// Coordinate of the region's first block, in blocks.
    pub(super) origin: IVec3,
    pub(super) cell_size_m: f64,
}

impl Frame {
    fn cells(self, place: DVec3) -> DVec3 {
        place / self.cell_size_m - (self.origin * BLOCK_EDGE).as_dvec3()
    }

    pub(super) fn ball(self, ball: &Ball) -> BallRow {
        BallRow {
            position: self.cells(ball.position).as_vec3().into(),
            radius: (ball.radius_m / self.cell_size_m) as f32,
            velocity: ball.velocity.as_vec3().into(),
            mass: ball.mass_kg as f32,
            spin: (ball.angular_velocity * ball.radius_m).as_vec3().into(),
            floor_height: self.cells(DVec3::Z * ball.floor_m.max(FLOOR_M_MIN)).z as f32,
            acceleration: ball.acceleration.as_vec3().into(),
            ..BallRow::default()
        }
    }

    pub(super) fn obstacle(self, obstacle: &Obstacle) -> ObstacleRow {
        let is_bonded = u32::from(obstacle.grip == Grip::Bonded);
        match obstacle.solid {
            Solid::HalfSpace { point, normal } => ObstacleRow {
                place: normal.as_vec3().into(),
                offset: normal.dot(self.cells(point)) as f32,
                half_size: [-1.0; 3],
                is_bonded,
                ..ObstacleRow::default()
            },
            Solid::Cuboid {
                center,
                half_size,
                orientation,
            } => {
                let axes = DMat3::from_quat(orientation);
                let column = |axis: DVec3| axis.as_vec3().extend(0.0).into();
                ObstacleRow {
                    place: self.cells(center).as_vec3().into(),
                    half_size: (half_size / self.cell_size_m).as_vec3().into(),
                    is_bonded,
                    axes: [axes.x_axis, axes.y_axis, axes.z_axis].map(column),
                    ..ObstacleRow::default()
                }
            }
        }
    }
}

/// Applies the impulses and displacements of a batch of a duration in s to the balls. Differences are
/// applied rather than the kernels' f32 states, so that the balls keep f64 precision.
pub(super) fn move_balls(
    bodies: &mut Bodies,
    rows: &[BallRow],
    duration_secs: f64,
    cell_size_m: f64,
) {
    for (ball, row) in bodies.balls.iter_mut().zip(rows) {
        let vector = |v: [f32; 3]| glam::Vec3::from(v).as_dvec3();
        let impulse = vector(row.impulse);
        let turn = vector(row.turn) * ball.radius_m;
        ball.velocity += impulse / ball.mass_kg + ball.acceleration * duration_secs;
        if ball.floor_m > FLOOR_M_MIN {
            // The floor has taken up an unknown part of the impulse, so the kernels' own velocity is used.
            ball.velocity.z = f64::from(row.velocity[2]);
        }
        ball.angular_velocity += turn / ball.moment_of_inertia();
        ball.position += vector(row.moved) * cell_size_m;
        ball.impulse += impulse;
        ball.angular_impulse += turn;
    }
}
