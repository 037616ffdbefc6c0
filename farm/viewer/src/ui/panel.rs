//! Panel at the left: exposure, view, lights and saving.

use carom_text::text;
use carom_tracer::{ImageSize, RenderSettings, Shape};
use carom_window::theme;
use egui::emath::Numeric;
use egui::{
    Area, Button, Checkbox, CollapsingHeader, ComboBox, Context, DragValue, Grid, Id, Order,
    ProgressBar, Rect, RichText, ScrollArea, Slider, SliderClamping, TextEdit, Ui, Vec2,
};
use glam::Vec3;

use crate::camera::OrbitCamera;
use crate::save_form::{SaveForm, SaveKind};
use crate::ui::animation;
use crate::viewer::{STOPS_MAX, Viewer};

/// Draws the panel at the left of `room`; returns the remaining part.
pub(crate) fn show(ctx: &Context, room: Rect, viewer: &mut Viewer) -> Rect {
    let area = Area::new(Id::unique("view-panel"))
        .order(Order::Middle)
        .constrain_to(room)
        .fixed_pos(room.min + Vec2::splat(GAP));
    let shown = area.show(ctx, |ui| {
        // egui's default maximum height of an area is small.
        ui.set_max_height(room.height() - 2.0 * GAP - LINE_HEIGHT);
        theme::frame().show(ui, |ui| {
            ui.set_width(WIDTH.min(room.width() - 4.0 * GAP).max(GAP));
            ui.spacing_mut().slider_width = 120.0;
            ui.spacing_mut().interact_size.y = ROW_HEIGHT;
            let height = (ui.available_height() - FRAME_MARGIN).max(GAP);
            ScrollArea::vertical()
                .max_height(height)
                .show(ui, |ui| contents(ui, viewer));
        });
    });
    room.with_min_x(shown.response.rect.right().min(room.right()))
}

fn contents(ui: &mut Ui, viewer: &mut Viewer) {
    heading(ui, viewer);
    let mut stops = viewer.exposure_stops;
    let slider = Slider::new(&mut stops, -STOPS_MAX..=STOPS_MAX)
        .text(text!("view-exposure"))
        .fixed_decimals(1);
    if ui
        .add(slider)
        .on_hover_text(text!("view-exposure-about"))
        .changed()
    {
        viewer.set_exposure_stops(stops);
    }
    camera(ui, viewer);
    let [narrow, wide] = OrbitCamera::FOV_X_DEG;
    let mut fov_x_deg = viewer.camera.fov_x_deg();
    let slider = Slider::new(&mut fov_x_deg, narrow..=wide)
        .text(text!("view-fov"))
        .suffix("°")
        .fixed_decimals(0)
        // Clamping only edits avoids rounding the scene's own value.
        .clamping(SliderClamping::Edits);
    if ui.add(slider).changed() {
        viewer.camera.set_fov_x_deg(fov_x_deg);
    }
    upright(ui, viewer);
    ui.horizontal_wrapped(|ui| {
        if ui.button(text!("view-home")).clicked() {
            viewer.go_home();
        }
        ui.checkbox(&mut viewer.is_paused, text!("view-pause"))
            .on_hover_text(text!("view-pause-about"));
    });
    if !viewer.playback.animations().is_empty() {
        section(ui, text!("view-animation"), |ui| {
            if animation::show(ui, &mut viewer.playback) {
                viewer.form.range = None;
            }
        });
    }
    section(ui, text!("view-lights"), |ui| lights(ui, viewer));
    section(ui, text!("view-save"), |ui| save(ui, viewer));
}

fn heading(ui: &mut Ui, viewer: &Viewer) {
    let (Some(document), Some(file)) = (&viewer.document, viewer.file_name()) else {
        return;
    };
    ui.label(RichText::new(file).strong())
        .on_hover_text(document.path.display().to_string());
    let scene = document.file.scene();
    let objects = &scene.objects;
    let triangles: usize = objects
        .iter()
        .map(|object| match &object.shape {
            Shape::Mesh(mesh) => mesh.triangles.len(),
            _ => 0,
        })
        .sum();
    let contents = text!(
        "view-contents",
        objects = objects.len(),
        triangles = triangles,
        lights = scene.area_lights.len()
    );
    ui.label(RichText::new(contents).color(theme::FAINT).small());
}

/// Draws the choice among the file's cameras and the free one.
fn camera(ui: &mut Ui, viewer: &mut Viewer) {
    let cameras = viewer.file_cameras();
    if cameras.is_empty() {
        return;
    }
    let name = |(number, name): (usize, &&str)| match *name {
        "" => text!("view-camera-number", number = number),
        name => name.to_owned(),
    };
    let names: Vec<String> = cameras.iter().enumerate().map(name).collect();
    let attached = viewer.attached_camera();
    let free = text!("view-camera-free");
    let shown = attached.map_or(free, |number| &names[number]);
    ui.horizontal(|ui| {
        let choice = ComboBox::from_id_salt(Id::unique("view-cameras")).selected_text(shown);
        let choice = choice.show_ui(ui, |ui| {
            for (number, name) in names.iter().enumerate() {
                let is_chosen = attached == Some(number);
                if ui.selectable_label(is_chosen, name).clicked() {
                    viewer.attach(number);
                }
            }
            if ui.selectable_label(attached.is_none(), free).clicked() {
                viewer.camera.detach();
            }
        });
        let label = ui.label(text!("view-camera"));
        let choice = choice.response.labelled_by(label.id);
        choice.on_hover_text(text!("view-camera-about"));
    });
}

