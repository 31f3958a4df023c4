//! The choice of an alternative: one protocol, under whichever locks.
//!
//! ```text
//!   owner:    look at each --one is ready--> leave the others, move the value, let the partner go
//!                 |
//!                 '--none--> open the select state, list each guard and leave its wait point
//!   partner:  finds a guard: commits its select state, moves the value, settles the guard
//!   owner:    withdraws the other guards
//! ```
//!
//! A plain guard is looked at, listed and withdrawn here, without a call, where it is alone at its
//! wait point: see [`Waiting`]. Any other step is one of its own: see [`RawGuard`].
//!
//! A registered alternative starts to wait under its own lock, and is the only partner that does. A
//! send that finds none waiting reports to those of its channel before the next guard is looked at.
//! They then look at the channel before they wait, and for that they need its lock.

mod logged;
mod polled;

use super::guard::Attempt;
#[cfg(doc)]
use super::guard::RawGuard;
use super::locks::{Locks, Own};
use super::offer::{Offer, PlainOffer};
use super::stop::Stop;
use crate::core::{FastPath, meet_alone};
use crate::finally::Finally;
use crate::in_place::InPlace;
use crate::select_state::{Limit, Owner, SelectState};
use crate::wait_point::{LastUser, WaitPoint, WaitQueues, Waiting};
use crate::waiter::{Outcome, Waiter};
use core::future::Future;
use core::marker::PhantomPinned;
use core::mem::MaybeUninit;
use core::pin::Pin;
use core::ptr::NonNull;
use core::task::{Context, Poll};
use luna_core::current::{PendingWake, PlainTurn, Turn};
use luna_platform::clock::Clock;

/// Maximum number of guards of one `alt!`. For more use an [`Alternative`](crate::Alternative),
/// which also costs less for many.
pub(super) const MAX_GUARDS: usize = 32;

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum State {
    /// Nothing has happened.
    New,
    /// The guards are listed, and the select state was opened.
    Listed,
    /// The guards are withdrawn, and the branch is about to be dropped.
    Failed,
    /// This guard was chosen; the others are withdrawn.
    Chosen(u32),
    /// Like `Chosen`, and the process lets others run before it continues.
    GaveWay(u32),
    Over,
}

/// An alternative under way: what `alt!` and `pri_alt!` await. It gives the number of the chosen
/// guard; `skip` is the one behind the last.
///
/// # Invariants
///
/// From `Listed` on, the select state is there. In `Listed` it was opened, and guards may be listed
/// and lead to it; in any other state none is. Unless it is open, it has nothing to be dropped but
/// its locks. If it `is_plain`, all guards are plain.
#[must_use = "an alternative does nothing unless awaited"]
#[repr(C)]
pub struct Choice<'b, 'a> {
    /// In the order written.
    offers: &'b mut [Offer<'a>],
    state: State,
    is_fair: bool,
    has_skip: bool,
    /// There is no `skip`, and all guards are plain.
    is_plain: bool,
    has_select_state: bool,
    /// The greatest stamp among the ends when they were looked at.
    greatest: u64,
    // What is not written at first lies behind what is.
    stop: Stop,
    select_state: MaybeUninit<SelectState>,
    _pinned: PhantomPinned,
}

// SAFETY: the offers may be sent, and the select state is shared by atomics and locks.
unsafe impl Send for Choice<'_, '_> {}
// SAFETY: `&Choice` gives access to nothing.
unsafe impl Sync for Choice<'_, '_> {}

// SAFETY: no code of this folder moves it, or its select state, behind a pin.
unsafe impl InPlace for Choice<'_, '_> {}

/// An alternative among these guards: fair, or in the order written.
#[inline(always)]
pub fn choose<'b, 'a, const N: usize>(
    offers: &'b mut [Offer<'a>; N],
    is_fair: bool,
    has_skip: bool,
) -> Choice<'b, 'a> {
    const {
        assert!(
            N <= MAX_GUARDS,
            "an alternative has at most 32 guards: use `Alternative` for more channels"
        )
    };
    let is_plain = !has_skip && offers.iter().all(|offer| offer.plain().is_some());
    Choice {
        offers,
        is_fair,
        has_skip,
        is_plain,
        has_select_state: false,
        greatest: 0,
        state: State::New,
        select_state: MaybeUninit::uninit(),
        stop: Stop::new(),
        _pinned: PhantomPinned,
    }
}

impl Future for Choice<'_, '_> {
    type Output = u32;

