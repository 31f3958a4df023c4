//! The current process: the contract between channels and executors.
//!
//! Whoever runs processes sets a thread-local *current process* around each poll. Whoever makes processes wait (channels, barriers,
//! timers) reads it: to order waiting lists by priority, and to ready a process without its waker ([`Wakeup`]). On a thread that runs no
//! process of LUNA (a plain thread, tokio, smol) it is absent: priority is then the lowest, and wakers do the waking.

mod branches;
mod guest;
mod heir;
mod home_thread;
mod inheritance;
mod lone;
mod poisoning;
mod process;
mod references;
mod run_queue;
mod wakeup;

pub use branches::Branches;
pub use guest::Guest;
pub use heir::Heir;
#[cfg(not(loom))]
pub use home_thread::{RefusedBoosts, refused_boosts};
pub use lone::Lone;
pub use poisoning::{dropped_ends_poison, poison_dropped_ends};
pub use process::{Activity, Home, LEVELS, Methods, Place, Priority, Process, ProcessId, User};
pub use wakeup::{PlainReady, Ready, Wakeup};

use crate::path;
use crate::spare::Spare;
use crate::sync::Arc;
use crate::tape::Tape;
use crate::timer_queue::TimerQueue;
use home_thread::HomeThread;
use run_queue::RunQueue;
use std::cell::{Cell, RefCell};
use std::ptr::NonNull;
use std::task::Context;

/// How many operations one poll may complete without waiting before the process lets others run.
///
/// A process whose operations always find a partner would else keep its executor from its timers and from wakes from elsewhere.
pub const OPERATIONS_PER_POLL: u32 = 64;

/// Which part of the current process is being polled: whether a sibling of it has failed, in the highest bit, and how many levels it
/// runs below its process, in the lowest six; the one between says that it is a part and not the whole. Above them, whether the process has a
/// [tape](crate::tape), and in the upper half which branch it is, if it has. One word, since it is saved and restored around each poll.
#[derive(Clone, Copy)]
struct Branch(u64);

impl Branch {
    /// No branch, but the process itself.
    const WHOLE: Branch = Branch(0);
    const FAILED: u64 = 1 << 7;
    const PART: u64 = 1 << 6;
    const TAPED: u64 = 1 << 8;

    /// Whether it runs at its process' level, and nobody has failed: it may be a part.
    #[inline]
    fn is_plain(self) -> bool {
        self.0 & !Self::PART == 0
    }

    #[inline]
    fn has_failed(self) -> bool {
        self.0 & Self::FAILED != 0
    }

    #[inline]
    fn lowered(self) -> u8 {
        (self.0 & 0x3f) as u8
    }

    #[inline]
    fn is_taped(self) -> bool {
        self.0 & Self::TAPED != 0
    }

    /// The path of parallel constructs down to it, as a number; 0 is the process itself.
    #[inline]
    fn path(self) -> u32 {
        (self.0 >> 32) as u32
    }

    /// A branch of this one.
    #[inline]
    fn branch(self, failed: bool, levels: u8, number: u32) -> Branch {
        // More than all levels is as good as all, and stays clear of the bits.
        let lowered = (self.lowered() + levels.min(LEVELS)).min(LEVELS - 1);
        let mut branch = Branch(
            self.0 & Self::FAILED | u64::from(failed) << 7 | Self::PART | u64::from(lowered),
        );
        if self.is_taped() {
            branch.0 |= Self::TAPED | u64::from(self.path_of(number)) << 32;
        }
        branch
    }

    /// The path of branch `number` of this one.
    #[cold]
    fn path_of(self, number: u32) -> u32 {
        // FNV-1a by words: different enough for the few paths of a process.
        ((self.path() ^ 0x811c_9dc5).wrapping_mul(0x0100_0193) ^ (number + 1))
            .wrapping_mul(0x0100_0193)
            .max(1)
    }
}

/// What a thread that runs processes keeps beside the current one.
///
/// What each turn and each operation touches comes first, at the beginning of a cache line: so it lies on one, whatever other thread-locals a program has.
#[repr(C, align(64))]
struct Thread {
    process: Cell<Option<NonNull<Process>>>,
    branch: Cell<Branch>,
    home: Cell<Option<Home>>,
    operations_left: Cell<u32>,
    branch_ended: Cell<bool>,
    may_block: Cell<bool>,
    on_path: Cell<bool>,
    abandons: Cell<bool>,
    queue: RunQueue,
    tape: Cell<Option<NonNull<dyn Tape>>>,
}

