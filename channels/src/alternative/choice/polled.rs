//! Polls in a turn that is not plain, or with locks of others, or of an alternative that something
//! else has happened to.

use super::{Choice, State};
use crate::alternative::locks::InOrder;
use crate::alternative::offer::Offer;
use crate::replay;
use crate::select_state::SelectState;
use core::task::Poll;
use luna_core::current::{self, Turn};
use luna_core::events;

impl<'a> Choice<'_, 'a> {
    /// Polls wherever the process is, and whatever is offered.
    #[cold]
    #[inline(never)]
    pub(super) fn poll_otherwise(&mut self, turn: Turn<'_>) -> Poll<u32> {
        if self.state != State::Over && !self.has_skip && !self.offers.iter().any(Offer::is_open) {
            // SAFETY: the alternative is pinned.
            unsafe { self.stop.list() };
        }
        let polled = match replay::is_on() {
            true => replay::poll(self, &mut turn.context()),
            false => self.poll_in(turn),
        };
        match polled {
            Poll::Pending => events::waits_for_several(),
            Poll::Ready(number) => {
                self.state = State::Over;
                if events::is_on() {
                    self.report(number);
                }
            }
        }
        polled
    }

    /// Which guard has happened and is over.
    pub(super) fn poll_in(&mut self, turn: Turn<'_>) -> Poll<u32> {
        match self.state {
            State::New => {
                if turn.branch_failed() {
                    if let Some(number) = self.fail() {
                        if crate::fails_later(&turn.context()) {
                            self.state = State::GaveWay(number);
                            return Poll::Pending;
                        }
                        return Poll::Ready(number);
                    }
                    if !self.has_skip && self.is_stuck() {
                        current::end_branch(&turn.context());
                        return Poll::Pending;
                    }
                }
                self.begin(turn)
            }
            State::Listed | State::Failed => self.poll_listed(turn),
            State::Chosen(number) | State::GaveWay(number) => {
                self.state = State::Chosen(number);
                self.poll_chosen(number, turn)
            }
            State::Over => panic!("an alternative was polled after it was over"),
        }
    }

    fn begin(&mut self, turn: Turn<'_>) -> Poll<u32> {
        // Made before the locks are taken, and dropped after that if it is not used.
        let mut wake_handle = (!self.has_skip).then(|| turn.wake_handle());
        let owner = (turn.here(), &mut wake_handle);
        match self.decide(&mut InOrder::of(self.offers), owner, turn) {
            Some(polled) => polled,
            None => unreachable!("all locks can be taken in their order"),
        }
    }

    /// The select state of one that was listed.
    fn select_state(&self) -> &SelectState {
        debug_assert!(self.has_select_state);
        // SAFETY: it is there, and pinned with the alternative.
        unsafe { self.select_state.assume_init_ref() }
    }

    #[cold]
    #[inline(never)]
    pub(super) fn poll_listed(&mut self, turn: Turn<'_>) -> Poll<u32> {
        let mut _former = None; // Dropped last.
        self.note_begun();
        if turn.branch_failed() && (self.can_fail() || self.is_stuck()) {
            // A partner that was faster has communicated: that stays so.
            let closed = self.select_state().close();
            if closed.is_some() || self.state == State::Failed {
                self.state = State::Failed;
                self.withdraw_but(usize::MAX, turn);
                if let Some(number) = self.fail() {
                    return Poll::Ready(number);
                }
                current::end_branch(&turn.context());
                return Poll::Pending;
            }
        }
        if self.select_state().chosen().is_none()
            && let Some(number) = self.time_that_has_come(turn)
        {
            // Committed by a partner or by this; this process need not be woken.
            _former = self.select_state().commit_own(number);
        }
        if self.select_state().wakes_another(&turn.context()) {
            // Rare: only combinators with wakers of their own come here. The drop of the former
            // handle may make a guard ready.
            drop(self.select_state().replace_wake_handle(turn.wake_handle()));
        }
        match self.select_state().chosen() {
            None => Poll::Pending,
            Some(number) => {
                self.withdraw_but(number as usize, turn);
                self.note_choice(number);
                self.state = State::Chosen(number);
                self.poll_chosen(number, turn)
            }
        }
    }

    fn time_that_has_come(&mut self, turn: Turn<'_>) -> Option<u32> {
        for (number, offer) in self.offers.iter_mut().enumerate() {
            if offer.is_of_time()
                && let Some(guard) = offer.guard_mut()
                // SAFETY: this is the guard's alternative.
                && unsafe { guard.poll_time(&mut turn.context()) }.is_ready()
            {
                return Some(number as u32);
            }
        }
        None
    }

    pub(super) fn poll_chosen(&mut self, number: u32, turn: Turn<'_>) -> Poll<u32> {
        let offer = self.offers.get_mut(number as usize);
        let polled = match offer.and_then(Offer::guard_mut) {
            // SAFETY: this is the guard's alternative, which has chosen it.
            Some(guard) => unsafe { guard.poll_chosen(&mut turn.context()) },
            // `skip`.
            None => Poll::Ready(()),
        };
        polled.map(|()| {
            self.state = State::Over;
            number
        })
    }

    /// Plain guards learn that their nodes were begun: from here on they withdraw themselves, and
    /// handle their results.
    fn note_begun(&mut self) {
        let guards = self
            .offers
            .iter_mut()
            .filter(|offer| offer.plain().is_some());
        guards
            .filter_map(Offer::guard_mut)
            .for_each(|guard| guard.note_begun());
    }

    fn can_fail(&self) -> bool {
        self.offers.iter().any(Offer::can_fail)
    }

    /// Whether it waits for a partner, or for nothing at all, and has no error to return if the
    /// partner never comes.
    fn is_stuck(&self) -> bool {
        let mut open = self
            .offers
            .iter()
            .filter(|offer| offer.is_open())
            .peekable();
        !self.can_fail()
            && (open.peek().is_none() || open.any(|offer| offer.wait_point().is_some()))
    }

    /// A sibling in a parallel construct has failed: the first guard that can fail does, as
    /// poisoned. None is listed.
    fn fail(&mut self) -> Option<u32> {
        let mut guards = self.offers.iter_mut().map(Offer::guard_mut);
        // SAFETY: this is the guards' alternative, and none of them is listed.
        let number = guards.position(|guard| guard.is_some_and(|guard| unsafe { guard.fail() }))?;
        current::stay_in_branch();
        self.state = State::Chosen(number as u32);
        Some(number as u32)
    }

    /// Records that the current process goes on with guard `number`.
    #[cold]
    fn report(&self, number: u32) {
        let chosen = self.offers.get(number as usize);
        let wait_point = chosen.and_then(Offer::wait_point);
        let wait_point = wait_point.map_or(0, |wait_point| wait_point.identity.number());
        let process = events::current_process() as u32;
        events::report(events::code::ALTERNATIVE, process, || {
            [number.into(), wait_point.into()]
        });
    }

    #[cold]
    #[inline(never)]
    pub(super) fn drop_unfinished(&mut self) {
        match self.state {
            State::New => replay::abandon(true),
            State::Listed => {
                replay::abandon(false);
                // From here on no thread can commit it; the guards then take themselves off their
                // lists. A guard that was chosen already keeps its result, and handles it as any
                // operation that is dropped. The handle is dropped last.
                let _former = self.select_state().close();
                self.note_begun();
                self.offers.iter_mut().for_each(Offer::withdraw_listed);
            }
            // The prologue may have met its partner, and let others run.
            State::GaveWay(number) => {
                let offer = self.offers.get_mut(number as usize);
                if let Some(guard) = offer
                    .filter(|offer| offer.plain().is_some())
                    .and_then(Offer::guard_mut)
                {
                    guard.note_begun();
                }
            }
            _ => {}
        }
    }
}
