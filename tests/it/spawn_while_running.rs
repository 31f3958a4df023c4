//! Processes that are spawned while the system runs, or starts, or ends.

use crate::common;
use common::{PLACEMENTS, SpawnOk, watchdog};
use luna::error::SetupError;
use luna::prelude::*;
use luna::{Error, Executor, Exit};
use std::pin::Pin;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex};
use std::thread::ThreadId;

/// Notes where its phases ran.
#[derive(Default)]
struct Phases {
    pre_run: Option<ThreadId>,
    run: Option<ThreadId>,
    post_run: Option<ThreadId>,
}

struct Noting(Arc<Mutex<Phases>>);

impl Process for Noting {
    fn pre_run(&mut self) -> luna::Result<()> {
        self.0.lock().unwrap().pre_run = Some(std::thread::current().id());
        Ok(())
    }

    async fn run(&mut self) -> luna::Result<()> {
        self.0.lock().unwrap().run = Some(std::thread::current().id());
        Ok(())
    }

    fn post_run(&mut self) {
        self.0.lock().unwrap().post_run = Some(std::thread::current().id());
    }
}

#[test]
fn from_a_process() {
    let _watch = watchdog();
    for place in PLACEMENTS {
        let phases = Arc::new(Mutex::new(Phases::default()));
        let (parent_thread, of_parent) = luna::buffered(Buffer::fifo(1));
        let mut system = System::new("growing");
        let other = system.executor("other").build().unwrap();
        let own = phases.clone();
        place
            .process(&mut system, "parents", "parent")
            .spawn_ok(async move {
                parent_thread.try_send(std::thread::current().id())?;
                let child = other.process("child").priority(20).spawn(Noting(own))?;
                // It can be looked at from now on.
                let handle = other.process_handle(child).unwrap();
                assert_eq!(
                    (handle.name(), handle.priority(), handle.id()),
                    ("child", 20, child)
                );
                assert_eq!(handle.join().await, Exit::Completed);
                Ok(())
            });
        let report = system.run().unwrap();
        let names: Vec<_> = report
            .processes
            .iter()
            .map(|process| process.name.as_str())
            .collect();
        assert_eq!(names, ["parent", "child"]);
        let phases = phases.lock().unwrap();
        assert_eq!(phases.pre_run, of_parent.try_recv().ok(), "in the caller");
        assert_eq!(phases.post_run, Some(std::thread::current().id()));
        assert!(phases.run.is_some() && phases.run != phases.pre_run);
    }
}

#[test]
fn from_another_thread() {
    let _watch = watchdog();
    for on_a_thread in [false, true] {
        let phases = Arc::new(Mutex::new(Phases::default()));
        let (running, runs) = luna::channel();
        let (enough, was_enough) = luna::channel::<()>();
        let mut system = System::new("growing");
        let executor = system.executor("main").build().unwrap();
        executor.process("first").spawn_ok(async move {
            running.send(()).await?;
            was_enough.recv().await?;
            Ok(())
        });
        let process = if on_a_thread {
            system.thread("late").process("second")
        } else {
            executor.process("second")
        };
        let own = phases.clone();
        let spawner = std::thread::spawn(move || {
            runs.blocking_recv().unwrap();
            process.spawn_ok(Noting(own));
            enough.blocking_send(()).unwrap();
            std::thread::current().id()
        });
        let report = system.run().unwrap();
        assert_eq!(report.processes[1].exit, Some(Exit::Completed));
        let threads: Vec<_> = report
            .threads
            .iter()
            .map(|thread| thread.name.as_str())
            .collect();
        assert_eq!(
            threads,
            if on_a_thread {
                &["main", "late"][..]
            } else {
                &["main"]
            }
        );
        let phases = phases.lock().unwrap();
        assert_eq!(phases.pre_run, Some(spawner.join().unwrap()));
        assert_eq!(phases.post_run, Some(std::thread::current().id()));
    }
}

type Body = Pin<Box<dyn Future<Output = luna::Result<()>> + Send>>;

