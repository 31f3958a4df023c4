//! Branches below their process.

use super::*;
use crate::timer_queue::TimerQueue;
use luna_platform::sync::Arc;
use std::task::{Context, Wake, Waker};

static METHODS: Methods =
    Methods::without_body(|_, _| unreachable!("all is on one thread"), |_| {});

/// Counts its wakes; panics in them if set.
#[derive(Default)]
struct Counted {
    wakes: std::sync::atomic::AtomicU32,
    panics: bool,
}

impl Wake for Counted {
    fn wake(self: std::sync::Arc<Self>) {
        self.wakes.fetch_add(1, std::sync::atomic::Ordering::SeqCst);
        assert!(!self.panics, "a waker that panics");
    }
}

fn pending_wake(counted: &std::sync::Arc<Counted>) -> PendingWake {
    let waker = Waker::from(counted.clone());
    WakeHandle::of(&Context::from_waker(&waker)).take()
}

#[test]
fn a_pending_wake_wakes_once_also_if_it_is_dropped() {
    let counted = std::sync::Arc::new(Counted::default());
    let wakes = || counted.wakes.load(std::sync::atomic::Ordering::SeqCst);
    pending_wake(&counted).wake();
    assert_eq!(wakes(), 1);
    drop(pending_wake(&counted));
    assert_eq!(wakes(), 2);
    assert_eq!(std::sync::Arc::strong_count(&counted), 1);
}

#[test]
fn a_wakers_panic_is_contained_while_another_one_unwinds() {
    let counted = std::sync::Arc::new(Counted {
        panics: true,
        ..Counted::default()
    });
    let wakes = || counted.wakes.load(std::sync::atomic::Ordering::SeqCst);
    let caught = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| {
        let _second = pending_wake(&counted);
        pending_wake(&counted).wake();
    }));
    assert!(caught.is_err() && wakes() == 2, "both have been woken");
    // A thread that wakes on behalf of others goes on.
    pending_wake(&counted).wake_contained();
    assert_eq!(wakes(), 3);
}

/// Does nothing; distinct from all other wakers.
struct Unused;

impl Wake for Unused {
    fn wake(self: std::sync::Arc<Self>) {}
}

/// The level at which the process was readied; it is in no queue afterwards.
fn readied() -> u8 {
    let before = ready_levels();
    // SAFETY: it counts as one that has its turn again before it is readied.
    assert!(unsafe { next_ready() }.is_some(), "it is not ready");
    let level = (before & !ready_levels()).ilog2();
    // It was given no turn, so it counts as ready still.
    process(|process| process.expect("one is current").begin_turn());
    level as u8
}

/// Makes this level ready, and none else, or none.
fn pretend(level: Option<u8>) {
    // SAFETY: what is taken out is used no more. The new process is leaked, and never polled.
    unsafe {
        while next_ready().is_some() {}
        if let Some(level) = level {
            let executor_id = executor_id().expect("this thread is an executor's");
            let other = Process::new(ProcessId::new(), executor_id, 0, level);
            let other = NonNull::from(Box::leak(Box::new(other)));
            Process::set_methods(other, &METHODS);
            other.as_ref().ready_at(level, QueueEnd::Back);
        }
    }
}

