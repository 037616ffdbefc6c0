//! A table with balls on it, waiting for a stroke.

use std::sync::Arc;

use glam::DVec3;

use crate::{EngineFault, LayoutFault, Result, StrokeFault};

use super::{
    ball::{BallState, Phase},
    cue_impact::Stroke,
    engine::Engine,
    event::{Event, EventKind},
    event_engine::{EventEngine, OnProgress, SimulatedShot, Until},
    flight::hop_speed_m_s,
    laws::Laws,
    particles::{self, ParticleBed, ParticleTrack},
    rack::BallLayout,
    rapier_engine::RapierEngine,
    shot::Shot,
    table::Table,
};

/// A table with balls on it.
#[derive(Clone, Debug)]
pub struct World {
    table: Table,
    laws: Laws,
    balls: Vec<BallState>,
    tray: Vec<(u8, usize)>,
    engine: Engine,
    particles: Option<Arc<ParticleBed>>,
}

impl World {
    /// A world with the laws of its table.
    ///
    /// # Errors
    /// [`crate::Error::Layout`] for balls that overlap each other or a cushion, lie off the table or in a
    /// pocket, share a number or are not finite.
    pub fn new(table: Table, layout: BallLayout) -> Result<Self> {
        let laws = Laws::of(&table);
        Self::with_laws(table, laws, layout.balls)
    }

    /// A world with laws of its own, whose balls may be in motion.
    ///
    /// # Errors
    /// [`crate::Error::Laws`], and [`crate::Error::Layout`] as in [`World::new`].
    pub fn with_laws(table: Table, laws: Laws, balls: Vec<BallState>) -> Result<Self> {
        laws.validate()?;
        let world = Self {
            table,
            laws,
            balls,
            tray: Vec::new(),
            engine: Engine::default(),
            particles: None,
        };
        for (index, ball) in world.balls.iter().enumerate() {
            world.check_place(ball, &world.balls[..index])?;
        }
        Ok(world)
    }

    /// The same table, laws and engine with other balls and without particles.
    ///
    /// # Errors
    /// [`crate::Error::Layout`] as in [`World::new`].
    pub fn with_balls(&self, balls: Vec<BallState>) -> Result<Self> {
        let mut world = Self::with_laws(self.table.clone(), self.laws, balls)?;
        world.engine = self.engine;
        Ok(world)
    }

    /// The balls, in a fixed order.
    pub fn balls(&self) -> Vec<BallState> {
        self.balls.clone()
    }

    /// The ball return: numbers of the balls in its tray, in the order in which they fell, and the
    /// index of the pocket each fell into.
    pub fn tray(&self) -> &[(u8, usize)] {
        &self.tray
    }

    /// The table.
    pub fn table(&self) -> &Table {
        &self.table
    }

    /// The laws.
    pub fn laws(&self) -> &Laws {
        &self.laws
    }

    /// The simulation engine.
    pub fn engine(&self) -> Engine {
        self.engine
    }

    /// Sets the engine from the next stroke on. A [`super::Rapier`] out of range makes the strokes
    /// fail.
    pub fn set_engine(&mut self, engine: Engine) {
        self.engine = engine;
    }

    /// The particles on the table, if any.
    pub fn particles(&self) -> Option<&Arc<ParticleBed>> {
        self.particles.as_ref()
    }

    /// Lays particles on the table, or removes them.
    pub fn set_particles(&mut self, particles: Option<Arc<ParticleBed>>) {
        self.particles = particles;
    }

    /// The same table without particles: for predictions, which must be fast.
    #[must_use]
    pub fn without_particles(&self) -> Self {
        Self {
            particles: None,
            ..self.clone()
        }
    }

    /// Simulates the whole shot that a stroke begins. The world itself does not change until
    /// [`World::adopt`]. With particles this takes up to seconds, and always uses [`Engine::Exact`].
    ///
    /// # Errors
    /// [`crate::Error::Stroke`] for a stroke out of range or without a cue ball on the table;
    /// [`crate::Error::Endless`] if the simulation passes its limits.
    pub fn strike(&self, stroke: Stroke) -> Result<Shot> {
        let Some(bed) = &self.particles else {
            return Ok(Shot::new(self.simulate(stroke, Until::Rest)?));
        };
        let mut bed = ParticleBed::clone(bed);
        let balls = self.struck(stroke)?;
        let engine = EventEngine::new(&self.table, &self.laws, &balls);
        let (outcome, track) = particles::run(engine, &mut bed)?;
        Ok(Shot::new(self.with_strike(outcome, stroke)).with_particles(track, Some(bed)))
    }

