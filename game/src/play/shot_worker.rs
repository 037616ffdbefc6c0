//! Simulation of a shot through particles on a thread, as it may take seconds.

use std::sync::mpsc::{Receiver, TryRecvError, channel};
use std::thread;

use carom_billiards::physics::{Shot, Stroke, World};

use super::cue::CueView;

/// A stroke whose shot is being simulated.
#[derive(Debug)]
pub(super) struct ShotWorker {
    /// The stroke.
    pub(super) stroke: Stroke,
    /// The cue, drawn back until the simulation has finished.
    pub(super) cue: Option<CueView>,
    shot: Receiver<carom_billiards::Result<Shot>>,
}

impl ShotWorker {
    /// Starts the simulation.
    ///
    /// # Errors
    /// [`carom_billiards::Error::NoThread`] if the thread cannot be started.
    pub(super) fn start(
        world: &World,
        stroke: Stroke,
        cue: Option<CueView>,
    ) -> carom_billiards::Result<Self> {
        let (sender, shot) = channel();
        let world = world.clone();
        let run = move || {
            // The receiver is gone if the shot was cancelled.
            let _ = sender.send(world.strike(stroke));
        };
        thread::Builder::new()
            .name("particles".to_owned())
            .spawn(run)
            .map_err(carom_billiards::Error::NoThread)?;
        Ok(Self { stroke, cue, shot })
    }

    /// The result, once the simulation has finished.
    pub(super) fn poll(&self) -> Option<carom_billiards::Result<Shot>> {
        match self.shot.try_recv() {
            Ok(shot) => Some(shot),
            Err(TryRecvError::Empty) => None,
            Err(TryRecvError::Disconnected) => Some(Err(carom_billiards::Error::ShotBrokeOff)),
        }
    }
}
