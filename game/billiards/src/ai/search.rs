//! The search for a shot: from a position to the computer's decision.

use std::sync::atomic::{AtomicBool, Ordering};

use glam::DVec2;

use super::{
    Position,
    ball_placement::best_placement,
    contact_candidates::contact_candidates,
    evaluation::evaluate,
    pot_candidates::{PotCandidate, pot_candidates},
    skill::Skill,
};
use crate::deterministic_math::angle_between;
use crate::physics::{AimContact, Stroke, predict};
use crate::rng::CounterRng;
use crate::rules::{Call, Calls, Choice, RuleSet};

/// The computer's decision; its parts are carried out in this order.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Decision {
    /// Its choice, if there was one to make; after [`Choice::Return`] and the like the other player is
    /// at the table and the rest does not count.
    pub choice: Option<Choice>,
    /// Place of the cue ball, if it is in hand and moved.
    pub place: Option<DVec2>,
    /// Its call.
    pub call: Option<Call>,
    /// Purpose of the stroke, also where the rules ask for no call: a pot with its pocket, or a safety;
    /// none for a break or a carom.
    pub aim: Option<Call>,
    /// Intended stroke; [`Skill::add_error`] turns it into the actual one.
    pub stroke: Stroke,
    /// Expected value of the shot, about −1 to 1.
    pub worth: f64,
    /// Number of simulated shots, whole or up to the first contact.
    pub simulated: u32,
}

/// Searches for a decision. `seed` draws the candidates; the same position and seed give the same
/// decision. Ends early, with the best so far, once `stop` is set.
pub fn think(position: &Position, skill: &Skill, seed: u32, stop: &AtomicBool) -> Decision {
    let mut position = position.clone();
    let choice = decide(&mut position, skill);
    let mut place_at = None;
    if let Some(area) = position.referee.ball_in_hand_area() {
        place_at = best_placement(&position, area, skill)
            .filter(|at| position.world.place(0, at.x, at.y).is_ok());
    }
    let mut search = ShotSearch {
        position: &position,
        skill,
        rng: CounterRng::new(seed, THINK),
        left: skill.shots,
        found: Vec::new(),
        stop,
    };
    // Pots first, with a reserve for the rest; then what is left of the budget goes to the other strokes.
    search.pots();
    search.others();
    search.weigh();
    let best = search.found.first().copied();
    let simulated = skill.shots - search.left;
    let fallback = ScoredStroke {
        stroke: Stroke::straight(0.0, 2.0),
        call: None,
        aim: None,
        worth: -1.0,
    };
    let best = best.unwrap_or(fallback);
    Decision {
        choice,
        place: place_at,
        call: best.call,
        aim: best.aim,
        stroke: best.stroke,
        worth: best.worth,
        simulated,
    }
}

/// Makes the choice that is offered: plays on where there is a fair pot, otherwise returns the turn or
/// takes what is offered.
fn decide(position: &mut Position, skill: &Skill) -> Option<Choice> {
    let options = position.referee.options().to_vec();
    if options.is_empty() {
        return None;
    }
    let positions = position.ball_positions();
    let on = position.referee.legal_targets(&positions);
    let found = pot_candidates(&position.layout, &positions, &on, skill);
    let is_fair = found.first().is_some_and(|line| line.chance > FAIR);
    let instead = [Choice::Return, Choice::TakeInHand, Choice::SpotBalls];
    let other = instead.into_iter().find(|choice| options.contains(choice));
    let choice = match other {
        Some(other) if !is_fair => other,
        _ => Choice::Accept,
    };
    if let Ok(verdict) = position
        .referee
        .choose(&position.layout, &positions, choice)
    {
        for p in &verdict.moves {
            // A ball that has no room stays where it is: the match reports that.
            let _ = position.world.place(p.ball, p.at.x, p.at.y);
        }
    }
    Some(choice)
}

#[derive(Clone, Copy, Debug)]
struct ScoredStroke {
    stroke: Stroke,
    call: Option<Call>,
    aim: Option<Call>,
    worth: f64,
}

struct ShotSearch<'a> {
    position: &'a Position,
    skill: &'a Skill,
    rng: CounterRng,
    left: u32,
    found: Vec<ScoredStroke>,
    stop: &'a AtomicBool,
}

