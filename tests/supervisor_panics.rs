//! The thread in `System::run` panics, or has nobody to tell: the machine is brought to safety, and nothing is used after it is gone.

#![cfg(unix)]

mod common;

use common::watchdog;
use luna::prelude::*;
use luna::{Degree, Error, Guardian};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::process::{Command, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

/// An error whose words panic, on the thread that tells them.
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

/// A process that fails, once `may` says so, with an error whose words panic; and one that would go on.
fn add_failing(system: &mut System, may: Arc<AtomicBool>) {
    let main = system.executor("main").build().unwrap();
    main.process("fails")
        .spawn(async move {
            while !may.load(Ordering::SeqCst) {
                luna::after(Duration::from_millis(1)).await;
            }
            Err(Error::other(Unspeakable))
        })
        .unwrap();
    main.process("goes on")
        .spawn(std::future::pending::<luna::Result<()>>())
        .unwrap();
}

#[test]
fn a_panic_of_the_thread_that_runs_the_system_is_an_emergency() {
    let _watch = watchdog();
    let has_run = Arc::new(AtomicBool::new(false));
    let mut system = System::new("unspeakable");
    let ran = has_run.clone();
    system.on_emergency("brakes", move || ran.store(true, Ordering::SeqCst));
    let told = std::env::temp_dir().join(format!("luna-told-{}", std::process::id()));
    let has_shell = std::path::Path::new("/bin/sh").exists();
    if has_shell {
        let script = "echo ready; while read line; do last=$line; done; echo \"told:$last\" > $0";
        system.guardian(
            Guardian::command("/bin/sh")
                .arg("-c")
                .arg(script)
                .arg(&told),
        );
    }
    add_failing(&mut system, Arc::new(AtomicBool::new(true)));
    assert_eq!(run_panics(&mut system), Degree::Emergency);
    assert!(has_run.load(Ordering::SeqCst), "the functions run");
    if has_shell {
        // The guardian has ended before the panic left the run; it was not told that all is safe.
        assert_eq!(std::fs::read_to_string(&told).unwrap(), "told:\n");
        let _ = std::fs::remove_file(told);
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
    system
        .thread("own")
        .process("owner")
        .spawn(Owner {
            is_gone: is_gone.clone(),
            was_used: was_used.clone(),
            runs,
        })
        .unwrap();
    run_panics(&mut system);
    drop(system);
    assert!(is_gone.load(Ordering::SeqCst));
    assert!(
        !was_used.load(Ordering::SeqCst),
        "the body ended after its process was dropped"
    );
}

/// What the child program runs; nothing when this program runs it as a test.
#[test]
fn part() {
    if common::part().is_none() {
        return;
    }
    struct Fails(Option<std::sync::mpsc::Sender<()>>);
    impl Process for Fails {
        async fn run(&mut self) -> luna::Result<()> {
            Err(Error::other("small failure"))
        }
        // After its error was told.
        fn post_run(&mut self) {
            self.0.take();
        }
    }
    let (buried, is_buried) = std::sync::mpsc::channel();
    let mut system = System::new("unheard");
    system.on_emergency("brakes", || println!("brakes"));
    system
        .thread("own")
        .process("fails")
        .spawn(Fails(Some(buried)))
        .unwrap();
    system
        .thread("other")
        .process("goes on")
        .spawn(async move {
            let _ = is_buried.recv();
            println!("went on");
            Ok(())
        })
        .unwrap();
    let error = system.run().unwrap_err();
    println!("{error}");
}

#[test]
fn standard_error_without_a_reader_is_no_reason_to_end() {
    let _watch = watchdog();
    let (reader, writer) = std::io::pipe().unwrap();
    drop(reader);
    let ended = Command::new(std::env::current_exe().unwrap())
        .args(["part", "--exact", "--nocapture", "--test-threads=1"])
        .env("LUNA_TEST_PART", "unheard")
        .stdin(Stdio::null())
        .stderr(writer)
        .output()
        .unwrap();
    let output = String::from_utf8(ended.stdout).unwrap();
    assert!(ended.status.success(), "{output}");
    assert!(
        output.contains("went on\nprocess `fails`: small failure\n"),
        "{output}"
    );
    assert!(!output.contains("brakes"), "{output}");
}
