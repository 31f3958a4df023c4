//! The decision: under the locks of all wait points, taken in the order of their addresses.
//!
//! All locks are held, so readiness is seen at one instant. The first ready guard in the order of
//! preference is therefore the right one, also across cores: no other thread can make a higher
//! guard ready between the look and the choice. No thread waits for a lock against the order while
//! it holds another, so there is no deadlock. There is no retry.
//!
//! A registered alternative starts to wait under its own lock, and is the only partner that does. A
//! send that finds none waiting reports to those of its channel before the next guard is looked at.
//! They then look at the channel before they wait, and for that they need its lock.

use super::guard::Attempt;
use super::list::{MAX_GUARDS, Open};
use crate::select_state::SelectState;
use crate::wait_point::{WaitPoint, WaitQueues};
use arrayvec::ArrayVec;
use core::ptr::NonNull;
use core::task::Context;
use luna_core::biased_lock::BiasedGuard;
use luna_core::current::{PendingWake, WakeHandle};
use luna_platform::clock::Instant;

/// The locks of an alternative's wait points.
pub(super) struct Locks<'a>(
    ArrayVec<(NonNull<WaitPoint>, BiasedGuard<'a, WaitQueues>), MAX_GUARDS>,
);

impl Locks<'_> {
    /// Locks all wait points of `open`, each once. O(n) locks.
    pub(super) fn take(open: &Open<'_>) -> Self {
        let mut wait_points: ArrayVec<NonNull<WaitPoint>, MAX_GUARDS> = open
            .iter()
            .filter_map(|(_, guard)| guard.terms().wait_point)
            .collect();
        wait_points.sort_unstable_by_key(|&wait_point| order(wait_point));
        let mut locks = ArrayVec::new();
        for wait_point in wait_points {
            if locks.last().is_none_or(|&(last, _)| last != wait_point) {
                // SAFETY: a wait point outlives its guards, and these locks do not outlive the poll
                // of the alternative that borrows them.
                locks.push((wait_point, unsafe { wait_point.as_ref() }.lock_lists()));
            }
        }
        Locks(locks)
    }

    fn lists(&mut self, wait_point: Option<NonNull<WaitPoint>>) -> Option<&mut WaitQueues> {
        let wait_point = wait_point?;
        let index = self
            .0
            .binary_search_by_key(&order(wait_point), |lock| order(lock.0))
            .ok()?;
        Some(&mut self.0[index].1)
    }
}

/// Key of the lock order.
#[cfg(not(loom))]
fn order(wait_point: NonNull<WaitPoint>) -> NonNull<WaitPoint> {
    wait_point
}

/// In a model by age, not by address: loom repeats a run from the middle, and addresses differ from
/// run to run.
#[cfg(loom)]
fn order(wait_point: NonNull<WaitPoint>) -> u64 {
    // SAFETY: a wait point outlives its guards.
    unsafe { wait_point.as_ref() }.identity.id()
}

/// Result of the first look at the guards.
pub(super) enum Choice {
    /// Guard number `.0` has happened. Wake the process of the `PendingWake` now that the locks are
    /// released.
    Made(u32, PendingWake),
    /// None can happen now; they are not listed.
    None,
    /// None could happen; all are listed.
    Listed,
}

/// Chooses the first ready guard by preference; with none, lists all of them in `select_state` with
/// the `wake_handle`. Without a `wake_handle` the alternative does not wait.
///
/// # Safety
///
/// All guards are new. The select state is closed, stays where it is, and outlives their being
/// listed.
pub(super) unsafe fn choose(
    open: &mut Open<'_>,
    select_state: &SelectState,
    fair: bool,
    wake_handle: &mut Option<WakeHandle>,
    cx: &mut Context<'_>,
) -> Choice {
    let mut locks = Locks::take(open);
    let mut preference: ArrayVec<usize, MAX_GUARDS> = (0..open.len()).collect();
    if fair {
        // Unlike the stable sort, this one never allocates.
        preference.sort_unstable_by_key(|&index| (stamp(open, index), index));
    }
    for &index in &preference {
        let (number, guard) = &mut open[index];
        let lists = locks.lists(guard.terms().wait_point);
        // SAFETY: the lists are those of the guard's wait point. The guard is new, as is demanded
        // here, since none before it has happened.
        if let Attempt::Ready(ready) = unsafe { guard.as_mut().attempt(lists, cx) } {
            return Choice::Made(*number, ready);
        }
    }
    let Some(wake_handle) = wake_handle.take() else {
        return Choice::None;
    };
    let several = open.iter().any(|(_, guard)| guard.terms().commits_several);
    // SAFETY: the select state is closed, and this runs for its owner: `choose` demands a closed
    // one, of which no node is listed.
    unsafe { select_state.open(wake_handle, several, limit(open, fair)) };
    // In this order too: a partner finds the preferred one of two guards of one channel.
    for index in preference {
        let (number, guard) = &mut open[index];
        if let Some(lists) = locks.lists(guard.terms().wait_point) {
            // SAFETY: the lists are those of the guard's wait point. The guard is new, since it was
            // not ready, and the select state outlives its being listed, as is demanded here.
            unsafe {
                guard
                    .as_mut()
                    .list(lists, NonNull::from(select_state), *number)
            };
        }
    }
    Choice::Listed
}

/// The instant from which on guards are too late, and the first of those guards: a delay that is
/// preferred to them has passed then, and the earliest delay counts. Without this, a partner that
/// comes after the instant and before the owner has woken would find a guard that must not be
/// chosen any more.
fn limit(open: &Open<'_>, fair: bool) -> Option<(Instant, u32)> {
    let delays = open
        .iter()
        .filter_map(|(number, guard)| Some((guard.terms().deadline?, *number)));
    // A fair alternative prefers a delay to all else: it was never chosen.
    delays
        .min()
        .map(|(instant, number)| (instant, if fair { 0 } else { number + 1 }))
}

/// Stamp of the last choice of a guard's end. A guard without memory (a time that has come) counts
/// as never chosen.
fn stamp(open: &Open<'_>, index: usize) -> u64 {
    open[index].1.terms().stamp.map_or(0, |stamp| stamp.get())
}

/// Notes that guard `number` was chosen.
pub(super) fn note_choice(open: &Open<'_>, number: u32) {
    let greatest = (0..open.len()).map(|index| stamp(open, index)).max();
    let chosen = open.iter().find(|(other, _)| *other == number);
    if let Some(stamp) = chosen.and_then(|(_, guard)| guard.terms().stamp) {
        stamp.choose(greatest.unwrap_or(0));
    }
}
