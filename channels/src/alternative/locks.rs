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

use super::choice::{MAX_GUARDS, take_preferred};
use super::offer::Offer;
use crate::wait_point::{WaitPoint, WaitQueues};
use arrayvec::ArrayVec;
use core::ptr;
use luna_core::biased_lock::{BiasedGuard, InsideGuard};
use luna_core::current::PlainTurn;

/// The locks, in whichever way they are held. The guards are gone through once, in the order
/// written; then a guard's lists are asked for by its number and its wait point.
pub(super) trait Locks<'l> {
    /// Goes to the next guard, and looks at the lists of its wait point. `None`: its lock cannot be
    /// taken in this way.
    fn reach<R>(
        &mut self,
        wait_point: &'l WaitPoint,
        look: impl FnOnce(&mut WaitQueues) -> R,
    ) -> Option<R>;

    /// Goes to the next guard, which is not looked at.
    fn pass_over(&mut self);

    /// The lists of a guard that was looked at.
    fn lists(&mut self, number: usize, wait_point: &'l WaitPoint) -> Option<&mut WaitQueues>;

    /// Calls `f` for each guard that was looked at: in the order written, or by its stamp where
    /// `is_fair` and two may have the same lists.
    fn for_each<'a: 'l>(
        &mut self,
        offers: &mut [Offer<'a>],
        is_fair: bool,
        f: impl FnMut(usize, &mut Offer<'a>, &'l WaitPoint, &mut WaitQueues),
    );

    /// Releases all locks.
    fn leave(&mut self);
}

/// Locks that are biased to the executor of a plain turn.
pub(super) struct Own<'a> {
    turn: PlainTurn<'a>,
    guards: ArrayVec<Option<InsideGuard<'a, WaitQueues>>, MAX_GUARDS>,
}

impl<'a> Own<'a> {
    pub(super) fn of(turn: PlainTurn<'a>) -> Self {
        Self {
            turn,
            guards: ArrayVec::new(),
        }
    }
}

impl<'l> Locks<'l> for Own<'l> {
    fn reach<R>(
        &mut self,
        wait_point: &'l WaitPoint,
        look: impl FnOnce(&mut WaitQueues) -> R,
    ) -> Option<R> {
        let mut lists = wait_point.enter_in(self.turn.here())?;
        let looked = look(&mut lists);
        self.guards.push(Some(lists));
        Some(looked)
    }

    fn pass_over(&mut self) {
        self.guards.push(None);
    }

    fn lists(&mut self, number: usize, _: &'l WaitPoint) -> Option<&mut WaitQueues> {
        self.guards.get_mut(number)?.as_deref_mut()
    }

    fn for_each<'a: 'l>(
        &mut self,
        offers: &mut [Offer<'a>],
        _: bool,
        mut f: impl FnMut(usize, &mut Offer<'a>, &'l WaitPoint, &mut WaitQueues),
    ) {
        let guards = self.guards.drain(..).zip(offers).enumerate();
        for (number, (lists, offer)) in guards {
            if let Some(mut lists) = lists
                && let Some(wait_point) = offer.wait_point()
            {
                f(number, offer, wait_point, &mut lists);
            }
        }
    }

    fn leave(&mut self) {
        self.guards.clear();
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

impl<'l> Locks<'l> for InOrder<'l> {
    fn reach<R>(
        &mut self,
        wait_point: &'l WaitPoint,
        look: impl FnOnce(&mut WaitQueues) -> R,
    ) -> Option<R> {
        self.lists(0, wait_point).map(look)
    }

    fn pass_over(&mut self) {}

    fn lists(&mut self, _: usize, wait_point: &'l WaitPoint) -> Option<&mut WaitQueues> {
        let key = order(wait_point);
        let index = self
            .0
            .binary_search_by_key(&key, |lock| order(lock.0))
            .ok()?;
        Some(&mut self.0[index].1)
    }

    fn for_each<'a: 'l>(
        &mut self,
        offers: &mut [Offer<'a>],
        is_fair: bool,
        mut f: impl FnMut(usize, &mut Offer<'a>, &'l WaitPoint, &mut WaitQueues),
    ) {
        let mut left = ((1_u64 << offers.len()) - 1) as u32;
        while let Some(number) = take_preferred(offers, &mut left, is_fair) {
            let offer = &mut offers[number];
            if let Some(wait_point) = offer.wait_point()
                && let Some(lists) = self.lists(number, wait_point)
            {
                f(number, offer, wait_point, lists);
            }
        }
    }

    fn leave(&mut self) {
        self.0.clear();
    }
}