thread_local! {
    static THREAD: Thread = const {
        Thread {
            process: Cell::new(None),
            home: Cell::new(None),
            queue: RunQueue::new(),
            operations_left: Cell::new(0),
            branch: Cell::new(Branch::WHOLE),
            branch_ended: Cell::new(false),
            may_block: Cell::new(true),
            on_path: Cell::new(false),
            abandons: Cell::new(false),
            tape: Cell::new(None),
        }
    };
    static TIMERS: RefCell<Option<Arc<TimerQueue>>> = const { RefCell::new(None) };
    static HOME_THREAD: RefCell<Option<std::sync::Arc<HomeThread>>> = const { RefCell::new(None) };
    /// What the processes of this thread that have ended had of the same.
    static SPARE_HOME_THREADS: Spare<HomeThread> = const { Spare::new() };
}

/// Marks this thread as `home` with its `timers` until the guard is dropped. `may_block`: its processes may make blocking calls,
/// since it runs one alone.
///
/// # Panics
///
/// If another thread is this home: what is done without atomics at home relies on there being one. If the thread is a home already: a process must not run a system or an executor inside itself, since that would block its own.
/// Ask [`home`] first where the outside decides.
pub fn enter_home(home: Home, timers: Arc<TimerQueue>, may_block: bool) -> HomeGuard {
    assert!(self::home().is_none(), "this thread runs processes already");
    entered::enter(home);
    crate::backend::fence::prepare();
    THREAD.with(|thread| {
        thread.home.set(Some(home));
        thread.may_block.set(may_block);
    });
    TIMERS.with(|slot| *slot.borrow_mut() = Some(timers));
    // What a plain thread was lent counts while it is a home too: two records of one thread would each restore what the other had set.
    let thread = match home_thread::known_plain() {
        Some(plain) => {
            plain.refresh();
            plain
        }
        None => HomeThread::new(),
    };
    SPARE_HOME_THREADS.with(|spare| spare.keep(&thread));
    HOME_THREAD.with(|slot| *slot.borrow_mut() = Some(thread));
    HomeGuard { home }
}

/// Ends what [`enter_home`] began.
#[derive(Debug)]
#[must_use = "the thread stops being a home when the guard is dropped"]
pub struct HomeGuard {
    home: Home,
}

impl Drop for HomeGuard {
    fn drop(&mut self) {
        THREAD.with(|thread| {
            thread.home.set(None);
            thread.may_block.set(true);
            thread.queue.pretend(0);
        });
        set_on_path(false);
        TIMERS.with(|slot| slot.borrow_mut().take());
        SPARE_HOME_THREADS.with(Spare::release);
        if let Some(thread) = HOME_THREAD.with(|slot| slot.borrow_mut().take())
            && !thread.is_plain()
        {
            thread.leave();
        }
        entered::leave(self.home);
    }
}

/// Which homes threads are now.
#[cfg(not(loom))]
mod entered {
    use super::Home;
    use crate::lock::PiLock;

    static ENTERED: PiLock<Vec<Home>> = PiLock::new(Vec::new());

    pub(super) fn enter(home: Home) {
        let mut entered = ENTERED.lock();
        let is_free = !entered.contains(&home);
        if is_free {
            entered.push(home);
        }
        drop(entered);
        assert!(is_free, "another thread is this home");
    }

    pub(super) fn leave(home: Home) {
        ENTERED.lock().retain(|&other| other != home);
    }
}

/// A model's threads share their locals, and none is a home.
#[cfg(loom)]
mod entered {
    pub(super) fn enter(_: super::Home) {}

    pub(super) fn leave(_: super::Home) {}
}

/// The home that this thread is, if it runs processes.
#[inline]
pub fn home() -> Option<Home> {
    THREAD.with(|thread| thread.home.get())
}

/// The number of the home that this thread is; 0 if it runs no processes.
#[inline(always)]
pub(crate) fn home_number() -> u64 {
    THREAD.with(|thread| thread.home.get().map_or(0, Home::number))
}

/// What is known of the thread of `home`, if this is it.
fn home_thread_of(home: Home) -> Option<std::sync::Arc<HomeThread>> {
    if self::home() != Some(home) {
        return None;
    }
    HOME_THREAD.with(|slot| {
        let slot = slot.borrow();
        let thread = slot.as_ref()?;
        Some(SPARE_HOME_THREADS.with(|spare| spare.another(thread)))
    })
}

