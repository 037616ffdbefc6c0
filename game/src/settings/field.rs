//! Names of the settings in the file, and their reading and writing.

use carom_billiards::physics::Engine;
use carom_text::text;
use clap::ValueEnum;
use glam::DVec3;
use toml_edit::{Array, InlineTable, Value};

use super::Settings;
use crate::camera::{Viewpoint, wrap_rad};
use crate::input::{ACTIONS, Action, Bindings, MouseSettings, Trigger};
use crate::{KeysFault, SettingFault};

/// Field of the settings file: table, key, function that gives the value to write, and function that reads
/// a value or returns what it must be.
pub(super) struct SettingsField(
    pub(super) &'static str,
    pub(super) &'static str,
    pub(super) fn(&Settings) -> Value,
    pub(super) fn(&mut Settings, &Value) -> Result<(), SettingFault>,
);

/// All settings except bindings.
#[rustfmt::skip]
pub(super) const FIELDS: &[SettingsField] = &[
    SettingsField("window", "width", |s| i64::from(s.window[0]).into(), |s, v| whole(v, Settings::WINDOW_EDGE).map(|w| s.window[0] = w)),
    SettingsField("window", "height", |s| i64::from(s.window[1]).into(), |s, v| whole(v, Settings::WINDOW_EDGE).map(|h| s.window[1] = h)),
    SettingsField("window", "fullscreen", |s| s.fullscreen.into(), |s, v| switch(v).map(|on| s.fullscreen = on)),
    SettingsField("interface", "text-scale", |s| s.text_scale.into(), |s, v| number(v, Settings::TEXT_SCALE).map(|x| s.text_scale = x)),
    SettingsField("interface", "reduced-motion", |s| s.reduced_motion.into(), |s, v| switch(v).map(|on| s.reduced_motion = on)),
    SettingsField("interface", "lesson", |s| value_name(&s.lesson).into(), |s, v| choice(v).map(|x| s.lesson = x)),
    SettingsField("game", "aim-aids", |s| value_name(&s.aim_aids).into(), |s, v| choice(v).map(|x| s.aim_aids = x)),
    SettingsField("game", "cloth", |s| value_name(&s.style.cloth).into(), |s, v| choice(v).map(|x| s.style.cloth = x)),
    SettingsField("game", "ball-set", |s| value_name(&s.style.balls).into(), |s, v| choice(v).map(|x| s.style.balls = x)),
    SettingsField("game", "cue", |s| value_name(&s.style.cue).into(), |s, v| choice(v).map(|x| s.style.cue = x)),
    SettingsField("game", "pockets", |s| value_name(&s.table.pockets).into(), |s, v| choice(v).map(|x| s.table.pockets = x)),
    SettingsField("game", "table-speed", |s| value_name(&s.table.speed).into(), |s, v| choice(v).map(|x| s.table.speed = x)),
    SettingsField("game", "physics", |s| s.physics.to_string().into(), |s, v| engine(v).map(|x| s.physics = x)),
    SettingsField("game", "particle-precision", |s| value_name(&s.particle_precision).into(), |s, v| choice(v).map(|x| s.particle_precision = x)),
    SettingsField("game", "ball-marks", |s| value_name(&s.ball_marks).into(), |s, v| choice(v).map(|x| s.ball_marks = x)),
    SettingsField("controls", "mouse-speed", |s| s.mouse.speed.into(), |s, v| number(v, MouseSettings::SPEED).map(|x| s.mouse.speed = x)),
    SettingsField("controls", "invert-pitch", |s| s.mouse.inverts_pitch.into(), |s, v| switch(v).map(|on| s.mouse.inverts_pitch = on)),
    SettingsField("picture", "quality", |s| value_name(&s.quality).into(), |s, v| choice(v).map(|x| s.quality = x)),
    SettingsField("picture", "resolution", |s| value_name(&s.resolution).into(), |s, v| choice(v).map(|x| s.resolution = x)),
    SettingsField("picture", "threads", |s| i64::from(s.threads).into(), |s, v| whole(v, [0, Settings::THREADS_MAX.into()]).map(|n| s.threads = n as u16)),
    SettingsField("picture", "brightness", |s| value_name(&s.style.brightness).into(), |s, v| choice(v).map(|x| s.style.brightness = x)),
    SettingsField("picture", "particles", |s| value_name(&s.style.particles).into(), |s, v| choice(v).map(|x| s.style.particles = x)),
    SettingsField("drills", "line-up", |s| i64::from(s.drill_bests[0]).into(), |s, v| whole(v, [0, POINTS_MAX]).map(|n| s.drill_bests[0] = n)),
    SettingsField("drills", "spot-shots", |s| i64::from(s.drill_bests[1]).into(), |s, v| whole(v, [0, POINTS_MAX]).map(|n| s.drill_bests[1] = n)),
    SettingsField("drills", "position-play", |s| i64::from(s.drill_bests[2]).into(), |s, v| whole(v, [0, POINTS_MAX]).map(|n| s.drill_bests[2] = n)),
    SettingsField("views", "view-1", |s| view(s.views[0]), |s, v| seen(v).map(|at| s.views[0] = at)),
    SettingsField("views", "view-2", |s| view(s.views[1]), |s, v| seen(v).map(|at| s.views[1] = at)),
    SettingsField("views", "view-3", |s| view(s.views[2]), |s, v| seen(v).map(|at| s.views[2] = at)),
    SettingsField("views", "view-4", |s| view(s.views[3]), |s, v| seen(v).map(|at| s.views[3] = at)),
    SettingsField("sound", "volume", |s| s.volume.into(), |s, v| number(v, [0.0, 1.0]).map(|x| s.volume = x)),
];

