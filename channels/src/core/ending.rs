//! The ends of a channel: how many there are, and how communication ends.

use super::{Channel, Ending, SPARE};
use crate::ended::take_watcher;
use crate::finally::Finally;
use crate::waiter::{Outcome, Waiter};
use alloc::collections::VecDeque;
use core::ptr::NonNull;
use luna_core::current;
use luna_core::deferred_free;
use luna_platform::sync::atomic::{AtomicU32, Ordering};

impl<T> Channel<T> {
    /// Poisons the channel: all operations that wait and all that come fail. O(waiting operations +
    /// stored values), one critical section each.
    pub(crate) fn poison(&self) {
        let _stored = Finally::new(|| self.drop_stored());
        self.end(Ending::Poisoned);
    }

    /// Drops values that can no longer be received. At once and not with the channel: a process may
    /// wait for the drop of a value (the way back to a client, say), and a value may borrow what
    /// the channel's memory outlives until its deferred free.
    ///
    /// To be called when the channel has ended for receivers: nothing is stored after that.
    fn drop_stored(&self) {
        // One by one, and not under the lock: the drop of a value can run anything.
        loop {
            let Some(value) = self.lock().with_store(VecDeque::pop_front) else {
                return;
            };
            let rest = Finally::new(|| self.drop_stored());
            drop(value);
            rest.cancel();
        }
    }

    pub(crate) fn is_poisoned(&self) -> bool {
        self.lock().lists.ending == Ending::Poisoned
    }

    fn end(&self, ending: Ending) {
        let mut locked = self.lock();
        if locked.lists.ending == Ending::Poisoned {
            return;
        }
        locked.lists.ending = ending;
        // No client waits for it any more; it may still answer the calls that it has accepted.
        let server = locked.lists.server.take();
        locked.lists.find_whether_plain();
        locked.announce();
        drop(locked);
        drop(server);
        self.end_those_that_wait(ending);
    }

    fn end_those_that_wait(&self, ending: Ending) {
        let outcome = Outcome::of(ending);
        let mut locked = self.lock();
        // Operations that come from now on see the ending, so the lists only get shorter. One by
        // one, so that the lock is held for few steps.
        loop {
            let lists = &mut *locked.lists;
            let ready = if let Some(node) = lists.senders.pop().or_else(|| lists.receivers.pop()) {
                let node = node.cast::<Waiter<T>>();
                // SAFETY: the node was listed, and the lock is held. A sender keeps its value, a
                // receiver has none.
                unsafe {
                    let is_committed = Waiter::commit(node);
                    Waiter::settle(
                        node,
                        if is_committed {
                            outcome
                        } else {
                            Outcome::Stale
                        },
                    )
                }
            } else if let Some(node) = lists.held.pop() {
                // It has communicated, whatever comes after; poisoning wakes every
                // waiter. SAFETY: the node was in the list, and the lock is held.
                unsafe { Waiter::settle(node.cast::<Waiter<T>>(), Outcome::Done) }
            } else if let Some(ready) = take_watcher(lists) {
                ready
            } else {
                break;
            };
            drop(locked);
            // A wake may panic: the remaining wakes must still be done.
            let rest = Finally::new(|| self.end_those_that_wait(ending));
            ready.wake();
            rest.cancel();
            locked = self.lock();
        }
        locked.release();
    }

    pub(crate) fn add_sender(&self) {
        count_one_more(&self.senders);
    }

    pub(crate) fn add_receiver(&self) {
        let receivers = count_one_more(&self.receivers) as usize;
        if receivers > SPARE {
            // Each receiver may have one receive under way that gives its value back.
            let buffered = self.buffer().reserved();
            self.lock().with_store(|store| {
                let needed = buffered
                    .saturating_add(receivers)
                    .saturating_sub(store.len());
                store.reserve(needed);
            });
        }
    }

    /// # Safety
    ///
    /// The caller gives up a sender or a receiver, which it does not use again.
    pub(crate) unsafe fn drop_end(channel: NonNull<Self>, is_sender: bool) {
        // SAFETY: the end kept the channel alive until now, and its kind does until `drop_kind`,
        // which is called once for it.
        unsafe {
            let _gone = Finally::new(|| {
                let this = channel.as_ref();
                let ends = match is_sender {
                    true => &this.senders,
                    false => &this.receivers,
                };
                if ends.fetch_sub(1, Ordering::AcqRel) == 1 {
                    let _kind = Finally::new(|| Self::drop_kind(channel));
                    let _stored = Finally::new(|| match is_sender {
                        true => {}
                        false => this.drop_stored(),
                    });
                    this.end(Ending::Closed);
                }
            });
            channel.as_ref().poison_if_ended_for_cause();
        }
    }

    /// Poisons the channel if one of its ends is dropped by a process that is ended for cause.
    fn poison_if_ended_for_cause(&self) {
        if current::dropped_ends_poison() {
            self.poison();
        }
    }

    /// # Safety
    ///
    /// The last end of one kind is gone, and this is called once for that kind.
    unsafe fn drop_kind(channel: NonNull<Self>) {
        // SAFETY: the last one to get here is the last user; what it frees may be freed on any
        // thread, since the values are `Send`.
        unsafe {
            if channel.as_ref().kinds.fetch_sub(1, Ordering::AcqRel) == 1 {
                deferred_free::retire(NonNull::new_unchecked(&raw mut (*channel.as_ptr()).retired));
            }
        }
    }
}

/// Counts an end; returns how many there are. Relaxed: a clone is made from a live end.
fn count_one_more(ends: &AtomicU32) -> u32 {
    let before = ends.fetch_add(1, Ordering::Relaxed);
    if before > i32::MAX as u32 {
        // Leaked ends only can reach this: a wrap of the counter would free memory in use.
        luna_platform::panics::abort();
    }
    before + 1
}
