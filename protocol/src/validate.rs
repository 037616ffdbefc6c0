//! Validation of messages beyond their encoding. Messages are checked after decoding and before sending,
//! so that a peer that breaks a rule cannot be running this program.

use carom_tracer::scene::validate::{CLOUDS_MAX, PARTICLES_MAX};
use carom_tracer::text::printable;
use carom_tracer::{SceneUpdate, TileGrid, TileRange};

use crate::error::Reason;
use crate::limits::{
    CHUNK_BYTES_MAX, CHUNKS_MAX, NODE_NAME_BYTES_MAX, POSES_MAX, REFERENCE_RANGES_MAX,
    REQUEST_SAMPLES_MAX, REQUEST_TILES_MAX, SCENE_BYTES_MAX, SENTENCE_BYTES_MAX, TILE_EDGE_MAX,
    TILES_PER_MESSAGE_MAX,
};
use crate::message::{
    ChunkKey, CodedParticles, NodeInfo, NodeLoad, PixelFormat, ReferenceRange, RefusalReason,
    TilesDone, ToClient, ToNode, TraceRequest,
};

type Check = Result<(), Reason>;

impl ToNode {
    /// Checks all that the message alone determines; the session checks whether a scene can be drawn and
    /// whether an update fits its scene.
    ///
    /// # Errors
    /// The rule that is broken, with its values.
    pub fn validate(&self) -> Check {
        match self {
            Self::Trace(request) => request.validate(),
            Self::Manifest { chunks, .. } => check_manifest(chunks),
            Self::Chunk { bytes } => check_chunk_bytes(bytes.len()),
            Self::Hello { .. }
            | Self::Scene { .. }
            | Self::CancelBefore(_)
            | Self::CancelRequest(_)
            | Self::Ping(_)
            | Self::Leave
            | Self::ChunksSent(_) => Ok(()),
        }
    }
}

impl ToClient {
    /// Checks all that the message alone determines; the session checks whether the tiles were asked for.
    ///
    /// # Errors
    /// The rule that is broken, with its values.
    pub fn validate(&self) -> Check {
        match self {
            Self::Welcome { node, .. } => node.validate(),
            Self::SceneRefused { why, .. } => sentence(why),
            Self::Tiles(tiles) => tiles.validate(),
            Self::RequestRefused(refusal) => match &refusal.why {
                RefusalReason::Invalid(why) | RefusalReason::Device(why) => sentence(why),
                RefusalReason::Cancelled | RefusalReason::Busy | RefusalReason::UnknownScene => {
                    Ok(())
                }
            },
            Self::Pong { load, .. } => load.validate(),
            Self::ChunksWanted { chunks, .. } => check_wanted(chunks),
            Self::SceneReady(_)
            | Self::RequestDone(_)
            | Self::SceneComing { .. }
            | Self::Leaving => Ok(()),
        }
    }
}

impl TraceRequest {
    /// Checks every number against its range and the work against [`REQUEST_SAMPLES_MAX`].
    ///
    /// # Errors
    /// The rule that is broken, with its values.
    pub fn validate(&self) -> Check {
        check_grid(self.grid)?;
        check_tiles(self.grid, self.tiles)?;
        self.settings.validate().map_err(Reason::tracer)?;
        check_update(&self.update)?;
        self.format.validate()?;
        self.precision.validate()?;
        self.check_references()?;
        self.particles.validate()?;
        let pixels = self.grid.pixels(self.tiles) as u64;
        let samples = pixels * u64::from(self.settings.samples);
        if samples > REQUEST_SAMPLES_MAX {
            return Err(format!(
                "{pixels} pixels of {} samples are asked for: at most {REQUEST_SAMPLES_MAX} samples are \
                 allowed in one request",
                self.settings.samples
            )
            .into());
        }
        Ok(())
    }
}

impl TraceRequest {
    fn check_references(&self) -> Check {
        at_most(
            "ranges of references",
            self.references.len(),
            REFERENCE_RANGES_MAX,
        )?;
        // Ranges must ascend without overlap: each begins at or after the end of the one before.
        let mut from = self.tiles.first;
        for ReferenceRange { request, tiles } in &self.references {
            let inside = tiles.first.checked_add(tiles.count);
            let inside = inside.is_some_and(|end| end <= self.tiles.end());
            if tiles.count == 0 || tiles.first < from || !inside || *request >= self.id {
                return Err(format!(
                    "{tiles:?} of request {} are references: ranges must be in order, in {:?} and of \
                     earlier requests than {}",
                    request.0, self.tiles, self.id.0
                )
                .into());
            }
            from = tiles.end();
        }
        Ok(())
    }
}