fn whole(value: &Value, [min, max]: [u32; 2]) -> Result<u32, SettingFault> {
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

/// Name of a choice in files, on the command line and in the identifiers of its texts.
pub(crate) fn value_name(choice: &impl ValueEnum) -> String {
    let value = choice.to_possible_value();
    value.map_or(String::new(), |value| value.get_name().to_owned())
}

fn choice<T: ValueEnum>(value: &Value) -> Result<T, SettingFault> {
    let chosen = value.as_str().and_then(|word| T::from_str(word, true).ok());
    chosen.ok_or_else(|| {
        let names = T::value_variants().iter().map(value_name).collect();
        SettingFault::Choice { names }
    })
}

fn engine(value: &Value) -> Result<Engine, SettingFault> {
    let engine = value.as_str().and_then(|word| word.parse().ok());
    engine.ok_or(SettingFault::Engine)
}

/// Value of a saved view, with parts rounded to four decimals; no view is `{}`.
fn view(at: Option<Viewpoint>) -> Value {
    let parts = at.map(|at| {
        [
            at.focus.x,
            at.focus.y,
            wrap_rad(at.bearing_rad).to_degrees(),
            at.pitch_rad.to_degrees(),
            at.distance_m,
            at.fov_x_deg,
        ]
    });
    let mut rows = InlineTable::new();
    for ((key, _), part) in VIEW_PARTS.iter().zip(parts.into_iter().flatten()) {
        let rounded = (part * VIEW_DIGITS).round() / VIEW_DIGITS;
        rows.insert(*key, rounded.into());
    }
    Value::InlineTable(rows)
}

fn seen(value: &Value) -> Result<Option<Viewpoint>, SettingFault> {
    let rows = value.as_inline_table().ok_or_else(no_view)?;
    if rows.is_empty() {
        return Ok(None);
    }
    let mut parts = [0.0; VIEW_PARTS.len()];
    for (part, (key, range)) in parts.iter_mut().zip(VIEW_PARTS) {
        let value = rows.get(key).ok_or_else(no_view)?;
        *part = number(value, range).map_err(|_| no_view())?;
    }
    let [x, y, bearing_deg, pitch_deg, distance_m, fov_x_deg] = parts;
    Ok(Some(Viewpoint {
        focus: DVec3::new(x, y, 0.0),
        bearing_rad: bearing_deg.to_radians(),
        pitch_rad: pitch_deg.to_radians(),
        distance_m,
        fov_x_deg,
    }))
}

fn no_view() -> SettingFault {
    let part = |(key, [min, max]): &(&str, [f64; 2])| format!("{key} from {min} to {max}");
    let parts = VIEW_PARTS.iter().map(part).collect();
    SettingFault::View { parts }
}

/// Parts of a saved view, with ranges that contain all views and rotations of them.
const VIEW_PARTS: [(&str, [f64; 2]); 6] = [
    ("x", [-4.0, 4.0]),
    ("y", [-4.0, 4.0]),
    ("bearing-deg", [-180.0, 180.0]),
    ("pitch-deg", [1.0, 90.0]),
    ("distance-m", [0.5, 10.0]),
    ("fov-deg", [5.0, 160.0]),
];
/// Largest score of a drill, above any real one.
const POINTS_MAX: u32 = 10_000;
const VIEW_DIGITS: f64 = 1e4;

/// Value of an action's triggers.
pub(super) fn triggers(bindings: &Bindings, action: Action) -> Value {
    let labels = bindings.triggers(action).into_iter();
    Value::Array(labels.map(|trigger| trigger.to_string()).collect::<Array>())
}

/// Reads an action's triggers from a string or an array of strings.
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

/// Bindings of the player's choices and, for other actions, of the remaining defaults; and warnings about
/// those that could not be bound.
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
            // A default trigger that the player has bound to another action is left out on purpose.
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
