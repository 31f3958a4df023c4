//! Crashes: the emergency functions run, and then the program ends as it would have without them.
//! Each system runs in a program of its own.

#![cfg(unix)]

use crate::common;
use common::{COMPLETE, Program, SpawnOk, watchdog, with_signals};
use luna::Error;
use luna::prelude::*;
use luna::report::FunctionOutcome;
use nix::sys::signal::{Signal, raise};
use std::os::unix::process::ExitStatusExt;
use std::time::Duration;

const ABORT: i32 = Signal::SIGABRT as i32;
const FAULT: i32 = Signal::SIGSEGV as i32;

/// A write that the processor refuses.
fn write_to_nowhere() {
    let nowhere = std::hint::black_box(std::ptr::without_provenance_mut::<u8>(8));
    // SAFETY: none. This access is unsound on purpose: the test is about its consequence. Nothing
    // is ever mapped at this address, so nothing is written.
    unsafe { nowhere.write_volatile(1) };
}

/// Uses up the stack of the calling thread.
#[expect(unconditional_recursion, reason = "on purpose")]
fn overflow(depth: u64) -> u64 {
    let frame = std::hint::black_box([depth; 64]);
    overflow(depth + 1) + frame[0]
}

/// A system of which one process, a thread or a function does `crash`.
fn crashing(on: &str, crash: fn()) -> System {
    let mut system = System::new("crashing");
    system.on_emergency("first", || println!("function 1"));
    if on == "function" {
        system.on_emergency("crashes", crash);
    }
    system.on_emergency("second", || println!("function 2"));
    match on {
        "executor" => {
            let executor = system.executor("main").policy(Policy::fifo(80)).build();
            let process = executor.unwrap().process("culprit");
            process.spawn_ok(async move {
                crash();
                Ok(())
            });
        }
        "thread" => {
            let process = system.thread("own").process("culprit");
            process.spawn_ok(async move {
                crash();
                Ok(())
            });
        }
        "plain thread" => {
            let process = system.thread("own").process("maker");
            let makes = async move {
                std::thread::spawn(crash);
                std::future::pending().await
            };
            process.spawn_ok(makes);
        }
        "function" => {
            let process = system.thread("own").process("raiser");
            process.spawn_ok(async { Err(luna::emergency(Error::other("now"))) });
        }
        "post_run" => {
            struct Crashes(fn());
            impl Process for Crashes {
                async fn run(&mut self) -> luna::Result<()> {
                    Ok(())
                }
                fn post_run(&mut self) {
                    (self.0)();
                }
            }
            system
                .thread("own")
                .process("culprit")
                .spawn_ok(Crashes(crash));
        }
        other => panic!("nobody is {other}"),
    }
    // Others go on until the end.
    system
        .executor("other")
        .build()
        .unwrap()
        .process("waiting")
        .spawn_ok(std::future::pending::<luna::Result<()>>());
    system
}

fn crash_of(what: &str) -> fn() {
    match what {
        "write" => write_to_nowhere,
        "overflow" => || {
            overflow(0);
        },
        "abort" => || std::process::abort(),
        "two panics" => || {
            struct Bad;
            impl Drop for Bad {
                fn drop(&mut self) {
                    panic!("while another panics");
                }
            }
            // A backtrace takes longer than a function may, on a busy machine.
            std::panic::set_hook(Box::new(|_| ()));
            let _bad = Bad;
            panic!("first");
        },
        "bus" => || raise(Signal::SIGBUS).unwrap(),
        "arithmetic" => || raise(Signal::SIGFPE).unwrap(),
        "instruction" => || raise(Signal::SIGILL).unwrap(),
        other => panic!("no crash by {other}"),
    }
}

/// What the child programs run; nothing when this program runs it as a test.
#[test]
fn part() {
    let Some(part) = common::part() else { return };
    // No dump of this program's memory is wanted.
    nix::sys::resource::setrlimit(nix::sys::resource::Resource::RLIMIT_CORE, 0, 0).unwrap();
    match &*part {
        "killed" => {
            let mut system = crashing("plain thread", || ());
            let process = system.thread("ready").process("ready");
            process.spawn_ok(async {
                println!("ready");
                std::future::pending().await
            });
            system.run().unwrap();
        }
        "hanging function" => {
            let mut system = crashing("executor", write_to_nowhere);
            system.on_emergency_within("hangs", Duration::from_millis(20), || {
                loop {
                    std::thread::park();
                }
            });
            system.on_emergency("last", || println!("last"));
            system.run().unwrap();
        }
        "afterwards" => {
            let mut system = System::new("short");
            system.on_emergency("first", || println!("function 1"));
            system.run().unwrap();
            let outcome = system.report().unwrap().safety.functions[0].outcome;
            assert_eq!(outcome, FunctionOutcome::NotRun);
            std::process::abort();
        }
        other => {
            let (what, on) = other.split_once(" on ").unwrap();
            crashing(on, crash_of(what)).run().unwrap();
        }
    }
}

fn ends_by(part: &str, signal: i32, functions: &[&str]) -> common::Ended {
    let ended = Program::start(part).end();
    check(part, &ended, signal, functions);
    ended
}

fn check(part: &str, ended: &common::Ended, signal: i32, functions: &[&str]) {
    assert_eq!(ended.status.signal(), Some(signal), "{part}: {ended:?}");
    let said = ended.said(&["function 1", "function 2", "last"]);
    assert_eq!(said, functions, "{part}: {ended:?}");
}

const BOTH: [&str; 2] = ["function 1", "function 2"];

#[test]
fn a_fault_wherever_it_is() {
    let Some(_watch) = with_signals() else { return };
    for on in ["executor", "thread", "plain thread", "post_run", "function"] {
        ends_by(&format!("write on {on}"), FAULT, &BOTH);
    }
}

#[test]
fn a_stack_that_overflows_is_told_of_as_ever() {
    let Some(_watch) = with_signals() else { return };
    for on in ["executor", "thread", "plain thread", "post_run", "function"] {
        let ended = ends_by(&format!("overflow on {on}"), ABORT, &BOTH);
        assert!(
            ended.errors.contains("has overflowed its stack"),
            "{on}: {ended:?}"
        );
    }
}

#[test]
fn an_abort_and_a_panic_in_a_panic() {
    let Some(_watch) = with_signals() else { return };
    for on in ["executor", "thread", "plain thread", "function"] {
        for what in ["abort", "two panics"] {
            ends_by(&format!("{what} on {on}"), ABORT, &BOTH);
        }
    }
}

#[test]
fn the_other_signals_of_a_crash() {
    let Some(_watch) = with_signals() else { return };
    for (what, signal) in [
        ("bus", Signal::SIGBUS),
        ("arithmetic", Signal::SIGFPE),
        ("instruction", Signal::SIGILL),
    ] {
        ends_by(&format!("{what} on executor"), signal as i32, &BOTH);
    }
}

#[test]
fn one_that_is_sent() {
    let Some(_watch) = with_signals() else { return };
    for signal in [FAULT, ABORT] {
        let mut program = Program::start("killed");
        program.wait_for("ready");
        program.signal(signal);
        check("killed", &program.end(), signal, &BOTH);
    }
}

#[test]
fn a_function_that_hangs_is_left_behind_in_a_crash_too() {
    let Some(_watch) = with_signals() else { return };
    ends_by(
        "hanging function",
        FAULT,
        &["function 1", "function 2", "last"],
    );
}

#[test]
fn after_the_end_a_crash_is_what_it_was_before() {
    let _watch = watchdog();
    if !COMPLETE {
        return;
    }
    ends_by("afterwards", ABORT, &[]);
}
