//! Closed forms of sliding, rolling and spinning, compared with the simulation.

use std::fmt;

use glam::DVec3;
use serde::Serialize;

use super::infinite_table::{ball, first_secs, released, single_ball};
use carom_billiards::physics::{BallBody, Cloth, EventKind, Laws};

/// One quantity, measured and in theory.
#[derive(Clone, Debug, Serialize)]
pub struct ClosedForm {
    /// Name of the quantity, with the case.
    pub name: String,
    /// Simulated value, in SI units.
    pub measured: f64,
    /// Theoretical value, in SI units.
    pub theory: f64,
    /// |measured − theory| / theory.
    pub error: f64,
}

impl ClosedForm {
    fn new(name: String, measured: f64, theory: f64) -> Self {
        Self {
            name,
            measured,
            theory,
            error: ((measured - theory) / theory).abs(),
        }
    }
}

impl fmt::Display for ClosedForm {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "{:44} {:18.12} {:18.12}  {:.1e}",
            self.name, self.measured, self.theory, self.error
        )
    }
}

/// Sliding, rolling and spinning of a lone ball at several speeds: Marlow, "The Physics of Pocket
/// Billiards" (1995); the 5/7 rule also in Alciatore, TP 4.1.
///
/// # Errors
/// None in practice for one ball on an endless cloth.
pub fn measure() -> anyhow::Result<Vec<ClosedForm>> {
    let mut forms = Vec::new();
    for speed in [0.01, 1.0, 3.0, 12.0] {
        forms.extend(slide_to_roll(speed)?);
        forms.extend(roll_out(speed)?);
        forms.push(dead_draw(speed)?);
    }
    for spin in [1.0, 100.0, 1e4] {
        forms.push(spin_decay(spin)?);
    }
    Ok(forms)
}

fn slide_to_roll(speed: f64) -> anyhow::Result<[ClosedForm; 4]> {
    let Cloth {
        sliding_friction: slide,
        rolling_friction: roll,
        gravity_m_s2: g,
        ..
    } = Cloth::default();
    let shot = single_ball(DVec3::X * speed, DVec3::ZERO)?;
    let rolls = |kind: &EventKind| matches!(kind, EventKind::Rolls { .. });
    let t = first_secs(&shot, rolls);
    let then = shot.states_at(t)[0];
    // v t − ½ μ g t² at the end of sliding, t = 2 v / (7 μ g).
    let way = 12.0 * speed * speed / (49.0 * slide * g);
    let end = shot.final_states()[0].position.x;
    let form = |what: &str, measured, theory| {
        ClosedForm::new(format!("{what}, stun at {speed} m/s"), measured, theory)
    };
    Ok([
        form(
            "speed of rolling (5/7 rule)",
            then.velocity.x,
            5.0 / 7.0 * speed,
        ),
        form("time of sliding", t, 2.0 * speed / (7.0 * slide * g)),
        form("way of sliding", then.position.x, way),
        form(
            "stopping distance",
            end,
            way + (5.0 / 7.0 * speed).powi(2) / (2.0 * roll * g),
        ),
    ])
}

fn roll_out(speed: f64) -> anyhow::Result<[ClosedForm; 2]> {
    let Cloth {
        rolling_friction: roll,
        gravity_m_s2: g,
        ..
    } = Cloth::default();
    let radius_m = BallBody::default().radius_m;
    let shot = single_ball(DVec3::X * speed, DVec3::Y * speed / radius_m)?;
    let form = |what: &str, measured, theory| {
        ClosedForm::new(format!("{what}, rolling at {speed} m/s"), measured, theory)
    };
    Ok([
        form("time to rest", shot.duration_secs(), speed / (roll * g)),
        form(
            "stopping distance",
            shot.final_states()[0].position.x,
            speed * speed / (2.0 * roll * g),
        ),
    ])
}

/// Backspin of 5/2 v/R and the speed reach zero at the same instant.
fn dead_draw(speed: f64) -> anyhow::Result<ClosedForm> {
    let cloth = Cloth::default();
    let spin = -2.5 * speed / BallBody::default().radius_m;
    let shot = single_ball(DVec3::X * speed, DVec3::Y * spin)?;
    let deceleration = cloth.sliding_friction * cloth.gravity_m_s2;
    Ok(ClosedForm::new(
        format!("way to a dead stop, drawn at {speed} m/s"),
        shot.final_states()[0].position.x,
        speed * speed / (2.0 * deceleration),
    ))
}

fn spin_decay(spin: f64) -> anyhow::Result<ClosedForm> {
    let laws = Laws::default();
    let shot = released(laws, vec![ball(0, 0.0, 0.0, DVec3::ZERO, DVec3::Z * spin)])?;
    let decay = 2.5 * laws.cloth.spin_friction_m * laws.cloth.gravity_m_s2
        / BallBody::default().radius_m.powi(2);
    Ok(ClosedForm::new(
        format!("time of spinning at {spin} rad/s"),
        shot.duration_secs(),
        spin / decay,
    ))
}

/// Maximum relative error of a closed form.
pub const ERROR_MAX: f64 = 1e-9;
