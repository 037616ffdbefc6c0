//! A viewer without a window and without a farm.

use std::path::Path;

use crate::dolly;
use carom_farm::SceneFile;
use carom_tracer::{AreaLight, Camera, ImageSize, Material, Scene, Sphere};
use carom_view::lights::LightSwitches;
use carom_view::render::{News, OpenedScene, Renderer, ShownPicture, Wanted};
use carom_view::viewer::Viewer;
use carom_window::display::DisplayFrame;
use carom_window::theme;
use egui::accesskit::Role;
use egui_kittest::Harness;
use egui_kittest::kittest::NodeT as _;
use tempfile::TempDir;

pub(crate) struct Stage {
    pub(crate) harness: Harness<'static, Play>,
    pub(crate) folder: TempDir,
}

pub(crate) struct Play {
    pub(crate) viewer: Viewer,
    now_secs: f64,
}

const SIZE: ImageSize = ImageSize::new(1280, 720);

/// A ball under a sky and two lamps.
pub(crate) fn scene() -> Scene {
    let mut scene = Scene::new().camera(Camera::looking_at([0.0, -4.0, 1.0], [0.0; 3]));
    scene.add(Sphere::new(0.5), Material::grey(0.5));
    for (name, x) in [("ceiling", 0.0), ("window", 2.0)] {
        let lamp = AreaLight::new(1.0, 1.0).at([x, 0.0, 3.0]);
        scene.add_light(AreaLight {
            name: name.to_owned(),
            ..lamp
        });
    }
    scene
}

pub(crate) fn opened(number: u64, path: &str, is_reread: bool) -> OpenedScene {
    let folder = tempfile::tempdir().unwrap();
    let saved = folder.path().join("scene.json");
    scene().save(&saved).unwrap();
    OpenedScene {
        number,
        path: path.into(),
        file: SceneFile::open(saved).unwrap(),
        is_reread,
    }
}

pub(crate) fn viewer(folder: &Path) -> Viewer {
    let mut viewer = Viewer::new(Renderer::without_farm(), 64, folder);
    viewer.resize(SIZE);
    viewer
}

pub(crate) fn stage() -> Stage {
    let folder = tempfile::tempdir().unwrap();
    let play = Play {
        viewer: viewer(folder.path()),
        now_secs: 0.0,
    };
    let mut harness = Harness::builder()
        .with_size(egui::vec2(SIZE.width as f32, SIZE.height as f32))
        .with_step_dt(0.1)
        .with_context_setup(|ctx| theme::apply(ctx, 1.0, true))
        .build_ui_state(
            |ui, play: &mut Play| {
                play.now_secs += 0.1;
                play.viewer.draw(ui, play.now_secs, "a test");
            },
            play,
        );
    harness.run_steps(4);
    Stage { harness, folder }
}

pub(crate) fn with_scene() -> Stage {
    let mut stage = stage();
    stage.post(|news| news.opened = Some(opened(1, "hall.json", false)));
    stage
}

/// The file that [`dolly::write`] writes, read.
pub(crate) fn opened_dolly(folder: &Path) -> OpenedScene {
    let path = dolly::write(folder);
    OpenedScene {
        number: 1,
        file: SceneFile::open(&path).unwrap(),
        path,
        is_reread: false,
    }
}

pub(crate) fn with_dolly() -> Stage {
    let mut stage = stage();
    let dolly = opened_dolly(stage.folder.path());
    stage.post(|news| news.opened = Some(dolly));
    stage
}

impl Stage {
    pub(crate) fn viewer(&mut self) -> &mut Viewer {
        &mut self.harness.state_mut().viewer
    }

    /// Plays the renderer's part.
    pub(crate) fn post(&mut self, add: impl FnOnce(&mut News)) {
        self.harness.state().viewer.renderer().post(add);
        self.harness.run_steps(3);
    }

    /// Shows a picture with this number of samples.
    pub(crate) fn picture(&mut self, samples: u32, is_draft: bool) {
        let frame = DisplayFrame {
            serial: samples.into(),
            size: ImageSize::new(2, 1),
            rgba: vec![[0, 0, 0, 255]; 2],
            update: Default::default(),
        };
        self.post(|news| {
            news.picture = Some(ShownPicture {
                frame,
                samples,
                is_draft,
            });
        });
    }

    pub(crate) fn wanted(&self) -> Wanted {
        self.harness.state().viewer.renderer().wanted()
    }

    pub(crate) fn camera(&self) -> Camera {
        self.wanted().look.expect("a scene is open").camera
    }

    pub(crate) fn lights(&self) -> LightSwitches {
        self.wanted().look.expect("a scene is open").lights
    }

    pub(crate) fn size(&self) -> ImageSize {
        SIZE
    }

    /// All texts on the screen.
    pub(crate) fn texts(&self) -> Vec<String> {
        let nodes = self.harness.root().children_recursive();
        let words = |node: egui_kittest::Node<'_>| {
            let node = node.accesskit_node();
            let is_text = node.role() != Role::TextInput;
            let words = node.label().or_else(|| node.value()).filter(|_| is_text);
            words.unwrap_or_default()
        };
        nodes.map(words).filter(|text| !text.is_empty()).collect()
    }

    pub(crate) fn has(&self, part: &str) -> bool {
        self.texts().iter().any(|text| text.contains(part))
    }
}
