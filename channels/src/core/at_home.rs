//! What two processes of one executor do, when nothing is asked of their channel but to send and to receive: nearly every communication.
//!
//! It comes to what [`Section`](super::Section) comes to, on a way without branches for what is not there: the lock favours the executor, so it is
//! taken and left by plain stores; no waker is cloned or called; nobody is registered, no call is served, nothing is buffered. Whenever one of these
//! does not hold, nothing has been changed, and the general way is gone.

use super::Channel;
use crate::place::LastUser;
use crate::source::{Offered, Source};
use crate::waiter::{Outcome, Waiter};
use luna_platform::current::{self, Process, Ready, User, Wakeup};
use luna_platform::wait_list::WaitList;
use std::ptr::NonNull;
use std::task::Context;

/// A send at home came to this.
pub(crate) enum SentAtHome {
    /// A receiver has it. Ready the receiver.
    Done(Ready),
    /// The sender waits: its node is listed.
    Waits,
}

/// A receive at home came to this.
pub(crate) enum ReceivedAtHome<T> {
    /// A value. Ready the sender.
    Done(T, Ready),
    /// The receiver waits: its node is listed.
    Waits,
}

impl<T> Channel<T> {
    /// Sends, or lists the sender. `None`: the general way is to be gone, and nothing has changed. O(1), without atomic read-modify-writes.
    ///
    /// # Safety
    ///
    /// `offered` is not listed, nobody else accesses it, and it holds its value. It stays where it is until it is settled or withdrawn.
    #[inline(always)]
    pub(crate) unsafe fn send_at_home<S: Source<T>>(
        &self,
        offered: NonNull<Offered<T, S>>,
        cx: &Context<'_>,
    ) -> Option<SentAtHome> {
        if S::MAKE.is_some() {
            return None;
        }
        // SAFETY: the contract; the current process' home is this thread. Under the lock a listed node may be changed, and is one of this channel's.
        current::in_plain_turn(cx, |process| unsafe {
            let mut lists = self.place.lock_if_favoured(process.home_number())?;
            if !lists.is_plain {
                return None;
            }
            let Some(first) = lists.receivers.first() else {
                if !lists.senders.is_empty() {
                    return None;
                }
                lists.sender = LastUser::process(process.id());
                let node = offered.cast::<Waiter<T>>();
                Waiter::begin(node, false, None, None);
                list(&mut lists.senders, node, process);
                return Some(SentAtHome::Waits);
            };
            let receiver = first.cast::<Waiter<T>>();
            if (*Waiter::link(receiver)).selection.is_some() {
                return None;
            }
            lists.sender = LastUser::process(process.id());
            lists.receivers.remove(first);
            let value = offered.as_ref().waiter.take_value();
            receiver.as_ref().put_value(value);
            Some(SentAtHome::Done(Waiter::settle(receiver, Outcome::Done)))
        })
    }

    /// Receives, or lists the receiver. `None`: the general way is to be gone, and nothing has changed. O(1), without atomic read-modify-writes.
    ///
    /// # Safety
    ///
    /// `node` is not listed, nobody else accesses it, and it holds no value. It stays where it is until it is settled or withdrawn.
    #[inline(always)]
    pub(crate) unsafe fn recv_at_home(
        &self,
        node: NonNull<Waiter<T>>,
        cx: &Context<'_>,
    ) -> Option<ReceivedAtHome<T>> {
        // SAFETY: as above.
        current::in_plain_turn(cx, |process| unsafe {
            let mut lists = self.place.lock_if_favoured(process.home_number())?;
            if !lists.is_plain {
                return None;
            }
            let Some(first) = lists.senders.first() else {
                if !lists.receivers.is_empty() {
                    return None;
                }
                // Those that came back from futures that were dropped go first.
                if self.store.with(|store| !(*store).is_empty()) {
                    return None;
                }
                lists.receiver = LastUser::process(process.id());
                Waiter::begin(node, false, None, None);
                list(&mut lists.receivers, node, process);
                return Some(ReceivedAtHome::Waits);
            };
            let sender = first.cast::<Waiter<T>>();
            let link = Waiter::link(sender);
            if (*link).selection.is_some() || (*link).makes() {
                return None;
            }
            if self.store.with(|store| !(*store).is_empty()) {
                return None;
            }
            lists.receiver = LastUser::process(process.id());
            lists.senders.remove(first);
            let value = sender.as_ref().take_value();
            Some(ReceivedAtHome::Done(
                value,
                Waiter::settle(sender, Outcome::Done),
            ))
        })
    }
}

/// Lists the node of the current process.
///
/// # Safety
///
/// The list is empty, and guarded by the lock that is held; the node was begun, and stays where it is until it is settled or withdrawn. This is a plain turn of the
/// process.
#[inline(always)]
unsafe fn list<T>(list: &mut WaitList, node: NonNull<Waiter<T>>, process: &Process) {
    let user = User::Process(process.id());
    let wakeup = Wakeup::of_plain_turn(process);
    // SAFETY: the contract; the wait node is the first field.
    unsafe { list.insert_alone(node.cast(), user, process.priority(), wakeup) };
}