impl CodedParticles {
    /// Checks the announced numbers, which bound what is decoded.
    fn validate(&self) -> Check {
        at_most("clouds of particles", self.clouds.len(), CLOUDS_MAX)?;
        let counts = self.clouds.iter().map(|cloud| cloud.count as usize);
        at_most("particles", counts.sum(), PARTICLES_MAX)
    }
}

impl PixelFormat {
    /// Checks the exposure.
    ///
    /// # Errors
    /// The rule, with the exposure.
    pub fn validate(self) -> Check {
        match self {
            Self::Srgb8 { exposure } if !(exposure.is_finite() && exposure > 0.0) => {
                Err(format!("the exposure is {exposure}: it must be finite and above 0").into())
            }
            Self::Srgb8 { .. } | Self::LinearF16 | Self::LinearF32 => Ok(()),
        }
    }
}

impl NodeInfo {
    fn validate(&self) -> Check {
        text("node's name", &self.name, NODE_NAME_BYTES_MAX)?;
        text("device's name", &self.device.name, NODE_NAME_BYTES_MAX)
    }
}

impl NodeLoad {
    fn validate(self) -> Check {
        at_most("percent of a second", usize::from(self.busy_percent), 100)
    }
}

impl TilesDone {
    fn validate(&self) -> Check {
        let TileRange { first, count } = self.tiles;
        if !(1..=TILES_PER_MESSAGE_MAX).contains(&count) {
            return Err(wrong_count(count, TILES_PER_MESSAGE_MAX));
        }
        match first.checked_add(count) {
            Some(_) => Ok(()),
            None => Err(format!("there is no tile {first} + {count}").into()),
        }
    }
}

fn check_manifest(chunks: &[ChunkKey]) -> Check {
    at_most("chunks", chunks.len(), CHUNKS_MAX)?;
    let mut bytes = 0;
    for chunk in chunks {
        check_chunk_bytes(chunk.bytes as usize)?;
        bytes += chunk.bytes as usize;
    }
    at_most("bytes in its chunks", bytes, SCENE_BYTES_MAX)
}

fn check_chunk_bytes(bytes: usize) -> Check {
    match bytes {
        1..=CHUNK_BYTES_MAX => Ok(()),
        _ => {
            Err(format!("a chunk has {bytes} bytes: it must be from 1 to {CHUNK_BYTES_MAX}").into())
        }
    }
}

fn check_wanted(chunks: &[u32]) -> Check {
    at_most("chunks", chunks.len(), CHUNKS_MAX)?;
    match chunks.is_sorted_by(|before, after| before < after) {
        true => Ok(()),
        false => Err("its chunks are not in rising order".into()),
    }
}

fn check_grid(grid: TileGrid) -> Check {
    grid.size.validate().map_err(Reason::tracer)?;
    if (1..=TILE_EDGE_MAX).contains(&grid.edge) {
        return Ok(());
    }
    let edge = grid.edge;
    Err(
        format!("tiles of {edge} pixels are asked for: it must be from 1 to {TILE_EDGE_MAX}")
            .into(),
    )
}

fn check_tiles(grid: TileGrid, tiles: TileRange) -> Check {
    if !(1..=REQUEST_TILES_MAX).contains(&tiles.count) {
        return Err(wrong_count(tiles.count, REQUEST_TILES_MAX));
    }
    let (TileRange { first, count }, all) = (tiles, grid.len());
    match first.checked_add(count) {
        Some(end) if end <= all => Ok(()),
        _ => Err(
            format!("{count} tiles from {first} on are asked for: the picture has {all}").into(),
        ),
    }
}

fn wrong_count(count: u32, max: u32) -> Reason {
    format!("it has {count} tiles: it must be from 1 to {max}").into()
}

fn check_update(update: &SceneUpdate) -> Check {
    at_most("poses", update.poses.len(), POSES_MAX)?;
    if let Some(camera) = &update.camera {
        camera.validate().map_err(Reason::tracer)?;
    }
    let mut poses = update.poses.iter();
    poses.try_for_each(|pose| pose.validate().map_err(Reason::tracer))
}

fn sentence(sentence: &str) -> Check {
    text("sentence", sentence, SENTENCE_BYTES_MAX)
}

/// Checks a text. Senders filter theirs by the same [`printable`], which leaves a valid text as it is.
fn text(what: &'static str, text: &str, bytes_max: usize) -> Check {
    if printable(text, bytes_max) == text {
        return Ok(());
    }
    Err(format!(
        "its {what} has {} bytes: at most {bytes_max} are allowed, without control characters",
        text.len()
    )
    .into())
}

fn at_most(what: &'static str, count: usize, max: usize) -> Check {
    if count <= max {
        return Ok(());
    }
    Err(format!("there are {count} {what}: at most {max} are allowed").into())
}
