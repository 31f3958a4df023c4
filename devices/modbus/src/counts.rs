//! What a client has done so far.

use std::fmt;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

/// Counters of a client since it was created. Cloning is cheap. Reading is possible at any time, on
/// the real-time path too: O(1), one load.
#[derive(Clone, Default)]
pub struct Counts(Arc<Inner>);

macro_rules! counters {
    ($($(#[$doc:meta])* $name:ident, $add:ident;)*) => {
        #[derive(Default)]
        struct Inner {
            $($name: AtomicU64,)*
        }

        impl Counts {
            $(
                $(#[$doc])*
                pub fn $name(&self) -> u64 {
                    self.0.$name.load(Ordering::Relaxed)
                }

                pub(crate) fn $add(&self) {
                    self.0.$name.fetch_add(1, Ordering::Relaxed);
                }
            )*
        }

        impl fmt::Debug for Counts {
            fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.debug_struct("Counts")
                    $(.field(stringify!($name), &self.$name()))*
                    .finish()
            }
        }
    };
}

counters! {
    /// Complete cycles: all writes that waited, and all reads.
    cycles, add_cycle;
    /// Cycles that were not done within the period: the server is slower than that.
    late, add_late;
    /// Values that a channel took.
    values, add_value;
    /// Values that were read, for which a channel had no room.
    dropped, add_dropped;
    /// Values that the server has confirmed.
    written, add_written;
    /// Values that it has not: each is an [`Event::WriteFailed`](crate::Event::WriteFailed), unless
    /// the device is lost while the channel of the events is full.
    write_failures, add_write_failure;
    /// Exceptions, of reads and writes.
    exceptions, add_exception;
    /// Requests without an answer in time.
    timeouts, add_timeout;
    /// Answers that make no sense.
    garbage, add_garbage;
    /// Answers to another request than the one that waits: a gateway may double them. They are
    /// discarded, and change nothing else.
    strays, add_stray;
    /// Connections made.
    connections, add_connection;
}
