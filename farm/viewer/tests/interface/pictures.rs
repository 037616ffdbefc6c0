//! Pictures of the viewer's panels.

use std::path::{Path, PathBuf};

use carom_view::viewer::Viewer;

use crate::looks::{Gpu, Look};
use crate::stage::{opened, opened_dolly, viewer};

/// Name of a picture, and the actions that lead to it.
type Situation = (&'static str, fn(&mut Viewer));

const SITUATIONS: [Situation; 6] = [
    ("empty", |_| {}),
    ("open", |viewer| open(viewer)),
    ("animated", |viewer| {
        let folder = tempfile::tempdir().unwrap();
        let dolly = opened_dolly(folder.path());
        viewer.renderer().post(|news| news.opened = Some(dolly));
    }),
    ("saving", |viewer| {
        open(viewer);
        viewer.renderer().post(|news| news.saving = Some(0.35));
    }),
    ("refused", |viewer| {
        open(viewer);
        viewer.renderer().post(|news| {
            let why = "models/duck.obj: line 3: the position [1, NaN, 0] is not finite";
            news.refused = Some(why.to_owned());
        });
    }),
    ("fault", |viewer| {
        open(viewer);
        viewer
            .renderer()
            .post(|news| news.fault = Some("no node has answered for 10 s".to_owned()));
    }),
];

#[test]
fn panels_look_as_they_did() {
    let gpu = Gpu::open();
    let mut differing = Vec::new();
    for size in [(1280, 720), (640, 360)] {
        for (name, happen) in SITUATIONS {
            let mut viewer = viewer(Path::new(""));
            happen(&mut viewer);
            let look = Look::new(size, 1.0, |ui, pass| {
                viewer.draw(ui, 0.1 * f64::from(pass), "a test");
            });
            let path = folder_of_pictures().join(format!("{name}_{}x{}.png", size.0, size.1));
            differing.extend(look.differences(&path, gpu.as_ref()));
        }
    }
    assert!(differing.is_empty(), "{}", differing.join("\n"));
}

fn open(viewer: &mut Viewer) {
    viewer
        .renderer()
        .post(|news| news.opened = Some(opened(1, "hall.json", false)));
}

fn folder_of_pictures() -> PathBuf {
    PathBuf::from(concat!(
        env!("CARGO_MANIFEST_DIR"),
        "/tests/interface/pictures"
    ))
}
