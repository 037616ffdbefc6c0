//! Between two cushions, cuts that hardly touch, and time that runs backwards.

use super::*;
use carom_billiards::physics::{BounceLaw, CushionLaw};

#[test]
fn a_ball_between_two_cushions_comes_out() {
    let table = Table::built_in("carom").expect("it ships with the game");
    let radius = table.ball().radius_m;
    let corner = DVec2::new(
        0.5 * table.length_m() - radius,
        0.5 * table.width_m() - radius,
    );
    for (back, speed) in [(0.0, 0.0), (0.0, 1e-6), (0.0, 2.0), (1e-9, 0.5), (0.3, 6.0)] {
        for turn in 0..16 {
            let way = DVec2::from_angle(f64::from(turn) * PI / 8.0);
            let from = corner - DVec2::splat(back);
            let start = BallState {
                velocity: (speed * way).extend(0.0),
                spin: DVec3::new(30.0, -20.0, 50.0) * f64::from(turn % 2),
                ..BallState::at_rest(0, from.x, from.y, &table.ball())
            };
            let shot = released(table.clone(), Laws::default(), vec![start]);
            assert!(shot.events().len() < 2000, "{} events", shot.events().len());
            assert_energy_never_grows(&shot);
            let end = shot.final_states()[0].position.truncate();
            assert!((end - corner).max_element() < 1e-6, "{end} is in a cushion");
        }
    }
}

/// The object ball leaves along the line of centres, and the cue ball goes on past it.
#[test]
fn the_thinnest_cuts_obey_the_law() {
    for degrees in [85.0, 89.0, 89.9f64] {
        let (sin, cos) = degrees.to_radians().sin_cos();
        let balls = vec![
            ball(0, -0.2, -2.0 * RADIUS * sin, 4.0 * DVec3::X, DVec3::ZERO),
            resting(1, 0.0, 0.0),
        ];
        let shot = released(prairie(), ideal(), balls);
        let [before, after] = around(&shot, first_ball_contact(&shot));
        let object = after[1].velocity;
        let speed = before[0].velocity.length() * cos;
        assert!(
            (object.length() - speed).abs() < 1e-9,
            "{degrees}: {object}"
        );
        let off = object.normalize().dot(DVec3::new(sin, -cos, 0.0));
        assert!(off.abs() < 1e-6, "{degrees}: {off} off the line of centres");
        assert!((momentum(&before) - momentum(&after)).length() < 1e-13);
        assert!((after[0].velocity.length() - before[0].velocity.length() * sin).abs() < 1e-9);
    }
}

/// On a table without friction, with ideal balls and cushions, every velocity turned round leads
/// back: each contact costs about a digit, and no more.
#[test]
fn time_runs_backwards_on_an_ideal_table() {
    let parts = TableParts {
        name: "ideal".to_owned(),
        length_m: 6.0,
        width_m: 1.0,
        nose_height_m: RADIUS,
        noses: vec![
            [DVec2::new(3.0, 0.5), DVec2::new(-3.0, 0.5)],
            [DVec2::new(-3.0, -0.5), DVec2::new(3.0, -0.5)],
        ],
        jaws: Vec::new(),
        pockets: Vec::new(),
    };
    // Open at both ends: what leaves there needs no friction to end the shot.
    let table = Table::from_parts(parts).expect("valid");
    let laws = Laws {
        cloth: carom_billiards::physics::Cloth {
            sliding_friction: 1e-14,
            rolling_friction: 1e-14,
            ..Default::default()
        },
        cushion: CushionLaw {
            restitution: 1.0,
            friction: 0.0,
            ..CushionLaw::default()
        },
        slate: BounceLaw::FLAT,
        ..ideal()
    };
    let start = vec![
        ball(0, -0.4, 0.0, DVec3::new(2.0, 0.0, 0.0), DVec3::ZERO),
        ball(1, 0.0, 0.025, DVec3::new(0.1, -0.1, 0.0), DVec3::ZERO),
        ball(2, 0.3, -0.05, DVec3::new(-0.5, 0.1, 0.0), DVec3::ZERO),
    ];
    let secs = 1.2;
    let there = released(table.clone(), laws, start.clone());
    let contacts = there.events().iter().filter(|event| {
        event.time_secs < secs
            && matches!(
                event.kind,
                EventKind::BallBall { .. } | EventKind::Cushion { .. }
            )
    });
    let contacts = contacts.count() as i32;
    assert!(contacts >= 4, "{contacts} contacts: {:?}", there.events());
    let turned = there.states_at(secs).into_iter().map(|state| BallState {
        velocity: -state.velocity,
        spin: -state.spin,
        ..state
    });
    let back = released(table, laws, turned.collect()).states_at(secs);
    for (end, start) in back.iter().zip(&start) {
        let off_m = end.position.distance(start.position);
        let allowed_m = 1e-15 * 10f64.powi(contacts);
        assert!(
            off_m < allowed_m.max(1e-12),
            "{off_m} m after {contacts} contacts"
        );
        assert!((end.velocity + start.velocity).length() < 10.0 * allowed_m.max(1e-12));
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 256, failure_persistence: None, ..Default::default() })]

    /// Into any pocket of any table, rolling or in the air: it ends, and nothing passes the upright edge
    /// at which a facing ends, unless it comes from under it.
    #[test]
    fn facings_end_in_an_edge_that_is_solid(
        name in prop_oneof![Just("seven_foot"), Just("eight_foot"), Just("nine_foot"), Just("snooker")],
        pocket in 0usize..6,
        beside in (-0.07..0.07, -0.07..0.07),
        from in (0.15..0.65, -1.3..1.3),
        speed in 0.3..9.0,
        rise in prop_oneof![Just(None), (1e-3..0.03, -0.5..1.0).prop_map(Some)],
        spin in (-100.0..100.0, -100.0..100.0, -100.0..100.0),
    ) {
        let table = Table::built_in(name).expect("it ships with the game");
        let (body, center) = (table.ball(), table.pockets()[pocket].center);
        let ((distance, turn), speed): ((f64, f64), f64) = (from, speed);
        let place = center - distance * DVec2::from_angle(turn).rotate(center.normalize());
        let way = (center + DVec2::new(beside.0, beside.1) - place).normalize();
        let (height, climb): (f64, f64) = rise.unwrap_or((0.0, 0.0));
        let start = BallState {
            position: place.extend(body.radius_m + height),
            velocity: (speed * way).extend(climb),
            spin: DVec3::from(spin),
            phase: if rise.is_some() { Phase::Airborne } else { Phase::Sliding },
            ..BallState::at_rest(1, 0.0, 0.0, &body)
        };
        if let Ok(world) = World::with_laws(table.clone(), Laws::default(), vec![start]) {
            let shot = world.release().expect("it ends");
            assert_energy_never_grows(&shot);
            assert_before_facings_ends(&table, &shot);
        }
    }
}

