//! Glossary of the statistics: label and definition of each figure, as its tooltip shows them.

/// A figure's name and its definition, with unit and window.
#[derive(Clone, Copy, Debug)]
pub struct Term {
    /// What stands before the number.
    pub label: &'static str,
    /// What the number is.
    pub meaning: &'static str,
}

const fn term(label: &'static str, meaning: &'static str) -> Term {
    Term { label, meaning }
}

macro_rules! terms {
    ($($name:ident $label:literal $meaning:literal)*) => {
        $(#[doc = $meaning] pub const $name: Term = term($label, $meaning);)*
        /// All of them.
        pub const ALL: &[Term] = &[$($name),*];
    };
}

terms! {
    FPS "fps" "Redraws of the window per second, over the last quarter of a second in which something moved. Traced frames are counted by frames/s."
    NEW_PICTURES "new pictures" "Pictures per second that are traced. Between them the newest one is moved to where you look, so that fps may be higher."
    DELAY "each takes" "Milliseconds from the request of a picture until it is there. Shots are requested that much ahead, so that you do not wait."
    SHARPNESS "sharpness" "Edge of the newest picture as a share of the window's. A view that rests gets to the resolution of the settings, 100 % unless you chose less."
    MADE_BY "made by" "Device that traces the picture, or how many machines do."
    FPS_MEAN "mean" "Mean redraws per second over the last 1,000 while something moved."
    LOW_1 "1% low" "Redraw rate of the slowest 1 %: one over the 99th percentile of the time between redraws, over the last 1,000."
    LOW_01 "0.1% low" "Redraw rate of the slowest 0.1 %, over the last 1,000 redraws."
    PICTURES "frames/s" "Traced frames per second that arrived from the farm, over the last 600."
    MAKESPAN "frame" "Makespan: milliseconds from the request of the frame until its last tile arrived."
    IDEAL "ideal" "Milliseconds that the same nodes would have needed with a division that lets all finish together, from their own starts and reported speeds."
    EFFICIENCY "balance" "Balance efficiency: ideal over actual makespan in per cent. At 100 no other division would have been faster."
    IDLE "idle" "Mean share of the makespan in which the participating nodes had no work left."
    STRAGGLER "last" "Straggler: the node whose tiles arrived last."
    NODES "nodes" "Nodes that hold the scene and can trace, of all configured nodes."
    BITS "Mbit/s" "Megabits of pixels per second from the farm, over the last 600 frames."
    RATIO "packed" "Compression ratio: bytes of the pixels before encoding over bytes on the link."
    LATE "late" "Tiles requested from a second node because they would have been late, over the last 600 frames."
    LOST "lost" "Tiles requested again because their node was lost, refused them or timed out, over the last 600 frames."
    REISSUED "reissued" "All tiles requested again, late and lost, over the last 600 frames."
    TWICE "twice" "Duplicate tiles, of which the first was kept, over the last 600 frames."
    DROPPED "dropped" "Samples that were NaN or infinite and count as black, over the last 600 frames."
    SIZE "size" "Resolution of the traced frame, which is scaled to the window, and samples per pixel."
    LEAD "lead" "Time by which frames of a shot are requested ahead: the 95th percentile of the frame latency."
    SKIPPED "skipped" "Frames of shots that were skipped because a later one was due already, since the start of the program."
    GUESSED "revealed" "Disocclusion: share of the window that the newest traced frame did not show before reprojection to the present camera and balls."
    DISPLAY "shown by" "Presentation back end of the window."
    ASKED "request" "Critical path, 1 of 6: milliseconds from the request of the frame until the node of the last tile was sent its request."
    NETWORK "network" "Critical path, 2 of 6: milliseconds in the network, both directions, queues included."
    QUEUE "queue" "Critical path, 3 of 6: milliseconds in the queue of the node's device, by the node's clock."
    TRACE "trace" "Critical path, 4 of 6: milliseconds of tracing, by the node's clock."
    ENCODE "encode" "Critical path, 5 of 6: milliseconds of encoding, by the node's clock."
    DECODE "decode" "Critical path, 6 of 6: milliseconds of decoding, by this machine's clock."
    DRAW "draw" "Milliseconds of the last redraw on this machine: reprojection, interface and presentation."
    NODE "node" "Number and name of the node, as in the map and the Gantt chart."
    STATE "state" "Connection state of the node: starting, paired (no scene yet), syncing (share of the scene received), ready, or lost."
    DEVICE "device" "Devices that the node traces with."
    TILES "tiles" "Tiles of this frame delivered by the node."
    SHARE "share" "The node's share of this frame's work, per cent."
    RESPONSE "resp" "Response time: milliseconds from the request of this frame until the node's last tile arrived."
    RESPONSE_MEAN "mean" "Mean response time of the node over those of the last 600 frames it took part in, milliseconds."
    RESPONSE_SIGMA "σ" "Standard deviation of the node's response times, milliseconds."
    RESPONSE_P99 "p99" "99th percentile of the node's response times, milliseconds."
    RESPONSE_MAX "max" "Maximum of the node's response times, milliseconds."
    NODE_NETWORK "net" "Network time of the node's last tile of this frame, both directions, milliseconds."
    NODE_QUEUE "queue" "Queueing time of the same tile at the device, milliseconds."
    NODE_TRACE "trace" "Tracing time of the same tile, milliseconds."
    NODE_CODEC "codec" "Encoding and decoding time of the same tile, milliseconds."
    FIXED "A ms" "A of the cost model y = A + B·x: the learned fixed cost of a request in milliseconds, with its standard error."
    PACE "B ms/M" "B of the cost model y = A + B·x: learned milliseconds per million samples of mean cost, with its standard error."
    PREDICTED "pred" "Predicted response time of the node when the tile was requested, milliseconds."
    ERROR "err%" "Prediction error: actual over predicted response time, less one, per cent; above 0 the node was slower."
    NODE_BYTES "kB" "Kilobytes of the node's pixels of this frame on the link."
    NODE_RATIO "packed" "Compression ratio of the node's tiles."
    NODE_LATE "late" "Tiles of the node that arrived more than a tenth and 1 ms after their prediction, over the last 600 frames."
    NODE_LOST "lost" "Tiles that the node refused, lost with its connection or let time out, since the start of the program."
    NODE_TWICE "twice" "Tiles of the node that another node had delivered before, over the last 600 frames."
    TALLY_FRAMES "frames" "Frames divided by this algorithm since the start of the program."
    TALLY_EFFICIENCY "balance" "Mean balance efficiency of those frames, per cent."
    TALLY_SIGMA "σ" "Mean over those frames of the standard deviation of the nodes' response times, milliseconds."
    TALLY_MAX "max" "Mean over those frames of the longest response time, milliseconds."
    RECORDING "recording" "Frames written to the files of the recording. Frames that the disk was too slow for are left out and counted."
    LEVEL_SCALE "pixels" "Resolution of a traced frame at this quality level."
    LEVEL_SAMPLES "spp" "Samples per pixel at this quality level; + where frames are denoised."
    LEVEL_MS "ms here" "Predicted milliseconds of a frame at this quality level on this farm."
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_term_is_defined_in_a_sentence_of_its_own() {
        for (i, term) in ALL.iter().enumerate() {
            assert!(!term.label.is_empty());
            assert!(
                term.meaning.len() > 25 && term.meaning.ends_with('.'),
                "{}",
                term.label
            );
            for other in &ALL[..i] {
                assert_ne!(term.meaning, other.meaning, "{}", term.label);
            }
        }
    }
}