/// Ends a reference that [`home_thread_of`] gave.
fn give_back_home_thread(thread: std::sync::Arc<HomeThread>) {
    // A thread that is ending keeps none any more.
    let _ = SPARE_HOME_THREADS.try_with(move |spare| spare.give_back(thread));
}

/// The calling thread, for what it was lent itself: as a home, or as a plain one. None while it ends, and in a model.
fn this_thread() -> Option<std::sync::Arc<HomeThread>> {
    #[cfg(not(loom))]
    return HOME_THREAD
        .try_with(|slot| slot.borrow().clone())
        .ok()?
        .or_else(home_thread::plain);
    #[cfg(loom)]
    None
}

/// Whether a blocking call on this thread holds up nobody else: not on an executor's thread.
pub fn may_block() -> bool {
    THREAD.with(|thread| thread.may_block.get())
}

/// The timers of this thread, if it runs processes.
pub fn timers() -> Option<Arc<TimerQueue>> {
    TIMERS.with(|slot| slot.borrow().clone())
}

/// Whether no deadline of this thread's processes comes within `time`. A clock reading if there is any deadline.
#[cfg(not(loom))]
pub(crate) fn has_no_deadline_within(time: std::time::Duration) -> bool {
    let next = TIMERS.with(|slot| slot.borrow().as_ref().map(|timers| timers.next_deadline()));
    let next = next.unwrap_or(crate::clock::Instant::NEVER);
    next == crate::clock::Instant::NEVER || crate::clock::Instant::now() + time < next
}

/// Whether `timers` are other ones than those of this thread, which runs processes.
pub(crate) fn has_other_timers(timers: &Arc<TimerQueue>) -> bool {
    TIMERS.with(|slot| {
        slot.borrow()
            .as_ref()
            .is_some_and(|own| !Arc::ptr_eq(own, timers))
    })
}

/// Runs `poll` with `process` as the current one.
///
/// # Safety
///
/// This thread is the process' home, and the process has not ended.
#[inline]
pub unsafe fn with_process<R>(process: &Process, poll: impl FnOnce() -> R) -> R {
    struct Restore<'a> {
        running: &'a Process,
        process: Option<NonNull<Process>>,
        branch: Branch,
    }
    impl Drop for Restore<'_> {
        #[inline]
        fn drop(&mut self) {
            self.running.end_turn();
            THREAD.with(|thread| {
                thread.process.set(self.process);
                thread.branch.set(self.branch);
            });
        }
    }
    process.begin_turn();
    let _restore = THREAD.with(|thread| {
        thread.operations_left.set(OPERATIONS_PER_POLL);
        Restore {
            running: process,
            process: thread.process.replace(Some(NonNull::from(process))),
            branch: thread.branch.replace(Branch::WHOLE),
        }
    });
    poll()
}

/// Runs `poll` with `process`, one of an executor's, as the current one, where none was before; says whether it is ready again. If `poll` panics, the process stays
/// the current one: whoever catches that asks [`take_interrupted`] for it. So a turn needs nothing that catches panics.
///
/// # Safety
///
/// As for [`with_process`]; and if the panic is caught, the process lives until it was taken.
#[inline]
pub unsafe fn give_turn<R>(process: &Process, poll: impl FnOnce() -> R) -> (R, bool) {
    process.begin_turn();
    THREAD.with(|thread| {
        thread.operations_left.set(OPERATIONS_PER_POLL);
        thread.process.set(Some(NonNull::from(process)));
    });
    let polled = poll();
    THREAD.with(|thread| thread.process.set(None));
    (polled, process.end_turn())
}

/// Runs `f` as if no process had its turn: for what is done in the middle of one, and is none of its own. If `f` panics, the turn goes on all the same.
pub fn outside<R>(f: impl FnOnce() -> R) -> R {
    struct Restore(Option<NonNull<Process>>, Branch);
    impl Drop for Restore {
        fn drop(&mut self) {
            THREAD.with(|thread| {
                thread.process.set(self.0);
                thread.branch.set(self.1);
            });
        }
    }
    let _restore = THREAD.with(|thread| {
        Restore(
            thread.process.replace(None),
            thread.branch.replace(Branch::WHOLE),
        )
    });
    f()
}

/// The process whose turn a panic has ended, and whether it is ready again; from here on it is not the current one any more.
pub fn take_interrupted() -> Option<(NonNull<Process>, bool)> {
    THREAD.with(|thread| {
        thread.branch.set(Branch::WHOLE);
        let process = thread.process.take()?;
        // SAFETY: the contract of `give_turn`.
        Some((process, unsafe { process.as_ref() }.end_turn()))
    })
}

