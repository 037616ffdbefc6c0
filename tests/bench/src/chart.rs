//! Charts as SVG: axes, lines, dots and a legend, drawn by plotters.

use std::ops::Range;

use plotters::coord::Shift;
use plotters::coord::types::RangedCoordf64;
use plotters::prelude::*;

/// A chart.
#[derive(Clone, Debug)]
pub(crate) struct Chart {
    /// Title above the plot.
    pub(crate) title: String,
    /// Horizontal axis.
    pub(crate) x: Axis,
    /// Vertical axis.
    pub(crate) y: Axis,
    /// The drawn series.
    pub(crate) series: Vec<Series>,
    /// Events: position on the x axis, and label.
    pub(crate) events: Vec<(f64, &'static str)>,
}

/// An axis, whose range follows from the points.
#[derive(Clone, Debug)]
pub(crate) struct Axis {
    /// Quantity and unit.
    pub(crate) label: &'static str,
    /// Whether it is logarithmic, with whole decades.
    pub(crate) logarithmic: bool,
}

/// A series of points.
#[derive(Clone, Debug)]
pub(crate) struct Series {
    /// Name in the legend.
    pub(crate) name: String,
    /// The points. Those that are not finite, or not above 0 on a logarithmic axis, are left out.
    pub(crate) points: Vec<(f64, f64)>,
    /// Style of the points.
    pub(crate) mark: Mark,
}

/// Style of points.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Mark {
    /// Joined by lines.
    Line,
    /// Single dots.
    Dots,
}

impl Axis {
    /// A linear axis.
    pub(crate) fn linear(label: &'static str) -> Self {
        Self {
            label,
            logarithmic: false,
        }
    }

    /// A logarithmic axis.
    pub(crate) fn logarithmic(label: &'static str) -> Self {
        Self {
            label,
            logarithmic: true,
        }
    }

    fn value(&self, v: f64) -> f64 {
        if self.logarithmic { v.log10() } else { v }
    }
}

impl Series {
    /// Points joined by lines.
    pub(crate) fn line(name: impl Into<String>, points: Vec<(f64, f64)>) -> Self {
        Self {
            name: name.into(),
            points,
            mark: Mark::Line,
        }
    }

    /// Single points.
    pub(crate) fn dots(name: impl Into<String>, points: Vec<(f64, f64)>) -> Self {
        Self {
            name: name.into(),
            points,
            mark: Mark::Dots,
        }
    }
}

impl Chart {
    /// A chart without events.
    pub(crate) fn new(title: impl Into<String>, x: Axis, y: Axis, series: Vec<Series>) -> Self {
        Self {
            title: title.into(),
            x,
            y,
            series,
            events: Vec::new(),
        }
    }

    /// The chart as the text of an SVG file.
    pub(crate) fn svg(&self) -> String {
        let mut svg = String::new();
        let area = SVGBackend::with_string(&mut svg, SIZE).into_drawing_area();
        self.draw(&area).expect("memory takes any text");
        drop(area);
        svg
    }

    fn draw<B: DrawingBackend>(&self, area: &Area<B>) -> Drawn<B> {
        area.fill(&WHITE)?;
        let points = || self.series.iter().flat_map(|series| &series.points);
        let x = self.x.range(points().map(|point| point.0));
        let y = self.y.range(points().map(|point| point.1));
        let (plot, legend) = area.split_horizontally(SIZE.0 as i32 - LEGEND_WIDTH);
        let mut chart = ChartBuilder::on(&plot)
            .caption(&self.title, (FONT, 17))
            .margin(12)
            .x_label_area_size(44)
            .y_label_area_size(62)
            .build_cartesian_2d(x.clone(), y.clone())?;
        chart
            .configure_mesh()
            .light_line_style(TRANSPARENT)
            .x_desc(self.x.label)
            .y_desc(self.y.label)
            .x_labels(self.x.labels(&x))
            .y_labels(self.y.labels(&y))
            .x_label_formatter(&|value| self.x.tick(*value))
            .y_label_formatter(&|value| self.y.tick(*value))
            .draw()?;
        for (index, series) in self.series.iter().enumerate() {
            self.draw_series(&mut chart, series, color(index))?;
            draw_legend(&legend, index, &series.name)?;
        }
        for &(at, name) in &self.events {
            draw_event(&mut chart, self.x.value(at), &y, name)?;
        }
        area.present()
    }

    fn draw_series<B: DrawingBackend>(
        &self,
        chart: &mut Plot<'_, B>,
        series: &Series,
        color: RGBColor,
    ) -> Drawn<B> {
        let places = series.points.iter();
        let places = places.map(|&(x, y)| (self.x.value(x), self.y.value(y)));
        let places = places.filter(|(x, y)| x.is_finite() && y.is_finite());
        match series.mark {
            Mark::Line => {
                chart.draw_series(LineSeries::new(places, color.stroke_width(2)))?;
            }
            Mark::Dots => {
                chart.draw_series(places.map(|place| Circle::new(place, 4, color.filled())))?;
            }
        }
        Ok(())
    }
}

