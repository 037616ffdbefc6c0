//! The physical world beyond the cloth: balls in the air, rims, rails, tables and unequal balls.

#![allow(
    clippy::disallowed_methods,
    reason = "tests need no digits that all systems share"
)]

use carom_billiards::Error;
use carom_billiards::physics::{
    BallBallLaw, BallBody, BallLayout, BallState, BounceLaw, CLUSTER_SPEED_M_S, Event, EventKind,
    HOP_LEAST_M, Laws, Phase, REBOUND_ENERGY_J, Shot, Stroke, Surface, Table, World,
};
use glam::{DVec2, DVec3};
use proptest::prelude::*;

const POOL: BallBody = BallBody::POOL;
const RADIUS: f64 = POOL.radius_m;
const GRAVITY: f64 = 9.81;

fn resting(number: u8, x: f64, y: f64) -> BallState {
    BallState::at_rest(number, x, y, &POOL)
}

fn moving(number: u8, x: f64, y: f64, velocity: DVec3) -> BallState {
    BallState {
        velocity,
        ..resting(number, x, y)
    }
}

fn flying(number: u8, position: DVec3, velocity: DVec3, spin: DVec3) -> BallState {
    BallState {
        position,
        velocity,
        spin,
        phase: Phase::Airborne,
        ..resting(number, 0.0, 0.0)
    }
}

fn released(table: Table, laws: Laws, balls: Vec<BallState>) -> Shot {
    World::with_laws(table, laws, balls)
        .expect("valid")
        .release()
        .expect("it ends")
}

fn find(shot: &Shot, wanted: impl Fn(&EventKind) -> bool) -> Option<&Event> {
    shot.events().iter().find(|event| wanted(&event.kind))
}

fn energy_j(states: &[BallState]) -> f64 {
    let in_play = states.iter().filter(|ball| ball.phase.is_on_table());
    in_play
        .map(|ball| {
            ball.body.kinetic_energy_j(ball.velocity, ball.spin)
                + ball.body.mass_kg * GRAVITY * (ball.position.z + 1.0)
        })
        .sum()
}

/// What the rules against endless contacts may add, by the heaviest balls used here.
fn allowance_j(kind: &EventKind) -> f64 {
    match kind {
        EventKind::BallBall { .. } => CLUSTER_SPEED_M_S.powi(2),
        EventKind::Cushion { .. } | EventKind::Bounces { .. } => 10.0 * REBOUND_ENERGY_J,
        _ => 0.0,
    }
}

fn assert_energy_never_grows(shot: &Shot) {
    let mut last = energy_j(&shot.states_at(0.0));
    for together in shot.events().chunk_by(|a, b| a.time_secs == b.time_secs) {
        let t = together[0].time_secs;
        let [before, after] = [t.next_down(), t].map(|t| energy_j(&shot.states_at(t)));
        let allowed: f64 = together.iter().map(|event| allowance_j(&event.kind)).sum();
        assert!(before <= last * (1.0 + 1e-11), "{before} J after {last} J");
        assert!(
            t == 0.0 || after <= before * (1.0 + 1e-11) + allowed,
            "{together:?}: {before} J to {after} J"
        );
        last = after;
    }
}

/// No ball is under the cloth but in a pocket, in a cushion, or through a rail or rim.
fn assert_solid(table: &Table, shot: &Shot, t: f64) {
    let (low, high) = table.outline();
    for ball in shot.states_at(t) {
        let place = ball.position.truncate();
        let over_table = place.cmpge(low).all() && place.cmple(high).all();
        if !ball.phase.is_on_table() || !over_table || ball.position.z < -0.2 {
            continue;
        }
        let radius = ball.body.radius_m;
        let hole = table
            .pockets()
            .iter()
            .find(|p| p.center.distance(place) < p.radius_m + 1e-9);
        let depth = radius - ball.position.z;
        let Some(pocket) = hole else {
            assert!(depth < 2e-6, "{ball:?} is under the cloth at {t}");
            continue;
        };
        let from_edge = DVec2::new(
            pocket.center.distance(place) - pocket.radius_m,
            ball.position.z + pocket.rim_radius_m,
        );
        let gap = from_edge.length() - radius - pocket.rim_radius_m;
        assert!(
            pocket.depth_m == 0.0 || gap > -1e-8 || from_edge.y < 0.0,
            "{ball:?} is {gap} m in the rim at {t}"
        );
    }
    if let Some(rails) = table.rails() {
        for ball in shot.states_at(t) {
            let behind = |nose: &carom_billiards::physics::Nose| {
                let d = nose.normal().dot(ball.position.truncate() - nose.from());
                (d, (nose.to() - nose.from()).length())
            };
            let sunk = table.cushions().iter().any(|cushion| {
                let (d, _) = behind(&table.noses()[cushion.nose]);
                let inside = cushion.covers(ball.position.truncate());
                let top = table.nose_height_m() + rails.rise_m * (-d / rails.cushion_width_m);
                inside && ball.position.z < top + 0.98 * ball.body.radius_m
            });
            let gone = !ball.phase.is_on_table();
            assert!(gone || !sunk, "{ball:?} is in a cushion's top at {t}");
        }
    }
}