/// A process that spawns two more below it, down to a depth, and waits for them.
fn grow(executors: [Executor; 2], name: String, depth: usize, leaves: Arc<AtomicUsize>) -> Body {
    Box::pin(async move {
        if depth == 0 {
            leaves.fetch_add(1, Ordering::Relaxed);
            return Ok(());
        }
        let mut children = Vec::new();
        for (side, on) in ["l", "r"].iter().zip(&executors) {
            let child = format!("{name}{side}");
            let id = on.process(&child).spawn(grow(
                executors.clone(),
                child.clone(),
                depth - 1,
                leaves.clone(),
            ))?;
            children.push(on.process_handle(id).unwrap());
        }
        for child in children {
            assert_eq!(child.join().await, Exit::Completed);
        }
        Ok(())
    })
}

#[test]
fn a_tree_of_processes() {
    let _watch = watchdog();
    let leaves = Arc::new(AtomicUsize::new(0));
    let mut system = System::new("tree");
    let executors = ["left", "right"].map(|name| system.executor(name).build().unwrap());
    let root = grow(executors.clone(), "root ".to_owned(), 6, leaves.clone());
    executors[0].process("root ").spawn_ok(root);
    let report = system.run().unwrap();
    assert_eq!(leaves.load(Ordering::Relaxed), 64);
    assert_eq!(report.processes.len(), 127);
    assert!(
        report
            .processes
            .iter()
            .all(|process| process.exit == Some(Exit::Completed))
    );
}

#[test]
fn names_stay_unique() {
    let _watch = watchdog();
    let mut system = System::new("unique");
    let executor = system.executor("main").build().unwrap();
    let own = executor.clone();
    executor.process("parent").spawn_ok(async move {
        let child = own.process("child").spawn(async { Ok(()) })?;
        own.process_handle(child).unwrap().join().await;
        // Also that of one that has ended: it is in the report.
        for name in ["parent", "child"] {
            let error = own.process(name).spawn(async { Ok(()) }).unwrap_err();
            assert_eq!(
                error,
                SetupError::DuplicateName {
                    kind: "process",
                    name: name.to_owned()
                }
                .into()
            );
        }
        Ok(())
    });
    assert_eq!(system.run().unwrap().processes.len(), 2);
}

#[test]
fn a_pre_run_that_fails_and_is_tried_again() {
    let _watch = watchdog();
    struct Fails(Arc<AtomicUsize>);
    impl Process for Fails {
        fn pre_run(&mut self) -> luna::Result<()> {
            self.0.fetch_add(1, Ordering::Relaxed);
            Err(Error::other("not yet"))
        }
        async fn run(&mut self) -> luna::Result<()> {
            unreachable!("it was not prepared")
        }
        fn post_run(&mut self) {
            self.0.fetch_add(100, Ordering::Relaxed);
        }
    }
    let count = Arc::new(AtomicUsize::new(0));
    let mut system = System::new("again");
    let executor = system.executor("main").build().unwrap();
    let (own, counted) = (executor.clone(), count.clone());
    executor.process("parent").spawn_ok(async move {
        for _ in 0..2 {
            let error = own
                .process("child")
                .spawn(Fails(counted.clone()))
                .unwrap_err();
            assert_eq!(error.to_string(), "process `child`: not yet");
        }
        own.process("child").spawn(async { Ok(()) })?;
        Ok(())
    });
    assert_eq!(system.run().unwrap().processes.len(), 2);
    assert_eq!(count.load(Ordering::Relaxed), 2);
}

#[test]
fn a_name_is_free_once_its_process_is_forgotten_however_busy_its_executor_is() {
    let _watch = watchdog();
    let mut system = System::new("busy");
    system.remember_ended(0);
    let busy = system.executor("busy").build().unwrap();
    let other = system.executor("other").build().unwrap();
    let is_over = Arc::new(AtomicUsize::new(0));
    let over = is_over.clone();
    busy.process("sleepless").spawn_ok(async move {
        while over.load(Ordering::Relaxed) == 0 {
            luna::yield_now().await;
        }
        Ok(())
    });
    other.process("parent").spawn_ok(async move {
        let mut ran = Ok(());
        for _ in 0..100 {
            match busy.process("job").start(async { Ok(()) }) {
                Ok(job) => assert_eq!(job.join().await, Exit::Completed),
                Err(error) => ran = Err(error),
            }
        }
        is_over.store(1, Ordering::Relaxed);
        ran
    });
    let report = system.run().unwrap();
    assert_eq!(report.earlier.completed, 100);
}

