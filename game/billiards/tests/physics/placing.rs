//! Balls before a shot, and strokes that no shot can begin with.

use super::*;

#[test]
fn absurd_strokes_are_rejected_with_a_sentence() {
    let world = eight_ball(0);
    let good = Stroke::straight(0.0, 3.0);
    for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, 1e300, -1.0] {
        for stroke in [
            Stroke {
                speed_m_s: bad,
                ..good
            },
            Stroke { side: bad, ..good },
            Stroke {
                vertical: bad,
                ..good
            },
            Stroke {
                elevation_rad: bad,
                ..good
            },
        ] {
            let error = world.strike(stroke).expect_err("absurd").to_string();
            assert!(
                error.starts_with("this stroke cannot be played: the "),
                "{error}"
            );
            assert!(predict(&world, stroke).is_err());
        }
    }
    assert!(
        world
            .strike(Stroke {
                direction_rad: f64::NAN,
                ..good
            })
            .is_err()
    );
    assert!(
        world
            .strike(Stroke {
                speed_m_s: 0.0,
                ..good
            })
            .is_err()
    );
    assert!(
        world
            .strike(Stroke {
                direction_rad: 1e9,
                ..good
            })
            .is_ok()
    );
}

#[test]
fn impossible_layouts_are_rejected() {
    let rejected = |balls: Vec<BallState>| {
        matches!(
            World::new(Table::nine_foot(), BallLayout { balls }),
            Err(Error::Layout(_))
        )
    };
    assert!(
        rejected(vec![resting(0, 0.0, 0.0), resting(1, 0.05, 0.0)]),
        "overlap"
    );
    assert!(
        rejected(vec![resting(0, 0.0, 0.0), resting(0, 0.5, 0.0)]),
        "twice"
    );
    assert!(rejected(vec![resting(0, 1.26, 0.0)]), "in a cushion");
    assert!(rejected(vec![resting(0, 0.0, 0.65)]), "in a pocket");
    assert!(rejected(vec![resting(0, 9.0, 0.0)]), "off the table");
    assert!(rejected(vec![resting(0, f64::NAN, 0.0)]), "nowhere");
    let mut floating = resting(0, 0.0, 0.0);
    floating.position.z = 0.5;
    assert!(rejected(vec![floating]), "in the air");
    let lossless = Laws {
        cloth: carom_billiards::physics::Cloth {
            rolling_friction: 0.0,
            ..Default::default()
        },
        ..ideal()
    };
    assert!(matches!(
        World::with_laws(prairie(), lossless, Vec::new()),
        Err(Error::Laws { .. })
    ));
}

#[test]
fn racks_are_tight_and_legal() {
    for seed in 0..50 {
        let balls = Table::nine_foot().rack_eight(seed).balls;
        let mut numbers: Vec<_> = balls.iter().map(|ball| ball.number).collect();
        assert_eq!(balls[5].number, 8, "the 8 is in the middle");
        assert_ne!(
            balls[11].number < 8,
            balls[15].number < 8,
            "a solid and a stripe in the corners"
        );
        numbers.sort_unstable();
        assert_eq!(numbers, (0..16).collect::<Vec<_>>());
        let apex = balls[1].position;
        for neighbour in [&balls[2], &balls[3]] {
            let gap = apex.distance(neighbour.position) - 2.0 * RADIUS;
            assert!((15e-6..65e-6).contains(&gap), "{gap}");
        }
    }
}
