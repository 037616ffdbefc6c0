//! What each figure is called and what it means: the words of every tooltip.

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
    FPS "fps" "Redraws of the window a second, over the last quarter of a second in which something moved. The picture behind may be newer or older: that is pictures/s."
    FPS_MEAN "mean" "Redraws a second, mean of the last 1,000 while something moved."
    LOW_1 "1% low" "The rate of the slowest redraw in a hundred: one over the 99th percentile of the time between redraws, of the last 1,000."
    LOW_01 "0.1% low" "The rate of the slowest redraw in a thousand, of the last 1,000."
    PICTURES "pictures/s" "Traced pictures that came from the farm a second, over the last 600."
    MAKESPAN "picture" "Makespan: from asking the farm for the picture until its last tile was here, milliseconds."
    IDEAL "ideal" "Milliseconds that the same nodes would have needed had the work been divided so that all end together: each begins when it did and is as quick as it says that it was."
    EFFICIENCY "balance" "Balance efficiency: ideal over real makespan, per cent. 100 means that no other division would have been quicker."
    IDLE "idle" "How long the nodes that took part had nothing to do at the end of the picture, on average, as a share of the makespan."
    STRAGGLER "last" "The straggler: the node whose tiles came last. The picture waited for it."
    NODES "nodes" "Nodes that hold the scene and can trace, of all that are configured."
    BITS "Mbit/s" "Megabits a second of pixels from the farm, over the last 600 pictures."
    RATIO "packed" "Bytes of the pixels before encoding, over the bytes that crossed the link."
    LATE "late" "Tiles that were asked of another node too because they would have come late, over the last 600 pictures."
    LOST "lost" "Tiles that were asked for again because their node was lost, refused them or fell silent, over the last 600 pictures."
    REISSUED "again" "Re-issued: all tiles that were asked for again, late and lost, over the last 600 pictures."
    TWICE "twice" "Tiles that came twice; the first one was kept, over the last 600 pictures."
    DROPPED "dropped" "Samples that were not finite numbers and count as black, over the last 600 pictures."
    SIZE "size" "Pixels of the traced picture, which is stretched over the window, and paths traced for each of them."
    LEAD "lead" "How far ahead of its moment a picture of a shot is asked for: the 95th percentile of what pictures take."
    SKIPPED "skipped" "Pictures of shots that were passed over because a later one was due already, since the program began."
    GUESSED "guessed" "Share of the window that the newest traced picture did not hold, when it was moved to the present camera and balls."
    DISPLAY "shown by" "What puts pictures into the window."
    ASKED "ask" "Critical path, 1 of 6: from asking the farm until the node of the last tile was asked, milliseconds."
    NETWORK "network" "Critical path, 2 of 6: both ways through the network and waiting for it: what is left of the round trip, milliseconds."
    QUEUE "queue" "Critical path, 3 of 6: waiting for the node's device, by the node's clock, milliseconds."
    TRACE "trace" "Critical path, 4 of 6: tracing, by the node's clock, milliseconds."
    ENCODE "encode" "Critical path, 5 of 6: encoding, by the node's clock, milliseconds."
    DECODE "decode" "Critical path, 6 of 6: decoding, by this machine's clock, milliseconds."
    DRAW "draw" "Milliseconds that this machine needed for the last redraw: moving the picture, interface, and handing both to the display."
    NODE "node" "Number and name of the node, as in the map and the Gantt chart."
    STATE "state" "Where the node stands: starting, paired (no scene yet), syncing (how much of the scene has come to it), ready, or lost."
    DEVICE "device" "What the node traces with."
    TILES "tiles" "Tiles of this picture that came from the node."
    SHARE "share" "The node's part of this picture's work, per cent."
    RESPONSE "resp" "Response time: from asking the farm for this picture until the node's last tile was here, milliseconds."
    RESPONSE_MEAN "mean" "Mean of the node's response times over those of the last 600 pictures in which it took part, milliseconds."
    RESPONSE_SIGMA "σ" "Standard deviation of the same, milliseconds."
    RESPONSE_P99 "p99" "99th percentile of the same, milliseconds."
    RESPONSE_MAX "max" "Longest of the same, milliseconds."
    NODE_NETWORK "net" "Of the node's last tile of this picture: both ways through the network and waiting for it, milliseconds."
    NODE_QUEUE "queue" "Of the same tile: waiting for the device, milliseconds."
    NODE_TRACE "trace" "Of the same tile: tracing, milliseconds."
    NODE_CODEC "codec" "Of the same tile: encoding and decoding, milliseconds."
    FIXED "A ms" "A of y = A + B·x, the learned fixed cost of a request in milliseconds, and its standard error."
    PACE "B ms/M" "B of y = A + B·x, the learned milliseconds for a million pixel samples of average cost, and its standard error."
    PREDICTED "pred" "When the node's last tile was predicted to come when it was asked for, milliseconds from asking the farm."
    ERROR "err%" "Actual over predicted response, less one, per cent: above 0 the node was slower than predicted."
    NODE_BYTES "kB" "Kilobytes of the node's pixels of this picture as they crossed the link."
    NODE_RATIO "packed" "Bytes before encoding over bytes that crossed the link, by the node's tiles."
    NODE_LATE "late" "Tiles of the node that came more than a tenth and 1 ms after their prediction, over the last 600 pictures."
    NODE_LOST "lost" "Tiles that the node refused, lost with its connection, or left to others by falling silent, since the program began."
    NODE_TWICE "twice" "Tiles of the node that another one had brought before, over the last 600 pictures."
    TALLY_FRAMES "pictures" "Pictures that were divided in this way since the program began."
    TALLY_EFFICIENCY "balance" "Mean balance efficiency of those pictures: ideal over real makespan, per cent."
    TALLY_SIGMA "σ" "Mean over those pictures of the standard deviation of the nodes' response times, milliseconds."
    TALLY_MAX "max" "Mean over those pictures of the longest response time, milliseconds."
    RECORDING "recording" "Pictures that have been written to the files of the recording. Those for which the disk was too slow are left out and counted."
    LEVEL_SCALE "pixels" "Size of a traced picture at this stop of the dial."
    LEVEL_SAMPLES "paths" "Paths traced for each pixel at this stop; + where they are denoised."
    LEVEL_MS "ms here" "Milliseconds that a picture at this stop keeps this farm busy, from what its pictures have cost so far."
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
