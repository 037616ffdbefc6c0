//! Command line of the viewer.

use std::path::PathBuf;

use carom_tracer::{ImageSize, RenderSettings};
use carom_window::args::WindowArgs;
use clap::Parser;

use crate::render::Accuracy;

/// View a scene, path-traced by a farm of any mix of GPUs and CPUs.
///
/// Without options this machine traces the pictures. F1 shows the controls.
#[derive(Clone, Debug, Parser)]
#[command(name = "carom-view", version)]
pub struct Args {
    /// Scene to open: a .json, .gltf, .glb, .obj or .ply file; others can be dropped on the window
    #[arg(value_name = "FILE")]
    pub scene: Option<PathBuf>,
    /// Size of the window in pixels
    #[arg(long, value_name = "WxH", default_value = "1280x720")]
    pub size: ImageSize,
    /// Samples per pixel that are gathered while nothing changes
    #[arg(long, default_value_t = 1024, value_parser = clap::value_parser!(u32).range(1..=i64::from(RenderSettings::SAMPLES_MAX)))]
    pub spp: u32,
    /// Limit paths to this many surface scattering events
    #[arg(long, default_value_t = 5, value_parser = clap::value_parser!(u32).range(0..=64))]
    pub max_depth: u32,
    /// Exposure at the start: radiance is shown times two to the power of this, -10 to 10
    #[arg(long, value_name = "STOPS", default_value_t = 0.0, allow_negative_numbers = true, value_parser = stops)]
    pub exposure: f32,
    /// Where pictures are traced, and how they are shown.
    #[command(flatten)]
    pub window: WindowArgs,
}

impl Args {
    /// The accuracy with which pictures are traced.
    pub fn accuracy(&self) -> Accuracy {
        Accuracy {
            samples: self.spp,
            max_depth: self.max_depth,
        }
    }
}

fn stops(text: &str) -> Result<f32, String> {
    let most = crate::viewer::STOPS_MAX;
    let stops: Option<f32> = text.parse().ok();
    let stops = stops.filter(|stops| (-most..=most).contains(stops));
    stops.ok_or_else(|| format!("it must be a number from -{most} to {most}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_command_line_is_consistent() {
        <Args as clap::CommandFactory>::command().debug_assert();
    }

    #[test]
    fn values_out_of_range_are_refused() {
        for words in [
            ["--exposure", "11"],
            ["--exposure", "nan"],
            ["--spp", "0"],
            ["--size", "0x5"],
        ] {
            let refused = Args::try_parse_from(["carom-view"].into_iter().chain(words));
            let said = refused.unwrap_err().to_string();
            assert!(said.contains(words[0]), "{said}");
        }
    }
}