impl Axis {
    /// Range of all finite values with a margin, or of whole decades of a logarithmic axis.
    fn range(&self, values: impl Iterator<Item = f64>) -> Range<f64> {
        let finite = values
            .map(|value| self.value(value))
            .filter(|v| v.is_finite());
        let (mut low, mut high) = finite.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| {
            (l.min(v), h.max(v))
        });
        if low > high {
            (low, high) = (0.0, 1.0);
        }
        if self.logarithmic {
            (low, high) = (low.floor(), high.ceil());
        }
        if high - low < 1e-12 {
            (low, high) = (low - 0.5, high + 0.5);
        }
        let room = match self.logarithmic {
            true => 0.0,
            false => 0.04 * (high - low),
        };
        low - room..high + room
    }

    /// Maximum number of labels: with one more, plotters would label fractions of a decade.
    fn labels(&self, range: &Range<f64>) -> usize {
        match self.logarithmic {
            true => (range.end - range.start) as usize + 1,
            false => LABELS_MAX,
        }
    }

    /// The label of a place on the axis.
    fn tick(&self, place: f64) -> String {
        let value = match self.logarithmic {
            true => 10f64.powf(place),
            false => place,
        };
        if value != 0.0 && !(1e-3..1e5).contains(&value.abs()) {
            return format!("{value:.0e}");
        }
        let digits = format!("{value:.4}");
        let digits = digits.trim_end_matches('0').trim_end_matches('.');
        digits.to_owned()
    }
}

fn draw_legend<B: DrawingBackend>(area: &Area<B>, index: usize, name: &str) -> Drawn<B> {
    let y = 44 + 21 * index as i32;
    let swatch = [(0, y + 3), (16, y + 7)];
    area.draw(&Rectangle::new(swatch, color(index).filled()))?;
    area.draw(&Text::new(name.to_owned(), (22, y), (FONT, 13)))
}

fn draw_event<B: DrawingBackend>(
    chart: &mut Plot<'_, B>,
    x: f64,
    y: &Range<f64>,
    name: &str,
) -> Drawn<B> {
    let line = DashedLineSeries::new([(x, y.start), (x, y.end)], 4, 3, GREY.stroke_width(1));
    chart.draw_series(line)?;
    let place = (x, y.start + 0.05 * (y.end - y.start));
    let text = Text::new(
        format!(" {name}"),
        place,
        (FONT, 13).into_font().color(&GREY),
    );
    chart.draw_series([text])?;
    Ok(())
}

fn color(index: usize) -> RGBColor {
    COLORS[index % COLORS.len()]
}

type Area<B> = DrawingArea<B, Shift>;
type Plot<'a, B> = ChartContext<'a, B, Cartesian2d<RangedCoordf64, RangedCoordf64>>;
type Drawn<B> = Result<(), DrawingAreaErrorKind<<B as DrawingBackend>::ErrorType>>;

const SIZE: (u32, u32) = (860, 480);
const LEGEND_WIDTH: i32 = 248;
const LABELS_MAX: usize = 8;
const FONT: &str = "sans-serif";
const GREY: RGBColor = RGBColor(85, 85, 85);
/// Colours that the colour-blind can tell apart as well: Okabe and Ito (2008).
const COLORS: [RGBColor; 10] = [
    RGBColor(0x00, 0x72, 0xb2),
    RGBColor(0xd5, 0x5e, 0x00),
    RGBColor(0x00, 0x9e, 0x73),
    RGBColor(0xcc, 0x79, 0xa7),
    RGBColor(0x56, 0xb4, 0xe9),
    RGBColor(0xe6, 0x9f, 0x00),
    RGBColor(0x55, 0x55, 0x55),
    RGBColor(0xb0, 0xa0, 0x00),
    RGBColor(0x00, 0x00, 0x00),
    RGBColor(0x88, 0x22, 0x55),
];

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn chart_places_finite_points_between_axes() {
        let chart = Chart {
            title: "a < b & c".to_owned(),
            x: Axis::linear("x, m"),
            y: Axis::logarithmic("y, s"),
            series: vec![
                Series::dots(
                    "one",
                    vec![(0.0, 1.0), (2.0, 1000.0), (1.0, f64::NAN), (1.0, 0.0)],
                ),
                Series::line("none", Vec::new()),
                Series::line("two", vec![(0.0, 1.0), (2.0, 1000.0)]),
            ],
            events: vec![(1.0, "half > way")],
        };
        let svg = chart.svg();
        assert_eq!(
            svg.matches("<circle").count(),
            2,
            "what has no place is left out"
        );
        for text in [
            "a &lt; b &amp; c",
            "half &gt; way",
            "one",
            "two",
            "x, m",
            "y, s",
        ] {
            assert!(svg.contains(text), "{text}: {svg}");
        }
        for tick in ["0", "0.5", "1", "2", "10", "100", "1000"] {
            assert!(svg.contains(&format!("\n{tick}\n")), "{tick}: {svg}");
        }
    }

    #[test]
    fn chart_without_points_has_axes() {
        let chart = Chart {
            title: String::new(),
            x: Axis::linear("x"),
            y: Axis::logarithmic("y"),
            series: Vec::new(),
            events: Vec::new(),
        };
        assert!(chart.svg().ends_with("</svg>\n"));
    }
}
