//! Tests of single functions of the kernel, run on a device over thousands of inputs.

use bytemuck::{cast_slice, pod_collect_to_vec};
use glam::{DVec3, Vec3};

use super::adapter::{self, AdapterChoice};
use super::device::Device;
use super::layout;
use super::layout::scene_bytes;
use super::{probe, shader};
use crate::compiled::{Primitive, ShapeKind, SphereData};
use crate::fresnel::fresnel_dielectric;
use crate::sampling::{pcg4d, uniforms};
use crate::scalar::area_light::sample_light;
use crate::scalar::basis::basis;
use crate::scalar::{Ray, intersect};
use crate::{CompiledScene, ImageSize, PunctualEmitter, PunctualLight};

/// A device, or the reason why there is none.
fn device() -> Option<Device> {
    match adapter::find(&AdapterChoice::Any).and_then(|adapter| Device::open(&adapter)) {
        Ok(device) => Some(device),
        Err(error) if std::env::var_os("CAROM_REQUIRE_GPU").is_some() => panic!("{error}"),
        Err(error) => {
            eprintln!("skipped: {error}");
            None
        }
    }
}

/// Evenly distributed numbers in [0, 1), four for each `i`.
fn random(i: usize) -> [f64; 4] {
    uniforms(i as u32, 1, 2, 3).map(f64::from)
}

/// Runs `body` for each `i` below `count`, a multiple of 64. It reads its input with `word(at)`,
/// `number(at)` and `triple(at)` and writes four words with `result(i, vec4u)`.
fn run(scene: &CompiledScene, body: &str, input: &[u32], count: usize) -> Option<Vec<[u32; 4]>> {
    device().map(|device| run_on(&device, scene, body, input, count))
}

/// Calls [`run`] if there is a device. Drivers allow only some tens of devices per process.
fn run_on(
    device: &Device,
    scene: &CompiledScene,
    body: &str,
    input: &[u32],
    count: usize,
) -> Vec<[u32; 4]> {
    assert_eq!(count % 64, 0);
    let features = layout::features(scene, 65_536);
    let memory = wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::STORAGE;
    let text = shader::source(&features) + ENTRY + body + "}";
    let mesh = (features.count(ShapeKind::Triangle) > 0).then(|| layout::mesh_bytes(scene));
    let scene = scene_bytes(scene, ImageSize::new(EDGE, EDGE)).unwrap();
    let bytes = 16 * count as u64;
    let (commands, readback) = device
        .guarded(|wgpu| {
            let buffer = |size: usize, usage| {
                wgpu.create_buffer(&wgpu::BufferDescriptor {
                    label: None,
                    size: size as u64,
                    usage: usage | wgpu::BufferUsages::COPY_DST,
                    mapped_at_creation: false,
                })
            };
            let scene_buffer = buffer(scene.len(), memory);
            let source = buffer(size_of_val(input), wgpu::BufferUsages::STORAGE);
            let results = wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC;
            let output = buffer(bytes as usize, results);
            let readback = buffer(bytes as usize, wgpu::BufferUsages::MAP_READ);
            device.queue.write_buffer(&scene_buffer, 0, &scene);
            let mesh_buffer = mesh.as_ref().map(|mesh| buffer(mesh.len(), memory));
            for (buffer, mesh) in mesh_buffer.iter().zip(&mesh) {
                device.queue.write_buffer(buffer, 0, mesh);
            }
            device.queue.write_buffer(&source, 0, cast_slice(input));
            let mut encoder = wgpu.create_command_encoder(&Default::default());
            let pipeline = pipeline(wgpu, text);
            encode(
                wgpu,
                &mut encoder,
                &pipeline,
                [&scene_buffer, &source, &output],
                mesh_buffer.as_ref(),
                count,
            );
            encoder.copy_buffer_to_buffer(&output, 0, &readback, 0, bytes);
            (encoder.finish(), readback)
        })
        .unwrap();
    device
        .submit_and_map(commands, &[readback.slice(..)])
        .unwrap();
    let view = readback.slice(..).get_mapped_range().unwrap();
    pod_collect_to_vec(&view)
}

/// Width and height of the image of a scene's camera.
const EDGE: u32 = 64;

