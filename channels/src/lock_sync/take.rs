//! Taking permits, as a future: the one operation behind locking, acquiring, and locking again
//! after a wait at a condition.

use super::core::{Core, Hold, LockState};
use super::entry::{Entry, follow};
use super::guard::AcquireError;
use crate::guarded_wait_point::Locked;
use crate::in_place::InPlace;
use crate::replay::{self, GiveUp, Logged, Stage};
use crate::wait_point::Lists;
use crate::waiter::{Outcome, Waiter};
use core::cell::UnsafeCell;
use core::fmt;
use core::future::Future;
use core::marker::PhantomPinned;
use core::mem::MaybeUninit;
use core::pin::Pin;
use core::ptr::NonNull;
use core::task::{Context, Poll};
use luna_core::current::{self, Inheritor, Priority, Renewal};
use luna_core::deferred_free::Shared;
use luna_core::replay_log::{Event, Turn};

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum TakePhase {
    New,
    /// It has let others run, and takes the permits next.
    GaveWay,
    /// The entry is in a list, or was settled.
    Listed,
    /// It has its permits, and no entry.
    Granted,
    /// Its permits, if it had any, belong to the caller.
    Over,
}

/// What comes of a [`Take`] that gives up; nothing when its time has run out.
pub(super) type InTime<'a> = Option<Result<Hold<'a>, AcquireError>>;

/// Taking permits of a mutex or a semaphore. Its output says that the caller has them now.
///
/// # Invariants
///
/// In `Listed` it is pinned, and the entry was begun. Otherwise there is none, only room for it.
pub(super) struct Take<'a> {
    core: &'a Shared<Core>,
    entry: UnsafeCell<MaybeUninit<Entry>>,
    pub(super) phase: TakePhase,
    /// The thread itself takes them, so it may inherit, and waits at its priority.
    pub(super) of_thread: bool,
    pub(super) count: u32,
    _pinned: PhantomPinned,
}

// SAFETY: a listed entry is guarded by its wait point's lock wherever the future is.
unsafe impl Send for Take<'_> {}
// SAFETY: `&Take` gives access to nothing.
unsafe impl Sync for Take<'_> {}

impl<'a> Take<'a> {
    #[inline]
    pub(super) fn new(core: &'a Shared<Core>, count: u32, of_thread: bool) -> Self {
        Take {
            core,
            entry: UnsafeCell::new(MaybeUninit::uninit()),
            phase: TakePhase::New,
            of_thread,
            count,
            _pinned: PhantomPinned,
        }
    }

