//! What a link has done, and what it knows of the other clock.

use super::data::TypeIdentity;
use super::estimate::Offset;
use std::fmt;
use std::sync::Arc;
use std::sync::atomic::{AtomicI64, AtomicU64, Ordering::Relaxed};

macro_rules! counters {
    ($($(#[$about:meta])* $name:ident,)*) => {
        #[derive(Default)]
        pub(super) struct Counters {
            $(pub(super) $name: AtomicU64,)*
            pub(super) offset: AtomicI64,
            /// One more than the error; 0 without an offset.
            pub(super) offset_error: AtomicU64,
            pub(super) other_type: OtherType,
        }

        impl Status {
            $($(#[$about])*
            pub fn $name(&self) -> u64 {
                self.0.$name.load(Relaxed)
            })*
        }

        impl fmt::Debug for Status {
            fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.debug_struct("Status")
                    $(.field(stringify!($name), &self.$name()))*
                    .field("offset", &self.offset())
                    .field("other_type", &self.other_type())
                    .finish()
            }
        }
    };
}

counters! {
    /// Values that were handed to the system to be sent.
    sent,
    /// Values that were not sent since the socket's buffer, or that of the network's queue, was
    /// full.
    full,
    /// Datagrams that were not sent, or had not arrived, since no program listens at the other
    /// address or the network does not lead there.
    refused,
    /// Values that have come in order.
    received,
    /// Values of the present session that the partner sent and that have not come in order, between
    /// the first and the newest that has: lost, overtaken, or not handed out by the partner's
    /// system.
    lost,
    /// Values among the lost ones that came after a newer one, and were dropped.
    overtaken,
    /// Datagrams that came a second time, and were dropped.
    duplicates,
    /// Datagrams that are none of this protocol, or contradict it.
    malformed,
    /// Datagrams of this protocol from another session than the partner's, while that is alive, and
    /// those that come before both sides have heard each other.
    foreign,
    /// Datagrams that state another type than the one to be received.
    mistyped,
    /// Sessions that were begun: 1 for the first, one more whenever the partner was restarted.
    sessions,
    /// How often the partner's values became stale.
    stale,
    /// How often the stamps contradicted what was known of the offset: a clock was set, or the
    /// clocks drift faster than the settings state.
    clock_steps,
    /// Values whose stamps contradict that both clocks are TAI within their stated errors: one of
    /// the two computers is wrong about its synchronization.
    clock_contradictions,
}

/// Counters of a link since it was opened, and the offset of the partner's clock. Cloning is cheap.
/// Reading is possible at any time, from any thread, on the real-time path too: O(1), loads alone.
///
/// ```
/// let status = luna_links::cycle::Status::default(); // of no link
/// assert_eq!((status.received(), status.lost(), status.offset()), (0, 0, None));
/// ```
#[derive(Clone, Default)]
pub struct Status(pub(super) Arc<Counters>);

impl Status {
    /// How far the partner's clock is ahead, as of the last datagram.
    pub fn offset(&self) -> Option<Offset> {
        let error = self.0.offset_error.load(Relaxed).checked_sub(1)?;
        Some(Offset {
            nanos: self.0.offset.load(Relaxed),
            error,
        })
    }

    /// The type that the partner states, if it has stated another one than that to be received.
    pub fn other_type(&self) -> Option<TypeIdentity> {
        (self.mistyped() > 0).then(|| self.0.other_type.get())
    }

    pub(super) fn count(&self, counter: impl FnOnce(&Counters) -> &AtomicU64) {
        self.add(counter, 1);
    }

    pub(super) fn add(&self, counter: impl FnOnce(&Counters) -> &AtomicU64, more: u64) {
        counter(&self.0).fetch_add(more, Relaxed);
    }

    pub(super) fn set_offset(&self, offset: Option<Offset>) {
        let offset = offset.map(|offset| (offset.nanos, offset.error.saturating_add(1)));
        let (nanos, error) = offset.unwrap_or((0, 0));
        self.0.offset.store(nanos, Relaxed);
        self.0.offset_error.store(error, Relaxed);
    }
}

/// The last one; a reader may see parts of two.
#[derive(Default)]
pub(super) struct OtherType {
    name_hash: AtomicU64,
    size_and_version: AtomicU64,
}

impl OtherType {
    pub(super) fn set(&self, of: TypeIdentity) {
        self.name_hash.store(of.name_hash, Relaxed);
        let both = u64::from(of.version) << 32 | u64::from(of.size);
        self.size_and_version.store(both, Relaxed);
    }

    fn get(&self) -> TypeIdentity {
        let both = self.size_and_version.load(Relaxed);
        let (size, version) = (both as u32, (both >> 32) as u32);
        TypeIdentity::stated(self.name_hash.load(Relaxed), size, version)
    }
}
