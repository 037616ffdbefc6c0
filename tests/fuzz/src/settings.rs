//! The settings file of the game.

use carom::settings::{Settings, SettingsStore};

/// Any text gives settings that can be written, and then read as they were. What is changed afterwards is read as it
/// was changed, whatever else is in the file.
pub fn settings(bytes: &[u8]) {
    let Ok(text) = str::from_utf8(bytes) else {
        return;
    };
    let mut store = SettingsStore::from_toml(text);
    let mut fresh = SettingsStore::default();
    fresh.settings = store.settings.clone();
    let written = fresh.to_toml();
    fresh.settings = SettingsStore::from_toml(&written).settings;
    // As texts: parts of a view are rounded once.
    assert_eq!(fresh.to_toml(), written);
    store.settings = Settings::default();
    let reset = SettingsStore::from_toml(&store.to_toml());
    assert_eq!(reset.settings, Settings::default());
}

/// Files as players have them: of one line, of many settings, and of wrong ones.
pub fn settings_seeds() -> Vec<Vec<u8>> {
    [ONE_LINE, ALL, WRONG]
        .map(|text| text.as_bytes().to_vec())
        .into()
}

const ONE_LINE: &str = "[sound]\nvolume = 0.25\n";
const ALL: &str = r##"# mine
[window]
width = 900
height = 700
fullscreen = true

[interface]
text-scale = 1.5 # large
reduced-motion = true
lesson = "suggest"

[game]
aim-aids = "full"
cloth = "red"
ball-set = "jade"
cue = "ebony"
pockets = "tight"
table-speed = "fast"
physics = "rapier-240"
particle-precision = "fine"
ball-marks = "off"

[controls]
mouse-speed = 0.4
invert-pitch = true

[picture]
quality = "fine"
resolution = "half"
threads = 3
brightness = "bright"
particles = "all"

[drills]
line-up = 7
position-play = 12

[views]
view-1 = { x = 0.25, y = -0.5, bearing-deg = -30.0, pitch-deg = 20.0, distance-m = 1.5, fov-deg = 44.0 }
view-2 = {}

[keys]
rack = ["R", "F5"]
practise = []
zoom-in = ["Wheel down", "Page up"]
zoom-out = ["Wheel up", "Page down"]
fine = "Left Shift"
"##;
const WRONG: &str = r#"sound = 3
[interface]
text-scale = 9
[views]
view-1 = { x = 9 }
[keys]
rack = ["R", "F4"]
look-back = ["F4"]
aim-left = ["Wheel up", "Left"]
aim-right = "no key"
help = 3
[later]
x = 1
"#;