#[test]
fn built_in_tables_meet_their_specifications() {
    for name in Table::built_in_names() {
        let table = Table::built_in(name).expect("valid");
        let pocketless = table.pockets().is_empty();
        assert_eq!(
            table.cushions().len(),
            if pocketless { 4 } else { 6 },
            "{name}"
        );
        for nose in table.noses() {
            let mirrored = |flip: DVec2| {
                let ends = [nose.to() * flip, nose.from() * flip];
                table.noses().iter().any(|other| {
                    other.from().distance(ends[0]) < 1e-12 && other.to().distance(ends[1]) < 1e-12
                })
            };
            assert!(
                mirrored(DVec2::new(-1.0, 1.0)) && mirrored(DVec2::new(1.0, -1.0)),
                "{name}"
            );
        }
    }
    let nine = Table::nine_foot();
    let tips: Vec<DVec2> = nine
        .cushions()
        .iter()
        .flat_map(|c| [c.corners[0], c.corners[1]])
        .collect();
    let mouth = |near: DVec2| {
        let mut two: Vec<DVec2> = tips.clone();
        two.sort_by(|a, b| a.distance(near).total_cmp(&b.distance(near)));
        two[0].distance(two[1])
    };
    // WPA: 4.5 to 4.625 in at the corners, 5 to 5.125 in at the sides.
    assert!((0.1143..=0.117_475).contains(&mouth(DVec2::new(1.27, 0.635))));
    assert!((0.127..=0.130_175).contains(&mouth(DVec2::new(0.0, 0.635))));
    let carom = Table::built_in("carom").expect("valid");
    assert!(carom.pockets().is_empty() && carom.ball().radius_m > RADIUS);
    assert!(
        Table::built_in("seven_foot")
            .expect("valid")
            .cue_ball()
            .mass_kg
            > POOL.mass_kg
    );
}

#[test]
fn a_bad_table_is_refused_with_what_is_wrong() {
    let message = |json: &str| match Table::parse(json) {
        Err(Error::Table(fault)) => fault.to_string(),
        other => panic!("{other:?}"),
    };
    let good = include_str!("../../../assets/tables/nine_foot.json");
    assert!(Table::parse(good).is_ok());
    for (from, to, word) in [
        ("\"length_m\": 2.54", "\"length_m\": -1", "length"),
        ("\"length_m\": 2.54", "\"length_m\": 1e300", "length"),
        ("\"length_m\": 2.54", "\"length\": 2", "unknown field"),
        (
            "\"nose_height_m\": 0.0363",
            "\"nose_height_m\": 0.2",
            "noses",
        ),
        ("\"cut_deg\": 142.0", "\"cut_deg\": 180.0", "cut angle"),
        (
            "\"radius_m\": 0.0585",
            "\"radius_m\": 0.01",
            "radius of a pocket",
        ),
        ("\"width_m\": 1.27", "\"width_m\": 0.3", "leave no cushion"),
    ] {
        assert!(good.contains(from), "{from}");
        let text = message(&good.replacen(from, to, 1));
        assert!(text.contains(word), "{text}");
    }
    assert!(message("{").contains("EOF"));
    let unknown = Table::built_in("ten_foot")
        .expect_err("there is none")
        .to_string();
    assert!(
        unknown.contains("ten_foot") && unknown.contains("snooker"),
        "{unknown}"
    );
}

