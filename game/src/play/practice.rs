//! Practice table, on which the player arranges balls and particles to play from.
//!
//! ```text
//! grab ─▶ drag (to a position, with a check whether it is free) ─▶ let_go
//! add, take_away, layout (a recording in which nothing moves)
//! ```

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::Arc;

use carom_billiards::physics::{
    BallPose, BallState, ParticleBed, ParticleMaterial, ParticlePatch, ParticlePrecision, Phase,
    Recording, Table, World,
};
use glam::{DVec2, DVec3};

use super::tricks::TrickTable;
use crate::particles::ParticleMoment;
use crate::{PracticeFault, Result};

/// Command of the practice page.
#[derive(Clone, Debug, PartialEq)]
pub enum PracticeCommand {
    /// Pick up the ball at a position on the table, m.
    Grab(DVec2),
    /// Move the held ball to a position.
    Drag(DVec2),
    /// Put the held ball down.
    LetGo,
    /// Add a ball, by number.
    Add(u8),
    /// Remove a ball, by number.
    TakeAway(u8),
    /// Choose the material to paint with, or none, in which case balls can be moved.
    Brush(Option<ParticleMaterial>),
    /// Cover the cloth around a position on the table, m.
    Paint(DVec2),
    /// Set up a trick table.
    Trick(TrickTable),
    /// Remove all particles.
    Sweep,
    /// Save the layout as a file.
    Save,
    /// Arrange the table as in a file.
    Open(PathBuf),
    /// Continue play from this table.
    Play,
    /// Return to the unchanged game.
    Close,
}

/// A practice table.
#[derive(Clone, Debug)]
pub struct Practice {
    world: World,
    held: Option<HeldBall>,
    brush: Option<ParticleMaterial>,
    /// Materials of the covered patches, by column and row.
    patches: BTreeMap<(i16, i16), ParticleMaterial>,
    precision: ParticlePrecision,
}

/// State of a table to continue play from, of the practice page or a replay.
#[derive(Clone, Debug)]
pub struct PracticeLayout {
    /// The balls.
    pub balls: Vec<BallState>,
    /// The particles.
    pub particles: Option<Arc<ParticleBed>>,
}

/// A held ball.
#[derive(Clone, Debug, PartialEq)]
pub struct HeldBall {
    /// Number of the ball.
    pub number: u8,
    /// Position of its centre seen from above, in m.
    pub at: DVec2,
    /// Reason why it cannot be placed there, if there is one.
    pub fault: Option<PracticeFault>,
}

impl Practice {
    /// A practice table that begins as another table, with a precision for new particles. Moving balls are
    /// stopped where they are.
    ///
    /// # Errors
    /// [`carom_billiards::Error::Layout`] if balls that were in the air cannot be placed below.
    pub fn new(world: &World, precision: ParticlePrecision) -> carom_billiards::Result<Self> {
        let patches = world.particles().map_or(&[][..], |bed| bed.patches());
        Ok(Self {
            patches: by_place(patches),
            precision,
            world: with_balls(world, at_rest(world.balls()))?,
            held: None,
            brush: None,
        })
    }

    /// The material of the brush, if there is one.
    pub fn brush(&self) -> Option<ParticleMaterial> {
        self.brush
    }

    /// Sets the material of the brush, or none.
    pub fn set_brush(&mut self, brush: Option<ParticleMaterial>) {
        (self.brush, self.held) = (brush, None);
    }

    /// Whether painting at a position would change anything.
    pub fn is_bare(&self, at: DVec2) -> bool {
        self.dab(at).next().is_some()
    }

    /// Covers the cloth around a position with the brush's material.
    ///
    /// # Errors
    /// [`carom_billiards::Error::Particles`] if there would be too many particles; nothing has changed then.
    pub fn paint(&mut self, at: DVec2) -> carom_billiards::Result<()> {
        let mut patches = self.patches.clone();
        patches.extend(
            self.dab(at)
                .map(|patch| ((patch.column, patch.row), patch.material)),
        );
        // Particles are settled only before play, in `table_layout`, which would be too slow while painting.
        self.cover(patches, ParticleBed::unsettled)
    }

