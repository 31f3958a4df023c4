//! An operation as a guard of an alternative.

use super::{Direction, Operation, Phase};
use crate::alternative::{Attempt, Guard, RawGuard, Terms};
use crate::core::Attempted;
use crate::in_place::InPlace;
use crate::select_state::SelectState;
use crate::wait_point::WaitQueues;
use crate::waiter::{Outcome, Waiter, Waits};
use core::hint::cold_path;
use core::pin::Pin;
use core::ptr::NonNull;
use core::task::{Context, Poll};
use luna_core::current::{self, Here, Renewal};

// SAFETY: it borrows an end, which keeps the channel; its drop takes the node off the list.
unsafe impl<'a, T, D: Direction<T>> RawGuard for Operation<'a, T, D> {
    #[inline(always)]
    fn terms(&self) -> Terms {
        Terms {
            plain: D::PLAIN.then(|| self.waiter().cast()),
            of_sender: D::SEND,
            can_fail: !D::ANSWERED,
            ..Terms::at(self.channel().wait_point(), &self.end.chosen)
        }
    }

    unsafe fn attempt(
        self: Pin<&mut Self>,
        lists: Option<&mut WaitQueues>,
        cx: &mut Context<'_>,
    ) -> Attempt {
        let this = self.in_place();
        let Some(lists) = lists else {
            return Attempt::NotReady;
        };
        // SAFETY: the lists are those of the guard's wait point, and the guard is new, as is
        // demanded here: so they are this channel's, and the node is a new operation's. It is
        // pinned, and its drop withdraws it.
        unsafe {
            let mut locked = this.channel().guard_of(lists, Here::now());
            match D::attempt(this.node_pointer(), &mut locked, Some(cx)) {
                Attempted::NotNow => {
                    // A registered alternative starts to wait under its own lock. From here on it
                    // looks at this channel first, for which it needs the lock that is held: so no
                    // later guard meets one that an earlier guard has missed.
                    if D::SEND {
                        locked.announce();
                    }
                    Attempt::NotReady
                }
                met => Attempt::Ready(this.met(met)),
            }
        }
    }

    unsafe fn list(
        self: Pin<&mut Self>,
        lists: &mut WaitQueues,
        select_state: NonNull<SelectState>,
        guard: u32,
    ) {
        let this = self.in_place();
        // SAFETY: the lists are those of the guard's wait point, and the guard is new, as is
        // demanded here: so they are this channel's, and the node is in none. It is pinned, and its
        // drop withdraws it.
        unsafe {
            let here = Here::now();
            let select_state = Some((select_state, guard));
            this.begin((here, None).into_node(), select_state);
            let mut locked = this.channel().guard_of(lists, here);
            locked.list(D::SEND, this.waiter());
        }
        this.phase = Phase::Listed;
    }

    unsafe fn withdraw(self: Pin<&mut Self>) {
        if self.phase == Phase::Listed && self.outcome() == Outcome::Waiting {
            drop(self.unlist());
        }
    }

    unsafe fn poll_chosen(self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<()> {
        let this = self.in_place();
        this.drop_overwritten();
        let mut outcome = this.outcome();
        if matches!(outcome, Outcome::Waiting | Outcome::Held) {
            // The committing thread holds the lock until it is settled. SAFETY: the node was
            // listed.
            outcome = unsafe { this.renew_wake_handle(Renewal::of(cx)) };
        }
        match outcome {
            // A failed branch does not wait for an answer.
            Outcome::Held | Outcome::Waiting if D::ANSWERED && current::branch_failed() => {
                this.leave_failed();
            }
            // One that is held waits again when its receive is dropped.
            Outcome::Held | Outcome::Waiting => return Poll::Pending,
            Outcome::Broken => this.broken(),
            _ => {}
        }
        Poll::Ready(())
    }

    fn released(&self) {
        if D::SEND {
            self.channel().ring();
        }
    }

    fn note_logged(&self) {
        self.channel().note_logged(D::SEND);
    }

    fn order(&self) -> u64 {
        match self.phase {
            // SAFETY: an operation with a replay log is listed on the slow path alone; it is
            // settled, since its alternative has chosen it.
            Phase::Listed if self.outcome() != Outcome::Waiting => unsafe {
                Waiter::order(self.waiter())
            },
            _ => 0,
        }
    }

    unsafe fn fail(self: Pin<&mut Self>) -> bool {
        let this = self.in_place();
        this.phase = Phase::Settled(Outcome::Poisoned);
        true
    }

    fn note_begun(self: Pin<&mut Self>) {
        let this = self.in_place();
        if this.phase == Phase::New {
            this.phase = Phase::Listed;
        }
    }
}

impl<'a, T, D: Direction<T>> Guard for Operation<'a, T, D> {
    type Output = Result<D::Success<'a>, D::Failure>;
    type Seed = D::Seed<'a>;
    const DROPS: bool = D::DROPS;

    #[inline(always)]
    fn into_seed(self) -> Self::Seed {
        D::into_seed(self)
    }

    #[inline(always)]
    fn from_seed(seed: Self::Seed) -> Self {
        D::from_seed(seed)
    }

    #[inline(always)]
    fn is_open(&self) -> bool {
        // SAFETY: called for a new operation; only its future knows its node.
        unsafe { &*self.node.get() }.direction.is_open()
    }

    #[inline(always)]
    unsafe fn output(self: Pin<&mut Self>) -> Self::Output {
        let this = self.in_place();
        match this.outcome() {
            Outcome::Done if !D::ANSWERED => Ok(this.done()),
            outcome => {
                cold_path();
                this.settled(outcome)
            }
        }
    }
}
