//! Switches of a scene's lights.

use carom_tracer::{Environment, Material, Scene};
use glam::Vec3;

/// On/off state of a scene's lights.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct LightSwitches {
    /// The sky; `None` if the scene has none.
    pub sky: Option<bool>,
    /// The area lights, in the scene's order.
    pub lamps: Vec<bool>,
    /// Whether there are lights that cannot be switched: points, spots, suns and emissive surfaces.
    pub has_others: bool,
}

impl LightSwitches {
    /// Switches for the lights of a scene, all on.
    pub fn of(scene: &Scene) -> Self {
        let has_sky = scene.environment.radiance != Vec3::ZERO;
        Self {
            sky: has_sky.then_some(true),
            lamps: vec![true; scene.area_lights.len()],
            has_others: !scene.punctual_lights.is_empty()
                || scene.materials.values().any(is_emitter),
        }
    }

    /// Whether they have the same lights as `other`.
    pub fn fit(&self, other: &Self) -> bool {
        self.sky.is_some() == other.sky.is_some() && self.lamps.len() == other.lamps.len()
    }

    /// Whether all lights are off.
    pub fn is_dark(&self) -> bool {
        self.sky != Some(true) && !self.lamps.contains(&true) && !self.has_others
    }

    /// Toggles a light: 0 is the sky, 1 the first area light; numbers without a light are ignored.
    pub fn toggle(&mut self, number: usize) {
        let switch = match number.checked_sub(1) {
            None => self.sky.as_mut(),
            Some(lamp) => self.lamps.get_mut(lamp),
        };
        if let Some(switch) = switch {
            *switch = !*switch;
        }
    }

    /// The scene with only these lights on. Lamps that are off stay in place with zero radiance.
    pub fn apply(&self, scene: &Scene) -> Scene {
        let mut lit = scene.clone();
        if self.sky == Some(false) {
            lit.environment = Environment {
                radiance: Vec3::ZERO,
            };
        }
        for (lamp, is_on) in lit.area_lights.iter_mut().zip(&self.lamps) {
            if !is_on {
                lamp.radiance = Vec3::ZERO;
            }
        }
        lit
    }
}

fn is_emitter(material: &Material) -> bool {
    matches!(material, Material::MetallicRoughness { emission, .. } if *emission != Vec3::ZERO)
}

#[cfg(test)]
mod tests {
    use carom_tracer::{AreaLight, PunctualEmitter, PunctualLight};

    use super::*;

    #[test]
    fn lights_that_are_off_emit_nothing_and_stay_in_their_place() {
        let mut scene = Scene::new();
        for x in [0.0, 2.0] {
            scene.add_light(AreaLight::new(1.0, 1.0).at([x, 0.0, 3.0]));
        }
        let mut switches = LightSwitches::of(&scene);
        assert_eq!(switches.apply(&scene), scene);
        switches.toggle(0);
        switches.toggle(2);
        switches.toggle(3);
        let lit = switches.apply(&scene);
        assert_eq!(lit.environment.radiance, Vec3::ZERO);
        assert_eq!(lit.area_lights[0], scene.area_lights[0]);
        assert_eq!(lit.area_lights[1].radiance, Vec3::ZERO);
        assert_eq!(lit.area_lights[1].center, scene.area_lights[1].center);
        assert!(!switches.is_dark());
        switches.toggle(1);
        assert!(switches.is_dark());
        let mut sunny = Scene::new().sky([0.0; 3]);
        let sun = PunctualEmitter::Distant {
            direction: Vec3::NEG_Z,
            irradiance: Vec3::ONE,
        };
        sunny.add_punctual_light(PunctualLight::new(sun));
        assert!(!LightSwitches::of(&sunny).is_dark());
        let without_sky = LightSwitches::of(&Scene::new().sky([0.0; 3]));
        assert_eq!(without_sky.sky, None);
        assert!(without_sky.is_dark() && !without_sky.fit(&switches));
    }
}
