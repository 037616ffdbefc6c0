//! Compilation of scenes on a thread beside the device: one at a time, players in turn, within a limit on
//! the memory of all compiled scenes.
//!
//! A compressed texture of some kilobytes may take a hundred megabytes and a second to decode: neither may
//! come out of the device time of other players.

use std::collections::VecDeque;
use std::sync::atomic::Ordering;
use std::sync::{Arc, Condvar, Mutex, PoisonError};
use std::time::Instant;

use carom_protocol::{RefusalReason, SceneHash};
use carom_tracer::scene::Shape;
use carom_tracer::{CompiledScene, Scene, SceneError};

use super::fair_queue::{FairQueue, PlayerId};
use super::job::UncompiledJob;
use crate::lock::lock;

/// The compiled scenes of a node, and the jobs that wait for a compilation.
pub(super) struct SceneCompiler {
    state: Mutex<CompilerState>,
    changed: Condvar,
}

struct CompilerState {
    waiting: FairQueue<UncompiledJob>,
    /// Compiled scenes, the most recently used first.
    kept: VecDeque<KeptScene>,
    bytes_max: u64,
    closed: bool,
}

struct KeptScene {
    hash: SceneHash,
    scene: Arc<CompiledScene>,
    bytes: u64,
    /// The player that requested it first.
    player: PlayerId,
}

impl KeptScene {
    fn is_in_use(&self) -> bool {
        Arc::strong_count(&self.scene) > 1
    }
}

impl Default for SceneCompiler {
    fn default() -> Self {
        Self {
            state: Mutex::new(CompilerState {
                waiting: FairQueue::new(),
                kept: VecDeque::new(),
                bytes_max: SCENE_BYTES_MAX,
                closed: false,
            }),
            changed: Condvar::new(),
        }
    }
}

impl SceneCompiler {
    /// Limits the memory of all compiled scenes, in bytes.
    pub(super) fn set_bytes_max(&self, bytes: u64) {
        lock(&self.state).bytes_max = bytes;
    }

    /// The part of that limit that a player may use, in bytes.
    pub(super) fn player_bytes_max(&self) -> u64 {
        lock(&self.state).bytes_max / PLAYER_PARTS
    }

    /// A scene that is already compiled.
    pub(super) fn kept(&self, hash: SceneHash) -> Option<Arc<CompiledScene>> {
        lock(&self.state).take_kept(hash)
    }

    /// Queues a job for the compilation of its scene.
    pub(super) fn push(&self, job: UncompiledJob) {
        let mut state = lock(&self.state);
        if !state.closed {
            state.waiting.jobs_mut(job.client.player).push_back(job);
            self.changed.notify_one();
        }
    }

    /// Waits for the next job to compile; `None` when the node is dropped.
    pub(super) fn next(&self) -> Option<UncompiledJob> {
        let mut state = lock(&self.state);
        loop {
            if state.closed {
                return None;
            }
            if let Some(job) = state.next() {
                return Some(job);
            }
            state = self
                .changed
                .wait(state)
                .unwrap_or_else(PoisonError::into_inner);
        }
    }

    /// The next job to compile, if one waits.
    #[cfg(test)]
    pub(super) fn try_next(&self) -> Option<UncompiledJob> {
        lock(&self.state).next()
    }

    /// Compiles a job's scene. An error is the reason for refusing the job.
    pub(super) fn compile(&self, job: &UncompiledJob) -> Result<Arc<CompiledScene>, RefusalReason> {
        let (hash, player) = (job.request.scene, job.client.player);
        let begun = Instant::now();
        let predicted = predicted_bytes(&job.scene).map_err(|why| invalid(&why))?;
        {
            let mut state = lock(&self.state);
            if let Some(scene) = state.take_kept(hash) {
                return Ok(scene);
            }
            // The room stays free while the lock is released, as only one thread compiles.
            state.make_room(predicted, player)?;
        }
        // Without the lock, as compiling a large scene takes long.
        let compiled = CompiledScene::new(&job.scene);
        let mut state = lock(&self.state);
        // This queue is fair in compilation time, separately from the device's.
        state.waiting.charge(player, begun.elapsed().as_secs_f64());
        let scene = Arc::new(compiled.map_err(|why| invalid(&why))?);
        state.kept.push_front(KeptScene {
            hash,
            bytes: scene.memory_bytes(),
            scene: Arc::clone(&scene),
            player,
        });
        Ok(scene)
    }

