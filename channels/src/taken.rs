//! A value between the channel and its receiver, while user code runs.

use crate::core::Channel;
use std::mem::ManuallyDrop;

/// A received value on its way out of its channel. If the receiver unwinds before it has it (the
/// waker of its partner, say, panics), the value goes back, and a held sender is released.
pub(crate) struct Taken<'a, T> {
    channel: &'a Channel<T>,
    value: ManuallyDrop<T>,
    ticket: u32,
}

impl<'a, T> Taken<'a, T> {
    #[inline]
    pub(crate) fn new(channel: &'a Channel<T>, value: T, ticket: u32) -> Self {
        Self {
            channel,
            value: ManuallyDrop::new(value),
            ticket,
        }
    }

    /// The receiver has it.
    #[inline]
    pub(crate) fn keep(self) -> T {
        let mut this = ManuallyDrop::new(self);
        // SAFETY: taken once, since `this` is not dropped.
        unsafe { ManuallyDrop::take(&mut this.value) }
    }
}

impl<T> Drop for Taken<'_, T> {
    fn drop(&mut self) {
        struct Release<'a, T>(&'a Channel<T>, u32);
        impl<T> Drop for Release<'_, T> {
            fn drop(&mut self) {
                self.0.release_held(self.1);
            }
        }
        // Also if the next receiver's waker panics.
        let _release = Release(self.channel, self.ticket);
        // SAFETY: taken once, since this is its drop.
        self.channel
            .give_back(unsafe { ManuallyDrop::take(&mut self.value) });
    }
}
