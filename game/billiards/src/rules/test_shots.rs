//! Shots described by their events, for the tests of the games.

use glam::DVec2;

use super::{
    BallPosition, BallPositions, Call, Referee, RuleSet, ShotEvent, ShotReport, TableLayout,
    Verdict, layout::place_of, rack, referee::apply_moves,
};

/// A table with a referee.
pub(crate) struct TestTable {
    pub(crate) layout: TableLayout,
    pub(crate) referee: Referee,
    pub(crate) positions: BallPositions,
}

pub(crate) fn layout(length_m: f64, width_m: f64, radius_m: f64) -> TableLayout {
    let (x, y) = (0.5 * length_m, 0.5 * width_m);
    let pockets = [(-x, -y), (0.0, -y), (x, -y), (-x, y), (0.0, y), (x, y)];
    TableLayout {
        length_m,
        width_m,
        radius_m,
        cue_radius_m: radius_m,
        pockets: pockets.map(|(x, y)| DVec2::new(x, y)).to_vec(),
    }
}

impl TestTable {
    /// A match of two to 3, before its first break.
    pub(crate) fn new(rules: RuleSet) -> Self {
        let layout = match rules {
            RuleSet::Snooker => layout(3.569, 1.778, 0.02625),
            RuleSet::ThreeCushion => TableLayout {
                pockets: Vec::new(),
                ..layout(2.84, 1.42, 0.03075)
            },
            _ => layout(2.54, 1.27, 0.028575),
        };
        Self {
            referee: Referee::new(rules, 2, 3, 1).unwrap(),
            positions: rack(rules, &layout, 1),
            layout,
        }
    }

    /// After a break that pots nothing and moves no ball: player 1 is at the table.
    pub(crate) fn broken(rules: RuleSet) -> Self {
        let mut scene = Self::new(rules);
        let first = *scene
            .referee
            .legal_targets(&scene.positions)
            .first()
            .unwrap();
        let rails: Vec<ShotEvent> = (1..=6).map(rail).collect();
        scene.play(&[&[hit(first)], &rails[..]].concat(), None);
        assert!(!scene.referee.is_break());
        scene
    }

    /// Only these balls, and the cue ball, stay on the table.
    pub(crate) fn keep(&mut self, balls: &[u8]) {
        self.positions
            .retain(|p| p.ball == 0 || balls.contains(&p.ball));
    }

    pub(crate) fn put(&mut self, ball: u8, x: f64, y: f64) {
        let at = DVec2::new(x, y);
        self.positions = apply_moves(&self.positions, &[BallPosition { ball, at }]);
    }

    pub(crate) fn report(&self, events: &[ShotEvent]) -> ShotReport {
        let gone = |ball: u8| {
            events.iter().any(|h| {
                matches!(h, ShotEvent::Pocketed { ball: b, .. } | ShotEvent::LeftTable { ball: b } if *b == ball)
            })
        };
        ShotReport {
            events: events.to_vec(),
            before: self.positions.clone(),
            after: self
                .positions
                .iter()
                .filter(|p| !gone(p.ball))
                .copied()
                .collect(),
            reach_x_m: f64::INFINITY,
            ..ShotReport::default()
        }
    }

    pub(crate) fn play(&mut self, events: &[ShotEvent], call: Option<Call>) -> Verdict {
        self.judge(&self.report(events), call)
    }

    pub(crate) fn judge(&mut self, report: &ShotReport, call: Option<Call>) -> Verdict {
        let verdict = self.referee.judge(&self.layout, report, call);
        self.lay(&report.after.clone(), &verdict);
        verdict
    }

    pub(crate) fn lay(&mut self, positions: &BallPositions, verdict: &Verdict) {
        self.positions = match verdict.rack {
            Some(seed) => rack(self.referee.rules(), &self.layout, seed),
            None => positions.clone(),
        };
        self.positions = apply_moves(&self.positions, &verdict.moves);
    }

    pub(crate) fn has(&self, ball: u8) -> bool {
        self.at(ball).is_some()
    }

    pub(crate) fn at(&self, ball: u8) -> Option<DVec2> {
        place_of(&self.positions, ball)
    }
}

pub(crate) fn hit(ball: u8) -> ShotEvent {
    ShotEvent::Contact {
        one: 0,
        other: ball,
    }
}

pub(crate) fn rail(ball: u8) -> ShotEvent {
    ShotEvent::Cushion { ball }
}

/// Into the pocket of that index.
pub(crate) fn pot(ball: u8, pocket: usize) -> ShotEvent {
    ShotEvent::Pocketed { ball, pocket }
}

pub(crate) fn off(ball: u8) -> ShotEvent {
    ShotEvent::LeftTable { ball }
}

/// A ball into a pocket.
pub(crate) fn call(ball: u8, pocket: usize) -> Option<Call> {
    Some(Call::Pot {
        ball,
        pocket: Some(pocket),
    })
}