const ENTRY: &str = "
@group(0) @binding(7) var<storage, read> leaf_input: array<u32>;
@group(0) @binding(8) var<storage, read_write> leaf_output: array<vec4u>;
fn word(at: u32) -> u32 { return leaf_input[at]; }
fn number(at: u32) -> f32 { return bitcast<f32>(leaf_input[at]); }
fn triple(at: u32) -> vec3f { return vec3f(number(at), number(at + 1u), number(at + 2u)); }
fn result(i: u32, words: vec4u) { leaf_output[i] = words; }
@compute @workgroup_size(64)
fn leaf(@builtin(global_invocation_id) id: vec3u) {
    let i = id.x;
    // So that each leaf's layout has the scene and the input, whether it uses them or not.
    let environment = scene.header.environment + scene_storage.header.environment;
    let first = word(0u);
";

fn pipeline(wgpu: &wgpu::Device, text: String) -> wgpu::ComputePipeline {
    let module = wgpu.create_shader_module(wgpu::ShaderModuleDescriptor {
        label: None,
        source: wgpu::ShaderSource::Wgsl(text.into()),
    });
    wgpu.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
        label: None,
        layout: None,
        module: &module,
        entry_point: Some("leaf"),
        compilation_options: wgpu::PipelineCompilationOptions::default(),
        cache: None,
    })
}

fn encode(
    wgpu: &wgpu::Device,
    encoder: &mut wgpu::CommandEncoder,
    pipeline: &wgpu::ComputePipeline,
    [scene, source, output]: [&wgpu::Buffer; 3],
    mesh: Option<&wgpu::Buffer>,
    count: usize,
) {
    let mesh = mesh.map(|mesh| (layout::MESH_BINDING, mesh));
    let buffers = [(0, scene), (6, scene), (7, source), (8, output)];
    let buffers = buffers.into_iter().chain(mesh);
    let entries = buffers.map(|(binding, buffer)| wgpu::BindGroupEntry {
        binding,
        resource: buffer.as_entire_binding(),
    });
    let entries: Vec<_> = entries.collect();
    let bindings = wgpu.create_bind_group(&wgpu::BindGroupDescriptor {
        label: None,
        layout: &pipeline.get_bind_group_layout(0),
        entries: &entries,
    });
    let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor::default());
    pass.set_pipeline(pipeline);
    pass.set_bind_group(0, &bindings, &[]);
    pass.dispatch_workgroups(count as u32 / 64, 1, 1);
}

fn probe_scene() -> CompiledScene {
    CompiledScene::new(&probe::scene()).unwrap()
}

#[test]
fn gpu_random_words_equal_the_cpu_s() {
    let inputs: Vec<[u32; 4]> = (0..8192_u32)
        .map(|i| pcg4d([i, i << 20, !i, i.wrapping_mul(0x9e37_79b9)]))
        .collect();
    let body = "
        let at = 4u * i;
        result(i, pcg4d(vec4u(word(at), word(at + 1u), word(at + 2u), word(at + 3u))));";
    let Some(words) = run(&probe_scene(), body, cast_slice(&inputs), inputs.len()) else {
        return;
    };
    for (input, words) in inputs.iter().zip(words) {
        assert_eq!(words, pcg4d(*input));
    }
}

#[test]
fn gpu_sample_pairs_equal_the_cpu_s() {
    let body = "
        let key = pixel_key(i % 300u, i * 16u);
        let block = block_light(i % 9u) + block_scatter(i);
        let drawn = pair(key, sample_key(4294967000u + i), block, 5u);
        result(i, vec4u(bitcast<vec2u>(drawn), key, 0u));";
    let Some(words) = run(&probe_scene(), body, &[0], 4096) else {
        return;
    };
    for (i, [x, y, key, _]) in (0..).zip(words) {
        use crate::sampling::{block_light, block_scatter, pair, pixel_key, sample_key};
        let block = block_light(i % 9) + block_scatter(i);
        assert_eq!(key, pixel_key(i % 300, i * 16));
        let sample = sample_key(4_294_967_000_u32.wrapping_add(i));
        assert_eq!([x, y].map(f32::from_bits), pair(key, sample, block, 5));
    }
}

