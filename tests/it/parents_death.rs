//! The death of the program that started this one, as an emergency.

#![cfg(unix)]

use crate::common;
use common::{COMPLETE, Program, SpawnOk, skip, watchdog};
use luna::Error;
use luna::prelude::*;
use luna::safety::Cause;
use std::process::{Command, Stdio};

fn system() -> System {
    let mut system = System::new("orphan");
    system.emergency_at_parents_death();
    system.on_emergency("neutral", || println!("neutral"));
    system
}

/// What the child programs run; nothing when this program runs it as a test.
#[test]
fn part() {
    let Some(part) = common::part() else { return };
    let _watch = watchdog();
    match &*part {
        "parent" => {
            // Its child writes to the same output, and lives on.
            let child = Command::new(std::env::current_exe().unwrap())
                .args([
                    &*common::part_of_caller(),
                    "--exact",
                    "--nocapture",
                    "--test-threads=1",
                ])
                .env("LUNA_TEST_PART", "child")
                .stdin(Stdio::null())
                .spawn()
                .unwrap();
            std::mem::forget(child);
            loop {
                std::thread::park();
            }
        }
        "child" => {
            let mut system = system();
            let main = system.executor("main").build().unwrap();
            main.process("servo").spawn_ok(async {
                println!("\nready");
                std::future::pending().await
            });
            let error = system.run().unwrap_err();
            println!("\n{error}");
            let latched = system.safety().state().latched.unwrap();
            assert_eq!(latched.cause, Cause::ParentDied);
            std::process::exit(0);
        }
        other => panic!("no part {other}"),
    }
}

#[test]
fn it_is_one() {
    let _watch = watchdog();
    if !COMPLETE {
        return skip("no processes are watched here");
    }
    let mut program = Program::start("parent");
    program.wait_for("ready");
    // Nothing of the parent can say so.
    program.signal(nix::sys::signal::Signal::SIGKILL as i32);
    program.wait_for("neutral");
    program.wait_for("the parent process has died");
    program.end();
}

#[test]
fn while_the_parent_lives_there_is_none() {
    let _watch = watchdog();
    let mut system = system();
    let main = system.executor("main").build().unwrap();
    main.process("short")
        .spawn_ok(async { Err(Error::other("its own")) });
    let error = system.run().unwrap_err();
    assert_eq!(error.to_string(), "process `short`: its own");
}
