//! Gantt chart of a picture: a row of bars for each node, in one mesh.

use carom_farm::Delivery;
use carom_text::text;
use egui::epaint::Mesh;
use egui::{Align2, Color32, FontId, Pos2, Rect, Sense, Shape, Ui, Vec2};

use super::frame_record::FrameRecord;
use super::palette;
use super::value_label::{in_ms, ms};
use crate::theme::{ALARM, FAINT, INK};

/// Draws a picture's chart over the available width.
pub fn show(ui: &mut Ui, record: &FrameRecord) {
    let Some(detail) = &record.detail else {
        ui.label(text!("stats-gantt-gone"));
        return;
    };
    let rows: Vec<usize> = record.took_part().map(|(index, _)| index).collect();
    if rows.is_empty() {
        return;
    }
    let row_height = (HEIGHT_MAX / rows.len() as f32).clamp(ROW_MIN, ROW_MAX);
    let size = Vec2::new(
        ui.available_width(),
        row_height * rows.len() as f32 + AXIS_HEIGHT,
    );
    let (rect, response) = ui.allocate_exact_size(size, Sense::hover());
    let end_secs = record.makespan_secs.max(1e-6);
    let plan = GanttLayout {
        bars: Rect::from_min_max(
            rect.min + Vec2::new(NAME_WIDTH, 0.0),
            rect.max - Vec2::new(0.0, AXIS_HEIGHT),
        ),
        row_height,
        end_secs,
    };
    let mut row_of = vec![None; record.nodes.len()];
    rows.iter()
        .enumerate()
        .for_each(|(row, node)| row_of[*node] = Some(row));
    let mut mesh = Mesh::default();
    // Room for five bars per message, of four vertices and two triangles each.
    mesh.reserve_vertices(detail.deliveries.len() * 20);
    mesh.reserve_triangles(detail.deliveries.len() * 10);
    let mut lanes = vec![GanttLane::default(); record.nodes.len()];
    let pointer = response.hover_pos();
    let mut under = None;
    for delivery in &detail.deliveries {
        let node = delivery.node.0;
        let Some(row) = row_of.get(node).copied().flatten() else {
            continue;
        };
        let bar = plan.delivery(&mut mesh, delivery, row, &mut lanes[node]);
        if pointer.is_some_and(|pointer| bar.contains(pointer)) {
            under = Some(delivery);
        }
    }
    plan.limit(&mut mesh, record.ideal_secs, palette::IDEAL);
    ui.painter().add(Shape::mesh(mesh));
    plan.labels(ui, record, &rows, rect);
    if let Some(delivery) = under {
        response.on_hover_text_at_pointer(tell(delivery));
    }
}

struct GanttLayout {
    bars: Rect,
    row_height: f32,
    end_secs: f64,
}

/// Times until which a node's row already shows tracing and arrivals.
#[derive(Clone, Copy, Default)]
struct GanttLane {
    traced: f64,
    arrived: f64,
}

impl GanttLayout {
    fn x(&self, secs: f64) -> f32 {
        self.bars.left() + self.bars.width() * (secs / self.end_secs).clamp(0.0, 1.0) as f32
    }

    /// Adds a tile message: tracing as a thick bar that ends when the tiles were sent, but begins no earlier
    /// than previous tracing ended; the network before the first bar and after each bar as a thin line, with
    /// encoding and decoding at its ends. Returns the rectangle of the thick bar.
    fn delivery(
        &self,
        mesh: &mut Mesh,
        delivery: &Delivery,
        row: usize,
        lane: &mut GanttLane,
    ) -> Rect {
        let split = &delivery.split;
        let top = self.bars.top() + self.row_height * row as f32;
        let mut bar = |from: f64, to: f64, height: f32, color: Color32| {
            let margin = 0.5 * self.row_height * (1.0 - height);
            let rect = Rect::from_min_max(
                Pos2::new(self.x(from), top + margin),
                Pos2::new(self.x(to), top + self.row_height - margin),
            );
            mesh.add_colored_rect(rect, color);
        };
        // Reconstructed backwards from the arrival, the only moment of the client's clock; half of the
        // network time is attributed to the way back.
        let arrived = delivery.arrived_secs;
        let decoding = arrived - split.decode_secs;
        let encoded = decoding - 0.5 * split.network_secs;
        let asked = split.request_secs.min(arrived);
        let traced =
            (encoded - split.encode_secs).clamp(lane.traced.max(asked).min(arrived), arrived);
        let begun = (traced - delivery.busy_secs)
            .max(lane.traced.max(asked))
            .min(traced);
        let [_, network, queue, trace, encode, decode] = palette::STAGES;
        let is_fresh = delivery.fresh_tiles == delivery.tiles.count;
        if lane.traced == 0.0 {
            let waiting = (begun - split.queue_secs).max(asked);
            bar(asked, waiting, 0.15, network);
            bar(waiting, begun, 0.3, queue);
        }
        bar(traced.max(lane.arrived), arrived, 0.15, network);
        bar(traced, encoded.max(traced), 0.4, encode);
        bar(decoding.max(traced), arrived, 0.4, decode);
        bar(begun, traced, 0.9, if is_fresh { trace } else { ALARM });
        *lane = GanttLane { traced, arrived };
        Rect::from_min_max(
            Pos2::new(self.x(begun), top),
            Pos2::new(self.x(traced.max(begun)) + 1.0, top + self.row_height),
        )
    }