fn assert_before_facings_ends(table: &Table, shot: &Shot) {
    let backs = table
        .cushions()
        .iter()
        .flat_map(|cushion| [cushion.corners[2], cushion.corners[3]]);
    let backs: Vec<_> = backs.collect();
    let end = shot.duration_secs().min(1.5);
    let states = (0..1000).map(|step| shot.states_at(end * f64::from(step) / 1000.0)[0]);
    for state in states.take_while(|state| state.phase.is_on_table() && state.position.z >= 0.0) {
        for back in &backs {
            let gap = state.position.truncate().distance(*back) - state.body.radius_m;
            let over = state.position.z > table.nose_height_m();
            assert!(over || gap > -1e-6, "{gap} m at {state:?}");
        }
    }
}

/// A ball comes to lie on a pocket's edge, against the upright edge of a facing, as slow ones may: it is
/// borne by both, and rolls out between them.
#[test]
fn slow_balls_at_a_pockets_edge_take_few_events() {
    let wedged = (
        DVec2::new(0.053_800_155_886_147_67, -0.881_003_794_872_603_8),
        DVec2::new(-0.177_895_506_311_278_93, -0.403_421_900_425_434_2),
        DVec3::new(15.368_453_349_539_969, -6.776_971_669_001_103, 0.0),
    );
    assert!(events_of_a_ball("snooker", wedged) < EVENTS_OF_A_SLOW_BALL_MAX);
    for name in ["seven_foot", "nine_foot", "snooker"] {
        let table = Table::built_in(name).expect("it ships with the game");
        let (pockets, radius_m) = (table.pockets(), table.ball().radius_m);
        for step in 0..SLOW_BALLS {
            let share = |by: f64| (by * f64::from(step)).fract();
            let pocket = &pockets[step as usize % pockets.len()];
            let out = DVec2::from_angle(2.4 * (share(0.618_034) - 0.5)).rotate(pocket.mouth);
            let place = pocket.center + (pocket.radius_m + 0.03 * share(0.754_878)) * out;
            let beside = (pocket.radius_m + radius_m) * (share(0.569_840) - 0.5) * out.perp();
            let way = (pocket.center + beside - place).normalize();
            let velocity = (0.02 + 0.6 * share(0.819_173)) * way;
            let spin = DVec3::new(-velocity.y, velocity.x, 5.0 * share(0.324_718)) / radius_m;
            let events = events_of_a_ball(name, (place, velocity, spin));
            assert!(
                events < EVENTS_OF_A_SLOW_BALL_MAX,
                "{name} {step}: {events}"
            );
        }
    }
}

/// What happens to one ball, by its place, velocity and spin; nothing where it cannot lie.
fn events_of_a_ball(name: &str, (place, velocity, spin): (DVec2, DVec2, DVec3)) -> usize {
    let table = Table::built_in(name).expect("it ships with the game");
    let start = BallState {
        velocity: velocity.extend(0.0),
        spin,
        ..BallState::at_rest(1, place.x, place.y, &table.ball())
    };
    let Ok(world) = World::with_laws(table, Laws::default(), vec![start]) else {
        return 0;
    };
    let shot = world.release().expect("it ends");
    assert_energy_never_grows(&shot);
    shot.events().len()
}

const SLOW_BALLS: u32 = 1_000;
/// Some two hundred hops take a slow ball round a pocket.
const EVENTS_OF_A_SLOW_BALL_MAX: usize = 2_000;
