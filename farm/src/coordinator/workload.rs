//! A node's open requests, and the forecast of when their tiles arrive.
//!
//! A node works on one request at a time, those of the oldest frame first, and sends tiles as they finish.
//! The tiles that have arrived therefore show how late the rest will be, long before the last one.

use std::cmp::Ordering;
use std::collections::BTreeMap;

use carom_protocol::{FrameId, RequestId};
use carom_tracer::{DeviceKind, TileRange};

use super::arrival_model::{ArrivalModel, FrameDelay};
use super::open_request::OpenRequest;
use crate::balancer::{Estimate, Estimator, Observation};

/// Requests of one node, and the models learned from its answers. Times are seconds on the client's clock.
#[derive(Debug, Default)]
pub(super) struct Workload {
    pub(super) requests: BTreeMap<RequestId, OpenRequest>,
    pub(super) estimator: Estimator,
    pub(super) arrivals: ArrivalModel,
    pub(super) delay: FrameDelay,
    /// Maximum work that has arrived for one frame.
    pub(super) proven_work: f64,
    /// The frame of the last message, and the work that has arrived for it.
    current: (FrameId, f64),
    /// The last frame with a cancelled request.
    last_cancelled: Option<FrameId>,
    /// When the last message came, or the first request was sent to the idle node, whichever is later.
    pub(super) last_heard: f64,
    /// Since when the node has been silent, if it has exceeded its timeout.
    pub(super) silent_since: Option<f64>,
}

/// Expected course of a request whose tiles are still wanted.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct RequestForecast {
    pub(super) id: RequestId,
    pub(super) frame: FrameId,
    /// When its missing work begins to be delivered, on the client's clock: the last missing tile arrives
    /// at `begin + pace · outstanding`.
    pub(super) begin: f64,
    /// Lower bound of `begin`: assumes that a late message was only delayed by the network.
    pub(super) soonest: f64,
    /// Seconds per unit of work.
    pub(super) pace: f64,
    pub(super) outstanding: f64,
}

impl RequestForecast {
    pub(super) fn finish(&self) -> f64 {
        self.begin + self.pace * self.outstanding
    }
}

impl Workload {
    /// Adds a request that is being sent.
    pub(super) fn add(&mut self, now: f64, id: RequestId, mut request: OpenRequest) {
        if self.requests.is_empty() {
            self.last_heard = now;
        }
        request.is_lost = self.silent_since.is_some();
        self.requests.insert(id, request);
    }

    /// Forgets all requests and returns how many tiles are lost. The estimates stay, as the node is most
    /// likely the same when it reconnects, but `proven_work` starts anew.
    pub(super) fn clear(&mut self) -> u64 {
        let requests = std::mem::take(&mut self.requests);
        self.silent_since = None;
        self.proven_work = 0.0;
        requests.values().map(OpenRequest::lost_tiles).sum()
    }

    /// Records a message about a request of a frame: tiles, or the request's end. Requests issued after it,
    /// or of later frames, have been waiting until then. Returns whether the node was silent.
    pub(super) fn hear(&mut self, now: f64, about: RequestId, frame: FrameId) -> bool {
        self.last_heard = now;
        for (id, request) in &mut self.requests {
            if *id > about || request.frame > frame {
                request.others_until = now;
            }
        }
        let was_silent = self.silent_since.take().is_some();
        if was_silent {
            self.arrivals.back_off();
            let requests = self.requests.values_mut();
            requests.for_each(|request| request.is_lost = false);
        }
        was_silent
    }

