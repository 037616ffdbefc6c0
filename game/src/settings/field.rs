//! Each setting's name in the file, and how it is read and written.

use carom_billiards::physics::Engine;
use carom_text::text;
use clap::ValueEnum;
use glam::DVec3;
use toml_edit::{Array, InlineTable, Value};

use super::Settings;
use crate::camera::{Viewpoint, wrap_rad};
use crate::input::{ACTIONS, Action, Bindings, MouseSettings, Trigger};
use crate::{KeysFault, SettingFault};

/// A line of the settings file.
#[derive(Clone, Copy)]
pub struct SettingsField {
    /// The heading.
    pub table: &'static str,
    /// The name under it.
    pub key: &'static str,
    /// As it is written.
    pub(super) read: fn(&Settings) -> Value,
    /// Takes a written value, or says what it must be.
    pub(super) write: fn(&mut Settings, &Value) -> Result<(), SettingFault>,
}

const fn field(
    table: &'static str,
    key: &'static str,
    read: fn(&Settings) -> Value,
    write: fn(&mut Settings, &Value) -> Result<(), SettingFault>,
) -> SettingsField {
    SettingsField {
        table,
        key,
        read,
        write,
    }
}

/// All settings but the keys.
#[rustfmt::skip]
pub const FIELDS: &[SettingsField] = &[
    field("window", "width", |s| i64::from(s.window[0]).into(), |s, v| edge(v).map(|w| s.window[0] = w)),
    field("window", "height", |s| i64::from(s.window[1]).into(), |s, v| edge(v).map(|h| s.window[1] = h)),
    field("window", "fullscreen", |s| s.fullscreen.into(), |s, v| switch(v).map(|on| s.fullscreen = on)),
    field("interface", "text-scale", |s| s.text_scale.into(), |s, v| number(v, Settings::TEXT_SCALE).map(|x| s.text_scale = x)),
    field("interface", "reduced-motion", |s| s.reduced_motion.into(), |s, v| switch(v).map(|on| s.reduced_motion = on)),
    field("interface", "lesson", |s| name(&s.lesson), |s, v| choice(v).map(|x| s.lesson = x)),
    field("game", "aim-aids", |s| name(&s.aim_aids), |s, v| choice(v).map(|x| s.aim_aids = x)),
    field("game", "cloth", |s| name(&s.cloth), |s, v| choice(v).map(|x| s.cloth = x)),
    field("game", "ball-set", |s| name(&s.ball_set), |s, v| choice(v).map(|x| s.ball_set = x)),
    field("game", "cue", |s| name(&s.cue), |s, v| choice(v).map(|x| s.cue = x)),
    field("game", "pockets", |s| name(&s.pockets), |s, v| choice(v).map(|x| s.pockets = x)),
    field("game", "table-speed", |s| name(&s.table_speed), |s, v| choice(v).map(|x| s.table_speed = x)),
    field("game", "physics", |s| s.physics.to_string().into(), |s, v| engine(v).map(|x| s.physics = x)),
    field("game", "particle-precision", |s| name(&s.particle_precision), |s, v| choice(v).map(|x| s.particle_precision = x)),
    field("game", "ball-marks", |s| name(&s.ball_marks), |s, v| choice(v).map(|x| s.ball_marks = x)),
    field("controls", "mouse-speed", |s| s.mouse.speed.into(), |s, v| number(v, MouseSettings::SPEED).map(|x| s.mouse.speed = x)),
    field("controls", "invert-pitch", |s| s.mouse.inverts_pitch.into(), |s, v| switch(v).map(|on| s.mouse.inverts_pitch = on)),
    field("picture", "quality", |s| name(&s.quality), |s, v| choice(v).map(|x| s.quality = x)),
    field("picture", "resolution", |s| name(&s.resolution), |s, v| choice(v).map(|x| s.resolution = x)),
    field("picture", "threads", |s| i64::from(s.threads).into(), |s, v| threads(v).map(|n| s.threads = n)),
    field("picture", "brightness", |s| name(&s.brightness), |s, v| choice(v).map(|x| s.brightness = x)),
    field("picture", "particles", |s| name(&s.particles), |s, v| choice(v).map(|x| s.particles = x)),
    field("drills", "line-up", |s| i64::from(s.drill_bests[0]).into(), |s, v| points(v).map(|n| s.drill_bests[0] = n)),
    field("drills", "spot-shots", |s| i64::from(s.drill_bests[1]).into(), |s, v| points(v).map(|n| s.drill_bests[1] = n)),
    field("drills", "position-play", |s| i64::from(s.drill_bests[2]).into(), |s, v| points(v).map(|n| s.drill_bests[2] = n)),
    field("views", "view-1", |s| view(s.views[0]), |s, v| seen(v).map(|at| s.views[0] = at)),
    field("views", "view-2", |s| view(s.views[1]), |s, v| seen(v).map(|at| s.views[1] = at)),
    field("views", "view-3", |s| view(s.views[2]), |s, v| seen(v).map(|at| s.views[2] = at)),
    field("views", "view-4", |s| view(s.views[3]), |s, v| seen(v).map(|at| s.views[3] = at)),
    field("sound", "volume", |s| s.volume.into(), |s, v| number(v, [0.0, 1.0]).map(|x| s.volume = x)),
];

