//! The node of a waiter for a mutex or a semaphore, or for a condition and then its mutex; and how
//! a priority is passed on: from the first waiter to the holder of a mutex, and from there to the
//! holder of the mutex that this one waits for.

use super::core::{Core, LockState};
use crate::guarded_wait_point::Locked;
use crate::wait_point::Lists;
use crate::waiter::{Link, Waiter};
use arrayvec::ArrayVec;
use core::mem::offset_of;
use core::ptr::NonNull;
use luna_core::current::{Inheritor, Priority};
use luna_core::deferred_free::Shared;
use luna_core::wait_list::WaitNode;

/// Why an entry that waited at a condition was moved to its mutex.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Cause {
    /// It is not: it waits at the condition, or never did.
    None,
    NotifiedAlone,
    NotifiedWithAll,
    TimedOut,
}

/// The node, inside its future.
///
/// # Invariants
///
/// While it is in a wait point's list, that wait point's lock guards `waiter`; a settled one
/// belongs to its future. `cause` is guarded by the condition's lock. The other fields do not
/// change between begin and end. If there is an `inheritor`, `of_process` is in the list of its
/// waits meanwhile, under the lock of its executor's boosts.
#[repr(C)]
pub(super) struct Entry {
    /// First, so that the list's node leads back to this.
    waiter: Waiter<()>,
    /// The process (or thread) that waits. It inherits when the entry holds the mutex.
    inheritor: Option<Inheritor>,
    /// How many permits it wants.
    pub(super) count: u32,
    pub(super) cause: Cause,
    /// Where it is to take them. It keeps that mutex's memory, also if its future is leaked: the
    /// chain may still find it.
    pub(super) core: Shared<Core>,
    /// Listed with the process that waits, so that a chain finds it.
    of_process: WaitNode,
}

/// Where `of_process` lies in an entry.
const OF_PROCESS: usize = offset_of!(Entry, of_process);

impl Entry {
    /// The node of a wait point's list.
    pub(super) fn of(node: NonNull<WaitNode>) -> NonNull<Entry> {
        node.cast()
    }

    pub(super) fn node(entry: NonNull<Entry>) -> NonNull<WaitNode> {
        entry.cast()
    }

    pub(super) fn waiter(entry: NonNull<Entry>) -> NonNull<Waiter<()>> {
        entry.cast()
    }

    /// Prepares the node for being listed by its own process, and lists it with that process, if
    /// that may inherit, as one that waits for `core`. O(1).
    ///
    /// # Safety
    ///
    /// `entry` is room for one, pinned, not accessed by another thread, and was not begun before;
    /// [`end`](Self::end) is called before the entry goes, or the entry stays for ever.
    pub(super) unsafe fn begin(
        entry: NonNull<Entry>,
        core: &Shared<Core>,
        count: u32,
        inheritor: Option<Inheritor>,
    ) {
        // SAFETY: it is room for an entry that no other thread accesses, as is demanded here. The
        // entry is in no list. It stays until `end`, so `of_process` can be listed with the
        // process; it is in no list yet.
        unsafe {
            entry.write(Entry {
                waiter: Waiter::empty(),
                inheritor,
                count,
                cause: Cause::None,
                core: core.clone(),
                of_process: WaitNode::new(),
            });
            Waiter::begin(Self::waiter(entry), None);
            if let Some(inheritor) = Self::inheritor(entry) {
                inheritor.begin_wait(entry.byte_add(OF_PROCESS).cast());
            }
        }
    }

    /// The process that waits, if it may inherit.
    ///
    /// # Safety
    ///
    /// The entry was begun, and has not ended as long as the result is used.
    pub(super) unsafe fn inheritor<'a>(entry: NonNull<Entry>) -> Option<&'a Inheritor> {
        // SAFETY: it is live, as is demanded here, and the field does not change meanwhile. Only
        // this field is borrowed.
        unsafe { &(*entry.as_ptr()).inheritor }.as_ref()
    }

    /// Undoes [`begin`](Self::begin). O(1).
    ///
    /// # Safety
    ///
    /// `entry` was begun, is live, in no wait point's list, and no other thread accesses it, but
    /// for `of_process` and `core`, which a chain uses under the lock of the process' boosts.
    pub(super) unsafe fn end(entry: NonNull<Entry>) {
        // SAFETY: the entry is live, in no wait point's list, and only its future accesses it but
        // for the two fields, as is demanded here. `begin` has listed it with its process; after
        // this no other thread has a pointer to it.
        unsafe {
            if let Some(inheritor) = Self::inheritor(entry) {
                inheritor.end_wait(entry.byte_add(OF_PROCESS).cast());
            }
            entry.drop_in_place();
        }
    }

    /// The mutex of the entry that is listed with a process by `node`, and the entry, to be found
    /// there.
    ///
    /// # Safety
    ///
    /// `node` was listed by [`begin`](Self::begin), and the lock of the process' boosts is held.
    pub(super) unsafe fn waited_for(node: NonNull<WaitNode>) -> (NonNull<Entry>, Shared<Core>) {
        // SAFETY: the node is part of an entry. Its owner needs the lock of the boosts, which is
        // held, to take it off: so the entry is live, and `core` does not change.
        unsafe {
            let entry = node.byte_sub(OF_PROCESS).cast::<Entry>();
            (entry, (*entry.as_ptr()).core.clone())
        }
    }

    /// The part of its waiter that others find it by.
    pub(super) fn link(entry: NonNull<Entry>) -> *mut Link {
        entry.as_ptr().cast()
    }

    /// How urgent it is now; under another runtime, as it was when it was listed.
    ///
    /// # Safety
    ///
    /// It is live, and the lock that guards it is held, if it is listed.
    pub(super) unsafe fn priority(entry: NonNull<Entry>) -> Priority {
        // SAFETY: the entry is live, and the lock that is held, or its owner's being the caller,
        // keeps other threads from its node.
        unsafe {
            match Self::inheritor(entry) {
                Some(inheritor) => inheritor.priority(),
                None => Self::node(entry).as_ref().priority(),
            }
        }
    }

    /// Whether it waits for `holder` itself.
    ///
    /// # Safety
    ///
    /// As for [`priority`](Self::priority): it is live, and the lock that guards it is held, if it
    /// is listed.
    pub(super) unsafe fn is_of(entry: NonNull<Entry>, holder: &Inheritor) -> bool {
        // SAFETY: the entry is live, as is demanded here.
        let inheritor = unsafe { Self::inheritor(entry) };
        inheritor.is_some_and(|inheritor| inheritor.is_same(holder))
    }
}

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
        // By the list's own pointer: another entry may lie where this one was.
        let listed = {
            let mut waiting = locked.waiting().nodes().map(Entry::of);
            waiting.find(|one| *one == entry)?
        };
        // SAFETY: its node is in the list.
        unsafe { locked.requeue(listed) };
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