    /// Drops the jobs that have been cancelled.
    pub(super) fn drop_cancelled(&self) {
        let is_cancelled = |job: &UncompiledJob| job.cancelled.load(Ordering::Relaxed);
        lock(&self.state).waiting.retain(|job| !is_cancelled(job));
    }

    /// Drops all jobs and scenes; no job is handed out any more.
    pub(super) fn close(&self) {
        let mut state = lock(&self.state);
        state.closed = true;
        state.waiting = FairQueue::new();
        state.kept.clear();
        self.changed.notify_all();
    }
}

impl CompilerState {
    fn next(&mut self) -> Option<UncompiledJob> {
        self.waiting.next_mut()?.pop_front()
    }

    fn take_kept(&mut self, hash: SceneHash) -> Option<Arc<CompiledScene>> {
        let place = self.kept.iter().position(|kept| kept.hash == hash)?;
        let kept = self.kept.remove(place)?;
        let scene = Arc::clone(&kept.scene);
        self.kept.push_front(kept);
        Some(scene)
    }

    /// Drops unused scenes, the least recently used first, until another one of `bytes` fits. The player of
    /// this process is not limited to its part.
    fn make_room(&mut self, bytes: u64, player: PlayerId) -> Result<(), RefusalReason> {
        let is_local = player == PlayerId::LOCAL;
        let share = self.bytes_max / PLAYER_PARTS;
        if bytes > share && !is_local {
            return Err(RefusalReason::Invalid(format!(
                "its scene takes some {} MiB of memory, of at most {} MiB for a player here: use smaller textures and \
                 fewer triangles, or give the node more (`carom-farm node --scene-memory`)",
                bytes.div_ceil(1 << 20),
                share >> 20
            )));
        }
        loop {
            let (all, own) = (
                self.bytes(|_| true),
                self.bytes(|kept| kept.player == player),
            );
            let own_fits = is_local || own + bytes <= share;
            let fits = is_local || (own_fits && all + bytes <= self.bytes_max);
            if fits && all + bytes <= self.bytes_max && self.kept.len() < SCENES_KEPT_MAX {
                return Ok(());
            }
            let is_unused =
                |kept: &KeptScene| !kept.is_in_use() && (own_fits || kept.player == player);
            match self.kept.iter().rposition(is_unused) {
                Some(unused) => drop(self.kept.remove(unused)),
                // More scenes than usual are in use, one or more per player.
                None if fits => return Ok(()),
                // The memory is held by requests for other scenes until these are done.
                None => return Err(RefusalReason::Busy),
            }
        }
    }

    fn bytes(&self, of: impl Fn(&KeptScene) -> bool) -> u64 {
        let kept = self.kept.iter().filter(|kept| of(kept));
        kept.map(|kept| kept.bytes).sum()
    }
}

/// Memory of a scene once compiled, predicted before anything is decoded: texels with their mip levels (Σ
/// 4⁻ⁱ = 4/3), triangles with their BVH, and the other objects.
fn predicted_bytes(scene: &Scene) -> Result<u64, SceneError> {
    let texels = scene.texture_bytes()?;
    let triangles = scene.objects.iter().map(|object| match &object.shape {
        Shape::Mesh(mesh) => mesh.triangles.len() as u64,
        _ => 0,
    });
    Ok(texels
        + texels / 3
        + triangles.sum::<u64>() * TRIANGLE_BYTES
        + scene.objects.len() as u64 * OBJECT_BYTES)
}

fn invalid(why: &impl ToString) -> RefusalReason {
    RefusalReason::Invalid(why.to_string())
}

