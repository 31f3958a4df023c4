//! What standard error says of a run: each error once, and a system that was never run.

use crate::common;

use common::{Ended, Program, SpawnOk, watchdog};
use luna::Error;
use luna::prelude::*;
use luna::safety::OnOverrun;
use std::time::Duration;

/// As a `main` that returns it.
fn report(outcome: luna::Result<luna::Report>) {
    if let Err(error) = outcome {
        eprintln!("Error: {error:?}");
    }
}

/// A system with one process, which does nothing.
fn described(name: &str) -> System {
    let mut system = System::new(name);
    let main = system.executor("main").build().unwrap();
    main.process("one").spawn_ok(async { Ok(()) });
    system
}

fn play(part: &str) {
    let mut system = System::new(part);
    match part {
        "two fail" => {
            let main = system.executor("main").build().unwrap();
            for (name, error) in [("drive", "no encoder"), ("brake", "no air")] {
                let fails = async move { Err(Error::other(error)) };
                main.process(name).spawn_ok(fails);
            }
            report(system.run());
        }
        "one goes on" => {
            let main = system.executor("main").build().unwrap();
            main.process("drive")
                .spawn_ok(async { Err(Error::other("no encoder")) });
            main.process("other").spawn_ok(async {
                let mut line = String::new();
                let read = luna::blocking(move || std::io::stdin().read_line(&mut line));
                read.await.map_err(Error::other)?;
                Ok(())
            });
            let _ = system.run();
        }
        "strict deadlock" => {
            let main = system.strict().executor("main").build().unwrap();
            let (own, from_own) = luna::channel::<()>();
            main.process("drive").spawn_ok(async move {
                from_own.recv().await?;
                drop(own);
                Ok(())
            });
            report(system.run());
        }
        "overrun" => {
            let main = system.executor("main").build().unwrap();
            let drive = main
                .process("drive")
                .poll_budget(Duration::from_nanos(1))
                .on_overrun(OnOverrun::Emergency);
            drive.spawn_ok(async {
                loop {
                    luna::yield_now().await;
                }
            });
            report(system.run());
        }
        "never run" => drop(described("servo")),
        "nothing to run" => drop(system),
        "panics" => {
            let outcome = std::panic::catch_unwind(|| {
                let _system = described("servo");
                panic!("on purpose");
            });
            outcome.unwrap_err();
        }
        "refused" => {
            let mut system = described("servo");
            system.executor("main").build().unwrap_err();
            drop(system);
            let mut system = described("servo");
            let thread = system.thread("t").policy(Policy::fifo(99));
            thread.process("two").spawn(async { Ok(()) }).unwrap_err();
            drop(system);
            let mut system = described("servo");
            system.set_parameter_text("nonsense").unwrap_err();
            drop(system);
            let system = described("servo");
            let inside = async { system.run().map(drop) };
            luna::run(inside).unwrap_err();
        }
        "ran" => drop(described("servo").run().unwrap()),
        "does not start" => {
            let mut system = described("servo");
            system.set_parameter("nobody's", 1);
            system.run().unwrap_err();
        }
        _ => unreachable!("{part}"),
    }
}

/// What the child program runs; nothing when this program runs it as a test.
#[test]
fn part() {
    if let Some(part) = common::part() {
        play(&part);
    }
}

/// Without the report that a run with an error prints: its table's lines are indented.
fn without_report(errors: &str) -> Vec<String> {
    let all = errors.lines();
    let rest = all.filter(|line| !line.starts_with("system `") && !line.starts_with("  main "));
    rest.map(str::to_owned).collect()
}

fn lines_of(part: &str) -> Vec<String> {
    let Ended { status, errors, .. } = Program::start(part).end();
    assert!(status.success(), "{errors}");
    without_report(&errors)
}

#[test]
fn the_error_that_a_main_returns_is_printed_once_and_so_are_all_others() {
    let _watch = watchdog();
    let lines = lines_of("two fail");
    let [other, returned] = &lines[..] else {
        panic!("{lines:?}")
    };
    assert!(other.starts_with("luna: process `brake`: "), "{lines:?}");
    assert_eq!(returned, "Error: process `drive`: no encoder");
}

#[test]
fn a_deadlock_and_an_overrun_that_end_a_system_are_printed_once() {
    let _watch = watchdog();
    for (part, wanted) in [
        ("strict deadlock", "is deadlocked"),
        ("overrun", "whose budget is"),
    ] {
        let lines = lines_of(part);
        let found: Vec<_> = lines.iter().filter(|line| line.contains(wanted)).collect();
        assert_eq!(found.len(), 1, "{lines:?}");
        assert!(found[0].starts_with("Error: "), "{lines:?}");
    }
}

#[test]
fn the_error_of_a_process_is_printed_while_the_others_go_on() {
    let _watch = watchdog();
    let mut program = Program::start("one goes on");
    assert_eq!(
        program.error_line(),
        "luna: process `drive`: no encoder\n",
        "before the other process ends"
    );
    program.close_input();
    let ended = program.end();
    assert!(ended.status.success());
    assert_eq!(without_report(&ended.errors), [""; 0]);
    assert!(ended.errors.starts_with("system `one goes on`: completed"));
}

#[test]
fn a_system_that_is_dropped_without_run_says_so_once() {
    let _watch = watchdog();
    assert_eq!(
        lines_of("never run"),
        ["luna: system `servo` was dropped without `run`: none of its processes (1) has run"]
    );
}

#[test]
fn nothing_is_said_where_there_was_nothing_to_run_or_another_reason_to_end() {
    let _watch = watchdog();
    for part in [
        "nothing to run",
        "panics",
        "refused",
        "ran",
        "does not start",
    ] {
        let lines = lines_of(part);
        let said = lines.iter().any(|line| line.contains("without `run`"));
        assert!(!said, "{part}: {lines:?}");
    }
}
