//! Export of a game's scene before its first stroke: `carom scene`.

use std::path::PathBuf;

use carom_billiards::game_match::{Match, MatchConfig, Player};
use carom_billiards::rules::RuleSet;
use carom_tracer::{Camera, Scene, SceneUpdate, Shape};
use clap::{Args, ValueEnum};
use glam::DVec3;

use crate::camera::Viewpoint;
use crate::output_file::output_file;
use crate::scene::ball_materials::BallSet;
use crate::scene::cue_stick::CuePose;
use crate::scene::table_args::TableArgs;
use crate::scene::table_scene::TableScene;
use crate::scene::table_style::{ClothColour, TableStyle};

/// Options of `carom scene`.
#[derive(Clone, Debug, Args)]
pub struct SceneArgs {
    #[command(flatten)]
    table: TableArgs,
    /// Game whose balls are racked
    #[arg(long, value_enum, value_name = "GAME", default_value_t)]
    rules: RuleSet,
    /// Material of the balls
    #[arg(long, value_enum, value_name = "SET", default_value_t)]
    ball_set: BallSet,
    /// Colour of the cloth
    #[arg(long, value_enum, value_name = "COLOUR", default_value_t)]
    cloth: ClothColour,
    /// Camera
    #[arg(long, value_enum, default_value_t)]
    view: SceneView,
    /// Seed of the rack
    #[arg(long, default_value_t = 1)]
    seed: u32,
    /// Output file, in place of one of this name [default: room.json, where there is none yet]
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
}

/// Camera of an exported scene.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub enum SceneView {
    /// Over the cue ball to the rack, as the game is aimed
    #[default]
    Cue,
    /// The whole table
    Table,
    /// The object balls from near
    Rack,
    /// The rack before the far end of the room, from a low eye and with depth of field
    Title,
    /// The cue ball and the chalked tip from a hand's breadth, with depth of field
    Macro,
}

impl SceneView {
    fn camera(self, scene: &TableScene, contest: &Match) -> Camera {
        let balls = contest.world().balls();
        let (cue_balls, object_balls): (Vec<_>, Vec<_>) =
            balls.into_iter().partition(|ball| ball.number == 0);
        match (self, cue_balls.first()) {
            (Self::Cue, Some(cue_ball)) => {
                let bearing_rad = (-cue_ball.position.truncate()).to_angle();
                Viewpoint::behind(cue_ball.position, bearing_rad).camera()
            }
            (Self::Macro, Some(cue_ball)) => {
                let camera = close_up(cue_ball.position).camera();
                camera.aperture_radius_m(MACRO_APERTURE_RADIUS_M)
            }
            (Self::Rack | Self::Title, _) if !object_balls.is_empty() => {
                let sum: DVec3 = object_balls.iter().map(|ball| ball.position).sum();
                let middle = sum / object_balls.len() as f64;
                if self == Self::Title {
                    let camera = title(middle).camera();
                    return camera.aperture_radius_m(TITLE_APERTURE_RADIUS_M);
                }
                let near = Viewpoint {
                    distance_m: RACK_DISTANCE_M,
                    ..Viewpoint::beside(middle, RACK_BEARING_RAD)
                };
                near.camera()
            }
            _ => scene.scene().camera,
        }
    }
}

/// Aperture radius of a 50 mm lens at f/2.8.
const TITLE_APERTURE_RADIUS_M: f32 = 0.009;

/// View from low over the cloth past the rack to the window.
fn title(rack: DVec3) -> Viewpoint {
    Viewpoint {
        focus: rack + DVec3::new(-0.03, -0.06, 0.05),
        bearing_rad: -0.55,
        pitch_rad: 0.1,
        distance_m: 0.82,
        fov_x_deg: 46.0,
    }
}

/// Aperture radius of a 50 mm lens at f/8, for the depth of field of a near subject.
const MACRO_APERTURE_RADIUS_M: f32 = 0.003;

/// View across the cue to the gap between its tip and the cue ball.
fn close_up(cue_ball: DVec3) -> Viewpoint {
    Viewpoint {
        focus: cue_ball + DVec3::new(-0.022, 0.0, 0.004),
        bearing_rad: 1.0,
        pitch_rad: 0.16,
        distance_m: 0.2,
        fov_x_deg: 44.0,
    }
}

