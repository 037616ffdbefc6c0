//! The bench of the simulation: its errors, and its cost.
//!
//! ```text
//! references       every shot of a folder, against the trajectories of another simulator
//! closed-forms     sliding, rolling and spinning, against theory
//! curves           rules and curves that are published, drawn with --plot
//! breaks           many breaks of the same rack, by statistics
//! flight           balls in the air: the closed flight against rapier's solver
//! many-balls       up to 1,000 balls: what an event costs
//! engine-tradeoff  plain rapier at many settings: error against CPU time
//! ```

pub mod accuracy;
pub mod accuracy_cost;
pub mod airborne;
mod banks;
pub mod break_agreement;
mod break_outcome;
pub mod break_samples;
pub mod breaks;
pub mod closed_forms;
pub mod curves;
pub mod deviation;
pub mod infinite_table;
pub mod many_balls;
mod masse;
pub mod published_curve;
pub mod reference;
mod schema;

use std::fs;
use std::path::{Path, PathBuf};

use crate::chart::Chart;
use anyhow::Context as _;
use clap::{Args, ValueEnum};
use serde::Serialize;

use accuracy::Accuracy;
use accuracy_cost::EngineTradeoff;
use airborne::FlightRow;
use break_agreement::BreakAgreement;
use break_samples::ReferenceBreaks;
use breaks::BreakStatistic;
use closed_forms::ClosedForm;
use many_balls::ManyBallsRow;
use published_curve::PublishedCurve;
use reference::ReferenceShot;

/// Measure the errors of the simulation, and its cost.
#[derive(Clone, Debug, Args)]
pub struct PhysicsArgs {
    /// Folder of reference shots (schema phys-ref-1)
    #[arg(long, value_name = "DIR", default_value = "tests/references/physics")]
    pub references: PathBuf,
    /// Breaks that another simulator drew many times, beside which ours are laid
    #[arg(
        long,
        value_name = "FILE",
        default_value = "tests/references/breaks.json"
    )]
    pub draws: PathBuf,
    /// Print JSON in place of tables
    #[arg(long)]
    pub json: bool,
    /// Draw what was measured into this folder, as SVG
    #[arg(long, value_name = "DIR")]
    pub plot: Option<PathBuf>,
    /// Times that each break is repeated with its balls a little moved, 20 to 100000
    #[arg(long, default_value_t = 200, value_parser = clap::value_parser!(u32).range(20..=100_000))]
    pub seeds: u32,
    /// What to measure; may be given several times [default: everything]
    #[arg(long = "part", value_enum)]
    pub parts: Vec<PhysicsPart>,
}

/// A part of `carom-bench physics`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum PhysicsPart {
    /// Every shot of the folder against its reference
    References,
    /// Sliding, rolling and spinning against theory
    ClosedForms,
    /// Rules and curves that are published
    Curves,
    /// Many breaks of the same rack, by statistics
    Breaks,
    /// Balls in the air: the closed flight against rapier's solver
    Flight,
    /// Up to 1,000 balls: what an event costs
    ManyBalls,
    /// Plain rapier at many settings: error against CPU time
    EngineTradeoff,
}

/// All measured results.
#[derive(Debug, Default, Serialize)]
struct PhysicsReport {
    #[serde(flatten)]
    accuracy: Option<Accuracy>,
    #[serde(skip_serializing_if = "Option::is_none")]
    closed_forms: Option<Vec<ClosedForm>>,
    #[serde(skip_serializing_if = "Option::is_none")]
    curves: Option<Vec<PublishedCurve>>,
    #[serde(skip_serializing_if = "Option::is_none")]
    breaks: Option<Vec<BreakStatistic>>,
    #[serde(skip_serializing_if = "Option::is_none")]
    breaks_agree: Option<BreakAgreement>,
    #[serde(skip_serializing_if = "Option::is_none")]
    flight: Option<Vec<FlightRow>>,
    #[serde(skip_serializing_if = "Option::is_none")]
    many_balls: Option<Vec<ManyBallsRow>>,
    #[serde(skip_serializing_if = "Option::is_none")]
    engine_tradeoff: Option<Vec<EngineTradeoff>>,
}

impl PhysicsArgs {
    pub(crate) fn run(&self) -> anyhow::Result<()> {
        let report = self.measure()?;
        if let Some(folder) = &self.plot {
            draw(&report.charts(), folder)
                .with_context(|| format!("cannot draw into {}", folder.display()))?;
        }
        if self.json {
            println!("{}", serde_json::to_string_pretty(&report)?);
        } else {
            report.print();
        }
        Ok(())
    }

