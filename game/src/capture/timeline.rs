//! Timeline of a shot: its events in words.

use carom_billiards::physics::{EventKind, Shot};

use carom_text::text;

/// Event of a shot.
#[derive(Clone, Debug, PartialEq)]
pub struct TimelineEvent {
    /// Seconds since the stroke.
    pub secs: f64,
    /// Description, such as "the cue ball hits the 5".
    pub words: String,
    /// Whether it is a contact of two balls or of a ball and a cushion, of which there are many.
    pub is_contact: bool,
}

/// The notable events of a shot, in the order of time.
pub fn timeline_events(shot: &Shot) -> Vec<TimelineEvent> {
    let moment = |event: &carom_billiards::physics::Event| {
        words(&event.kind).map(|words| TimelineEvent {
            secs: event.time_secs,
            words,
            is_contact: matches!(
                event.kind,
                EventKind::BallBall { .. } | EventKind::Cushion { .. }
            ),
        })
    };
    shot.events().iter().filter_map(moment).collect()
}

/// Description of an event; none for bounces, rolling and rest.
fn words(kind: &EventKind) -> Option<String> {
    Some(match *kind {
        EventKind::Strike { speed_m_s } => {
            text!("event-strike", speed = format!("{speed_m_s:.1}"))
        }
        EventKind::Miscue { .. } => text!("event-miscue").to_owned(),
        EventKind::BallBall { first, second, .. } => {
            text!("event-hit", first = ball(first), second = ball(second))
        }
        EventKind::Cushion { ball: which, .. } => text!("event-cushion", ball = ball(which)),
        EventKind::Pocketed { ball: which, .. } => text!("event-potted", ball = ball(which)),
        EventKind::LeftTable { ball: which, .. } => text!("event-left-table", ball = ball(which)),
        EventKind::Bounces { .. } | EventKind::Rolls { .. } | EventKind::Rests { .. } => {
            return None;
        }
    })
}

fn ball(number: u8) -> String {
    text!("ball", number = number)
}

#[cfg(test)]
mod tests {
    use super::*;
    use carom_billiards::physics::{Stroke, Table, World};

    #[test]
    fn a_break_is_told_in_order() {
        let table = Table::nine_foot();
        let world = World::new(table.clone(), table.rack_eight(1)).unwrap();
        let told = timeline_events(&world.strike(Stroke::straight(0.0, 7.0)).unwrap());
        assert!(told.is_sorted_by(|a, b| a.secs <= b.secs));
        assert_eq!(told[0].words, "the cue strikes at 7.0 m/s");
        assert!(
            told[1].words.starts_with("the cue ball hits the "),
            "{told:?}"
        );
        assert!(
            told.iter()
                .any(|moment| moment.words.ends_with("meets a cushion"))
        );
    }
}