    #[inline]
    pub(super) fn core(&self) -> &'a Core {
        self.core
    }

    pub(super) fn entry(&self) -> NonNull<Entry> {
        NonNull::from(&self.entry).cast()
    }

    /// Begins the entry, for the caller to list it.
    ///
    /// # Safety
    ///
    /// It is pinned and new.
    pub(super) unsafe fn begin(&mut self, inheritor: Option<Inheritor>) {
        self.phase = TakePhase::Listed;
        // SAFETY: it is pinned and new, as is demanded here: so the entry is this future's alone,
        // and was not begun. It is ended with the future.
        unsafe { Entry::begin(self.entry(), self.core, self.count, inheritor) };
    }

    /// Whether a listed entry was given its permits.
    pub(super) fn has_succeeded(&self) -> bool {
        debug_assert_eq!(self.phase, TakePhase::Listed);
        // SAFETY: it was begun, and lies in this future.
        unsafe { Waiter::outcome(Entry::waiter(self.entry())) == Outcome::Done }
    }

    #[inline(never)]
    fn poll_otherwise(
        &mut self,
        turn: current::Turn<'_>,
        cx: &mut Context<'_>,
    ) -> Poll<Result<Hold<'a>, AcquireError>> {
        let polled = match turn.has_replay_log() {
            true => replay::poll(self, cx),
            false => self.poll_without_log(turn),
        };
        if polled.is_ready() {
            self.end();
        }
        polled
    }

    /// Polls until it has its permits, or its branch has failed.
    fn poll_without_log(
        &mut self,
        turn: current::Turn<'_>,
    ) -> Poll<Result<Hold<'a>, AcquireError>> {
        let cx = &turn.context();
        if turn.branch_failed() && self.phase != TakePhase::Over && !self.withdraw() {
            if self.phase == TakePhase::New && crate::fails_later(cx) {
                self.phase = TakePhase::GaveWay;
                return Poll::Pending;
            }
            self.end();
            current::stay_in_branch();
            return Poll::Ready(Err(AcquireError));
        }
        let polled = match self.phase {
            // Lets others run before it holds what they could wait for.
            TakePhase::New if turn.yields_after_operation() => {
                self.phase = TakePhase::GaveWay;
                return Poll::Pending;
            }
            TakePhase::New | TakePhase::GaveWay => {
                self.core().note_user(turn.here());
                // Made without the lock.
                let mut inheritor = self.core().inheritor(self.of_thread);
                let locked = self.core().lock_in(turn.here());
                self.take_under(locked, turn, || inheritor.take())
            }
            TakePhase::Listed => self.poll_listed(cx),
            TakePhase::Granted => Poll::Ready(()),
            TakePhase::Over => panic!("a lock or acquire was polled after it was over"),
        };
        // SAFETY: it has succeeded; the phase says that its permits belong to the caller when this
        // is returned.
        polled.map(|()| Ok(unsafe { self.hold() }))
    }

    /// # Safety
    ///
    /// It has succeeded, and no hold was made of it, or that was only kept.
    pub(super) unsafe fn hold(&self) -> Hold<'a> {
        // SAFETY: it has succeeded, as is demanded here, and gives its permits to this hold.
        unsafe { Hold::new(self.core()) }
    }

    /// Takes permits under the lock, in whichever way it is held, or waits for them. At first as if
    /// uncontended: there is no process to wake then, and a thread need not ask the system for its
    /// priority.
    #[inline(always)]
    fn take_under(
        &mut self,
        mut locked: Locked<'_, LockState, impl Lists>,
        turn: current::Turn<'_>,
        holder: impl FnOnce() -> Option<Inheritor>,
    ) -> Poll<()> {
        let here = turn.here();
        if locked.take(here, self.count, || here.priority(), holder) {
            self.phase = TakePhase::Granted;
            return Poll::Ready(());
        }
        drop(locked);
        self.poll_contended(turn)
    }

    #[cold]
    #[inline(never)]
    fn poll_contended(&mut self, turn: current::Turn<'_>) -> Poll<()> {
        let (core, here, cx) = (self.core(), turn.here(), turn.context());
        let (priority, mut inheritor) = (priority(self.of_thread), core.inheritor(self.of_thread));
        let (mut renewal, mut changed) = (Renewal::of(&cx), None);
        let polled = renewal.put(|renewal| {
            let mut locked = core.lock_in(here);
            if locked.take(here, self.count, || priority, || inheritor.take()) {
                self.phase = TakePhase::Granted;
                return Poll::Ready(());
            }
            let Some(wake_handle) = renewal.take() else {
                return Poll::Pending;
            };
            // SAFETY: this future is pinned, and was not listed; in `Listed` it is taken back and
            // ended when it goes. Listed with its process before the priority is read again.
            unsafe {
                self.begin(inheritor.take());
                let node = Entry::node(self.entry());
                locked.waiting().insert(node, priority, wake_handle);
                locked.requeue(self.entry());
            }
            changed = locked.boost_holder();
            Poll::Pending
        });
        if polled.is_pending() {
            follow(changed);
            core.waits();
        }
        polled
    }

    /// Polls an entry that is in the list of the core, or was settled.
    pub(super) fn poll_listed(&mut self, cx: &Context<'_>) -> Poll<()> {
        if self.has_succeeded() {
            return Poll::Ready(());
        }
        let mut renewal = Renewal::of(cx);
        let polled = renewal.put(|renewal| {
            let _locked = self.core().lock();
            if self.has_succeeded() {
                return Poll::Ready(());
            }
            // SAFETY: the entry was begun, and under the lock a waiting node may be changed.
            renewal.store(unsafe { (*Entry::link(self.entry())).wait.wake_handle_mut() });
            Poll::Pending
        });
        if polled.is_pending() {
            self.core().waits();
        }
        polled
    }

    /// Ends the entry, which is settled or in no list.
    pub(super) fn end(&mut self) {
        if self.phase == TakePhase::Listed {
            // SAFETY: it is this future's, was begun, and is in no list.
            unsafe { Entry::end(self.entry()) };
        }
        self.phase = TakePhase::Over;
    }

    /// Takes it back, if it waits; `true` if it has its permits.
    fn withdraw(&mut self) -> bool {
        if self.phase != TakePhase::Listed {
            return self.phase == TakePhase::Granted;
        }
        let core = self.core();
        core.waits_no_more();
        let mut locked = core.lock();
        if self.has_succeeded() {
            return true;
        }
        let entry = self.entry();
        // SAFETY: the entry is this future's, was begun, and under the lock one that is not done is
        // in the list. It is settled after it was taken off.
        let _former = unsafe {
            locked.waiting().remove(Entry::node(entry));
            let former = (*Entry::link(entry)).wait.wake_handle_mut().take();
            Waiter::set_outcome(Entry::waiter(entry), Outcome::Stale);
            former
        };
        let changed = locked.boost_holder();
        drop(locked);
        // Before what may run user code: the former handle's drop is the last step.
        self.end();
        follow(changed);
        if !core.has_owner() {
            // Waiters behind it may want fewer permits.
            core.serve();
        }
        false
    }

    /// Gives up in any state; gives back what it was given.
    #[cold]
    pub(super) fn cancel(&mut self) {
        let has_them = self.withdraw();
        self.end();
        if has_them {
            // The value was not touched.
            self.core().give_back(self.count);
        }
    }
}