/// Calls `f` within a process of this level.
fn within(level: u8, f: impl FnOnce(&Context<'_>)) {
    let executor_id = ExecutorId::new();
    let _entered = enter_executor(executor_id, Arc::new(TimerQueue::new()), false);
    let process = &Process::new(ProcessId::new(), executor_id, 0, level);
    // SAFETY: the process is polled below, on this thread, and is not used after `f`; its methods
    // ignore the owner.
    unsafe {
        process.set_waker(Waker::from(std::sync::Arc::new(Unused)));
        Process::set_methods(NonNull::from(process), &METHODS);
        let waker = process.waker().expect("it was set above").clone();
        with_process(process, || f(&Context::from_waker(&waker)));
    }
}

fn level() -> u8 {
    priority().level
}

#[test]
fn levels_of_nested_branches_add_up_and_end_at_the_lowest() {
    within(5, |_| {
        assert_eq!(level(), 5);
        with_branch_below(false, 2, 0, || {
            assert_eq!(level(), 3);
            with_branch_below(true, 0, 0, || {
                assert_eq!((level(), branch_failed()), (3, true));
                with_branch_below(false, 1, 0, || {
                    assert_eq!((level(), branch_failed()), (2, true))
                });
            });
            with_branch_below(false, 200, 0, || {
                with_branch_below(false, 200, 0, || assert_eq!(level(), 0));
            });
            assert_eq!((level(), branch_failed()), (3, false));
        });
        assert_eq!(level(), 5);
    });
}

#[test]
fn a_branch_is_outranked_by_what_its_process_is_not() {
    within(5, |_| {
        pretend(Some(4));
        assert!(!is_outranked());
        with_branch_below(false, 1, 0, || assert!(!is_outranked()));
        with_branch_below(false, 2, 0, || assert!(is_outranked()));
        pretend(None);
    });
}

#[test]
fn wakeups_ready_at_the_level_of_the_branch_that_made_them() {
    within(5, |cx| {
        let (own, other) =
            with_branch_below(false, 2, 0, || (WakeHandle::of(cx), WakeHandle::of(cx)));
        assert!(!own.is_of(cx), "the process itself is readied elsewhere");
        with_branch_below(false, 2, 0, || assert!(own.is_of(cx)));
        own.take().wake();
        assert_eq!(readied(), 3);
        with_branch_below(false, 9, 0, || ready_again(cx, QueueEnd::Front));
        assert_eq!(readied(), 0);
        drop(other);
        ready_again(cx, QueueEnd::Back);
        assert_eq!(readied(), 5);
    });
}

#[test]
fn one_that_is_ready_is_queued_once_at_the_highest_level_it_was_readied_at() {
    within(5, |cx| {
        for levels in [1, 4, 2] {
            with_branch_below(false, levels, 0, || ready_again(cx, QueueEnd::Back));
        }
        assert_eq!(ready_levels(), 1 << 4);
        assert_eq!(readied(), 4);
        with_branch_below(false, 3, 0, || ready_again(cx, QueueEnd::Back));
        ready_again(cx, QueueEnd::Back);
        assert_eq!(ready_levels(), 1 << 5);
        assert_eq!(readied(), 5);
        // SAFETY: the queue is empty, so no process is taken.
        assert_eq!(unsafe { next_ready() }, None);
        // SAFETY: this is its executor's thread.
        process(|process| unsafe { process.expect("one is current").set_ended(0) });
        ready_again(cx, QueueEnd::Back);
        // SAFETY: the queue is empty, so no process is taken.
        let next = unsafe { next_ready() };
        assert_eq!(next, None, "an ended process is not readied");
    });
}

#[test]
fn a_turn_that_panics_is_known_to_the_one_that_catches_it() {
    let executor_id = ExecutorId::new();
    let _entered = enter_executor(executor_id, Arc::new(TimerQueue::new()), false);
    let process = &Process::new(ProcessId::new(), executor_id, 0, 3);
    // SAFETY: the process lives on, and its methods ignore the owner.
    unsafe {
        Process::set_methods(NonNull::from(process), &METHODS);
        process.ready_at(3, QueueEnd::Back);
        assert_eq!(process.activity(), ProcessState::Ready);
        let next = next_ready().expect("it is ready");
        let caught = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| {
            give_turn(next.as_ref(), || {
                assert_eq!(next.as_ref().activity(), ProcessState::Running);
                std::panic::resume_unwind(Box::new(()))
            })
        }));
        assert!(caught.is_err());
        assert_eq!(user(), User::Process(process.id()));
        assert_eq!(take_interrupted(), Some(next));
        assert!(!process.is_queued());
        assert_eq!((user(), take_interrupted()), (User::Outside, None));
        assert_eq!(process.activity(), ProcessState::Waiting);
    }
}

#[test]
fn a_waker_makes_its_process_yield_in_its_own_whole_turn_alone() {
    within(5, |_| {
        process(|process| {
            let process = process.expect("one is current");
            with_branch_below(false, 0, 0, || assert!(!process.yields_to_wake()));
            with_branch_below(false, 1, 0, || assert!(!process.yields_to_wake()));
            // SAFETY: no plain turn is used.
            unsafe { outside(|| assert!(!process.yields_to_wake())) };
            assert!(process.yields_to_wake());
            assert_eq!(ready_levels(), 0, "it is queued when its turn is over");
            // SAFETY: this is its turn, on its executor's thread, which forgets it afterwards.
            unsafe { process.end_turn() };
            assert_eq!(ready_levels(), 1 << 5);
        });
    });
}

