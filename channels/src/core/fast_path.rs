//! Communication between two processes of one executor, over a channel that is used for plain sends
//! and receives only: nearly every communication.
//!
//! It gives the same results as [`ChannelGuard`](super::ChannelGuard), without branches for what is
//! not there: the lock is biased to the executor, so it is taken and left by plain stores; no waker
//! is cloned or called; no alternative is registered, no call is served, no buffer overwrites.
//! Whenever one of these conditions does not hold, no state has changed, and the operation takes
//! the slow path.
//!
//! A node that was listed here is marked so ([`Waiter::begin_plain`]). An operation that finds it
//! here knows that its process belongs to this very executor: only the executor that owns the bias
//! comes here, and a lock is biased to no second one.
//!
//! A recorded process has a path of its own, which is the same but for the events. So the others
//! need not test at each event whether it is recorded.

use super::Channel;
use super::meeting::{Found, come_to_receive, come_to_send, part_from_receiver, part_from_sender};
use crate::source::{Offered, Source};
use crate::wait_point::{LastUser, WaitPoint, WaitQueues, user_number};
use crate::waiter::Waiter;
use luna_core::current::{self, PlainPendingWake, Process};
use luna_core::events;
use luna_core::wait_list::WaitNode;
use std::ptr::NonNull;
use std::task::Context;

/// Result of an operation on the fast path.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum FastPath {
    /// Fast path unavailable; no state changed. Take the slow path.
    No,
    /// The node is listed.
    Waits,
    /// It is done, and the partner woken.
    Done,
    /// It is done, and the process is queued again: others run first.
    GaveWay,
}

impl FastPath {
    /// # Safety
    ///
    /// As for [`current::gives_way`].
    #[inline(always)]
    pub(super) unsafe fn done(process: &Process) -> FastPath {
        // SAFETY: the contract is the same.
        match unsafe { current::gives_way(process) } {
            true => FastPath::GaveWay,
            false => FastPath::Done,
        }
    }
}

/// Gives the value of `offered` to the first waiting receiver, if that is a plain operation's. The
/// caller wakes it when the lock is released. `None`: no state changed.
///
/// # Safety
///
/// `first` is the first of the receivers, in a channel of values of this type; this executor holds
/// its lock. `offered` holds a value, and no other thread accesses it.
#[inline(always)]
pub(super) unsafe fn give_to_first<T, const RECORDED: bool>(
    place: &WaitPoint,
    lists: &mut WaitQueues,
    first: NonNull<WaitNode>,
    offered: NonNull<Waiter<T>>,
    process: &Process,
) -> Option<PlainPendingWake> {
    // SAFETY: the contract; a listed receiver's node holds no value.
    unsafe {
        let receiver = first.cast::<Waiter<T>>();
        let ready = Waiter::take_plain_wakeup(receiver)?;
        if RECORDED {
            place.tell(|| [process.id().get().into(), user_number(first)]);
        }
        lists.sender = LastUser::process(process.id());
        lists.receivers.remove_first(first);
        Waiter::put_value_of(receiver, Waiter::take_value_of(offered));
        Waiter::settle_plain(receiver);
        Some(ready)
    }
}

/// Takes the value of the first waiting sender, if that is a plain operation's. The caller wakes it
/// when the lock is released. `None`: no state changed.
///
/// # Safety
///
/// `first` is the first of the senders, in a channel of values of this type; this executor holds
/// its lock.
#[inline(always)]
pub(super) unsafe fn take_from_first<T, const RECORDED: bool>(
    place: &WaitPoint,
    lists: &mut WaitQueues,
    first: NonNull<WaitNode>,
    process: &Process,
) -> Option<(T, PlainPendingWake)> {
    // SAFETY: the contract; a listed sender's node holds its value.
    unsafe {
        let sender = first.cast::<Waiter<T>>();
        let ready = Waiter::take_plain_wakeup(sender)?;
        if RECORDED {
            place.tell(|| [user_number(first), process.id().get().into()]);
        }
        lists.receiver = LastUser::process(process.id());
        lists.senders.remove_first(first);
        let value = Waiter::take_value_of(sender);
        Waiter::settle_plain(sender);
        Some((value, ready))
    }
}

impl<T> Channel<T> {
    /// Sends, or lists the sender. O(1), without atomic read-modify-writes.
    ///
    /// # Safety
    ///
    /// `offered` is not listed, no other thread accesses it, and it holds or makes its value. It
    /// stays where it is until it is settled or withdrawn.
    #[inline(always)]
    pub(crate) unsafe fn send_fast<S: Source<T>>(
        &self,
        offered: NonNull<Offered<T, S>>,
        cx: &Context<'_>,
    ) -> FastPath {
        if S::MAKE.is_some() {
            return FastPath::No;
        }
        // SAFETY: the contract.
        unsafe { self.send_in_turn::<S, false>(offered, cx) }
    }

