//! A thousand balls of three materials: `cargo run --release -p carom-farm --example many_balls -- [SAMPLES]`

use carom_farm::prelude::*;

fn main() -> carom_farm::Result<()> {
    let samples = std::env::args().nth(1).and_then(|count| count.parse().ok());
    let mut scene = Scene::new().camera(Camera::looking_at([0.0, -7.0, 5.0], [0.0, 0.0, 0.2]));
    let materials = [
        Material::glass(),
        Material::gold(0.15),
        Material::plastic([0.15, 0.35, 0.75]),
    ];
    for i in 0..1000_u16 {
        // Vogel's sunflower: each ball is turned by the golden angle from the one before.
        let (radius, angle) = (0.1 * f32::from(i).sqrt(), 2.399_963_2 * f32::from(i));
        let (sin, cos) = angle.sin_cos();
        let ball = Sphere::new(0.08).at([radius * cos, radius * sin, 0.08]);
        scene.add(ball, materials[usize::from(i) % materials.len()]);
    }
    scene.add(Plane::z(0.0), Material::grey(0.6));
    scene.add_light(
        AreaLight::new(2.0, 2.0)
            .at([3.0, -3.0, 6.0])
            .facing([0.0; 3])
            .power(900.0),
    );
    let still = Still::new(640, 360).samples(samples.unwrap_or(64));
    Farm::auto()?.render(&scene, still)?.save("many_balls.png")
}
