//! Animations of a glTF file.

use std::collections::BTreeSet;

use gltf_json::animation::{Channel, Property};

use super::track::Track;
use super::{Document, Refusal, find, known};
use crate::scene::validate::NAME_BYTES_MAX;
use crate::text::printable;

/// An animation of a file: its name, duration and channels.
#[derive(Debug)]
pub struct Animation {
    name: String,
    duration_secs: f64,
    channels: Vec<AnimatedProperty>,
}

/// A channel: a property of a node that changes with time.
#[derive(Debug)]
pub(super) struct AnimatedProperty {
    pub(super) node: usize,
    pub(super) property: Property,
    pub(super) track: Track,
}

impl Animation {
    /// Name of the animation in the file; empty if it has none.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Time of the last key frame in seconds from the animation's start, at least 0.
    pub fn duration_secs(&self) -> f64 {
        self.duration_secs
    }

    pub(super) fn channels(&self) -> &[AnimatedProperty] {
        &self.channels
    }
}

/// Maximum total number of values in key frames; a minute of 200 joints at 60 frames per second has
/// 8 million.
pub(super) const KEY_NUMBERS_MAX: usize = 1 << 26;

/// All animations of the file.
pub(super) fn read(document: &Document) -> Result<Vec<Animation>, Refusal> {
    let mut animations = Vec::new();
    let mut numbers = 0;
    for (index, from) in document.root.animations.iter().enumerate() {
        let name = printable(from.name.as_deref().unwrap_or_default(), NAME_BYTES_MAX);
        let mut animation = Animation {
            duration_secs: 0.0,
            channels: Vec::new(),
            name,
        };
        let mut targets = BTreeSet::new();
        for (place, channel) in from.channels.iter().enumerate() {
            let what = format!("animation {index} `{}`, channel {place}", animation.name);
            let channel = animated_property(document, from, channel, &what)?;
            if !targets.insert((channel.node, channel.property as u8)) {
                let (node, property) = (channel.node, channel.property);
                return Err(format!(
                    "{what} moves node {node}'s {property:?} a second time"
                ));
            }
            numbers += channel.track.numbers();
            if numbers > KEY_NUMBERS_MAX {
                return Err(format!(
                    "{what}: key frames have more than {KEY_NUMBERS_MAX} numbers"
                ));
            }
            animation.duration_secs = animation.duration_secs.max(channel.track.end_secs());
            animation.channels.push(channel);
        }
        animations.push(animation);
    }
    Ok(animations)
}

fn animated_property(
    document: &Document,
    from: &gltf_json::Animation,
    channel: &Channel,
    what: &str,
) -> Result<AnimatedProperty, Refusal> {
    let place = channel.sampler.value();
    let sampler = find(&from.samplers, place, format_args!("{what}: sampler"))?;
    let place = channel.target.node.value();
    let node = find(&document.root.nodes, place, format_args!("{what}: node"))?;
    let unknown = || format!("{what} moves what glTF does not know of node {place}");
    let property = known(&channel.target.path, unknown)?;
    let width = match property {
        Property::Translation | Property::Scale => 3,
        Property::Rotation => 4,
        Property::MorphTargetWeights => document.targets(node)?,
    };
    if width == 0 {
        return Err(format!(
            "{what} moves weights of node {place}, which has no morph targets"
        ));
    }
    if node.matrix.is_some() && property != Property::MorphTargetWeights {
        return Err(format!(
            "{what} moves node {place}, which has a matrix: it must have translation, rotation and scale"
        ));
    }
    let track = Track::read(document, sampler, property, width, what)?;
    Ok(AnimatedProperty {
        node: place,
        property,
        track,
    })
}
