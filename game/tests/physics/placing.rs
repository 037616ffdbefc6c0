//! Where balls lie before a shot, and strokes that no shot can begin with.

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
            World::new(Table::nine_foot(), Layout { balls }),
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
        cloth: carom::sim::Cloth {
            rolling_friction: 0.0,
            ..Default::default()
        },
        ..ideal()
    };
    assert!(matches!(
        World::with_laws(prairie(), lossless, Vec::new()),
        Err(Error::Laws(_))
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

/// The picture's table: shapes of `assets/scenes/pool.json` whose name begins so.
fn scene_shapes(prefix: &str, shape: &str) -> Vec<serde_json::Value> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../assets/scenes/pool.json");
    let text = fs::read_to_string(path).expect("the scene is in the repository");
    let scene: serde_json::Value = serde_json::from_str(&text).expect("a scene is JSON");
    let objects = scene["objects"].as_array().expect("objects").iter();
    let named = objects.filter(|o| o["name"].as_str().is_some_and(|n| n.starts_with(prefix)));
    named.map(|object| object["shape"][shape].clone()).collect()
}

fn over_cloth(point: &serde_json::Value) -> DVec2 {
    let [x, y] = [0, 1].map(|axis| point[axis].as_f64().expect("a number"));
    DVec2::new(x, y)
}

#[test]
fn the_table_is_the_one_in_the_picture() {
    let table = Table::boxes();
    let boxes: Vec<_> = scene_shapes("cush_", "box")
        .iter()
        .map(|b| (over_cloth(&b["min"]), over_cloth(&b["max"])))
        .collect();
    let is_in_front = |nose: &Nose, (low, high): &(DVec2, DVec2)| {
        let on_face = |p: DVec2| p.cmpge(*low - 1e-9).all() && p.cmple(*high + 1e-9).all();
        let outside = nose.from().midpoint(nose.to()) + 1e-6 * nose.normal();
        let leaves = outside.cmplt(*low).any() || outside.cmpgt(*high).any();
        on_face(nose.from()) && on_face(nose.to()) && leaves
    };
    for nose in table.noses() {
        assert!(
            boxes.iter().any(|b| is_in_front(nose, b)),
            "{nose:?} is on no cushion's face"
        );
    }
    // Each box is a long face, two rounded corners and two ends.
    assert_eq!(
        (table.noses().len(), table.jaws().len()),
        (3 * boxes.len(), 2 * boxes.len())
    );
    for jaw in table.jaws() {
        let corners = boxes
            .iter()
            .flat_map(|&(a, b)| [a, b, DVec2::new(a.x, b.y), DVec2::new(b.x, a.y)]);
        let inscribed =
            |corner: DVec2| ((corner - jaw.center).abs() - jaw.radius_m).length() < 1e-9;
        assert_eq!(
            corners.filter(|&c| inscribed(c)).count(),
            1,
            "{jaw:?} rounds no corner"
        );
    }
    let discs = scene_shapes("pocket", "disc");
    assert_eq!(discs.len(), table.pockets().len());
    for (disc, pocket) in discs.iter().zip(table.pockets()) {
        assert_eq!(over_cloth(&disc["center"]), pocket.center);
        assert_eq!(disc["radius"].as_f64(), Some(pocket.radius_m));
    }
    let balls = scene_shapes("ball", "sphere");
    let places = balls
        .iter()
        .map(|ball| over_cloth(&ball["center"]))
        .zip(0..);
    let balls = places
        .map(|(place, number)| resting(number, place.x, place.y))
        .collect();
    World::new(table, Layout { balls }).expect("the picture's balls lie on the table");
}