#[test]
fn a_dropped_ball_bounces_as_its_restitution_says() {
    let height = 0.4;
    let start = flying(
        0,
        DVec3::new(0.0, 0.1, RADIUS + height),
        DVec3::ZERO,
        DVec3::ZERO,
    );
    let shot = released(Table::nine_foot(), Laws::default(), vec![start]);
    let bounces: Vec<&Event> = shot
        .events()
        .iter()
        .filter(|e| {
            matches!(
                e.kind,
                EventKind::Bounces {
                    surface: Surface::Cloth,
                    ..
                }
            )
        })
        .collect();
    let mut speed = (2.0 * GRAVITY * height).sqrt();
    let mut at = speed / GRAVITY;
    let mut count = 0;
    loop {
        assert!((bounces[count].time_secs - at).abs() < 1e-12);
        count += 1;
        speed *= 0.5;
        if speed * speed / (2.0 * GRAVITY) < HOP_LEAST_M {
            break;
        }
        at += 2.0 * speed / GRAVITY;
    }
    assert_eq!(bounces.len(), count);
    assert!((shot.duration_secs() - at).abs() < 1e-12, "then it lies");
    assert_eq!(
        shot.final_states()[0].position,
        DVec3::new(0.0, 0.1, RADIUS)
    );
    assert_energy_never_grows(&shot);
}

#[test]
fn elevated_strokes_jump_where_level_ones_hit() {
    let layout = || BallLayout {
        balls: vec![resting(0, -0.6, 0.0), resting(1, -0.3, 0.0)],
    };
    let world = World::new(Table::nine_foot(), layout()).expect("valid");
    let level = Stroke::straight(0.0, 5.0);
    let jump = Stroke {
        elevation_rad: 45f64.to_radians(),
        ..level
    };
    let hits = |stroke| {
        let shot = world.strike(stroke).expect("valid");
        assert_energy_never_grows(&shot);
        find(&shot, |kind| matches!(kind, EventKind::BallBall { .. })).map(|e| e.time_secs)
    };
    assert!(hits(level).is_some_and(|t| t < 0.1));
    let shot = world.strike(jump).expect("valid");
    let at_ball = |t: f64| shot.states_at(t)[0].position;
    let over = (0..1000)
        .map(|i| at_ball(f64::from(i) * 1e-3))
        .find(|p| p.x >= -0.3)
        .expect("it gets there");
    assert!(over.z > 3.0 * RADIUS, "it passes over the ball: {over}");
    assert!(
        hits(jump).is_none_or(|t| t > 0.2),
        "what it meets is the cushion or on its way back"
    );
}

#[test]
fn balls_that_meet_in_the_air_keep_their_momentum() {
    for offset in [
        DVec3::ZERO,
        DVec3::new(0.0, 0.02, 0.03),
        DVec3::new(0.0, -0.01, -0.05),
    ] {
        let place = DVec3::new(0.0, 0.0, 0.3);
        let one = flying(
            1,
            place - 0.1 * DVec3::X + offset,
            DVec3::X * 3.0,
            DVec3::Z * 40.0,
        );
        let two = flying(2, place + 0.1 * DVec3::X, DVec3::X * -1.0, DVec3::Y * 90.0);
        let shot = released(Table::nine_foot(), Laws::default(), vec![one, two]);
        let met = find(&shot, |k| matches!(k, EventKind::BallBall { .. })).expect("they meet");
        let [before, after] = [met.time_secs.next_down(), met.time_secs].map(|t| shot.states_at(t));
        let momentum = |states: &[BallState]| states.iter().map(|b| b.velocity).sum::<DVec3>();
        assert!((momentum(&before) - momentum(&after)).length() < 1e-13);
        let normal = (before[1].position - before[0].position).normalize();
        let closing = |s: &[BallState]| (s[0].velocity - s[1].velocity).dot(normal);
        assert!((closing(&after) + 0.95 * closing(&before)).abs() < 1e-12);
        let gap = before[0].position.distance(before[1].position) - 2.0 * RADIUS;
        assert!(gap.abs() < 1e-12, "they touch where they meet: {gap}");
        assert_energy_never_grows(&shot);
    }
}