#[test]
fn a_process_within_a_branch_is_whole() {
    within(5, |_| {
        with_branch_below(true, 3, 0, || {
            let inner = Process::new(ProcessId::new(), executor_id().unwrap(), 0, 7);
            // SAFETY: this is its executor's thread.
            unsafe {
                with_process(&inner, || {
                    assert_eq!((level(), branch_failed()), (7, false))
                });
            }
            assert_eq!((level(), branch_failed()), (2, true));
        });
    });
}

#[test]
fn a_branch_gives_way_only_if_its_process_comes_again_behind() {
    within(5, |cx| {
        pretend(Some(4));
        assert!(!yield_if_outranked(cx), "not outranked");
        with_branch_below(false, 2, 0, || {
            assert!(yield_if_outranked(cx));
            assert!(!yield_if_outranked(&Context::from_waker(Waker::noop())));
        });
        assert_eq!(ready_levels(), 1 << 4 | 1 << 3);
        // SAFETY: what was pretended is not used.
        assert!(unsafe { next_ready() }.is_some());
        assert_eq!(readied(), 3);
        pretend(Some(6));
        // At the process' own level a waker readies it behind what is more urgent, too.
        assert!(yield_if_outranked(&Context::from_waker(Waker::noop())));
        assert_eq!(ready_levels(), 1 << 6, "such a waker queues nobody here");
        pretend(None);
    });
}

/// The codes and subjects of a thread's events.
#[cfg(feature = "events")]
#[derive(Clone, Default)]
struct Noted(Arc<std::sync::Mutex<Vec<(u16, u32)>>>);

#[cfg(feature = "events")]
impl crate::events::Trace for Noted {
    fn put(&self, code: u16, subject: u32, _: [u64; 2]) -> bool {
        self.0.lock().unwrap().push((code, subject));
        true
    }

    fn place(&self) -> (u64, u32) {
        (0, 0)
    }
}

#[test]
fn a_traced_process_is_readied_as_others_are_and_has_turns_of_its_own_kind() {
    let executor_id = ExecutorId::new();
    let _entered = enter_executor(executor_id, Arc::new(TimerQueue::new()), false);
    let process = &Process::new(ProcessId::new(), executor_id, 0, 3);
    #[cfg(feature = "events")]
    let traced = {
        let noted = Noted::default();
        crate::events::attach(Box::new(noted.clone()));
        noted
    };
    // SAFETY: the process lives on, and its methods ignore the owner. It is polled by this thread
    // alone, with its own waker.
    unsafe {
        process.set_waker(Waker::from(std::sync::Arc::new(Unused)));
        Process::set_methods(NonNull::from(process), &METHODS);
        process.set_traced();
        process.ready_at(3, QueueEnd::Back);
        process.ready_at(3, QueueEnd::Back);
        for _ in 0..2 {
            let next = next_ready().expect("it is ready");
            assert_eq!(next_ready(), None, "it is queued once");
            let cx = Context::from_waker(next.as_ref().waker().expect("it was set above"));
            give_turn(next.as_ref(), || {
                process.keep_traced();
                assert!(plain_turn(&cx).is_none());
                ready_again(&cx, QueueEnd::Back);
            });
            assert!(next.as_ref().is_queued());
        }
    }
    #[cfg(feature = "events")]
    {
        use crate::events::code;
        crate::events::detach();
        // Readied once from outside, and once in each turn.
        let ready = (code::READY, process.id().get());
        assert_eq!(*traced.0.lock().unwrap(), [ready; 3]);
    }
}

#[test]
#[cfg(target_pointer_width = "64")]
fn what_each_turn_touches_of_its_thread_is_one_cache_line() {
    let tails = std::mem::offset_of!(Thread, queue) + std::mem::offset_of!(RunQueue, tails);
    assert!(tails <= 64, "{tails}");
    THREAD.with(|thread| assert_eq!(std::ptr::from_ref(thread).addr() % 64, 0));
}