    /// Simulates what the balls do without a stroke: nothing, unless they are in motion.
    ///
    /// # Errors
    /// [`crate::Error::Endless`] if the simulation passes its limits.
    pub fn release(&self) -> Result<Shot> {
        let outcome = self.run(&self.balls, Until::Rest, &mut |_| {})?;
        let shot = Shot::new(outcome);
        Ok(match &self.particles {
            Some(bed) => {
                shot.with_particles(ParticleTrack::new(bed), Some(ParticleBed::clone(bed)))
            }
            None => shot,
        })
    }

    /// Takes over the final state of a shot.
    pub fn adopt(&mut self, shot: &Shot) {
        self.balls = shot.final_states();
        if let Some(bed) = shot.bed() {
            self.particles = Some(Arc::clone(bed));
        }
        self.tray.extend(shot.potted());
    }

    /// Puts a ball at rest on the cloth at (x, y) in m: ball in hand, or spotting. A ball that had
    /// left the table comes back.
    ///
    /// # Errors
    /// [`crate::Error::Layout`] if there is no such ball or it cannot lie there; it stays where it was.
    pub fn place(&mut self, number: u8, x: f64, y: f64) -> Result<()> {
        let Some(index) = self.balls.iter().position(|ball| ball.number == number) else {
            return Err(LayoutFault::NoSuchBall(number).into());
        };
        let placed = BallState {
            orientation: self.balls[index].orientation,
            ..BallState::at_rest(number, x, y, &self.balls[index].body)
        };
        let mut others = self.balls.clone();
        others.remove(index);
        self.check_place(&placed, &others)?;
        self.balls[index] = placed;
        self.tray.retain(|&(potted, _)| potted != number);
        Ok(())
    }

    pub(crate) fn simulate(&self, stroke: Stroke, until: Until) -> Result<SimulatedShot> {
        let outcome = self.run(&self.struck(stroke)?, until, &mut |_| {})?;
        Ok(self.with_strike(outcome, stroke))
    }

    /// As [`World::strike`], calling `each` after every `frame_secs` of the shot, so that the caller
    /// can do other work in between. The shot does not depend on the frames.
    ///
    /// # Errors
    /// As [`World::strike`].
    pub fn strike_in_frames(
        &self,
        stroke: Stroke,
        frame_secs: f64,
        each: &mut dyn FnMut(),
    ) -> Result<Shot> {
        let balls = self.struck(stroke)?;
        if frame_secs.is_nan() || frame_secs < FRAME_SECS_MIN {
            return Err(EngineFault::FrameTooShort {
                frame_secs,
                min_secs: FRAME_SECS_MIN,
            }
            .into());
        }
        let mut frames = 0.0;
        let mut on_progress = |time_secs: f64| {
            while time_secs >= (frames + 1.0) * frame_secs {
                frames += 1.0;
                each();
            }
        };
        let outcome = self.run(&balls, Until::Rest, &mut on_progress)?;
        Ok(Shot::new(self.with_strike(outcome, stroke)))
    }

    /// States of the balls right after the stroke's impulse.
    fn struck(&self, stroke: Stroke) -> Result<Vec<BallState>> {
        stroke.validate()?;
        let mut balls = self.balls.clone();
        let Some(cue_ball) = balls
            .iter_mut()
            .find(|b| b.number == 0 && b.phase.is_on_table())
        else {
            return Err(StrokeFault::NoCueBall.into());
        };
        let body = cue_ball.body;
        let blow = self.laws.cue.strike(&body, &stroke);
        // A ball that particles carry has no slate under it.
        let is_carried = cue_ball.phase == Phase::Airborne && self.particles.is_some();
        let mut twist = match is_carried {
            true => blow,
            false => self.laws.slate.resolve(&body, DVec3::Z, blow),
        };
        let jumps = is_carried || twist.velocity.z >= hop_speed_m_s(self.laws.cloth.gravity_m_s2);
        if !jumps {
            // Below the hop speed the ball stays on the cloth, with a vertical speed of exactly 0:
            // other code compares its height with its radius for equality.
            twist.velocity.z = 0.0;
        }
        *cue_ball = BallState {
            velocity: twist.velocity,
            spin: twist.spin,
            phase: if jumps {
                Phase::Airborne
            } else {
                Phase::Sliding
            },
            ..*cue_ball
        };
        Ok(balls)
    }

