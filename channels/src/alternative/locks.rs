//! The locks of an alternative's wait points: all are held while it is decided.
//!
//! All locks are held, so readiness is seen at one instant. The first ready guard in the order of
//! preference is therefore the right one, also across cores: no other thread can make a higher
//! guard ready between the look and the choice. There is no retry.
//!
//! Locks that are biased to this executor are taken by plain stores and in no particular order: a
//! thread that wants a lock which this thread is inside waits until it is left, and this thread
//! waits for no other in between. If one of them is not, all are taken in the order of their
//! addresses. No thread waits for a lock against that order while it holds another, so there is no
//! deadlock.

use super::choice::MAX_GUARDS;
use super::offer::Offer;
use crate::wait_point::{WaitPoint, WaitQueues};
use arrayvec::ArrayVec;
use core::ops::DerefMut;
use core::ptr;
use luna_core::biased_lock::{BiasedGuard, InsideGuard};
use luna_core::current::PlainTurn;

/// The locks, in whichever way they are held. A guard's lists are asked for by the guard's number
/// and its wait point.
pub(super) trait Locks<'a> {
    /// Whether each guard has a lock of its own, which this executor holds by its bias.
    const OWN: bool;

    /// The lists of one guard, which are held as long as this.
    type Held<'x>: DerefMut<Target = WaitQueues>
    where
        Self: 'x;

    /// Takes the lock of the next guard, if it has one. `false`: not possible in this way.
    fn reach(&mut self, wait_point: Option<&'a WaitPoint>) -> bool;

    /// The lists of a guard that was reached.
    fn lists(&mut self, number: usize, wait_point: &'a WaitPoint) -> Option<&mut WaitQueues>;

    /// The lists of a guard that was reached, for the last time.
    fn hold(&mut self, number: usize, wait_point: &'a WaitPoint) -> Option<Self::Held<'_>>;

    /// As [`hold`](Self::hold), by the bias to the executor of this turn.
    fn own(&mut self, number: usize) -> Option<(InsideGuard<'a, WaitQueues>, PlainTurn<'a>)>;
}

/// Locks that are biased to the executor of a plain turn.
pub(super) struct Own<'a> {
    turn: PlainTurn<'a>,
    guards: ArrayVec<Option<InsideGuard<'a, WaitQueues>>, MAX_GUARDS>,
}

impl<'a> Own<'a> {
    #[inline(always)]
    pub(super) fn of(turn: PlainTurn<'a>) -> Self {
        Self {
            turn,
            guards: ArrayVec::new(),
        }
    }
}

impl<'a> Locks<'a> for Own<'a> {
    const OWN: bool = true;

    type Held<'x>
        = InsideGuard<'a, WaitQueues>
    where
        Self: 'x;

    #[inline(always)]
    fn reach(&mut self, wait_point: Option<&'a WaitPoint>) -> bool {
        let guard = match wait_point {
            Some(wait_point) => match wait_point.enter_in(self.turn.here()) {
                None => return false,
                entered => entered,
            },
            None => None,
        };
        self.guards.push(guard);
        true
    }

    #[inline(always)]
    fn lists(&mut self, number: usize, _: &'a WaitPoint) -> Option<&mut WaitQueues> {
        self.guards.get_mut(number)?.as_deref_mut()
    }

    #[inline(always)]
    fn hold(&mut self, number: usize, _: &'a WaitPoint) -> Option<InsideGuard<'a, WaitQueues>> {
        self.guards.get_mut(number)?.take()
    }

    #[inline(always)]
    fn own(&mut self, number: usize) -> Option<(InsideGuard<'a, WaitQueues>, PlainTurn<'a>)> {
        Some((self.guards.get_mut(number)?.take()?, self.turn))
    }
}

/// Locks in the order of their addresses, each once.
pub(super) struct InOrder<'a>(ArrayVec<(&'a WaitPoint, BiasedGuard<'a, WaitQueues>), MAX_GUARDS>);

impl<'a> InOrder<'a> {
    /// Takes the locks of all guards. O(n) locks, O(n log n) steps.
    pub(super) fn of(offers: &[Offer<'a>]) -> Self {
        let mut wait_points: ArrayVec<&WaitPoint, MAX_GUARDS> =
            offers.iter().filter_map(Offer::wait_point).collect();
        wait_points.sort_unstable_by_key(|&wait_point| order(wait_point));
        let mut locks: ArrayVec<(&WaitPoint, _), MAX_GUARDS> = ArrayVec::new();
        for wait_point in wait_points {
            if locks
                .last()
                .is_none_or(|&(last, _)| !ptr::eq(last, wait_point))
            {
                locks.push((wait_point, wait_point.lock_lists()));
            }
        }
        Self(locks)
    }
}

/// Key of the lock order.
#[cfg(not(loom))]
fn order(wait_point: &WaitPoint) -> *const WaitPoint {
    wait_point
}

/// In a model by age, not by address: loom repeats a run from the middle, and addresses differ from
/// run to run.
#[cfg(loom)]
fn order(wait_point: &WaitPoint) -> u64 {
    wait_point.identity.id()
}

impl<'a> Locks<'a> for InOrder<'a> {
    const OWN: bool = false;

    type Held<'x>
        = &'x mut WaitQueues
    where
        Self: 'x;

    fn reach(&mut self, _: Option<&'a WaitPoint>) -> bool {
        true
    }

    fn lists(&mut self, _: usize, wait_point: &'a WaitPoint) -> Option<&mut WaitQueues> {
        let key = order(wait_point);
        let index = self
            .0
            .binary_search_by_key(&key, |lock| order(lock.0))
            .ok()?;
        Some(&mut self.0[index].1)
    }

    fn hold(&mut self, number: usize, wait_point: &'a WaitPoint) -> Option<&mut WaitQueues> {
        self.lists(number, wait_point)
    }

    fn own(&mut self, _: usize) -> Option<(InsideGuard<'a, WaitQueues>, PlainTurn<'a>)> {
        None
    }
}
