//! Blocking calls of processes that share an executor.

use crate::common;
use common::{PLACEMENTS, SpawnOk, in_process, watchdog};
use futures_lite::future;
use luna::prelude::*;
use luna::{Error, Exit};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Barrier, mpsc};

#[test]
fn the_executor_goes_on_meanwhile() {
    let _watch = watchdog();
    let (release, released) = mpsc::channel();
    let mut system = System::new("meanwhile");
    let executor = system.executor("main").build().unwrap();
    executor
        .process("calling")
        .priority(20)
        .spawn_ok(async move {
            // Comes back only when the other process of the executor has run.
            assert_eq!(luna::blocking(move || released.recv()).await, Ok(7));
            Ok(())
        });
    executor
        .process("other")
        .priority(10)
        .spawn_ok(async move { release.send(7).map_err(Error::other) });
    system.run().unwrap();
}

#[test]
fn a_call_runs_on_an_ordinary_thread_of_its_own() {
    let _watch = watchdog();
    for place in PLACEMENTS {
        let mut system = System::new("where");
        let process = place.process(&mut system, "place", "calling");
        process.spawn_ok(async {
            let own = std::thread::current().id();
            let call = luna::blocking(move || {
                assert_ne!(std::thread::current().id(), own);
                assert!(!luna::realtime::on_path());
                let name = std::thread::current().name().map(str::to_owned);
                (name, luna_platform::thread::current_policy())
            });
            assert_eq!(call.await, (Some("luna-buddy".to_owned()), Policy::Other));
            assert_eq!(std::thread::current().id(), own);
            Ok(())
        });
        system.run().unwrap();
    }
}

#[test]
fn a_hundred_at_once() {
    let _watch = watchdog();
    let calls = Arc::new(AtomicUsize::new(0));
    let mut system = System::new("hundred");
    let executor = system.executor("main").build().unwrap();
    for number in 0..100 {
        let calls = calls.clone();
        executor
            .process(format!("calling {number}"))
            .spawn_ok(async move {
                for round in 0..3 {
                    let calls = calls.clone();
                    let call = luna::blocking(move || {
                        calls.fetch_add(1, Ordering::Relaxed);
                        std::thread::yield_now();
                        number * round
                    });
                    assert_eq!(call.await, number * round);
                }
                Ok(())
            });
    }
    system.run().unwrap();
    assert_eq!(calls.load(Ordering::Relaxed), 300);
}

#[test]
fn calls_that_wait_for_each_other() {
    let _watch = watchdog();
    // Each needs a thread until all are there; the tests of this program share the pool.
    const TOGETHER: usize = 24;
    let barrier = Arc::new(Barrier::new(TOGETHER));
    let leaders = Arc::new(AtomicUsize::new(0));
    let mut system = System::new("together");
    let executors = ["left", "right"].map(|name| system.executor(name).build().unwrap());
    for number in 0..TOGETHER {
        let (barrier, leaders) = (barrier.clone(), leaders.clone());
        executors[number % 2]
            .process(format!("calling {number}"))
            .spawn_ok(async move {
                let is_leader = luna::blocking(move || barrier.wait().is_leader()).await;
                leaders.fetch_add(usize::from(is_leader), Ordering::Relaxed);
                Ok(())
            });
    }
    system.run().unwrap();
    assert_eq!(leaders.load(Ordering::Relaxed), 1);
}

#[test]
fn a_chain_of_calls_started_from_its_end() {
    let _watch = watchdog();
    luna::run(async {
        let (first, mut before) = mpsc::channel();
        let mut calls = Vec::new();
        for _ in 0..24 {
            let (next, after) = mpsc::channel();
            let mine = std::mem::replace(&mut before, after);
            calls.push(luna::blocking(move || {
                next.send(mine.recv().unwrap() + 1).unwrap()
            }));
        }
        // All are started before the first can end.
        for call in calls.iter_mut().rev() {
            assert!(future::poll_once(call).await.is_none());
        }
        first.send(0).unwrap();
        for call in calls {
            call.await;
        }
        assert_eq!(before.recv(), Ok(24));
        Ok(())
    })
    .unwrap();
}

#[test]
fn a_panic_passes_through() {
    let _watch = watchdog();
    let call = || luna::blocking(|| -> u8 { panic!("in the call") });
    let outcome = std::panic::catch_unwind(|| luna::run(async { Ok(call().await) }));
    assert_eq!(outcome.unwrap_err().downcast_ref(), Some(&"in the call"));

    let mut system = System::new("panicking");
    let executor = system.executor("main").build().unwrap();
    let calling = async { luna::blocking(|| -> luna::Result<()> { panic!("number {}", 7) }).await };
    let id = executor.process("calling").spawn_ok(calling);
    let panicked = Error::Panicked("number 7".to_owned());
    assert_eq!(system.run().unwrap_err(), in_process("calling", panicked));
    assert_eq!(
        system.process_handle(id).unwrap().exit(),
        Some(Exit::Panicked("number 7".to_owned()))
    );

    // The pool has survived it.
    assert_eq!(luna::run(async { Ok(luna::blocking(|| 1).await) }), Ok(1));
}

#[test]
fn one_that_is_never_polled_is_never_made() {
    let _watch = watchdog();
    let counted = Arc::new(());
    let value = counted.clone();
    drop(luna::blocking(move || value));
    assert_eq!(Arc::strong_count(&counted), 1);
}

#[test]
fn one_that_is_dropped_runs_to_its_end_and_its_result_is_forgotten() {
    let _watch = watchdog();
    let (release, released) = mpsc::channel::<()>();
    let (ended, has_ended) = mpsc::channel();
    struct Result(mpsc::Sender<&'static str>);
    impl Drop for Result {
        fn drop(&mut self) {
            self.0.send("result dropped").unwrap();
        }
    }
    luna::run(async {
        let call = luna::blocking(move || {
            released.recv().unwrap();
            ended.send("call ended").unwrap();
            Result(ended)
        });
        assert!(future::poll_once(call).await.is_none());
        Ok(())
    })
    .unwrap();
    // The process that made it is gone; the call is not.
    release.send(()).unwrap();
    assert_eq!(has_ended.recv(), Ok("call ended"));
    assert_eq!(has_ended.recv(), Ok("result dropped"));
}

#[test]
fn a_process_that_is_cancelled_in_one() {
    let _watch = watchdog();
    let (begun, has_begun) = luna::channel();
    let (release, released) = mpsc::channel();
    let mut system = System::new("cancelled");
    let executor = system.executor("main").build().unwrap();
    let call = async move {
        luna::blocking(move || {
            begun.blocking_send(()).unwrap();
            released.recv().unwrap()
        })
        .await;
        Ok(())
    };
    let id = executor.process("calling").spawn_ok(call);
    let own = executor.clone();
    let cancel = async move {
        has_begun.recv().await?;
        let calling = own.process_handle(id).unwrap();
        calling.cancel();
        assert_eq!(calling.join().await, Exit::Cancelled);
        // Only now could it have ended.
        release.send(()).map_err(Error::other)
    };
    executor.process("canceller").spawn_ok(cancel);
    assert_eq!(
        system.run().unwrap_err().to_string(),
        "process `calling`: cancelled before its body had ended"
    );
}
