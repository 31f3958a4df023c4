//! What two processes of one executor do, when nothing is asked of their channel but to send and to receive: nearly every communication.
//!
//! It comes to what [`Section`](super::Section) comes to, on a way without branches for what is not there: the lock favours the executor, so it is
//! taken and left by plain stores; no waker is cloned or called; nobody is registered, no call is served, no buffer overwrites. Whenever one of these
//! does not hold, nothing has been changed, and the general way is gone.
//!
//! A node that was listed here says so ([`Waiter::begin_plain`]), and whoever finds it here knows that its process is of this very home: only the home
//! that a lock favours comes here, and a lock favours no second one.
//!
//! A process that is recorded goes a way of its own, which is the same but for the events: so the others need not ask at each of them whether anybody records.

use super::Channel;
use crate::place::{LastUser, Lists, Place, user_number};
use crate::source::{Offered, Source};
use crate::waiter::Waiter;
use luna_platform::current::{self, PlainReady, Process};
use luna_platform::events;
use luna_platform::home_lock::InsideGuard;
use luna_platform::wait_list::WaitNode;
use std::ptr::NonNull;
use std::task::Context;

/// What an operation at home came to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum AtHome {
    /// The general way is to be gone: nothing has changed.
    No,
    /// The node is listed.
    Waits,
    /// It is done, and the partner readied.
    Done,
    /// It is done, and the process is ready again: it lets others run first.
    GaveWay,
}

impl AtHome {
    #[inline(always)]
    fn done(process: &Process) -> AtHome {
        match current::gives_way(process) {
            true => AtHome::GaveWay,
            false => AtHome::Done,
        }
    }
}

