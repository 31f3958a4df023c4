//! A panic in a process is an emergency: the functions run, the other processes are cancelled, and
//! `run` names the process that panicked.

use crate::common;
use common::{Log, PLACEMENTS, Placement, SpawnOk, has_real_time, panicked, skip, watchdog};
use luna::Error;
use luna::prelude::*;
use std::sync::{Arc, Mutex};

/// Says that it has begun, waits for ever, and says when it was cancelled.
struct Waiting {
    name: String,
    begun: Sender<()>,
    log: Log,
}

impl Process for Waiting {
    async fn run(&mut self) -> luna::Result<()> {
        struct Body<'a>(&'a Waiting);
        impl Drop for Body<'_> {
            fn drop(&mut self) {
                self.0.log.add(format!("cancelled {}", self.0.name));
            }
        }
        let _body = Body(self);
        self.begun.send(()).await?;
        std::future::pending().await
    }

    fn post_run(&mut self) {
        self.log.add(format!("post {}", self.name));
    }
}

#[test]
fn functions_run_in_order_then_the_others_are_cancelled() {
    let _watch = watchdog();
    for place in PLACEMENTS {
        let log = Log::default();
        let (begun, both_have) = luna::channel();
        let mut system = System::new("panicking");
        for number in 1..=3 {
            let name = format!("function {number}");
            system.on_emergency(&name, log.noter(&name));
        }
        for (other, name) in [
            (Placement::Executor, "beside"),
            (Placement::Thread, "on a thread"),
        ] {
            let process = Waiting {
                name: name.to_owned(),
                begun: begun.clone(),
                log: log.clone(),
            };
            other
                .process(&mut system, &format!("place {name}"), name)
                .spawn_ok(process);
        }
        let culprit = place.process(&mut system, "place", "culprit");
        culprit.spawn_ok(async move {
            both_have.recv().await?;
            both_have.recv().await?;
            panic!("message {}", 7)
        });
        assert_eq!(
            system.run().unwrap_err(),
            panicked("culprit", "message 7"),
            "{place:?}"
        );

        let log = log.all();
        assert_eq!(
            log[..3],
            ["function 1", "function 2", "function 3"],
            "{place:?}"
        );
        let mut ends = log[3..].to_vec();
        ends.sort();
        assert_eq!(
            ends,
            [
                "cancelled beside",
                "cancelled on a thread",
                "post beside",
                "post on a thread"
            ],
            "{place:?}"
        );
    }
}

#[test]
fn the_last_process_that_lives_panics() {
    let _watch = watchdog();
    // The system's end and the emergency come at the same time: the functions must not be lost
    // between the two.
    for round in 0..100 {
        let place = PLACEMENTS[round % 2];
        let log = Log::default();
        let mut system = System::new("alone");
        system.on_emergency("neutral", log.noter("neutral"));
        place
            .process(&mut system, "place", "only")
            .spawn_ok(async { panic!("alone") });
        assert_eq!(system.run().unwrap_err(), panicked("only", "alone"));
        assert_eq!(log.all(), ["neutral"], "round {round}");
    }
}

#[test]
fn without_an_emergency_the_functions_do_not_run() {
    let _watch = watchdog();
    let log = Log::default();
    let mut system = System::new("calm");
    system.on_emergency("neutral", log.noter("neutral"));
    let executor = system.executor("main").build().unwrap();
    // A process that fails is no emergency.
    executor
        .process("failing")
        .spawn_ok(async { Err(Error::other("no")) });
    assert_eq!(
        system.run().unwrap_err().to_string(),
        "process `failing`: no"
    );
    drop(system);
    assert!(log.all().is_empty());
    assert_eq!(Arc::strong_count(&log.0), 1, "the functions were dropped");
}

#[test]
fn a_function_that_panics_does_not_stop_the_next() {
    let _watch = watchdog();
    let log = Log::default();
    let mut system = System::new("unsafe");
    system.on_emergency("bad", || panic!("in an emergency function"));
    system.on_emergency("good", log.noter("good"));
    Placement::Executor
        .process(&mut system, "main", "culprit")
        .spawn_ok(async { panic!("first") });
    assert_eq!(system.run().unwrap_err(), panicked("culprit", "first"));
    assert_eq!(log.all(), ["good"]);
}

#[test]
fn a_panic_without_a_text() {
    let _watch = watchdog();
    let mut system = System::new("speechless");
    let process = Placement::Executor.process(&mut system, "main", "culprit");
    process.spawn_ok(async { std::panic::panic_any(42) });
    assert_eq!(
        system.run().unwrap_err(),
        panicked("culprit", "(a panic whose message is no text)")
    );
}