/// Distance of the eye from the centre of the rack.
const RACK_DISTANCE_M: f64 = 0.62;
/// Direction of the view of the rack, along the table and past the rack's side.
const RACK_BEARING_RAD: f64 = 0.4;

/// The scene of a game before its first stroke.
///
/// # Errors
/// [`carom_billiards::Error`] if the game is not played on the table.
pub fn opening_scene(
    table: &TableArgs,
    rules: RuleSet,
    style: TableStyle,
    view: SceneView,
    seed: u32,
) -> carom_billiards::Result<Scene> {
    let players = vec![Player::Human(String::new()); *rules.info().players.start()];
    let own = MatchConfig::new(rules, players, seed)?;
    let contest = Match::new(MatchConfig {
        table: table.of(own.table, table.options()),
        ..own
    })?;
    let room = TableScene::of(&contest, style);
    let update = opening_update(&room, &contest, view);
    let mut scene = room.scene().clone();
    scene.camera = update.camera.unwrap_or(scene.camera);
    for pose in update.poses {
        if let Shape::Sphere {
            center, rotation, ..
        }
        | Shape::TruncatedCone {
            center, rotation, ..
        } = &mut scene.objects[pose.object as usize].shape
        {
            (*center, *rotation) = (pose.position, pose.rotation);
        }
    }
    Ok(scene)
}

/// Update of `room` for a match before its first stroke.
pub fn opening_update(room: &TableScene, contest: &Match, view: SceneView) -> SceneUpdate {
    let table = contest.world().table();
    let camera = view.camera(room, contest);
    let balls = contest.world().balls();
    let poses: Vec<_> = balls.iter().map(|ball| ball.pose()).collect();
    let cue_ball = poses.iter().find(|pose| pose.number == 0);
    let cue = cue_ball.map(|ball| {
        let bearing_rad = (-ball.position.truncate()).to_angle();
        CuePose::aimed(ball.position, table.cue_ball().radius_m, bearing_rad)
    });
    room.update(camera, &poses, cue.as_ref())
}

impl SceneArgs {
    /// Writes the scene file.
    ///
    /// # Errors
    /// If the game is not played on the table, or the file cannot be written.
    pub fn run(&self) -> anyhow::Result<()> {
        let out = output_file(self.out.as_deref(), "room.json")?;
        let scene = opening_scene(
            &self.table,
            self.rules,
            TableStyle {
                balls: self.ball_set,
                cloth: self.cloth,
                ..TableStyle::default()
            },
            self.view,
            self.seed,
        )?;
        scene.save(&out)?;
        println!(
            "{}: {} objects, {} lights. Depth of the game: {}",
            out.display(),
            scene.objects.len(),
            scene.area_lights.len(),
            self.ball_set.max_depth()
        );
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use carom_billiards::physics::Table;

    use super::*;

    #[test]
    fn every_game_exports_both_views() {
        for rules in RuleSet::value_variants() {
            for view in SceneView::value_variants() {
                let scene = opening_scene(
                    &TableArgs::default(),
                    *rules,
                    TableStyle::default(),
                    *view,
                    1,
                )
                .unwrap();
                assert_eq!(Scene::from_json(&scene.to_json().unwrap()).unwrap(), scene);
            }
        }
    }

    #[test]
    fn exported_balls_lie_where_they_are_racked() {
        let scene = opening_scene(
            &TableArgs::default(),
            RuleSet::Eight,
            TableStyle::default(),
            SceneView::Cue,
            1,
        );
        let scene = scene.unwrap();
        let centers: Vec<_> = scene
            .objects
            .iter()
            .filter_map(|object| match object.shape {
                Shape::Sphere { center, .. } => Some(center),
                _ => None,
            })
            .collect();
        assert_eq!(centers.len(), 16);
        for (i, a) in centers.iter().enumerate() {
            assert!(centers[..i].iter().all(|b| a.distance(*b) > 0.057), "{a}");
        }
    }

    #[test]
    fn game_on_wrong_table_is_refused() {
        let carom = TableArgs {
            built_in: Some(Table::built_in("carom").unwrap()),
            ..TableArgs::default()
        };
        let scene = opening_scene(
            &carom,
            RuleSet::Eight,
            TableStyle::default(),
            SceneView::Cue,
            1,
        );
        assert!(scene.unwrap_err().to_string().contains("pockets"));
    }
}
