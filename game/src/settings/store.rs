//! The settings file, which is read once and written after changes; a broken file is kept under another name.

use std::fs;
use std::io::{ErrorKind, Read as _, Write as _};
use std::path::{Path, PathBuf};

use carom_farm::WholeFile;
use carom_text::text;
use etcetera::BaseStrategy as _;
use toml_edit::{DocumentMut, Item, Value};

use super::Settings;
use super::field::{self, FIELDS, SettingsField};
use crate::input::{ACTIONS, Action};
use crate::{Error, SettingFault};

/// Settings and their file.
#[derive(Clone, Debug, Default)]
pub struct SettingsStore {
    /// The present settings.
    pub settings: Settings,
    saved: Settings,
    document: DocumentMut,
    path: Option<PathBuf>,
    warnings: Vec<String>,
    /// Whether the file is not valid TOML: it is moved aside before a new one is written.
    is_broken: bool,
}

impl SettingsStore {
    /// Opens the player's file: `carom/settings.toml` in the platform's configuration folder
    /// (`$XDG_CONFIG_HOME`, `~/.config`, `~/Library/Preferences` or `%APPDATA%`). If the platform
    /// names none, settings are not saved.
    pub fn of_player() -> Self {
        match etcetera::base_strategy::choose_native_strategy() {
            Ok(folders) => Self::open(folders.config_dir().join("carom").join("settings.toml")),
            Err(error) => Self {
                warnings: vec![text!("settings-no-folder", why = error.to_string())],
                ..Self::default()
            },
        }
    }

    /// Opens a file. Missing and invalid settings have their defaults, and [`SettingsStore::warnings`] say
    /// what is invalid.
    pub fn open(path: PathBuf) -> Self {
        let mut store = match read(&path) {
            Ok(text) => Self::from_toml(&text),
            Err(error) if error.kind() == ErrorKind::NotFound => Self::default(),
            Err(error) => {
                let mut store = Self::default();
                store.give_up(error.to_string());
                store
            }
        };
        let name = path.display().to_string();
        for warning in &mut store.warnings {
            *warning = format!("{name}: {warning}");
        }
        store.path = Some(path);
        store
    }

    /// Settings of a file's text, which are not saved. Missing and invalid settings have their defaults, as
    /// in [`SettingsStore::open`].
    pub fn from_toml(text: &str) -> Self {
        let mut store = Self::default();
        store.parse(text);
        store.saved = store.settings.clone();
        store
    }

    /// Text of the file with the settings changed since it was read; all else is as it was.
    pub fn to_toml(&self) -> String {
        self.changed_document().to_string()
    }

    /// Sentences about what is invalid in the file.
    pub fn warnings(&self) -> &[String] {
        &self.warnings
    }

    /// Path of the settings file, if there is one.
    pub fn path(&self) -> Option<&Path> {
        self.path.as_deref()
    }

    /// Changes settings for this run of the program only: they are not written, unless the player
    /// changes them again.
    pub fn with_override(&mut self, change: impl Fn(&mut Settings)) {
        change(&mut self.settings);
        change(&mut self.saved);
    }

    /// Writes the settings changed since the file was read. The file is replaced atomically.
    ///
    /// # Errors
    /// [`Error::Settings`].
    pub fn save(&mut self) -> Result<(), Error> {
        let Some(path) = self.path.clone() else {
            return Ok(());
        };
        if self.settings == self.saved {
            return Ok(());
        }
        let document = self.changed_document();
        let written = self.make_room(&path).and_then(|()| {
            let text = document.to_string();
            WholeFile::replace(&path, |file| file.write_all(text.as_bytes()))
        });
        written.map_err(|source| Error::Settings { path, source })?;
        self.document = document;
        self.saved = self.settings.clone();
        Ok(())
    }

    fn parse(&mut self, text: &str) {
        match text.parse::<DocumentMut>() {
            Ok(document) => self.document = document,
            Err(error) => return self.give_up(error.to_string().trim_end().to_owned()),
        }
        for SettingsField(table, key, _, write) in FIELDS {
            let rows = self.document.get(table);
            let Some(item) = rows.and_then(|rows| rows.get(key)) else {
                continue;
            };
            let written = match item.as_value() {
                Some(value) => write(&mut self.settings, value),
                None => Err(SettingFault::Table),
            };
            if let Err(wanted) = written {
                let shown = item.to_string();
                self.warnings.push(text!(
                    "settings-ignored",
                    table = *table,
                    key = *key,
                    value = shown.trim(),
                    wanted = wanted.to_string()
                ));
            }
        }
        self.parse_keys();
        self.name_unknown();
    }