#[test]
fn where_a_body_is_made() {
    let _watch = watchdog();
    for place in PLACEMENTS {
        let log = Log::default();
        let (function, body) = (log.clone(), log.clone());
        let mut system = System::new("unmade");
        system.on_emergency("neutral", move || {
            function.add("neutral");
            // Time in which a body that was released would begin; only a failure needs it.
            std::thread::sleep(std::time::Duration::from_millis(200));
        });
        let process = place.process(&mut system, "place", "unmade");
        process.spawn_ok(|| -> std::future::Ready<luna::Result<()>> { panic!("no body") });
        // What is in safety before the start is not set in motion.
        let other = place.process(&mut system, "other place", "other");
        other.spawn_ok(async move {
            body.add("body");
            Ok(())
        });
        assert_eq!(
            system.run().unwrap_err(),
            panicked("unmade", "no body"),
            "{place:?}"
        );
        assert_eq!(log.all(), ["neutral"], "{place:?}");
    }
}

#[test]
fn where_a_cancelled_body_is_dropped() {
    let _watch = watchdog();
    struct Bad;
    impl Drop for Bad {
        fn drop(&mut self) {
            panic!("in a drop");
        }
    }
    for place in PLACEMENTS {
        let log = Log::default();
        let (begun, has_begun) = luna::channel();
        let mut system = System::new("dropped");
        system.on_emergency("neutral", log.noter("neutral"));
        let waiting = place.process(&mut system, "place", "culprit");
        let waits = async move {
            let _bad = Bad;
            begun.send(()).await?;
            std::future::pending().await
        };
        let id = waiting.spawn_ok(waits);
        let other = system.executor("other").build().unwrap();
        let handles = other.clone();
        let cancels = async move {
            has_begun.recv().await?;
            handles.process_handle(id).unwrap().cancel();
            std::future::pending().await
        };
        other.process("canceller").spawn_ok(cancels);
        let error = system.run().unwrap_err();
        assert_eq!(error, panicked("culprit", "in a drop"), "{place:?}");
        assert_eq!(log.all(), ["neutral"], "{place:?}");
    }
}

#[test]
fn the_panic_counts_and_not_the_errors_that_follow_from_it() {
    let _watch = watchdog();
    let (sender, receiver) = luna::channel::<()>();
    let mut system = System::new("domino");
    let left = system.executor("left").build().unwrap();
    // Spawned first, and fails since its partner has gone.
    left.process("victim")
        .spawn_ok(async move { Ok(receiver.recv().await?) });
    let right = system.executor("right").build().unwrap();
    right.process("culprit").spawn_ok(async move {
        let _sender = sender;
        panic!("cause")
    });
    assert_eq!(system.run().unwrap_err(), panicked("culprit", "cause"));
}

#[test]
fn several_at_once() {
    let _watch = watchdog();
    for _ in 0..20 {
        let log = Log::default();
        let mut system = System::new("all");
        system.on_emergency("neutral", log.noter("neutral"));
        for (number, place) in [
            (0, Placement::Executor),
            (1, Placement::Thread),
            (2, Placement::Executor),
            (3, Placement::Thread),
        ] {
            let name = format!("process {number}");
            place
                .process(&mut system, &name, &name)
                .spawn_ok(async { panic!("all") });
        }
        let Error::Process { source, .. } = system.run().unwrap_err() else {
            panic!("whose was it?")
        };
        assert_eq!(*source, Error::Panicked("all".to_owned()));
        assert_eq!(log.all(), ["neutral"], "once");
    }
}

#[test]
fn functions_run_on_a_thread_above_all_others() {
    let _watch = watchdog();
    let seen = Arc::new(Mutex::new(None));
    let own = seen.clone();
    let mut system = System::new("real time");
    let executor = system
        .executor("control")
        .policy(Policy::fifo(80))
        .build()
        .unwrap();
    system.on_emergency("look", move || {
        let name = std::thread::current().name().map(str::to_owned);
        *own.lock().unwrap() = Some((
            name,
            luna_platform::thread::current_policy(),
            luna::realtime::on_path(),
        ));
    });
    executor
        .process("culprit")
        .spawn_ok(async { panic!("on purpose") });
    system.run().unwrap_err();
    let (name, policy, on_path) = seen.lock().unwrap().clone().unwrap();
    assert_eq!((name.as_deref(), on_path), (Some("luna-emergency"), false));
    if !has_real_time() {
        return skip("its priority: no privilege");
    }
    // On a single core the threads take turns, so that one that hangs does not keep the others from
    // going on.
    let expected = match luna_platform::thread::available_cores().len() {
        1 => Policy::round_robin(99),
        _ => Policy::fifo(99),
    };
    assert_eq!(policy, expected);
}
