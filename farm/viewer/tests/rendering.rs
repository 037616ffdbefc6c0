//! Tests of the renderer with a farm on this machine's CPU: files in, pictures out.

mod dolly;

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use carom_farm::{FarmConfig, LocalNode, NodeStatus};
use carom_tracer::{AreaLight, Camera, ImageSize, Material, Plane, Scene, Sphere};
use carom_view::lights::LightSwitches;
use carom_view::render::{
    Accuracy, FrameCamera, FrameView, News, OpenedScene, Renderer, SaveOrder, SceneLook,
    ShownPicture,
};
use tempfile::TempDir;

const SIZE: ImageSize = ImageSize::new(48, 32);
const SAMPLES: u32 = 32;

/// A renderer and the news that it has reported.
struct Viewing {
    renderer: Renderer,
    folder: TempDir,
    files: u64,
    saves: u64,
}

fn viewing() -> Viewing {
    viewing_by(FarmConfig {
        local: LocalNode::Cpu,
        threads: 1,
        ..FarmConfig::default()
    })
}

fn viewing_by(config: FarmConfig) -> Viewing {
    let accuracy = Accuracy {
        samples: SAMPLES,
        max_depth: 3,
    };
    let renderer = Renderer::start(config, accuracy, || {}).unwrap();
    renderer.want(|wanted| wanted.size = Some(SIZE));
    Viewing {
        renderer,
        folder: tempfile::tempdir().unwrap(),
        files: 0,
        saves: 0,
    }
}

/// A ball on a floor under a sky and a lamp.
fn scene() -> Scene {
    let mut scene = Scene::new()
        .camera(Camera::looking_at([0.0, -4.0, 1.5], [0.0, 0.0, 0.4]))
        .sky([0.2; 3]);
    scene.add(Sphere::new(0.5).at([0.0, 0.0, 0.5]), Material::grey(0.5));
    scene.add(Plane::z(0.0), Material::grey(0.5));
    scene.add_light(
        AreaLight::new(1.0, 1.0)
            .at([0.0, -1.0, 3.0])
            .radiance([4.0; 3]),
    );
    scene
}

impl Viewing {
    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn write(&self, name: &str, scene: &Scene) -> PathBuf {
        let path = self.path(name);
        scene.save(&path).unwrap();
        path
    }

    /// Requests a file, and waits until it is open.
    fn open(&mut self, path: &Path) -> OpenedScene {
        self.ask(path);
        self.until(|news| news.opened.take())
    }

    fn ask(&mut self, path: &Path) {
        self.files += 1;
        let file = Some((self.files, path.to_owned()));
        self.renderer.want(|wanted| wanted.file = file);
    }

    /// Waits for the first news of the wanted kind.
    fn until<T>(&self, wanted: impl Fn(&mut News) -> Option<T>) -> T {
        let deadline = Instant::now() + PATIENCE;
        loop {
            let mut news = self.renderer.take_news();
            if let Some(found) = wanted(&mut news) {
                return found;
            }
            assert!(Instant::now() < deadline, "it did not come; last: {news:?}");
            std::thread::sleep(Duration::from_millis(2));
        }
    }

    /// The next picture of the window's size with all samples.
    fn whole(&self) -> ShownPicture {
        self.until(|news| {
            let picture = news.picture.take()?;
            (!picture.is_draft && picture.samples == SAMPLES).then_some(picture)
        })
    }

    fn look(&self, look: SceneLook) {
        self.renderer.want(|wanted| wanted.look = Some(look));
    }

    fn save(
        &mut self,
        name: &str,
        views: Vec<FrameView>,
        rate: Option<u16>,
    ) -> Result<PathBuf, String> {
        self.order(name, views, rate, 4);
        self.until(|news| news.saved.take())
    }

    fn order(&mut self, name: &str, views: Vec<FrameView>, rate: Option<u16>, samples: u32) {
        self.saves += 1;
        let order = SaveOrder {
            number: self.saves,
            path: self.path(name),
            size: ImageSize::new(24, 16),
            samples,
            exposure: 1.0,
            views: views.into(),
            frames_per_sec: rate,
        };
        self.renderer.want(|wanted| wanted.save = Some(order));
    }
}