    /// Records tiles of a request that took the node `busy_secs`. `frame_work` is their work in their
    /// frame, if the frame still exists. Returns whether the node was silent.
    pub(super) fn receive(
        &mut self,
        now: f64,
        id: RequestId,
        tiles: TileRange,
        busy_secs: f64,
        frame_work: Option<f64>,
    ) -> bool {
        let cost = self.delivered();
        let Some(frame) = self.requests.get(&id).map(|request| request.frame) else {
            return false;
        };
        // Before the tiles are recorded, as that moves the expected time of the next message, and `current`
        // to this frame.
        self.observe_delay(now, id);
        let is_first = self.is_new(frame);
        let was_silent = self.hear(now, id, frame);
        let Some(request) = self.requests.get_mut(&id) else {
            return was_silent;
        };
        // Without the frame, the work is estimated by the share of the request's tiles.
        let share = f64::from(tiles.count) / f64::from(request.tiles.count);
        let work = frame_work.unwrap_or(request.work * share);
        if frame_work.is_some() {
            request.pieces.push((tiles, work, busy_secs));
        }
        request.receive(now, tiles, work, busy_secs, cost, is_first);
        self.prove(frame, work);
        was_silent
    }

    /// Learns the lateness of a message, if it is about the request that was expected to be served next.
    fn observe_delay(&mut self, now: f64, id: RequestId) {
        let (Some(expected), Some(cost)) = (self.next_message(None), self.delivered()) else {
            return;
        };
        let Some((_, request)) = self.next_request(cost).filter(|(next, _)| *next == id) else {
            return;
        };
        let secs = now - expected;
        // Its expected time was computed from the message before it, so that the delay of that one is
        // included.
        let sent = request.issued + cost.fixed_secs;
        let follows = request.tiles_received > 0 || request.others_until > sent;
        let frame = request.frame;
        self.arrivals.observe(secs, self.is_new(frame));
        self.delay.observe(frame, secs, follows);
    }

    /// Whether the last message was of another frame.
    fn is_new(&self, frame: FrameId) -> bool {
        self.current.0 != frame
    }

    fn prove(&mut self, frame: FrameId, work: f64) {
        let before = if self.is_new(frame) {
            0.0
        } else {
            self.current.1
        };
        self.current = (frame, before + work);
        self.proven_work = self.proven_work.max(before + work);
    }

    /// What has arrived of a request, as an observation for the estimator; `None` if nothing has.
    pub(super) fn observation(
        &self,
        id: RequestId,
        round_trip_secs: Option<f64>,
    ) -> Option<Observation> {
        let request = self.requests.get(&id)?;
        if request.tiles_received == 0 || request.work_received <= 0.0 {
            return None;
        }
        let response_secs = (request.last_heard - request.issued).max(0.0);
        Some(Observation {
            work: request.work_received,
            response_secs,
            queue_secs: request.queue_secs(round_trip_secs).min(response_secs),
            busy_secs: request.busy_secs.clamp(0.0, response_secs),
            round_trip_secs,
        })
    }

    /// Marks a request as cancelled, and learns from its lateness.
    pub(super) fn cancel(&mut self, now: f64, id: RequestId, round_trip_secs: Option<f64>) {
        let Some(request) = self.requests.get_mut(&id) else {
            return;
        };
        request.is_cancelled = true;
        let late = request.expected.is_none_or(|expected| now >= expected);
        let missed = late && request.tiles_received == 0;
        let secs = now - request.issued;
        let queue_secs = request.queue_secs(round_trip_secs);
        // The requests of one frame are sent and late together: they are one observation, not several.
        if self.last_cancelled.replace(request.frame) != Some(request.frame) {
            self.estimator
                .observe_late(request.work, secs, queue_secs, missed);
        }
    }

    /// The cost model by which work is divided.
    pub(super) fn estimate(&self) -> Option<Estimate> {
        self.estimator.estimate()
    }

    /// The cost model by which arrivals are predicted.
    pub(super) fn delivered(&self) -> Option<Estimate> {
        self.estimator.delivered()
    }

    /// Requested work that has not arrived and is still wanted.
    pub(super) fn outstanding(&self) -> f64 {
        self.requests.values().map(OpenRequest::outstanding).sum()
    }