    /// The patches under the brush that are on the cloth and not yet covered with its material.
    fn dab(&self, at: DVec2) -> impl Iterator<Item = ParticlePatch> {
        let steps = (-1..=1).flat_map(|x| (-1..=1).map(move |y| DVec2::new(x.into(), y.into())));
        let places = steps.map(move |step| at + ParticlePatch::EDGE_M * step);
        let patches = places.filter_map(|at| ParticlePatch::around(self.brush?, at));
        patches.filter(move |patch| {
            let there = self.patches.get(&(patch.column, patch.row));
            patch.is_on_cloth(self.world.table()) && there != Some(&patch.material)
        })
    }

    /// Replaces all particles by those of a trick table.
    ///
    /// # Errors
    /// [`carom_billiards::Error::Particles`].
    pub fn lay_trick(&mut self, trick: TrickTable) -> carom_billiards::Result<()> {
        self.cover(by_place(&trick.patches()), ParticleBed::new)
    }

    /// Removes all particles.
    pub fn sweep(&mut self) {
        self.patches.clear();
        self.world.set_particles(None);
    }

    fn cover(
        &mut self,
        patches: BTreeMap<(i16, i16), ParticleMaterial>,
        lay: LayParticles,
    ) -> carom_billiards::Result<()> {
        let list = patches
            .iter()
            .map(|(&(column, row), &material)| ParticlePatch {
                material,
                column,
                row,
            });
        let (table, balls) = (self.world.table(), self.world.balls());
        let bed = lay(table, &balls, &list.collect::<Vec<_>>(), self.precision)?;
        self.world.set_particles(Some(Arc::new(bed)));
        self.patches = patches;
        Ok(())
    }

    /// The particles.
    pub fn particles(&self) -> ParticleMoment {
        ParticleMoment::lying(&self.world)
    }

    /// The table to play from, with settled particles.
    ///
    /// # Errors
    /// [`carom_billiards::Error::Particles`] if they do not come to rest.
    pub fn table_layout(&self) -> carom_billiards::Result<PracticeLayout> {
        let balls = self.world.balls();
        let settle = |bed: &Arc<ParticleBed>| ParticleBed::clone(bed).settled(&balls);
        let particles = self.world.particles().map(settle).transpose()?;
        Ok(PracticeLayout {
            balls,
            particles: particles.map(Arc::new),
        })
    }

    /// The table, with a held ball at its position before it was picked up.
    pub fn world(&self) -> &World {
        &self.world
    }

    /// The held ball, if there is one.
    pub fn held(&self) -> Option<&HeldBall> {
        self.held.as_ref()
    }

    /// Picks up the ball nearest to a position, within `REACH_RADII`; false if there is none.
    pub fn grab(&mut self, at: DVec2) -> bool {
        let distance = |ball: &BallState| ball.position.truncate().distance(at);
        let balls = self.world.balls().into_iter();
        let near = balls
            .filter(|ball| ball.phase.is_on_table())
            .filter(|ball| distance(ball) < REACH_RADII * ball.body.radius_m)
            .min_by(|a, b| distance(a).total_cmp(&distance(b)));
        self.held = near.map(|ball| HeldBall {
            number: ball.number,
            at: ball.position.truncate(),
            fault: None,
        });
        self.held.is_some()
    }

    /// Moves the held ball.
    pub fn drag(&mut self, at: DVec2) {
        let Some(held) = &mut self.held else {
            return;
        };
        let half = 0.5 * DVec2::new(self.world.table().length_m(), self.world.table().width_m());
        if at.is_finite() {
            held.at = at.clamp(-half, half);
        }
        let placed = self.world.clone().place(held.number, held.at.x, held.at.y);
        held.fault = placed.is_err().then_some(PracticeFault::NotClear);
    }

    /// Puts the held ball down.
    ///
    /// # Errors
    /// [`PracticeFault::NotClear`]; the ball is then back where it was.
    pub fn let_go(&mut self) -> Result<(), PracticeFault> {
        let Some(HeldBall { number, at, .. }) = self.held.take() else {
            return Ok(());
        };
        let placed = self.world.place(number, at.x, at.y);
        placed.map_err(|_| PracticeFault::NotClear)
    }

