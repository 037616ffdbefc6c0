//! A node's open requests, and the forecast of when their tiles come.
//!
//! A node works on one request after the other, of the oldest frame first, and sends tiles as they
//! finish, so that what it has sent tells how late the rest will be, long before the end.

use std::cmp::Ordering;
use std::collections::BTreeMap;

use carom_protocol::{FrameId, RequestId};
use carom_tracer::{DeviceKind, TileRange};

use super::arrival_model::{ArrivalModel, FrameDelay};
use super::open_request::OpenRequest;
use crate::balancer::{Estimate, Estimator, Observation};

/// Requests of one node, and what is learned from its answers. Times are seconds on the client's
/// clock.
#[derive(Debug, Default)]
pub(super) struct Workload {
    pub(super) requests: BTreeMap<RequestId, OpenRequest>,
    pub(super) estimator: Estimator,
    pub(super) arrivals: ArrivalModel,
    pub(super) delay: FrameDelay,
    /// The most work that came for one frame.
    pub(super) proven_work: f64,
    /// The frame of which something came last, and the work that has come for it.
    current: (FrameId, f64),
    /// The last frame of which something was cancelled.
    last_cancelled: Option<FrameId>,
    /// When it was last asked while nothing was open, or last answered.
    pub(super) last_heard: f64,
    /// Since when it has been silent for longer than it should need.
    pub(super) silent_since: Option<f64>,
}