    /// # Safety
    ///
    /// As for [`send_fast`](Self::send_fast).
    #[inline(always)]
    unsafe fn send_in_turn<S: Source<T>, const RECORDED: bool>(
        &self,
        offered: NonNull<Offered<T, S>>,
        cx: &Context<'_>,
    ) -> FastPath {
        // SAFETY: the contract. A receiver that is found holds no value, and its node is accessible
        // while the lock is held.
        unsafe {
            match come_to_send::<RECORDED>(&self.place, offered.cast(), cx) {
                Found::Partner(receiver) => {
                    let value = Waiter::take_value_of(offered.cast::<Waiter<T>>());
                    Waiter::put_value_of(receiver.cast::<Waiter<T>>(), value);
                    part_from_receiver::<RECORDED>(&self.place, receiver)
                }
                Found::Nobody => FastPath::Waits,
                Found::Buffer => self.store_fast::<RECORDED>(offered.cast()),
                found => self.send_otherwise::<S, RECORDED>(found, offered, cx),
            }
        }
    }

    /// As [`send_fast`](Self::send_fast), for a recorded process. Its waiting is noted.
    ///
    /// # Safety
    ///
    /// As there.
    #[cold]
    unsafe fn send_recorded<S: Source<T>>(
        &self,
        offered: NonNull<Offered<T, S>>,
        cx: &Context<'_>,
    ) -> FastPath {
        // SAFETY: the contract.
        let came_to = unsafe { self.send_in_turn::<S, true>(offered, cx) };
        if came_to == FastPath::Waits {
            self.place.waits();
        }
        came_to
    }

    /// Sends where an alternative may be met, or for a recorded process; or returns
    /// [`No`](FastPath::No) for the slow path.
    ///
    /// # Safety
    ///
    /// As for [`send_fast`](Self::send_fast); `found` is what the sender has found.
    #[inline(never)]
    unsafe fn send_otherwise<S: Source<T>, const RECORDED: bool>(
        &self,
        found: Found,
        offered: NonNull<Offered<T, S>>,
        cx: &Context<'_>,
    ) -> FastPath {
        if found != Found::More {
            return match !RECORDED && events::is_on() {
                // SAFETY: the contract: no state has changed.
                true => unsafe { self.send_recorded(offered, cx) },
                false => FastPath::No,
            };
        }
        // SAFETY: the contract: this is a process' turn, and it has the lock.
        unsafe {
            let process = current::this_process();
            let lists = self.place.kept(process.home_number());
            match (lists.is_plain, lists.is_plain_but_registered) {
                (false, true) => self.send_to_registered::<S, RECORDED>(lists, offered, process),
                (true, _) if lists.is_rendezvous => {
                    self.send_to_guard::<S, RECORDED>(lists, offered, process)
                }
                _ => FastPath::No,
            }
        }
    }

    /// Stores the value of a sender that has found only a [buffer](Found::Buffer), or lists the
    /// sender.
    ///
    /// # Safety
    ///
    /// `node` holds a value; as for [`send_fast`](Self::send_fast).
    #[inline(never)]
    unsafe fn store_fast<const RECORDED: bool>(&self, node: NonNull<Waiter<T>>) -> FastPath {
        // SAFETY: the contract: this is a process' turn, and it has the lock.
        unsafe {
            let process = current::this_process();
            let mut lists = self.place.kept(process.home_number());
            if self.store.with(|store| (*store).len() < self.capacity()) {
                lists.sender = LastUser::process(process.id());
                if RECORDED {
                    self.place.tell(|| [process.id().get().into(), 0]);
                }
                let value = Waiter::take_value_of(node);
                self.store.with_mut(|store| (*store).push_back(value));
                lists.is_storing = true;
                drop(lists);
                return FastPath::done(process);
            }
            if !lists.senders.is_empty() {
                return FastPath::No;
            }
            lists.sender = LastUser::process(process.id());
            Waiter::begin_plain(node, process);
            lists.senders.insert_alone(node.cast());
            FastPath::Waits
        }
    }