    /// Seconds that a new request for a frame would wait behind others; if these are late, they are
    /// expected to be late by as much again.
    pub(super) fn wait_secs(&self, now: f64, frame: FrameId) -> f64 {
        let Some(cost) = self.delivered() else {
            return 0.0;
        };
        let asked = now + cost.fixed_secs + self.delay.secs(frame);
        begins_after(&self.forecast(now, None), frame, asked) - asked
    }

    /// Forecasts of the wanted requests in the order in which the node serves them. `newcomer` is the cost
    /// assumed of a node that has delivered nothing.
    pub(super) fn forecast(&self, now: f64, newcomer: Option<Estimate>) -> Vec<RequestForecast> {
        let Some(cost) = self.delivered().or(newcomer) else {
            return Vec::new();
        };
        let requests = self.requests.iter();
        let wanted = requests.filter(|(_, request)| request.outstanding() > 0.0);
        let mut waiting: Vec<(&RequestId, &OpenRequest)> = wanted.collect();
        waiting.sort_by_key(|(_, request)| request.frame);
        let mut forecast: Vec<RequestForecast> = Vec::with_capacity(waiting.len());
        // Simulates the node's queue: `served_next` picks the request that the node would turn to, which
        // then delays all others by its outstanding work.
        let (mut pace, mut soonest) = (cost.secs_per_work, f64::NEG_INFINITY);
        while !waiting.is_empty() {
            let before = forecast.last().map(RequestForecast::finish);
            let (id, request) = waiting.remove(served_next(&waiting, cost, before));
            let asked = request.begins(cost);
            let seen = request.pace(self.arrivals.margin_secs());
            // A slowdown is assumed to persist for the requests that follow; scatter below the threshold is
            // ignored.
            if seen > SLOWED * pace {
                pace = seen;
            }
            let mut begin = before.map_or(asked, |before| before.max(asked));
            soonest = asked.max(soonest);
            if before.is_none() {
                // A message that is late by d is expected in another d: the longer it is overdue, the
                // longer the rest of the delay. `begin` moves by both.
                let next = begin + pace * self.arrivals.next_message_work(request);
                begin += 2.0 * (now - next).max(0.0);
            }
            forecast.push(RequestForecast {
                id: *id,
                frame: request.frame,
                begin,
                soonest,
                pace,
                outstanding: request.outstanding(),
            });
            soonest += pace * request.outstanding();
        }
        forecast
    }

    /// Expected time of the next message; `None` if nothing is requested or nothing is known of the node.
    pub(super) fn next_message(&self, newcomer: Option<Estimate>) -> Option<f64> {
        let cost = self.delivered().or(newcomer)?;
        let (_, request) = self.next_request(cost)?;
        Some(request.begins(cost) + cost.secs_per_work * self.arrivals.next_message_work(request))
    }

    /// The request that the node is working on, as far as its messages tell.
    fn next_request(&self, cost: Estimate) -> Option<(RequestId, &OpenRequest)> {
        let requests = self.requests.iter();
        let wanted = requests.filter(|(_, request)| request.outstanding() > 0.0);
        let (id, request) = wanted.min_by(|(_, a), (_, b)| {
            let order = earlier(a, b, cost);
            order.then(a.frame.cmp(&b.frame))
        })?;
        Some((*id, request))
    }

    /// Marks requests as lost if the node has exceeded its timeout, and returns how many tiles that are.
    /// Requests that the node should not have reached yet are not lost.
    pub(super) fn time_out(&mut self, now: f64, hedged: bool, device: DeviceKind) -> Option<u64> {
        self.silence_due(hedged, device).filter(|due| *due <= now)?;
        // Hedged, only the frames whose own deadline has passed are lost; otherwise everything is.
        let ends = self.timeouts_by_frame().filter(|_| hedged);
        let is_lost = |request: &OpenRequest| match &ends {
            Some(ends) => ends.get(&request.frame).is_none_or(|end| *end <= now),
            None => true,
        };
        let mut lost_tiles = 0;
        for request in self
            .requests
            .values_mut()
            .filter(|request| is_lost(request))
        {
            lost_tiles += request.lost_tiles();
            request.is_lost = true;
        }
        self.silent_since = self.silent_since.or(Some(self.last_heard));
        Some(lost_tiles)
    }

