//! What a test does to a bus.

use super::node::{Status, lock};
use crate::{Frame, State};
use luna::Sender;
use std::fmt;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

/// Lets errors come, and counts what is on the bus: see [`Bus::control`](super::Bus::control).
/// Cloning is cheap.
#[derive(Clone)]
pub struct Control {
    pub(super) shared: Arc<Shared>,
    pub(super) wake: Sender<Frame>,
}

#[derive(Default)]
pub(super) struct Shared {
    pub(super) nodes: Mutex<Vec<(String, Arc<Mutex<Status>>)>>,
    pub(super) frames: AtomicU64,
    pub(super) destroyed: AtomicU64,
    pub(super) dropped: AtomicU64,
}

impl Control {
    /// Destroys the next `count` frames of a node. It repeats them.
    ///
    /// # Panics
    ///
    /// There is no such node; so for all functions with a name.
    pub fn corrupt(&self, node: &str, count: u32) {
        self.with(node, |status| {
            status.to_corrupt = status.to_corrupt.saturating_add(count)
        });
    }

    /// Lets a node miss the next `count` frames of others, without an error.
    pub fn lose(&self, node: &str, count: u32) {
        self.with(node, |status| {
            status.to_lose = status.to_lose.saturating_add(count)
        });
    }

    /// Cuts a node off: it gets nothing, and what it sends is [dropped](Self::dropped).
    pub fn cut(&self, node: &str) {
        self.with(node, |status| status.is_cut = true);
    }

    /// Connects a node that was cut off.
    pub fn connect(&self, node: &str) {
        self.with(node, |status| status.is_cut = false);
        self.wake();
    }

    /// Restarts a node that is bus-off.
    pub fn restart(&self, node: &str) {
        self.with(node, |status| {
            (status.sent_errors, status.received_errors) = (0, 0);
            status.state = State::Active;
            status.report.state = Some(State::Active);
        });
        self.wake();
    }

    /// The error state of a node.
    pub fn state(&self, node: &str) -> State {
        self.with(node, |status| status.state)
    }

    /// What a node has sent at once, in an emergency.
    pub fn sent_at_once(&self, node: &str) -> Vec<Frame> {
        self.with(node, |status| status.at_once.clone())
    }

    /// Frames that all nodes could receive.
    pub fn frames(&self) -> u64 {
        self.shared.frames.load(Ordering::Relaxed)
    }

    /// Frames that were destroyed, or not acknowledged.
    pub fn destroyed(&self) -> u64 {
        self.shared.destroyed.load(Ordering::Relaxed)
    }

    /// Frames of nodes that were cut off or bus-off.
    pub fn dropped(&self) -> u64 {
        self.shared.dropped.load(Ordering::Relaxed)
    }

    fn with<R>(&self, name: &str, change: impl FnOnce(&mut Status) -> R) -> R {
        let nodes = self.shared.nodes.lock();
        let nodes = nodes.unwrap_or_else(PoisonError::into_inner);
        let node = nodes.iter().find(|(of, _)| of == name);
        let (_, status) = node.unwrap_or_else(|| panic!("the bus has no node `{name}`"));
        change(&mut lock(status))
    }

    fn wake(&self) {
        if let Some(frame) = Frame::standard(0, &[]) {
            // It overwrites: there is room. If the bus has ended, there is nothing to wake.
            let _ = self.wake.try_send(frame);
        }
    }
}

impl fmt::Debug for Control {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Control")
            .field("frames", &self.frames())
            .field("destroyed", &self.destroyed())
            .field("dropped", &self.dropped())
            .finish()
    }
}
