use carom_tracer::film::trace_image;
use carom_tracer::metrics::{flip, rel_mse};
use carom_tracer::scalar::{Ray, camera_ray, intersect};
use carom_tracer::tonemap::srgb8;
use carom_tracer::{CompiledScene, CpuTracer, ImageSize, RadianceImage, RenderSettings};
use clap::ValueEnum as _;
use glam::DVec3;

use super::*;
use crate::camera::{Framing, Viewpoint};
use crate::scene::ball_materials::BallSet;
use crate::scene::cue_stick::CUE_NAME;
use crate::scene::table_style::{Brightness, CueStyle};

fn nine_foot() -> (Table, CompiledScene) {
    let table = Table::nine_foot();
    let mut scene = room(&table, RuleSet::Free, BallSet::Classic.into());
    scene
        .objects
        .retain(|object| !object.name.starts_with("ball") && object.name != CUE_NAME);
    let scene = CompiledScene::new(&scene).unwrap();
    (table, scene)
}

/// The first intersection of a ray with the room.
fn met(scene: &CompiledScene, origin: DVec3, direction: DVec3) -> DVec3 {
    let direction = direction.normalize();
    intersect(scene, &Ray { origin, direction }).unwrap().point
}

#[test]
fn every_set_of_balls_makes_a_scene_with_sixteen() {
    for set in BallSet::ALL {
        let scene = room(&Table::nine_foot(), RuleSet::Free, set.into());
        scene.validate().unwrap();
        let balls = scene.objects.iter().filter(|o| o.name.starts_with("ball"));
        assert_eq!(balls.count(), 16, "{set:?}");
    }
}

#[test]
fn cushions_stand_where_balls_meet_them() {
    let (table, scene) = nine_foot();
    let height = table.nose_height_m();
    for cushion in table.cushions() {
        let nose = &table.noses()[cushion.nose];
        let middle = 0.5 * (nose.from() + nose.to());
        // Where the simulation has a ball meet the nose line, it touches the round nose.
        let radius = table.ball().radius_m;
        let away = (radius * radius - (height - radius).powi(2)).sqrt();
        let center = (middle + away * nose.normal()).extend(radius);
        let distance = |angle: f64| {
            let direction = -angle.cos() * nose.normal().extend(0.0) + angle.sin() * DVec3::Z;
            met(&scene, center, direction).distance(center)
        };
        let nearest = (0..100).map(|step| distance(0.003 * f64::from(step)));
        let nearest = nearest.fold(f64::INFINITY, f64::min);
        assert!((nearest - radius).abs() < 1e-6, "{nearest}");
        // Under the nose the cushion draws back.
        let low = (middle + 0.3 * nose.normal()).extend(0.005);
        let depth = (middle - met(&scene, low, -nose.normal().extend(0.0)).truncate()).length();
        assert!((0.005..0.02).contains(&depth), "{depth}");
    }
}

#[test]
fn jaws_are_round_where_balls_meet_them() {
    for table in [
        Table::nine_foot(),
        Table::parse(include_str!("../../../../assets/tables/snooker.json")).unwrap(),
    ] {
        let scene = room(&table, RuleSet::Free, BallSet::Classic.into());
        let scene = CompiledScene::new(&scene).unwrap();
        let height = table.nose_height_m();
        let mut met_jaws = 0;
        for cushion in table.cushions() {
            for (tip, jaw) in cushion.corners.into_iter().zip(cushion.jaws) {
                let Some(jaw) = jaw else { continue };
                met_jaws += 1;
                let out = (tip - jaw.center).normalize();
                // Towards the middle of the rounding, and a little to its sides.
                for turn in [-0.1, 0.0, 0.1] {
                    let out = DVec2::from_angle(turn).rotate(out);
                    let from = (jaw.center + (jaw.radius_m + 0.02) * out).extend(height);
                    let point = met(&scene, from, -out.extend(0.0)).truncate();
                    let radius = point.distance(jaw.center);
                    assert!((radius - jaw.radius_m).abs() < 1e-6, "{radius} {jaw:?}");
                }
                // No cloth is left of the tip.
                let last = 0.5 * (tip + jaw.center + jaw.radius_m * out);
                let down = met(&scene, last.extend(height + 0.1), DVec3::NEG_Z);
                assert!(down.z < 1e-6, "{down}");
            }
        }
        assert!(met_jaws >= 12, "{met_jaws}");
    }
}

#[test]
fn pockets_are_holes_as_wide_as_the_simulation_s() {
    let (table, scene) = nine_foot();
    for pocket in table.pockets() {
        let inside = pocket.center + 0.9 * pocket.radius_m * pocket.mouth;
        let down = met(&scene, inside.extend(0.5), DVec3::NEG_Z);
        assert!((down.z + f64::from(POCKET_DEPTH_M)).abs() < 1e-6, "{down}");
        let outside = pocket.center + 1.1 * pocket.radius_m * pocket.mouth;
        let down = met(&scene, outside.extend(0.5), DVec3::NEG_Z);
        assert!(down.z.abs() < 1e-6, "{down}");
        let back = met(
            &scene,
            pocket.center.extend(0.02),
            -pocket.mouth.extend(0.0),
        );
        let radius = (back.truncate() - pocket.center).length();
        assert!((radius - pocket.radius_m).abs() < 1e-6, "{radius}");
    }
}

