//! The way of values from zenoh's threads to the link's process.

use crate::age::{Sent, Stamped};
use luna::{Buffer, Instant, Receiver, Sender};
use serde::de::DeserializeOwned;
use std::collections::VecDeque;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering::SeqCst};

/// Whether a value was taken.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Accepted {
    Yes,
    /// There was no room, or it is not the next one.
    No,
}

/// Takes the values that arrive.
pub(crate) trait Inbox: Send {
    /// One value of a message. An error of decoding is a text.
    fn take(
        &mut self,
        number: u64,
        at: Instant,
        sent: Sent,
        bytes: &[u8],
    ) -> Result<Accepted, String>;

    /// The message is at its end.
    fn deliver(&mut self);
}

/// A value that has arrived.
pub(crate) struct Arrived<T> {
    pub(crate) value: T,
    pub(crate) number: u64,
    pub(crate) at: Instant,
    pub(crate) sent: Sent,
}

impl<T> Arrived<T> {
    pub(crate) fn plain(self) -> T {
        self.value
    }

    pub(crate) fn stamped(self) -> Stamped<T> {
        Stamped::new(self.value, self.number, self.at, self.sent)
    }
}

pub(crate) type Values<T> = VecDeque<Arrived<T>>;

/// Empty queues that are kept for the next messages.
const QUEUES_KEPT: usize = 2;

/// The side of zenoh's threads.
struct Decoder<T> {
    values: Values<T>,
    full: Sender<Values<T>>,
    empty: Receiver<Values<T>>,
    /// Values that were delivered and that the process has not taken.
    waiting: Arc<AtomicU64>,
    window: u64,
}

/// The side of the link's process.
pub(crate) struct Deliveries<T> {
    full: Receiver<Values<T>>,
    empty: Sender<Values<T>>,
    waiting: Arc<AtomicU64>,
}

/// An inbox for so many values. The process need not allocate or free for it.
pub(crate) fn inbox<T: DeserializeOwned + Send + 'static>(
    window: usize,
) -> (Box<dyn Inbox>, Deliveries<T>) {
    // In the worst case each value came alone.
    let (full, filled) = luna::buffered(Buffer::fifo(window));
    // Those in `full`, one on each side.
    let (emptied, empty) = luna::buffered(Buffer::fifo(window + 2));
    let waiting = Arc::new(AtomicU64::new(0));
    let decoder = Decoder {
        values: VecDeque::new(),
        full: full.external(),
        empty: empty.external(),
        waiting: waiting.clone(),
        window: window as u64,
    };
    let deliveries = Deliveries {
        full: filled.external(),
        empty: emptied.external(),
        waiting,
    };
    (Box::new(decoder), deliveries)
}

impl<T: DeserializeOwned + Send> Inbox for Decoder<T> {
    fn take(
        &mut self,
        number: u64,
        at: Instant,
        sent: Sent,
        bytes: &[u8],
    ) -> Result<Accepted, String> {
        // One that finds no room is sent again.
        if self.waiting.load(SeqCst) + self.values.len() as u64 >= self.window {
            return Ok(Accepted::No);
        }
        let value = postcard::from_bytes(bytes).map_err(|error| error.to_string())?;
        self.values.push_back(Arrived {
            value,
            number,
            at,
            sent,
        });
        Ok(Accepted::Yes)
    }

    fn deliver(&mut self) {
        if self.values.is_empty() {
            return;
        }
        let next = self.empty.try_recv().unwrap_or_default();
        let values = std::mem::replace(&mut self.values, next);
        self.waiting.fetch_add(values.len() as u64, SeqCst);
        // There is room: each of those that wait has a value, and the window bounds these. The
        // receiving end is gone only with its link.
        let _ = self.full.try_send(values);
        // A slow receiver has many queues under way. They are freed here: each may grow to a window.
        while self.empty.buffered() > QUEUES_KEPT {
            drop(self.empty.try_recv());
        }
    }
}

impl<T: Send> Deliveries<T> {
    /// Waits for values. None if the other side is gone.
    pub(crate) async fn next(&self) -> Option<Values<T>> {
        self.full.recv().await.ok()
    }

    #[cfg(test)]
    pub(crate) fn try_next(&self) -> Option<Values<T>> {
        self.full.try_recv().ok()
    }

    /// Whether more wait.
    pub(crate) fn has_more(&self) -> bool {
        self.full.buffered() > 0
    }

    /// A value was taken, and has made room.
    pub(crate) fn took_one(&self) {
        self.waiting.fetch_sub(1, SeqCst);
    }

    /// Gives an empty queue back, for other values.
    pub(crate) fn give_back(&self, values: Values<T>) {
        let _ = self.empty.try_send(values);
    }
}