    fn parse_keys(&mut self) {
        let rows = self.document.get("keys").and_then(Item::as_table_like);
        let mut chosen = Vec::new();
        for control in ACTIONS {
            let row = rows.and_then(|rows| rows.get(control.name));
            let Some(value) = row.and_then(Item::as_value) else {
                continue;
            };
            match field::read_triggers(value) {
                Ok(triggers) => chosen.push((control.action, triggers)),
                Err(why) => self
                    .warnings
                    .push(format!("[keys] {}: {why}", control.name)),
            }
        }
        let (bindings, warnings) = field::bind(&chosen);
        self.settings.bindings = bindings;
        self.warnings.extend(warnings);
    }

    fn name_unknown(&mut self) {
        let mut unknown = Vec::new();
        for (table, item) in self.document.iter() {
            let is_known = |key: &str| match table {
                "keys" => Action::from_name(key).is_some(),
                _ => FIELDS
                    .iter()
                    .any(|field| (field.0, field.1) == (table, key)),
            };
            match item.as_table_like() {
                Some(rows) => {
                    let rows = rows.iter().filter(|(key, _)| !is_known(key));
                    unknown.extend(rows.map(|(key, _)| format!("[{table}] {key}")));
                }
                None => unknown.push(table.to_owned()),
            }
        }
        let said = unknown
            .into_iter()
            .map(|name| text!("settings-unknown", name = name));
        self.warnings.extend(said);
    }

    fn give_up(&mut self, why: String) {
        self.is_broken = true;
        self.warnings.push(text!("settings-broken", why = why));
    }

    /// The document with the settings changed since it was read.
    fn changed_document(&self) -> DocumentMut {
        let mut document = self.document.clone();
        for SettingsField(table, key, read, _) in FIELDS {
            let value = read(&self.settings);
            if value.to_string() != read(&self.saved).to_string() {
                enter(&mut document, table, key, value);
            }
        }
        if self.settings.bindings == self.saved.bindings {
            return document;
        }
        for control in ACTIONS {
            let triggers = |settings: &Settings| settings.bindings.triggers(control.action);
            // A row that differs from the bindings in use, as one that lost a key to another action, is
            // written anew.
            let row = document.get("keys").and_then(|rows| rows.get(control.name));
            let row = row
                .and_then(Item::as_value)
                .map(|row| field::read_triggers(row).ok());
            let is_of_use = row.flatten().is_none_or(|mut chosen| {
                let mut bound = triggers(&self.settings);
                chosen.sort();
                chosen.dedup();
                bound.sort();
                chosen == bound
            });
            if triggers(&self.settings) != triggers(&self.saved) || !is_of_use {
                let value = field::triggers(&self.settings.bindings, control.action);
                enter(&mut document, "keys", control.name, value);
            }
        }
        document
    }

    fn make_room(&mut self, path: &Path) -> std::io::Result<()> {
        if let Some(folder) = path.parent() {
            fs::create_dir_all(folder)?;
        }
        if self.is_broken {
            set_aside(path, "broken")?;
            self.is_broken = false;
        }
        Ok(())
    }
}

fn read(path: &Path) -> std::io::Result<String> {
    let mut text = String::new();
    fs::File::open(path)?
        .take(BYTES_MAX + 1)
        .read_to_string(&mut text)?;
    if text.len() as u64 > BYTES_MAX {
        return Err(std::io::Error::other(text!(
            "settings-too-long",
            bytes = BYTES_MAX
        )));
    }
    Ok(text)
}

/// Sets a value and preserves its comments. If `table` is not a table in the player's file, nothing is
/// changed.
fn enter(document: &mut DocumentMut, table: &str, key: &str, mut value: Value) {
    let fresh = || Item::Table(toml_edit::Table::new());
    let rows = document.entry(table).or_insert_with(fresh);
    let Some(rows) = rows.as_table_like_mut() else {
        return;
    };
    if let Some(old) = rows.get(key).and_then(Item::as_value) {
        *value.decor_mut() = old.decor().clone();
    }
    rows.insert(key, Item::Value(value));
}