impl ShotSearch<'_> {
    /// Considers straight pots by falling chance, each with several speeds and heights of the tip.
    fn pots(&mut self) {
        if self.position.referee.is_break() {
            return;
        }
        let positions = self.position.ball_positions();
        let on = self.position.referee.legal_targets(&positions);
        let found = pot_candidates(&self.position.layout, &positions, &on, self.skill);
        let reserve = self.reserve();
        for line in found.iter().take(LINES_MAX) {
            for (stretch, vertical) in TOUCHES {
                if self.left <= reserve {
                    return;
                }
                // Heuristic: longer paths need more speed.
                let speed_m_s = (stretch * (0.9 + 0.75 * line.length_m)).clamp(0.8, 6.0);
                let stroke = Stroke {
                    vertical,
                    ..Stroke::straight(line.bearing_rad, speed_m_s)
                };
                if let Some(stroke) = self.aimed(line, stroke) {
                    let aim = Call::Pot {
                        ball: line.ball,
                        pocket: Some(line.pocket),
                    };
                    self.consider(stroke, self.pot_call(line), Some(aim));
                }
            }
        }
    }

    /// Considers breaks, safeties, escapes and caroms.
    fn others(&mut self) {
        // A drill asks for pots: luck and safeties are no answer to it.
        if self.position.referee.rules().is_drill() && !self.found.is_empty() {
            return;
        }
        let trials = self.skill.trials;
        let kept = (trials.0 as u32 * trials.1).min(self.left / 2);
        let good = self.found.iter().any(|found| found.worth > GOOD);
        // With a good pot a third of the budget is enough to look for something better.
        let count = (self.left - kept) / if good { 3 } else { 1 };
        let referee = &self.position.referee;
        let is_carom = referee.rules() == RuleSet::ThreeCushion;
        let aim = (!is_carom && !referee.is_break()).then_some(Call::Safety);
        let call = aim.filter(|_| self.calls() == Calls::Pocket);
        for stroke in contact_candidates(self.position, count, &mut self.rng) {
            if self.left <= kept {
                return;
            }
            self.consider(stroke, call, aim);
        }
    }

    /// Evaluates the best few again, as the mean over strokes with the player's own error.
    fn weigh(&mut self) {
        self.sort();
        let (count, trials) = self.skill.trials;
        self.found.truncate(count.max(1));
        if trials < 2 || self.found.len() < 2 {
            return;
        }
        for index in 0..self.found.len() {
            let found = self.found[index];
            // Common random numbers: each stroke has the same errors, which lowers the variance of
            // their differences.
            let mut rng = CounterRng::new(trials, WEIGH);
            let (mut sum, mut tried) = (0.0, 0.0);
            for _ in 0..trials {
                // A stroke that is good only if played exactly loses here against one that tolerates
                // errors.
                let strayed = self.skill.add_error(found.stroke, &mut rng);
                if let Some(worth) = self.simulated(strayed, found.call) {
                    sum += worth;
                    tried += 1.0;
                }
            }
            self.found[index].worth = if tried > 0.0 { sum / tried } else { -1.0 };
        }
        self.sort();
    }

    /// Best first; of equals the one found first.
    fn sort(&mut self) {
        self.found.sort_by(|a, b| b.worth.total_cmp(&a.worth));
    }

    fn consider(&mut self, stroke: Stroke, call: Option<Call>, aim: Option<Call>) {
        if let Some(worth) = self.simulated(stroke, call) {
            self.found.push(ScoredStroke {
                stroke,
                call,
                aim,
                worth,
            });
        }
    }

    fn simulated(&mut self, stroke: Stroke, call: Option<Call>) -> Option<f64> {
        if !self.counts() {
            return None;
        }
        let shot = self.position.world.strike(stroke).ok()?;
        let is_break = self.position.referee.is_break();
        let effort = if is_break { 0.0 } else { self.skill.effort };
        let cost = effort * ((stroke.speed_m_s / 10.0).powi(2) + stroke.offset().powi(2));
        Some(evaluate(self.position, &stroke, &shot, call, self.skill) - cost)
    }

    /// Turns the stroke until the object ball leaves towards the pocket: the simulation includes throw,
    /// squirt and swerve.
    fn aimed(&mut self, line: &PotCandidate, mut stroke: Stroke) -> Option<Stroke> {
        for _ in 0..CORRECTIONS {
            if !self.counts() {
                return None;
            }
            let contact = predict(&self.position.world, stroke).ok()?.contact;
            let AimContact::Ball {
                number,
                object_direction,
                ..
            } = contact
            else {
                return None;
            };
            let way = object_direction.truncate();
            if number != line.ball || way == DVec2::ZERO {
                return None;
            }
            let off = angle_between(line.to_pocket, way);
            if off.abs() < AIMED_RAD {
                break;
            }
            // Newton's step with the slope −lever from geometry: a cue turned to the left meets the
            // ball more on its left and sends it to the right. The clamp keeps thin cuts, whose levers
            // are large, from missing the ball.
            stroke.direction_rad += (off / line.lever).clamp(-0.2, 0.2);
        }
        Some(stroke)
    }

    fn pot_call(&self, line: &PotCandidate) -> Option<Call> {
        let pocket = match self.calls() {
            Calls::Nothing => return None,
            Calls::Pocket => Some(line.pocket),
            Calls::Colour => None,
        };
        Some(Call::Pot {
            ball: line.ball,
            pocket,
        })
    }

    fn calls(&self) -> Calls {
        self.position.referee.info().calls
    }

    /// Number of simulations reserved for other strokes and for the re-evaluation.
    fn reserve(&self) -> u32 {
        let (count, trials) = self.skill.trials;
        (count as u32 * trials).min(self.skill.shots / 2) + self.skill.shots / 6
    }

    /// Whether one more simulation is allowed; if so, counts it.
    fn counts(&mut self) -> bool {
        let allowed = self.left > 0 && !self.stop.load(Ordering::Relaxed);
        self.left -= u32::from(allowed);
        allowed
    }
}

/// Factors of the speed and vertical offsets of the tip: follow, stun and draw.
const TOUCHES: [(f64, f64); 6] = [
    (1.0, 0.0),
    (1.0, 0.3),
    (1.3, -0.3),
    (0.75, 0.15),
    (1.6, 0.0),
    (1.6, 0.35),
];
const LINES_MAX: usize = 8;
/// Maximum number of predictions to aim one stroke.
const CORRECTIONS: u32 = 3;
/// Tolerance of the aim: 3 mm after 2 m.
const AIMED_RAD: f64 = 1.5e-3;
/// Chance above which a pot is worth trying.
const FAIR: f64 = 0.35;
/// Value above that of any safety.
const GOOD: f64 = 0.3;
/// Random streams of the search and of its re-evaluation.
const THINK: u32 = 0x7468_696e;
const WEIGH: u32 = 0x7765_6967;
