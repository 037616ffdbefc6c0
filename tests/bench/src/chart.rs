//! Charts as SVG, for benches here and in applications: axes, lines, dots and a legend, nothing
//! more.

use std::fmt::Write as _;

/// A chart.
#[derive(Clone, Debug)]
pub(crate) struct Chart {
    /// Above it.
    pub(crate) title: String,
    /// Under it: quantity and unit.
    pub(crate) x: Axis,
    /// Beside it: quantity and unit.
    pub(crate) y: Axis,
    /// What is drawn.
    pub(crate) series: Vec<Series>,
    /// What happened where on the x axis.
    pub(crate) events: Vec<(f64, &'static str)>,
}

/// An axis, as wide as what is drawn needs.
#[derive(Clone, Debug)]
pub(crate) struct Axis {
    /// Quantity and unit.
    pub(crate) label: &'static str,
    /// Whether it counts in powers of ten.
    pub(crate) logarithmic: bool,
}

/// Points of one kind.
#[derive(Clone, Debug)]
pub(crate) struct Series {
    /// In the legend.
    pub(crate) name: String,
    /// Any that are not finite, or not over 0 on a logarithmic axis, are left out.
    pub(crate) points: Vec<(f64, f64)>,
    /// How they are drawn.
    pub(crate) mark: Mark,
}

/// How points are drawn.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Mark {
    /// Joined.
    Line,
    /// Each by itself.
    Dots,
}

impl Axis {
    /// Equal steps.
    pub(crate) fn linear(label: &'static str) -> Self {
        Self {
            label,
            logarithmic: false,
        }
    }

    /// Powers of ten.
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
    /// Joined points.
    pub(crate) fn line(name: impl Into<String>, points: Vec<(f64, f64)>) -> Self {
        Self {
            name: name.into(),
            points,
            mark: Mark::Line,
        }
    }

    /// Points by themselves.
    pub(crate) fn dots(name: impl Into<String>, points: Vec<(f64, f64)>) -> Self {
        Self {
            name: name.into(),
            points,
            mark: Mark::Dots,
        }
    }
}

impl Chart {
    /// The chart as a file.
    pub(crate) fn svg(&self) -> String {
        let points = || self.series.iter().flat_map(|series| &series.points);
        let x = Scale::over(&self.x, points().map(|p| p.0), LEFT, WIDTH - RIGHT);
        let y = Scale::over(&self.y, points().map(|p| p.1), HEIGHT - BOTTOM, TOP);
        let mut svg = format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{WIDTH}\" height=\"{HEIGHT}\" \
             font-family=\"sans-serif\" font-size=\"13\">\n\
             <rect width=\"100%\" height=\"100%\" fill=\"white\"/>\n\
             <text x=\"{LEFT}\" y=\"26\" font-size=\"17\">{}</text>\n",
            escaped(&self.title)
        );
        self.draw_axes(&mut svg, &x, &y);
        for (index, series) in self.series.iter().enumerate() {
            let color = COLORS[index % COLORS.len()];
            draw_series(&mut svg, series, color, &x, &y);
            let at = TOP + 12.0 + 21.0 * index as f64;
            let mark = WIDTH - RIGHT + 14.0;
            let _ = writeln!(
                svg,
                "<rect x=\"{mark}\" y=\"{}\" width=\"16\" height=\"4\" fill=\"{color}\"/>\
                 <text x=\"{}\" y=\"{at}\">{}</text>",
                at - 7.0,
                mark + 22.0,
                escaped(&series.name)
            );
        }
        for &(at, what) in &self.events {
            draw_event(&mut svg, &x, at, what);
        }
        svg.push_str("</svg>\n");
        svg
    }

    fn draw_axes(&self, svg: &mut String, x: &Scale, y: &Scale) {
        let (right, bottom) = (WIDTH - RIGHT, HEIGHT - BOTTOM);
        for (at, label) in x.ticks() {
            let _ = writeln!(
                svg,
                "<path d=\"M{at:.1} {TOP}V{bottom}\" stroke=\"#ddd\"/>\
                 <text x=\"{at:.1}\" y=\"{}\" text-anchor=\"middle\">{label}</text>",
                bottom + 18.0
            );
        }
        for (at, label) in y.ticks() {
            let _ = writeln!(
                svg,
                "<path d=\"M{LEFT} {at:.1}H{right}\" stroke=\"#ddd\"/>\
                 <text x=\"{}\" y=\"{:.1}\" text-anchor=\"end\">{label}</text>",
                LEFT - 7.0,
                at + 4.0
            );
        }
        let middle = (0.5 * (LEFT + right), 0.5 * (TOP + bottom));
        let _ = writeln!(
            svg,
            "<path d=\"M{LEFT} {TOP}V{bottom}H{right}\" stroke=\"black\" fill=\"none\"/>\
             <text x=\"{}\" y=\"{}\" text-anchor=\"middle\">{}</text>\
             <text transform=\"translate(18 {}) rotate(-90)\" text-anchor=\"middle\">{}</text>",
            middle.0,
            HEIGHT - 12.0,
            escaped(self.x.label),
            middle.1,
            escaped(self.y.label)
        );
    }
}