#[test]
fn light_samples_are_those_of_scalar() {
    const COUNT: usize = 8192;
    let scene = probe_scene();
    let point = |i: usize| DVec3::from_slice(&random(i)) * 4.0 - DVec3::new(2.0, 2.0, 1.9);
    let input: Vec<u32> = (0..COUNT)
        .flat_map(|i| {
            let [x, y, z] = point(i).to_array();
            let [u, v, ..] = random(i + COUNT);
            [x, y, z, u, v].map(|value| (value as f32).to_bits())
        })
        .collect();
    let body = "
        let at = 5u * i;
        let chosen = sample_light(triple(at), vec2f(number(at + 3u), number(at + 4u)));
        let drawn = sample_direction(spherical_rectangle(chosen.index, triple(at)), chosen);
        let inverse_pdf = drawn.inverse_pdf * chosen.light_weight_sum / chosen.weight;
        result(i, vec4u(bitcast<vec3u>(drawn.wi),
            select(bitcast<u32>(inverse_pdf), 0u, chosen.weight == 0.0)));";
    let Some(results) = run(&scene, body, &input, COUNT) else {
        return;
    };
    let mut differing = 0;
    for (i, [x, y, z, inverse_pdf]) in results.into_iter().enumerate() {
        let [u, v, ..] = random(i + COUNT);
        let point = point(i).as_vec3().as_dvec3();
        let Some(chosen) = sample_light(&scene.area_lights, point, [u, v]) else {
            assert_eq!(inverse_pdf, 0);
            continue;
        };
        let expected = chosen.seen.sample(chosen.u);
        let wi = Vec3::from([x, y, z].map(f32::from_bits)).as_dvec3();
        let inverse_pdf = f64::from(f32::from_bits(inverse_pdf));
        let ratio = inverse_pdf * chosen.probability / expected.inverse_pdf;
        let same = wi.distance(expected.wi) < 1e-3 && (ratio - 1.0).abs() < 2e-3;
        differing += usize::from(!same);
    }
    // Points so near a threshold that rounding decides.
    assert!(differing <= 8, "{differing} of {COUNT}");
}

#[test]
fn infinities_and_nan_are_told_from_numbers() {
    let values = [
        (0.0, true),
        (-0.0, true),
        (f32::MAX, true),
        (f32::MIN_POSITIVE, true),
        (-1e30, true),
        (f32::INFINITY, false),
        (f32::NEG_INFINITY, false),
        (f32::NAN, false),
    ];
    let words: Vec<u32> = values.iter().map(|(value, _)| value.to_bits()).collect();
    let body = "
        var v = vec3f(1.0);
        v[(i / 8u) % 3u] = number(i % 8u);
        result(i, vec4u(u32(is_finite(v)), 0u, 0u, 0u));";
    let Some(results) = run(&probe_scene(), body, &words, 64) else {
        return;
    };
    for (i, [finite, ..]) in results.into_iter().enumerate() {
        let (value, expected) = values[i % 8];
        assert_eq!(finite == 1, expected, "{value}");
    }
}

#[test]
fn cosine_samples_are_those_of_scalar() {
    const COUNT: usize = 8192;
    let normal = |i: usize| {
        let [a, b, ..] = random(i + COUNT);
        match i % 16 {
            0 => DVec3::new(0.0, 0.0, -1.0),
            1 => DVec3::new(-1.0, 0.0, -0.0),
            2 => DVec3::new(1e-4, 0.0, -1.0).normalize(),
            _ => DVec3::new(a - 0.5, b - 0.5, a * b - 0.2).normalize(),
        }
    };
    let u = |i: usize| {
        [
            random(i)[0],
            if i.is_multiple_of(8) {
                0.0
            } else {
                random(i)[1]
            },
        ]
    };
    let input: Vec<u32> = (0..COUNT)
        .flat_map(|i| [normal(i).to_array().as_slice(), &u(i)].concat())
        .map(|value| (value as f32).to_bits())
        .collect();
    let body = "
        let at = 5u * i;
        let wi = cosine_hemisphere(triple(at), number(at + 3u), number(at + 4u));
        result(i, vec4u(bitcast<vec3u>(wi), 0u));";
    let Some(results) = run(&probe_scene(), body, &input, COUNT) else {
        return;
    };
    for (i, [x, y, z, _]) in results.into_iter().enumerate() {
        let n = normal(i).as_vec3().as_dvec3();
        let (t, b) = basis(n);
        let [u1, u2] = u(i);
        let (sin, cos) = (std::f64::consts::TAU * u2).sin_cos();
        let expected = u1.sqrt() * (cos * t + sin * b) + (1.0 - u1).sqrt() * n;
        let wi = Vec3::from([x, y, z].map(f32::from_bits)).as_dvec3();
        assert!(
            wi.distance(expected) < 1e-6,
            "{i}: {wi} instead of {expected}"
        );
    }
}