    fn measure(&self) -> anyhow::Result<PhysicsReport> {
        let wants = |part| self.parts.is_empty() || self.parts.contains(&part);
        let read = || {
            ReferenceShot::read_folder(&self.references)
                .context("--references names a folder of reference shots")
        };
        let mut report = PhysicsReport::default();
        if wants(PhysicsPart::References) {
            report.accuracy = Some(Accuracy::measure(&read()?)?);
        }
        if wants(PhysicsPart::ClosedForms) {
            report.closed_forms = Some(closed_forms::measure()?);
        }
        if wants(PhysicsPart::Curves) {
            report.curves = Some(curves::measure()?);
        }
        if wants(PhysicsPart::Breaks) {
            let theirs =
                ReferenceBreaks::read(&self.draws).context("--draws names a file of breaks")?;
            let rows = breaks::measure(&read()?, &theirs, self.seeds)?;
            report.breaks_agree = Some(BreakAgreement::of(&rows));
            report.breaks = Some(rows);
        }
        if wants(PhysicsPart::Flight) {
            report.flight = Some(airborne::measure()?);
        }
        if wants(PhysicsPart::ManyBalls) {
            report.many_balls = Some(many_balls::measure()?);
        }
        if wants(PhysicsPart::EngineTradeoff) {
            let references = read()?;
            let engines = accuracy_cost::engines().into_iter();
            let measured = engines.map(|engine| accuracy_cost::measure(engine, &references));
            report.engine_tradeoff = Some(measured.collect::<anyhow::Result<_>>()?);
        }
        Ok(report)
    }
}

impl PhysicsReport {
    /// The charts, with the names of their files.
    fn charts(&self) -> Vec<(String, Chart)> {
        let curves = self.curves.iter().flatten();
        let mut charts: Vec<_> = curves
            .map(|curve| (file_name(curve.name), curve.chart.clone()))
            .collect();
        let tradeoff = self.engine_tradeoff.iter();
        let tradeoff = tradeoff.flat_map(|engines| accuracy_cost::charts(engines));
        charts.extend(tradeoff.map(|chart| (file_name(&chart.title), chart)));
        charts
    }

    fn print(&self) {
        if let Some(accuracy) = &self.accuracy {
            println!("Reference shots\n{accuracy}");
        }
        if let Some(forms) = &self.closed_forms {
            println!(
                "Closed forms: measured, theory, relative error (bar {})",
                closed_forms::ERROR_MAX
            );
            for form in forms {
                println!("{form}");
            }
        }
        if let Some(curves) = &self.curves {
            println!("\nPublished rules and curves: largest difference in degrees");
            for curve in curves {
                println!("{curve}");
            }
            println!("{}", curves::UNPUBLISHED);
        }
        if let Some(breaks) = &self.breaks {
            println!("\nBreaks\n{}", breaks::HEADING);
            for statistic in breaks {
                println!("{statistic}");
            }
        }
        if let Some(agreement) = &self.breaks_agree {
            println!("{agreement}");
        }
        if let Some(flights) = &self.flight {
            println!(
                "\nIn the air (bar of the closed flight: {})\n{}",
                airborne::OFF_MAX,
                airborne::HEADING
            );
            for flight in flights {
                println!("{flight}");
            }
        }
        if let Some(many_balls) = &self.many_balls {
            println!("\nMany balls\n{}", many_balls::HEADING);
            for row in many_balls {
                println!("{row}");
            }
        }
        if let Some(engines) = &self.engine_tradeoff {
            let [whole, second, frame] = accuracy_cost::BARS_MS;
            println!(
                "\nEngines: error against CPU time (bars: {whole}, {second} and {frame} ms)\n{}",
                accuracy_cost::HEADING
            );
            for engine in engines {
                println!("{engine}");
            }
        }
    }
}

fn draw(charts: &[(String, Chart)], folder: &Path) -> anyhow::Result<()> {
    fs::create_dir_all(folder)?;
    for (name, chart) in charts {
        fs::write(folder.join(name), chart.svg())?;
    }
    Ok(())
}

/// Name of a chart's file: the letters and digits of its title.
fn file_name(name: &str) -> String {
    let name = name.replace('é', "e");
    let words = name.split(|c: char| !c.is_ascii_alphanumeric());
    let words: Vec<_> = words.filter(|word| !word.is_empty()).collect();
    format!("{}.svg", words.join("_"))
}