    fn with_strike(&self, mut outcome: SimulatedShot, stroke: Stroke) -> SimulatedShot {
        let event = |kind| Event {
            time_secs: 0.0,
            kind,
        };
        let strike = event(EventKind::Strike {
            speed_m_s: stroke.speed_m_s,
        });
        let offset = stroke.offset();
        let slips = offset > self.laws.cue.miscue_offset();
        let miscue = slips.then(|| event(EventKind::Miscue { offset }));
        let first = [strike].into_iter().chain(miscue);
        outcome.events.splice(0..0, first);
        outcome
    }

    fn run(
        &self,
        balls: &[BallState],
        until: Until,
        on_progress: OnProgress<'_>,
    ) -> Result<SimulatedShot> {
        let (table, laws) = (&self.table, &self.laws);
        match self.engine {
            Engine::Exact => EventEngine::new(table, laws, balls).run(until, on_progress),
            Engine::Rapier(rapier) => {
                rapier.validate()?;
                RapierEngine::new(table, laws, rapier, balls).run(until, on_progress)
            }
        }
    }

    fn check_place(&self, ball: &BallState, others: &[BallState]) -> Result<()> {
        let BallState {
            number,
            body,
            position,
            velocity,
            spin,
            phase,
            ..
        } = *ball;
        body.validate(number)?;
        let ball = number;
        if !(position.is_finite() && velocity.is_finite() && spin.is_finite()) {
            return Err(LayoutFault::NotFinite(ball).into());
        }
        if others.iter().any(|other| other.number == number) {
            return Err(LayoutFault::Twice(ball).into());
        }
        if !phase.is_on_table() {
            return Ok(());
        }
        let flies = phase == Phase::Airborne;
        let lies = position.z == body.radius_m && velocity.z == 0.0;
        if !(lies || flies && position.z >= body.radius_m) {
            let height_m = position.z;
            return Err(LayoutFault::NotOnCloth { ball, height_m }.into());
        }
        self.check_clear(ball, position, body.radius_m)?;
        let touches = |other: &&BallState| {
            let least = body.radius_m + other.body.radius_m;
            other.phase.is_on_table() && other.position.distance(position) < least - OVERLAP_MAX_M
        };
        match others.iter().find(touches) {
            Some(other) => Err(LayoutFault::Overlap {
                ball,
                position,
                other: other.number,
            }
            .into()),
            None => Ok(()),
        }
    }

    /// Whether the table leaves room for a ball at a place.
    fn check_clear(&self, ball: u8, position: DVec3, radius_m: f64) -> Result<()> {
        let center = position.truncate();
        if !self.table.contains(center) {
            return Err(LayoutFault::OffTable { ball, position }.into());
        }
        let lies = position.z == radius_m;
        if let Some(hole) = self.table.pocket_under(center).filter(|_| lies) {
            let pocket = self.table.pockets()[hole].center;
            return Err(LayoutFault::InPocket {
                ball,
                position,
                pocket,
            }
            .into());
        }
        let reaches = |distance: f64, least: f64| distance < least - OVERLAP_MAX_M;
        let in_nose = self.table.noses().iter().any(|nose| {
            let depth = nose.normal().dot(center - nose.from());
            nose.spans(center) && depth > -radius_m && reaches(depth, radius_m)
        });
        let in_jaw = self
            .table
            .jaws()
            .iter()
            .any(|jaw| reaches(center.distance(jaw.center), radius_m + jaw.radius_m));
        let low = position.z < self.table.rail_height_m() + radius_m;
        let in_rail = self.table.is_rail_under(center)
            || self.table.cushions().iter().any(|c| c.covers(center));
        if low && (in_nose || in_jaw || in_rail) {
            return Err(LayoutFault::InCushion { ball, position }.into());
        }
        Ok(())
    }
}

/// Minimum duration of a frame in s.
const FRAME_SECS_MIN: f64 = 1e-7;
/// Balls that overlap by less count as touching.
const OVERLAP_MAX_M: f64 = 1e-7;
