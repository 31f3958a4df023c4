//! Signals while a process is blocked: it does not keep the system from its end.

#![cfg(unix)]

use crate::common;
use common::{SpawnOk, end_by, exit_by, watchdog, with_signals};
use luna::Exit;
use luna::prelude::*;
use std::time::Duration;

const INTERRUPT: i32 = 2;
const TERMINATE: i32 = 15;

/// What the child programs run; nothing when this program runs it as a test.
#[test]
fn part() {
    let Some(part) = common::part() else { return };
    let _watch = watchdog();
    match part.as_str() {
        "blocked" => {
            let mut system = System::new("blocked");
            let console = system.thread("console");
            console.process("operator").spawn_ok(async {
                println!("ready");
                let mut line = String::new();
                std::io::stdin().read_line(&mut line)?;
                Ok(())
            });
            let control = system.executor("control").build().unwrap();
            control
                .process("waiting")
                .spawn_ok(std::future::pending::<luna::Result<()>>());
            let start = luna::now();
            let report = system.run().unwrap();
            assert!(
                luna::now() - start >= Duration::from_secs(2),
                "it was given time"
            );
            let abandoned = |name| {
                report
                    .threads
                    .iter()
                    .find(|thread| thread.name == name)
                    .unwrap()
                    .abandoned
            };
            assert!(abandoned("console") && !abandoned("control"), "{report}");
            assert_eq!(report.processes[0].exit, None);
            assert_eq!(report.processes[1].exit, Some(Exit::Cancelled));
            exit_by(&report)
        }
        "blocked at a buddy" => {
            let mut system = System::new("blocked");
            let control = system.executor("control").build().unwrap();
            control.process("reader").spawn_ok(async {
                luna::blocking(|| {
                    println!("ready");
                    let mut line = String::new();
                    let _ = std::io::stdin().read_line(&mut line);
                })
                .await;
                Ok(())
            });
            let report = system.run().unwrap();
            assert!(
                report.threads.iter().all(|thread| !thread.abandoned),
                "{report}"
            );
            assert_eq!(report.processes[0].exit, Some(Exit::Cancelled));
            exit_by(&report)
        }
        other => panic!("no part {other}"),
    }
}

#[test]
fn a_blocked_process_is_left_behind_and_named() {
    let Some(_watch) = with_signals() else { return };
    let ended = end_by("blocked", TERMINATE);
    assert_eq!(ended.status.code(), Some(70 + TERMINATE), "{ended:?}");
    for part in ["`console` did not end", "`operator`"] {
        assert!(ended.errors.contains(part), "{part} in {ended:?}");
    }
    assert!(
        !ended.errors.contains("`control`") && !ended.errors.contains("`waiting`"),
        "{ended:?}"
    );
    let row = |name| {
        ended
            .output
            .lines()
            .find(|line| line.trim_start().starts_with(name))
            .unwrap()
    };
    assert!(
        row("console").contains("left to itself") && !row("control").contains("left to itself"),
        "{ended:?}"
    );
}

#[test]
fn a_blocking_call_of_a_process_holds_up_nobody() {
    let Some(_watch) = with_signals() else { return };
    let ended = end_by("blocked at a buddy", INTERRUPT);
    assert_eq!(ended.status.code(), Some(70 + INTERRUPT), "{ended:?}");
    assert!(!ended.errors.contains("did not end"), "{ended:?}");
}
