//! `carom-bench physics`: how right the simulation is, and what it costs:
//!
//! ```text
//! references    every shot of a folder, against the trajectories of another simulator
//! closed-forms  sliding, rolling and spinning, against theory
//! curves        rules and curves that are published, drawn with --plot
//! breaks        many breaks of the same rack, by statistics
//! air           balls in the air: the closed flight against rapier's solver
//! crowd         up to 1,000 balls: what an event costs
//! trade         plain rapier at many settings: error against CPU time
//! ```

pub mod accuracy;
pub mod air;
mod banks;
pub mod breaks;
pub mod closed_forms;
pub mod crowd;
pub mod curves;
pub mod deviation;
pub mod draws;
pub mod infinite_table;
mod masse;
pub mod reference;
mod schema;
pub mod trade;

use std::fs;
use std::path::{Path, PathBuf};

use crate::chart::Chart;
use anyhow::Context as _;
use clap::{Args, ValueEnum};
use serde::Serialize;

use accuracy::Accuracy;
use air::Air;
use breaks::BreakStatistic;
use closed_forms::ClosedForm;
use crowd::Crowd;
use curves::Curve;
use draws::{Agreement, Draws};
use reference::Reference;
use trade::Trade;

/// Options of `carom-bench physics`.
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
    pub parts: Vec<Part>,
}

/// A part of `carom-bench physics`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Part {
    /// Every shot of the folder against its reference
    References,
    /// Sliding, rolling and spinning against theory
    ClosedForms,
    /// Rules and curves that are published
    Curves,
    /// Many breaks of the same rack, by statistics
    Breaks,
    /// Balls in the air: the closed flight against rapier's solver
    Air,
    /// Up to 1,000 balls: what an event costs
    Crowd,
    /// Plain rapier at many settings: error against CPU time
    Trade,
}

/// All that was measured.
#[derive(Debug, Default, Serialize)]
struct Report {
    #[serde(flatten)]
    accuracy: Option<Accuracy>,
    #[serde(skip_serializing_if = "Option::is_none")]
    closed_forms: Option<Vec<ClosedForm>>,
    #[serde(skip_serializing_if = "Option::is_none")]
    curves: Option<Vec<Curve>>,
    #[serde(skip_serializing_if = "Option::is_none")]
    breaks: Option<Vec<BreakStatistic>>,
    #[serde(skip_serializing_if = "Option::is_none")]
    breaks_agree: Option<Agreement>,
    #[serde(skip_serializing_if = "Option::is_none")]
    air: Option<Vec<Air>>,
    #[serde(skip_serializing_if = "Option::is_none")]
    crowd: Option<Vec<Crowd>>,
    #[serde(skip_serializing_if = "Option::is_none")]
    trade: Option<Vec<Trade>>,
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

    fn measure(&self) -> anyhow::Result<Report> {
        let wants = |part| self.parts.is_empty() || self.parts.contains(&part);
        let read = || {
            Reference::read_folder(&self.references)
                .context("--references names a folder of reference shots")
        };
        let mut report = Report::default();
        if wants(Part::References) {
            report.accuracy = Some(Accuracy::measure(&read()?)?);
        }
        if wants(Part::ClosedForms) {
            report.closed_forms = Some(closed_forms::measure()?);
        }
        if wants(Part::Curves) {
            report.curves = Some(curves::measure()?);
        }
        if wants(Part::Breaks) {
            let theirs = Draws::read(&self.draws).context("--draws names a file of breaks")?;
            let rows = breaks::measure(&read()?, &theirs, self.seeds)?;
            report.breaks_agree = Some(Agreement::of(&rows));
            report.breaks = Some(rows);
        }
        if wants(Part::Air) {
            report.air = Some(air::measure()?);
        }
        if wants(Part::Crowd) {
            report.crowd = Some(crowd::measure()?);
        }
        if wants(Part::Trade) {
            let references = read()?;
            let engines = trade::engines().into_iter();
            let measured = engines.map(|engine| trade::measure(engine, &references));
            report.trade = Some(measured.collect::<anyhow::Result<_>>()?);
        }
        Ok(report)
    }
}

impl Report {
    /// With the names of their files.
    fn charts(&self) -> Vec<(String, Chart)> {
        let curves = self.curves.iter().flatten();
        let mut charts: Vec<_> = curves
            .map(|curve| (file_name(curve.name), curve.chart.clone()))
            .collect();
        let trade = self.trade.iter().flat_map(|trades| trade::charts(trades));
        charts.extend(trade.map(|chart| (file_name(&chart.title), chart)));
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
        if let Some(airs) = &self.air {
            println!(
                "\nIn the air (bar of the closed flight: {})\n{}",
                air::OFF_MAX,
                air::HEADING
            );
            for air in airs {
                println!("{air}");
            }
        }
        if let Some(crowds) = &self.crowd {
            println!("\nCrowds\n{}", crowd::HEADING);
            for crowd in crowds {
                println!("{crowd}");
            }
        }
        if let Some(trades) = &self.trade {
            let [whole, second, frame] = trade::BARS_MS;
            println!(
                "\nThe trade (bars: {whole}, {second} and {frame} ms)\n{}",
                trade::HEADING
            );
            for trade in trades {
                println!("{trade}");
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

/// Letters and digits of a chart's name.
fn file_name(name: &str) -> String {
    let name = name.replace('é', "e");
    let words = name.split(|c: char| !c.is_ascii_alphanumeric());
    let words: Vec<_> = words.filter(|word| !word.is_empty()).collect();
    format!("{}.svg", words.join("_"))
}
