//! The first poll: looks at the guards, and meets the partner of one that is ready.

use super::{Ends, Finish, PlainGuard, Visit};
use crate::alternative::guard::Guard;
use crate::core::{FastPath, part_alone, part_queued};
use crate::wait_point::WaitQueues;
use crate::waiter::Waiter;
use core::pin::Pin;
use core::ptr::NonNull;
use luna_core::biased_lock::InsideGuard;
use luna_core::current::PlainTurn;
use luna_core::wait_list::WaitNode;

/// Looks at new guards, and keeps the locks of those that it has seen. A guard that comes behind a
/// ready one, in the order of preference, cannot be chosen: it is not looked at.
#[derive(Debug)]
pub(in crate::alternative) struct Looks<'a, const FAIR: bool> {
    turn: PlainTurn<'a>,
    /// The number of the guard to choose; or `NONE`, or `REFUSED`.
    found: u32,
    /// When the end of `ready` was last chosen.
    least: u64,
    pub(in crate::alternative) ends: Ends<FAIR>,
    /// A bit for each guard with a locked wait point.
    locked: u32,
}

/// What [`Looks`] have found.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in crate::alternative) enum Found {
    /// The guard of this number is ready.
    Ready(u32),
    /// No guard is ready.
    Nothing,
    /// Fast path unavailable: no guard is there, or one cannot take it.
    Refused,
}

impl<'a, const FAIR: bool> Looks<'a, FAIR> {
    // As numbers of guards, so that one word holds what was found.
    const NONE: u32 = u32::MAX;
    const REFUSED: u32 = u32::MAX - 1;

    #[inline(always)]
    pub(in crate::alternative) fn new(turn: PlainTurn<'a>) -> Self {
        Self {
            turn,
            found: Self::NONE,
            least: u64::MAX,
            ends: Ends::new(),
            locked: 0,
        }
    }

    #[inline(always)]
    pub(in crate::alternative) fn found(&self) -> Found {
        match self.found {
            Self::REFUSED => Found::Refused,
            Self::NONE if self.locked == 0 => Found::Refused,
            Self::NONE => Found::Nothing,
            number => Found::Ready(number),
        }
    }

    /// What releases the locks, but for the lock of the guard that is ready.
    #[inline(always)]
    pub(in crate::alternative) fn leaving(&self) -> Leaving<'_> {
        Leaving {
            turn: self.turn,
            locked: match self.found() {
                Found::Ready(ready) => self.locked & !(1 << ready),
                _ => self.locked,
            },
        }
    }

    /// What lets the guard that is ready meet its partner.
    #[inline(always)]
    pub(in crate::alternative) fn meeting(&self) -> Meeting<'_, FAIR> {
        Meeting {
            turn: self.turn,
            ends: self.ends,
        }
    }
}

impl<const FAIR: bool> Visit for Looks<'_, FAIR> {
    #[inline(always)]
    fn visit<G: Guard>(&mut self, number: u32, guard: Pin<&mut G>) -> bool {
        let guard = guard.plain();
        let stamp = self.ends.note(guard.stamp);
        // Of two that were never chosen, the first.
        if stamp >= self.least {
            return true;
        }
        let Some(lists) = guard.wait_point.enter_in(self.turn.here()) else {
            self.found = Self::REFUSED;
            return false;
        };
        let is_ready = if lists.waiting.is_idle() {
            lists.keep();
            false
        } else if lists.waiting.one(!guard.of_sender).is_some() {
            lists.keep();
            true
        } else {
            // SAFETY: the lists are those of the guard's wait point: it was entered for them.
            let Some(found) = (unsafe { look_at_queues(lists, guard.of_sender) }) else {
                self.found = Self::REFUSED;
                return false;
            };
            found
        };
        self.locked |= 1 << number;
        if !is_ready {
            return true;
        }
        self.least = stamp;
        self.found = number;
        FAIR
    }
}

/// Whether there is a partner, where neither nothing nor a partner waits alone. `None`: fast path
/// unavailable, and the lock is released. Else it is kept.
///
/// # Safety
///
/// The lists are those of a wait point.
#[cold]
#[inline(never)]
unsafe fn look_at_queues(mut lists: InsideGuard<'_, WaitQueues>, of_sender: bool) -> Option<bool> {
    // What a buffer stores, and a guard of another alternative on the other side, are left to the
    // slow path.
    if !lists.is_plain_rendezvous()
        || !lists.leave_queues() && (lists.is_storing || lists.waiting.guard(!of_sender).is_some())
    {
        return None;
    }
    let partner = first_partner(&mut lists, of_sender);
    // SAFETY: under the lock the nodes in the queues are accessible.
    if partner.is_some_and(|first| !unsafe { Waiter::<()>::has_plain_wake_handle(first.cast()) }) {
        return None;
    }
    lists.keep();
    Some(partner.is_some())
}

/// The first in the queue of the other side.
fn first_partner(lists: &mut WaitQueues, of_sender: bool) -> Option<NonNull<WaitNode>> {
    match of_sender {
        true => lists.waiting_for::<true>().first(),
        false => lists.waiting_for::<false>().first(),
    }
}

/// Lets the guard that is ready meet its partner, and the partner go. It is over, unless the
/// process gives way. Demands that [`Looks`] have found this guard ready, and have kept its lock.
#[derive(Debug)]
pub(in crate::alternative) struct Meeting<'a, const FAIR: bool> {
    turn: PlainTurn<'a>,
    ends: Ends<FAIR>,
}

impl<const FAIR: bool> Finish for Meeting<'_, FAIR> {
    #[cfg_attr(not(debug_assertions), inline(always))]
    unsafe fn finish<G: Guard>(self, mut guard: Pin<&mut G>) -> Option<G::Output> {
        let PlainGuard {
            wait_point,
            of_sender,
            stamp,
            ..
        } = guard.plain();
        self.ends.choose(stamp);
        // The end that the guard borrows keeps the wait point.
        let wait_point = NonNull::from(wait_point);
        // SAFETY: the look has kept the lock, on this thread, and has found the partner. It is met,
        // so the guard is done.
        unsafe {
            let wait_point = wait_point.as_ref();
            let mut lists = wait_point.kept(self.turn);
            let result = match lists.waiting.one(!of_sender) {
                Some(partner) => {
                    lists.keep();
                    guard.as_mut().meet(partner);
                    part_alone(wait_point, partner, of_sender, self.turn)
                }
                None => {
                    let Some(partner) = first_partner(&mut lists, of_sender) else {
                        unreachable!("a partner has gone under the lock");
                    };
                    lists.keep();
                    guard.as_mut().meet(partner);
                    part_queued(wait_point, of_sender, self.turn)
                }
            };
            (result != FastPath::GaveWay).then(|| guard.output_when_done())
        }
    }
}

/// Releases the locks that [`Looks`] have kept, but for one.
#[derive(Debug)]
pub(in crate::alternative) struct Leaving<'a> {
    turn: PlainTurn<'a>,
    locked: u32,
}

impl Visit for Leaving<'_> {
    #[inline(always)]
    fn visit<G: Guard>(&mut self, number: u32, guard: Pin<&mut G>) -> bool {
        if self.locked & (1 << number) != 0 {
            // SAFETY: the look has kept the lock, on this thread.
            drop(unsafe { guard.plain().wait_point.kept(self.turn) });
        }
        true
    }
}
