//! A live picture without a window: a ball rolls for some frames, then rests while samples accumulate:
//! `cargo run --release -p carom-farm --example live_picture`

use std::sync::mpsc;

use carom_farm::prelude::*;

fn main() -> carom_farm::Result<()> {
    let mut scene = Scene::new().camera(Camera::looking_at([0.0, -3.0, 1.5], [0.0, 0.0, 0.2]));
    let ball = scene.add_named(
        "ball",
        Sphere::new(0.25).at([0.0, 0.0, 0.25]),
        Material::glass(),
    );
    scene.add(Plane::z(0.0), Material::wood(Axis::X));
    scene.add_light(
        AreaLight::new(1.0, 1.0)
            .at([1.0, -1.0, 3.0])
            .facing([0.0; 3])
            .power(300.0),
    );
    let mut farm = Farm::auto()?;
    // A window would be woken here: `proxy.send_event(())` with winit, `ctx.request_repaint()` with egui.
    let (wake, woken) = mpsc::channel();
    let live = Live::new(640, 360)
        .samples(64)
        .on_frame(move || wake.send(()).unwrap_or_default());
    let mut view = farm.live(&scene, live)?;
    let mut pictures = 0_u16;
    while woken.recv().is_ok() {
        let Some(picture) = view.latest()? else {
            continue;
        };
        pictures += 1;
        println!("picture {pictures}: {} samples", picture.samples());
        if pictures <= 10 {
            let x = 0.1 * f32::from(pictures) - 0.5;
            view.move_to(ball, [x, 0.0, 0.25], Quat::from_rotation_y(4.0 * x))?;
        } else if picture.samples() == 64 {
            return picture.save("live_picture.png");
        }
    }
    Ok(())
}