/// Renames a file by the reason, such as `settings.broken.toml`, or with the first number that makes such a
/// name free, and returns the new path.
///
/// # Errors
/// Those of the system.
pub(crate) fn set_aside(path: &Path, why: &str) -> std::io::Result<PathBuf> {
    let ending = path.extension().unwrap_or_default().display();
    let name = |number: u32| match number {
        0 => path.with_extension(format!("{why}.{ending}")),
        number => path.with_extension(format!("{why}.{number}.{ending}")),
    };
    let free = (0..1000).map(name).find(|name| !name.exists());
    let free = free.unwrap_or_else(|| name(1000));
    fs::rename(path, &free)?;
    Ok(free)
}

/// Largest size of a settings file in bytes, far more than all settings with comments.
const BYTES_MAX: u64 = 1 << 20;

#[cfg(test)]
mod tests {
    use carom_billiards::physics::{PocketSize, TableOptions, TableSpeed};

    use super::*;
    use crate::camera::Viewpoint;
    use crate::input::{BindingContext, Trigger};
    use crate::scene::ball_materials::BallSet;
    use crate::scene::table_style::{Brightness, ClothColour, CueStyle, TableStyle};

    /// A view whose numbers have few digits in the file.
    fn a_view() -> Viewpoint {
        Viewpoint {
            focus: glam::DVec3::new(0.25, -0.5, 0.0),
            bearing_rad: (-30f64).to_radians(),
            pitch_rad: 20f64.to_radians(),
            distance_m: 1.5,
            fov_x_deg: 44.0,
        }
    }

