//! Waiting for the end of a channel, without offering to communicate.

use crate::in_place::InPlace;
use crate::replay::{self, Logged, Stage};
use crate::wait_point::{Ending, WaitPoint, WaitQueues};
use core::cell::UnsafeCell;
use core::future::Future;
use core::marker::PhantomPinned;
use core::pin::Pin;
use core::ptr::NonNull;
use core::task::{Context, Poll};
use luna_core::current::{self, PendingWake, Renewal, WakeHandle};
use luna_core::events;
use luna_core::replay_log::{Event, Turn, What};
use luna_core::wait_list::{WaitList, WaitNode};

/// How a channel has ended: what [`Ended`] gives.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum ChannelEnd {
    /// The other ends are gone.
    Closed,
    /// The channel, or the branch that waits, was poisoned.
    Poisoned,
}

/// The node of a watcher: a process that waits for the end. While it is listed the wait point's
/// lock guards it.
#[repr(C)]
struct Watcher {
    /// First, so that the list's node leads back to this.
    wait: WaitNode,
    of_poison_alone: bool,
    listed: bool,
}

impl Watcher {
    fn is_met_by(&self, ending: Ending) -> Option<ChannelEnd> {
        match ending {
            Ending::Poisoned => Some(ChannelEnd::Poisoned),
            Ending::Closed if !self.of_poison_alone => Some(ChannelEnd::Closed),
            _ => None,
        }
    }
}

/// Takes out the most urgent watcher of the present ending, and returns its wake handle. O(watchers
/// that wait on).
pub(crate) fn take_watcher(lists: &mut WaitQueues) -> Option<PendingWake> {
    let ending = lists.ending;
    let mut watchers = lists.watching.nodes().map(NonNull::cast::<Watcher>);
    // SAFETY: what is in this list is the first field of a live watcher, which the lock guards; the
    // lists are borrowed from it.
    let is_met = |watcher: &NonNull<Watcher>| unsafe { watcher.as_ref() }.is_met_by(ending);
    let watcher = watchers.find(|watcher| is_met(watcher).is_some())?;
    drop(watchers);
    // SAFETY: it was found in the list, and the lock of the list is held.
    Some(unsafe { unlist(&mut lists.watching, watcher) })
}

/// # Safety
///
/// `watcher` is in `list`, and the lock of `list` is held.
unsafe fn unlist(list: &mut WaitList, watcher: NonNull<Watcher>) -> PendingWake {
    // SAFETY: the watcher is in this list, and the lock is held that guards both: so it is live, no
    // other thread accesses it, and its wait node, the first field, can be removed.
    unsafe {
        list.remove(watcher.cast());
        (*watcher.as_ptr()).listed = false;
        let wake_handle = (*watcher.as_ptr()).wait.wake_handle_mut().take();
        wake_handle.map_or(PendingWake::NONE, WakeHandle::take)
    }
}

/// Waits for a channel's end: made by [`Sender::ended`](crate::Sender::ended),
/// [`Receiver::ended`](crate::Receiver::ended) and
/// [`Receiver::poisoned`](crate::Receiver::poisoned).
///
/// # Invariants
///
/// Once it was polled it is pinned, and leaves the list before it goes.
#[must_use = "it waits only when awaited"]
pub struct Ended<'a> {
    wait_point: &'a WaitPoint,
    /// The result, while its process is held by its replay log.
    given: Option<ChannelEnd>,
    /// Its process' replay log has admitted it.
    has_entered: bool,
    /// It has let others run.
    has_given_way: bool,
    watcher: UnsafeCell<Watcher>,
    _pinned: PhantomPinned,
}

// SAFETY: the watcher is touched under the wait point's lock alone, wherever the future is.
unsafe impl Send for Ended<'_> {}
// SAFETY: `&Ended` gives access to nothing that changes.
unsafe impl Sync for Ended<'_> {}

impl<'a> Ended<'a> {
    pub(crate) fn new(wait_point: &'a WaitPoint, of_poison_alone: bool) -> Self {
        Self {
            wait_point,
            given: None,
            has_entered: false,
            has_given_way: false,
            watcher: UnsafeCell::new(Watcher {
                wait: WaitNode::new(),
                of_poison_alone,
                listed: false,
            }),
            _pinned: PhantomPinned,
        }
    }

