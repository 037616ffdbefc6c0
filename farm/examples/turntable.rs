//! Balls that spin on a turntable, as a film with moving objects:
//! `cargo run --release -p carom-farm --example turntable -- [FRAMES] [SAMPLES]`

use std::f32::consts::TAU;

use carom_farm::carom_tracer::{ProceduralTexture, Stripe};
use carom_farm::prelude::*;

const RADIUS_M: f32 = 0.35;

fn main() -> carom_farm::Result<()> {
    let mut arguments = std::env::args()
        .skip(1)
        .map(|count| count.parse::<u16>().ok());
    let frames = arguments.next().flatten().unwrap_or(36);
    let samples = arguments.next().flatten().unwrap_or(32);
    let mut scene = Scene::new().camera(Camera::looking_at([0.0, -4.5, 2.4], [0.0, 0.0, 0.2]));
    let balls: Vec<ObjectHandle> = (0..6_u8)
        .map(|i| {
            // A stripe makes the spin visible.
            let red = 0.15 + 0.14 * f32::from(i);
            let stripe = Stripe {
                albedo: Vec3::new(red, 0.25, 0.9 - red),
                half_width: 0.5,
            };
            let material = Material::Coated {
                ior: 1.5,
                alpha: 0.0,
                texture: ProceduralTexture::Ball {
                    albedo: Vec3::splat(0.8),
                    stripe: Some(stripe),
                    number: i + 9,
                },
            };
            let place = [f32::from(i), 0.0, RADIUS_M];
            scene.add(Sphere::new(RADIUS_M).at(place), material)
        })
        .collect();
    scene.add(Plane::z(0.0), Material::grey(0.4));
    scene.add_light(
        AreaLight::new(2.0, 2.0)
            .at([2.0, -2.0, 4.0])
            .facing([0.0; 3])
            .power(150.0),
    );
    let mut updates = Vec::new();
    for frame in 0..frames {
        let turn = f32::from(frame) / f32::from(frames);
        let mut update = SceneUpdate::default();
        for (i, &ball) in balls.iter().enumerate() {
            let (sin, cos) = (TAU * (turn + i as f32 / balls.len() as f32)).sin_cos();
            let spin = Quat::from_rotation_z(3.0 * TAU * turn);
            update = update.pose(scene.pose(ball, [1.5 * cos, 1.5 * sin, RADIUS_M], spin)?);
        }
        updates.push(update);
    }
    let film = Film::new(320, 180, updates).samples(samples.into());
    let film = Farm::auto()?
        .film(&scene, film, "turntable.frames")?
        .wait()?;
    film.save("turntable.png", 24)?;
    film.remove()
}
