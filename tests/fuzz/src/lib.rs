//! Bodies of the fuzz targets. Plain functions, so that a test of the main
//! workspace runs them too; each panics if a law is broken.

mod addresses;
mod checkpoints;
mod enrolment;
mod files;
mod images;
mod scenes;
mod settings;
mod tile_transport;
mod wire;

pub use addresses::*;
pub use checkpoints::*;
pub use enrolment::*;
pub use files::*;
pub use images::*;
pub use scenes::*;
pub use settings::*;
pub use tile_transport::*;
pub use wire::*;

/// A target: its name, its body and inputs to begin from.
pub type Target = (&'static str, fn(&[u8]), fn() -> Vec<Vec<u8>>);

/// All targets.
pub const TARGETS: [Target; 19] = [
    ("to_node", to_node, to_node_seeds),
    ("to_client", to_client, to_client_seeds),
    ("tile_codec", tile_codec, tile_codec_seeds),
    ("srgb_tiles", srgb_tiles, srgb_tiles_seeds),
    ("particles", particles, particles_seeds),
    ("framing", framing, framing_seeds),
    ("session", session, session_seeds),
    ("datagrams", datagrams, datagrams_seeds),
    ("addresses", addresses, addresses_seeds),
    ("enrolment", enrolment, enrolment_seeds),
    ("scene_json", scene_json, scene_json_seeds),
    ("traced_scene", traced_scene, traced_scene_seeds),
    ("recording", recording, recording_seeds),
    ("match_save", match_save, match_save_seeds),
    ("checkpoint", checkpoint, checkpoint_seeds),
    ("settings", settings, settings_seeds),
    ("texture", texture, texture_seeds),
    ("environment", environment, environment_seeds),
    ("gltf", gltf, gltf_seeds),
];
