//! An alternative under the locks of its wait points, whatever its guards are.

use super::{Identity, State, identity};
use crate::alternative::choose::{Choice, Locks, choose, note_choice};
use crate::alternative::guard::RawGuard;
use crate::alternative::list::Open;
use crate::finally::Finally;
use crate::replay::{self, Logged, Stage};
use crate::select_state::SelectState;
use core::pin::Pin;
use core::ptr::NonNull;
use core::task::{Context, Poll};
use luna_core::current::{self, WakeHandle};
use luna_core::replay_log::{Event, Turn, What};

/// The locks of these guards' wait points were released.
pub(super) fn released(open: &[(u32, Pin<&mut (dyn RawGuard + '_)>)]) {
    if let Some(((_, first), others)) = open.split_first() {
        // A wake may panic: the remaining wakes must still be done.
        let _others = Finally::new(|| released(others));
        first.released();
    }
}

/// One poll of an alternative, whatever the types of its guards.
pub(super) struct Polled<'a> {
    pub(super) open: Open<'a>,
    /// Of the alternative around it; there if `has_select_state`.
    pub(super) select_state: NonNull<SelectState>,
    pub(super) has_select_state: &'a mut bool,
    pub(super) fair: bool,
    pub(super) state: &'a mut State,
    pub(super) polled_by: &'a mut Identity,
    /// The number of `skip`, if it stands.
    pub(super) skip: Option<u32>,
}

impl<'a> Polled<'a> {
    /// Which guard has happened and is over.
    pub(super) fn poll(&mut self, cx: &mut Context<'_>) -> Poll<u32> {
        let skip = self.skip;
        match *self.state {
            State::New => {
                if current::branch_failed() {
                    if let Some(number) = self.fail() {
                        if crate::fails_later(cx) {
                            *self.state = State::GaveWay(number);
                            return Poll::Pending;
                        }
                        return Poll::Ready(number);
                    }
                    if skip.is_none() && self.is_stuck() {
                        current::end_branch(cx);
                        return Poll::Pending;
                    }
                }
                match self.first_look(skip, cx) {
                    Poll::Ready(Some(number)) => {
                        *self.state = State::Chosen(number);
                        if crate::yield_after_operation(cx) {
                            *self.state = State::GaveWay(number);
                            return Poll::Pending;
                        }
                        self.poll_chosen(number, cx)
                    }
                    Poll::Ready(None) => self.poll_listed(cx),
                    Poll::Pending => Poll::Pending,
                }
            }
            State::Listed | State::Failed => self.poll_listed(cx),
            State::Chosen(number) | State::GaveWay(number) => {
                *self.state = State::Chosen(number);
                self.poll_chosen(number, cx)
            }
            State::Seeds | State::Over => panic!("an alternative was polled after it was over"),
        }
    }

    /// Looks at the guards for the first time: which has happened, or none, and all are listed.
    pub(super) fn first_look(
        &mut self,
        skip: Option<u32>,
        cx: &mut Context<'_>,
    ) -> Poll<Option<u32>> {
        // Made before the locks are taken; dropped last, if a guard is chosen.
        let mut wake_handle = skip.is_none().then(|| WakeHandle::of(cx));
        // SAFETY: it is room for one in the alternative.
        unsafe { self.select_state.write(SelectState::new()) };
        *self.has_select_state = true;
        // SAFETY: in `New` nothing is listed and the select state is closed; it is pinned, and
        // outlives its guards.
        let choice = unsafe {
            choose(
                &mut self.open,
                self.select_state.as_ref(),
                self.fair,
                &mut wake_handle,
                cx,
            )
        };
        match (choice, skip) {
            (Choice::Made(number, ready), _) => {
                // Before a foreign waker can panic.
                *self.state = State::Chosen(number);
                self.note(number);
                let _released = Finally::new(|| released(&self.open));
                ready.wake();
                Poll::Ready(Some(number))
            }
            (Choice::None, Some(skip)) => {
                released(&self.open);
                Poll::Ready(Some(skip))
            }
            (Choice::None | Choice::Listed, _) => {
                *self.state = State::Listed;
                *self.polled_by = identity(cx);
                released(&self.open);
                Poll::Ready(None)
            }
        }
    }

    /// The select state of one that was listed.
    pub(super) fn select_state(&self) -> &'a SelectState {
        debug_assert!(*self.has_select_state);
        // SAFETY: it is there, and pinned with the alternative.
        unsafe { self.select_state.as_ref() }
    }

    pub(super) fn poll_listed(&mut self, cx: &mut Context<'_>) -> Poll<u32> {
        let mut _former = None;
        if current::branch_failed() && (self.can_fail() || self.is_stuck()) {
            // A partner that was faster has communicated: that stays so.
            let closed = self.select_state().close();
            if closed.is_some() || *self.state == State::Failed {
                *self.state = State::Failed;
                self.withdraw_but(None);
                if let Some(number) = self.fail() {
                    return Poll::Ready(number);
                }
                current::end_branch(cx);
                return Poll::Pending;
            }
        }
        let select_state = self.select_state();
        if select_state.chosen().is_none() {
            for (number, guard) in self.open.iter_mut() {
                if guard.terms().wait_point.is_none()
                    // SAFETY: this is the guard's alternative.
                    && unsafe { guard.as_mut().poll_time(cx) }.is_ready()
                {
                    // Committed here, by a partner or by this commit; this process need not be
                    // woken.
                    _former = select_state.commit_own(*number);
                    break;
                }
            }
        }
        if self.select_state().chosen().is_none() && *self.polled_by != identity(cx) {
            self.rewake(cx);
        }
        match self.select_state().chosen() {
            None => Poll::Pending,
            Some(number) => {
                self.withdraw_but(Some(number));
                self.note(number);
                *self.state = State::Chosen(number);
                self.poll_chosen(number, cx)
            }
        }
    }

    /// Replaces the wake handle by that of the current poll. Rare: only combinators with wakers of
    /// their own come here. O(n) locks.
    #[cold]
    pub(super) fn rewake(&mut self, cx: &mut Context<'_>) {
        let wake_handle = WakeHandle::of(cx);
        let _former;
        let _locks = Locks::take(&self.open);
        if self.select_state().chosen().is_some() {
            return;
        }
        // SAFETY: with all locks held no thread can commit the select state.
        _former = unsafe { self.select_state().replace_wake_handle(wake_handle) };
        *self.polled_by = identity(cx);
    }

    /// Takes all guards but one off their lists. O(n).
    pub(super) fn withdraw_but(&mut self, chosen: Option<u32>) {
        for (number, guard) in self.open.iter_mut() {
            if Some(*number) != chosen {
                // SAFETY: this is the guard's alternative.
                unsafe { guard.as_mut().withdraw() };
            }
        }
    }

    pub(super) fn poll_chosen(&mut self, number: u32, cx: &mut Context<'_>) -> Poll<u32> {
        match self.open.iter_mut().find(|(other, _)| *other == number) {
            // SAFETY: this is the guard's alternative, which has chosen it.
            Some((_, guard)) => unsafe { guard.as_mut().poll_chosen(cx) }.map(|()| number),
            // `skip`.
            None => Poll::Ready(number),
        }
    }

    pub(super) fn can_fail(&self) -> bool {
        self.open.iter().any(|(_, guard)| guard.terms().can_fail)
    }

    /// Whether it waits for a partner, or for nothing at all, and has no error to return if the
    /// partner never comes.
    pub(super) fn is_stuck(&self) -> bool {
        !self.can_fail()
            && (self.open.is_empty()
                || self
                    .open
                    .iter()
                    .any(|(_, guard)| guard.terms().wait_point.is_some()))
    }

    /// A sibling in a parallel construct has failed: the first guard that can fail does, as
    /// poisoned. None is listed.
    pub(super) fn fail(&mut self) -> Option<u32> {
        let number = self.open.iter_mut().find_map(|(number, guard)| {
            // SAFETY: this is the guard's alternative, and none of its guards is listed.
            unsafe { guard.as_mut().fail() }.then_some(*number)
        })?;
        current::stay_in_branch();
        *self.state = State::Chosen(number);
        Some(number)
    }

    pub(super) fn note(&self, number: u32) {
        if self.fair {
            note_choice(&self.open, number);
        }
    }
}

/// A replayed one looks at the recorded guard alone, in each poll.
impl Logged for Polled<'_> {
    type Output = u32;

    const KEEPS: bool = true;

    fn stage(&self) -> Stage {
        match *self.state {
            State::New | State::Listed => Stage::New,
            State::Chosen(_) | State::GaveWay(_) => Stage::GaveWay,
            State::Seeds | State::Failed | State::Over => Stage::Over,
        }
    }

    fn come(&mut self, turn: Turn, _: &mut Context<'_>) -> Poll<()> {
        let is_new = *self.state == State::New;
        match turn {
            Turn::Look => return replay::differs("an alternative chooses"),
            Turn::Given(event) if event.what == What::Chosen => {
                let choice = u32::try_from(event.number).unwrap_or(u32::MAX);
                self.open.retain(|(number, _)| *number == choice);
                match self.open.first().map(|(_, guard)| guard.terms().wait_point) {
                    // The time had come, or none was ready: there is no partner to wait for.
                    Some(None) => *self.state = State::Chosen(choice),
                    None if self.skip == Some(choice) => *self.state = State::Chosen(choice),
                    None => return replay::differs("an alternative has no such guard"),
                    Some(Some(_)) => self.skip = None,
                }
            }
            _ => {}
        }
        if is_new {
            self.open.iter().for_each(|(_, guard)| guard.note_logged());
        }
        Poll::Ready(())
    }

    fn poll_unlogged(&mut self, cx: &mut Context<'_>) -> Poll<u32> {
        self.poll(cx)
    }

    unsafe fn success(&self, output: Option<&u32>, own: u64) -> Event {
        let chosen = match (output, *self.state) {
            (Some(number), _) => *number,
            (None, State::Chosen(number) | State::GaveWay(number)) => number,
            (None, _) => unreachable!("no guard was chosen"),
        };
        let guard = self.open.iter().find(|(number, _)| *number == chosen);
        let of_partner = guard.map_or(0, |(_, guard)| guard.order());
        let stamp = replay::stamp(of_partner, own);
        Event::new(What::Chosen, u64::from(chosen), stamp)
    }

    fn keep(&mut self, number: u32) {
        *self.state = State::GaveWay(number);
    }
}
