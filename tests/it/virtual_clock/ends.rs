//! How processes and systems end: each at its instant, and before time goes on.

use super::{HOUR, MS, Notes, simulated, sleep_for, watchdog};
use crate::common::SpawnOk;
use luna::prelude::*;
use luna::{End, Error};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
use std::time::Duration;

#[test]
fn a_deadlock_is_found_when_nothing_can_run() {
    let _alive = watchdog();
    let mut system = System::new("stuck");
    system.virtual_clock().strict();
    let main = system.executor("main").build().unwrap();
    let other = system.executor("other").build().unwrap();
    let (one, of_one) = luna::channel::<()>();
    let (two, of_two) = luna::channel::<()>();
    let first = async move {
        luna::after(HOUR).await;
        of_two.recv().await?;
        Ok(one.send(()).await?)
    };
    main.process("first").spawn_ok(first);
    let second = async move {
        of_one.recv().await?;
        Ok(two.send(()).await?)
    };
    other.process("second").spawn_ok(second);
    assert!(matches!(system.run(), Err(Error::Deadlock(_))));
    assert_eq!(system.report().unwrap().elapsed, HOUR);
}

#[test]
fn a_panic_is_an_emergency_and_time_stands_for_its_functions() {
    let _alive = watchdog();
    let (mut system, main) = simulated();
    let seen = Arc::new(AtomicU64::new(0));
    let kept = seen.clone();
    system.on_emergency("safe", move || kept.store(luna::now().as_nanos(), Relaxed));
    let panics = async {
        luna::after(MS).await;
        panic!("on purpose");
    };
    main.process("panics").spawn_ok(panics);
    let cycles = Arc::new(AtomicU64::new(0));
    let counted = cycles.clone();
    let goes_on = async move {
        let mut tick = luna::periodic("goes on", MS)?;
        loop {
            tick.next().await;
            counted.fetch_add(1, Relaxed);
        }
    };
    main.process("goes on").spawn_ok(goes_on);
    let error = system.run().unwrap_err();
    assert!(error.to_string().contains("on purpose"), "{error}");
    let report = system.report().unwrap();
    assert_eq!((report.end, report.elapsed), (End::Panic, MS));
    assert_eq!(seen.load(Relaxed), 1_001_000_000);
    // It was due at the instant of the panic, and never after.
    assert_eq!(cycles.load(Relaxed), 1);
}

#[test]
fn poison_and_cancel_end_processes_at_their_instants() {
    let _alive = watchdog();
    let mut system = System::new("ends");
    system.virtual_clock();
    let main = system.executor("main").build().unwrap();
    let notes = Notes::default();
    let (sender, receiver) = luna::channel::<u32>();
    let own = notes.clone();
    let reads = async move {
        while receiver.recv().await.is_ok() {}
        own.note("poisoned");
        Ok(())
    };
    let reads = system.thread("reads").process("reads").spawn_ok(reads);
    let poisons = async move {
        luna::after(MS).await;
        sender.send(1).await?;
        sender.poison();
        Ok(())
    };
    main.process("poisons").spawn_ok(poisons);
    let sleeps = main.process("sleeps").spawn_ok(sleep_for(HOUR));
    let (own, handles) = (notes.clone(), main.clone());
    let cancels = async move {
        let sleeper = handles.process_handle(sleeps).unwrap();
        let reader = handles.process_handle(reads).unwrap();
        reader.join().await;
        luna::after(MS).await;
        sleeper.cancel();
        assert_eq!(sleeper.join().await, luna::Exit::Cancelled);
        own.note("cancelled");
        Ok(())
    };
    main.process("cancels").spawn_ok(cancels);
    // A process that another one cancels has not done its work.
    let error = system.run().unwrap_err().to_string();
    assert_eq!(
        error,
        "process `sleeps`: cancelled before its body had ended"
    );
    let report = system.report().unwrap();
    assert_eq!(
        notes.take(),
        [(1000, "poisoned".into()), (2000, "cancelled".into())]
    );
    assert_eq!(report.elapsed, MS * 2);
}

/// Notes its phases.
struct Phases(
    Notes,
    #[expect(dead_code, reason = "what counts is when it is dropped")] luna::Sender<()>,
);

impl Process for Phases {
    fn pre_run(&mut self) -> luna::Result<()> {
        self.0.note("pre");
        Ok(())
    }

