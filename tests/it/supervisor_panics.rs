//! The thread in `System::run` panics, or has no thread to report to: the machine is brought to
//! safety, and nothing is used after it is freed.

#![cfg(unix)]

use crate::common;
use common::{SpawnOk, watchdog};
use luna::Error;
use luna::prelude::*;
use luna::safety::{Degree, Guardian};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::process::{Command, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

/// An error with a text that panics, on the thread that formats it.
#[derive(Debug)]
struct Unspeakable;

impl std::fmt::Display for Unspeakable {
    fn fmt(&self, _: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        panic!("no words")
    }
}

impl std::error::Error for Unspeakable {}

/// Runs a system that panics, and gives its degree then.
fn run_panics(system: &mut System) -> Degree {
    let outcome = catch_unwind(AssertUnwindSafe(|| system.run().map(drop)));
    assert!(outcome.is_err(), "{outcome:?}");
    system.safety().degree()
}

/// A process that fails, once `may` allows it, with an error that panics when formatted; and a
/// process that would go on.
fn add_failing(system: &mut System, may: Arc<AtomicBool>) {
    add_failing_with(system, may, Unspeakable);
}

fn add_failing_with<E>(system: &mut System, may: Arc<AtomicBool>, error: E)
where
    E: std::error::Error + Send + Sync + 'static,
{
    let main = system.executor("main").build().unwrap();
    main.process("fails").spawn_ok(async move {
        while !may.load(Ordering::SeqCst) {
            luna::after(Duration::from_millis(1)).await;
        }
        Err(Error::other(error))
    });
    main.process("goes on")
        .spawn_ok(std::future::pending::<luna::Result<()>>());
}

#[test]
fn a_panic_of_the_thread_that_runs_the_system_is_an_emergency() {
    let _watch = watchdog();
    let has_run = Arc::new(AtomicBool::new(false));
    let mut system = System::new("unspeakable");
    let ran = has_run.clone();
    system.on_emergency("brakes", move || ran.store(true, Ordering::SeqCst));
    let reported = std::env::temp_dir().join(format!("luna-reported-{}", std::process::id()));
    let has_shell = std::path::Path::new("/bin/sh").exists();
    if has_shell {
        let script =
            "echo ready; while read line; do last=$line; done; echo \"reported:$last\" > $0";
        system.guardian(
            Guardian::command("/bin/sh")
                .arg("-c")
                .arg(script)
                .arg(&reported),
        );
    }
    add_failing(&mut system, Arc::new(AtomicBool::new(true)));
    assert_eq!(run_panics(&mut system), Degree::Emergency);
    assert!(has_run.load(Ordering::SeqCst), "the functions run");
    if has_shell {
        // The guardian has ended before the panic left the run. It was not notified that all is
        // safe.
        assert_eq!(std::fs::read_to_string(&reported).unwrap(), "reported:\n");
        let _ = std::fs::remove_file(reported);
    }
}

#[test]
fn a_process_outlives_the_thread_that_runs_it() {
    let _watch = watchdog();
    struct Owner {
        is_gone: Arc<AtomicBool>,
        was_used: Arc<AtomicBool>,
        runs: Arc<AtomicBool>,
    }
    impl Drop for Owner {
        fn drop(&mut self) {
            self.is_gone.store(true, Ordering::SeqCst);
        }
    }
    struct InBody(Arc<AtomicBool>, Arc<AtomicBool>);
    impl Drop for InBody {
        fn drop(&mut self) {
            self.1
                .store(self.0.load(Ordering::SeqCst), Ordering::SeqCst);
        }
    }
    impl Process for Owner {
        async fn run(&mut self) -> luna::Result<()> {
            let _in_body = InBody(self.is_gone.clone(), self.was_used.clone());
            self.runs.store(true, Ordering::SeqCst);
            std::future::pending().await
        }
    }
    let [is_gone, was_used, runs] = std::array::from_fn(|_| Arc::new(AtomicBool::new(false)));
    let mut system = System::new("owner");
    add_failing(&mut system, runs.clone());
    system.thread("own").process("owner").spawn_ok(Owner {
        is_gone: is_gone.clone(),
        was_used: was_used.clone(),
        runs,
    });
    run_panics(&mut system);
    drop(system);
    assert!(is_gone.load(Ordering::SeqCst));
    assert!(
        !was_used.load(Ordering::SeqCst),
        "the body ended after its process was dropped"
    );
}

/// A process of an executor that computes on and on holds nothing up: it is left behind, with all
/// that it uses.
fn panics_beside_one_that_computes(is_virtual: bool) {
    static COMPUTES: AtomicBool = AtomicBool::new(false);
    static MAY_END: AtomicBool = AtomicBool::new(false);
    static IS_GONE: AtomicBool = AtomicBool::new(false);
    struct Computes(std::sync::mpsc::Sender<bool>);
    /// Its words panic as soon as the other one computes.
    #[derive(Debug)]
    struct Later;
    impl std::fmt::Display for Later {
        fn fmt(&self, _: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
            while !COMPUTES.load(Ordering::SeqCst) {
                std::thread::yield_now();
            }
            panic!("no words")
        }
    }
    impl std::error::Error for Later {}
    impl Drop for Computes {
        fn drop(&mut self) {
            IS_GONE.store(true, Ordering::SeqCst);
        }
    }
    impl Process for Computes {
        async fn run(&mut self) -> luna::Result<()> {
            COMPUTES.store(true, Ordering::SeqCst);
            while !MAY_END.load(Ordering::SeqCst) {
                std::thread::yield_now();
            }
            let _ = self.0.send(IS_GONE.load(Ordering::SeqCst));
            Ok(())
        }
    }
    let (ended, has_ended) = std::sync::mpsc::channel();
    let mut system = System::new("computing");
    if is_virtual {
        // One thread runs all, and this one's turn comes first.
        system.virtual_clock();
    }
    system.on_emergency("brakes", || println!("brakes"));
    add_failing_with(&mut system, Arc::new(AtomicBool::new(true)), Later);
    let other = system.executor("other").build().unwrap();
    let computes = Computes(ended);
    other.process("computes").spawn_ok(computes);
    assert_eq!(run_panics(&mut system), Degree::Emergency);
    println!("returned");
    drop(system);
    MAY_END.store(true, Ordering::SeqCst);
    assert!(
        !has_ended.recv().unwrap(),
        "it was dropped while its body ran"
    );
    println!("alive");
}

#[test]
fn an_executor_that_does_not_end_is_left_behind_in_a_panic() {
    let _watch = watchdog();
    let parts = ["computing", "computing on virtual time"];
    for program in parts.map(|part| common::Program::start(part)) {
        let ended = program.end();
        let lines = ["brakes", "returned", "alive"];
        assert_eq!(ended.said(&lines), lines, "{ended:?}");
        assert!(
            ended.errors.contains("did not end within") && ended.errors.contains("left to itself"),
            "{ended:?}"
        );
    }
}

/// What the child program runs; nothing when this program runs it as a test.
#[test]
fn part() {
    let Some(part) = common::part() else { return };
    if part.starts_with("computing") {
        panics_beside_one_that_computes(part.ends_with("virtual time"));
        return;
    }
    struct Fails(Option<std::sync::mpsc::Sender<()>>);
    impl Process for Fails {
        async fn run(&mut self) -> luna::Result<()> {
            Err(Error::other("small failure"))
        }
        // After its error was noted.
        fn post_run(&mut self) {
            self.0.take();
        }
    }
    let (reaped, is_buried) = std::sync::mpsc::channel();
    let mut system = System::new("unheard");
    system.on_emergency("brakes", || println!("brakes"));
    system
        .thread("own")
        .process("fails")
        .spawn_ok(Fails(Some(reaped)));
    system
        .thread("other")
        .process("goes on")
        .spawn_ok(async move {
            let _ = is_buried.recv();
            println!("went on");
            Ok(())
        });
    // This error is not returned, so it is reported.
    system
        .thread("third")
        .process("fails too")
        .spawn_ok(async { Err(Error::other("another failure")) });
    let error = system.run().unwrap_err();
    println!("{error}");
}

#[test]
fn standard_error_without_a_reader_is_no_reason_to_end() {
    let _watch = watchdog();
    let (reader, writer) = std::io::pipe().unwrap();
    drop(reader);
    let mut program = Command::new(std::env::current_exe().unwrap());
    program
        .args([
            &*common::part_of_caller(),
            "--exact",
            "--nocapture",
            "--test-threads=1",
        ])
        .env("LUNA_TEST_PART", "unheard")
        .stdin(Stdio::null())
        .stderr(writer);
    let ended = common::output(&mut program);
    let output = String::from_utf8(ended.stdout).unwrap();
    assert!(ended.status.success(), "{output}");
    assert!(
        output.contains("went on\nprocess `fails`: small failure\n"),
        "{output}"
    );
    assert!(!output.contains("brakes"), "{output}");
}