fn draw_event(svg: &mut String, x: &Scale, at: f64, what: &str) {
    let Some(at) = x.place(at) else {
        return;
    };
    let bottom = HEIGHT - BOTTOM;
    let _ = writeln!(
        svg,
        "<path d=\"M{at:.1} {TOP}V{bottom}\" stroke=\"#555\" stroke-dasharray=\"4 3\"/>\
         <text x=\"{:.1}\" y=\"{}\" fill=\"#555\">{}</text>",
        at + 4.0,
        bottom - 6.0,
        escaped(what)
    );
}

fn draw_series(svg: &mut String, series: &Series, color: &str, x: &Scale, y: &Scale) {
    let place = |&(px, py): &(f64, f64)| Some((x.place(px)?, y.place(py)?));
    let places = series.points.iter().filter_map(place);
    match series.mark {
        Mark::Line => {
            // A path stays open: some viewers join a polyline's end to its beginning.
            let way: Vec<_> = places.map(|(x, y)| format!("{x:.1} {y:.1}")).collect();
            if !way.is_empty() {
                let _ = writeln!(
                    svg,
                    "<path d=\"M{}\" fill=\"none\" stroke=\"{color}\" stroke-width=\"2\"/>",
                    way.join("L")
                );
            }
        }
        Mark::Dots => {
            for (x, y) in places {
                let _ = writeln!(
                    svg,
                    "<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"4\" fill=\"{color}\"/>"
                );
            }
        }
    }
}

/// From values to places on the chart.
struct Scale<'a> {
    axis: &'a Axis,
    low: f64,
    high: f64,
    from: f64,
    to: f64,
}

impl<'a> Scale<'a> {
    fn over(axis: &'a Axis, values: impl Iterator<Item = f64>, from: f64, to: f64) -> Self {
        let finite = values.map(|v| axis.value(v)).filter(|v| v.is_finite());
        let (mut low, mut high) = finite.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| {
            (l.min(v), h.max(v))
        });
        if low > high {
            (low, high) = (0.0, 1.0);
        }
        if axis.logarithmic {
            (low, high) = (low.floor(), high.ceil());
        }
        if high - low < 1e-12 {
            (low, high) = (low - 0.5, high + 0.5);
        }
        let room = if axis.logarithmic {
            0.0
        } else {
            0.04 * (high - low)
        };
        Self {
            axis,
            low: low - room,
            high: high + room,
            from,
            to,
        }
    }

    fn place(&self, value: f64) -> Option<f64> {
        let v = self.axis.value(value);
        v.is_finite()
            .then(|| self.from + (self.to - self.from) * (v - self.low) / (self.high - self.low))
    }

    /// Places of round values, with their names.
    fn ticks(&self) -> Vec<(f64, String)> {
        let span = self.high - self.low;
        let least = span / TICKS_MAX;
        let power = 10f64.powf(least.log10().floor());
        let round = [1.0, 2.0, 5.0, 10.0].map(|digit| digit * power);
        let step = round
            .into_iter()
            .find(|step| *step >= least)
            .unwrap_or(least);
        let step = if self.axis.logarithmic {
            step.ceil()
        } else {
            step
        };
        let first = (self.low / step).ceil() as i64;
        let last = (self.high / step + 1e-9).floor() as i64;
        let tick = |i: i64| {
            let v = i as f64 * step;
            let value = if self.axis.logarithmic {
                10f64.powf(v)
            } else {
                v
            };
            Some((self.place(value)?, name(value)))
        };
        (first..=last).filter_map(tick).collect()
    }
}

fn name(value: f64) -> String {
    if value != 0.0 && !(1e-3..1e5).contains(&value.abs()) {
        return format!("{value:.0e}");
    }
    let digits = format!("{value:.4}");
    digits
        .trim_end_matches('0')
        .trim_end_matches('.')
        .to_owned()
}

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;")
        .replace('<', "&lt;")
        .replace('>', "&gt;")
}

/// Round values beside an axis.
const TICKS_MAX: f64 = 8.0;
const WIDTH: f64 = 860.0;
const HEIGHT: f64 = 480.0;
const LEFT: f64 = 76.0;
const RIGHT: f64 = 260.0;
const TOP: f64 = 44.0;
const BOTTOM: f64 = 56.0;
/// Told apart also by the colour-blind: Okabe and Ito (2008).
const COLORS: [&str; 10] = [
    "#0072b2", "#d55e00", "#009e73", "#cc79a7", "#56b4e9", "#e69f00", "#555555", "#b0a000",
    "#000000", "#882255",
];

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_chart_places_points_between_its_axes() {
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
        let open = svg.matches("stroke-width=\"2\"").count();
        assert_eq!((open, svg.contains("polyline")), (1, false), "{svg}");
        assert!(svg.contains("a &lt; b &amp; c"));
        assert!(svg.contains("half &gt; way"));
        assert!(
            svg.contains(&format!("cy=\"{:.1}\"", HEIGHT - BOTTOM)),
            "{svg}"
        );
        assert!(svg.contains(&format!("cy=\"{TOP:.1}\"")), "{svg}");
        for tick in [">0<", ">2<", ">1<", ">10<", ">1000<"] {
            assert!(svg.contains(tick), "{tick}: {svg}");
        }
    }
}