/// What a camera sees of a scene without animations.
fn placed(camera: Camera) -> FrameView {
    FrameView {
        camera: FrameCamera::Placed(camera),
        time: None,
    }
}

fn mean(picture: &ShownPicture) -> f64 {
    let values = picture.frame.rgba.iter().flat_map(|pixel| &pixel[..3]);
    values.map(|value| f64::from(*value)).sum::<f64>() / (3 * picture.frame.rgba.len()) as f64
}

#[test]
fn a_scene_is_opened_drafted_gathered_and_looked_at_from_elsewhere() {
    let mut viewing = viewing();
    let path = viewing.write("ball.json", &scene());
    let opened = viewing.open(&path);
    assert_eq!((opened.number, opened.is_reread), (1, false));
    assert_eq!(**opened.file.scene(), scene());
    let whole = viewing.whole();
    assert_eq!(whole.frame.size, SIZE);
    let camera = Camera::looking_at([0.0, -3.0, 8.0], [0.0; 3]);
    viewing.look(SceneLook {
        scene: opened.number,
        camera,
        lights: LightSwitches::of(opened.file.scene()),
        time: None,
    });
    let above = viewing.whole();
    assert!(above.frame.rgba != whole.frame.rgba);
    viewing
        .renderer
        .want(|wanted| wanted.size = Some(ImageSize::new(30, 20)));
    assert_eq!(
        viewing
            .until(|news| { news.picture.take().filter(|picture| !picture.is_draft) })
            .frame
            .size,
        ImageSize::new(30, 20)
    );
}

#[test]
fn exposure_shows_at_once_and_lights_change_what_is_traced() {
    let mut viewing = viewing();
    let path = viewing.write("ball.json", &scene());
    let opened = viewing.open(&path);
    let plain = mean(&viewing.whole());
    viewing.renderer.want(|wanted| wanted.exposure = 2.0);
    assert!(mean(&viewing.whole()) > 1.1 * plain);
    viewing.renderer.want(|wanted| wanted.exposure = 1.0);
    viewing.whole();
    let mut lights = LightSwitches::of(opened.file.scene());
    let look = |lights: &LightSwitches| SceneLook {
        scene: opened.number,
        camera: opened.file.scene().camera,
        lights: lights.clone(),
        time: None,
    };
    lights.toggle(0);
    viewing.look(look(&lights));
    let without_sky = mean(&viewing.whole());
    assert!(without_sky < 0.9 * plain, "{without_sky} of {plain}");
    lights.toggle(1);
    viewing.look(look(&lights));
    viewing.until(|news| news.is_cleared.then_some(()));
    lights.toggle(0);
    lights.toggle(1);
    viewing.look(look(&lights));
    let again = mean(&viewing.whole());
    assert!((again - plain).abs() < 0.02 * plain, "{again} of {plain}");
}

#[test]
fn meshes_are_opened_and_bad_files_are_refused_while_the_scene_stays() {
    let mut viewing = viewing();
    let good = viewing.path("wing.obj");
    std::fs::write(&good, "v 0 0 0\nv 2 0 0\nv 0 1 0\nf 1 2 3\n").unwrap();
    let opened = viewing.open(&good);
    assert_eq!(opened.file.scene().objects[0].name, "wing");
    viewing.whole();
    for (name, text, reason) in [
        ("bad.obj", "v 0 zero 0\n", "line 1"),
        ("bad.json", "{", "line 1"),
        ("bad.fbx", "", ".json, .gltf, .glb, .obj, .ply"),
    ] {
        let path = viewing.path(name);
        std::fs::write(&path, text).unwrap();
        viewing.ask(&path);
        let why = viewing.until(|news| news.refused.take());
        assert!(why.contains(name) && why.contains(reason), "{why}");
    }
    viewing.ask(&viewing.path("none.json"));
    let why = viewing.until(|news| news.refused.take());
    assert!(why.contains("none.json"), "{why}");
    // Still there.
    viewing.renderer.want(|wanted| wanted.exposure = 0.5);
    viewing.whole();
}