#[test]
fn fresnel_reflectance_is_that_of_scalar() {
    const COUNT: usize = 4096;
    let index = |i: usize| [1.0, 1.000_001, 1.33, 1.5, 2.4, 1000.0][i % 6];
    let cos = |i: usize| [0.0, 1.0, 1e-6, random(i)[0], random(i)[1]][i % 5] as f32;
    let input: Vec<u32> = (0..COUNT)
        .flat_map(|i| [cos(i).to_bits(), (index(i) as f32).to_bits()])
        .collect();
    let body = "
        let f = fresnel_dielectric(number(2u * i), number(2u * i + 1u));
        let none = fresnel_dielectric(number(2u * i), 0.0);
        result(i, bitcast<vec4u>(vec4f(f, none, 0.0, 0.0)));";
    let Some(results) = run(&probe_scene(), body, &input, COUNT) else {
        return;
    };
    for (i, [f, none, ..]) in results.into_iter().enumerate() {
        let expected = fresnel_dielectric(f64::from(cos(i)), f64::from(index(i) as f32));
        let f = f64::from(f32::from_bits(f));
        assert!((f - expected).abs() < 2e-6, "{f} instead of {expected}");
        assert_eq!(f32::from_bits(none), 0.0);
    }
}

/// Rays including some along axes, in faces and through edges.
fn rays(count: usize) -> Vec<[f32; 6]> {
    let ray = |i: usize| {
        let [a, b, c, d] = random(i);
        let origin = DVec3::new(6.0 * a - 3.0, 6.0 * b - 3.0, 3.0 * c - 0.5);
        let aim = DVec3::from_slice(&random(i + count)) * DVec3::new(3.0, 3.0, 1.0);
        let direction = (aim - DVec3::new(1.5, 1.5, 0.0) - origin).normalize();
        let axis = DVec3::AXES[i % 3] * if d < 0.5 { 1.0 } else { -1.0 };
        let (origin, direction) = match i % 8 {
            0 => (origin, axis),
            1 => (DVec3::new(-1.5, origin.y, 0.45), axis),
            2 => (DVec3::new(-1.5, 0.6, 2.0 * c), axis),
            _ => (origin, direction),
        };
        let [o, d] = [origin, direction].map(|v| v.as_vec3().to_array());
        [o[0], o[1], o[2], d[0], d[1], d[2]]
    };
    (0..count).map(ray).collect()
}

#[test]
fn rays_hit_what_scalar_rays_hit() {
    // One area light lower than the other and in front of its face; far from the origin in relation
    // to its size.
    let mut unequal = probe::scene();
    unequal.area_lights[1].center.z = 1.9;
    let mut far = unequal.clone();
    far.camera.eye.x = 1e5;
    for (scene, area_lights_occlude) in [(probe::scene(), false), (unequal, true), (far, true)] {
        let scene = CompiledScene::new(&scene).unwrap();
        assert_eq!(
            layout::features(&scene, 65_536).area_lights_occlude,
            area_lights_occlude
        );
        compare_rays(&scene, area_lights_occlude);
    }
}