/// The current process, if its turn is a plain one: it is an executor's, `cx` has its own waker and no combinator's, and no branch of it is
/// being polled that failed or runs at another level. Nearly all polls are.
#[inline(always)]
pub fn plain_turn<'a>(cx: &Context<'a>) -> Option<&'a Process> {
    turn(cx, Process::is_owned)
}

/// As [`plain_turn`], of a process whose events nobody records ([`Process::set_recorded`]): so who asks for this tells none of it.
#[inline(always)]
pub fn unrecorded_turn<'a>(cx: &Context<'a>) -> Option<&'a Process> {
    turn(cx, Process::is_owned_unrecorded)
}

#[inline(always)]
fn turn<'a>(cx: &Context<'a>, is_owned: impl FnOnce(&Process) -> bool) -> Option<&'a Process> {
    let (current, branch) = THREAD.with(|thread| (thread.process.get(), thread.branch.get()));
    // SAFETY: the pointer is that of a process which is being polled, so it is live now. It is live for longer if its waker is what `cx`
    // borrows, since the waker lies in it.
    let process = unsafe { &*current?.as_ptr() };
    (process.is_polled_by(cx) && branch.is_plain() && is_owned(process)).then_some(process)
}

/// The process whose turn this is, for who knows that there is one.
///
/// # Safety
///
/// There is one, and its turn lasts as long as the reference is used.
#[inline(always)]
pub unsafe fn this_process<'a>() -> &'a Process {
    let current = THREAD.with(|thread| thread.process.get());
    // SAFETY: the contract; a process that is being polled is live.
    unsafe { &*current.unwrap_unchecked().as_ptr() }
}

/// Calls `f` with the current process, if there is one.
#[inline]
pub fn process<R>(f: impl FnOnce(Option<&Process>) -> R) -> R {
    let current = THREAD.with(|thread| thread.process.get());
    // SAFETY: `with_process` sets the pointer from a reference that lives until it restores the one before, and the closure
    // cannot keep what it is lent.
    f(current.map(|process| unsafe { process.as_ref() }))
}

/// Who is at work on this thread: the current process, or somebody outside of all.
#[inline]
pub fn user() -> User {
    process(|process| process.map_or(User::Outside, |process| User::Process(process.id())))
}

/// How urgent the current process is, or the branch of it that is being polled; the lowest priority where there is none.
#[inline]
pub fn priority() -> Priority {
    process(|process| {
        process
            .map(|process| process.lowered_priority(lowered()))
            .unwrap_or_default()
    })
}

/// How many levels the branch that is being polled runs below its process.
#[inline]
fn lowered() -> u8 {
    THREAD.with(|thread| thread.branch.get().lowered())
}

#[inline]
fn with_queue<R>(f: impl FnOnce(&RunQueue) -> R) -> R {
    THREAD.with(|thread| f(&thread.queue))
}

/// The levels at which this thread's executor has a ready process, one bit each.
#[inline]
pub fn ready_levels() -> u32 {
    with_queue(RunQueue::bits)
}

/// Lets the processes of this thread, which is no executor's, believe that at these levels others are ready: for tests.
#[doc(hidden)]
pub fn pretend_ready_levels(bits: u32) {
    with_queue(|queue| queue.pretend(bits));
}

/// Takes the process whose turn it is out of this thread's run queue, and gives its owner. It was readied by [`Process::ready_at`] or a wakeup, and is live as
/// long as its owner keeps it.
#[inline(always)]
pub fn next_ready() -> Option<NonNull<()>> {
    Some(with_queue(RunQueue::pop)?.cast())
}

/// Whether a process of higher level than the current one, or the current branch, is ready on its executor: then a completed
/// communication lets it run.
#[inline]
pub fn is_outranked() -> bool {
    THREAD.with(|thread| {
        thread.process.get().is_some_and(|process| {
            // SAFETY: as in `process`.
            let process = unsafe { process.as_ref() };
            let level = process
                .level()
                .saturating_sub(thread.branch.get().lowered());
            // Two shifts, since a shift by 32 is none.
            (thread.queue.bits() >> level) >> 1 != 0
        })
    })
}