    /// When the node counts as silent, or when further requests count as lost, if no message comes.
    /// `hedged` selects a timeout from the statistics of its messages instead of a generous multiple of its
    /// predicted work.
    pub(super) fn silence_due(&self, hedged: bool, device: DeviceKind) -> Option<f64> {
        if self.silent_since.is_some() {
            let ends = self.timeouts_by_frame().filter(|_| hedged)?;
            return ends.into_values().reduce(f64::min);
        }
        // Cancelled requests count too, as the node has to acknowledge them.
        if self.requests.is_empty() {
            return None;
        }
        if hedged && let Some(due) = self.timeout() {
            return Some(due);
        }
        let patience_secs = match self.delivered() {
            Some(cost) => {
                let work_secs = cost.secs_per_work * self.outstanding();
                let predicted = cost.fixed_secs + SILENCE_FACTOR * work_secs;
                predicted + silence_margin_secs(device)
            }
            None => NEWCOMER_PATIENCE_SECS,
        };
        Some(self.last_heard + patience_secs)
    }

    /// When the node counts as silent by the statistics of its messages.
    fn timeout(&self) -> Option<f64> {
        Some(self.next_message(None)? + self.timeout_secs()?)
    }

    /// The same for each frame that the node still holds, from the expected first message of that frame:
    /// most stalls end, and the requests of later frames wait their turn meanwhile.
    fn timeouts_by_frame(&self) -> Option<BTreeMap<FrameId, f64>> {
        let timeout_secs = self.timeout_secs()?;
        let mut ends = BTreeMap::new();
        // With `now` = 0 no message counts as late, so that these deadlines do not move while they are
        // waited for.
        for forecast in self.forecast(0.0, None) {
            let request = &self.requests[&forecast.id];
            let work = self.arrivals.next_message_work(request);
            let next = forecast.soonest + forecast.pace * work;
            if !request.is_lost {
                ends.entry(request.frame).or_insert(next + timeout_secs);
            }
        }
        Some(ends)
    }

    fn timeout_secs(&self) -> Option<f64> {
        let mut frames = self.requests.values().map(|request| request.frame);
        let first = frames.next();
        let several_frames = frames.any(|frame| Some(frame) != first);
        self.arrivals.timeout_secs(several_frames)
    }
}

/// Index into `waiting`, sorted by frame, of the request that a node serves next when it becomes free at
/// `free`: among those that have reached it by then the oldest frame's, else the one that reaches it first.
fn served_next(waiting: &[(&RequestId, &OpenRequest)], cost: Estimate, free: Option<f64>) -> usize {
    let is_there = |(_, request): &(&RequestId, &OpenRequest)| {
        free.is_some_and(|free| request.begins(cost) <= free)
    };
    let sooner = |a: &usize, b: &usize| earlier(waiting[*a].1, waiting[*b].1, cost);
    let there = waiting.iter().position(is_there);
    let first = || (0..waiting.len()).min_by(sooner);
    there.or_else(first).unwrap_or(0)
}

/// Order of service of a node's requests; at equal times, the one already begun comes first.
fn earlier(a: &OpenRequest, b: &OpenRequest, cost: Estimate) -> Ordering {
    let waits = |request: &OpenRequest| request.tiles_received == 0;
    let begins = a.begins(cost).total_cmp(&b.begins(cost));
    begins.then(waits(a).cmp(&waits(b)))
}