/// If there are other lights, area lights occlude their shadow rays; a single area light is
/// possible too.
#[test]
fn the_light_that_a_shadow_ray_asks_for_is_not_in_its_way() {
    const COUNT: usize = 4096;
    let mut scene = probe::scene();
    scene.area_lights.truncate(1);
    scene.punctual_lights.push(PunctualLight {
        name: "point".to_owned(),
        emitter: PunctualEmitter::Point {
            center: Vec3::Z,
            intensity: Vec3::ONE,
        },
    });
    let lit = CompiledScene::new(&scene).unwrap();
    let features = layout::features(&lit, 65_536);
    assert!(features.area_lights_coplanar && features.area_lights_occlude);
    let light = scene.area_lights.pop().unwrap();
    let unlit = CompiledScene::new(&scene).unwrap();
    // From a distance of a metre, towards the light and beyond its edges.
    let ray = |i: usize| {
        let [a, b, c, d] = random(i).map(|v| 2.0 * v as f32 - 1.0);
        let aim = light.center + 1.2 * (a * light.half_u + b * light.half_v);
        let direction = Vec3::new(c, d, [0.7, -0.7][i % 2]).normalize();
        let (o, d) = ((aim - direction).to_array(), direction.to_array());
        [o[0], o[1], o[2], d[0], d[1], d[2]]
    };
    let rays: Vec<_> = (0..COUNT).map(ray).collect();
    let input: Vec<u32> = rays.as_flattened().iter().map(|v| v.to_bits()).collect();
    let body = "
        let ray = Ray(triple(6u * i), triple(6u * i + 3u));
        let asked = occluded(ray, NO_PRIMITIVE, 0u, 1.25);
        let other = occluded(ray, NO_PRIMITIVE, NO_PRIMITIVE, 1.25);
        result(i, vec4u(u32(asked), u32(other), 0u, 0u));";
    let Some(results) = run(&lit, body, &input, COUNT) else {
        return;
    };
    let (mut differing, mut met) = (0, 0);
    for (ray, [asked, other, ..]) in rays.iter().zip(results) {
        let vector = |at: usize| Vec3::from_slice(&ray[at..]).as_dvec3();
        let (origin, direction) = (vector(0), vector(3));
        let is_hit = |scene| {
            let hit = intersect(scene, &Ray { origin, direction });
            u32::from(hit.is_some_and(|hit| hit.t < 1.25))
        };
        differing += u32::from((asked, other) != (is_hit(&unlit), is_hit(&lit)));
        met += u32::from(asked != other);
    }
    assert!(differing <= 2 && met > 1000, "{differing}, {met}");
}

fn compare_rays(scene: &CompiledScene, area_lights_occlude: bool) {
    const COUNT: usize = 16_384;
    let rays = rays(COUNT);
    let input: Vec<u32> = rays.as_flattened().iter().map(|v| v.to_bits()).collect();
    let body = "
        let ray = Ray(triple(6u * i), triple(6u * i + 3u));
        let hit = nearest(ray, NO_PRIMITIVE);
        let shadowed = occluded(ray, NO_PRIMITIVE, NO_PRIMITIVE, 1.5);
        result(i, vec4u(hit.primitive, bitcast<u32>(hit.t), u32(shadowed), 0u));";
    let Some(results) = run(scene, body, &input, COUNT) else {
        return;
    };
    let mut differing = Vec::new();
    for (ray, [primitive, t, shadowed, _]) in rays.iter().zip(results) {
        let vector = |at: usize| Vec3::from_slice(&ray[at..]).as_dvec3();
        let (origin, direction) = (vector(0), vector(3));
        let hit = intersect(scene, &Ray { origin, direction });
        let expected = hit.map_or(u32::MAX, |hit| match hit.primitive {
            Primitive::Sphere(_) => 0,
            Primitive::Box(_) => 1,
            Primitive::Disc(_) => 2,
            Primitive::Rectangle(_) => 3,
            Primitive::CsgFace(_) => panic!("the scene has no CSG box"),
            Primitive::Triangle(_) => panic!("the scene has no mesh"),
            Primitive::AreaLight(i) => 4 + i,
        });
        let t_expected = hit.map_or(f64::INFINITY, |hit| hit.t);
        let t = f64::from(f32::from_bits(t));
        // What is behind an area light without occlusion is not tested.
        let is_shadow_known = area_lights_occlude || !(4..u32::MAX).contains(&expected);
        let is_shadow_same = (shadowed == 1) == (t_expected < 1.5)
            || (t_expected - 1.5).abs() < 1e-5
            || !is_shadow_known;
        let is_same = primitive == expected
            && (hit.is_none() || (t - t_expected).abs() < 1e-5)
            && is_shadow_same;
        if !is_same {
            differing.push((ray, [primitive, expected], [t, t_expected], shadowed));
        }
    }
    // Rays that pass within rounding of an edge, or exactly through an edge of the box.
    let (count, some) = (differing.len(), &differing[..differing.len().min(9)]);
    assert!(count * 2000 <= COUNT, "{count} of {COUNT}: {some:?}");
}

