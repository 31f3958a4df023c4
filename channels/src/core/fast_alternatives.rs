//! Fast path of an alternative and its partners: the steps of [`fast_path`](super::fast_path), with
//! an alternative on one side.
//!
//! An alternative takes the locks of all its wait points here too, by plain stores, and holds them
//! until it has chosen or is listed everywhere. So the argument for its decision on the slow path
//! holds here for the same reason. Its choice is committed under its commit lock, which is biased
//! to the same executor.

use super::fast_path::{give_to_first, take_from_first};
use super::{Channel, FastPath};
use crate::alternative::{Entry, Look};
use crate::select_state::SelectState;
use crate::source::{Offered, Source};
use crate::wait_point::{LastUser, WaitQueues};
use crate::waiter::{Outcome, Waiter};
use luna_core::biased_lock::InsideGuard;
use luna_core::current::{PlainPendingWake, Process};
use std::ptr::NonNull;

/// A partner on the fast path.
impl<T> Channel<T> {
    /// Sends to the alternative that is registered here, or lists the sender and reports the
    /// channel to it.
    ///
    /// # Safety
    ///
    /// As for [`send_fast`](Self::send_fast), where `process` has its plain turn. The lists are
    /// this channel's, and plain but for one registered alternative.
    pub(super) unsafe fn send_to_registered<S: Source<T>>(
        &self,
        mut lists: InsideGuard<'_, WaitQueues>,
        offered: NonNull<Offered<T, S>>,
        process: &Process,
    ) -> FastPath {
        if !lists.receivers.is_empty() || !lists.senders.is_empty() {
            return FastPath::No;
        }
        let Some(node) = lists.registered.first() else {
            return FastPath::No;
        };
        let entry = node.cast::<Entry<T>>();
        let receiver = node.cast::<Waiter<T>>();
        // SAFETY: a registered node is that of a live entry, which the lock guards.
        let claimed = unsafe { Entry::claim_or_announce(entry, process.home_number()) };
        match claimed {
            None => FastPath::No,
            // SAFETY: the contract; the entry was just claimed, and holds no value before it is
            // done.
            Some(Some(ready)) => unsafe {
                lists.sender = LastUser::process(process.id());
                Waiter::put_value_of(receiver, offered.as_ref().waiter.take_value());
                Waiter::settle_plain(receiver);
                drop(lists);
                go_on(ready, process)
            },
            // SAFETY: by the contract on `offered` and the lock; no other node is listed.
            Some(None) => unsafe { wait_as_sender(&mut lists, offered, process) },
        }
    }

    /// Sends to the first waiting alternative with a listed guard here, and takes the guards of
    /// others off the list; or lists the sender.
    ///
    /// # Safety
    ///
    /// As for [`send_fast`](Self::send_fast), where `process` has its plain turn. The lists are
    /// this channel's, and plain.
    #[inline(never)]
    pub(super) unsafe fn send_to_guard<S: Source<T>>(
        &self,
        mut lists: InsideGuard<'_, WaitQueues>,
        offered: NonNull<Offered<T, S>>,
        process: &Process,
    ) -> FastPath {
        while let Some(first) = lists.receivers.first() {
            let receiver = first.cast::<Waiter<T>>();
            // SAFETY: the node is listed, and guarded by the lock; its select state is live. A
            // receiver holds no value before it is done.
            unsafe {
                let Some((selection, guard)) = Waiter::selection(receiver) else {
                    return FastPath::No;
                };
                let selection = selection.as_ref();
                if selection.is_open() {
                    let Some(gate) = selection.gate_if_favoured(process.home_number()) else {
                        return FastPath::No;
                    };
                    let Some(ready) = selection.claim_plainly(guard) else {
                        return FastPath::No;
                    };
                    drop(gate);
                    lists.sender = LastUser::process(process.id());
                    lists.receivers.remove_first(first);
                    Waiter::put_value_of(receiver, offered.as_ref().waiter.take_value());
                    Waiter::settle_plain(receiver);
                    drop(lists);
                    return go_on(ready, process);
                }
                // A claim would fail, as it will on the slow path.
                lists.receivers.remove_first(first);
                Waiter::settle_stale(receiver);
            }
        }
        if !lists.senders.is_empty() {
            return FastPath::No;
        }
        // SAFETY: by the contract on `offered` and the lock; no other node is listed.
        unsafe { wait_as_sender(&mut lists, offered, process) }
    }