    #[inline(always)]
    fn poll(self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<u32> {
        let (this, turn) = (self.in_place(), Turn::of(cx));
        match turn.plain() {
            Some(plain) if this.state == State::New => this.begin_plain(plain, turn),
            Some(_) => this.finish_plain(turn),
            None => this.poll_otherwise(turn),
        }
    }
}

/// Whether nothing waits there, though something did until now.
#[cold]
#[inline(never)]
fn is_idle_without_queues(lists: &mut WaitQueues) -> bool {
    lists.leave_queues();
    lists.waiting.is_idle()
}

/// Makes these lists say all that waits there, for a guard's own step.
fn prepare(wait_point: &WaitPoint, lists: &mut WaitQueues) {
    lists.list_lone();
    wait_point.clear_slots(lists);
}

/// Takes the first guard, in the order of preference, out of a set of them.
#[inline(always)]
pub(super) fn take_preferred(offers: &[Offer<'_>], set: &mut u32, by_stamp: bool) -> Option<usize> {
    let mut preferred = (*set != 0).then(|| set.trailing_zeros() as usize)?;
    if by_stamp && set.count_ones() > 1 {
        let members = (0..offers.len()).filter(|&number| *set & (1 << number) != 0);
        preferred = members.min_by_key(|&number| offers[number].stamp())?;
    }
    *set &= !(1 << preferred);
    Some(preferred)
}

impl<'a> Choice<'_, 'a> {
    /// The prologue of [`decide`](Self::decide), in a plain turn: all guards are plain, their locks
    /// are biased to this executor, and nothing waits there but partners alone. Guards then wait
    /// alone too, and none calls anything.
    #[inline(never)]
    fn begin_plain(&mut self, plain: PlainTurn<'_>, turn: Turn<'_>) -> Poll<u32> {
        if !self.is_plain {
            return self.begin_other(plain, turn);
        }
        // The bit of the guard that is looked at, those that were entered, and that of the ready
        // one. Only one with a stamp below `least` is preferred to it.
        let (mut bit, mut entered, mut ready) = (1_u32, 0_u32, 0_u32);
        let (mut least, mut greatest) = (u64::MAX, 0);
        let mut is_other = false;
        for offer in self.plain_offers() {
            let stamp = offer.stamp.get();
            greatest = greatest.max(stamp);
            if stamp < least {
                let Some(mut lists) = offer.wait_point.enter_in(plain.here()) else {
                    is_other = true;
                    break;
                };
                entered |= bit;
                if !lists.waiting.is_idle() {
                    if lists.waiting.one(!offer.of_sender).is_some() {
                        ready = bit;
                        least = if self.is_fair { stamp } else { 0 };
                    } else {
                        is_other |= !is_idle_without_queues(&mut lists);
                    }
                }
                lists.keep();
            }
            bit <<= 1;
        }
        if is_other {
            self.leave(entered, plain);
            return self.begin_other(plain, turn);
        }
        self.greatest = greatest;
        if ready != 0 {
            self.leave(entered & !ready, plain);
            return self.meet(ready.trailing_zeros(), plain);
        }
        self.wait_alone(plain);
        Poll::Pending
    }

    /// What the guards offer, if all are plain; nothing otherwise.
    #[inline(always)]
    fn plain_offers(&self) -> impl Iterator<Item = PlainOffer<'a>> {
        let offers: &[_] = if self.is_plain { self.offers } else { &[] };
        // SAFETY: by the invariant each guard is plain.
        offers.iter().map(|offer| unsafe { offer.plain_offer() })
    }

    /// Releases the locks of these guards' wait points, which were kept.
    #[inline(always)]
    fn leave(&self, mut entered: u32, plain: PlainTurn<'_>) {
        while entered != 0 {
            let number = entered.trailing_zeros();
            entered &= entered - 1;
            if let Some(wait_point) = self.offers[number as usize].wait_point() {
                // SAFETY: this thread has kept the lock, and takes it back once.
                drop(unsafe { wait_point.kept(plain) });
            }
        }
    }

    /// Lets the guard that the prologue has found ready meet the partner that waits alone, and the
    /// partner go. Its lock was kept.
    #[inline(always)]
    fn meet(&mut self, number: u32, plain: PlainTurn<'_>) -> Poll<u32> {
        self.note_choice(number);
        self.state = State::GaveWay(number);
        // SAFETY: the prologue looks at plain guards alone. The lock was kept, and is taken back
        // once. The guard is new, and the partner is noted as alone at the other side of its wait
        // point.
        let result = unsafe {
            let offer = self.offers[number as usize].plain_offer();
            meet_alone(offer.wait_point, offer.waiter, offer.of_sender, plain)
        };
        if result == FastPath::GaveWay {
            return Poll::Pending;
        }
        self.state = State::Over;
        Poll::Ready(number)
    }