/// A request that is still wanted, as it should go on.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct RequestForecast {
    pub(super) id: RequestId,
    pub(super) frame: FrameId,
    /// When the first of its missing work begins to count, by the client's clock: the last missing
    /// tile comes at `begin + pace · outstanding`.
    pub(super) begin: f64,
    /// The same if what is late is merely late on its way.
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

    /// Forgets all requests. The estimates stay, for the node is most likely the same when it comes
    /// back, but it has to prove them again. Returns how many tiles are lost.
    pub(super) fn clear(&mut self) -> u64 {
        let requests = std::mem::take(&mut self.requests);
        self.silent_since = None;
        self.proven_work = 0.0;
        requests.values().map(OpenRequest::lost_tiles).sum()
    }

    /// Notes that it delivers for a request of a frame, or says that it will not. `true` if it was
    /// silent. What it has been asked for later than that, or of a later frame, has waited meanwhile.
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

    /// Notes tiles of a request that took the node `busy_secs`. `frame_work` is what they are of their
    /// frame, if that is still known. `true` if the node was silent.
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
        // Before what comes is noted: that moves when the next message is expected, and `current` to this
        // frame.
        self.observe_delay(now, id);
        let is_first = self.is_new(frame);
        let was_silent = self.hear(now, id, frame);
        let Some(request) = self.requests.get_mut(&id) else {
            return was_silent;
        };
        let share = f64::from(tiles.count) / f64::from(request.tiles.count);
        let work = frame_work.unwrap_or(request.work * share);
        if frame_work.is_some() {
            request.pieces.push((tiles, work, busy_secs));
        }
        request.receive(now, tiles, work, busy_secs, cost, is_first);
        self.prove(frame, work);
        was_silent
    }

    /// Learns how late a message about a request is, if it is the one that was expected.
    fn observe_delay(&mut self, now: f64, id: RequestId) {
        let (Some(expected), Some(cost)) = (self.next_message(None), self.delivered()) else {
            return;
        };
        let Some((_, request)) = self.next_request(cost).filter(|(next, _)| *next == id) else {
            return;
        };
        let secs = now - expected;
        // Such a message was expected some time after the one before it, which had its own delay.
        let sent = request.issued + cost.fixed_secs;
        let follows = request.tiles_received > 0 || request.others_until > sent;
        let frame = request.frame;
        self.arrivals.observe(secs, self.is_new(frame));
        self.delay.observe(frame, secs, follows);
    }

    /// Whether what it has sent last was of another frame.
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

    /// What has come of a request, if anything, as the estimator sees it.
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

    /// Marks a request as not wanted, and learns from its lateness.
    pub(super) fn cancel(&mut self, now: f64, id: RequestId, round_trip_secs: Option<f64>) {
        let Some(request) = self.requests.get_mut(&id) else {
            return;
        };
        request.is_cancelled = true;
        let late = request.expected.is_none_or(|expected| now >= expected);
        let missed = late && request.tiles_received == 0;
        let secs = now - request.issued;
        let queue_secs = request.queue_secs(round_trip_secs);
        // What a node has been asked for at once is late together, and once.
        if self.last_cancelled.replace(request.frame) != Some(request.frame) {
            self.estimator
                .observe_late(request.work, secs, queue_secs, missed);
        }
    }

    /// The cost that work is divided by.
    pub(super) fn estimate(&self) -> Option<Estimate> {
        self.estimator.estimate()
    }

    /// The cost that work is waited for by.
    pub(super) fn delivered(&self) -> Option<Estimate> {
        self.estimator.delivered()
    }

    /// Work that it has been asked for and that is still wanted.
    pub(super) fn outstanding(&self) -> f64 {
        self.requests.values().map(OpenRequest::outstanding).sum()
    }

    /// Seconds that a request for a frame would wait for others: longer by as much again as these are
    /// late.
    pub(super) fn wait_secs(&self, now: f64, frame: FrameId) -> f64 {
        let Some(cost) = self.delivered() else {
            return 0.0;
        };
        let asked = now + cost.fixed_secs + self.delay.secs(frame);
        begins_after(&self.forecast(now, None), frame, asked) - asked
    }

    /// What it still has to do, in the order in which it does it. `newcomer` is assumed of a node
    /// that has delivered nothing.
    pub(super) fn forecast(&self, now: f64, newcomer: Option<Estimate>) -> Vec<RequestForecast> {
        let Some(cost) = self.delivered().or(newcomer) else {
            return Vec::new();
        };
        let requests = self.requests.iter();
        let wanted = requests.filter(|(_, request)| request.outstanding() > 0.0);
        let mut waiting: Vec<(&RequestId, &OpenRequest)> = wanted.collect();
        waiting.sort_by_key(|(_, request)| request.frame);
        let mut forecast: Vec<RequestForecast> = Vec::with_capacity(waiting.len());
        let (mut pace, mut soonest) = (cost.secs_per_work, f64::NEG_INFINITY);
        while !waiting.is_empty() {
            let before = forecast.last().map(RequestForecast::finish);
            let (id, request) = waiting.remove(served_next(&waiting, cost, before));
            let asked = request.begins(cost);
            let seen = request.pace(self.arrivals.margin_secs());
            // A node that has slowed down stays so for what follows; scatter below that does not count.
            if seen > SLOWED * pace {
                pace = seen;
            }
            let mut begin = before.map_or(asked, |before| before.max(asked));
            soonest = asked.max(soonest);
            if before.is_none() {
                // What is late is taken to be late by as much again.
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

    /// When its next message should come; absent if nothing is asked of it or known about it.
    pub(super) fn next_message(&self, newcomer: Option<Estimate>) -> Option<f64> {
        let cost = self.delivered().or(newcomer)?;
        let (_, request) = self.next_request(cost)?;
        Some(request.begins(cost) + cost.secs_per_work * self.arrivals.next_message_work(request))
    }

    /// The request that it is at, as far as can be told from what has come.
    fn next_request(&self, cost: Estimate) -> Option<(RequestId, &OpenRequest)> {
        let requests = self.requests.iter();
        let wanted = requests.filter(|(_, request)| request.outstanding() > 0.0);
        let (id, request) = wanted.min_by(|(_, a), (_, b)| {
            let order = earlier(a, b, cost);
            order.then(a.frame.cmp(&b.frame))
        })?;
        Some((*id, request))
    }

    /// Notes that requests have just been lost: work has been asked for, and nothing has come for far
    /// longer than predicted. Then the node is silent. What it should not have come to even now is not
    /// lost yet. Returns how many tiles are, if it is time.
    pub(super) fn time_out(&mut self, now: f64, hedged: bool, device: DeviceKind) -> Option<u64> {
        self.silence_due(hedged, device).filter(|due| *due <= now)?;
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

    /// When it counts as silent, or loses more, if nothing comes. `hedged` says to go by how its own
    /// messages come, not by a generous multiple of its work.
    pub(super) fn silence_due(&self, hedged: bool, device: DeviceKind) -> Option<f64> {
        if self.silent_since.is_some() {
            let ends = self.timeouts_by_frame().filter(|_| hedged)?;
            return ends.into_values().reduce(f64::min);
        }
        // A request that has been cancelled must be answered too.
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

    /// When it counts as lost if nothing comes, by how its messages come.
    fn timeout(&self) -> Option<f64> {
        Some(self.next_message(None)? + self.timeout_secs()?)
    }

    /// The same for each frame that it still holds, by when its first message for that one should
    /// come: most pauses end, and meanwhile what it is asked for later waits its turn.
    fn timeouts_by_frame(&self) -> Option<BTreeMap<FrameId, f64>> {
        let timeout_secs = self.timeout_secs()?;
        let mut ends = BTreeMap::new();
        // At time 0 nothing counts as late: these ends do not move while they are waited for.
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

/// Among requests in the order of their frames, the place of the one that a node turns to when it is
/// through with all before at `free`: of those that have reached it by then the oldest frame's, else
/// the one that reaches it first.
fn served_next(waiting: &[(&RequestId, &OpenRequest)], cost: Estimate, free: Option<f64>) -> usize {
    let is_there = |(_, request): &(&RequestId, &OpenRequest)| {
        free.is_some_and(|free| request.begins(cost) <= free)
    };
    let sooner = |a: &usize, b: &usize| earlier(waiting[*a].1, waiting[*b].1, cost);
    let there = waiting.iter().position(is_there);
    let first = || (0..waiting.len()).min_by(sooner);
    there.or_else(first).unwrap_or(0)
}

/// Order in which requests of a node count; what it has begun comes first.
fn earlier(a: &OpenRequest, b: &OpenRequest, cost: Estimate) -> Ordering {
    let waits = |request: &OpenRequest| request.tiles_received == 0;
    let begins = a.begins(cost).total_cmp(&b.begins(cost));
    begins.then(waits(a).cmp(&waits(b)))
}

/// When that which is asked for a frame would begin to count if it could from `asked` on and its node
/// has that to do: a node turns to the oldest frame first, but ends what it has begun.
pub(super) fn begins_after(forecast: &[RequestForecast], frame: FrameId, asked: f64) -> f64 {
    forecast.iter().fold(asked, |begin, before| {
        if before.frame <= frame || before.begin < begin {
            begin.max(before.finish())
        } else {
            begin
        }
    })
}

/// A processor that also runs the client is late whenever the system gives its cores to others.
fn silence_margin_secs(device: DeviceKind) -> f64 {
    match device {
        DeviceKind::Gpu => 0.03,
        DeviceKind::Cpu | DeviceKind::Scalar => 0.25,
    }
}

/// How many times as long as before a node must take for what comes to be taken to have slowed down.
const SLOWED: f64 = 2.0;
/// How many times its predicted work a node may take before it counts as silent.
const SILENCE_FACTOR: f64 = 6.0;
/// Seconds that a node may take for its very first tiles, of unknown cost.
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

    /// A workload with a known cost that has been asked for ten tiles each, of `frames`, at `issued`.
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
        // It arrives when the first is being traced, which is ended.
        assert_eq!(order(&workload, 0.002), [0, 3, 1, 2]);
        let [first, again, ..] = workload.forecast(0.002, None)[..] else {
            unreachable!()
        };
        assert!((again.begin - first.finish()).abs() < 1e-12);
        // A message of the first tells that the others have waited.
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
        // Work that it is asked for while it is silent is not relied on.
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
        // Frame 0 ends at 20 ms; asked for at 12, more of it is there just before that.
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
