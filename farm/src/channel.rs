//! Channel between threads whose receiver polls with a waker, so that it can be awaited together with other
//! sources.
//!
//! It is unbounded in itself and bounded by its senders. Commands of a coordinator: a scene, a ping a
//! second, and for each of `REQUESTS_QUEUED_MAX` open requests a request and its cancellation. Packets of a
//! node: the answers to as many requests, of which its session holds no more bytes than
//! [`carom_protocol::limits`] allow. A sender that blocked instead would stop the coordinator for one slow
//! link.

use std::collections::VecDeque;
use std::sync::{Arc, Mutex, MutexGuard};
use std::task::{Context, Poll, Waker};

use crate::lock::lock;

/// Sending end.
pub(crate) struct Sender<T>(Arc<Mutex<State<T>>>);

/// Receiving end.
pub(crate) struct Receiver<T>(Arc<Mutex<State<T>>>);

struct State<T> {
    queue: VecDeque<T>,
    closed: bool,
    waker: Option<Waker>,
}

/// Creates a channel.
pub(crate) fn channel<T>() -> (Sender<T>, Receiver<T>) {
    let state = Arc::new(Mutex::new(State {
        queue: VecDeque::new(),
        closed: false,
        waker: None,
    }));
    (Sender(Arc::clone(&state)), Receiver(state))
}

impl<T> Sender<T> {
    /// Adds a message. Returns whether the receiver still exists.
    pub(crate) fn send(&self, message: T) -> bool {
        let mut state = lock(&self.0);
        let open = !state.closed;
        if open {
            state.queue.push_back(message);
        }
        wake(state);
        open
    }
}

impl<T> Drop for Sender<T> {
    fn drop(&mut self) {
        let mut state = lock(&self.0);
        state.closed = true;
        wake(state);
    }
}

impl<T> Receiver<T> {
    /// The next message; `None` when the sender is gone and all messages have been taken.
    pub(crate) fn poll_recv(&self, cx: &mut Context<'_>) -> Poll<Option<T>> {
        let mut state = lock(&self.0);
        if let Some(message) = state.queue.pop_front() {
            return Poll::Ready(Some(message));
        }
        if state.closed {
            return Poll::Ready(None);
        }
        // Under the same lock as the check before: a message that is sent afterwards finds the waker.
        state.waker = Some(cx.waker().clone());
        Poll::Pending
    }
}

impl<T> Drop for Receiver<T> {
    fn drop(&mut self) {
        let mut state = lock(&self.0);
        state.closed = true;
        state.queue.clear();
    }
}

/// Wakes the receiver after releasing the lock, so that it does not block on it.
fn wake<T>(mut state: MutexGuard<'_, State<T>>) {
    let waker = state.waker.take();
    drop(state);
    if let Some(waker) = waker {
        waker.wake();
    }
}