    fn limit(&self, mesh: &mut Mesh, secs: f64, color: Color32) {
        let x = self.x(secs);
        let line = Rect::from_min_max(
            Pos2::new(x - 1.0, self.bars.top()),
            Pos2::new(x + 1.0, self.bars.bottom()),
        );
        mesh.add_colored_rect(line, color);
    }

    fn labels(&self, ui: &Ui, record: &FrameRecord, rows: &[usize], rect: Rect) {
        let painter = ui.painter().with_clip_rect(rect.expand(2.0));
        let font = FontId::monospace(10.0);
        // As many names as there is room for.
        let every = (LABEL_HEIGHT / self.row_height).ceil().max(1.0) as usize;
        for (row, node) in rows.iter().enumerate().step_by(every) {
            let name: String = format!("{node} {}", record.nodes[*node].name)
                .chars()
                .take(NAME_CHARS)
                .collect();
            let at = Pos2::new(
                rect.left(),
                self.bars.top() + self.row_height * (row as f32 + 0.5),
            );
            painter.text(at, Align2::LEFT_CENTER, name, font.clone(), INK);
        }
        let bottom = rect.bottom();
        let start = Pos2::new(self.bars.left(), bottom);
        painter.text(start, Align2::LEFT_BOTTOM, "0", font.clone(), FAINT);
        let ideal = text!("stats-gantt-ideal", milliseconds = ms(record.ideal_secs));
        let at = Pos2::new(
            self.x(record.ideal_secs).clamp(
                rect.left() + 130.0,
                (rect.right() - 70.0).max(rect.left() + 130.0),
            ),
            bottom,
        );
        painter.text(
            at,
            Align2::RIGHT_BOTTOM,
            ideal,
            font.clone(),
            palette::IDEAL,
        );
        let end = in_ms(self.end_secs);
        painter.text(rect.right_bottom(), Align2::RIGHT_BOTTOM, end, font, INK);
    }
}

fn tell(delivery: &Delivery) -> String {
    let split = &delivery.split;
    let [from, to] = [delivery.tiles.first, delivery.tiles.end().saturating_sub(1)];
    let twice = delivery.tiles.count.saturating_sub(delivery.fresh_tiles);
    let tiles = text!(
        "stats-gantt-tiles",
        node = delivery.node.0,
        from = from,
        to = to,
        twice = twice
    );
    let [requested, received] = [split.request_secs, delivery.arrived_secs].map(ms);
    let times = match delivery.expected_secs {
        Some(secs) => text!(
            "stats-gantt-times-predicted",
            requested = requested,
            received = received,
            predicted = ms(secs)
        ),
        None => text!(
            "stats-gantt-times",
            requested = requested,
            received = received
        ),
    };
    let stages = text!(
        "stats-gantt-stages",
        busy = ms(delivery.busy_secs),
        network = ms(split.network_secs),
        queue = ms(split.queue_secs),
        encode = ms(split.encode_secs),
        decode = ms(split.decode_secs)
    );
    format!("{tiles}\n{times}\n{stages}")
}

const HEIGHT_MAX: f32 = 190.0;
const ROW_MIN: f32 = 3.0;
const ROW_MAX: f32 = 16.0;
const LABEL_HEIGHT: f32 = 12.0;
const AXIS_HEIGHT: f32 = 14.0;
const NAME_WIDTH: f32 = 78.0;
const NAME_CHARS: usize = 12;
