//! Glossary of the statistics: label and definition of each figure, shown in its tooltip.

use carom_farm::LatencySplit;
use carom_text::text;

/// A figure's label and its definition, with unit and time window.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Term {
    /// Identifier in the texts `glossary-<id>` and `glossary-<id>-about`.
    pub id: &'static str,
}

impl Term {
    /// The label in front of the value.
    pub fn label(&self) -> &'static str {
        text!(&format!("glossary-{}", self.id))
    }

    /// The definition.
    pub fn meaning(&self) -> &'static str {
        text!(&format!("glossary-{}-about", self.id))
    }
}

/// Stages of a tile's latency with their seconds, in chronological order.
pub(super) fn stages(split: &LatencySplit) -> [(&'static Term, f64); 6] {
    [
        (&ASKED, split.request_secs),
        (&NETWORK, split.network_secs),
        (&QUEUE, split.queue_secs),
        (&TRACE, split.trace_secs),
        (&ENCODE, split.encode_secs),
        (&DECODE, split.decode_secs),
    ]
}

macro_rules! terms {
    ($($name:ident $id:literal)*) => {
        $(#[doc = concat!("The text `glossary-", $id, "`.")] pub const $name: Term = Term { id: $id };)*
        /// All terms.
        pub const ALL: &[Term] = &[$($name),*];
    };
}

terms! {
    FPS "fps"
    NEW_PICTURES "new-pictures"
    DELAY "delay"
    SHARPNESS "sharpness"
    MADE_BY "made-by"
    FPS_MEAN "fps-mean"
    LOW_1 "low-1"
    LOW_01 "low-01"
    PICTURES "pictures"
    MAKESPAN "makespan"
    IDEAL "ideal"
    EFFICIENCY "efficiency"
    IDLE "idle"
    STRAGGLER "straggler"
    NODES "nodes"
    BITS "mbit"
    RATIO "ratio"
    LATE "late"
    LOST "lost"
    REISSUED "reissued"
    TWICE "twice"
    DROPPED "dropped"
    SIZE "size"
    LEAD "lead"
    SKIPPED "skipped"
    GUESSED "revealed"
    DISPLAY "shown-by"
    ASKED "request"
    NETWORK "network"
    QUEUE "queue"
    TRACE "trace"
    ENCODE "encode"
    DECODE "decode"
    DRAW "draw"
    REDRAWS "redraws"
    NODE "node"
    STATE "state"
    DEVICE "device"
    TILES "tiles"
    SHARE "share"
    RESPONSE "response"
    RESPONSE_MEAN "response-mean"
    RESPONSE_SIGMA "response-sigma"
    RESPONSE_P99 "response-p99"
    RESPONSE_MAX "response-max"
    NODE_NETWORK "node-network"
    NODE_QUEUE "node-queue"
    NODE_TRACE "node-trace"
    NODE_CODEC "node-codec"
    FIXED "fixed"
    PACE "pace"
    PREDICTED "predicted"
    ERROR "error"
    NODE_BYTES "node-bytes"
    NODE_RATIO "node-ratio"
    NODE_LATE "node-late"
    NODE_LOST "node-lost"
    NODE_TWICE "node-twice"
    TALLY_FRAMES "tally-frames"
    TALLY_EFFICIENCY "tally-efficiency"
    TALLY_SIGMA "tally-sigma"
    TALLY_MAX "tally-max"
    RECORDING "recording"
    LEVEL_SCALE "level-scale"
    LEVEL_SAMPLES "level-samples"
    LEVEL_MS "level-ms"
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_term_is_defined_in_a_sentence_of_its_own() {
        for (i, term) in ALL.iter().enumerate() {
            let (label, meaning) = (term.label(), term.meaning());
            assert!(!label.is_empty(), "{}", term.id);
            assert!(meaning.len() > 25 && meaning.ends_with('.'), "{label}");
            for other in &ALL[..i] {
                assert_ne!(meaning, other.meaning(), "{label}");
            }
        }
    }
}