#[test]
fn unequal_balls_keep_momentum_and_restitution() {
    for (mass_ratio, size_ratio) in [(10.0, 1.0), (0.1, 1.0), (1.18, 1.0556), (8.0, 2.0)] {
        let body = BallBody {
            mass_kg: POOL.mass_kg * mass_ratio,
            radius_m: RADIUS * size_ratio,
        };
        for offset in [0.0, 0.02, -0.04] {
            let one = BallState {
                velocity: DVec3::X * 2.0,
                spin: DVec3::Z * 30.0,
                ..BallState::at_rest(0, -0.3, offset, &body)
            };
            // Balls of two sizes push each other up and down, and the slate's friction answers.
            let laws = Laws {
                slate: BounceLaw::FLAT,
                ..Laws::default()
            };
            let shot = released(Table::nine_foot(), laws, vec![one, resting(1, 0.0, 0.0)]);
            let met = find(&shot, |k| matches!(k, EventKind::BallBall { .. })).expect("they meet");
            let [before, after] =
                [met.time_secs.next_down(), met.time_secs].map(|t| shot.states_at(t));
            let momentum = |s: &[BallState]| {
                s.iter()
                    .map(|b| b.body.mass_kg * b.velocity)
                    .sum::<DVec3>()
                    .with_z(0.0)
            };
            assert!((momentum(&before) - momentum(&after)).length() < 1e-12);
            let normal = (before[1].position - before[0].position).normalize();
            let closing = |s: &[BallState]| (s[0].velocity - s[1].velocity).dot(normal);
            if size_ratio == 1.0 {
                assert!((closing(&after) + 0.95 * closing(&before)).abs() < 1e-12);
            }
            assert_energy_never_grows(&shot);
        }
    }
    let laws = Laws {
        ball_ball: BallBallLaw::IDEAL,
        ..Laws::default()
    };
    let heavy = BallState {
        body: BallBody {
            mass_kg: 3.0 * POOL.mass_kg,
            ..POOL
        },
        ..moving(0, -0.1, 0.0, DVec3::X)
    };
    let shot = released(Table::nine_foot(), laws, vec![heavy, resting(1, 0.0, 0.0)]);
    let met = find(&shot, |k| matches!(k, EventKind::BallBall { .. })).expect("they meet");
    let [before, after] = [met.time_secs.next_down(), met.time_secs].map(|t| shot.states_at(t));
    let ratio = |i: usize| after[i].velocity.x / before[0].velocity.x;
    assert!((ratio(0) - 0.5).abs() < 1e-12 && (ratio(1) - 1.5).abs() < 1e-12);
}

#[test]
fn balls_driven_over_the_rail_fall_to_the_floor() {
    let table = Table::nine_foot();
    let (_, high) = table.outline();
    let start = flying(
        4,
        DVec3::new(0.9, 0.1, 0.1),
        DVec3::new(4.0, 0.0, 1.0),
        DVec3::ZERO,
    );
    let shot = released(
        table.clone(),
        Laws::default(),
        vec![start, resting(0, 0.0, 0.0)],
    );
    let left = find(&shot, |k| matches!(k, EventKind::LeftTable { .. })).expect("it leaves");
    let EventKind::LeftTable {
        ball: 4,
        point,
        speed_m_s,
    } = left.kind
    else {
        panic!("{left:?}")
    };
    assert!((point.x - high.x).abs() < 1e-12 && speed_m_s > 3.9);
    assert!((left.time_secs - (high.x - 0.9) / 4.0).abs() < 1e-12);
    let end = shot.final_states()[0];
    assert_eq!(end.phase, Phase::OffTable);
    assert!((end.position.z - (RADIUS - table.bed_height_m())).abs() < 1e-9);
    assert!(
        shot.poses_at(left.time_secs + 0.01)[0].on_table,
        "it is seen falling"
    );
}

#[test]
fn a_ball_that_lands_on_a_cushion_comes_back_or_goes() {
    let table = Table::nine_foot();
    let mut back = 0;
    for step in 0..60 {
        let x = 1.20 + 0.003 * f64::from(step);
        let start = flying(2, DVec3::new(x, 0.2, 0.15), DVec3::X * 0.2, DVec3::ZERO);
        let shot = released(table.clone(), Laws::default(), vec![start]);
        assert_energy_never_grows(&shot);
        for event in shot.events() {
            assert_solid(&table, &shot, event.time_secs);
        }
        let end = shot.final_states()[0];
        match end.phase {
            Phase::Resting => {
                assert!(end.position.x < 1.27 - RADIUS + 1e-9, "{end:?}");
                back += 1;
            }
            Phase::OffTable => {
                assert!(
                    find(&shot, |k| matches!(k, EventKind::LeftTable { ball: 2, .. })).is_some()
                );
            }
            other => panic!("{other:?}"),
        }
    }
    assert!((10..50).contains(&back), "{back} of 60 come back");
}