/// Gives the value of `offered` to the receiver that waits first, if that is a plain operation's. Ready it when the lock is released. `None`: nothing has
/// changed. It is told as an event if it is `RECORDED`, as below.
///
/// # Safety
///
/// `first` is the first of the receivers, in a channel of values of this type whose lock this home has. `offered` holds a value, and nobody else accesses it.
#[inline(always)]
pub(super) unsafe fn give_to_first<T, const RECORDED: bool>(
    place: &Place,
    lists: &mut Lists,
    first: NonNull<WaitNode>,
    offered: NonNull<Waiter<T>>,
    process: &Process,
) -> Option<PlainReady> {
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

/// Takes the value of the sender that waits first, if that is a plain operation's. Ready it when the lock is released. `None`: nothing has changed.
///
/// # Safety
///
/// `first` is the first of the senders, in a channel of values of this type whose lock this home has.
#[inline(always)]
pub(super) unsafe fn take_from_first<T, const RECORDED: bool>(
    place: &Place,
    lists: &mut Lists,
    first: NonNull<WaitNode>,
    process: &Process,
) -> Option<(T, PlainReady)> {
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
    /// `offered` is not listed, nobody else accesses it, and it holds or makes its value. It stays where it is until it is settled or withdrawn.
    #[inline]
    pub(crate) unsafe fn send_at_home<S: Source<T>>(
        &self,
        offered: NonNull<Offered<T, S>>,
        cx: &Context<'_>,
    ) -> AtHome {
        if S::MAKE.is_some() {
            return AtHome::No;
        }
        let Some(process) = current::unrecorded_turn(cx) else {
            return match events::is_on() {
                // SAFETY: the contract.
                true => unsafe { self.send_recorded(offered, cx) },
                false => AtHome::No,
            };
        };
        // SAFETY: the contract.
        unsafe { self.send_in_turn::<S, false>(offered, process) }
    }

    /// As [`send_at_home`](Self::send_at_home), for a process that is recorded. What it waits for is noted.
    ///
    /// # Safety
    ///
    /// As there.
    #[inline(never)]
    unsafe fn send_recorded<S: Source<T>>(
        &self,
        offered: NonNull<Offered<T, S>>,
        cx: &Context<'_>,
    ) -> AtHome {
        let Some(process) = current::plain_turn(cx) else {
            return AtHome::No;
        };
        // SAFETY: the contract.
        let came_to = unsafe { self.send_in_turn::<S, true>(offered, process) };
        if came_to == AtHome::Waits {
            self.place.waits();
        }
        came_to
    }

    /// # Safety
    ///
    /// As for [`send_at_home`](Self::send_at_home), by the process whose plain turn this is.
    #[inline(always)]
    unsafe fn send_in_turn<S: Source<T>, const RECORDED: bool>(
        &self,
        offered: NonNull<Offered<T, S>>,
        process: &Process,
    ) -> AtHome {
        let home = process.home_number();
        // SAFETY: this is the thread of the process' home. Under the lock a listed node may be changed, and is one of this channel's.
        unsafe {
            let Some(mut lists) = self.place.lock_if_favoured(home) else {
                return AtHome::No;
            };
            if !lists.is_plain {
                return match lists.is_plain_but_registered {
                    true => self.send_to_registered::<S, RECORDED>(lists, offered, process),
                    false => AtHome::No,
                };
            }
            let Some(first) = lists.receivers.first() else {
                if !lists.is_rendezvous && self.store.with(|store| (*store).len() < self.capacity())
                {
                    lists.sender = LastUser::process(process.id());
                    if RECORDED {
                        self.place.tell(|| [process.id().get().into(), 0]);
                    }
                    let value = offered.as_ref().waiter.take_value();
                    self.store.with_mut(|store| (*store).push_back(value));
                    drop(lists);
                    return AtHome::done(process);
                }
                if !lists.senders.is_empty() {
                    return AtHome::No;
                }
                lists.sender = LastUser::process(process.id());
                let node = offered.cast::<Waiter<T>>();
                Waiter::begin_plain(node, process);
                lists.senders.insert_alone(node.cast());
                return AtHome::Waits;
            };
            let node = offered.cast();
            let Some(ready) =
                give_to_first::<T, RECORDED>(&self.place, &mut lists, first, node, process)
            else {
                return match lists.is_rendezvous {
                    true => self.send_to_guard::<S, RECORDED>(lists, offered, process),
                    false => AtHome::No,
                };
            };
            drop(lists);
            ready.wake();
        }
        AtHome::done(process)
    }

    /// Receives into the node, or lists the receiver. O(1), without atomic read-modify-writes.
    ///
    /// # Safety
    ///
    /// `node` is not listed, nobody else accesses it, and it holds no value. It stays where it is until it is settled or withdrawn.
    #[inline]
    pub(crate) unsafe fn recv_at_home(&self, node: NonNull<Waiter<T>>, cx: &Context<'_>) -> AtHome {
        let Some(process) = current::unrecorded_turn(cx) else {
            return match events::is_on() {
                // SAFETY: the contract.
                true => unsafe { self.recv_recorded(node, cx) },
                false => AtHome::No,
            };
        };
        // SAFETY: the contract.
        unsafe { self.recv_in_turn::<false>(node, process) }
    }

    /// As [`recv_at_home`](Self::recv_at_home), for a process that is recorded. What it waits for is noted.
    ///
    /// # Safety
    ///
    /// As there.
    #[inline(never)]
    unsafe fn recv_recorded(&self, node: NonNull<Waiter<T>>, cx: &Context<'_>) -> AtHome {
        let Some(process) = current::plain_turn(cx) else {
            return AtHome::No;
        };
        // SAFETY: the contract.
        let came_to = unsafe { self.recv_in_turn::<true>(node, process) };
        if came_to == AtHome::Waits {
            self.place.waits();
        }
        came_to
    }

    /// # Safety
    ///
    /// As for [`recv_at_home`](Self::recv_at_home), by the process whose plain turn this is.
    #[inline(always)]
    unsafe fn recv_in_turn<const RECORDED: bool>(
        &self,
        node: NonNull<Waiter<T>>,
        process: &Process,
    ) -> AtHome {
        let home = process.home_number();
        // SAFETY: as above.
        unsafe {
            let Some(mut lists) = self.place.lock_if_favoured(home) else {
                return AtHome::No;
            };
            if !lists.is_plain {
                return AtHome::No;
            }
            // A rendezvous stores nothing, or it is not plain.
            if !lists.is_rendezvous && self.store.with(|store| !(*store).is_empty()) {
                return self.recv_stored::<RECORDED>(node, process, lists);
            }
            let Some(first) = lists.senders.first() else {
                if !lists.receivers.is_empty() {
                    return AtHome::No;
                }
                lists.receiver = LastUser::process(process.id());
                Waiter::begin_plain(node, process);
                lists.receivers.insert_alone(node.cast());
                return AtHome::Waits;
            };
            let Some((value, ready)) =
                take_from_first::<T, RECORDED>(&self.place, &mut lists, first, process)
            else {
                return match lists.is_rendezvous {
                    true => self.recv_from_guard::<RECORDED>(lists, node, process),
                    false => AtHome::No,
                };
            };
            Waiter::put_value_of(node, value);
            drop(lists);
            ready.wake();
        }
        AtHome::done(process)
    }

    /// Receives what is stored; a sender that waits moves up.
    ///
    /// # Safety
    ///
    /// As for [`recv_at_home`](Self::recv_at_home), by the process whose plain turn this is; not more is stored than there is room for.
    #[inline(never)]
    unsafe fn recv_stored<const RECORDED: bool>(
        &self,
        node: NonNull<Waiter<T>>,
        process: &Process,
        mut lists: InsideGuard<'_, Lists>,
    ) -> AtHome {
        // SAFETY: the contract; the lock is held, which guards the store too.
        unsafe {
            let mut moves_up = None;
            if let Some(first) = lists.senders.first() {
                let Some(ready) = Waiter::take_plain_wakeup(first.cast::<Waiter<T>>()) else {
                    return AtHome::No;
                };
                moves_up = Some((first, ready));
            }
            lists.receiver = LastUser::process(process.id());
            let Some(value) = self.store.with_mut(|store| (*store).pop_front()) else {
                return AtHome::No;
            };
            Waiter::put_value_of(node, value);
            if RECORDED {
                self.place.tell(|| [0, process.id().get().into()]);
            }
            let Some((first, ready)) = moves_up else {
                drop(lists);
                return AtHome::done(process);
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
        }
        AtHome::done(process)
    }
}
