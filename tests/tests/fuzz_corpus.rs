//! The fuzz targets without a fuzzer: their seeds, the inputs that once failed, and thousands of
//! mutations of both.

#[expect(unreachable_pub, reason = "the fuzz targets use it as a library")]
#[path = "../fuzz/src/lib.rs"]
mod fuzz;

use std::path::Path;

use fuzz::TARGETS;
use rayon::iter::{IntoParallelIterator, IntoParallelRefIterator, ParallelIterator};

/// Mutations of each input; fewer where each is a whole match.
fn mutations(target: &str) -> u64 {
    if target == "match_save" { 100 } else { 1000 }
}

#[test]
fn regression_inputs_break_no_law() {
    TARGETS.into_par_iter().for_each(|(name, target, seeds)| {
        let mut inputs = seeds();
        inputs.extend(regressions(name));
        inputs.par_iter().for_each(|input| {
            target(input);
            for seed in 0..mutations(name) {
                target(&mutated(input, &inputs, seed));
            }
        });
    });
}

#[test]
fn seeds_get_past_the_decoders() {
    use carom_protocol::codec::{decode_to_client, decode_to_node};
    let right = |seeds: Vec<Vec<u8>>, decodes: fn(&[u8]) -> bool| {
        assert!(seeds.iter().all(|bytes| decodes(bytes)));
    };
    right(fuzz::to_node_seeds(), |bytes| decode_to_node(bytes).is_ok());
    right(fuzz::to_client_seeds(), |bytes| {
        decode_to_client(bytes).is_ok()
    });
}

/// What a fuzzer has found, kept in `fuzz/regressions/<target>`.
fn regressions(name: &str) -> Vec<Vec<u8>> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("fuzz/regressions")
        .join(name);
    let Ok(files) = std::fs::read_dir(folder) else {
        return Vec::new();
    };
    let bytes = |file: std::io::Result<std::fs::DirEntry>| std::fs::read(file?.path());
    files
        .map(bytes)
        .collect::<Result<_, _>>()
        .expect("readable files")
}

/// A few of the things that libFuzzer does: flip, overwrite, cut, repeat, splice.
fn mutated(input: &[u8], others: &[Vec<u8>], seed: u64) -> Vec<u8> {
    const EXTREMES: [u8; 6] = [0, 1, 0x7f, 0x80, 0xfe, 0xff];
    let mut random = Random(seed);
    let mut bytes = input.to_vec();
    for _ in 0..=random.below(4) {
        let at = random.below(bytes.len());
        match random.below(6) {
            _ if bytes.is_empty() => bytes.push(random.below(256) as u8),
            0 => bytes[at] ^= 1 << random.below(8),
            1 => bytes[at] = EXTREMES[random.below(EXTREMES.len())],
            2 => bytes[at] = random.below(256) as u8,
            3 => bytes.truncate(at),
            4 => {
                let piece = bytes[at..(at + random.below(64)).min(bytes.len())].to_vec();
                bytes.splice(at..at, piece);
            }
            _ => {
                let other = &others[random.below(others.len())];
                bytes.truncate(at);
                bytes.extend_from_slice(&other[random.below(other.len())..]);
            }
        }
    }
    bytes
}

/// SplitMix64 (Steele, Lea and Flood 2014).
struct Random(u64);

impl Random {
    fn below(&mut self, end: usize) -> usize {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) % end.max(1) as u64) as usize
    }
}