    /// Receives from the first waiting alternative that offers to send here, and takes the guards
    /// of others off the list; or lists the receiver.
    ///
    /// # Safety
    ///
    /// As for [`recv_fast`](Self::recv_fast), where `process` has its plain turn. The lists are
    /// this channel's, and plain, and nothing is stored.
    #[inline(never)]
    pub(super) unsafe fn recv_from_guard(
        &self,
        mut lists: InsideGuard<'_, WaitQueues>,
        node: NonNull<Waiter<T>>,
        process: &Process,
    ) -> FastPath {
        while let Some(first) = lists.senders.first() {
            let sender = first.cast::<Waiter<T>>();
            // SAFETY: the node is listed, and guarded by the lock; its select state is live. A
            // plainly opened one belongs to guards on the fast path only, which hold their values.
            unsafe {
                let Some((selection, guard)) = Waiter::selection(sender) else {
                    return FastPath::No;
                };
                let selection = selection.as_ref();
                if selection.is_open() {
                    let Some(gate) = selection.gate_if_favoured(process.home_number()) else {
                        return FastPath::No;
                    };
                    let Some(ready) = selection.claim_plainly(guard) else {
                        return FastPath::No;
                    };
                    drop(gate);
                    lists.receiver = LastUser::process(process.id());
                    lists.senders.remove_first(first);
                    Waiter::put_value_of(node, Waiter::take_value_of(sender));
                    Waiter::settle_plain(sender);
                    drop(lists);
                    return go_on(ready, process);
                }
                lists.senders.remove_first(first);
                Waiter::settle_stale(sender);
            }
        }
        if !lists.receivers.is_empty() {
            return FastPath::No;
        }
        lists.receiver = LastUser::process(process.id());
        // SAFETY: by the contract on `node` and the lock; no other node is listed.
        unsafe {
            Waiter::begin_plain(node, process);
            lists.receivers.insert_alone(node.cast());
        }
        FastPath::Waits
    }
}

/// An alternative on the fast path, for one of its guards. Fast-path guards are those of plain
/// channels only, with plain operations as partners.
impl<T> Channel<T> {
    /// Locks, and returns whether a receive would not have to wait. Unless the result is
    /// [`No`](Look::No), the lock is kept.
    ///
    /// # Safety
    ///
    /// This thread is the executor of that number.
    #[inline(always)]
    pub(crate) unsafe fn look_for_sender(&self, home: u64) -> Look {
        // SAFETY: the contract; under the lock the store and the nodes in the lists are accessible.
        unsafe {
            let Some(lists) = self.place.lock_if_free(home) else {
                return Look::No;
            };
            if !lists.is_plain_rendezvous() || lists.is_storing {
                return Look::No;
            }
            look_at::<T>(lists.senders.first(), lists)
        }
    }

    /// As [`look_for_sender`](Self::look_for_sender), for a send.
    ///
    /// # Safety
    ///
    /// As there.
    #[inline(always)]
    pub(crate) unsafe fn look_for_receiver(&self, home: u64) -> Look {
        // SAFETY: as above.
        unsafe {
            let Some(lists) = self.place.lock_if_free(home) else {
                return Look::No;
            };
            if !lists.is_plain_rendezvous() {
                return Look::No;
            }
            look_at::<T>(lists.receivers.first(), lists)
        }
    }

    /// Releases the lock that was kept.
    ///
    /// # Safety
    ///
    /// A look by this executor, on this thread, has kept the lock.
    #[inline(always)]
    pub(crate) unsafe fn leave_home(&self, home: u64) {
        // SAFETY: the contract.
        drop(unsafe { self.place.kept(home) });
    }

    /// Receives for a registered alternative from a plain sender, if that is the first to wait;
    /// then reports under the lock whether no other waits. `None`: not possible here, or `still`
    /// returned false under the lock; no state changed.
    ///
    /// # Safety
    ///
    /// This is the thread of the process' executor.
    #[inline(always)]
    pub(crate) unsafe fn take_sender_if(
        &self,
        process: &Process,
        still: impl FnOnce() -> bool,
        note: impl FnOnce(bool),
    ) -> Option<(T, PlainPendingWake)> {
        // SAFETY: the contract. Under the lock a listed node is one of this channel's, and a
        // sender's holds its value.
        unsafe {
            let mut lists = self.place.lock_if_favoured(process.home_number())?;
            if !lists.is_plain_but_registered || lists.is_storing || !still() {
                return None;
            }
            let first = lists.senders.first()?;
            let taken = take_from_first::<T>(&mut lists, first, process)?;
            note(lists.senders.is_empty());
            Some(taken)
        }
    }

    /// Receives into the node, and releases the lock that was kept.
    ///
    /// # Safety
    ///
    /// As for [`leave_home`](Self::leave_home), and the look reported that it is ready. The node is
    /// not listed, holds no value, and no other thread accesses it.
    #[inline(always)]
    pub(crate) unsafe fn take_sender(
        &self,
        node: NonNull<Waiter<T>>,
        process: &Process,
    ) -> Option<PlainPendingWake> {
        // SAFETY: the contract; under the lock a listed node is one of this channel's, and a
        // sender's holds its value.
        unsafe {
            let mut lists = self.place.kept(process.home_number());
            let first = lists.senders.first()?;
            let (value, ready) = take_from_first::<T>(&mut lists, first, process)?;
            Waiter::put_value_of(node, value);
            Some(ready)
        }
    }