    async fn run(&mut self) -> luna::Result<()> {
        luna::after(MS * 3).await;
        self.0.note("run");
        Ok(())
    }

    fn post_run(&mut self) {
        self.0.note("post");
    }
}

#[test]
fn phases_see_its_time_and_a_burial_comes_before_time_goes_on() {
    let _alive = watchdog();
    for _ in 0..20 {
        let (system, main) = simulated();
        let notes = Notes::default();
        let (end, ended) = luna::channel::<()>();
        main.process("phases").spawn_ok(Phases(notes.clone(), end));
        let own = notes.clone();
        let other = async move {
            // The channel's end goes with the process, which is dropped after its post_run.
            assert!(ended.recv().await.is_err());
            own.note("closed");
            Ok(())
        };
        main.process("other").spawn_ok(other);
        main.process("time").spawn_ok(sleep_for(HOUR));
        system.run().unwrap();
        let expected = [(0, "pre"), (3000, "run"), (3000, "post"), (3000, "closed")];
        assert_eq!(
            notes.take(),
            expected.map(|(at, what)| (at, what.to_owned()))
        );
    }
}

#[test]
fn a_start_that_fails_leaves_nothing() {
    let _alive = watchdog();
    struct Fails;
    impl Process for Fails {
        fn pre_run(&mut self) -> luna::Result<()> {
            Err(Error::other("no"))
        }
        async fn run(&mut self) -> luna::Result<()> {
            Ok(())
        }
    }
    let (mut system, main) = simulated();
    let kept = Arc::new(());
    let held = kept.clone();
    let body = async move {
        let _held = held;
        sleep_for(HOUR).await
    };
    system.thread("thread").process("held").spawn_ok(body);
    main.process("fails").spawn_ok(Fails);
    assert_eq!(system.run().unwrap_err().to_string(), "process `fails`: no");
    assert_eq!(Arc::strong_count(&kept), 1);
    let empty = simulated().0;
    assert_eq!(empty.run().unwrap().elapsed, Duration::ZERO);
}

/// Holds an end, which goes when the process is reaped.
struct Holder(#[expect(dead_code, reason = "its drop counts")] luna::Sender<u32>);

impl Process for Holder {
    async fn run(&mut self) -> luna::Result<()> {
        luna::after(MS).await;
        Ok(())
    }
}

/// Another thread drops what a process held. When others see it does not depend on that thread.
#[test]
fn what_an_ended_process_held_goes_before_anybody_else_runs() {
    let _alive = watchdog();
    let turns_until_closed = || {
        let (system, main) = simulated();
        let (held, end) = luna::channel::<u32>();
        let turns = Arc::new(AtomicU64::new(0));
        let (counted, seen) = (turns.clone(), Arc::new(AtomicU64::new(u64::MAX)));
        let (own, at_close) = (turns, seen.clone());
        main.process("holder").spawn_ok(Holder(held));
        main.process("reader").spawn_ok(async move {
            assert!(end.recv().await.is_err());
            at_close.store(own.load(Relaxed), Relaxed);
            Ok(())
        });
        main.process("counter").spawn_ok(async move {
            luna::after(MS).await;
            for _ in 0..20_000 {
                counted.fetch_add(1, Relaxed);
                luna::yield_now().await;
            }
            Ok(())
        });
        system.run().unwrap();
        seen.load(Relaxed)
    };
    let first = turns_until_closed();
    assert!(first < 10, "{first}");
    for _ in 0..20 {
        assert_eq!(turns_until_closed(), first);
    }
}

/// Tells its end to a process that is not ready for it yet.
struct ReportsItsEnd(luna::Sender<u32>);

impl Process for ReportsItsEnd {
    async fn run(&mut self) -> luna::Result<()> {
        Ok(())
    }

    fn post_run(&mut self) {
        self.0.blocking_send(1).unwrap();
    }
}

#[test]
fn a_post_run_that_waits_for_time_does_not_keep_time_from_going_on() {
    let _alive = watchdog();
    let (system, main) = simulated();
    let (sender, receiver) = luna::channel();
    main.process("reports").spawn_ok(ReportsItsEnd(sender));
    main.process("logger").spawn_ok(async move {
        luna::after(MS).await;
        assert_eq!(receiver.recv().await, Ok(1));
        Ok(())
    });
    assert_eq!(system.run().unwrap().end, End::Completed);
}
