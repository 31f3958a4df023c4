//! The emergency functions run before the panic hook prints, which takes long with a backtrace.
//! Each system runs in a program of its own, since the hook is the whole program's.

use crate::common;

use common::{Ended, PLACEMENTS, Program, watchdog};
use luna::End;
use luna::prelude::*;
use luna::time::Timers;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::process::Command;
use std::time::Duration;

/// Panics as it is dropped.
struct Bad;

impl Drop for Bad {
    fn drop(&mut self) {
        panic!("in a drop");
    }
}

/// Panics before its body.
struct Unprepared;

impl Process for Unprepared {
    fn pre_run(&mut self) -> luna::Result<()> {
        panic!("in pre_run")
    }

    async fn run(&mut self) -> luna::Result<()> {
        Ok(())
    }
}

/// What the child programs run; nothing when this program runs it as a test.
#[test]
fn part() {
    let Some(part) = common::part() else { return };
    let _watch = watchdog();
    let (what, place) = part.rsplit_once(" on ").unwrap();
    let place = PLACEMENTS
        .into_iter()
        .find(|one| format!("{one:?}") == place)
        .unwrap();
    let mut system = System::new("panicking");
    if common::has_real_time() {
        // So that its functions are on threads above all others.
        let urgent = system.executor("urgent").policy(Policy::fifo(10)).build();
        drop(urgent.unwrap());
    }
    system.on_emergency("neutral", || eprintln!("function 1"));
    if what == "callback" {
        system.timers(Timers::Manager);
    }
    let timers = system.timer_manager();
    let process = place.process(&mut system, "place", "culprit");
    match what {
        "body" => process.spawn(async { panic!("in the body") }),
        "builder" => {
            process.spawn(|| -> std::future::Ready<luna::Result<()>> { panic!("no body") })
        }
        "drop" => process.spawn(async {
            let _bad = Bad;
            Ok(())
        }),
        "another hook" => process.spawn(async {
            std::panic::set_hook(Box::new(|_| eprintln!("panicked at: another hook")));
            panic!("in the body")
        }),
        "callback" => process.spawn(async move {
            let timers = timers.unwrap();
            let callback = timers.callback("bad", |_| panic!("in a callback"))?;
            callback.after(Duration::ZERO);
            std::future::pending().await
        }),
        "caught" => process.spawn(async {
            let outcome = catch_unwind(AssertUnwindSafe(|| panic!("in the body")));
            outcome.unwrap_err();
            eprintln!("went on");
            Ok(())
        }),
        "caught on purpose" => process.spawn(async {
            luna::safety::catch_panic(|| panic!("in the body")).unwrap_err();
            eprintln!("went on");
            Ok(())
        }),
        "preparation" => {
            let executor = system.executor("late").build().unwrap();
            process.spawn(async move {
                let late = executor.process("late").spawn(Unprepared);
                assert!(late.unwrap_err().to_string().contains("in pre_run"));
                eprintln!("went on");
                Ok(())
            })
        }
        other => panic!("no part {other}"),
    }
    .unwrap();
    let outcome = system.run();
    let end = system.report().unwrap().end;
    assert_eq!(outcome.is_err(), end == End::Panic, "{outcome:?}");
    eprintln!("ended by {end:?}");
}

fn run(part: &str) -> Ended {
    let mut command = Command::new(std::env::current_exe().unwrap());
    command.env("RUST_BACKTRACE", "1");
    let ended = Program::start_by(command, &common::part_of_caller(), part).end();
    assert!(ended.status.success(), "{part}: {ended:?}");
    ended
}

/// What was said on standard error of this, in this order.
fn said(ended: &Ended) -> Vec<&str> {
    let known = [
        "function 1",
        "panicked at",
        "stack backtrace:",
        "went on",
        "ended by Panic",
        "ended by Completed",
    ];
    let lines = ended.errors.lines();
    lines
        .filter_map(|line| known.into_iter().find(|known| line.contains(known)))
        .collect()
}

#[test]
fn the_functions_run_before_the_hook() {
    let _watch = watchdog();
    for what in ["body", "builder", "drop", "callback"] {
        for place in PLACEMENTS {
            let part = format!("{what} on {place:?}");
            let ended = run(&part);
            let order = [
                "function 1",
                "panicked at",
                "stack backtrace:",
                "ended by Panic",
            ];
            assert_eq!(said(&ended), order, "{part}: {ended:?}");
        }
    }
}

#[test]
fn a_hook_that_is_set_later_runs_before_them() {
    let _watch = watchdog();
    for place in PLACEMENTS {
        let ended = run(&format!("another hook on {place:?}"));
        let order = ["panicked at", "function 1", "ended by Panic"];
        assert_eq!(said(&ended), order, "{ended:?}");
    }
}

#[test]
fn a_panic_that_the_body_catches() {
    let _watch = watchdog();
    for place in PLACEMENTS {
        let ended = run(&format!("caught on {place:?}"));
        let order = [
            "function 1",
            "panicked at",
            "stack backtrace:",
            "went on",
            "ended by Panic",
        ];
        assert_eq!(said(&ended), order, "{ended:?}");
    }
}

#[test]
fn a_panic_that_is_announced_to_be_caught_is_none() {
    let _watch = watchdog();
    for what in ["caught on purpose", "preparation"] {
        for place in PLACEMENTS {
            let ended = run(&format!("{what} on {place:?}"));
            let order = [
                "panicked at",
                "stack backtrace:",
                "went on",
                "ended by Completed",
            ];
            assert_eq!(said(&ended), order, "{what}: {ended:?}");
        }
    }
}
