//! The node of a waiter for a mutex or a semaphore, or for a condition and then its mutex.

use super::core::Core;
use crate::waiter::{Link, Outcome, Waiter};
use core::mem::MaybeUninit;
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

/// The node listed with the process (or thread) that waits, so that a chain finds it.
#[repr(C)]
struct Listed {
    /// First, so that it leads back to this.
    wait: WaitNode,
    entry: NonNull<Entry>,
    inheritor: Inheritor,
}

/// The node, inside its future.
///
/// # Invariants
///
/// While it is in a wait point's list, that wait point's lock guards `waiter` and `inheritor`; a
/// settled one belongs to its future. `cause` is guarded by the condition's lock. `listed` is there
/// while `is_listed`: its node is then in the list of its inheritor's waits, under the lock of the
/// inheritor's executor. `count` and `core` do not change between begin and end.
#[repr(C)]
pub(super) struct Entry {
    /// First, so that the list's node leads back to this.
    waiter: Waiter<()>,
    /// Inherits when the entry holds the mutex.
    pub(super) inheritor: Option<Inheritor>,
    /// How many permits it wants.
    pub(super) count: u32,
    pub(super) cause: Cause,
    /// Where it is to take them, from its begin to its end. It keeps that mutex's memory, also if
    /// its future is leaked: the chain may still find it.
    pub(super) core: Shared<Core>,
    is_listed: bool,
    listed: MaybeUninit<Listed>,
}

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
        // entry is in no list. It stays until `end`, so the node of `listed` can be listed with the
        // process; it is in no list yet.
        unsafe {
            let this = entry.as_ptr();
            this.write(Entry {
                waiter: Waiter::empty(),
                inheritor,
                count,
                cause: Cause::None,
                core: core.clone(),
                is_listed: false,
                listed: MaybeUninit::uninit(),
            });
            Waiter::begin(Self::waiter(entry), None);
            if let Some(inheritor) = &(*this).inheritor {
                (*this).listed.write(Listed {
                    wait: WaitNode::new(),
                    entry,
                    inheritor: inheritor.copy(),
                });
                (*this).is_listed = true;
                inheritor.begin_wait(NonNull::from(&mut (*this).listed).cast());
            }
        }
    }

    /// Undoes [`begin`](Self::begin). O(1).
    ///
    /// # Safety
    ///
    /// `entry` was begun, is live, in no wait point's list, and no other thread accesses it, but
    /// for its `listed` and `core`, which a chain reads under the lock of the process' boosts.
    pub(super) unsafe fn end(entry: NonNull<Entry>) {
        // SAFETY: the entry is live, in no wait point's list, and only its future accesses it but
        // for `listed` and `core`, as is demanded here. Until `listed` is taken out, others may
        // access its node under the lock of its executor's boosts, so only the inheritor is
        // referred to; it is that of the process with which `begin` has listed the node.
        unsafe {
            let this = entry.as_ptr();
            if (*this).is_listed {
                let listed = (&raw mut (*this).listed).cast::<Listed>();
                let inheritor = &(*listed).inheritor;
                inheritor.end_wait(NonNull::new_unchecked(listed).cast());
                (*this).listed.assume_init_drop();
            }
            this.drop_in_place();
        }
    }

    /// The entry of `node`, which is listed with a process. Only its mutex may be asked for.
    ///
    /// # Safety
    ///
    /// `node` was listed by [`begin`](Self::begin), and the lock of the process' executor is held.
    pub(super) unsafe fn waited_for(node: NonNull<WaitNode>) -> NonNull<Entry> {
        // SAFETY: the node is listed with a process, as is demanded here, so it begins a `Listed`.
        // Its owner needs the lock of the executor's boosts, which is held, to take it off: so it
        // is live, and `entry` does not change.
        unsafe { (*node.cast::<Listed>().as_ptr()).entry }
    }

    /// The part of its waiter that others find it by.
    pub(super) fn link(entry: NonNull<Entry>) -> *mut Link {
        entry.as_ptr().cast()
    }

    /// What has become of it.
    ///
    /// # Safety
    ///
    /// It is live and was begun.
    pub(super) unsafe fn outcome(entry: NonNull<Entry>) -> Outcome {
        // SAFETY: the entry is live and was begun, as is demanded here, and its waiter with it.
        unsafe { Waiter::outcome(Self::waiter(entry)) }
    }

    /// How urgent it is now; under another runtime, as it was when it was listed.
    ///
    /// # Safety
    ///
    /// It is live, and the lock that guards it is held, if it is listed.
    pub(super) unsafe fn priority(entry: NonNull<Entry>) -> Priority {
        // SAFETY: the entry is live, and the lock that is held, or its owner's being the caller,
        // keeps other threads from its inheritor and its node. Only one of these is borrowed.
        unsafe {
            match &(*entry.as_ptr()).inheritor {
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
        // SAFETY: the entry is live, and its lock is held, as is demanded here, so no other thread
        // accesses its inheritor. Only this field is borrowed.
        unsafe { &(*entry.as_ptr()).inheritor }
            .as_ref()
            .is_some_and(|inheritor| inheritor.is_same(holder))
    }
}
