//! Passes a priority on: from the first waiter to the holder of a mutex, and from there to the
//! holder of the mutex that this one waits for.

use super::core::{Core, LockState};
use super::entry::Entry;
use crate::guarded_wait_point::Locked;
use crate::wait_point::Lists;
use arrayvec::ArrayVec;
use core::ptr::NonNull;
use luna_core::current::Inheritor;

/// How many holders a chain is followed along.
pub(super) const HOLDERS: usize = 8;

/// The number of wait points that are looked at in all, since a process may wait for several: one
/// in each branch.
pub(super) const STEPS: usize = 32;

/// A holder with a changed boost.
#[derive(Debug)]
pub(super) struct Changed {
    pub(super) inheritor: Inheritor,
    pub(super) is_more: bool,
}

/// Reports the holder's new priority to the mutex that it waits for, and so on along the chain.
/// Each holder on the way with a higher boost is queued to run: one that really waits is polled
/// once for nothing. Called without any lock.
pub(super) fn follow(changed: Option<Changed>) {
    let Some(Changed { inheritor, is_more }) = changed else {
        return;
    };
    // The holders on the way, each with the wait that was looked at last.
    let mut way = ArrayVec::<(Inheritor, usize), HOLDERS>::new();
    way.push((inheritor, 0));
    for _ in 0..STEPS {
        let Some((inheritor, above)) = way.last_mut() else {
            return;
        };
        // Also one that has a wait listed: it may have been handed what it waited for and be
        // queued, or another branch of it may be.
        if *above == 0 && is_more {
            inheritor.move_up();
        }
        // SAFETY: all that is listed with a process is an entry's, and its mutex lives while it is.
        let next = inheritor.next_wait(*above, |node| unsafe {
            (node.addr().get(), Entry::waited_for(node))
        });
        let Some((address, (entry, core))) = next else {
            way.pop();
            continue;
        };
        *above = address;
        if let Some(further) = core.reorder(entry) {
            if way.is_full() {
                if is_more {
                    further.move_up();
                }
            } else {
                way.push((further, 0));
            }
        }
    }
}

impl Core {
    /// Moves `entry`, if it still waits here, to where its process' priority belongs now. Returns
    /// the holder, if its boost changes by that. O(waiters).
    fn reorder(&self, entry: NonNull<Entry>) -> Option<Inheritor> {
        let mut locked = self.lock();
        if !locked
            .waiting()
            .nodes()
            .any(|node| Entry::of(node) == entry)
        {
            return None;
        }
        // SAFETY: its node is in the list.
        unsafe { locked.requeue(entry) };
        locked.boost_holder().map(|changed| changed.inheritor)
    }
}

impl<L: Lists> Locked<'_, LockState, L> {
    /// Moves a listed entry to where its priority now belongs. O(1) if it stands there, else
    /// O(waiters of lower priority).
    ///
    /// # Safety
    ///
    /// `entry` is in the list of waiters.
    pub(super) unsafe fn requeue(&mut self, entry: NonNull<Entry>) {
        let node = Entry::node(entry);
        // SAFETY: the entry is in this list, as is demanded here, and the lock is held: so it is
        // live, and may be changed. Taken off it is in no list, and is listed again at once.
        unsafe {
            let priority = Entry::priority(entry);
            if priority != node.as_ref().priority() {
                self.waiting().remove(node);
                self.waiting().insert_again_at(node, priority);
            }
        }
    }

    /// Boosts the holder to the priority of the first other waiter. O(1), and O(waiters before that
    /// are branches of the holder itself).
    pub(super) fn boost_holder(&mut self) -> Option<Changed> {
        let (state, lists) = self.parts();
        let inheritor = state.inheritor.as_mut()?;
        // SAFETY: a listed node is live, and an entry's; the lock is held.
        let first_other = lists.senders.nodes().find_map(|node| unsafe {
            (!Entry::is_of(Entry::of(node), inheritor)).then(|| node.as_ref().priority())
        });
        // As a whole: the waiter may be another branch of the same process. The process does not
        // inherit its own priority, since it may be an inherited one.
        let change = inheritor.boost_whole(first_other.unwrap_or_default());
        change.is_ne().then(|| Changed {
            inheritor: inheritor.copy(),
            is_more: change.is_gt(),
        })
    }
}

/// Ends the boost of a former holder.
pub(super) fn end_boost(former: Option<Inheritor>) {
    if let Some(mut inheritor) = former
        && inheritor.give_back()
    {
        let is_more = false;
        follow(Some(Changed { inheritor, is_more }));
    }
}