    /// Sends the node's value, and releases the lock that was kept.
    ///
    /// # Safety
    ///
    /// As for [`take_sender`](Self::take_sender); but the node holds a value.
    #[inline(always)]
    pub(crate) unsafe fn take_receiver(
        &self,
        node: NonNull<Waiter<T>>,
        process: &Process,
    ) -> Option<PlainPendingWake> {
        // SAFETY: as above; a listed receiver's node holds no value.
        unsafe {
            let mut lists = self.place.kept(process.home_number());
            let first = lists.receivers.first()?;
            give_to_first::<T>(&mut lists, first, node, process)
        }
    }

    /// Lists the node of a guard, on the side given by `of_sender`, and releases the lock that was
    /// kept.
    ///
    /// # Safety
    ///
    /// As for [`leave_home`](Self::leave_home), and the look reported that it is not ready. The
    /// node is not listed, no other thread accesses it, and it holds a value if it is a sender's.
    /// It stays where it is until it is settled or withdrawn, and the select state outlives that.
    #[inline(always)]
    pub(crate) unsafe fn list_guard(
        &self,
        node: NonNull<Waiter<T>>,
        of_sender: bool,
        selection: (NonNull<SelectState>, u32),
        process: &Process,
    ) {
        // SAFETY: the contract.
        unsafe {
            let mut lists = self.place.kept(process.home_number());
            Waiter::begin_guard(node, process, selection.0, selection.1);
            let (list, user) = match of_sender {
                true => (&raw mut lists.senders, &raw mut lists.sender),
                false => (&raw mut lists.receivers, &raw mut lists.receiver),
            };
            *user = LastUser::process(process.id());
            if (*list).is_empty() {
                (*list).insert_alone(node.cast());
            } else {
                (*list).insert(node.cast(), process.priority(), None);
            }
        }
    }

    /// Takes the node of a guard that was not chosen off its list, if it is still there.
    ///
    /// # Safety
    ///
    /// `node` was listed in this channel, on the side given by `of_sender`. This thread is the
    /// executor of that number.
    #[inline(always)]
    pub(crate) unsafe fn withdraw_guard(
        &self,
        node: NonNull<Waiter<T>>,
        of_sender: bool,
        home: u64,
    ) {
        // SAFETY: the contract; under the lock a waiting node is listed.
        unsafe {
            if Waiter::outcome(node) != Outcome::Waiting {
                return;
            }
            let lists = self.place.lock_if_favoured(home);
            match lists {
                // A plain channel serves no call, so waiters here boost no server.
                Some(mut lists)
                    if lists.is_plain_rendezvous() && Waiter::outcome(node) == Outcome::Waiting =>
                {
                    match of_sender {
                        true => lists.senders.remove(node.cast()),
                        false => lists.receivers.remove(node.cast()),
                    }
                    Waiter::settle_stale(node);
                }
                lists => {
                    drop(lists);
                    drop(self.withdraw(node, of_sender));
                }
            }
        }
    }
}

/// Handles the first waiting partner. Keeps the lock unless the result is [`No`](Look::No).
///
/// # Safety
///
/// `first` is the first in a list of waiters of such values that the lock guards.
#[inline(always)]
unsafe fn look_at<T>(
    first: Option<NonNull<luna_core::wait_list::WaitNode>>,
    lists: InsideGuard<'_, WaitQueues>,
) -> Look {
    let look = match first {
        None => Look::NotReady,
        // SAFETY: the contract.
        Some(first) if unsafe { Waiter::<T>::is_plain(first.cast()) } => Look::Ready,
        // Another alternative, or one with a waker of its own.
        Some(_) => return Look::No,
    };
    lists.keep();
    look
}

/// Lists a sender.
///
/// # Safety
///
/// As for [`send_fast`](Channel::send_fast); and no node is listed on either side.
#[inline(always)]
unsafe fn wait_as_sender<T, S: Source<T>>(
    lists: &mut WaitQueues,
    offered: NonNull<Offered<T, S>>,
    process: &Process,
) -> FastPath {
    lists.sender = LastUser::process(process.id());
    let node = offered.cast::<Waiter<T>>();
    // SAFETY: the contract.
    unsafe {
        Waiter::begin_plain(node, process);
        lists.senders.insert_alone(node.cast());
    }
    FastPath::Waits
}

/// Wakes the partner, and lets others run before `process` if they are to.
///
/// # Safety
///
/// The wake handle was made on this thread, where this is the plain turn of `process`.
#[inline(always)]
unsafe fn go_on(ready: PlainPendingWake, process: &Process) -> FastPath {
    // SAFETY: by the contract the wake handle was made here, and `process` is the current one, in a
    // plain turn.
    unsafe {
        ready.wake();
        FastPath::done(process)
    }
}
