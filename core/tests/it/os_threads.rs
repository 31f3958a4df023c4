//! Processes on threads of their own, and on the calling thread.

#![cfg(not(loom))]

use crate::support;
use luna_core::deferred_free::{self, Shared};
use luna_core::timer_queue::Sleep;
use luna_core::{Exit, Nested, OsThread, ProcessSpec, ProcessState, block_on, yield_now};
use luna_platform::clock::Instant;
use luna_platform::thread::Attributes;
use std::future::{Future, pending};
use std::rc::Rc;
use std::sync::Mutex;
use std::time::Duration;
use support::{Drops, Gate, Log, quiet_panics, until, watchdog};

fn start<F: Future<Output = ()> + 'static>(build: impl FnOnce() -> F + Send + 'static) -> OsThread {
    OsThread::start(Attributes::new("test"), ProcessSpec::new("alone"), build).unwrap()
}

#[test]
fn held_until_released() {
    let _watchdog = watchdog();
    let log = Log::new();
    let own = log.clone();
    let thread = start(move || {
        own.add("built");
        async move { own.add("ran") }
    });
    assert_eq!(log.take(), ["built"], "built when `start` returns");
    assert_eq!(
        (thread.process().polls(), thread.process().state()),
        (0, ProcessState::Ready)
    );
    thread.release();
    assert_eq!(thread.process().wait(), Exit::Completed);
    assert_eq!((log.take(), thread.process().polls()), (vec!["ran"], 1));
    until(|| thread.has_stopped());
    thread.release();
    thread.request_stop();
    assert_eq!(thread.process().exit(), Some(Exit::Completed));
}

#[test]
fn what_it_frees_is_freed_while_it_blocks() {
    let _watchdog = watchdog();
    let drops = Drops::default();
    let shared = Shared::new(Mutex::new(drops.token()));
    let (open, blocked) = std::sync::mpsc::channel::<()>();
    let thread = start(move || async move {
        drop(shared);
        blocked.recv().unwrap();
    });
    thread.release();
    // It has kept nothing to itself: any thread can free it.
    until(|| {
        deferred_free::collect();
        drops.count() == 1
    });
    open.send(()).unwrap();
    assert_eq!(thread.process().wait(), Exit::Completed);
}

#[test]
fn dropped_while_held_parked_and_ended() {
    let _watchdog = watchdog();
    let drops = Drops::default();
    for released in [false, true] {
        let token = drops.token();
        let thread = start(move || async move {
            let _token = token;
            pending::<()>().await;
        });
        if released {
            thread.release();
            until(|| thread.process().state() == ProcessState::Waiting);
        }
        let process = thread.process().clone();
        drop(thread);
        assert_eq!(
            (process.exit(), process.polls()),
            (Some(Exit::Cancelled), u64::from(released))
        );
    }
    assert_eq!(drops.count(), 2);
}

#[test]
fn cancelled_while_parked_by_a_thread_and_by_a_process() {
    let _watchdog = watchdog();
    for from_process in [false, true] {
        let gate = Gate::default();
        let wait = gate.clone();
        let thread = start(move || async move { wait.pass().await });
        thread.release();
        until(|| thread.process().state() == ProcessState::Waiting);
        let process = thread.process().clone();
        let cancel = move || process.cancel();
        if from_process {
            block_on(async { cancel() }).unwrap();
        } else {
            cancel();
        }
        assert_eq!(thread.process().wait(), Exit::Cancelled);
        gate.open();
    }
}

#[test]
fn a_blocking_call_is_allowed_where_nobody_else_runs() {
    let _watchdog = watchdog();
    let other = start(|| async { yield_now().await });
    other.release();
    let process = other.process().clone();
    let thread = start(move || async move { assert_eq!(process.wait(), Exit::Completed) });
    thread.release();
    assert_eq!(thread.process().wait(), Exit::Completed);
}

#[test]
fn a_blocking_call_on_an_executor_is_a_panic_that_says_so() {
    let _watchdog = watchdog();
    let executor = support::executor();
    let other = executor.spawn(ProcessSpec::new("other"), || async { pending().await });
    let process = executor.spawn(ProcessSpec::new("blocks"), move || async move {
        drop(other.wait())
    });
    executor.release();
    let exit = process.wait();
    assert!(
        matches!(&exit, Exit::Panicked(text) if text.contains("await the operation instead")),
        "{exit}"
    );
}

#[test]
fn panics_and_builders_that_panic() {
    let _watchdog = watchdog();
    quiet_panics();
    let thread = start(|| async { panic!("on purpose") });
    thread.release();
    assert_eq!(thread.process().wait(), Exit::Panicked("on purpose".into()));
    let thread = start(|| {
        if Instant::now() > Instant::from_nanos(0) {
            panic!("on purpose, in the builder");
        }
        async {}
    });
    assert_eq!(
        thread.process().wait(),
        Exit::Panicked("on purpose, in the builder".into())
    );
}

#[test]
fn block_on_borrows_and_refuses_to_nest() {
    let _watchdog = watchdog();
    let mut text = String::from("a");
    let not_send = Rc::new(1);
    let length = block_on(async {
        yield_now().await;
        text.push('b');
        assert_eq!(block_on(async {}), Err(Nested));
        text.len() + *not_send
    });
    assert_eq!((length, text.as_str()), (Ok(3), "ab"));
    assert!(Nested.to_string().contains("await it instead"));
    let executor = support::executor();
    let log = Log::new();
    let own = log.clone();
    executor.spawn(ProcessSpec::new("nests"), move || async move {
        own.add(block_on(async {}))
    });
    executor.release();
    until(|| log.len() == 1);
    assert_eq!(log.take(), [Err(Nested)]);
}

#[test]
fn block_on_again_after_a_panic() {
    let _watchdog = watchdog();
    quiet_panics();
    assert!(std::panic::catch_unwind(|| block_on(async { panic!("on purpose") })).is_err());
    assert_eq!(block_on(async { 1 }), Ok(1));
}

#[test]
fn a_process_that_always_readies_itself_again_has_deadlines_all_the_same() {
    let _watchdog = watchdog();
    let until = Instant::now() + Duration::from_millis(3);
    block_on(futures_lite::future::or(Sleep::until(until), async {
        loop {
            yield_now().await;
        }
    }))
    .unwrap();
    assert!(Instant::now() >= until);
}

#[test]
fn a_deadline_is_one_poll() {
    let _watchdog = watchdog();
    let thread = start(|| async {
        for _ in 0..5 {
            Sleep::until(Instant::now() + Duration::from_millis(1)).await;
        }
    });
    thread.release();
    assert_eq!(thread.process().wait(), Exit::Completed);
    // The release is a wake too, which may still be there after the first poll. On a slow machine a
    // deadline may have passed.
    assert!(thread.process().polls() <= 7);
}
