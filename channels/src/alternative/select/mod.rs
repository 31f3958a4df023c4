//! The future of an alternative.

mod slow_path;

use crate::alternative::fast_path::{Chosen, Ends, Finish, Found, Listing, Looks, Withdrawing};
use crate::alternative::guard::Guard;
use crate::alternative::list::{Collected, Guards, MAX_GUARDS, Seeds};
use crate::alternative::stop::Stop;
use crate::finally::Finally;
use crate::replay;
use crate::select_state::SelectState;
use core::future::Future;
use core::marker::PhantomPinned;
use core::mem::{ManuallyDrop, MaybeUninit};
use core::pin::Pin;
use core::ptr::NonNull;
use core::task::{Context, Poll, RawWakerVTable, ready};
use luna_core::current::PlainTurn;
use luna_core::events;
use slow_path::Polled;

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
/// `has_select_state`. Unless it is open, it has nothing to be dropped but its locks. In `Over`,
/// `stop` is not listed.
#[must_use = "an alternative does nothing unless awaited"]
pub struct Select<const FAIR: bool, S: Seeds> {
    seeds: MaybeUninit<S>,
    guards: MaybeUninit<S::Guards>,
    select_state: MaybeUninit<SelectState>,
    has_select_state: bool,
    state: State,
    /// Of the guards, when the fast path listed them.
    ends: Ends<FAIR>,
    /// On the slow path. A waker that polls there next after the fast path is new.
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
        has_select_state: false,
        state: State::Seeds,
        ends: Ends::new(),
        polled_by: (core::ptr::null(), core::ptr::null()),
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
                    _ => self.as_mut().begin_fast(turn),
                }
            };
            if let Some(polled) = polled {
                return polled;
            }
        }
        let number = ready!(self.as_mut().poll_slow_path(cx));
        // SAFETY: the guards are pinned with the whole, and are there since the poll began. The
        // guard was chosen and is over, and the alternative is not polled again. `Over` gives an
        // output.
        unsafe {
            let this = self.get_unchecked_mut();
            this.state = State::Over;
            let guards = Pin::new_unchecked(this.guards.assume_init_mut());
            Poll::Ready(guards.finish(number, Over).unwrap_unchecked())
        }
    }
}

/// The last step on a guard that the slow path has chosen, and which is over.
struct Over;

impl Finish for Over {
    #[cfg_attr(not(debug_assertions), inline(always))]
    unsafe fn finish<G: Guard>(self, guard: Pin<&mut G>) -> Option<G::Output> {
        // SAFETY: the guard was chosen and is over, and its output is taken once, as is demanded
        // here.
        Some(unsafe { guard.output() })
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
    #[cfg_attr(not(debug_assertions), inline(always))]
    unsafe fn begin_fast(self: Pin<&mut Self>, turn: PlainTurn<'_>) -> Option<Poll<Outputs<S>>> {
        // SAFETY: the guards are pinned with the whole, and the select state is only borrowed.
        let this = unsafe { self.get_unchecked_mut() };
        // SAFETY: the guards are there since the poll began, and are pinned with the whole.
        let mut guards = unsafe { Pin::new_unchecked(this.guards.assume_init_mut()) };
        let mut looks = Looks::<FAIR>::new(turn);
        guards.as_mut().each(0, &mut looks);
        let found = looks.found();
        if found == Found::Nothing && !S::Guards::SKIP {
            let select_state = NonNull::from(&mut this.select_state).cast();
            // SAFETY: none is ready; the guards are pinned, and go before the select state.
            let mut listing = unsafe { Listing::of(turn, select_state) };
            // Before another thread can find a node that leads to it. SAFETY: it is room for one in
            // the alternative. `Nothing` was found only if a look has entered a wait point, by its
            // bias to the executor of this turn.
            unsafe { select_state.write(SelectState::opened_fast(turn)) };
            this.has_select_state = true;
            guards.each(0, &mut listing);
            this.state = State::Listed;
            this.ends = looks.ends;
            return Some(Poll::Pending);
        }
        guards.as_mut().each(0, &mut looks.leaving());
        let (number, output) = match found {
            Found::Refused => return None,
            // SAFETY: the look has found this guard ready, and has kept its lock.
            Found::Ready(number) => (number, unsafe { guards.finish(number, looks.meeting()) }),
            Found::Nothing => {
                let skip = S::Guards::LEN as u32;
                // SAFETY: `skip` demands nothing.
                let output = (!turn.yields_after_operation())
                    .then(|| unsafe { guards.finish(skip, Over) })
                    .flatten();
                (skip, output)
            }
        };
        let Some(output) = output else {
            this.state = State::GaveWay(number);
            return Some(Poll::Pending);
        };
        this.state = State::Over;
        Some(Poll::Ready(output))
    }

    /// Takes the result of a partner's commit, and withdraws the other guards. `None`: take the
    /// slow path.
    ///
    /// # Safety
    ///
    /// The guards are plain and listed.
    #[cfg_attr(not(debug_assertions), inline(always))]
    unsafe fn finish_fast(self: Pin<&mut Self>, turn: PlainTurn<'_>) -> Option<Poll<Outputs<S>>> {
        // SAFETY: the guards are pinned with the whole, and the select state is only borrowed.
        let this = unsafe { self.get_unchecked_mut() };
        // SAFETY: guards were listed, so both are there: the guards since the first poll, the
        // select state since before the listing. The guards are pinned with the whole.
        let (mut guards, select_state) = unsafe {
            (
                Pin::new_unchecked(this.guards.assume_init_mut()),
                this.select_state.assume_init_ref(),
            )
        };
        let chosen = select_state.chosen()?;
        // SAFETY: the guard was listed, and a partner has chosen it. The output is taken once: the
        // alternative is over then.
        let output = unsafe { guards.as_mut().finish(chosen, Chosen { ends: this.ends }) }?;
        guards.each(0, &mut Withdrawing { turn });
        this.state = State::Over;
        Some(Poll::Ready(output))
    }

    /// Polls wherever the process is, and whatever is offered.
    #[inline(never)]
    fn poll_slow_path(self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<u32> {
        // SAFETY: the guards are pinned with the whole, and the select state is only borrowed.
        let this = unsafe { self.get_unchecked_mut() };
        // SAFETY: the guards are there since the poll began, and are pinned with the whole.
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
                has_select_state: &mut this.has_select_state,
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
        match polled {
            Poll::Pending => events::waits_for_several(),
            Poll::Ready(number) => report_choice(guards, number),
        }
        polled
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

impl<const FAIR: bool, S: Seeds> Drop for Select<FAIR, S> {
    #[inline(always)]
    fn drop(&mut self) {
        if self.state != State::Over {
            self.drop_unfinished();
            return;
        }
        // SAFETY: they are there after the first poll. No node leads to the select state any more.
        unsafe {
            if S::Guards::DROPS {
                self.guards.assume_init_drop();
            }
            if SelectState::HAS_DROP && self.has_select_state {
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
                if self.has_select_state {
                    self.select_state.assume_init_drop();
                }
            });
            self.guards.assume_init_drop();
        }
    }
}

luna_platform::debug_fields!(
    impl[const FAIR: bool, S: Seeds] Select<FAIR, S>, |select|
    fair: FAIR,
    state: select.state
);