/// Every face, edge and corner, along every axis, with both zeros and with denormal components.
#[test]
fn rays_in_the_planes_of_a_box_hit_it() {
    let scene = probe_scene();
    let solid = scene.boxes[0];
    let mut rays = Vec::new();
    for (axis, sign, small) in (0..3).flat_map(|axis| {
        [1.0f32, -1.0]
            .into_iter()
            .flat_map(move |sign| [0.0, -0.0, 1e-40, -1e-40].map(|small| (axis, sign, small)))
    }) {
        for place in 0..9 {
            let along = [solid.min, solid.max];
            let mut ray = [0.0; 6];
            for (other, third) in [(1, place % 3), (2, place / 3)] {
                let at = (axis + other) % 3;
                let [low, high] = along.map(|corner| corner[at]);
                ray[at] = [low, 0.5 * (low + high), high][third];
                ray[at + 3] = small;
            }
            ray[axis] = if sign > 0.0 {
                solid.min[axis] - 2.0
            } else {
                solid.max[axis] + 2.0
            };
            ray[axis + 3] = sign;
            rays.push(ray);
        }
    }
    rays.resize(rays.len().next_multiple_of(64), rays[0]);
    let input: Vec<u32> = rays.as_flattened().iter().map(|v| v.to_bits()).collect();
    let body = "
        let ray = Ray(triple(6u * i), triple(6u * i + 3u));
        let t = box_t(prepare_ray(ray), 0u);
        result(i, vec4u(bitcast<u32>(t), 0u, 0u, 0u));";
    let Some(results) = run(&scene, body, &input, rays.len()) else {
        return;
    };
    for (ray, [t, ..]) in rays.iter().zip(results) {
        let t = f32::from_bits(t);
        assert!((t - 2.0).abs() < 1e-6, "{ray:?}: {t}");
    }
}

/// Rays that hit or miss a ball by a few ULPs at its silhouette: beyond 4 ULPs all results are
/// right.
#[test]
fn grazing_rays_are_exact_to_4_ulps() {
    let mut scene = probe_scene();
    scene.spheres[0] = SphereData {
        center: [0.0; 3],
        radius: RADIUS,
        ..scene.spheres[0]
    };
    let impact = |i: usize| f32::from_bits(RADIUS.to_bits() + i as u32 - 64);
    let input: Vec<u32> = (0..128).map(|i| impact(i).to_bits()).collect();
    let body = "
        let ray = Ray(vec3f(-1.0, number(i), 0.0), vec3f(1.0, 0.0, 0.0));
        let t = sphere_t(prepare_ray(ray), 0u);
        result(i, vec4u(bitcast<u32>(t), 0u, 0u, 0u));";
    let Some(results) = run(&scene, body, &input, 128) else {
        return;
    };
    for (i, [t, ..]) in results.into_iter().enumerate() {
        let t = f32::from_bits(t);
        assert!(!t.is_nan());
        let is_hit = t < 3e38;
        assert!(i.abs_diff(64) <= 4 || is_hit == (i < 64), "{i}: {t}");
    }
}

#[test]
fn balls_are_hit_from_any_distance_as_in_f64() {
    const COUNT: usize = 25_600;
    for distance in [1.0, 10.0, 100.0, 1e3, 1e4, 1e5, 1e6, 1e7] {
        let mut scene = probe_scene();
        scene.spheres[0] = SphereData {
            center: BALL,
            radius: RADIUS,
            ..scene.spheres[0]
        };
        scene.camera.eye.x = distance;
        let rays: Vec<[f32; 6]> = (0..COUNT).map(|i| ray_at_ball(i, distance)).collect();
        let input: Vec<u32> = rays.as_flattened().iter().map(|v| v.to_bits()).collect();
        let body = "
            let ray = Ray(triple(6u * i), triple(6u * i + 3u));
            let t = sphere_t(prepare_ray(ray), 0u);
            let n = sphere_surface(ray, t, 0u, false).normal;
            result(i, vec4u(bitcast<u32>(t), bitcast<vec3u>(n)));";
        let Some(results) = run(&scene, body, &input, COUNT) else {
            return;
        };
        let mut wrong = 0;
        let mut error_max = 0.0_f64;
        for (ray, [t, x, y, z]) in rays.iter().zip(results) {
            let n = Vec3::from([x, y, z].map(f32::from_bits)).as_dvec3();
            let is_hit = f32::from_bits(t) < 3e38;
            match normal_in_f64(ray) {
                Some(expected) if is_hit => error_max = error_max.max(n.distance(expected)),
                expected => wrong += usize::from(expected.is_some() || is_hit),
            }
        }
        // Without compensation, the error of a device whose `fma` rounds twice is proportional to
        // the distance.
        let is_compensated = layout::features(&scene, 65_536).is_compensated;
        let bound = if is_compensated {
            3e-5
        } else {
            1e-4 * f64::from(distance)
        };
        assert_eq!(wrong, 0, "{distance} m");
        assert!(
            error_max < bound,
            "{distance} m: normals off by {error_max}"
        );
    }
}