fn upright(ui: &mut Ui, viewer: &mut Viewer) {
    ui.horizontal(|ui| {
        let up = viewer.camera.up();
        for (name, axis) in [("x", Vec3::X), ("y", Vec3::Y), ("z", Vec3::Z)] {
            if ui.selectable_label(up == axis, name).clicked() {
                viewer.camera.set_up(axis);
            }
        }
        ui.label(text!("view-upright"));
    });
}

fn lights(ui: &mut Ui, viewer: &mut Viewer) {
    let Some(document) = &viewer.document else {
        return;
    };
    if let Some(sky) = &mut viewer.lights.sky {
        ui.checkbox(sky, text!("view-sky"));
    }
    let lamps = document.file.scene().area_lights.iter();
    for (number, (lamp, is_on)) in lamps.zip(&mut viewer.lights.lamps).enumerate() {
        // Names of lamps may coincide.
        ui.push_id(number, |ui| ui.add(Checkbox::new(is_on, &lamp.name)));
    }
}

fn save(ui: &mut Ui, viewer: &mut Viewer) {
    let is_animated = !viewer.playback.animations().is_empty();
    let duration_secs = viewer.playback.duration_secs();
    let (window, form) = (viewer.window, &mut viewer.form);
    Grid::new("view-save").num_columns(2).show(ui, |ui| {
        let label = ui.label(text!("view-save-file"));
        let edit = TextEdit::singleline(&mut form.path).desired_width(FIELD_WIDTH);
        ui.add(edit)
            .labelled_by(label.id)
            .on_hover_text(text!("view-save-file-about"));
        ui.end_row();
        ui.label(text!("view-save-size"));
        let size = form.size_in(window);
        let mut edges = [size.width, size.height];
        ui.horizontal(|ui| {
            let drags = edges.each_mut().map(|edge| {
                let drag = DragValue::new(edge).range(1..=EDGE_MAX).speed(4.0);
                ui.add(drag).changed()
            });
            if drags.contains(&true) {
                form.size = Some(edges);
            }
        });
        ui.end_row();
        let samples = text!("view-save-samples");
        number(ui, samples, &mut form.samples, SAMPLES_MAX);
        number(ui, text!("view-save-frames"), &mut form.frames, FRAMES_MAX);
        if is_animated {
            range(ui, form, duration_secs);
        }
        let rate = text!("view-save-rate");
        number(ui, rate, &mut form.frames_per_sec, SaveForm::RATE_MAX);
    });
    let Some(done) = viewer.saving else {
        ui.horizontal_wrapped(|ui| {
            let is_named = !viewer.form.path.trim().is_empty();
            let mut offer = |kind, label: &str, about: &str| {
                let button = ui.add_enabled(is_named, Button::new(label));
                if button.on_hover_text(about).clicked() {
                    viewer.save(kind);
                }
            };
            let (label, about) = (text!("view-save-still"), text!("view-save-still-about"));
            offer(SaveKind::Still, label, about);
            let label = text!("view-save-turntable");
            offer(
                SaveKind::Turntable,
                label,
                text!("view-save-turntable-about"),
            );
            if is_animated {
                let label = text!("view-save-animation");
                offer(
                    SaveKind::Animation,
                    label,
                    text!("view-save-animation-about"),
                );
            }
        });
        return;
    };
    ui.add(ProgressBar::new(done as f32).show_percentage());
    if ui.button(text!("view-save-cancel")).clicked() {
        viewer.cancel_save();
    }
}

/// Draws the row of an animation's first and last frame.
fn range(ui: &mut Ui, form: &mut SaveForm, duration_secs: f64) {
    let label = ui.label(text!("view-save-range"));
    let [mut first, mut last] = form.range_in(duration_secs);
    ui.horizontal(|ui| {
        let drag = DragValue::new(&mut first).range(0..=SaveForm::FRAME_MAX);
        let first_drag = ui.add(drag.speed(1.0)).labelled_by(label.id);
        let drag = DragValue::new(&mut last).range(first..=SaveForm::FRAME_MAX);
        let last_drag = ui.add(drag.speed(1.0)).labelled_by(label.id);
        if first_drag.changed() || last_drag.changed() {
            form.range = Some([first, last.max(first)]);
        }
    });
    ui.end_row();
}

/// Draws a row with a number.
fn number<Number: Numeric>(ui: &mut Ui, label: &str, value: &mut Number, max: Number) {
    let label = ui.label(label);
    let min = Number::from_f64(1.0);
    let drag = DragValue::new(value).range(min..=max).speed(1.0);
    ui.add(drag).labelled_by(label.id);
    ui.end_row();
}

fn section(ui: &mut Ui, title: &str, draw: impl FnOnce(&mut Ui)) {
    CollapsingHeader::new(title)
        .default_open(true)
        .show_unindented(ui, draw);
}

const WIDTH: f32 = 270.0;
/// Width of the file name's field.
const FIELD_WIDTH: f32 = 180.0;
const ROW_HEIGHT: f32 = 28.0;
/// Height reserved for the line at the bottom of the window.
const LINE_HEIGHT: f32 = 44.0;
/// Vertical margins of the panel's content.
const FRAME_MARGIN: f32 = 20.0;
/// Distance of the panel from the window's edge.
const GAP: f32 = 8.0;
/// Maximum edge of a picture that a farm traces.
const EDGE_MAX: u32 = ImageSize::EDGE_MAX;
const SAMPLES_MAX: u32 = RenderSettings::SAMPLES_MAX;
/// Maximum frames of a turntable: two minutes.
const FRAMES_MAX: u32 = 2880;
