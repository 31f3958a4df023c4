//! What a controller has done so far.

use crate::State;
use std::fmt;
use std::sync::Arc;
use std::sync::atomic::{AtomicU8, AtomicU64, Ordering};

/// Counters of a controller since it was created. Cloning is cheap. Reading is possible at any
/// time, on the real-time path too: O(1), one load.
#[derive(Clone, Default)]
pub struct Counts(Arc<Inner>);

macro_rules! counters {
    ($($(#[$doc:meta])* $name:ident, $add:ident;)*) => {
        #[derive(Default)]
        struct Inner {
            $($name: AtomicU64,)*
            /// 0, or one more than the state.
            state: AtomicU8,
        }

        impl Counts {
            $(
                $(#[$doc])*
                pub fn $name(&self) -> u64 {
                    self.0.$name.load(Ordering::Relaxed)
                }

                pub(crate) fn $add(&self, count: u64) {
                    self.0.$name.fetch_add(count, Ordering::Relaxed);
                }
            )*
        }

        impl fmt::Debug for Counts {
            fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.debug_struct("Counts")
                    $(.field(stringify!($name), &self.$name()))*
                    .field("state", &self.state())
                    .finish()
            }
        }
    };
}

counters! {
    /// Frames that the port took. They were not on the bus yet.
    sent, add_sent;
    /// Frames given to receivers; a frame for two counts twice.
    received, add_received;
    /// Frames for which a receiver's channel had no room.
    overruns, add_overrun;
    /// Frames that are none of their receiver's values.
    malformed, add_malformed;
    /// Frames that were lost before: the queue of the kernel or of the hardware was full. Hardware
    /// does not say how many: each report counts as one.
    lost, add_lost;
    /// Reports of errors on the bus.
    errors, add_error;
    /// Events for which their channel had no room, or that has no receiver. So for the reports of
    /// a [`HeartbeatConsumer`](crate::canopen::HeartbeatConsumer).
    unreported, add_unreported;
    /// Frames that were not sent, since the node was bus-off: see
    /// [`OnBusOff::Wait`](crate::OnBusOff::Wait).
    dropped, add_dropped;
}

impl Counts {
    /// The error state of the node, as was reported last; none before the first report. Ports
    /// report changes: a node is likely to be active until then, but was not asked.
    pub fn state(&self) -> Option<State> {
        match self.0.state.load(Ordering::Relaxed) {
            0 => None,
            1 => Some(State::Active),
            2 => Some(State::Warning),
            3 => Some(State::Passive),
            _ => Some(State::BusOff),
        }
    }

    pub(crate) fn set_state(&self, state: State) {
        self.0.state.store(state as u8 + 1, Ordering::Relaxed);
    }
}