const RADIUS: f32 = 0.028_575;
/// Not the origin, so that the difference to a distant eye is rounded.
const BALL: [f32; 3] = [0.31, -0.22, 0.17];

/// A ray from `distance` that passes the ball's centre within 1.2 radii.
fn ray_at_ball(i: usize, distance: f32) -> [f32; 6] {
    let [a, b, c, d] = random(i);
    let center = Vec3::from(BALL).as_dvec3();
    let eye = center + (DVec3::new(a, b, c) - 0.5).normalize() * f64::from(distance);
    let eye = eye.as_vec3().as_dvec3();
    let (t, bitangent) = basis((eye - center).normalize());
    let angle = std::f64::consts::TAU * d;
    let aside = f64::from(RADIUS) * 1.2 * random(i + 77_777)[0].sqrt();
    let aim = center + aside * (angle.cos() * t + angle.sin() * bitangent);
    let direction = (aim - eye).normalize();
    let [o, d] = [eye, direction].map(|v| v.as_vec3().to_array());
    [o[0], o[1], o[2], d[0], d[1], d[2]]
}

fn normal_in_f64(ray: &[f32; 6]) -> Option<DVec3> {
    let vector = |at: usize| Vec3::from_slice(&ray[at..]).as_dvec3();
    let direction = vector(3).normalize();
    let origin = vector(0) - Vec3::from(BALL).as_dvec3();
    let nearest = origin - origin.dot(direction) * direction;
    let half_squared = f64::from(RADIUS).powi(2) - nearest.length_squared();
    (half_squared > 0.0).then(|| (nearest - half_squared.sqrt() * direction).normalize())
}

/// Hits found by a BVH are those of a linear search.
#[test]
fn bvh_hits_equal_those_of_a_linear_scan() {
    use crate::bvh::test_scenes::{ARRANGEMENTS, SHAPES, ray, test_scene};
    use crate::compiled::BvhUse;
    const COUNT: usize = 4096;
    let body = "
        let at = 7u * i;
        let ray = Ray(triple(at), triple(at + 3u));
        let start = word(at + 6u);
        let hit = nearest(ray, start);
        let limit = select(hit.t, 1.0, hit.primitive == NO_PRIMITIVE);
        let before = occluded(ray, start & ~INSIDE, NO_PRIMITIVE, 0.5 * limit);
        let behind = occluded(ray, start & ~INSIDE, NO_PRIMITIVE, 2.0 * limit);
        result(i, vec4u(bitcast<u32>(hit.t), hit.primitive, u32(before), u32(behind)));";
    let Some(device) = device() else {
        return;
    };
    let crowds = SHAPES
        .into_iter()
        .flat_map(|of| ARRANGEMENTS.map(|kind| (of, kind)));
    for (seed, (of, kind)) in (0..).zip(crowds) {
        let mut scene = test_scene(kind, of, 300, seed);
        let rays = (0..COUNT as u32).map(|i| ray(&scene, seed, i));
        let words = rays.flat_map(|ray| {
            let inside = if ray.is_inside { 1 << 31 } else { 0 };
            let start = ray.left.map_or(u32::MAX, |left| left | inside);
            let [o, d] = [ray.origin, ray.direction].map(|v| v.to_array().map(f32::to_bits));
            [o[0], o[1], o[2], d[0], d[1], d[2], start]
        });
        let input: Vec<u32> = words.collect();
        scene.bvh_use = BvhUse::Never;
        let each = run_on(&device, &scene, body, &input, COUNT);
        scene.bvh_use = BvhUse::Always;
        let bvh = run_on(&device, &scene, body, &input, COUNT);
        let hits = each.iter().filter(|hit| hit[1] != u32::MAX).count();
        assert!(hits > COUNT / 16, "{of:?} {kind:?}: {hits} hits");
        for (i, (found, expected)) in bvh.iter().zip(&each).enumerate() {
            assert_eq!(found, expected, "{of:?} {kind:?}, ray {i}");
        }
    }
}

