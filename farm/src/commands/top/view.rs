//! Table of a farm's nodes in a terminal.

use ratatui::Frame;
use ratatui::buffer::Buffer;
use ratatui::layout::{Constraint, Layout, Rect};
use ratatui::style::{Color, Style, Stylize as _};
use ratatui::text::Line;
use ratatui::widgets::{Row, Table, Widget};

use super::figures::{NodeHealth, NodeRates};

const COLUMNS: [(&str, Constraint); 10] = [
    ("node", Constraint::Fill(1)),
    ("address", Constraint::Length(21)),
    ("state", Constraint::Length(8)),
    ("players", Constraint::Length(7)),
    ("busy", Constraint::Length(5)),
    ("share", Constraint::Length(7)),
    ("Msample/s", Constraint::Length(9)),
    ("tiles/s", Constraint::Length(8)),
    ("response", Constraint::Length(9)),
    ("Mbit/s", Constraint::Length(7)),
];

/// Draws the rows from `first_row` on, with the sums below.
pub(super) fn draw(frame: &mut Frame<'_>, rows: &[NodeRates], first_row: usize) {
    let sums = sums(rows) + "  (q ends)";
    render(frame.area(), frame.buffer_mut(), rows, first_row, sums);
}

/// The table as text, with the reasons of nodes that do not answer below.
pub(super) fn text(rows: &[NodeRates]) -> String {
    let height = (rows.len() + 2).min(usize::from(u16::MAX / TEXT_WIDTH)) as u16;
    let area = Rect::new(0, 0, TEXT_WIDTH, height);
    let mut buffer = Buffer::empty(area);
    render(area, &mut buffer, rows, 0, sums(rows));
    let line = |y| {
        let cells = (0..area.width).filter_map(|x| buffer.cell((x, y)));
        let line: String = cells.map(ratatui::buffer::Cell::symbol).collect();
        line.trim_end().to_owned() + "\n"
    };
    let silent = rows.iter().filter_map(|row| {
        let why = row.silence()?;
        Some(format!("{} does not answer: {why}\n", row.address))
    });
    (0..area.height).map(line).chain(silent).collect()
}

/// Width of the text in columns, for files and mails written with `--once`.
const TEXT_WIDTH: u16 = 120;

fn render(area: Rect, buffer: &mut Buffer, rows: &[NodeRates], first_row: usize, sums: String) {
    let [table_area, sums_area] =
        Layout::vertical([Constraint::Fill(1), Constraint::Length(1)]).areas(area);
    let header = Row::new(COLUMNS.map(|(title, _)| title)).style(Style::new().bold());
    let shown = rows.iter().skip(first_row).map(row);
    let table = Table::new(shown, COLUMNS.map(|(_, width)| width)).header(header);
    Widget::render(table, table_area, buffer);
    Line::from(sums).bold().render(sums_area, buffer);
}

fn row(node: &NodeRates) -> Row<'static> {
    let name = match (&*node.name, &*node.device) {
        ("", "") => String::new(),
        (name, device) => format!("{name}: {device}"),
    };
    let (state, style) = match &node.state {
        NodeHealth::Ready => ("ready", Style::new()),
        NodeHealth::Draining => ("draining", Style::new().fg(Color::Yellow)),
        NodeHealth::Silent(why) => {
            let cells = [why.clone(), node.address.clone(), "silent".to_owned()];
            return Row::new(cells).style(Style::new().fg(Color::Red));
        }
    };
    let response = node
        .response_ms
        .map_or_else(|| "-".to_owned(), |ms| format!("{ms:.1} ms"));
    Row::new([
        name,
        node.address.clone(),
        state.to_owned(),
        format!("{:7.0}", node.players),
        format!("{:3.0} %", 100.0 * node.busy),
        format!("{:5.1} %", 100.0 * node.share),
        format!("{:9.2}", node.msamples_per_sec),
        format!("{:8.1}", node.tiles_per_sec),
        format!("{response:>9}"),
        format!("{:7.2}", node.mbits_per_sec),
    ])
    .style(style)
}

fn sums(rows: &[NodeRates]) -> String {
    let answering = rows.iter().filter(|row| row.silence().is_none()).count();
    let sum = |value: fn(&NodeRates) -> f64| rows.iter().map(value).sum::<f64>();
    format!(
        "{answering} of {} nodes answer: {:.2} Msample/s, {:.1} tiles/s, {:.2} Mbit/s",
        rows.len(),
        sum(|row| row.msamples_per_sec),
        sum(|row| row.tiles_per_sec),
        sum(|row| row.mbits_per_sec)
    )
}

#[cfg(test)]
mod tests {
    use ratatui::Terminal;
    use ratatui::backend::TestBackend;

    use super::*;

    fn nodes() -> Vec<NodeRates> {
        let node = |index: usize| NodeRates {
            address: format!("10.0.0.{index}:8433"),
            name: format!("oak{index}"),
            device: "L4".into(),
            share: 0.25,
            msamples_per_sec: 12.5,
            response_ms: Some(4.2),
            mbits_per_sec: 48.0,
            ..NodeRates::default()
        };
        let mut nodes: Vec<NodeRates> = (0..4).map(node).collect();
        nodes[3].state = NodeHealth::Silent("connection refused".into());
        nodes
    }

    fn screen(first_row: usize, height: u16) -> String {
        let mut terminal = Terminal::new(TestBackend::new(120, height)).unwrap();
        terminal
            .draw(|frame| draw(frame, &nodes(), first_row))
            .unwrap();
        terminal.backend().to_string()
    }

    #[test]
    fn nodes_shares_response_times_and_bytes_are_shown() {
        let screen = screen(0, 8);
        for text in [
            "oak0: L4",
            "10.0.0.1:8433",
            "25.0 %",
            "4.2 ms",
            "48.00",
            "connection refused",
        ] {
            assert!(screen.contains(text), "{text}: {screen}");
        }
        assert!(
            screen.contains("3 of 4 nodes answer: 50.00 Msample/s"),
            "{screen}"
        );
    }

    #[test]
    fn rows_are_scrolled_and_the_sums_stay() {
        let screen = screen(2, 4);
        assert!(
            !screen.contains("oak1") && screen.contains("oak2"),
            "{screen}"
        );
        assert!(screen.contains("3 of 4 nodes answer"), "{screen}");
    }

    #[test]
    fn the_text_has_a_line_a_node_and_why_one_is_silent() {
        let text = text(&nodes());
        assert_eq!(text.lines().count(), 7, "{text}");
        assert!(
            text.lines().nth(1).unwrap().starts_with("oak0: L4"),
            "{text}"
        );
        let last = text.lines().last().unwrap();
        assert_eq!(last, "10.0.0.3:8433 does not answer: connection refused");
    }
}
