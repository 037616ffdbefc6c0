//! Shots of another simulator, theory, published curves and many balls, through the bench that
//! measures them.

use std::path::Path;

use carom_bench::physics::{
    accuracy, airborne, break_agreement, break_samples, breaks, closed_forms, curves, many_balls,
    reference::ReferenceShot,
};

fn references() -> Vec<ReferenceShot> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../references/physics");
    ReferenceShot::read_folder(&folder).expect("the references are in the repository")
}

#[test]
fn shots_follow_the_references() {
    // Their positions, up to 40 m, are written with nine digits.
    let closed_forms = ["backspin_slide", "pure_spin", "roll_out", "slide_to_roll"];
    let measured = accuracy::Accuracy::measure(&references()).expect("all can be played");
    assert!(
        measured.shots.len() >= 12,
        "only {} references",
        measured.shots.len()
    );
    for shot in measured.shots.iter().filter(|shot| shot.is_comparable()) {
        let exact = closed_forms.contains(&shot.name.as_str());
        let bound_mm = if exact {
            5.1e-5
        } else {
            accuracy::WORST_MAX_MM
        };
        assert!(shot.max_mm <= bound_mm, "{shot:?}");
        assert_eq!(shot.pocketed_differently, 0, "{}", shot.name);
    }
    assert!(
        measured.median_max_mm <= accuracy::MEDIAN_MAX_MM,
        "{measured}"
    );
}

#[test]
fn struck_clusters_part_as_in_the_references() {
    let measured = accuracy::Accuracy::measure(&references()).expect("all can be played");
    let clusters: Vec<_> = measured
        .shots
        .iter()
        .filter(|shot| shot.kind == "cluster")
        .collect();
    assert_eq!(clusters.len(), 2);
    for shot in clusters {
        assert!(shot.fastest_off_m_s < 0.01, "of 2 m/s: {shot:?}");
        // The others press on each other for a while, for which the references have a rule and
        // `pressed_balls_move_as_in_lasting_contact` the theory.
        let off = shot.velocity_off_m_s;
        assert!(off > 0.0 && off < 0.04, "of 2 m/s: {shot:?}");
    }
}

#[test]
fn breaks_of_the_references_are_draws_of_ours() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../references");
    let theirs = break_samples::ReferenceBreaks::read(&folder.join("breaks.json"))
        .expect("it is in the repository");
    let rows = breaks::measure(&references(), &theirs, 100).expect("all can be played");
    let agreement = break_agreement::BreakAgreement::of(&rows);
    assert_eq!((agreement.comparisons, agreement.shots), (6, 6));
    assert!(
        agreement.chance_together > break_agreement::CHANCE_TOGETHER_MIN,
        "{agreement}"
    );
    assert_eq!(
        rows.len(),
        9,
        "two racks of the references and the game's own"
    );
    for row in &rows {
        assert!(row.halves_differ.abs() < 4.0, "{row}");
        // Energy hardly differs from draw to draw, so that its band is narrower than the models.
        let slack = 0.05 * row.mean;
        let [low, high] = row.band;
        let fits = |value: f64| (low - slack..=high + slack).contains(&value);
        assert!(row.reference.is_none_or(fits), "{row}");
    }
    let kept = rows
        .iter()
        .find(|row| row.quantity == "energy kept")
        .expect("counted");
    assert!((0.3..0.6).contains(&kept.mean), "{kept}");
}

#[test]
fn closed_forms_and_published_curves_are_met() {
    for form in closed_forms::measure().expect("one ball always comes to rest") {
        assert!(form.error <= closed_forms::ERROR_MAX, "{form}");
    }
    for curve in curves::measure().expect("two balls always come to rest") {
        assert!(curve.error_max <= curve.bar, "{curve}");
    }
}

#[test]
fn rapier_converges_to_the_closed_flight() {
    let rows = airborne::measure().expect("all can be played");
    let errors = |row: &airborne::FlightRow| {
        let airborne::FlightRow {
            flight_off_mm,
            meeting_off_mm,
            ..
        } = *row;
        [flight_off_mm, meeting_off_mm]
    };
    let (exact, stepped) = rows.split_first().expect("rows");
    let all = errors(exact)
        .into_iter()
        .chain([exact.momentum_off, exact.energy_off]);
    for error in all {
        assert!(error < airborne::OFF_MAX, "{exact}");
    }
    for row in stepped {
        assert!(errors(row).into_iter().all(|error| error > 1e-2), "{row}");
    }
    // What it comes up to at ever smaller steps is the closed form, or that were wrong.
    let [longest, shortest] =
        [stepped.first(), stepped.last()].map(|row| errors(row.expect("rows")));
    for (long, short) in longest.into_iter().zip(shortest) {
        assert!(short < 0.1 * long, "{longest:?} and {shortest:?} mm");
    }
}

#[test]
fn a_thousand_balls_come_to_rest() {
    let crowds = many_balls::measure().expect("they end");
    assert_eq!(crowds.iter().map(|crowd| crowd.balls).max(), Some(1000));
    for crowd in &crowds {
        assert!(crowd.energy_growth_j <= 1e-12, "{crowd}");
        assert!(crowd.overlap_m <= 1e-9, "{crowd}");
        assert!(crowd.moved > 10 && crowd.events > crowd.moved, "{crowd}");
    }
    let frozen = crowds.iter().find(|crowd| crowd.gap_m == 0.0);
    assert!(frozen.is_some_and(|crowd| crowd.moved == crowd.balls));
}
