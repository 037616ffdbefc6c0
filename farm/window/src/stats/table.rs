//! Table of the nodes in columns of fixed width: each row is a single text layout, so that sixty-four rows
//! cost no more than a page of text.

use egui::text::{LayoutJob, TextFormat};
use egui::{FontId, Response, Role, ScrollArea, Sense, Ui, Vec2, WidgetInfo};

use super::frame_record::{FrameRecord, NodeRecord};
use super::glossary::{self as terms, Term};
use super::summary::{NodeSummary, StatsSummary};
use super::value_label::ms;
use crate::theme::{ACCENT, ALARM, INK};

/// Text of the table.
#[derive(Debug, Default)]
pub(super) struct NodeRows {
    rows: Vec<NodeRow>,
}

#[derive(Debug)]
struct NodeRow {
    job: LayoutJob,
    /// Description of the node's state.
    sentence: String,
}

/// Data for a cell.
struct NodeCell<'a> {
    index: usize,
    summary: &'a NodeSummary,
    node: Option<&'a NodeRecord>,
    record: Option<&'a FrameRecord>,
}

struct TableColumn {
    term: &'static Term,
    /// Width in characters, including the gap to the next column.
    width: usize,
    cell: fn(&NodeCell<'_>) -> String,
    /// Whether the cell's value indicates a problem.
    alarm: fn(&NodeCell<'_>) -> bool,
}

impl TableColumn {
    /// Truncates or pads a text to the column's width; words are aligned left and numbers right.
    fn fit(&self, text: &str) -> String {
        let gap = self.width - 1;
        let text: String = text.chars().take(gap).collect();
        if [terms::NODE, terms::STATE, terms::DEVICE].contains(self.term) {
            format!("{text:<gap$} ")
        } else {
            format!("{text:>gap$} ")
        }
    }
}

impl NodeRows {
    /// Rebuilds the table.
    pub(super) fn refresh(&mut self, summary: &StatsSummary) {
        let record = summary.record.as_deref();
        let row = |(index, summary): (usize, &NodeSummary)| {
            let node = record.and_then(|record| record.nodes.get(index));
            let seen = NodeCell {
                index,
                summary,
                node,
                record,
            };
            let mut job = LayoutJob::default();
            for column in COLUMNS {
                let bad = (column.alarm)(&seen);
                let mut cell = (column.cell)(&seen);
                if bad {
                    cell.push('!');
                }
                job.append(&column.fit(&cell), 0.0, format(bad));
            }
            NodeRow {
                job,
                sentence: summary.state_sentence.clone(),
            }
        };
        self.rows = summary.nodes.iter().enumerate().map(row).collect();
    }

    /// Draws the visible rows; the others are reached by scrolling.
    pub(super) fn show(&self, ui: &mut Ui, height: f32) {
        let char_width = ui.fonts_mut(|fonts| fonts.glyph_width(&FontId::monospace(SIZE), '0'));
        let chars: usize = COLUMNS.iter().map(|column| column.width).sum();
        let size = Vec2::new(char_width * chars as f32, ROW_HEIGHT);
        ScrollArea::horizontal()
            .id_salt("nodes-across")
            .show(ui, |ui| {
                ui.spacing_mut().item_spacing.y = 0.0;
                ui.set_min_width(size.x);
                let header = line(ui, size, &header());
                explain(header, char_width, None);
                let room = (height - ROW_HEIGHT - SCROLL_BAR).max(2.0 * ROW_HEIGHT);
                let area = ScrollArea::vertical()
                    .id_salt("nodes")
                    .max_height(room)
                    .auto_shrink([false, true]);
                area.show_rows(ui, ROW_HEIGHT, self.rows.len(), |ui, shown| {
                    for row in &self.rows[shown] {
                        let response = line(ui, size, &row.job);
                        explain(response, char_width, Some(&row.sentence));
                    }
                });
            });
    }

    /// Height in points of the table with all its rows.
    pub(super) fn height(&self) -> f32 {
        ROW_HEIGHT * (self.rows.len() + 1) as f32 + SCROLL_BAR
    }
}

fn header() -> LayoutJob {
    let mut job = LayoutJob::default();
    for column in COLUMNS {
        let format = TextFormat {
            color: ACCENT,
            ..format(false)
        };
        job.append(&column.fit(column.term.label()), 0.0, format);
    }
    job
}

fn line(ui: &mut Ui, size: Vec2, job: &LayoutJob) -> Response {
    let (rect, response) = ui.allocate_exact_size(size, Sense::hover());
    response.widget_info(|| WidgetInfo::labeled(Role::Label, true, &job.text));
    if ui.is_rect_visible(rect) {
        let galley = ui.fonts_mut(|fonts| fonts.layout_job(job.clone()));
        ui.painter().galley(rect.min, galley, INK);
    }
    response
}

/// Shows a tooltip with the definition of the column under the pointer and, in the state's column, the
/// sentence.
fn explain(response: Response, char_width: f32, sentence: Option<&str>) {
    let Some(pointer) = response.hover_pos() else {
        return;
    };
    let mut left = response.rect.left();
    let under = COLUMNS.iter().find(|column| {
        left += column.width as f32 * char_width;
        pointer.x < left
    });
    let Some(term) = under.map(|column| column.term) else {
        return;
    };
    response.on_hover_ui_at_pointer(|ui| {
        ui.set_max_width(320.0);
        if let (true, Some(sentence)) = (*term == terms::STATE, sentence) {
            ui.label(sentence);
        }
        ui.label(term.meaning());
    });
}

fn format(bad: bool) -> TextFormat {
    TextFormat::simple(FontId::monospace(SIZE), if bad { ALARM } else { INK })
}

/// A value of the node's contribution to the picture; `-` if it took no part.
fn of_node(seen: &NodeCell<'_>, value: impl Fn(&NodeRecord) -> String) -> String {
    let took_part = seen.node.filter(|node| node.tiles > 0);
    took_part.map_or_else(|| "-".to_owned(), value)
}

/// An estimate of the node; `-` while it is unknown.
fn known(seen: &NodeCell<'_>, value: impl Fn(&NodeRecord) -> String) -> String {
    let known = seen.node.filter(|node| node.msamples_per_sec > 0.0);
    known.map_or_else(|| "-".to_owned(), value)
}

fn error(node: &NodeRecord) -> Option<f64> {
    let predicted = node.predicted_secs.filter(|secs| *secs > 0.0)?;
    Some(node.response_secs / predicted - 1.0)
}

fn ratio(seen: &NodeCell<'_>, node: &NodeRecord) -> f64 {
    let tiles: u32 = seen
        .record
        .map_or(0, |record| record.nodes.iter().map(|node| node.tiles).sum());
    let raw = seen.record.map_or(0.0, |record| record.raw_bytes as f64);
    raw * f64::from(node.tiles) / f64::from(tiles.max(1)) / node.payload_bytes.max(1) as f64
}

const fn column(
    term: &'static Term,
    width: usize,
    cell: fn(&NodeCell<'_>) -> String,
) -> TableColumn {
    TableColumn {
        term,
        width,
        cell,
        alarm: |_| false,
    }
}

const fn alarming(column: TableColumn, alarm: fn(&NodeCell<'_>) -> bool) -> TableColumn {
    TableColumn { alarm, ..column }
}

static COLUMNS: &[TableColumn] = &[
    column(&terms::NODE, 15, |s| {
        format!("{:>2} {}", s.index, s.summary.name)
    }),
    alarming(
        column(&terms::STATE, 13, |s| s.summary.state.clone()),
        |s| !s.summary.is_ready,
    ),
    column(&terms::DEVICE, 20, |s| s.summary.device.clone()),
    column(&terms::TILES, 6, |s| of_node(s, |n| n.tiles.to_string())),
    column(&terms::SHARE, 6, |s| {
        of_node(s, |n| format!("{:.1}", n.share * 1e2))
    }),
    alarming(
        column(&terms::RESPONSE, 7, |s| of_node(s, |n| ms(n.response_secs))),
        |s| {
            let is_last = s
                .record
                .is_some_and(|record| record.straggler == Some(s.index));
            is_last
                && s.record.is_some_and(|record| {
                    record.efficiency() < 0.9 && record.took_part().count() > 1
                })
        },
    ),
    column(&terms::RESPONSE_MEAN, 6, |s| ms(s.summary.mean_secs)),
    column(&terms::RESPONSE_SIGMA, 6, |s| ms(s.summary.deviation_secs)),
    column(&terms::RESPONSE_P99, 6, |s| ms(s.summary.p99_secs)),
    column(&terms::RESPONSE_MAX, 6, |s| ms(s.summary.max_secs)),
    column(&terms::NODE_NETWORK, 6, |s| {
        of_node(s, |n| ms(n.split.network_secs))
    }),
    column(&terms::NODE_QUEUE, 6, |s| {
        of_node(s, |n| ms(n.split.queue_secs))
    }),
    column(&terms::NODE_TRACE, 6, |s| {
        of_node(s, |n| ms(n.split.trace_secs))
    }),
    column(&terms::NODE_CODEC, 6, |s| {
        of_node(s, |n| ms(n.split.encode_secs + n.split.decode_secs))
    }),
    column(&terms::FIXED, 12, |s| {
        known(s, |n| {
            format!("{}±{}", ms(n.fixed_secs), ms(n.fixed_error_secs))
        })
    }),
    column(&terms::PACE, 13, |s| {
        known(s, |n| {
            let pace_secs = 1.0 / n.msamples_per_sec;
            format!("{}±{}", ms(pace_secs), ms(pace_secs * n.speed_error))
        })
    }),
    column(&terms::PREDICTED, 6, |s| {
        of_node(s, |n| n.predicted_secs.map_or_else(|| "-".to_owned(), ms))
    }),
    alarming(
        column(&terms::ERROR, 6, |s| {
            of_node(s, |n| {
                error(n).map_or_else(|| "-".to_owned(), |error| format!("{:+.0}", error * 1e2))
            })
        }),
        |s| s.node.and_then(error).is_some_and(|error| error > 0.5),
    ),
    column(&terms::NODE_BYTES, 7, |s| {
        of_node(s, |n| format!("{:.1}", n.payload_bytes as f64 * 1e-3))
    }),
    column(&terms::NODE_RATIO, 7, |s| {
        of_node(s, |n| format!("{:.1}x", ratio(s, n)))
    }),
    column(&terms::NODE_LATE, 6, |s| s.summary.late.to_string()),
    alarming(
        column(&terms::NODE_LOST, 6, |s| s.summary.lost.to_string()),
        |s| s.summary.lost > 0,
    ),
    column(&terms::NODE_TWICE, 6, |s| s.summary.twice.to_string()),
];

const SIZE: f32 = 10.5;
const ROW_HEIGHT: f32 = 14.0;
const SCROLL_BAR: f32 = 12.0;
