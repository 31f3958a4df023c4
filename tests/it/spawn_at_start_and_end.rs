//! Processes that are spawned while the system starts, or ends.

use crate::common;
use common::{PLACEMENTS, SpawnOk, watchdog};
use luna::error::SetupError;
use luna::prelude::*;
use luna::{Error, Executor, Exit};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex};

#[test]
fn in_a_pre_run_it_starts_with_the_others() {
    let _watch = watchdog();
    struct Spawning {
        on: Executor,
        log: Arc<Mutex<Vec<&'static str>>>,
    }
    impl Process for Spawning {
        fn pre_run(&mut self) -> luna::Result<()> {
            self.log.lock().unwrap().push("pre parent");
            self.on
                .process("child")
                .spawn(Child {
                    log: self.log.clone(),
                })
                .map(drop)
        }
        async fn run(&mut self) -> luna::Result<()> {
            self.log.lock().unwrap().push("run");
            Ok(())
        }
    }
    struct Child {
        log: Arc<Mutex<Vec<&'static str>>>,
    }
    impl Process for Child {
        fn pre_run(&mut self) -> luna::Result<()> {
            self.log.lock().unwrap().push("pre child");
            Ok(())
        }
        async fn run(&mut self) -> luna::Result<()> {
            self.log.lock().unwrap().push("run");
            Ok(())
        }
    }
    let log = Arc::new(Mutex::new(Vec::new()));
    let mut system = System::new("early");
    let executor = system.executor("main").build().unwrap();
    executor.process("parent").spawn_ok(Spawning {
        on: executor.clone(),
        log: log.clone(),
    });
    assert_eq!(system.run().unwrap().processes.len(), 2);
    assert_eq!(
        *log.lock().unwrap(),
        ["pre parent", "pre child", "run", "run"]
    );
}

#[test]
fn where_a_body_is_made() {
    let _watch = watchdog();
    for place in PLACEMENTS {
        let mut system = System::new("early");
        let other = system.executor("other").build().unwrap();
        let made = place.process(&mut system, "place", "parent");
        made.spawn_ok(move || {
            let child = other.process("child").spawn(async { Ok(()) });
            async move { child.map(drop) }
        });
        let report = system.run().unwrap();
        let exits: Vec<_> = report
            .processes
            .iter()
            .map(|process| process.exit.clone())
            .collect();
        assert_eq!(
            exits,
            [Some(Exit::Completed), Some(Exit::Completed)],
            "{place:?}"
        );
    }
}

#[test]
fn beside_the_end_it_runs_or_is_refused() {
    let _watch = watchdog();
    for round in 0..100 {
        let runs = Arc::new(AtomicUsize::new(0));
        let mut system = System::new("ending");
        let executor = system.executor("main").build().unwrap();
        let process = if round % 2 == 0 {
            executor.process("late")
        } else {
            system.thread("late").process("late")
        };
        let (running, has_run) = luna::channel();
        executor
            .process("first")
            .spawn_ok(async move { Ok(running.send(()).await?) });
        struct Counts(Arc<AtomicUsize>);
        impl Process for Counts {
            async fn run(&mut self) -> luna::Result<()> {
                self.0.fetch_add(1, Ordering::Relaxed);
                Ok(())
            }
            fn post_run(&mut self) {
                self.0.fetch_add(100, Ordering::Relaxed);
            }
        }
        let own = runs.clone();
        let spawner = std::thread::spawn(move || {
            has_run.blocking_recv().unwrap();
            process.spawn(Counts(own))
        });
        let report = system.run().unwrap();
        match spawner.join().unwrap() {
            // It belongs to the system then, which waits for it.
            Ok(_) => {
                assert_eq!(report.processes.len(), 2, "round {round}");
                assert_eq!(
                    (
                        report.processes[1].exit.clone(),
                        runs.load(Ordering::Relaxed)
                    ),
                    (Some(Exit::Completed), 101)
                );
            }
            Err(error) => {
                assert!(
                    matches!(error, Error::Setup(SetupError::Ended { .. })),
                    "{error:?}"
                );
                assert_eq!(report.processes.len(), 1, "round {round}");
                assert_eq!(runs.load(Ordering::Relaxed) % 100, 0, "no body ran");
            }
        }
    }
}