    fn node(&self) -> NonNull<Watcher> {
        NonNull::from(&self.watcher).cast()
    }
}

// SAFETY: what is pinned is the watcher, which every method leaves where it is.
unsafe impl InPlace for Ended<'_> {}

impl Future for Ended<'_> {
    type Output = ChannelEnd;

    fn poll(self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<ChannelEnd> {
        let this = self.in_place();
        match replay::is_on() {
            true => replay::poll(this, cx),
            false => this.poll_without_log(cx),
        }
    }
}

impl Logged for Ended<'_> {
    type Output = ChannelEnd;

    const KEEPS: bool = true;

    fn stage(&self) -> Stage {
        match self.given {
            Some(_) => Stage::GaveWay,
            None => Stage::New,
        }
    }

    fn come(&mut self, turn: Turn, _: &mut Context<'_>) -> Poll<()> {
        self.has_entered = true;
        match turn {
            Turn::Record => Poll::Ready(()),
            // It did not end while the recorded process waited.
            Turn::Look => Poll::Pending,
            Turn::Given(event) => {
                self.given = Some(match event.number {
                    0 => ChannelEnd::Closed,
                    _ => ChannelEnd::Poisoned,
                });
                Poll::Ready(())
            }
        }
    }

    fn poll_unlogged(&mut self, cx: &mut Context<'_>) -> Poll<ChannelEnd> {
        match self.given {
            Some(end) => Poll::Ready(end),
            None => self.poll_without_log(cx),
        }
    }

    unsafe fn success(&self, end: Option<&ChannelEnd>, _: u64) -> Event {
        let is_poisoned = end == Some(&ChannelEnd::Poisoned);
        Event::new(What::Chosen, u64::from(is_poisoned), replay::own_stamp())
    }

    fn keep(&mut self, end: ChannelEnd) {
        self.given = Some(end);
    }
}

impl Ended<'_> {
    /// The end that was found without waiting, after others have run if it is their turn. Once: in
    /// a process with a branch that spends all operations of each turn it would otherwise never
    /// come.
    #[cold]
    fn found(&mut self, end: ChannelEnd, cx: &Context<'_>) -> Poll<ChannelEnd> {
        if !self.has_given_way && crate::fails_later(cx) {
            self.has_given_way = true;
            return Poll::Pending;
        }
        Poll::Ready(end)
    }

    fn poll_without_log(&mut self, cx: &mut Context<'_>) -> Poll<ChannelEnd> {
        if current::branch_failed() {
            current::stay_in_branch();
            return self.found(ChannelEnd::Poisoned, cx);
        }
        let node = self.node();
        let mut renewal = Renewal::of(cx);
        let end = renewal.put(|renewal| {
            let mut lists = self.wait_point.lock_lists();
            // SAFETY: the lock is held that guards the watcher, which is pinned, and leaves the
            // list when the future is dropped.
            unsafe {
                let has_waited = node.as_ref().listed;
                if let Some(end) = node.as_ref().is_met_by(lists.ending) {
                    return Some((end, has_waited));
                }
                if has_waited {
                    renewal.store((*node.as_ptr()).wait.wake_handle_mut());
                } else if let Some(wake_handle) = renewal.take() {
                    (*node.as_ptr()).listed = true;
                    lists
                        .watching
                        .insert(node.cast(), current::priority(), wake_handle);
                }
            }
            None
        });
        match end {
            // No value is taken, so it looks again.
            Some((end, true)) => Poll::Ready(end),
            Some((end, false)) => self.found(end, cx),
            None => {
                events::waits_for_other();
                Poll::Pending
            }
        }
    }
}

impl Drop for Ended<'_> {
    fn drop(&mut self) {
        if self.given.is_none() {
            replay::abandon(!self.has_entered);
        }
        let node = self.node();
        let mut lists = self.wait_point.lock_lists();
        // SAFETY: the lock is held; a watcher in this state is in the list of its wait point.
        let unused = unsafe {
            if !node.as_ref().listed {
                return;
            }
            lists.watching.remove(node.cast());
            (*node.as_ptr()).wait.wake_handle_mut().take()
        };
        drop(lists);
        drop(unused);
    }
}

luna_platform::debug_fields!(Ended<'_>);