#[test]
fn a_file_that_changes_is_read_again_and_seen_as_before() {
    let mut viewing = viewing();
    let path = viewing.write("ball.json", &scene());
    let opened = viewing.open(&path);
    let camera = Camera::looking_at([0.0, -5.0, 4.0], [0.0; 3]);
    let mut lights = LightSwitches::of(opened.file.scene());
    lights.toggle(0);
    viewing.look(SceneLook {
        scene: opened.number,
        camera,
        lights,
        time: None,
    });
    let before = viewing.whole();
    let mut more = scene();
    more.add(Sphere::new(0.5).at([1.2, 0.0, 0.5]), Material::grey(0.9));
    viewing.write("ball.json", &more);
    let again = viewing.until(|news| news.opened.take());
    assert_eq!((again.number, again.is_reread), (2, true));
    assert_eq!(again.file.scene().objects.len(), 3);
    // With the same camera and lights, although they have not been set since.
    let after = viewing.whole();
    let differing = before.frame.rgba.iter().zip(&after.frame.rgba);
    let differing = differing.filter(|(a, b)| a[0].abs_diff(b[0]) > 24).count();
    let pixels = before.frame.rgba.len();
    assert!(
        (pixels / 200..pixels / 3).contains(&differing),
        "{differing} of {pixels}"
    );
    // Also on request.
    viewing.ask(&path);
    assert!(viewing.until(|news| news.opened.take()).is_reread);
}

#[test]
fn stills_and_turntables_are_saved_as_their_names_say() {
    let mut viewing = viewing();
    let path = viewing.write("ball.json", &scene());
    viewing.open(&path);
    viewing.whole();
    let camera = placed(scene().camera);
    for (name, magic) in [
        ("a.png", &b"\x89PNG"[..]),
        ("a.jpg", b"\xff\xd8"),
        ("a.exr", b"\x76\x2f\x31\x01"),
    ] {
        let saved = viewing.save(name, vec![camera], None).unwrap();
        assert_eq!(saved, viewing.path(name));
        assert!(std::fs::read(saved).unwrap().starts_with(magic), "{name}");
    }
    for (name, mark) in [("turn.png", &b"acTL"[..]), ("turn.y4m", b"YUV4MPEG2")] {
        let saved = viewing.save(name, vec![camera; 3], Some(24)).unwrap();
        let bytes = std::fs::read(saved).unwrap();
        assert!(bytes.windows(mark.len()).any(|part| part == mark), "{name}");
    }
    let names = std::fs::read_dir(viewing.folder.path()).unwrap().count();
    assert_eq!(names, 6, "frames and partial files are gone");
    let why = viewing.save("a.gif", vec![camera], None).unwrap_err();
    assert!(why.contains("a.gif") && why.contains(".png"), "{why}");
    let why = viewing
        .save("turn.jpg", vec![camera; 2], Some(24))
        .unwrap_err();
    assert!(why.contains("turn.jpg"), "{why}");
    let why = viewing
        .save("nowhere/a.png", vec![camera], None)
        .unwrap_err();
    assert!(why.contains("nowhere"), "{why}");
}

/// The columns of a luma plane that contain a dark pixel.
fn dark_columns(luma: &[u8], width: usize) -> Vec<usize> {
    let columns = 0..width;
    let is_dark = |x: &usize| luma.iter().skip(*x).step_by(width).any(|value| *value < 90);
    columns.filter(is_dark).collect()
}

/// The columns of the square in each frame of a film.
fn squares(film: &Path) -> Vec<Vec<usize>> {
    let bytes = std::fs::read(film).unwrap();
    let header = bytes.iter().position(|byte| *byte == b'\n').unwrap() + 1;
    let (width, height) = (24, 16);
    let frames = bytes[header..].chunks_exact(b"FRAME\n".len() + 3 * width * height);
    let lumas = frames.map(|frame| &frame[b"FRAME\n".len()..][..width * height]);
    lumas.map(|luma| dark_columns(luma, width)).collect()
}

