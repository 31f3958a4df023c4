//! The node of a waiter for a mutex, or for a condition and then its mutex.

use super::core::{Core, CoreRef};
use crate::waiter::{Outcome, Waiter};
use luna_core::current::{Inheritor, Priority, Renewal, WakeHandle};
use luna_core::wait_list::WaitNode;
use std::mem::MaybeUninit;
use std::ptr::NonNull;

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
    core: NonNull<Core>,
    inheritor: Inheritor,
}

/// The node, inside its future.
///
/// # Invariants
///
/// While it is in a wait point's list, that wait point's lock guards `waiter` and `inheritor`; a
/// settled one belongs to its future. `cause` is guarded by the condition's lock. `listed` is there
/// while `is_listed`: its node is then in the list of its inheritor's waits, under the lock of the
/// inheritor's executor, and the mutex lives.
#[repr(C)]
pub(super) struct Entry {
    /// First, so that the list's node leads back to this.
    waiter: Waiter<()>,
    /// Inherits when the entry holds the mutex.
    inheritor: Option<Inheritor>,
    cause: Cause,
    /// The mutex that it is to lock, from its begin to its end. It keeps that mutex's memory, also
    /// if its future is leaked: the chain may still find it.
    core: Option<CoreRef>,
    is_listed: bool,
    listed: MaybeUninit<Listed>,
}

impl Entry {
    #[inline]
    pub(super) fn new() -> Self {
        Self {
            waiter: Waiter::empty(),
            inheritor: None,
            cause: Cause::None,
            core: None,
            is_listed: false,
            listed: MaybeUninit::uninit(),
        }
    }

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

    /// Prepares the node for being listed by its own process, and lists it with that process as one
    /// that waits for `core`. O(1).
    ///
    /// # Safety
    ///
    /// `entry` is live, pinned, not accessed by another thread, and was not begun before; `core` is
    /// live; [`end`](Self::end) is called before the entry goes, or the entry stays for ever.
    pub(super) unsafe fn begin(
        entry: NonNull<Entry>,
        core: NonNull<Core>,
        inheritor: Option<Inheritor>,
    ) {
        // SAFETY: the contract.
        unsafe {
            Waiter::begin(Self::waiter(entry), false, None, None);
            let this = entry.as_ptr();
            if let Some(inheritor) = &inheritor {
                (*this).listed.write(Listed {
                    wait: WaitNode::new(),
                    entry,
                    core,
                    inheritor: inheritor.copy(),
                });
                (*this).is_listed = true;
                inheritor.begin_wait(NonNull::from(&mut (*this).listed).cast());
            }
            (*this).inheritor = inheritor;
            (*this).core = Some(CoreRef::new(core));
        }
    }

    /// Undoes [`begin`](Self::begin), if it was begun. O(1).
    ///
    /// # Safety
    ///
    /// `entry` is live, in no wait point's list, and no other thread accesses it.
    pub(super) unsafe fn end(entry: NonNull<Entry>) {
        // SAFETY: by the contract. Until it is taken out, others may access the node of `listed`
        // under its executor's lock, so only the inheritor is referred to.
        unsafe {
            let this = entry.as_ptr();
            if std::mem::take(&mut (*this).is_listed) {
                let listed = (&raw mut (*this).listed).cast::<Listed>();
                let inheritor = &(*listed).inheritor;
                inheritor.end_wait(NonNull::new_unchecked(listed).cast());
                (*this).listed.assume_init_drop();
            }
            (*this).inheritor = None;
            (*this).core = None;
        }
    }

    /// What `node`, which is listed with a process, waits for: the entry, to be compared only, and
    /// its mutex, which is live.
    ///
    /// # Safety
    ///
    /// `node` was listed by [`begin`](Self::begin), and the lock of the process' executor is held.
    pub(super) unsafe fn waited_for(node: NonNull<WaitNode>) -> (NonNull<Entry>, NonNull<Core>) {
        // SAFETY: the contract.
        unsafe {
            let listed = node.cast::<Listed>().as_ptr();
            ((*listed).entry, (*listed).core)
        }
    }