/// Default limit of the memory of all compiled scenes of a node, in bytes.
pub(super) const SCENE_BYTES_MAX: u64 = 1 << 30;
/// A player may use one of so many parts of it.
const PLAYER_PARTS: u64 = 2;
/// Maximum number of compiled scenes, unless more are in use.
const SCENES_KEPT_MAX: usize = 8;
const TRIANGLE_BYTES: u64 = 256;
const OBJECT_BYTES: u64 = 256;

#[cfg(test)]
mod tests {
    use super::*;

    const MIB: u64 = 1 << 20;

    fn player(name: &str) -> PlayerId {
        PlayerId::of_key(name.as_bytes())
    }

    fn kept(name: u8, bytes: u64, player: PlayerId) -> KeptScene {
        let scene = include_str!("../../../assets/scenes/pool.json");
        let scene = Scene::from_json(scene).unwrap();
        KeptScene {
            hash: SceneHash([name; 32]),
            scene: Arc::new(CompiledScene::new(&scene).unwrap()),
            bytes,
            player,
        }
    }

    fn state(kept: Vec<KeptScene>) -> CompilerState {
        CompilerState {
            waiting: FairQueue::new(),
            kept: kept.into(),
            bytes_max: 400 * MIB,
            closed: false,
        }
    }

    #[test]
    fn scenes_that_were_not_used_for_longest_make_room() {
        let (near, far) = (player("near"), player("far"));
        let mut state = state(vec![
            kept(0, 150 * MIB, near),
            kept(1, 150 * MIB, far),
            kept(2, 50 * MIB, far),
        ]);
        state.make_room(100 * MIB, player("other")).unwrap();
        let left: Vec<u8> = state.kept.iter().map(|kept| kept.hash.0[0]).collect();
        assert_eq!(left, [0, 1]);
    }

    #[test]
    fn a_player_has_its_part_of_the_memory_and_no_more() {
        let (near, far) = (player("near"), player("far"));
        let mut state = state(vec![kept(0, 150 * MIB, near), kept(1, 150 * MIB, far)]);
        let why = state.make_room(201 * MIB, far).unwrap_err();
        let RefusalReason::Invalid(why) = why else {
            panic!("{why:?}");
        };
        assert!(
            why.contains("201 MiB of memory, of at most 200 MiB"),
            "{why}"
        );
        // Its own scenes are dropped first, though another player's was used less recently.
        state.kept.swap(0, 1);
        state.make_room(100 * MIB, far).unwrap();
        let left: Vec<u8> = state.kept.iter().map(|kept| kept.hash.0[0]).collect();
        assert_eq!(left, [0]);
        // Scenes that requests use stay.
        state.kept.push_front(kept(2, 150 * MIB, far));
        let in_use = Arc::clone(&state.kept[0].scene);
        assert_eq!(state.make_room(100 * MIB, far), Err(RefusalReason::Busy));
        drop(in_use);
        state.make_room(100 * MIB, far).unwrap();
    }

    #[test]
    fn any_number_of_players_may_use_scenes_of_their_own() {
        let mut state = state(Vec::new());
        let mut in_use = Vec::new();
        for index in 0..2 * SCENES_KEPT_MAX as u8 {
            let player = player(&index.to_string());
            state.make_room(MIB, player).unwrap();
            state.kept.push_front(kept(index, MIB, player));
            in_use.push(Arc::clone(&state.kept[0].scene));
        }
        drop(in_use);
        state.make_room(MIB, player("last")).unwrap();
        assert_eq!(state.kept.len(), SCENES_KEPT_MAX - 1);
    }

    #[test]
    fn scenes_are_priced_before_they_are_decoded() {
        let scene = include_str!("../../../assets/scenes/pool.json");
        let scene = Scene::from_json(scene).unwrap();
        let compiled = CompiledScene::new(&scene).unwrap().memory_bytes();
        let predicted = predicted_bytes(&scene).unwrap();
        assert!(
            (compiled / 2..compiled * 8).contains(&predicted),
            "{predicted} for {compiled}"
        );
    }
}