#[test]
fn an_animation_is_saved_as_its_frames_look() {
    let mut viewing = viewing();
    viewing.open(&dolly::write(viewing.folder.path()));
    viewing.whole();
    let frames = |animation: usize, secs: &[f64], camera| {
        let view = |secs: &f64| FrameView {
            camera,
            time: Some((animation, *secs)),
        };
        secs.iter().map(view).collect::<Vec<_>>()
    };
    // The camera moves to the right, so the square moves to the left.
    let ride = frames(0, &[0.0, 1.0, 2.0], FrameCamera::OfFile(0));
    let saved = viewing.save("ride.y4m", ride, Some(24)).unwrap();
    let squares_of_ride = squares(&saved);
    let lefts: Vec<usize> = squares_of_ride.iter().map(|square| square[0]).collect();
    assert!(lefts.is_sorted_by(|a, b| a > b), "{squares_of_ride:?}");
    let is_as_wide = |square: &Vec<usize>| square.len().abs_diff(squares_of_ride[0].len()) <= 1;
    assert!(squares_of_ride.iter().all(is_as_wide));
    // A fixed camera shows that nothing else moves.
    let opened = scene_of(&viewing);
    let stand = frames(0, &[0.0, 1.0, 2.0], FrameCamera::Placed(opened));
    let saved = viewing.save("stand.y4m", stand, Some(24)).unwrap();
    assert!(
        squares(&saved)
            .iter()
            .all(|square| *square == squares_of_ride[0])
    );
    // A deformed mesh is another scene in each frame.
    let growth = frames(1, &[0.0, 2.5, 5.0], FrameCamera::OfFile(1));
    let saved = viewing.save("growth.y4m", growth, Some(24)).unwrap();
    let widths: Vec<usize> = squares(&saved).iter().map(Vec::len).collect();
    assert!(widths.is_sorted_by(|a, b| a < b), "{widths:?}");
    // A still at the same time equals that frame.
    let still = frames(0, &[1.0], FrameCamera::OfFile(0));
    let saved = viewing.save("still.png", still, None).unwrap();
    let file = std::io::BufReader::new(std::fs::File::open(saved).unwrap());
    let mut reader = png::Decoder::new(file).read_info().unwrap();
    let mut rgb = vec![0; reader.output_buffer_size().unwrap()];
    reader.next_frame(&mut rgb).unwrap();
    let green: Vec<u8> = rgb.chunks_exact(3).map(|pixel| pixel[1]).collect();
    assert_eq!(dark_columns(&green, 24), squares_of_ride[1]);
    let wrong = frames(7, &[1.0], FrameCamera::OfFile(0));
    for (name, rate) in [("wrong.png", None), ("wrong.y4m", Some(24))] {
        let why = viewing.save(name, wrong.clone(), rate).unwrap_err();
        assert!(why.contains("no animation 7"), "{why}");
    }
    let wrong = frames(0, &[1.0], FrameCamera::OfFile(2));
    let why = viewing.save("wrong.png", wrong, None).unwrap_err();
    assert!(why.contains("no camera 2"), "{why}");
}

/// The first camera of the file that [`dolly::write`] wrote, at rest.
fn scene_of(viewing: &Viewing) -> Camera {
    let path = viewing.path("dolly.gltf");
    let file = carom_farm::SceneFile::open(path).unwrap();
    file.camera(0, None).unwrap()
}

