//! Materials of the balls.

use carom_billiards::rules::RuleSet;
use carom_tracer::{Material, Medium, ProceduralTexture, Stripe};
use clap::ValueEnum;
use glam::Vec3;

/// A set of sixteen balls.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub enum BallSet {
    /// Phenolic resin with numbers and stripes
    #[default]
    Classic,
    /// Glass with numbers: stripes are paler, and each ball throws its colour onto the cloth
    Glass,
    /// Jade and other translucent stone with numbers: stripes are paler
    Jade,
    /// Anodised metal in the balls' colours, with numbers: solids polished, stripes brushed
    Metal,
}

impl BallSet {
    /// All sets.
    pub const ALL: [Self; 4] = [Self::Classic, Self::Glass, Self::Jade, Self::Metal];

    /// Material of the ball of a number in a game; 0 is the cue ball. The balls of snooker and carom
    /// have neither numbers nor stripes.
    pub fn material(self, rules: RuleSet, number: u8) -> Material {
        let is_numbered = !matches!(rules, RuleSet::Snooker | RuleSet::ThreeCushion);
        let colour = ball_colour(rules, number);
        let is_striped = is_numbered && number > 8;
        let number = if is_numbered { number } else { 0 };
        match self {
            Self::Classic => classic(number, colour, is_striped),
            Self::Glass => {
                // Beer–Lambert extinction: light is attenuated to the colour over this distance; stripes
                // are paler.
                let depth_m = if is_striped { 0.45 } else { 0.2 };
                let extinction = -colour.max(Vec3::splat(0.05)).map(f32::ln) / depth_m;
                dielectric(1.5, extinction, Vec3::ZERO, number)
            }
            Self::Jade => {
                let stone = if is_striped {
                    colour.lerp(CREAM, 0.45)
                } else {
                    colour
                };
                // Single-scattering albedo for which a half-space reflects the colour, a fit of Chiang et
                // al., "Practical and Controllable Subsurface Scattering for Production Path Tracing",
                // SIGGRAPH 2016 talks.
                let albedo = stone
                    .max(Vec3::splat(0.03))
                    .map(|c| 1.0 - (((-4.318_05 * c + 2.611_88) * c - 5.094_06) * c).exp());
                dielectric(1.55, Vec3::splat(160.0), albedo, number)
            }
            Self::Metal => {
                let sheen = if is_striped {
                    colour.lerp(CREAM, 0.25)
                } else {
                    colour
                };
                tinted_metal(sheen, if is_striped { 0.22 } else { 0.04 }, number)
            }
        }
    }

    /// Maximum path depth that the set needs: paths enter and leave glass, and scatter within
    /// stone. Time is proportional to the length of paths.
    pub fn max_depth(self) -> u32 {
        match self {
            Self::Classic | Self::Metal => 5,
            Self::Glass => 9,
            Self::Jade => 32,
        }
    }
}

fn classic(number: u8, colour: Vec3, is_striped: bool) -> Material {
    let stripe = is_striped.then_some(Stripe {
        albedo: colour,
        half_width: 0.5,
    });
    Material::Coated {
        ior: 1.5,
        alpha: 0.0,
        texture: ProceduralTexture::Ball {
            albedo: if is_striped { CREAM } else { colour },
            stripe,
            number,
        },
    }
}

fn dielectric(ior: f32, extinction: Vec3, albedo: Vec3, number: u8) -> Material {
    Material::Dielectric {
        ior,
        alpha: 0.0,
        medium: Some(Medium { extinction, albedo }),
        number,
    }
}

/// A metal that reflects a colour R at normal incidence. With η = 1 the Fresnel equations give R = k² / (4
/// + k²), which is solved for k.
fn tinted_metal(colour: Vec3, alpha: f32, number: u8) -> Material {
    let reflectance = colour.clamp(Vec3::splat(0.04), Vec3::splat(0.95));
    let k = (4.0 * reflectance / (1.0 - reflectance)).map(f32::sqrt);
    Material::Conductor {
        eta: Vec3::ONE,
        k,
        alpha,
        number,
    }
}

/// Albedo of a ball's own colour in a game, linear Rec. 709; 0 is the cue ball.
pub fn ball_colour(rules: RuleSet, number: u8) -> Vec3 {
    match rules {
        RuleSet::Snooker => snooker_colour(number),
        RuleSet::ThreeCushion => carom_colour(number),
        _ => colour(number),
    }
}

/// Albedo of snooker's balls: 1 to 15 are red, 16 to 21 worth 2 to 7.
fn snooker_colour(number: u8) -> Vec3 {
    match number {
        1..=15 => Vec3::new(0.45, 0.01, 0.012),
        16 => Vec3::new(0.8, 0.58, 0.03),
        17 => Vec3::new(0.01, 0.16, 0.06),
        18 => Vec3::new(0.2, 0.07, 0.02),
        19 => Vec3::new(0.02, 0.08, 0.5),
        20 => Vec3::new(0.8, 0.3, 0.35),
        21 => Vec3::splat(0.012),
        _ => CREAM,
    }
}

/// Albedo of carom's balls: the two cue balls are white and yellow, the third is red.
fn carom_colour(number: u8) -> Vec3 {
    match number {
        1 => Vec3::new(0.8, 0.58, 0.03),
        2 => Vec3::new(0.55, 0.015, 0.015),
        _ => CREAM,
    }
}

/// Albedo of a number's colour.
fn colour(number: u8) -> Vec3 {
    match number {
        1 | 9 => Vec3::new(0.8, 0.52, 0.02),
        2 | 10 => Vec3::new(0.02, 0.06, 0.42),
        3 | 11 => Vec3::new(0.6, 0.02, 0.02),
        4 | 12 => Vec3::new(0.13, 0.03, 0.28),
        5 | 13 => Vec3::new(0.75, 0.2, 0.02),
        6 | 14 => Vec3::new(0.01, 0.22, 0.07),
        7 | 15 => Vec3::new(0.26, 0.03, 0.02),
        8 => Vec3::splat(0.012),
        _ => CREAM,
    }
}

const CREAM: Vec3 = Vec3::new(0.8, 0.78, 0.7);
