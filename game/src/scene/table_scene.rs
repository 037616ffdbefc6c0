//! Traced scene of a table, and its updates for poses of balls and a camera.

use carom_billiards::game_match::Match;
use carom_billiards::physics::{BallPose, Table};
use carom_billiards::rules::RuleSet;
use carom_tracer::{Camera, Object, ObjectPose, Scene, SceneUpdate};
use glam::{Quat, Vec3};

use crate::particles::ParticleDetail;
use crate::scene::cue_stick::{CUE_NAME, CuePose};
use crate::scene::potted_balls::potted_balls;
use crate::scene::scene_builder::{below_lamp, room, scoreboard};
use crate::scene::scoreboard::{HAND_NAME, ScoreReading, Scoreboard};
use crate::scene::table_style::TableStyle;

/// Scene of a table in its room, with the objects of balls, cue and scoreboard.
#[derive(Clone, Debug)]
pub struct TableScene {
    table: Table,
    scene: Scene,
    balls: Vec<(u8, u32)>,
    scoreboard: Scoreboard,
    /// Indices of its hands' objects.
    hands: Vec<u32>,
    /// Index of the cue's object; none on a table without a cue ball.
    cue: Option<u32>,
    detail: ParticleDetail,
    cloth_albedo: Vec3,
}

impl TableScene {
    /// The game's room in a style, around [`TableScene::table`].
    pub fn room(style: impl Into<TableStyle>) -> Self {
        Self::around(&Self::table(), style)
    }

    /// The game's room in a style, around another table.
    pub fn around(table: &Table, style: impl Into<TableStyle>) -> Self {
        Self::new(table, RuleSet::Free, style.into())
    }

    /// The default table.
    pub fn table() -> Table {
        Table::nine_foot()
    }

    /// The room of a match, with its table and the balls of its game.
    pub fn of(contest: &Match, style: impl Into<TableStyle>) -> Self {
        let rules = contest.referee().rules();
        Self::new(contest.world().table(), rules, style.into())
    }

    /// Builds the scene; objects named `ball0`, `ball1` … are the balls of those numbers.
    fn new(table: &Table, rules: RuleSet, style: TableStyle) -> Self {
        let scene = room(table, rules, style);
        let numbered = |(index, object): (usize, &carom_tracer::Object)| {
            let number = object.name.strip_prefix("ball")?.parse().ok()?;
            Some((number, index as u32))
        };
        let balls = scene
            .objects
            .iter()
            .enumerate()
            .filter_map(numbered)
            .collect();
        let is_cue = |object: &Object| object.name == CUE_NAME;
        let cue = scene.objects.iter().position(is_cue);
        let objects = (0..).zip(&scene.objects);
        let hands = objects.filter(|(_, object)| object.name == HAND_NAME);
        Self {
            table: table.clone(),
            scoreboard: scoreboard(table),
            hands: hands.map(|(index, _)| index).collect(),
            detail: style.particles,
            cloth_albedo: style.cloth.albedo(rules),
            cue: cue.map(|index| index as u32),
            scene,
            balls,
        }
    }

    /// The table in the room.
    pub fn table_inside(&self) -> &Table {
        &self.table
    }

    /// Detail of particles in its pictures.
    pub fn particle_detail(&self) -> ParticleDetail {
        self.detail
    }

    /// Albedo of the cloth.
    pub fn cloth_albedo(&self) -> Vec3 {
        self.cloth_albedo
    }

    /// The scene for the farm.
    pub fn scene(&self) -> &Scene {
        &self.scene
    }

    /// The update of the scene for a frame. Potted balls lie in their pockets; balls off the table and
    /// absent ones are hidden, and so is the cue if it is `None`. A view from straight above leaves out the
    /// lamp.
    pub fn update(&self, camera: Camera, poses: &[BallPose], cue: Option<&CuePose>) -> SceneUpdate {
        let potted = potted_balls(&self.table, poses);
        let pose_of = |&(number, object): &(u8, u32)| {
            let pose = poses.iter().find(|pose| pose.number == number);
            let in_pocket = potted.iter().find(|(ball, _)| *ball == number);
            let position = pose.and_then(|pose| match in_pocket {
                Some(&(_, center)) => Some(center),
                None => pose.on_table.then_some(pose.position),
            });
            ObjectPose {
                object,
                position: position.map_or(Vec3::ZERO, |position| position.as_vec3()),
                rotation: pose.map_or(Quat::IDENTITY, |pose| pose.rotation.as_quat().normalize()),
                visible: position.is_some(),
            }
        };
        SceneUpdate {
            camera: Some(below_lamp(&self.table, camera)),
            poses: self
                .balls
                .iter()
                .map(pose_of)
                .chain(self.cue_pose(cue))
                .collect(),
            particles: Vec::new(),
        }
    }