/// Readies the current process again, at `place` among those of its level; more urgent ones run before it in any case. The caller
/// returns `Pending`. Where no process of LUNA runs, or a combinator within it polls, the waker is woken.
#[inline]
pub fn ready_again(cx: &Context<'_>, place: Place) {
    process(|process| match process {
        // SAFETY: this is the home's thread, and the process lives while it is polled.
        Some(process) if process.is_owned() && process.is_polled_with(cx) => unsafe {
            process.ready_here(lowered(), place);
        },
        _ => cx.waker().wake_by_ref(),
    });
}

/// Lets those run before the current branch that outrank it: if there are any, the process is ready again already, and the caller returns
/// `Pending`. A branch whose process can be readied at its own level alone (it is polled by a combinator with wakers of its own) does not:
/// the process would come again before them.
#[inline]
pub fn give_way(cx: &Context<'_>) -> bool {
    is_outranked() && {
        // A waker readies the process at its own level alone.
        let has_level = lowered() == 0
            || process(|process| {
                process.is_some_and(|own| own.is_owned() && own.is_polled_with(cx))
            });
        if has_level {
            ready_again(cx, Place::First);
        }
        has_level
    }
}

/// Counts an operation that completed without waiting; `false` when this poll has used up [`OPERATIONS_PER_POLL`].
///
/// Always `true` where no process of LUNA runs: other runtimes have means of their own.
#[inline]
pub fn count_operation() -> bool {
    spend_operation() || is_replayed()
}

/// As [`count_operation`], but that it is `false` in a replayed process always: for who has to ask then whether the process may go on.
#[inline]
pub fn spend_operation() -> bool {
    THREAD.with(|thread| {
        if thread.process.get().is_none() {
            return true;
        }
        let left = thread.operations_left.get();
        thread.operations_left.set(left.saturating_sub(1));
        left != 0
    })
}

/// Whether the current process is replayed.
#[cold]
pub fn is_replayed() -> bool {
    tape(|tape| tape.is_replay()).unwrap_or_default()
}

/// Lets others run after an operation of `process`, which has a [plain turn](plain_turn), if they are more urgent or it has completed [`OPERATIONS_PER_POLL`] in
/// this one: then it is ready again already, and the caller returns `Pending`.
#[inline(always)]
pub fn gives_way(process: &Process) -> bool {
    let gives_way = THREAD.with(|thread| {
        if process.is_outranked(thread.queue.bits()) {
            return Some(Place::First);
        }
        let left = thread.operations_left.get();
        if left == 0 {
            return Some(Place::Last);
        }
        thread.operations_left.set(left - 1);
        None
    });
    let Some(place) = gives_way else {
        return false;
    };
    // SAFETY: it is the current process, of an executor, so this is its home's thread and it lives.
    unsafe { process.ready_here(0, place) };
    true
}

/// Whether a branch is being polled, which has siblings that may be ready.
#[inline]
pub fn in_branch() -> bool {
    THREAD.with(|thread| thread.branch.get().0 & Branch::PART != 0)
}

/// Whether a sibling of the branch that is being polled has failed, so that its operations fail as poisoned.
#[inline]
pub fn branch_failed() -> bool {
    THREAD.with(|thread| thread.branch.get().has_failed())
}

/// Ends the branch that is being polled, one of whose siblings has failed: for an operation that then cannot go on, and has no error to
/// return. The caller returns `Pending`; the construct drops the branch where it waits, unless another of the branch's operations has an error to give
/// in the same poll ([`stay_in_branch`]). In case that changes nothing, the branch is polled once more.
pub fn end_branch(cx: &Context<'_>) {
    THREAD.with(|thread| thread.branch_ended.set(true));
    ready_again(cx, Place::Last);
}

/// Takes [`end_branch`] back: an operation gives the branch the error by which it learns of the failure, and may do what it has to.
#[inline]
pub fn stay_in_branch() {
    THREAD.with(|thread| thread.branch_ended.set(false));
}

/// Whether the branch that was just polled is to be dropped. Asked by its construct after each poll in which it knew of a failure.
#[inline]
pub fn take_branch_end() -> bool {
    THREAD.with(|thread| thread.branch_ended.replace(false))
}

/// Polls a branch of a parallel construct, telling it whether a sibling `failed`. Failure reaches nested constructs too.
#[inline]
pub fn with_branch<R>(failed: bool, poll: impl FnOnce() -> R) -> R {
    with_branch_below(failed, 0, 0, poll)
}