    /// Adds a ball at the free position nearest to the table's centre.
    ///
    /// # Errors
    /// [`PracticeFault::OnTable`] and [`PracticeFault::NoRoom`].
    pub fn add(&mut self, number: u8) -> Result<(), PracticeFault> {
        let mut balls = self.world.balls();
        let lies = |ball: &BallState| ball.number == number && ball.phase.is_on_table();
        if balls.iter().any(lies) {
            return Err(PracticeFault::OnTable(number));
        }
        balls.retain(|ball| ball.number != number);
        let table = self.world.table();
        let place = |at: DVec2| {
            let mut balls = balls.clone();
            balls.push(table.resting_ball(number, at));
            with_balls(&self.world, balls).ok()
        };
        let mut places = rings(1.1 * table.body_of(number).radius_m, table.length_m());
        let found = places.find_map(place);
        self.world = found.ok_or(PracticeFault::NoRoom(number))?;
        Ok(())
    }

    /// Removes a ball from the table, also if it is held.
    ///
    /// # Errors
    /// [`PracticeFault::NotOnTable`].
    pub fn take_away(&mut self, number: u8) -> Result<()> {
        let mut balls = self.world.balls();
        let before = balls.len();
        balls.retain(|ball| ball.number != number);
        if balls.len() == before {
            return Err(PracticeFault::NotOnTable(number).into());
        }
        self.world = with_balls(&self.world, balls)?;
        self.held = self.held.take().filter(|held| held.number != number);
        Ok(())
    }

    /// The numbers of the balls on the table, ascending.
    pub fn numbers(&self) -> Vec<u8> {
        let balls = self.world.balls().into_iter();
        let mut numbers: Vec<u8> = balls
            .filter(|ball| ball.phase.is_on_table())
            .map(|ball| ball.number)
            .collect();
        numbers.sort_unstable();
        numbers
    }

    /// Poses of the balls for drawing, with a held ball at its new position.
    pub fn poses(&self) -> Vec<BallPose> {
        let balls = self.world.balls().into_iter();
        let pose = |ball: BallState| {
            let held = self.held.as_ref().filter(|held| held.number == ball.number);
            BallPose {
                position: held.map_or(ball.position, |held| {
                    DVec3::new(held.at.x, held.at.y, ball.body.radius_m)
                }),
                ..ball.pose()
            }
        };
        balls.map(pose).collect()
    }

    /// The layout as a recording.
    ///
    /// # Errors
    /// Those of [`World::release`].
    pub fn layout(&self, title: &str) -> carom_billiards::Result<Recording> {
        let still = self.world.release()?;
        Ok(Recording::of(self.world.table(), title, still))
    }

    /// Places the balls and new particles of a shot's start or a layout.
    ///
    /// # Errors
    /// [`carom_billiards::Error::Layout`] if they cannot be placed so on this table.
    pub fn lay(
        &mut self,
        balls: Vec<BallState>,
        patches: &[ParticlePatch],
    ) -> carom_billiards::Result<()> {
        self.world = with_balls(&self.world, balls)?;
        self.held = None;
        if patches.is_empty() {
            self.sweep();
            return Ok(());
        }
        self.cover(by_place(patches), ParticleBed::new)
    }
}

/// Balls at the same positions, at rest.
pub fn at_rest(mut balls: Vec<BallState>) -> Vec<BallState> {
    for ball in balls.iter_mut().filter(|ball| ball.phase.is_on_table()) {
        let still = BallState::at_rest(ball.number, ball.position.x, ball.position.y, &ball.body);
        *ball = BallState {
            orientation: ball.orientation,
            phase: Phase::Resting,
            ..still
        };
    }
    balls
}

/// Function that places particles on patches.
type LayParticles = fn(
    &Table,
    &[BallState],
    &[ParticlePatch],
    ParticlePrecision,
) -> carom_billiards::Result<ParticleBed>;

/// The same table with other balls.
fn with_balls(world: &World, balls: Vec<BallState>) -> carom_billiards::Result<World> {
    let mut laid = world.with_balls(balls)?;
    laid.set_particles(world.particles().map(Arc::clone));
    Ok(laid)
}

