//! Playback of a scene's animation: which one, at what time, and how fast.

use std::sync::Arc;

use carom_farm::SceneAnimation;

/// State of the playback.
#[derive(Clone, Debug)]
pub(crate) struct Playback {
    animations: Arc<[SceneAnimation]>,
    animation: usize,
    /// Time since the animation's start.
    secs: f64,
    /// Seconds of the animation per second.
    pub(crate) speed: f64,
    is_playing: bool,
    /// Time of the last advance.
    advanced: Option<f64>,
}

impl Default for Playback {
    fn default() -> Self {
        Self::new(Arc::new([]))
    }
}

impl Playback {
    /// Playback stopped at the start of the first animation.
    pub(crate) fn new(animations: Arc<[SceneAnimation]>) -> Self {
        Self {
            animations,
            animation: 0,
            secs: 0.0,
            speed: 1.0,
            is_playing: false,
            advanced: None,
        }
    }

    /// Continues with a reread file if its animations are the same, otherwise starts anew.
    pub(crate) fn reread(&mut self, animations: Arc<[SceneAnimation]>) {
        if animations != self.animations {
            *self = Self::new(animations);
        }
    }

    /// All animations of the scene.
    pub(crate) fn animations(&self) -> &Arc<[SceneAnimation]> {
        &self.animations
    }

    /// The animation to show and the time in it in seconds; `None` if the scene has none.
    pub(crate) fn time(&self) -> Option<(usize, f64)> {
        let animation = self.animations.get(self.animation)?;
        Some((self.animation, self.secs.min(animation.duration_secs)))
    }

    pub(crate) fn duration_secs(&self) -> f64 {
        let animation = self.animations.get(self.animation);
        animation.map_or(0.0, |animation| animation.duration_secs)
    }

    pub(crate) fn is_playing(&self) -> bool {
        self.is_playing
    }

    /// Starts or stops playing.
    pub(crate) fn toggle(&mut self) {
        self.is_playing = !self.is_playing && self.duration_secs() > 0.0;
        self.advanced = None;
    }

    /// Moves to another time.
    pub(crate) fn seek(&mut self, secs: f64) {
        self.secs = secs.clamp(0.0, self.duration_secs());
    }

    /// Selects another animation, from its start.
    pub(crate) fn choose(&mut self, animation: usize) {
        self.animation = animation;
        self.secs = 0.0;
        self.is_playing &= self.duration_secs() > 0.0;
    }

    /// Advances to the present time; at its end the animation starts again.
    pub(crate) fn advance(&mut self, now_secs: f64) {
        if !self.is_playing {
            return;
        }
        if let Some(before) = self.advanced.replace(now_secs) {
            self.secs += self.speed * (now_secs - before).max(0.0);
            // The duration is not 0, or nothing would play.
            self.secs %= self.duration_secs();
        }
    }
}

/// Minimum and maximum speed.
pub(crate) const SPEEDS: [f64; 2] = [0.05, 8.0];

#[cfg(test)]
mod tests {
    use super::*;

    fn animations(durations: &[f64]) -> Arc<[SceneAnimation]> {
        let animations = durations.iter().map(|duration_secs| SceneAnimation {
            name: String::new(),
            duration_secs: *duration_secs,
        });
        animations.collect()
    }

    #[test]
    fn it_plays_at_its_speed_and_begins_again_at_the_end() {
        let mut playback = Playback::new(animations(&[2.0, 5.0]));
        playback.advance(1.0);
        assert_eq!(playback.time(), Some((0, 0.0)));
        playback.toggle();
        playback.speed = 0.5;
        for now_secs in [10.0, 11.0, 13.0] {
            playback.advance(now_secs);
        }
        assert_eq!(playback.time(), Some((0, 1.5)));
        playback.advance(14.5);
        assert_eq!(playback.time(), Some((0, 0.25)));
        playback.toggle();
        playback.advance(99.0);
        assert_eq!(playback.time(), Some((0, 0.25)));
        // The time while it was stopped does not count.
        playback.toggle();
        playback.advance(100.0);
        playback.seek(9.0);
        assert_eq!(playback.time(), Some((0, 2.0)));
        playback.choose(1);
        assert!(playback.is_playing());
        assert_eq!(
            (playback.time(), playback.duration_secs()),
            (Some((1, 0.0)), 5.0)
        );
    }

    #[test]
    fn what_does_not_move_does_not_play() {
        for durations in [&[][..], &[0.0]] {
            let mut playback = Playback::new(animations(durations));
            playback.toggle();
            playback.advance(1.0);
            playback.advance(2.0);
            assert!(!playback.is_playing());
            assert_eq!(playback.time(), durations.first().map(|_| (0, 0.0)));
        }
    }

    #[test]
    fn a_file_that_is_read_again_plays_on() {
        let mut playback = Playback::new(animations(&[2.0]));
        playback.seek(1.0);
        playback.reread(animations(&[2.0]));
        assert_eq!(playback.time(), Some((0, 1.0)));
        playback.reread(animations(&[3.0]));
        assert_eq!(playback.time(), Some((0, 0.0)));
    }
}
