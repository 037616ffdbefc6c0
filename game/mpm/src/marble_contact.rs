//! Contact model of a marble: a linear spring and dashpot along the normal, and a tangential spring and
//! dashpot bounded by Coulomb's law.

use glam::DVec3;

use crate::marble::{Marble, MarbleState};

/// Surface of the second body of a marble's contact, at the marble.
pub(crate) struct Surface {
    /// Distance from the surface to the marble's centre, in m.
    pub(crate) distance_m: f64,
    /// Unit normal out of the body.
    pub(crate) normal: DVec3,
    /// Velocity of the body's centre, in m/s.
    pub(crate) velocity: DVec3,
    /// Angular velocity, in rad/s.
    pub(crate) spin: DVec3,
    /// Mass in kg, infinite for static bodies.
    pub(crate) mass_kg: f64,
    /// Radius of a sphere in m, 0 for static bodies.
    pub(crate) radius_m: f64,
}

/// Impulses of a contact over a substep.
pub(crate) struct Push {
    /// Impulse on the marble, in kg·m/s.
    pub(crate) impulse: DVec3,
    /// From the marble's centre to the contact point, in m.
    pub(crate) arm: DVec3,
    /// From the other body's centre to the contact point, in m.
    pub(crate) other_arm: DVec3,
    /// Angular impulse on the marble by rolling friction, in kg·m²/s.
    pub(crate) rolling: DVec3,
}

impl Surface {
    pub(crate) fn sphere(center: DVec3, other: DVec3, radius_m: f64) -> Self {
        let between = center - other;
        Self {
            distance_m: between.length() - radius_m,
            radius_m,
            ..Self::still(0.0, between.normalize_or(DVec3::Z))
        }
    }

    pub(crate) fn still(distance_m: f64, normal: DVec3) -> Self {
        Self {
            distance_m,
            normal,
            velocity: DVec3::ZERO,
            spin: DVec3::ZERO,
            mass_kg: f64::INFINITY,
            radius_m: 0.0,
        }
    }

    pub(crate) fn moving(self, velocity: DVec3, spin: DVec3, mass_kg: f64) -> Self {
        Self {
            velocity,
            spin,
            mass_kg,
            ..self
        }
    }

    /// Impulses on a marble over a substep of `dt` seconds, none if it does not touch; updates the stretch
    /// of the tangential spring, in m.
    pub(crate) fn push(
        &self,
        marble: &Marble,
        damping: f64,
        sphere: &MarbleState,
        stretch: &mut DVec3,
        dt: f64,
    ) -> Option<Push> {
        let depth_m = marble.radius_m - self.distance_m;
        if depth_m <= 0.0 {
            return None;
        }
        let normal = self.normal;
        let arm = -normal * (marble.radius_m - 0.5 * depth_m);
        let other_arm = normal * (self.radius_m - 0.5 * depth_m);
        let velocity = sphere.velocity + sphere.spin.cross(arm);
        let relative = velocity - self.velocity - self.spin.cross(other_arm);
        let approach = relative.dot(normal);
        let mass_kg = 1.0 / (1.0 / marble.mass_kg() + 1.0 / self.mass_kg);
        let stiffness = marble.stiffness_n_m;
        let dashpot = 2.0 * damping * (stiffness * mass_kg).sqrt();
        let force = (stiffness * depth_m - dashpot * approach).max(0.0);
        let slip = relative - approach * normal;
        let shear = stiffness * SHEAR_STIFFNESS;
        // The effective tangential mass of solid spheres is 2/7 of the reduced mass, as they also turn:
        // 1/m + r²/I = 7/2 · 1/m.
        let shear_dashpot = 2.0 * damping * (shear * mass_kg * SHEAR_STIFFNESS).sqrt();
        // The stretch is projected to the tangent plane, as the contact may have turned since the last
        // substep.
        let turned = *stretch - stretch.dot(normal) * normal + slip * dt;
        let drag = -shear * turned - shear_dashpot * slip;
        let bound = marble.friction * force;
        let bounded = drag.clamp_length_max(bound);
        // While the contact slips, the stretch stays at Coulomb's bound: otherwise it would grow with the
        // distance and push back when the slip ends.
        *stretch = match drag.length() > bound {
            true => -bounded / shear,
            false => turned,
        };
        // At most what stops the relative rotation within a substep: half the moment of inertia is the
        // reduced one of two marbles.
        let rolling = sphere.spin - self.spin;
        let stop = 0.5 * marble.moment_of_inertia() * rolling.length();
        let resistance = (marble.rolling_friction * marble.radius_m * force * dt).min(stop);
        Some(Push {
            impulse: (force * normal + bounded) * dt,
            arm,
            other_arm,
            rolling: -rolling.normalize_or_zero() * resistance,
        })
    }
}

/// Damping ratio at which a linear spring and dashpot without attraction have a coefficient of restitution:
/// equation 20 of Schwager and Pöschel 2007, "Coefficient of restitution and linear–dashpot model
/// revisited", solved by bisection.
pub(crate) fn damping_of(restitution: f64) -> f64 {
    // The restitution of a ratio: the contact ends when the force, not the depth, is 0.
    let gives = |share: f64| {
        let swing = (1.0 - share * share).sqrt();
        let angle = (2.0 * share * swing).atan2(share * share - swing * swing);
        (-share / swing * angle).exp()
    };
    let (mut low, mut high) = (0.0, 1.0);
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        match gives(middle) > restitution {
            true => low = middle,
            false => high = middle,
        }
    }
    low
}

/// Stiffness of the tangential spring over that of the normal one. With the effective tangential mass of
/// 2/7, both have the same period (Schäfer et al. 1996).
const SHEAR_STIFFNESS: f64 = 2.0 / 7.0;
