//! The future of an alternative.

use super::choose::{Choice, Locks, choose, note_choice};
use super::fast_path::{Listing, Looks, Withdrawing};
use super::guard::RawGuard;
use super::list::{Collected, Guards, MAX_GUARDS, Open, Seeds};
use super::stop::Stop;
use crate::core::{FastPath, part_from};
use crate::finally::Finally;
use crate::replay::{self, Logged, Stage};
use crate::select_state::SelectState;
use luna_core::current::{self, PlainTurn, WakeHandle};
use luna_core::events;
use luna_core::replay_log::{Event, Turn, What};
use std::fmt;
use std::future::Future;
use std::marker::PhantomPinned;
use std::mem::{ManuallyDrop, MaybeUninit};
use std::pin::Pin;
use std::ptr::NonNull;
use std::task::{Context, Poll, RawWakerVTable};

/// Which waker polled: two of the same identity wake the same.
type Identity = (*const (), *const RawWakerVTable);

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum State {
    /// Not polled yet.
    Seeds,
    /// The guards are there, and nothing has happened.
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

/// An alternative under way: what `alt!` and `pri_alt!` await.
///
/// # Invariants
///
/// `seeds` is there in `Seeds`, and `guards` from then on; then it is pinned. In `Listed`, and
/// until their drop afterwards, guards may be listed and lead to `select_state`, which is there if
/// `has_selection`. Unless it is open, it has nothing to be dropped but its locks. In `Over`,
/// `stop` is not listed.
#[must_use = "an alternative does nothing unless awaited"]
pub struct Select<const FAIR: bool, S: Seeds> {
    seeds: MaybeUninit<S>,
    guards: MaybeUninit<S::Guards>,
    select_state: MaybeUninit<SelectState>,
    has_selection: bool,
    state: State,
    polled_by: Identity,
    stop: ManuallyDrop<Stop>,
    _pinned: PhantomPinned,
}

// SAFETY: the guards may be sent, the select state is shared by atomics and locks, and the identity
// is only compared.
unsafe impl<const FAIR: bool, S: Seeds<Guards: Send> + Send> Send for Select<FAIR, S> {}
// SAFETY: `&Select` gives access to nothing.
unsafe impl<const FAIR: bool, S: Seeds<Guards: Sync> + Sync> Sync for Select<FAIR, S> {}

/// An alternative among the guards of `seeds`: fair, or in the order written.
#[inline(always)]
pub fn select<const FAIR: bool, S: Seeds>(seeds: S) -> Select<FAIR, S> {
    const {
        assert!(
            S::Guards::LEN <= MAX_GUARDS,
            "an alternative has at most 32 guards: use `Alternative` for more channels"
        )
    };
    Select {
        seeds: MaybeUninit::new(seeds),
        guards: MaybeUninit::uninit(),
        select_state: MaybeUninit::uninit(),
        has_selection: false,
        state: State::Seeds,
        polled_by: (std::ptr::null(), std::ptr::null()),
        stop: ManuallyDrop::new(Stop::new()),
        _pinned: PhantomPinned,
    }
}

fn identity(cx: &Context<'_>) -> Identity {
    (cx.waker().data(), cx.waker().vtable())
}

impl<const FAIR: bool, S: Seeds> Future for Select<FAIR, S> {
    type Output = Outputs<S>;

    #[inline]
    fn poll(mut self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<Outputs<S>> {
        if self.state == State::Seeds {
            // SAFETY: in `Seeds` they are there, and not pinned; the guards are not there yet.
            unsafe {
                let this = self.as_mut().get_unchecked_mut();
                this.state = State::New;
                this.seeds.assume_init_read().grow(this.guards.as_mut_ptr());
            }
        }
        if S::Guards::PLAIN
            && let State::New | State::Listed = self.state
            && let Some(turn) = PlainTurn::of(cx)
        {
            // SAFETY: the guards are plain; their state is looked at here.
            let polled = unsafe {
                match self.state {
                    State::Listed => self.as_mut().finish_fast(turn),
                    _ => self.as_mut().begin_fast(turn, cx),
                }
            };
            if let Some(polled) = polled {
                return polled;
            }
        }
        self.poll_slow_path(cx)
    }
}

type Outputs<S> = <<S as Seeds>::Guards as Guards>::Output;

impl<const FAIR: bool, S: Seeds> Select<FAIR, S> {
    /// Chooses a ready guard, or lists all, on the [fast path](super::fast_path). `None`: take the
    /// slow path; nothing has happened.
    ///
    /// # Safety
    ///
    /// The guards are plain, and nothing has happened.
    #[inline(always)]
    unsafe fn begin_fast(
        self: Pin<&mut Self>,
        turn: PlainTurn<'_>,
        cx: &Context<'_>,
    ) -> Option<Poll<Outputs<S>>> {
        // SAFETY: the guards are pinned with the whole, and the select state is only borrowed.
        let this = unsafe { self.get_unchecked_mut() };
        // SAFETY: as above; they are there since the poll began.
        let mut guards = unsafe { Pin::new_unchecked(this.guards.assume_init_mut()) };
        let mut looks = Looks::new(turn, FAIR);
        guards.each(0, &mut looks);
        if looks.ready.is_none() && !looks.is_refused && !S::Guards::SKIP {
            // Before another thread can find a node that leads to it.
            // SAFETY: by the contract, and a wait point is locked by its bias.
            let select_state = this
                .select_state
                .write(unsafe { SelectState::opened_fast(turn.process()) });
            let select_state = NonNull::from(select_state);
            this.has_selection = true;
            // SAFETY: none is ready; the guards are pinned, and go before the select state.
            guards.each(0, &mut unsafe { Listing::of(turn.process(), select_state) });
            guards.note_listed();
            this.state = State::Listed;
            this.polled_by = identity(cx);
            return Some(Poll::Pending);
        }
        guards.each(0, &mut looks.leaving());
        if looks.is_refused {
            return None;
        }
        // SAFETY: a chosen guard's look has kept its lock, and found this partner; a channel and
        // its ends outlive its guards. The process is in its plain turn.
        let (number, gives_way) = unsafe {
            looks.stamp();
            match looks.ready {
                Some(ready) => {
                    guards.as_mut().meet(ready.number, ready.partner);
                    let parted = part_from(
                        ready.wait_point.as_ref(),
                        ready.partner,
                        ready.of_sender,
                        turn,
                    );
                    (ready.number, parted == FastPath::GaveWay)
                }
                None => (S::Guards::LEN as u32, current::gives_way(turn.process())),
            }
        };
        if gives_way {
            this.state = State::GaveWay(number);
            return Some(Poll::Pending);
        }
        this.state = State::Over;
        // SAFETY: the guard was chosen and is over, and the alternative is not polled again.
        Some(Poll::Ready(unsafe { guards.output(number) }))
    }

    /// Takes the result of a partner's commit, and withdraws the other guards. `None`: take the
    /// slow path.
    ///
    /// # Safety
    ///
    /// The guards are plain and listed.
    #[inline(always)]
    unsafe fn finish_fast(self: Pin<&mut Self>, turn: PlainTurn<'_>) -> Option<Poll<Outputs<S>>> {
        // SAFETY: the guards are pinned with the whole, and the select state is only borrowed.
        let this = unsafe { self.get_unchecked_mut() };
        // SAFETY: as above; both are there since the guards were listed.
        let (guards, select_state) = unsafe {
            (
                Pin::new_unchecked(this.guards.assume_init_mut()),
                this.select_state.assume_init_ref(),
            )
        };
        let chosen = select_state.chosen()?;
        let mut others = Withdrawing::but(chosen, turn, FAIR);
        guards.each(0, &mut others);
        // SAFETY: the guards are there.
        unsafe { others.stamp() };
        this.state = State::Chosen(chosen);
        if !others.is_over {
            return None;
        }
        this.state = State::Over;
        // SAFETY: the guard was chosen and is over, and the alternative is not polled again.
        Some(Poll::Ready(unsafe { guards.output(chosen) }))
    }

    /// Polls wherever the process is, and whatever is offered.
    #[inline(never)]
    fn poll_slow_path(self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<Outputs<S>> {
        // SAFETY: the guards are pinned with the whole, and the select state is only borrowed.
        let this = unsafe { self.get_unchecked_mut() };
        // SAFETY: as above; they are there since the poll began.
        let mut guards = unsafe { Pin::new_unchecked(this.guards.assume_init_mut()) };
        let polled = {
            let mut collected = Collected::default();
            guards.as_mut().collect(0, &mut collected);
            let Collected(open) = collected;
            if open.is_empty() && !S::Guards::SKIP && this.state != State::Over {
                // SAFETY: the alternative is pinned.
                unsafe { this.stop.list() };
            }
            let mut alternative = Polled {
                open,
                select_state: NonNull::from(&mut this.select_state).cast(),
                has_selection: &mut this.has_selection,
                fair: FAIR,
                state: &mut this.state,
                polled_by: &mut this.polled_by,
                skip: S::Guards::SKIP.then_some(S::Guards::LEN as u32),
            };
            match replay::is_on() {
                true => replay::poll(&mut alternative, cx),
                false => alternative.poll(cx),
            }
        };
        if polled.is_pending() {
            events::waits_for_several();
        }
        polled.map(|number| {
            this.state = State::Over;
            report_choice(guards.as_mut(), number);
            // SAFETY: the guard was chosen and is over, and the alternative is not polled again.
            unsafe { guards.output(number) }
        })
    }
}

/// Records that the current process goes on with guard `number`.
#[inline(always)]
fn report_choice<G: Guards>(guards: Pin<&mut G>, number: u32) {
    if events::is_on() {
        report_choice_event(guards, number);
    }
}

#[cold]
fn report_choice_event<G: Guards>(guards: Pin<&mut G>, number: u32) {
    let mut collected = Collected::default();
    guards.collect(0, &mut collected);
    let chosen = collected.0.iter().find(|(other, _)| *other == number);
    let wait_point = chosen.and_then(|(_, guard)| guard.terms().wait_point);
    let wait_point = wait_point.map_or(0, |wait_point| {
        // SAFETY: a wait point outlives its guards.
        unsafe { wait_point.as_ref() }.identity.number()
    });
    let process = events::current_process() as u32;
    events::report(events::code::ALTERNATIVE, process, || {
        [number.into(), wait_point.into()]
    });
}

/// The locks of these guards' wait points were released.
fn released(open: &[(u32, Pin<&mut (dyn RawGuard + '_)>)]) {
    if let Some(((_, first), others)) = open.split_first() {
        // A wake may panic: the remaining wakes must still be done.
        let _others = Finally::new(|| released(others));
        first.released();
    }
}

/// One poll of an alternative, whatever the types of its guards.
struct Polled<'a> {
    open: Open<'a>,
    /// Of the alternative around it; there if `has_selection`.
    select_state: NonNull<SelectState>,
    has_selection: &'a mut bool,
    fair: bool,
    state: &'a mut State,
    polled_by: &'a mut Identity,
    /// The number of `skip`, if it stands.
    skip: Option<u32>,
}

impl<'a> Polled<'a> {
    /// Which guard has happened and is over.
    fn poll(&mut self, cx: &mut Context<'_>) -> Poll<u32> {
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
                        if crate::gives_way(cx) {
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
    fn first_look(&mut self, skip: Option<u32>, cx: &mut Context<'_>) -> Poll<Option<u32>> {
        // Made before the locks are taken; dropped last, if a guard is chosen.
        let mut wake_handle = skip.is_none().then(|| WakeHandle::of(cx));
        // SAFETY: it is room for one in the alternative.
        unsafe { self.select_state.write(SelectState::new()) };
        *self.has_selection = true;
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
            (Choice::None, Some(skip)) => Poll::Ready(Some(skip)),
            (Choice::None | Choice::Listed, _) => {
                *self.state = State::Listed;
                *self.polled_by = identity(cx);
                released(&self.open);
                Poll::Ready(None)
            }
        }
    }

    /// The select state of one that was listed.
    fn select_state(&self) -> &'a SelectState {
        debug_assert!(*self.has_selection);
        // SAFETY: it is there, and pinned with the alternative.
        unsafe { self.select_state.as_ref() }
    }

    fn poll_listed(&mut self, cx: &mut Context<'_>) -> Poll<u32> {
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
    fn rewake(&mut self, cx: &mut Context<'_>) {
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
    fn withdraw_but(&mut self, chosen: Option<u32>) {
        for (number, guard) in self.open.iter_mut() {
            if Some(*number) != chosen {
                // SAFETY: this is the guard's alternative.
                unsafe { guard.as_mut().withdraw() };
            }
        }
    }

    fn poll_chosen(&mut self, number: u32, cx: &mut Context<'_>) -> Poll<u32> {
        match self.open.iter_mut().find(|(other, _)| *other == number) {
            // SAFETY: this is the guard's alternative, which has chosen it.
            Some((_, guard)) => unsafe { guard.as_mut().poll_chosen(cx) }.map(|()| number),
            // `skip`.
            None => Poll::Ready(number),
        }
    }

    fn can_fail(&self) -> bool {
        self.open.iter().any(|(_, guard)| guard.terms().can_fail)
    }

    /// Whether it waits for a partner, or for nothing at all, and has no error to return if the
    /// partner never comes.
    fn is_stuck(&self) -> bool {
        !self.can_fail()
            && (self.open.is_empty()
                || self
                    .open
                    .iter()
                    .any(|(_, guard)| guard.terms().wait_point.is_some()))
    }

    /// A sibling in a parallel construct has failed: the first guard that can fail does, as
    /// poisoned. None is listed.
    fn fail(&mut self) -> Option<u32> {
        let number = self.open.iter_mut().find_map(|(number, guard)| {
            // SAFETY: this is the guard's alternative, and none of its guards is listed.
            unsafe { guard.as_mut().fail() }.then_some(*number)
        })?;
        current::stay_in_branch();
        *self.state = State::Chosen(number);
        Some(number)
    }

    fn note(&self, number: u32) {
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

impl<const FAIR: bool, S: Seeds> Drop for Select<FAIR, S> {
    #[inline(always)]
    fn drop(&mut self) {
        if self.state != State::Over {
            self.drop_unfinished();
            return;
        }
        // SAFETY: they are there after the first poll. No node leads to the selection any more.
        unsafe {
            if S::Guards::DROPS {
                self.guards.assume_init_drop();
            }
            if SelectState::HAS_DROP && self.has_selection {
                self.select_state.assume_init_drop();
            }
        }
    }
}

impl<const FAIR: bool, S: Seeds> Select<FAIR, S> {
    #[cold]
    fn drop_unfinished(&mut self) {
        // Dropped when no node leads here any more.
        let _former;
        match self.state {
            State::Seeds => {
                replay::abandon(true);
                // SAFETY: in this state they are there.
                return unsafe { self.seeds.assume_init_drop() };
            }
            State::New => replay::abandon(true),
            State::Listed => {
                replay::abandon(false);
                // From here on no thread can commit it; the guards then take themselves off their
                // lists. A guard that was chosen already keeps its result, and handles it as any
                // operation that is dropped. SAFETY: in this state it is there.
                _former = unsafe { self.select_state.assume_init_ref() }.close();
            }
            _ => {}
        }
        // SAFETY: each is dropped once, and the guards are there after the first poll. Their
        // select state outlives them.
        unsafe {
            let _stop = Finally::new(|| ManuallyDrop::drop(&mut self.stop));
            let _select_state = Finally::new(|| {
                if self.has_selection {
                    self.select_state.assume_init_drop();
                }
            });
            self.guards.assume_init_drop();
        }
    }
}

impl<const FAIR: bool, S: Seeds> fmt::Debug for Select<FAIR, S> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Select")
            .field("fair", &FAIR)
            .field("state", &self.state)
            .finish_non_exhaustive()
    }
}