fn by_place(patches: &[ParticlePatch]) -> BTreeMap<(i16, i16), ParticleMaterial> {
    let patches = patches.iter();
    patches
        .map(|patch| ((patch.column, patch.row), patch.material))
        .collect()
}

/// Positions on circles around the centre, the nearest first, about `step_m` apart.
fn rings(step_m: f64, reach_m: f64) -> impl Iterator<Item = DVec2> {
    let rings = (reach_m / step_m).ceil() as u32;
    (0..rings).flat_map(move |ring| {
        // The n-th circle has a circumference of 2π n steps: 6 n positions are about a step apart.
        let count = (6 * ring).max(1);
        (0..count).map(move |i| {
            let turn_rad = std::f64::consts::TAU * f64::from(i) / f64::from(count);
            DVec2::from_angle(turn_rad) * step_m * f64::from(ring)
        })
    })
}

/// Distance from a ball within which it is picked up, in its radii.
const REACH_RADII: f64 = 1.6;

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::capture::replay::ReplayPlayer;
    use carom_billiards::physics::Table;

    fn practice() -> Practice {
        let table = Table::nine_foot();
        let world = World::new(table.clone(), table.rack_eight(1)).unwrap();
        Practice::new(&world, ParticlePrecision::default()).unwrap()
    }

    #[test]
    fn a_ball_is_dragged_and_refused_where_it_cannot_lie() {
        let mut practice = practice();
        let head = practice.world().table().head_spot();
        assert!(!practice.grab(DVec2::new(0.0, 0.3)));
        assert!(practice.grab(head + DVec2::new(0.02, 0.0)));
        assert_eq!(practice.held().unwrap().number, 0);
        practice.drag(DVec2::new(0.1, 0.2));
        assert_eq!(practice.held().unwrap().fault, None);
        assert_eq!(
            practice.poses()[0].position.truncate(),
            DVec2::new(0.1, 0.2)
        );
        practice.let_go().unwrap();
        // On another ball, and outside the table.
        for at in [practice.world().table().foot_spot(), DVec2::new(9.0, 9.0)] {
            assert!(practice.grab(DVec2::new(0.1, 0.2)));
            practice.drag(at);
            assert!(practice.held().unwrap().fault.is_some());
            assert_eq!(practice.let_go(), Err(PracticeFault::NotClear));
        }
        let lies = practice.world().balls()[0].position.truncate();
        assert_eq!(lies, DVec2::new(0.1, 0.2));
    }

    #[test]
    fn balls_come_and_go() {
        let mut practice = practice();
        let there = PracticeFault::OnTable(3);
        assert_eq!(practice.add(3), Err(there));
        assert_eq!(there.to_string(), "the 3 is on the table already");
        for number in 1..=15 {
            practice.take_away(number).unwrap();
        }
        let gone = practice.take_away(3).unwrap_err().to_string();
        assert_eq!(gone, "the 3 is not on the table");
        assert_eq!(practice.numbers(), [0]);
        for number in [8, 3] {
            practice.add(number).unwrap();
        }
        assert_eq!(practice.numbers(), [0, 3, 8]);
        let reach = 2.0 * practice.world().table().ball().radius_m;
        let balls = practice.world().balls();
        let [eight, three] = [8, 3].map(|n| balls.iter().find(|b| b.number == n).unwrap());
        let apart = eight.position.distance(three.position);
        assert!(apart >= reach && apart < 1.5 * reach, "{apart}");
    }

    #[test]
    fn a_layout_is_kept_and_laid_again() {
        let mut practice = practice();
        practice.take_away(9).unwrap();
        let layout = practice.layout("all but the 9").unwrap();
        let read = Recording::from_bytes(&layout.to_bytes().unwrap()).unwrap();
        let viewing = ReplayPlayer::new(read, practice.world().table(), 0.0).unwrap();
        let mut other = self::practice();
        other.lay(viewing.start().balls, &[]).unwrap();
        let places = |p: &Practice| p.poses().iter().map(|b| b.position).collect::<Vec<_>>();
        assert_eq!(places(&other), places(&practice));
        let mut carom = Practice::new(
            &World::new(
                Table::built_in("seven_foot").unwrap(),
                carom_billiards::physics::BallLayout { balls: Vec::new() },
            )
            .unwrap(),
            ParticlePrecision::default(),
        )
        .unwrap();
        assert!(
            carom
                .lay(
                    vec![BallState::at_rest(
                        1,
                        1.2,
                        0.0,
                        &carom.world().table().ball()
                    )],
                    &[]
                )
                .is_err()
        );
    }

    #[test]
    fn cloth_is_painted_kept_laid_again_and_swept() {
        let mut practice = practice();
        let at = DVec2::new(0.4, 0.2);
        assert!(!practice.is_bare(at), "nothing is painted with");
        practice.set_brush(Some(ParticleMaterial::Sand));
        assert!(practice.is_bare(at));
        practice.paint(at).unwrap();
        assert!(!practice.is_bare(at));
        let bed = |practice: &Practice| practice.world().particles().map(Arc::clone);
        let sand = bed(&practice).unwrap();
        assert_eq!(sand.patches().len(), 9);
        // The brush covers what lay there.
        practice.set_brush(Some(ParticleMaterial::Snow));
        practice
            .paint(at + DVec2::new(ParticlePatch::EDGE_M, 0.0))
            .unwrap();
        let materials = bed(&practice).unwrap().groups().to_vec();
        assert_eq!(materials.len(), 2, "{materials:?}");
        let layout = practice.layout("painted").unwrap();
        let read = Recording::from_bytes(&layout.to_bytes().unwrap()).unwrap();
        let viewing = ReplayPlayer::new(read, practice.world().table(), 0.0).unwrap();
        let mut other = self::practice();
        other.lay(viewing.start().balls, viewing.patches()).unwrap();
        // Particles placed from the recording are in the same positions as painted ones after settling.
        let played = practice.table_layout().unwrap().particles.unwrap();
        assert_eq!(bed(&other).unwrap().centers(), played.centers());
        assert!(
            !viewing
                .particles(0.0)
                .clouds(crate::particles::ParticleDetail::Off, glam::Vec3::ONE)
                .is_empty()
        );
        // Balls are still laid, and paint stays; beyond the cushions nothing is painted.
        practice.set_brush(None);
        assert!(practice.grab(practice.world().table().head_spot()));
        practice.let_go().unwrap();
        assert!(bed(&practice).is_some());
        practice.set_brush(Some(ParticleMaterial::Water));
        assert!(!practice.is_bare(DVec2::new(5.0, 0.0)));
        practice.sweep();
        assert!(bed(&practice).is_none() && practice.particles().bed.is_none());
    }

    #[test]
    fn every_trick_table_can_be_laid_and_struck() {
        for trick in <TrickTable as clap::ValueEnum>::value_variants() {
            let mut practice = practice();
            practice.lay_trick(*trick).unwrap();
            assert!(practice.world().particles().is_some(), "{trick:?}");
            let table = practice.world().table();
            let (world, stroke) = trick.world(table, ParticlePrecision::Coarse).unwrap();
            let shot = world.strike(stroke).unwrap();
            let places = |secs| shot.particles().unwrap().places_at(secs);
            assert_ne!(places(0.0), places(0.5), "{trick:?}");
        }
    }

    proptest! {
        #[test]
        fn what_may_be_put_down_is_put_down_and_nothing_else(
            x in -2.0f64..2.0, y in -1.2f64..1.2, ball in 0u8..16,
        ) {
            let mut practice = practice();
            let from = practice.world().balls()[usize::from(ball)].position.truncate();
            prop_assert!(practice.grab(from));
            let number = practice.held().unwrap().number;
            practice.drag(DVec2::new(x, y));
            let held = practice.held().unwrap().clone();
            let put = practice.let_go();
            prop_assert_eq!(put.is_ok(), held.fault.is_none());
            let lies = practice.world().balls();
            let lies = lies.iter().find(|b| b.number == number).unwrap().position.truncate();
            prop_assert_eq!(lies, if put.is_ok() { held.at } else { from });
            // The table stays one that can be played on.
            prop_assert!(practice.world().release().is_ok());
        }
    }
}