/// Polls a branch as [`with_branch`] does, `levels` below whoever polls it, but not below level 0. Its operations wait at that
/// level, and their wakes queue the process there. In nested constructs the levels add up. `number` tells it from its siblings.
#[inline]
pub fn with_branch_below<R>(failed: bool, levels: u8, number: u32, poll: impl FnOnce() -> R) -> R {
    struct Restore(Branch);
    impl Drop for Restore {
        #[inline]
        fn drop(&mut self) {
            THREAD.with(|thread| thread.branch.set(self.0));
        }
    }
    let _restore = THREAD.with(|thread| {
        let before = thread.branch.get();
        thread.branch.set(before.branch(failed, levels, number));
        Restore(before)
    });
    poll()
}

/// Polls the current process as one that has `tape`: it has no [plain turns](plain_turn), and all its operations find the tape.
pub fn with_tape<R>(tape: &dyn Tape, poll: impl FnOnce() -> R) -> R {
    struct Restore(Branch, Option<NonNull<dyn Tape>>);
    impl Drop for Restore {
        fn drop(&mut self) {
            THREAD.with(|thread| {
                thread.branch.set(self.0);
                thread.tape.set(self.1);
            });
        }
    }
    let is_replay = tape.is_replay();
    let tape: *const (dyn Tape + '_) = tape;
    // SAFETY: the same pointer; it is taken back before what it borrows goes, and `tape` lends it for no longer than a call.
    let tape: *mut (dyn Tape + 'static) = unsafe { std::mem::transmute(tape) };
    let _restore = THREAD.with(|thread| {
        let branch = thread.branch.get();
        thread.branch.set(Branch(branch.0 | Branch::TAPED));
        if is_replay {
            // So that each operation that need not wait comes by who asks whether its process may go on.
            thread.operations_left.set(0);
        }
        Restore(branch, thread.tape.replace(NonNull::new(tape)))
    });
    poll()
}

/// Calls `f` as if the current process had no tape: for what is done within one of its operations.
pub fn without_tape<R>(f: impl FnOnce() -> R) -> R {
    struct Restore(Branch);
    impl Drop for Restore {
        fn drop(&mut self) {
            THREAD.with(|thread| thread.branch.set(self.0));
        }
    }
    let _restore = THREAD.with(|thread| {
        let branch = thread.branch.get();
        thread.branch.set(Branch(branch.0 & !Branch::TAPED));
        Restore(branch)
    });
    f()
}

/// Whether the current process has a tape.
#[inline]
pub fn is_taped() -> bool {
    THREAD.with(|thread| thread.branch.get().is_taped())
}

/// Calls `f` with the current process' tape, if it has one.
pub fn tape<R>(f: impl FnOnce(&dyn Tape) -> R) -> Option<R> {
    is_taped().then(|| {
        let tape = THREAD.with(|thread| thread.tape.get())?;
        // SAFETY: `with_tape` sets it from a reference that lives until it takes it back, and the closure cannot keep what it is lent.
        Some(f(unsafe { tape.as_ref() }))
    })?
}

/// Which branch of the current process is being polled, if it has a tape: a number of the way down to it; 0 is the process itself.
pub fn branch_path() -> u32 {
    THREAD.with(|thread| thread.branch.get().path())
}

/// Calls `f`, which drops a process' body, or a branch of it, that has not come to its end: it was cancelled, a sibling has failed, or it panicked.
/// What it held knows by that ([`is_abandoned`]) that it was left in the middle.
pub fn with_abandoned<R>(f: impl FnOnce() -> R) -> R {
    struct Restore(bool);
    impl Drop for Restore {
        fn drop(&mut self) {
            THREAD.with(|thread| thread.abandons.set(self.0));
        }
    }
    let _restore = Restore(THREAD.with(|thread| thread.abandons.replace(true)));
    f()
}

/// Whether what is dropped now belongs to a body or branch that has not come to its end.
#[inline]
pub fn is_abandoned() -> bool {
    THREAD
        .try_with(|thread| thread.abandons.get())
        .unwrap_or(false)
}

/// Whether this thread is on the real-time path: it runs the bodies of processes, or schedules them.
#[inline]
pub fn on_path() -> bool {
    // An allocator asks this too, also while the thread's locals are being torn down.
    THREAD
        .try_with(|thread| thread.on_path.get())
        .unwrap_or(false)
}

/// Says whether this thread is on the real-time path from now on; gives what was said before.
pub fn set_on_path(on_path: bool) -> bool {
    // Whoever watches the path is told while the thread counts as off it.
    let before = THREAD.with(|thread| thread.on_path.replace(false));
    path::switched(on_path);
    THREAD.with(|thread| thread.on_path.set(on_path));
    before
}

#[cfg(all(test, not(loom)))]
mod tests;