    /// What has become of it.
    ///
    /// # Safety
    ///
    /// It is live and was begun.
    pub(super) unsafe fn outcome(entry: NonNull<Entry>) -> Outcome {
        // SAFETY: the contract.
        unsafe { Waiter::outcome(Self::waiter(entry)) }
    }

    /// How urgent it is now; under another runtime, as it was when it was listed.
    ///
    /// # Safety
    ///
    /// It is live, and the lock that guards it is held, if it is listed.
    pub(super) unsafe fn priority(entry: NonNull<Entry>) -> Priority {
        // SAFETY: the contract; this borrows the one field, or else the node.
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
    /// As for [`priority`](Self::priority).
    pub(super) unsafe fn is_of(entry: NonNull<Entry>, holder: &Inheritor) -> bool {
        // SAFETY: the contract; this borrows the one field.
        unsafe { &(*entry.as_ptr()).inheritor }
            .as_ref()
            .is_some_and(|inheritor| inheritor.is_same(holder))
    }

    /// Takes the inheritor out.
    ///
    /// # Safety
    ///
    /// It is live, and the lock that guards it is held.
    pub(super) unsafe fn take_inheritor(entry: NonNull<Entry>) -> Option<Inheritor> {
        // SAFETY: the contract; this borrows the one field.
        unsafe { (*entry.as_ptr()).inheritor.take() }
    }

    /// The mutex that it is to lock.
    ///
    /// # Safety
    ///
    /// It is live.
    pub(super) unsafe fn core(entry: NonNull<Entry>) -> Option<NonNull<Core>> {
        // SAFETY: the contract; between begin and end, this does not change.
        unsafe { &(*entry.as_ptr()).core }
            .as_ref()
            .map(CoreRef::pointer)
    }

    /// # Safety
    ///
    /// It is live, and the condition's lock is held.
    pub(super) unsafe fn cause(entry: NonNull<Entry>) -> Cause {
        // SAFETY: the contract.
        unsafe { (*entry.as_ptr()).cause }
    }

    /// # Safety
    ///
    /// As for [`cause`](Self::cause).
    pub(super) unsafe fn set_cause(entry: NonNull<Entry>, cause: Cause) {
        // SAFETY: the contract.
        unsafe { (*entry.as_ptr()).cause = cause };
    }

    /// In which round of the condition it waits.
    ///
    /// # Safety
    ///
    /// It was begun, and the condition's lock is held.
    pub(super) unsafe fn ticket(entry: NonNull<Entry>) -> u32 {
        // SAFETY: the contract.
        unsafe { (*Waiter::link(Self::waiter(entry))).ticket }
    }

    /// # Safety
    ///
    /// As for [`ticket`](Self::ticket).
    pub(super) unsafe fn set_ticket(entry: NonNull<Entry>, ticket: u32) {
        // SAFETY: the contract.
        unsafe { (*Waiter::link(Self::waiter(entry))).ticket = ticket };
    }

    /// Takes the wake handle out.
    ///
    /// # Safety
    ///
    /// It was begun and is in no list any more, and the lock is held that guarded it.
    #[must_use = "its drop is user code, and the caller's last step"]
    pub(super) unsafe fn take_wake_handle(entry: NonNull<Entry>) -> Option<WakeHandle> {
        // SAFETY: the contract.
        unsafe { (*Waiter::link(Self::waiter(entry))).wait.wake_handle_mut() }.take()
    }

    /// Makes it wake the present poller.
    ///
    /// # Safety
    ///
    /// It is listed, and the lock is held that guards it.
    pub(super) unsafe fn renew_wake_handle(entry: NonNull<Entry>, renewal: &mut Renewal<'_, '_>) {
        // SAFETY: the contract.
        renewal.store(unsafe { (*Waiter::link(Self::waiter(entry))).wait.wake_handle_mut() });
    }
}

/// The inheritor for a lock taken by the caller: its process; or the thread, if it runs no process
/// and the `thread` itself holds the lock.
pub(super) fn inheritor(thread: bool) -> Option<Inheritor> {
    if thread {
        Inheritor::current_or_thread()
    } else {
        Inheritor::current()
    }
}