    /// Poses of the scoreboard's hands that differ from those in the scene.
    pub fn hand_poses(&self, reading: ScoreReading) -> impl Iterator<Item = ObjectPose> {
        let poses = self.scoreboard.hands(reading);
        let before = self.scoreboard.hands(ScoreReading::default());
        let hands = self.hands.iter().zip(poses.into_iter().zip(before));
        let turned = hands.filter(|(_, (pose, before))| pose != before);
        turned.map(|(hand, (pose, _))| ObjectPose {
            object: *hand,
            position: pose.tip,
            rotation: pose.rotation,
            visible: true,
        })
    }

    fn cue_pose(&self, cue: Option<&CuePose>) -> Option<ObjectPose> {
        Some(ObjectPose {
            object: self.cue?,
            position: cue.map_or(Vec3::ZERO, |cue| cue.tip.as_vec3()),
            rotation: cue.map_or(Quat::IDENTITY, CuePose::rotation),
            visible: cue.is_some(),
        })
    }
}

#[cfg(test)]
mod tests {
    use carom_tracer::scalar::{Ray, intersect};
    use carom_tracer::{CompiledScene, Shape};
    use glam::{DQuat, DVec3};

    use super::*;
    use crate::scene::ball_materials::BallSet;

    fn pose(number: u8, x: f64, on_table: bool) -> BallPose {
        BallPose {
            number,
            position: DVec3::new(x, 0.1, 0.028575),
            rotation: DQuat::from_rotation_x(x),
            on_table,
        }
    }

    #[test]
    fn the_room_has_sixteen_balls() {
        let table_scene = TableScene::room(BallSet::Classic);
        let mut numbers: Vec<u8> = table_scene
            .balls
            .iter()
            .map(|(number, _)| *number)
            .collect();
        numbers.sort_unstable();
        assert_eq!(numbers, (0..16).collect::<Vec<u8>>());
        for (_, object) in &table_scene.balls {
            assert!(matches!(
                table_scene.scene.objects[*object as usize].shape,
                Shape::Sphere { .. }
            ));
        }
    }

    #[test]
    fn the_cue_is_where_it_is_held_and_gone_when_it_is_not() {
        let table_scene = TableScene::room(BallSet::Classic);
        let mut compiled = CompiledScene::new(table_scene.scene()).unwrap();
        let camera = table_scene.scene().camera;
        let held = CuePose::aimed(DVec3::new(0.3, 0.2, 0.03), 0.028_575, 0.7);
        let along = Ray {
            origin: held.tip - 0.1 * held.back,
            direction: held.back,
        };
        let distance = |compiled: &CompiledScene| intersect(compiled, &along).unwrap().t;
        let update = table_scene.update(camera, &[], Some(&held));
        compiled.apply(&update).unwrap();
        assert!((distance(&compiled) - 0.1).abs() < 1e-4);
        let update = table_scene.update(camera, &[], None);
        compiled.apply(&update).unwrap();
        assert!(distance(&compiled) > 1.0);
    }

    #[test]
    fn hands_of_the_scoreboard_turn_with_the_scores() {
        let table_scene = TableScene::room(BallSet::Classic);
        let mut compiled = CompiledScene::new(table_scene.scene()).unwrap();
        assert_eq!(table_scene.hand_poses(ScoreReading::default()).count(), 0);
        // Looked at from before the tip of the first dial's long hand when the score is 3.
        let reading = ScoreReading {
            scores: [3, 0],
            minutes: 0,
        };
        let poses: Vec<_> = table_scene.hand_poses(reading).collect();
        assert_eq!(poses.len(), 2);
        let tip = (poses[1].position + poses[1].rotation * (0.01 * Vec3::Z)).as_dvec3();
        let towards = Ray {
            origin: tip - DVec3::X,
            direction: DVec3::X,
        };
        let distance = |compiled: &CompiledScene| intersect(compiled, &towards).unwrap().t;
        let at_zero = distance(&compiled);
        let update = poses
            .into_iter()
            .fold(SceneUpdate::default(), SceneUpdate::pose);
        compiled.apply(&update).unwrap();
        assert!((distance(&compiled) - 1.0).abs() < 0.006);
        assert!(at_zero > 1.006, "{at_zero}");
    }

    #[test]
    fn balls_are_drawn_where_they_lie_and_those_off_the_table_are_not() {
        let table_scene = TableScene::room(BallSet::Classic);
        let pocket = &table_scene.table.pockets()[0];
        let mut potted = pose(3, 0.0, false);
        potted.position = pocket.center.extend(-0.1);
        let poses = [pose(0, 0.25, true), potted, pose(9, -0.5, false)];
        let update = table_scene.update(table_scene.scene().camera, &poses, None);
        let mut compiled = CompiledScene::new(table_scene.scene()).unwrap();
        compiled.apply(&update).unwrap();
        let visible: Vec<_> = compiled
            .spheres
            .iter()
            .filter(|ball| ball.radius > 0.0)
            .collect();
        assert_eq!(visible.len(), 2);
        assert!(table_scene.cue.is_some());
        assert_eq!(visible[0].center, [0.25, 0.1, 0.028575]);
        let in_pocket = Vec3::from(visible[1].center).as_dvec3();
        assert!(in_pocket.truncate().distance(pocket.center) < pocket.radius_m);
        assert!(in_pocket.z < -0.1, "{in_pocket}");
    }
}