    /// Lets all guards wait alone, and releases the locks, which were kept.
    #[inline(always)]
    fn wait_alone(&mut self, plain: PlainTurn<'_>) {
        let select_state = self.open(plain, None);
        let user = LastUser::process(plain.process().id());
        let mut number = 0;
        for offer in self.plain_offers() {
            // SAFETY: this thread has kept the lock, and takes it back once. The node is new, so no
            // other thread knows it; it is withdrawn before it and the select state go.
            let mut lists = unsafe {
                let lists = offer.wait_point.kept(plain);
                Waiter::begin_guard_alone(offer.waiter, select_state, number);
                lists
            };
            lists.note_user(offer.of_sender, user);
            lists.waiting = Waiting::alone_guard(offer.waiter.cast(), offer.of_sender);
            number += 1;
        }
    }

    /// Opens the select state, before another thread can find a node that leads to it.
    #[inline(always)]
    fn open(&mut self, owner: impl Owner, limit: Option<Limit>) -> NonNull<SelectState> {
        self.select_state.write(owner.open(limit));
        self.has_select_state = true;
        self.state = State::Listed;
        NonNull::from(&mut self.select_state).cast()
    }

    /// Begins in a plain turn, whatever is offered and waits.
    #[inline(never)]
    fn begin_other(&mut self, plain: PlainTurn<'_>, turn: Turn<'_>) -> Poll<u32> {
        // The locks are left before anything else is tried.
        let decided = self.decide(&mut Own::of(plain), plain, turn);
        decided.unwrap_or_else(|| self.poll_otherwise(turn))
    }

    /// Polls one in a plain turn that is not new.
    #[inline(never)]
    fn finish_plain(&mut self, turn: Turn<'_>) -> Poll<u32> {
        let Some(number) = self.is_met() else {
            return self.poll_otherwise(turn);
        };
        self.note_choice(number);
        self.withdraw_but(number as usize, turn);
        self.state = State::Over;
        Poll::Ready(number)
    }

    /// The guard that a partner has chosen, if it is plain and done.
    #[inline(always)]
    fn is_met(&self) -> Option<u32> {
        if self.state != State::Listed {
            return None;
        }
        // SAFETY: in `Listed` it is there.
        let number = unsafe { self.select_state.assume_init_ref() }.chosen()?;
        let waiter = self.offers.get(number as usize)?.plain()?;
        // SAFETY: the node was begun when it was listed.
        (unsafe { Waiter::outcome(waiter) } == Outcome::Done).then_some(number)
    }

    /// Decides under the locks: makes the first ready guard by preference happen; with none, lists
    /// all of them. `None`: not possible with these locks, and nothing has happened.
    fn decide<'l, L: Locks<'l>>(
        &mut self,
        locks: &mut L,
        owner: impl Owner,
        turn: Turn<'_>,
    ) -> Option<Poll<u32>>
    where
        'a: 'l,
    {
        let (mut candidates, user) = (0, LastUser::of(turn.here().user()));
        self.greatest = 0;
        for (number, offer) in self.offers.iter().enumerate() {
            if self.is_fair {
                self.greatest = self.greatest.max(offer.stamp());
            }
            let may_be_ready = match offer.wait_point() {
                Some(wait_point) => locks.reach(wait_point, |lists| {
                    lists.leave_queues();
                    let is_tried = offer.plain().is_none() || !lists.waiting.is_idle();
                    if !is_tried {
                        lists.note_user(offer.of_sender(), user);
                    }
                    is_tried
                })?,
                None => {
                    locks.pass_over();
                    offer.is_open()
                }
            };
            candidates |= u32::from(may_be_ready) << number;
        }
        while let Some(number) = take_preferred(self.offers, &mut candidates, self.is_fair) {
            let offer = &mut self.offers[number];
            if let Attempt::Ready(ready) = attempt(offer, number, locks, turn) {
                return Some(self.made(number, ready, locks, turn));
            }
        }
        if self.has_skip {
            return Some(self.made(self.offers.len(), PendingWake::NONE, locks, turn));
        }
        let select_state = self.open(owner, self.limit());
        locks.for_each(
            self.offers,
            self.is_fair,
            |number, offer, wait_point, lists| {
                prepare(wait_point, lists);
                if let Some(guard) = offer.guard_mut() {
                    // SAFETY: the lists are those of the guard's wait point. The guard is new,
                    // since it was not ready, and is withdrawn before the select state goes.
                    unsafe { guard.list(lists, select_state, number as u32) };
                }
            },
        );
        locks.leave();
        self.release(0);
        Some(self.poll_listed(turn))
    }