    /// Receives into the node, or lists the receiver. O(1), without atomic read-modify-writes.
    ///
    /// # Safety
    ///
    /// `node` is not listed, no other thread accesses it, and it holds no value. It stays where it
    /// is until it is settled or withdrawn.
    #[inline(always)]
    pub(crate) unsafe fn recv_fast(&self, node: NonNull<Waiter<T>>, cx: &Context<'_>) -> FastPath {
        // SAFETY: the contract.
        unsafe { self.recv_in_turn::<false>(node, cx) }
    }

    /// # Safety
    ///
    /// As for [`recv_fast`](Self::recv_fast).
    #[inline(always)]
    unsafe fn recv_in_turn<const RECORDED: bool>(
        &self,
        node: NonNull<Waiter<T>>,
        cx: &Context<'_>,
    ) -> FastPath {
        // SAFETY: the contract. A sender that is found holds its value, and its node is accessible
        // while the lock is held.
        unsafe {
            match come_to_receive::<RECORDED>(&self.place, node.cast(), cx) {
                Found::Partner(sender) => {
                    let value = Waiter::take_value_of(sender.cast::<Waiter<T>>());
                    Waiter::put_value_of(node, value);
                    part_from_sender::<RECORDED>(&self.place, sender)
                }
                Found::Nobody => FastPath::Waits,
                Found::Buffer => self.recv_stored::<RECORDED>(node),
                found => self.recv_otherwise::<RECORDED>(found, node, cx),
            }
        }
    }

    /// As [`recv_fast`](Self::recv_fast), for a recorded process. Its waiting is noted.
    ///
    /// # Safety
    ///
    /// As there.
    #[cold]
    unsafe fn recv_recorded(&self, node: NonNull<Waiter<T>>, cx: &Context<'_>) -> FastPath {
        // SAFETY: the contract.
        let came_to = unsafe { self.recv_in_turn::<true>(node, cx) };
        if came_to == FastPath::Waits {
            self.place.waits();
        }
        came_to
    }

    /// As [`send_otherwise`](Self::send_otherwise), for a receiver.
    ///
    /// # Safety
    ///
    /// As for [`recv_fast`](Self::recv_fast); `found` is what the receiver has found.
    #[inline(never)]
    unsafe fn recv_otherwise<const RECORDED: bool>(
        &self,
        found: Found,
        node: NonNull<Waiter<T>>,
        cx: &Context<'_>,
    ) -> FastPath {
        if found != Found::More {
            return match !RECORDED && events::is_on() {
                // SAFETY: the contract: no state has changed.
                true => unsafe { self.recv_recorded(node, cx) },
                false => FastPath::No,
            };
        }
        // SAFETY: the contract: this is a process' turn, and it has the lock.
        unsafe {
            let process = current::this_process();
            let lists = self.place.kept(process.home_number());
            match lists.is_rendezvous {
                true => self.recv_from_guard::<RECORDED>(lists, node, process),
                false => FastPath::No,
            }
        }
    }

    /// Receives a stored value; a waiting sender moves up.
    ///
    /// # Safety
    ///
    /// As for [`recv_fast`](Self::recv_fast), by a receiver that has found a
    /// [buffer](Found::Buffer).
    #[inline(never)]
    unsafe fn recv_stored<const RECORDED: bool>(&self, node: NonNull<Waiter<T>>) -> FastPath {
        // SAFETY: the contract: this is a process' turn, and it has the lock, which guards the
        // store too.
        unsafe {
            let process = current::this_process();
            let mut lists = self.place.kept(process.home_number());
            let stored = self.store.with(|store| (*store).len());
            // Values given back by dropped futures may exceed the capacity.
            if stored > self.capacity() {
                return FastPath::No;
            }
            let mut moves_up = None;
            if let Some(first) = lists.senders.first() {
                let Some(ready) = Waiter::take_plain_wakeup(first.cast::<Waiter<T>>()) else {
                    return FastPath::No;
                };
                moves_up = Some((first, ready));
            }
            lists.receiver = LastUser::process(process.id());
            let Some(value) = self.store.with_mut(|store| (*store).pop_front()) else {
                return FastPath::No;
            };
            Waiter::put_value_of(node, value);
            if RECORDED {
                self.place.tell(|| [0, process.id().get().into()]);
            }
            let Some((first, ready)) = moves_up else {
                lists.is_storing = stored > 1;
                drop(lists);
                return FastPath::done(process);
            };
            let sender = first.cast::<Waiter<T>>();
            if RECORDED {
                self.place.tell(|| [user_number(first), 0]);
            }
            lists.senders.remove_first(first);
            let next = Waiter::take_value_of(sender);
            self.store.with_mut(|store| (*store).push_back(next));
            Waiter::settle_plain(sender);
            drop(lists);
            ready.wake();
            FastPath::done(process)
        }
    }
}
