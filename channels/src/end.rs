//! One end of a channel, for either direction.

use crate::core::Channel;
use crate::replay;
use crate::stamp::Stamp;
use core::fmt;
use core::marker::PhantomData;
use core::ptr::NonNull;
use luna_core::current;

/// What a [`Sender`](crate::Sender) and a [`Receiver`](crate::Receiver) have in common.
///
/// # Invariants
///
/// The channel counts this end, so it lives at least as long.
pub struct End<T> {
    channel: NonNull<Channel<T>>,
    /// When an alternative last chose it.
    pub(crate) chosen: Stamp,
    _values: PhantomData<T>,
}

// SAFETY: the channel is shared under its lock and by atomics; values pass from thread to thread.
unsafe impl<T: Send> Send for End<T> {}
// SAFETY: a shared end gives access to the channel alone, which is shared under its lock and by
// atomics; values pass from thread to thread.
unsafe impl<T: Send> Sync for End<T> {}
impl<T> core::panic::UnwindSafe for End<T> {}
impl<T> core::panic::RefUnwindSafe for End<T> {}
// The values lie in the channel, not in its ends.
impl<T> Unpin for End<T> {}

impl<T> End<T> {
    /// # Safety
    ///
    /// The caller gives this one of the ends that the channel counts.
    pub(crate) unsafe fn new(channel: NonNull<Channel<T>>) -> Self {
        Self {
            channel,
            chosen: Stamp::new(),
            _values: PhantomData,
        }
    }

    #[inline]
    pub(crate) fn channel(&self) -> &Channel<T> {
        // SAFETY: by the invariant the channel lives as long as this.
        unsafe { self.channel.as_ref() }
    }

    /// The channel, also beyond the end's life.
    pub(crate) fn pointer(&self) -> NonNull<Channel<T>> {
        self.channel
    }

    pub(crate) fn poison(&self) {
        if current::has_replay_log() {
            // A replay has to keep to the set of operations that still get through before it.
            let poison = || self.channel().poison();
            let _ = replay::call(true, poison, |()| None);
        } else {
            self.channel().poison();
        }
    }

    pub(crate) fn set_name(&self, name: &str) {
        self.channel().wait_point().identity.set_name(name);
    }

    pub(crate) fn set_external(&self) {
        self.channel().wait_point().identity.set_external();
    }
}

impl<T> fmt::Debug for End<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.channel.fmt(f)
    }
}