    /// The guard of this number has happened, or `skip` has: releases the locks, and wakes the
    /// partner.
    #[inline(never)]
    fn made<'l, L: Locks<'l>>(
        &mut self,
        number: usize,
        ready: PendingWake,
        locks: &mut L,
        turn: Turn<'_>,
    ) -> Poll<u32> {
        let number = number as u32;
        // Before a foreign waker can panic.
        self.state = State::Chosen(number);
        locks.leave();
        self.note_choice(number);
        let released = Finally::new(|| self.release(0));
        ready.wake();
        drop(released);
        if turn.yields_after_operation() {
            self.state = State::GaveWay(number);
            return Poll::Pending;
        }
        self.poll_chosen(number, turn)
    }

    /// The instant from which on guards are too late, and the first of those guards: a delay that
    /// is preferred to them has passed then, and the earliest delay counts. Without this, a partner
    /// that comes after the instant and before the owner has woken would find a guard that must not
    /// be chosen any more.
    #[cold]
    fn limit(&self) -> Option<Limit> {
        let delays = self.offers.iter().enumerate();
        let delays = delays.filter_map(|(number, offer)| {
            // Only guards of time have a deadline.
            Some((offer.guard()?.deadline()?, number as u32))
        });
        // A fair alternative prefers a delay to all else: it was never chosen.
        delays.min().map(|(instant, number)| Limit {
            instant,
            first_late: if self.is_fair { 0 } else { number + 1 },
            clock: Clock::number_here(),
        })
    }

    /// Gives the end of the chosen guard its new stamp.
    #[inline(always)]
    fn note_choice(&self, number: u32) {
        if self.is_fair
            && let Some(chosen) = self.offers.get(number as usize)
        {
            chosen.choose(self.greatest);
        }
    }

    /// Tells the guards from this one on that the locks of their wait points were released.
    #[cold]
    #[inline(never)]
    fn release(&self, from: usize) {
        if let Some(offer) = self.offers.get(from) {
            // A wake may panic: the remaining wakes must still be done.
            let _others = Finally::new(|| self.release(from + 1));
            if let Some(guard) = offer.guard() {
                guard.released();
            }
        }
    }

    /// Takes all listed guards but one off their lists. O(n).
    #[inline(always)]
    fn withdraw_but(&mut self, chosen: usize, turn: Turn<'_>) {
        for (number, offer) in self.offers.iter_mut().enumerate() {
            if number == chosen {
                continue;
            }
            if !self.is_plain {
                offer.withdraw(turn.here());
                continue;
            }
            // SAFETY: all guards were listed, and by the invariant all are plain.
            if !unsafe { offer.plain_offer().withdraw(turn.here()) } {
                offer.withdraw_listed();
            }
        }
    }
}

/// Makes a guard happen by its own step, if possible.
#[inline(never)]
fn attempt<'l, 'a: 'l, L: Locks<'l>>(
    offer: &mut Offer<'a>,
    number: usize,
    locks: &mut L,
    turn: Turn<'_>,
) -> Attempt {
    let wait_point = offer.wait_point();
    let lists = wait_point.and_then(|wait_point| {
        let lists = locks.lists(number, wait_point)?;
        prepare(wait_point, lists);
        Some(lists)
    });
    match offer.guard_mut() {
        // SAFETY: the lists are those of the guard's wait point. The guard is new, since none has
        // happened.
        Some(guard) => unsafe { guard.attempt(lists, &mut turn.context()) },
        None => Attempt::NotReady,
    }
}

impl Drop for Choice<'_, '_> {
    #[inline(always)]
    fn drop(&mut self) {
        if self.state != State::Over {
            self.drop_unfinished();
        }
        if SelectState::HAS_DROP && self.has_select_state {
            // SAFETY: it is there, and no node leads to it any more.
            unsafe { self.select_state.assume_init_drop() };
        }
    }
}

luna_platform::debug_fields!(
    Choice<'_, '_>, |choice|
    is_fair: choice.is_fair,
    state: choice.state
);