#[test]
fn many_may_share_a_name_and_take_it_from_nobody() {
    let _watch = watchdog();
    for remembered in [0, 1000] {
        let mut system = System::new("many");
        system.remember_ended(remembered);
        let main = system.executor("main").build().unwrap();
        for _ in 0..2 {
            main.process("child")
                .one_of_many()
                .spawn_ok(async { Ok(()) });
        }
        let place = main.clone();
        main.process("parent").spawn_ok(async move {
            let own = place.process("child").start(std::future::pending())?;
            for number in 0..10 {
                let child = place.process("child").one_of_many();
                let child = match number % 2 {
                    0 => child.start(async { Ok(()) })?,
                    _ => child.start(Noting(Arc::default()))?,
                };
                assert_eq!(child.name(), "child");
                assert_eq!(child.join().await, Exit::Completed);
            }
            let taken = place.process("child").start(async { Ok(()) });
            assert!(matches!(
                taken,
                Err(Error::Setup(SetupError::DuplicateName { .. }))
            ));
            own.cancel();
            Ok(())
        });
        let error = system.run().unwrap_err();
        assert_eq!(
            error.to_string(),
            "process `child`: cancelled before its body had ended"
        );
        let report = system.report().unwrap();
        let all = report.earlier.number() as usize + report.processes.len();
        assert_eq!(all, 2 + 1 + 1 + 10);
        let sharing = report.processes.iter().filter(|one| one.name == "child");
        assert_eq!(sharing.count(), if remembered == 0 { 2 } else { 13 });
    }
}

#[test]
fn nothing_is_started_at_once_before_the_start_and_after_the_end() {
    let _watch = watchdog();
    for is_shared in [false, true] {
        let mut system = System::new("late");
        let main = system.executor("main").build().unwrap();
        let child = || match is_shared {
            false => main.process("child"),
            true => main.process("child").one_of_many(),
        };
        let early = child().start(async { Ok(()) }).unwrap_err();
        assert_eq!(
            early.to_string(),
            "process `child` cannot be started, since its system does not run yet; spawn it"
        );
        // It was not added, so its name is free.
        child().spawn_ok(async { Ok(()) });
        assert_eq!(system.run().unwrap().processes.len(), 1);
        let late = child().start(async { Ok(()) });
        assert!(matches!(late, Err(Error::Setup(SetupError::Ended { .. }))));
    }
}

/// Also one with phases, and one on a thread of its own.
#[test]
fn one_that_starts_a_process_has_its_handle() {
    let _watch = watchdog();
    let mut system = System::new("handles");
    let main = system.executor("main").build().unwrap();
    let thread = system.thread("thread");
    let place = main.clone();
    main.process("parent").spawn_ok(async move {
        let plain = place.process("plain").start(async { Ok(()) })?;
        let phased = place.process("phased").start(Noting(Arc::default()))?;
        let apart = thread.process("apart").start(async { Ok(()) })?;
        for handle in [&plain, &phased, &apart] {
            assert_eq!(handle.join().await, Exit::Completed);
            let same = place.process_handle(handle.id()).map(|same| same.id());
            assert_eq!(same, Some(handle.id()));
        }
        assert_eq!(plain.name(), "plain");
        Ok(())
    });
    assert_eq!(system.run().unwrap().processes.len(), 4);
}

/// Spawns a process when it is dropped: user code that uses the system.
struct Spawns(luna::Executor, Arc<AtomicUsize>);

impl Drop for Spawns {
    fn drop(&mut self) {
        let ran = self.1.clone();
        self.0
            .process("of the drop")
            .one_of_many()
            .spawn_ok(async move {
                ran.fetch_add(1, Ordering::SeqCst);
                Ok(())
            });
    }
}

#[test]
fn what_is_freed_at_a_spawn_may_spawn() {
    let _watchdog = watchdog();
    let ran = Arc::new(AtomicUsize::new(0));
    let mut system = System::new("spawns");
    let main = system.executor("main").build().unwrap();
    let (own, counts) = (main.clone(), ran.clone());
    main.process("parent").spawn_ok(async move {
        // Freed later, since it is dropped on the real-time path: by the next spawn.
        drop(luna_core::deferred_free::Shared::new(Mutex::new(Spawns(
            own.clone(),
            counts,
        ))));
        own.process("late").one_of_many().spawn_ok(async { Ok(()) });
        Ok(())
    });
    system.run().unwrap();
    assert_eq!(ran.load(Ordering::SeqCst), 1);
}