#[test]
fn an_animation_that_is_stopped_goes_on_under_the_same_name() {
    let mut viewing = viewing();
    viewing.open(&dolly::write(viewing.folder.path()));
    viewing.whole();
    let view = |frame: u32| FrameView {
        camera: FrameCamera::OfFile(0),
        time: Some((1, f64::from(frame) / 24.0)),
    };
    let views: Vec<FrameView> = (0..60).map(view).collect();
    viewing.order("growth.png", views.clone(), Some(24), 512);
    viewing.until(|news| news.saving.filter(|done| *done > 1.5 / 60.0));
    // Meanwhile the live view still works.
    viewing.renderer.want(|wanted| wanted.exposure = 0.5);
    viewing.until(|news| news.picture.take());
    viewing.renderer.want(|wanted| wanted.cancelled_save = 1);
    let why = viewing.until(|news| news.saved.take()).unwrap_err();
    assert!(why.contains("of 60 frames"), "{why}");
    assert!(!viewing.path("growth.png").exists());
    let first = viewing.path("growth.png.frames").join("frame_0000.png");
    let written = std::fs::metadata(&first).unwrap().modified().unwrap();
    // Another number of samples makes another film, which does not replace the first.
    let why = viewing
        .save("growth.png", views.clone(), Some(24))
        .unwrap_err();
    assert!(why.contains("unfinished film"), "{why}");
    viewing.order("growth.png", views, Some(24), 512);
    let begun = viewing.until(|news| news.saving.filter(|done| *done > 0.0));
    assert!(begun > 1.0 / 60.0, "{begun}");
    assert_eq!(
        std::fs::metadata(&first).unwrap().modified().unwrap(),
        written
    );
    viewing.until(|news| news.saved.take()).unwrap();
    assert!(!viewing.path("growth.png.frames").exists());
}

#[test]
fn a_long_save_tells_how_far_it_is_and_can_be_cancelled() {
    let mut viewing = viewing();
    let path = viewing.write("ball.json", &scene());
    viewing.open(&path);
    viewing.whole();
    let many = 1 << 16;
    viewing.order("a.png", vec![placed(scene().camera)], None, many);
    viewing.until(|news| news.saving.filter(|done| *done > 0.0));
    // Meanwhile the live view still works.
    viewing.renderer.want(|wanted| wanted.exposure = 0.5);
    viewing.until(|news| news.picture.take());
    viewing.renderer.want(|wanted| wanted.cancelled_save = 1);
    let why = viewing.until(|news| news.saved.take()).unwrap_err();
    assert_eq!(why, "it was cancelled");
    assert!(!viewing.path("a.png").exists());
    viewing.order(
        "turn.png",
        vec![placed(scene().camera); 500],
        Some(24),
        4096,
    );
    viewing.until(|news| news.saving.filter(|done| *done > 0.0));
    viewing.renderer.want(|wanted| wanted.cancelled_save = 2);
    let why = viewing.until(|news| news.saved.take()).unwrap_err();
    assert!(why.contains("of 500 frames"), "{why}");
    // The next one is not.
    assert!(
        viewing
            .save("b.png", vec![placed(scene().camera)], None)
            .is_ok()
    );
}

#[test]
fn nodes_frames_and_quality_are_told_of() {
    let mut viewing = viewing();
    viewing.renderer.want(|wanted| wanted.has_statistics = true);
    let path = viewing.write("ball.json", &scene());
    viewing.open(&path);
    let frame = viewing.until(|news| news.frames.pop());
    assert!(frame.stats.makespan_secs > 0.0);
    let is_ready = |nodes: &Vec<NodeStatus>| nodes.iter().any(|node| node.state.is_ready());
    viewing.until(|news| news.nodes.take().filter(is_ready));
    viewing.until(|news| news.quality.take());
}

#[test]
fn a_farm_that_nobody_traces_for_says_so() {
    let mut viewing = viewing_by(FarmConfig {
        local: LocalNode::None,
        timeout_secs: Some(1),
        ..FarmConfig::default()
    });
    let path = viewing.write("ball.json", &scene());
    viewing.open(&path);
    let why = viewing.until(|news| news.fault.take().filter(|why| !why.is_empty()));
    assert!(why.contains("node"), "{why}");
}

#[test]
fn a_configuration_that_cannot_be_used_is_told_and_closing_does_not_wait() {
    let viewing = viewing_by(FarmConfig {
        nodes: vec!["nobody.invalid:1".to_owned()],
        credentials: PathBuf::from("no/such/folder"),
        ..FarmConfig::default()
    });
    let why = viewing.until(|news| news.fault.take().filter(|why| !why.is_empty()));
    assert!(why.contains("no/such/folder"), "{why}");
}

/// Generous, since the machine may be busy with other tests.
const PATIENCE: Duration = Duration::from_secs(120);