/// When a new request for `frame` would begin to be delivered, given that it could from `asked` on and the
/// node has the requests of `forecast`: a node serves the oldest frame first, but finishes the request that
/// it has begun.
pub(super) fn begins_after(forecast: &[RequestForecast], frame: FrameId, asked: f64) -> f64 {
    forecast.iter().fold(asked, |begin, before| {
        if before.frame <= frame || before.begin < begin {
            begin.max(before.finish())
        } else {
            begin
        }
    })
}

/// Extra patience in seconds: a CPU node that also runs the client stalls whenever the system gives its
/// cores to other threads.
fn silence_margin_secs(device: DeviceKind) -> f64 {
    match device {
        DeviceKind::Gpu => 0.03,
        DeviceKind::Cpu | DeviceKind::Scalar => 0.25,
    }
}

/// Measured pace, relative to the assumed one, from which a node is taken to have slowed down.
const SLOWED: f64 = 2.0;
/// Multiple of the predicted duration of its work after which an unhedged node counts as silent.
const SILENCE_FACTOR: f64 = 6.0;
/// Timeout of a node's very first tiles, of unknown cost, in seconds.
const NEWCOMER_PATIENCE_SECS: f64 = 5.0;

#[cfg(test)]
mod tests {
    use carom_tracer::{ImageSize, TileGrid};

    use super::super::arrival_model::{LOST_SECS_MIN, MESSAGES_MIN};
    use super::super::sample_passes::SamplePasses;
    use super::*;

    const FIXED_SECS: f64 = 0.01;
    const PACE: f64 = 0.001;
    const GPU: DeviceKind = DeviceKind::Gpu;

    /// A workload of known cost with requests for ten tiles each, as pairs of frame and time of issue.
    fn workload(asked: &[(u64, f64)]) -> Workload {
        let mut workload = Workload::default();
        workload.estimator.observe(&Observation {
            work: 100.0,
            response_secs: FIXED_SECS + 100.0 * PACE,
            queue_secs: 0.0,
            busy_secs: 100.0 * PACE,
            round_trip_secs: Some(FIXED_SECS),
        });
        let passes = SamplePasses::one(TileGrid::new(ImageSize::new(40, 1), 1), 1);
        for (id, (frame, issued)) in asked.iter().enumerate() {
            let tiles = TileRange {
                first: 0,
                count: 10,
            };
            let request = OpenRequest::new(*issued, FrameId(*frame), passes, tiles, 10.0);
            workload.add(*issued, RequestId(id as u64), request);
        }
        workload
    }

    fn order(workload: &Workload, now: f64) -> Vec<u64> {
        let forecast = workload.forecast(now, None);
        forecast.iter().map(|request| request.id.0).collect()
    }

    #[test]
    fn reissued_tiles_of_older_frame_run_first() {
        let mut workload = workload(&[(1, 0.0), (1, 0.0), (1, 0.0), (0, 0.002)]);
        // It arrives while the first is being traced, which is finished before it.
        assert_eq!(order(&workload, 0.002), [0, 3, 1, 2]);
        let [first, again, ..] = workload.forecast(0.002, None)[..] else {
            unreachable!()
        };
        assert!((again.begin - first.finish()).abs() < 1e-12);
        // A message of the first shows that the others have waited.
        workload.hear(0.015, RequestId(0), FrameId(1));
        let mut others = workload.requests.values().skip(1);
        assert!(others.all(|request| request.others_until == 0.015));
        let wait = |frame| workload.wait_secs(0.002, FrameId(frame));
        assert!(wait(2) > wait(0) + 19.0 * PACE, "{} {}", wait(2), wait(0));
    }

    #[test]
    fn older_frame_that_arrives_too_late_runs_last() {
        let workload = workload(&[(1, 0.0), (1, 0.0), (0, 0.015)]);
        assert_eq!(order(&workload, 0.015), [0, 1, 2]);
    }