fn edge(value: &Value) -> Result<u32, SettingFault> {
    let [min, max] = Settings::WINDOW_EDGE;
    whole(value, min, max)
}

fn threads(value: &Value) -> Result<u16, SettingFault> {
    whole(value, 0, Settings::THREADS_MAX.into()).map(|threads| threads as u16)
}

fn points(value: &Value) -> Result<u32, SettingFault> {
    whole(value, 0, POINTS_MAX)
}

fn whole(value: &Value, min: u32, max: u32) -> Result<u32, SettingFault> {
    let number = value
        .as_integer()
        .and_then(|number| u32::try_from(number).ok());
    let fits = number.filter(|number| (min..=max).contains(number));
    fits.ok_or(SettingFault::WholeNumber { min, max })
}

fn switch(value: &Value) -> Result<bool, SettingFault> {
    value.as_bool().ok_or(SettingFault::Switch)
}

fn number(value: &Value, [min, max]: [f64; 2]) -> Result<f64, SettingFault> {
    let whole = || value.as_integer().map(|number| number as f64);
    let number = value.as_float().or_else(whole);
    let fits = number.filter(|number| (min..=max).contains(number));
    fits.ok_or(SettingFault::Number { min, max })
}

fn name(choice: &impl ValueEnum) -> Value {
    let name = choice.to_possible_value();
    name.map_or(String::new(), |name| name.get_name().to_owned())
        .into()
}

fn choice<T: ValueEnum>(value: &Value) -> Result<T, SettingFault> {
    let chosen = value.as_str().and_then(|word| T::from_str(word, true).ok());
    chosen.ok_or_else(|| {
        let names = T::value_variants().iter().filter_map(T::to_possible_value);
        let names = names.map(|name| name.get_name().to_owned()).collect();
        SettingFault::Choice { names }
    })
}

fn engine(value: &Value) -> Result<Engine, SettingFault> {
    let engine = value.as_str().and_then(|word| word.parse().ok());
    engine.ok_or(SettingFault::Engine)
}

/// A saved view as it is written: its parts rounded to what can be seen; none as `{}`.
fn view(at: Option<Viewpoint>) -> Value {
    let Some(at) = at else {
        return Value::InlineTable(InlineTable::new());
    };
    let rows = VIEW_PARTS.iter().map(|part| {
        let rounded = ((part.read)(&at) * VIEW_DIGITS).round() / VIEW_DIGITS;
        (part.key, Value::from(rounded))
    });
    Value::InlineTable(rows.collect())
}

fn seen(value: &Value) -> Result<Option<Viewpoint>, SettingFault> {
    let rows = value.as_inline_table().ok_or_else(no_view)?;
    if rows.is_empty() {
        return Ok(None);
    }
    let mut at = Viewpoint {
        focus: DVec3::ZERO,
        bearing_rad: 0.0,
        pitch_rad: 0.0,
        distance_m: 0.0,
        fov_x_deg: 0.0,
    };
    for part in VIEW_PARTS {
        let value = rows.get(part.key).ok_or_else(no_view)?;
        let number = number(value, part.range);
        (part.write)(&mut at, number.map_err(|_| no_view())?);
    }
    Ok(Some(at))
}