#[test]
fn slow_balls_tip_over_the_rim_and_resting_ones_hang() {
    let table = Table::nine_foot();
    let pocket = table.pockets()[4];
    let edge = pocket.center + pocket.radius_m * pocket.mouth;
    let on_edge = edge + 1e-12 * pocket.mouth;
    let hanging = resting(3, on_edge.x, on_edge.y);
    let world = World::with_laws(table.clone(), Laws::default(), vec![hanging]).expect("valid");
    assert_eq!(world.release().expect("it ends").duration_secs(), 0.0);

    for speed in [1e-5, 1e-3, 0.05, 0.3, 1.0, 4.0, 8.0] {
        let into = -pocket.mouth.extend(0.0);
        let place = edge + 1e-12 * pocket.mouth;
        let start = BallState {
            spin: DVec3::Z.cross(speed * into) / RADIUS,
            ..moving(3, place.x, place.y, speed * into)
        };
        let shot = released(table.clone(), Laws::default(), vec![start]);
        assert_energy_never_grows(&shot);
        for event in shot.events() {
            assert_solid(&table, &shot, event.time_secs);
        }
        assert!(
            shot.events().len() < 3000,
            "{} events at {speed}",
            shot.events().len()
        );
        let end = shot.final_states()[0];
        assert_eq!(end.phase, Phase::Pocketed, "at {speed} m/s");
        assert!(
            (end.position.z + pocket.depth_m).abs() < 1e-9,
            "it fell to the bottom: {end:?}"
        );
        // Free fall takes 0.16 s for the way down; tipping over takes its time too.
        let slowest = if speed < 0.01 { 4.0 } else { 0.6 };
        assert!(
            (0.1..slowest).contains(&shot.duration_secs()),
            "{}",
            shot.duration_secs()
        );
    }
}

#[test]
fn potted_balls_lie_in_the_order_of_their_fall() {
    let table = Table::nine_foot();
    let towards = |number: u8, pocket: usize, from: DVec2| {
        let way = table.pockets()[pocket].center - from;
        moving(number, from.x, from.y, (2.0 * way.normalize()).extend(0.0))
    };
    let balls = vec![
        resting(0, 0.0, 0.0),
        towards(7, 5, DVec2::new(0.7, 0.1)),
        towards(3, 0, DVec2::new(-1.1, -0.45)),
    ];
    let mut world = World::with_laws(table.clone(), Laws::default(), balls).expect("valid");
    let shot = world.release().expect("it ends");
    assert!(world.tray().is_empty());
    world.adopt(&shot);
    assert_eq!(world.tray(), [(3, 0), (7, 5)]);
    world.place(3, 0.3, 0.3).expect("free");
    assert_eq!(world.tray(), [(7, 5)], "a spotted ball is taken out");
}

#[test]
fn a_miscue_is_reported() {
    let world = World::new(
        Table::nine_foot(),
        BallLayout {
            balls: vec![resting(0, 0.0, 0.0)],
        },
    )
    .expect("valid");
    let with_side = |side| Stroke {
        side,
        ..Stroke::straight(0.0, 2.0)
    };
    let slips = |side| {
        let shot = world.strike(with_side(side)).expect("valid");
        find(&shot, |k| matches!(k, EventKind::Miscue { .. })).is_some()
    };
    assert!(slips(0.52) && !slips(0.51));
}

#[test]
fn the_same_jump_has_the_same_bits() {
    let table = Table::nine_foot();
    let rack = table.rack_eight(8);
    let world = World::new(table, rack).expect("valid");
    let stroke = Stroke {
        elevation_rad: 0.6,
        side: 0.2,
        ..Stroke::straight(0.01, 9.0)
    };
    let [one, two] = [(); 2].map(|()| world.strike(stroke).expect("valid"));
    assert_eq!(one.events(), two.events());
    assert_eq!(one.final_states(), two.final_states());
}

#[test]
fn a_flight_in_mirror_image_is_the_mirror_image() {
    let flip = |v: DVec3| DVec3::new(v.x, -v.y, v.z);
    let start = flying(
        1,
        DVec3::new(0.9, 0.3, 0.2),
        DVec3::new(2.5, 1.5, 1.0),
        DVec3::new(5.0, 60.0, 9.0),
    );
    let twin = BallState {
        position: flip(start.position),
        velocity: flip(start.velocity),
        spin: -flip(start.spin),
        ..start
    };
    let [one, two] = [start, twin].map(|b| released(Table::nine_foot(), Laws::default(), vec![b]));
    for step in 0..100 {
        let t = 0.02 * f64::from(step);
        let (a, b) = (one.poses_at(t)[0].position, two.poses_at(t)[0].position);
        assert!((flip(a) - b).length() < 1e-8, "at {t}: {a} and {b}");
    }
}