// SAFETY: what is pinned is the entry, which every method leaves where it is.
unsafe impl InPlace for Take<'_> {}

/// The process that takes permits; or the thread, if it runs no process and the thread itself takes
/// them.
pub(super) fn caller(of_thread: bool) -> Option<Inheritor> {
    match of_thread {
        true => Inheritor::current_or_thread(),
        false => Inheritor::current(),
    }
}

/// The priority at which the caller waits. That of a plain thread is read from the system.
pub(super) fn priority(of_thread: bool) -> Priority {
    caller(of_thread).map_or_else(current::priority, |caller| {
        caller.priority_before_blocking()
    })
}

impl<'a> Future for Take<'a> {
    type Output = Result<Hold<'a>, AcquireError>;

    /// Polls wherever the process is, and whatever it waits with.
    #[inline(never)]
    fn poll(self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<Self::Output> {
        let this = self.in_place();
        let (core, turn) = (this.core(), current::Turn::of(cx));
        if this.phase == TakePhase::New
            && let Some(plain) = turn.plain()
            && let Some(locked) = core.enter_in(turn.here())
            && plain.goes_on()
        {
            let holder = || match core.has_owner() {
                true => Inheritor::of_plain_turn(plain),
                false => None,
            };
            let polled = this.take_under(locked, turn, holder);
            if polled.is_ready() {
                this.phase = TakePhase::Over;
            }
            // SAFETY: it has succeeded, and is over.
            return polled.map(|()| Ok(unsafe { this.hold() }));
        }
        this.poll_otherwise(turn, cx)
    }
}

impl Drop for Take<'_> {
    #[inline(always)]
    fn drop(&mut self) {
        if self.phase != TakePhase::Over {
            replay::abandon(self.phase == TakePhase::New);
            self.cancel();
        }
    }
}

impl fmt::Debug for Take<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.phase.fmt(f)
    }
}

impl<'a> Logged for Take<'a> {
    type Output = Result<Hold<'a>, AcquireError>;

    const KEEPS: bool = true;

    fn stage(&self) -> Stage {
        match self.phase {
            TakePhase::New => Stage::New,
            // One that lets others run does so before it takes permits.
            TakePhase::GaveWay | TakePhase::Listed => Stage::Waits,
            TakePhase::Granted => Stage::GaveWay,
            TakePhase::Over => Stage::Over,
        }
    }

    fn come(&mut self, turn: Turn, _: &mut Context<'_>) -> Poll<()> {
        if !self.core().has_owner() && matches!(turn, Turn::Given(event) if event.stamp != 0) {
            self.core().take_given(self.count);
            self.phase = TakePhase::Granted;
        }
        Poll::Ready(())
    }

    fn poll_unlogged(&mut self, cx: &mut Context<'_>) -> Poll<<Self as Logged>::Output> {
        self.poll_without_log(current::Turn::of(cx))
    }

    /// The stamp is taken now, when the process has the permits: stamps of holders are in the order
    /// of their holding a mutex, and one of a semaphore comes after what made room.
    unsafe fn success(&self, _: Option<&<Self as Logged>::Output>, _: u64) -> Event {
        Event::done(match self.core().has_owner() {
            true => replay::meeting(&mut self.core().lock()),
            false => replay::own_stamp(),
        })
    }

    fn keep(&mut self, _: <Self as Logged>::Output) {
        self.end();
        self.phase = TakePhase::Granted;
    }

    fn fail(&mut self, _: u64) -> Poll<<Self as Logged>::Output> {
        self.end();
        Poll::Ready(Err(AcquireError))
    }

    fn failure(output: &<Self as Logged>::Output) -> Option<Event> {
        output.as_ref().err().map(|_| replay::ended(true))
    }
}

impl<'a> GiveUp for Take<'a> {
    type Outcome = InTime<'a>;

    /// It has not tried yet.
    fn lets_others_run(&self) -> bool {
        self.phase == TakePhase::GaveWay
    }

    fn give_up(self: Pin<&mut Self>) -> InTime<'a> {
        let this = self.in_place();
        let has_them = this.withdraw();
        this.end();
        // SAFETY: it was given its permits, and is over.
        has_them.then(|| Ok(unsafe { this.hold() }))
    }

    fn in_time(output: <Self as Future>::Output) -> InTime<'a> {
        Some(output)
    }

    fn failure_in_time(outcome: &InTime<'a>) -> Option<Event> {
        outcome.is_none().then(replay::gave_up)
    }
}
