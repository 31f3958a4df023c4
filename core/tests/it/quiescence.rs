//! Whether all threads of a system sleep for good, as their observer sees it; and what a process
//! waits for.

#![cfg(not(loom))]

use crate::support;
use luna_core::timer_queue::Sleep;
use luna_core::{
    Executor, Exit, OsThread, ProcessRegistry, ProcessSpec, Quiescent, block_on_patiently, blocking,
};
use luna_platform::clock::Instant;
use luna_platform::thread::Attributes;
use std::sync::Arc;
use std::time::Duration;
use support::{Gate, until, watchdog};

fn executor(name: &str, registry: &Arc<ProcessRegistry>) -> Executor {
    Executor::start_counted(Attributes::new(name), registry.clone()).unwrap()
}

/// Looks as the thread that runs a system does: sleeps until it is rung, without a deadline.
fn until_still(registry: &ProcessRegistry) -> Quiescent {
    loop {
        let seen = registry.changes();
        if let Some(quiescent) = registry.quiescent() {
            return quiescent;
        }
        registry.wait(seen, Instant::NEVER);
    }
}

#[test]
fn executors_without_work_are_still_and_those_that_are_held_are_not() {
    let _watchdog = watchdog();
    let registry = Arc::new(ProcessRegistry::new());
    let (one, two) = (executor("1", &registry), executor("2", &registry));
    assert!(registry.quiescent().is_none());
    one.release();
    assert!(registry.quiescent().is_none());
    two.release();
    let quiescent = until_still(&registry);
    assert!(registry.is_yet(&quiescent));
    // One that ends is no longer among them; and none of them can be distinguished from before.
    two.stop();
    assert!(!registry.is_yet(&quiescent));
    assert!(registry.is_yet(&until_still(&registry)));
}

#[test]
fn a_wake_ends_the_quiescence_and_another_follows() {
    let _watchdog = watchdog();
    let registry = Arc::new(ProcessRegistry::new());
    let gate = Gate::default();
    let executor = executor("waits", &registry);
    let own = gate.clone();
    let waits = executor.spawn(ProcessSpec::new("waits"), move || async move {
        own.pass().await;
    });
    let (second, own) = (Gate::default(), gate.clone());
    let of_thread = second.clone();
    let thread = OsThread::start_counted(Attributes::new("alone"), registry.clone(), |executor| {
        executor.announce(ProcessSpec::new("alone"), move || async move {
            own.pass().await;
            of_thread.pass().await;
        })
    })
    .unwrap();
    executor.release();
    thread.release();
    let before = until_still(&registry);
    gate.open();
    assert!(!registry.is_yet(&before), "a wake is under way, or was");
    assert_eq!(waits.wait(), Exit::Completed);
    let after = until_still(&registry);
    assert_ne!(before, after);
    second.open();
    assert_eq!(thread.process().wait(), Exit::Completed);
}

#[test]
fn a_deadline_or_a_call_keeps_it_from_being_still() {
    let _watchdog = watchdog();
    let registry = Arc::new(ProcessRegistry::new());
    let executor = executor("busy", &registry);
    let gate = Gate::default();
    let own = gate.clone();
    let process = executor.spawn(ProcessSpec::new("sleeps"), move || async move {
        Sleep::until(Instant::now() + Duration::from_millis(100)).await;
        own.pass().await;
    });
    let (let_go, hold) = std::sync::mpsc::channel::<()>();
    let calls = executor.spawn(ProcessSpec::new("calls"), move || async move {
        blocking(move || hold.recv().is_err()).await;
    });
    let began = Instant::now();
    executor.release();
    until(|| Instant::now() - began > Duration::from_millis(150));
    assert!(registry.quiescent().is_none(), "the call is under way");
    drop(let_go);
    let _ = until_still(&registry);
    assert_eq!(calls.exit(), Some(Exit::Completed));
    assert_eq!(process.exit(), None);
    gate.open();
    assert_eq!(process.wait(), Exit::Completed);
}

#[cfg(unix)]
#[test]
fn a_file_keeps_it_from_being_still_until_the_wait_is_dropped_wherever_that_is() {
    use std::future::{Future, poll_fn};
    use std::task::Poll;
    let _watchdog = watchdog();
    let registry = Arc::new(ProcessRegistry::new());
    let (near, _far) = std::os::unix::net::UnixStream::pair().unwrap();
    let near: &'static _ = Box::leak(Box::new(near));
    let executor = executor("files", &registry);
    let (give, given) = std::sync::mpsc::channel();
    let gate = Gate::default();
    let own = gate.clone();
    let process = executor.spawn(ProcessSpec::new("waits"), move || async move {
        let mut wait = Box::pin(luna_core::readable(near));
        let is_pending = poll_fn(|cx| Poll::Ready(wait.as_mut().poll(cx).is_pending())).await;
        give.send((wait, is_pending)).unwrap();
        own.pass().await;
    });
    executor.release();
    let (wait, is_pending) = given.recv().unwrap();
    if is_pending {
        until(|| gate.waiting() == 1);
        assert!(registry.quiescent().is_none());
    }
    drop(wait);
    let _ = until_still(&registry);
    gate.open();
    assert_eq!(process.wait(), Exit::Completed);
}

#[test]
fn one_that_joins_a_process_is_known() {
    let _watchdog = watchdog();
    let executor = support::executor();
    let gate = Gate::default();
    let own = gate.clone();
    let awaited = executor.spawn(ProcessSpec::new("awaited"), move || async move {
        own.pass().await;
    });
    let joiners: Vec<_> = (0..20)
        .map(|n| {
            let awaited = awaited.clone();
            executor.spawn(ProcessSpec::new(format!("{n}")), move || async move {
                awaited.join().await;
            })
        })
        .collect();
    executor.release();
    until(|| awaited.joiners().len() == 20);
    let mut expected: Vec<_> = joiners.iter().map(|joiner| joiner.id()).collect();
    let mut found = awaited.joiners();
    expected.sort();
    found.sort();
    assert_eq!(found, expected);
    gate.open();
    for joiner in joiners {
        assert_eq!(joiner.wait(), Exit::Completed);
    }
    assert!(awaited.joiners().is_empty());
}

#[test]
fn patience_ends_only_where_nothing_can_wake() {
    let _watchdog = watchdog();
    let short = Duration::from_millis(1);
    let mut reported = 0;
    let outcome = block_on_patiently(
        async {
            Sleep::until(Instant::now() + 20 * short).await;
            blocking(move || std::thread::sleep(20 * short)).await;
        },
        short,
        |_| {
            reported += 1;
            true
        },
    );
    assert_eq!((outcome, reported), (Ok(()), 0));

    // Notified twice, if it requests that, and then no more.
    let gates = [Gate::default(), Gate::default(), Gate::default()];
    let mut closed = gates.iter();
    let (later, outcome) = (
        gates[2].clone(),
        block_on_patiently(
            async {
                for gate in &gates {
                    gate.pass().await;
                }
            },
            short,
            |_| {
                reported += 1;
                closed.next().unwrap().open();
                if reported == 2 {
                    let later = gates[2].clone();
                    std::thread::spawn(move || {
                        until(|| later.waiting() == 1);
                        later.open();
                    });
                }
                reported == 2
            },
        ),
    );
    assert_eq!((outcome, reported, later.waiting()), (Ok(()), 2, 0));
}
