//! Adapter of [`DelayBasedController`] to quinn's `Controller`.

use std::any::Any;
use std::sync::Arc;
use std::time::{Duration, Instant};

use quinn::Connection;
use quinn::congestion::{Controller, ControllerFactory};

use super::delay_based::{self, DelayBasedController};

/// Factory of controllers for quinn's connections.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct ControllerConfig;

impl ControllerFactory for ControllerConfig {
    fn build(self: Arc<Self>, now: Instant, current_mtu: u16) -> Box<dyn Controller> {
        Box::new(QuinnController {
            start: now,
            inner: DelayBasedController::new(Duration::ZERO, current_mtu),
        })
    }
}

/// Bytes in flight that the path of a connection has been seen to carry; with one of quinn's controllers,
/// its whole window.
pub(crate) fn validated_bytes(connection: &Connection) -> u64 {
    match connection
        .congestion_state()
        .into_any()
        .downcast::<QuinnController>()
    {
        Ok(controller) => controller.inner.validated_bytes(),
        Err(_) => connection.stats().path.cwnd,
    }
}

#[derive(Clone, Debug)]
struct QuinnController {
    start: Instant,
    inner: DelayBasedController,
}

impl QuinnController {
    fn since_start(&self, instant: Instant) -> Duration {
        instant.saturating_duration_since(self.start)
    }
}

impl Controller for QuinnController {
    fn on_ack(
        &mut self,
        now: Instant,
        sent: Instant,
        bytes: u64,
        app_limited: bool,
        _: &quinn_proto::RttEstimator,
    ) {
        let (now, sent) = (self.since_start(now), self.since_start(sent));
        self.inner.on_ack(now, sent, bytes, app_limited);
    }

    fn on_end_acks(&mut self, now: Instant, _: u64, _: bool, _: Option<u64>) {
        self.inner.on_end_acks(self.since_start(now));
    }

    fn on_congestion_event(
        &mut self,
        now: Instant,
        _: Instant,
        is_persistent_congestion: bool,
        lost_bytes: u64,
    ) {
        if is_persistent_congestion {
            self.inner.on_persistent_congestion(self.since_start(now));
        } else {
            self.inner.on_loss(lost_bytes);
        }
    }

    fn on_mtu_update(&mut self, new_mtu: u16) {
        self.inner.on_mtu_update(new_mtu);
    }

    fn window(&self) -> u64 {
        self.inner.window_bytes()
    }

    fn clone_box(&self) -> Box<dyn Controller> {
        Box::new(self.clone())
    }

    fn initial_window(&self) -> u64 {
        delay_based::initial_cwnd(Duration::ZERO) as u64
    }

    fn into_any(self: Box<Self>) -> Box<dyn Any> {
        self
    }
}