#[test]
fn a_ball_rolls_over_nothing_but_cloth() {
    let (table, scene) = nine_foot();
    let half = 0.5 * DVec2::new(table.length_m(), table.width_m()) - table.ball().radius_m;
    for i in 0..400 {
        let share = DVec2::new(f64::from(i % 20), f64::from(i / 20)) / 19.0;
        let place = half * (2.0 * share - 1.0);
        let point = met(&scene, place.extend(table.rail_height_m()), DVec3::NEG_Z);
        assert!(point.z.abs() < 1e-6, "{point}");
    }
}

/// Twice the light is twice the radiance of every pixel, as twice the exposure would be.
#[test]
fn brightness_scales_the_picture_and_nothing_else() {
    let tracer = CpuTracer::new().unwrap();
    let picture = |brightness| {
        let style = TableStyle {
            brightness,
            ..TableStyle::default()
        };
        let scene = room(&Table::nine_foot(), RuleSet::Free, style);
        let scene = CompiledScene::new(&scene).unwrap();
        let settings = RenderSettings {
            samples: 4,
            ..RenderSettings::default()
        };
        trace_image(&tracer, &scene, ImageSize::new(96, 54), settings)
            .unwrap()
            .image()
    };
    let normal = picture(Brightness::Normal);
    for brightness in [Brightness::Dim, Brightness::Daylight] {
        let scaled = picture(brightness);
        for (a, b) in normal.pixels.iter().zip(&scaled.pixels) {
            assert_eq!(a.map(|light| light * brightness.factor()), *b);
        }
    }
}

#[test]
fn each_cue_has_woods_of_its_own() {
    let woods = |cue| {
        let style = TableStyle {
            cue,
            ..TableStyle::default()
        };
        room(&Table::nine_foot(), RuleSet::Free, style).materials["cue"]
    };
    let cues: Vec<_> = CueStyle::value_variants()
        .iter()
        .map(|&cue| woods(cue))
        .collect();
    for (index, cue) in cues.iter().enumerate() {
        assert!(!cues[..index].contains(cue));
    }
}

/// relMSE and FLIP of the room against its picture of 512 samples fall with the number of samples. For
/// metal and glass balls only FLIP is tested, as their relMSE is dominated by whether single paths hit a
/// lamp.
#[test]
fn more_samples_never_leave_more_error() {
    let tracer = CpuTracer::new().unwrap();
    let size = ImageSize::new(240, 135);
    let shown = |image: &RadianceImage| {
        let pixels = image.pixels.iter();
        pixels.map(|light| srgb8(*light, EXPOSURE)).collect()
    };
    for set in [BallSet::Classic, BallSet::Glass, BallSet::Metal] {
        let scene = room(&Table::nine_foot(), RuleSet::Free, set.into());
        let scene = CompiledScene::new(&scene).unwrap();
        let picture = |samples, denoise, seed| {
            let settings = RenderSettings {
                samples,
                max_depth: set.max_depth(),
                denoise,
                seed,
                ..RenderSettings::default()
            };
            trace_image(&tracer, &scene, size, settings)
                .unwrap()
                .image()
        };
        let reference = picture(512, false, 1);
        let truth: Vec<[u8; 3]> = shown(&reference);
        for denoise in [false, true] {
            let errors = [1, 2, 4, 8, 16, 64].map(|samples| {
                let image = picture(samples, denoise, 0);
                let seen: Vec<[u8; 3]> = shown(&image);
                let error = rel_mse(&image, &reference).unwrap();
                (error, flip(size, &seen, &truth).unwrap().mean)
            });
            let falls = |pair: &[(f64, f64)]| {
                pair[1].1 <= pair[0].1 && (set != BallSet::Classic || pair[1].0 <= pair[0].0)
            };
            let is_right = errors.windows(2).all(falls);
            assert!(is_right, "{set:?}, denoised {denoise}: {errors:?}");
        }
    }
}

#[test]
fn the_plan_shows_all_of_the_table_and_nothing_of_the_lamp() {
    let framing = Framing::whole(DVec2::new(1280.0, 720.0));
    for table in [
        Table::nine_foot(),
        Table::parse(include_str!("../../../../assets/tables/snooker.json")).unwrap(),
    ] {
        let scene = room(&table, RuleSet::Free, BallSet::Classic.into());
        let plan = Viewpoint::overhead(&table, &framing).camera();
        let mut compiled = CompiledScene::new(&scene).unwrap();
        compiled.camera = below_lamp(&table, plan);
        let size = ImageSize::new(64, 36);
        let frame = compiled.camera_frame(size);
        for (x, y) in (0..size.height).flat_map(|y| (0..size.width).map(move |x| (x, y))) {
            let film = [f64::from(x) + 0.5, f64::from(y) + 0.5];
            let ray = camera_ray(&frame, film, [0.5; 2]);
            let hit = intersect(&compiled, &ray).unwrap();
            assert!(hit.point.z < 0.2, "{}: {film:?}", table.name());
        }
        let forward = (plan.target - plan.eye).normalize();
        let (_, outer) = table.outline();
        let top = Vec3::new(outer.x as f32, outer.y as f32, table.rail_height_m() as f32);
        for corner in [top, top * Vec3::new(-1.0, -1.0, 1.0)] {
            let depth = forward.dot(corner - plan.eye);
            assert!(compiled.camera.near_m < depth, "{}", table.name());
        }
    }
}

#[test]
fn a_camera_under_the_lamp_has_no_near_plane() {
    let table = Table::nine_foot();
    let camera = room(&table, RuleSet::Free, BallSet::Classic.into()).camera;
    assert_eq!(below_lamp(&table, camera), camera);
}