#[test]
fn no_ray_passes_an_edge_or_a_corner_of_a_closed_mesh() {
    use crate::bvh::test_scenes::globe_with_rays;
    use crate::compiled::BvhUse;
    let (mut scene, rays) = globe_with_rays();
    let count = rays.len() / 64 * 64;
    let words = rays[..count].iter().flat_map(|(origin, direction)| {
        let [o, d] = [origin, direction].map(|v| v.to_array().map(f32::to_bits));
        [o[0], o[1], o[2], d[0], d[1], d[2]]
    });
    let input: Vec<u32> = words.collect();
    let body = "
        let ray = Ray(triple(6u * i), triple(6u * i + 3u));
        result(i, vec4u(nearest(ray, NO_PRIMITIVE).primitive, 0u, 0u, 0u));";
    for bvh_use in [BvhUse::Never, BvhUse::Always] {
        scene.bvh_use = bvh_use;
        let Some(hits) = run(&scene, body, &input, count) else {
            return;
        };
        let missed = hits.iter().filter(|hit| hit[0] == u32::MAX).count();
        assert_eq!(missed, 0, "{bvh_use:?}: of {count}");
    }
}

/// Camera rays of a block find the same hits among the primitives in its frustum as among all: with
/// wide and very narrow fields of view, with and without a lens, and far from the origin.
#[test]
fn camera_rays_meet_the_same_in_their_frustum() {
    use crate::bvh::test_scenes::{Arrangement, test_scene};
    use crate::compiled::BvhUse;
    const COUNT: usize = (EDGE * EDGE) as usize;
    const PRIMITIVES: u32 = 150;
    let body = format!(
        "
        let block = vec2u(i / 64u % {0}u, i / 64u / {0}u);
        let pixel = 8u * block + vec2u(i % 8u, i / 8u % 8u);
        find_block_candidates(Place(pixel.x, pixel.y, 0u, 0u, true), i % 64u);
        let film = vec2f(pixel) + vec2f(number(2u * i), number(2u * i + 1u));
        let camera = scene.header.camera;
        let direction = camera.corner + film.x * camera.dx + film.y * camera.dy;
        let ray = Ray(camera.eye, direction / length(direction));
        let hit = nearest(ray, NO_PRIMITIVE);
        let found = nearest_of_camera_ray(ray, 0u);
        var count = 0u;
        for (var word = 0u; word < CANDIDATE_WORDS; word++) {{ count += countOneBits(candidates_of_block(0u, word)); }}
        let is_same = hit.primitive == found.primitive && hit.t == found.t;
        result(i, vec4u(u32(is_same), hit.primitive, found.primitive, count));",
        EDGE / 8
    );
    let Some(device) = device() else {
        return;
    };
    // Including corners of pixels.
    let jitter = (0..COUNT).flat_map(|i| {
        let [x, y, is_corner, _] = random(i);
        [x, y].map(|at| if is_corner < 0.2 { at.round() } else { at } as f32)
    });
    let input: Vec<u32> = jitter.map(f32::to_bits).collect();
    let views = [(40.0, 3.0), (170.0, 0.5), (1.0, 100.0), (1e-2, 1e4)];
    for shape in [ShapeKind::Sphere, ShapeKind::Box, ShapeKind::CsgFace] {
        for arrangement in [Arrangement::Cloud, Arrangement::Far] {
            let mut scene = test_scene(arrangement, shape, PRIMITIVES, 1);
            scene.bvh_use = BvhUse::Never;
            let target = scene.camera.target;
            for ((fov_x_deg, distance), aperture_radius_m) in views
                .into_iter()
                .flat_map(|view| [(view, 0.0), (view, 0.1)])
            {
                scene.camera.eye = target + distance * Vec3::new(0.6, -0.5, 0.62).normalize();
                scene.camera.fov_x_deg = fov_x_deg;
                scene.camera.lens.aperture_radius_m = aperture_radius_m;
                let results = run_on(&device, &scene, &body, &input, COUNT);
                let of = format!("{shape:?}, {arrangement:?}, {fov_x_deg} degrees");
                for (i, result) in results.iter().enumerate() {
                    assert_eq!(result[0], 1, "{of}, ray {i}: {result:?}");
                }
                let hits = results.iter().filter(|hit| hit[1] != u32::MAX).count();
                assert!(hits > COUNT / 50, "{of}: {hits} hits");
                let candidates: u32 = results.iter().map(|result| result[3]).sum();
                let share = f64::from(candidates) / COUNT as f64 / f64::from(PRIMITIVES);
                match aperture_radius_m > 0.0 {
                    true => assert_eq!(share, 1.0, "{of}, with a lens"),
                    false => assert!(share < 0.5, "{of}: {share} of all are candidates"),
                }
            }
        }
    }
}
