//! Shots told by what happened in them, for the tests of the games.

use glam::DVec2;

use super::{
    Call, Ground, Happening, Lie, Placed, Referee, Report, RuleSet, Verdict, rack,
    referee::with_moves,
};

/// A table with a referee.
pub(crate) struct Scene {
    pub(crate) ground: Ground,
    pub(crate) referee: Referee,
    pub(crate) lie: Lie,
}

pub(crate) fn ground(length_m: f64, width_m: f64, radius_m: f64) -> Ground {
    let (x, y) = (0.5 * length_m, 0.5 * width_m);
    let pockets = [(-x, -y), (0.0, -y), (x, -y), (-x, y), (0.0, y), (x, y)];
    Ground {
        length_m,
        width_m,
        radius_m,
        cue_radius_m: radius_m,
        pockets: pockets.map(|(x, y)| DVec2::new(x, y)).to_vec(),
    }
}

impl Scene {
    /// A match of two to 3, before its first break.
    pub(crate) fn new(rules: RuleSet) -> Self {
        let ground = match rules {
            RuleSet::Snooker => ground(3.569, 1.778, 0.02625),
            RuleSet::ThreeCushion => Ground {
                pockets: Vec::new(),
                ..ground(2.84, 1.42, 0.03075)
            },
            _ => ground(2.54, 1.27, 0.028575),
        };
        Self {
            referee: Referee::new(rules, 2, 3, 1).unwrap(),
            lie: rack(rules, &ground, 1),
            ground,
        }
    }

    /// After a break that pots nothing and moves no ball: player 1 is at the table.
    pub(crate) fn broken(rules: RuleSet) -> Self {
        let mut scene = Self::new(rules);
        let first = *scene.referee.on(&scene.lie).first().unwrap();
        let rails: Vec<Happening> = (1..=6).map(rail).collect();
        scene.play(&[&[hit(first)], &rails[..]].concat(), None);
        assert!(!scene.referee.is_break());
        scene
    }

    /// Only these balls, and the cue ball, stay on the table.
    pub(crate) fn keep(&mut self, balls: &[u8]) {
        self.lie.retain(|p| p.ball == 0 || balls.contains(&p.ball));
    }

    pub(crate) fn put(&mut self, ball: u8, x: f64, y: f64) {
        let at = DVec2::new(x, y);
        self.lie = with_moves(&self.lie, &[Placed { ball, at }]);
    }

    pub(crate) fn report(&self, happenings: &[Happening]) -> Report {
        let gone = |ball: u8| {
            happenings.iter().any(|h| {
                matches!(h, Happening::Pocketed { ball: b, .. } | Happening::LeftTable { ball: b } if *b == ball)
            })
        };
        Report {
            happenings: happenings.to_vec(),
            before: self.lie.clone(),
            after: self.lie.iter().filter(|p| !gone(p.ball)).copied().collect(),
            reach_x_m: f64::INFINITY,
            ..Report::default()
        }
    }

    pub(crate) fn play(&mut self, happenings: &[Happening], call: Option<Call>) -> Verdict {
        self.judge(&self.report(happenings), call)
    }

    pub(crate) fn judge(&mut self, report: &Report, call: Option<Call>) -> Verdict {
        let verdict = self.referee.judge(&self.ground, report, call);
        self.lay(&report.after.clone(), &verdict);
        verdict
    }

    pub(crate) fn lay(&mut self, lie: &Lie, verdict: &Verdict) {
        self.lie = match verdict.rack {
            Some(seed) => rack(self.referee.rules(), &self.ground, seed),
            None => lie.clone(),
        };
        self.lie = with_moves(&self.lie, &verdict.moves);
    }

    pub(crate) fn has(&self, ball: u8) -> bool {
        self.at(ball).is_some()
    }

    pub(crate) fn at(&self, ball: u8) -> Option<DVec2> {
        self.lie.iter().find(|p| p.ball == ball).map(|p| p.at)
    }
}

pub(crate) fn hit(ball: u8) -> Happening {
    Happening::Contact {
        one: 0,
        other: ball,
    }
}

pub(crate) fn rail(ball: u8) -> Happening {
    Happening::Cushion { ball }
}

/// Into the pocket of that index.
pub(crate) fn pot(ball: u8, pocket: usize) -> Happening {
    Happening::Pocketed { ball, pocket }
}

pub(crate) fn off(ball: u8) -> Happening {
    Happening::LeftTable { ball }
}

/// A ball into a pocket.
pub(crate) fn call(ball: u8, pocket: usize) -> Option<Call> {
    Some(Call::Pot {
        ball,
        pocket: Some(pocket),
    })
}