#[test]
fn lossless_bounces_are_refused() {
    let laws = Laws {
        slate: BounceLaw {
            restitution: 1.0,
            friction: 0.2,
        },
        ..Laws::default()
    };
    let error = World::with_laws(Table::nine_foot(), laws, Vec::new()).expect_err("endless");
    assert!(
        error.to_string().contains("restitution of the slate"),
        "{error}"
    );
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 512, failure_persistence: None, ..Default::default() })]

    /// Balls thrown at any table, anyhow.
    #[test]
    fn any_throw_ends_in_order(
        table in 0..Table::built_in_names().count(),
        place in (-1.0..1.0, -1.0..1.0, 0.0..0.4),
        speed in prop_oneof![1e-6..1e-2, 0.1..15.0, 15.0..100.0],
        heading in (-3.2..3.2, -1.5..1.5),
        spin in prop_oneof![Just(0.0), 1.0..300.0, 300.0..1e4],
        spin_axis in (-3.2..3.2, -1.5..1.5),
    ) {
        let name = Table::built_in_names().nth(table).expect("in range");
        assert_ends_in_order(name, place, (speed, heading), (spin, spin_axis));
    }
}

/// Throws that came through something, or gained energy, before edges were told from the lines that they
/// lie on.
#[test]
fn throws_over_the_ends_of_edges_end_in_order() {
    let still = (0.0, (0.0, 0.0));
    for (table, place, throw, spin) in [
        // Over the mouth of a pocket into the edge of its wall.
        (
            "eight_foot",
            (-0.511_279, -0.684_773, 0.135_261),
            (1.334_001, (-2.964_407, 0.664_344)),
            (261.437_835, (-0.748_721, 1.157_661)),
        ),
        // Out of a pocket's throat along a nose from beyond its end.
        (
            "seven_foot",
            (0.843_345_869_9, 0.778_950_308_1, 0.243_806_743_6),
            (0.005_578_071, (2.159_817_570, -0.630_233_968)),
            still,
        ),
        // Out of a throat over a facing onto the rail.
        (
            "eight_foot",
            (0.892_333_748_1, 0.618_229_622_5, 0.259_055_611_5),
            (0.000_975_864_9, (0.0, -1.041_672_603_9)),
            (235.856_715_728_6, (-0.060_740_653_1, 0.763_251_349_2)),
        ),
        // From the rail into a pocket.
        (
            "seven_foot",
            (-0.098_059_758_8, 0.935_696_817_3, 0.094_904_984_8),
            (0.008_697_652_5, (2.585_816_423_2, 0.165_664_352_9)),
            (9_116.598_188_676, (1.886_765_971_4, -1.232_489_049_6)),
        ),
    ] {
        assert_ends_in_order(table, place, throw, spin);
    }
}

/// A ball thrown from a place on a table of 1.2 by 1.2 times the real one, at a height, with a velocity and a
/// spin by size, azimuth and climb: it ends, nothing passes through anything, and energy never
/// grows. A throw that begins inside of something is left out.
fn assert_ends_in_order(
    table: &str,
    (x, y, height): (f64, f64, f64),
    (speed, heading): (f64, (f64, f64)),
    (spin, spin_axis): (f64, (f64, f64)),
) {
    let table = Table::built_in(table).expect("valid");
    let body = table.ball();
    let along = |(azimuth, climb): (f64, f64)| {
        DVec3::new(
            climb.cos() * azimuth.cos(),
            climb.cos() * azimuth.sin(),
            climb.sin(),
        )
    };
    let place = DVec3::new(
        0.6 * x * table.length_m(),
        0.6 * y * table.width_m(),
        body.radius_m + height,
    );
    let thrown = BallState {
        body,
        ..flying(1, place, speed * along(heading), spin * along(spin_axis))
    };
    let rests = BallState::at_rest(2, 0.3, 0.0, &body);
    let Ok(world) = World::with_laws(table.clone(), Laws::default(), vec![rests, thrown]) else {
        return;
    };
    let shot = world.release().expect("it ends");
    assert_energy_never_grows(&shot);
    for event in shot.events() {
        assert_solid(&table, &shot, event.time_secs);
    }
    for step in 0..200 {
        let t = shot.duration_secs().min(2.0) * f64::from(step) / 200.0;
        assert_solid(&table, &shot, t);
    }
}