fn no_view() -> SettingFault {
    let part =
        |part: &ViewpointPart| format!("{} from {} to {}", part.key, part.range[0], part.range[1]);
    let parts = VIEW_PARTS.iter().map(part).collect();
    SettingFault::View { parts }
}

/// A part of a saved view.
struct ViewpointPart {
    key: &'static str,
    range: [f64; 2],
    read: fn(&Viewpoint) -> f64,
    write: fn(&mut Viewpoint, f64),
}

const fn part(
    key: &'static str,
    range: [f64; 2],
    read: fn(&Viewpoint) -> f64,
    write: fn(&mut Viewpoint, f64),
) -> ViewpointPart {
    ViewpointPart {
        key,
        range,
        read,
        write,
    }
}

/// In ranges that hold what every view and every way of turning it can give.
#[rustfmt::skip]
const VIEW_PARTS: [ViewpointPart; 6] = [
    part("x", [-4.0, 4.0], |at| at.focus.x, |at, x| at.focus.x = x),
    part("y", [-4.0, 4.0], |at| at.focus.y, |at, y| at.focus.y = y),
    part(
        "bearing-deg",
        [-180.0, 180.0],
        |at| wrap_rad(at.bearing_rad).to_degrees(),
        |at, deg| at.bearing_rad = deg.to_radians(),
    ),
    part(
        "pitch-deg",
        [1.0, 90.0],
        |at| at.pitch_rad.to_degrees(),
        |at, deg| at.pitch_rad = deg.to_radians(),
    ),
    part(
        "distance-m",
        [0.5, 7.0],
        |at| at.distance_m,
        |at, m| at.distance_m = m,
    ),
    part(
        "fov-deg",
        [20.0, 160.0],
        |at| at.fov_x_deg,
        |at, deg| at.fov_x_deg = deg,
    ),
];
/// More than any drill gives.
const POINTS_MAX: u32 = 10_000;
const VIEW_DIGITS: f64 = 1e4;

/// What an action is bound to, as it is written.
pub(super) fn triggers(bindings: &Bindings, action: Action) -> Value {
    let labels = bindings.triggers(action).into_iter();
    Value::Array(labels.map(|trigger| trigger.to_string()).collect::<Array>())
}

/// Reads one action's triggers from a word or an array of words.
pub(super) fn read_triggers(value: &Value) -> Result<Vec<Trigger>, KeysFault> {
    let words: Vec<&Value> = match value {
        Value::String(_) => vec![value],
        Value::Array(array) => array.iter().collect(),
        _ => return Err(KeysFault::NotAList),
    };
    let trigger = |word: &Value| {
        let label = word.as_str().ok_or(KeysFault::NotInQuotes)?;
        Ok(label.parse()?)
    };
    words.into_iter().map(trigger).collect()
}

/// Binds what the player has chosen, and what is left of the defaults. Says what could not be bound.
pub(super) fn bind(chosen: &[(Action, Vec<Trigger>)]) -> (Bindings, Vec<String>) {
    let mut bindings = Bindings::none();
    let mut warnings = Vec::new();
    for (action, triggers) in chosen {
        for trigger in triggers {
            if let Err(error) = bindings.bind(*trigger, *action) {
                warnings.push(format!("[keys] {}: {error}", action.control().name));
            }
        }
    }
    let is_chosen = |action: Action| chosen.iter().any(|(of, _)| *of == action);
    let defaults = Bindings::default();
    for control in ACTIONS.iter().filter(|control| !is_chosen(control.action)) {
        for trigger in defaults.triggers(control.action) {
            // Taken by the player's choice: that is what it was for.
            let _ = bindings.bind(trigger, control.action);
        }
    }
    let lost = bindings.unbound().filter(|action| !is_chosen(*action));
    warnings.extend(lost.map(|action| {
        let control = action.control();
        text!(
            "settings-no-key-left",
            does = control.does(),
            name = control.name
        )
    }));
    (bindings, warnings)
}