    fn file(text: &str) -> (tempfile::TempDir, PathBuf) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("carom/settings.toml");
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(&path, text).unwrap();
        (folder, path)
    }

    #[test]
    fn the_first_change_makes_the_file() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("new/settings.toml");
        let mut store = SettingsStore::open(path.clone());
        assert_eq!(store.settings, Settings::default());
        store.save().unwrap();
        assert!(!path.exists(), "nothing to write");
        store.settings.volume = 0.25;
        store.save().unwrap();
        assert_eq!(
            fs::read_to_string(&path).unwrap().trim(),
            "[sound]\nvolume = 0.25"
        );
        assert_eq!(SettingsStore::open(path).settings, store.settings);
    }

    #[test]
    fn every_setting_survives_a_round_trip() {
        let folder = tempfile::tempdir().unwrap();
        let mut store = SettingsStore::open(folder.path().join("settings.toml"));
        let bindings = {
            let mut bindings = store.settings.bindings.clone();
            bindings
                .rebind("F5".parse().unwrap(), Action::Rack)
                .unwrap();
            bindings.unbind(Action::TipUp);
            bindings
        };
        store.settings = Settings {
            window: [900, 700],
            fullscreen: true,
            text_scale: 1.5,
            reduced_motion: true,
            lesson: crate::ui::lessons::Lesson::Suggest,
            aim_aids: crate::play::AimAids::Full,
            style: TableStyle {
                balls: BallSet::Jade,
                cloth: ClothColour::Red,
                cue: CueStyle::Ebony,
                brightness: Brightness::Bright,
                particles: crate::particles::ParticleDetail::All,
            },
            table: TableOptions {
                pockets: PocketSize::Tight,
                speed: TableSpeed::Fast,
            },
            physics: "rapier-240".parse().unwrap(),
            particle_precision: carom_billiards::physics::ParticlePrecision::Fine,
            quality: carom_farm::quality::QualityPreference::Fine,
            resolution: carom_farm::quality::Resolution::Half,
            threads: 3,
            drill_bests: [7, 0, 12],
            volume: 0.0,
            views: [Some(a_view()), None, None, Some(a_view())],
            ball_marks: crate::play::BallMarks::Off,
            mouse: crate::input::MouseSettings {
                speed: 0.4,
                inverts_pitch: true,
            },
            bindings,
        };
        store.save().unwrap();
        let again = SettingsStore::open(folder.path().join("settings.toml"));
        assert_eq!(again.warnings(), [] as [String; 0]);
        assert_eq!(again.settings, store.settings);
    }

    #[test]
    fn wrong_values_are_told_and_kept() {
        let text = "# mine\n[interface]\ntext-scale = 9 # large\nreduced-motion = true\n\n\
                    [sound]\nvolume = 0.5 # not loud\necho = 3\n\n[later]\nx = 1\n";
        let (_folder, path) = file(text);
        let mut store = SettingsStore::open(path.clone());
        assert!(store.settings.reduced_motion && store.settings.text_scale == 1.0);
        let told = store.warnings().join("\n");
        for word in [
            "settings.toml: ignored [interface] text-scale = 9",
            "from 0.75 to 2",
            "unknown setting [sound] echo",
            "unknown setting [later] x",
        ] {
            assert!(told.contains(word), "{word} in {told}");
        }
        store.settings.volume = 0.75;
        store.save().unwrap();
        let kept = fs::read_to_string(path).unwrap();
        assert_eq!(kept, text.replace("volume = 0.5 #", "volume = 0.75 #"));
    }

    #[test]
    fn saved_views_are_lines_and_wrong_ones_are_told() {
        let (_folder, path) = file("[views]\nview-1 = { x = 9 }\nview-2 = 3\n");
        let mut store = SettingsStore::open(path.clone());
        assert_eq!(store.settings.views, [None; 4]);
        let told = store.warnings().join("\n");
        for word in [
            "[views] view-1",
            "view-2 = 3",
            "x from -4 to 4",
            "distance-m from 0.5",
        ] {
            assert!(told.contains(word), "{word} in {told}");
        }
        store.settings.views[0] = Some(a_view());
        store.save().unwrap();
        let text = fs::read_to_string(&path).unwrap();
        let line = "view-1 = { x = 0.25, y = -0.5, bearing-deg = -30.0, pitch-deg = 20.0, \
                    distance-m = 1.5, fov-deg = 44.0 }";
        assert!(text.contains(line), "{text}");
        let mut again = SettingsStore::open(path.clone());
        assert_eq!(again.settings.views, store.settings.views);
        again.settings.views[0] = None;
        again.save().unwrap();
        assert_eq!(SettingsStore::open(path).settings.views, [None; 4]);
    }

    #[test]
    fn a_file_that_is_no_toml_is_kept_beside_the_new_one() {
        let (_folder, path) = file("volume = = 3");
        let mut store = SettingsStore::open(path.clone());
        assert!(store.warnings()[0].contains("cannot be read"));
        store.save().unwrap();
        assert_eq!(fs::read_to_string(&path).unwrap(), "volume = = 3");
        store.settings.volume = 0.1;
        store.save().unwrap();
        let beside = path.with_extension("broken.toml");
        assert_eq!(fs::read_to_string(beside).unwrap(), "volume = = 3");
        assert_eq!(SettingsStore::open(path).settings.volume, 0.1);
    }

    #[test]
    fn a_heading_that_is_no_table_is_told_and_left_alone() {
        let (_folder, path) = file("sound = 3\n");
        let mut store = SettingsStore::open(path.clone());
        assert!(store.warnings()[0].contains("unknown setting sound"));
        store.settings.volume = 0.1;
        store.settings.fullscreen = true;
        store.save().unwrap();
        let kept = fs::read_to_string(path).unwrap();
        assert!(kept.starts_with("sound = 3\n") && kept.contains("fullscreen = true"));
    }

    #[test]
    fn keys_are_rebound_and_conflicts_told() {
        let (_folder, path) =
            file("[keys]\nrack = [\"W\", \"F5\"]\nstats = \"F5\"\nhelp = [\"Hyper\"]\n");
        let store = SettingsStore::open(path);
        let action = |label: &str| {
            let trigger: Trigger = label.parse().unwrap();
            store
                .settings
                .bindings
                .action(trigger, BindingContext::Table)
        };
        assert_eq!(action("W"), Some(Action::Rack));
        assert_eq!(action("F5"), Some(Action::Rack));
        assert_eq!(action("F1"), Some(Action::Help), "the default counts");
        let told = store.warnings().join("\n");
        for word in [
            "F5 is taken",
            "`Hyper` is no key",
            "nothing is left for \"move the tip up",
        ] {
            assert!(told.contains(word), "{word} in {told}");
        }
    }

    #[test]
    fn a_file_that_cannot_be_written_is_told() {
        let folder = tempfile::tempdir().unwrap();
        fs::write(folder.path().join("file"), "").unwrap();
        let mut store = SettingsStore::open(folder.path().join("file/settings.toml"));
        store.settings.volume = 0.1;
        let error = store.save().unwrap_err().to_string();
        assert!(error.contains("file/settings.toml"), "{error}");
    }
}