    #[test]
    fn pause_before_a_frame_is_no_slowness_but_gaps_are() {
        let mut workload = workload(&[(0, 0.0), (1, 0.0)]);
        let cost = workload.delivered();
        let eight = TileRange { first: 0, count: 8 };
        let request = workload.requests.get_mut(&RequestId(1)).unwrap();
        request.others_until = 0.02;
        let mut slow = request.clone();
        request.receive(0.048, eight, 8.0, 0.008, cost, true);
        assert_eq!(request.pace(0.0), 0.0);
        slow.receive(0.048, eight, 8.0, 0.008, cost, false);
        assert!((slow.pace(0.0) - 3.5 * PACE).abs() < 1e-12);
    }

    #[test]
    fn silent_node_keeps_what_is_not_due_yet() {
        let mut workload = workload(&[(0, 0.0), (0, 0.0), (1, 0.016)]);
        (0..MESSAGES_MIN).for_each(|_| workload.arrivals.observe(0.0, true));
        let lost = |workload: &Workload| -> Vec<bool> {
            let requests = workload.requests.values();
            requests.map(|request| request.is_lost).collect()
        };
        // The first message of frame 0 is due at 20 ms, that of frame 1 at 40.
        let first = FIXED_SECS + 10.0 * PACE + LOST_SECS_MIN;
        assert_eq!(workload.time_out(first - 1e-6, true, GPU), None);
        assert_eq!(workload.time_out(first + 1e-6, true, GPU), Some(20));
        assert_eq!(lost(&workload), [true, true, false]);
        // Work requested during silence is not relied on.
        let more = workload.requests[&RequestId(2)].clone();
        workload.add(first, RequestId(3), more);
        assert_eq!(lost(&workload), [true, true, false, true]);
        let second = first + 20.0 * PACE;
        assert_eq!(workload.time_out(second - 1e-6, true, GPU), None);
        assert_eq!(workload.time_out(second + 1e-6, true, GPU), Some(10));
        assert_eq!(lost(&workload), [true; 4]);
        assert!(workload.hear(second + 1e-3, RequestId(0), FrameId(0)));
        assert_eq!(lost(&workload), [false; 4]);
    }

    #[test]
    fn unhedged_node_loses_all_at_once() {
        let mut workload = workload(&[(0, 0.0), (1, 0.016)]);
        (0..MESSAGES_MIN).for_each(|_| workload.arrivals.observe(0.0, true));
        assert_eq!(workload.time_out(10.0, false, GPU), Some(20));
    }

    #[test]
    fn early_messages_make_forecasts_earlier() {
        let mut workload = workload(&[(0, 0.0), (1, 0.0)]);
        workload.delay.observe(FrameId(0), -0.003, false);
        // Frame 0 ends at 20 ms; more of it, requested at 12 ms, could begin at 19 ms, just before that.
        let asked = 0.012;
        let begins = asked + FIXED_SECS - 0.003 + workload.wait_secs(asked, FrameId(0));
        assert!((begins - 0.020).abs() < 1e-12, "{begins}");
        let mut more = workload.requests[&RequestId(0)].clone();
        (more.issued, more.delay_secs) = (asked, workload.delay.secs(FrameId(0)));
        workload.add(asked, RequestId(2), more);
        let forecast = workload.forecast(asked, None);
        assert_eq!(forecast[1].id, RequestId(2));
        assert!((forecast[1].begin - begins).abs() < 1e-12);
    }

    #[test]
    fn cancelled_requests_are_learned_from_once_a_frame() {
        let mut workload = workload(&[(0, 0.0), (0, 0.0)]);
        let before = workload.estimate().unwrap().secs_per_work;
        workload.cancel(1.0, RequestId(0), Some(FIXED_SECS));
        let after = workload.estimate().unwrap().secs_per_work;
        assert!(after > 1.2 * before, "{after}");
        workload.cancel(1.0, RequestId(1), Some(FIXED_SECS));
        assert_eq!(workload.estimate().unwrap().secs_per_work, after);
        assert_eq!(
            (workload.outstanding(), workload.forecast(1.0, None)),
            (0.0, vec![])
        );
    }
}
