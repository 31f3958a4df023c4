//! A system at a standstill reports it once, with the circle. A system that can still be woken
//! reports nothing.

mod circles;
use crate::common;
mod later;
mod messages;
mod none;

use common::{COMPLETE, PLACEMENTS, Placement, Program, SpawnOk, deadlock_of, strict, watchdog};
use luna::inspect::{Operation, Partner};
use luna::prelude::*;
use luna::system::ProcessBuilder;
use luna::{End, Error};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, mpsc};
use std::time::Duration;

/// Two processes that each receive from the other first.
fn spawn_two_that_receive_first(left: ProcessBuilder, right: ProcessBuilder) {
    let (to_left, from_right) = luna::channel::<u32>();
    let (to_right, from_left) = luna::channel::<u32>();
    let from_right = from_right.named("to left");
    left.spawn_ok(async move {
        let n = from_right.recv().await?;
        to_right.send(n).await?;
        Ok(())
    });
    right.spawn_ok(async move {
        let n = from_left.recv().await?;
        to_left.send(n).await?;
        Ok(())
    });
}

/// Long enough for many looks.
const LONG: Duration = Duration::from_millis(300);

#[test]
fn on_a_virtual_clock_it_ends_a_system_that_is_not_strict() {
    let _watch = watchdog();
    let mut system = System::new("virtual");
    system.virtual_clock();
    let main = system.executor("main").build().unwrap();
    let names = ["left", "right"].map(String::from);
    spawn_two_that_receive_first(
        main.process(&names[0]),
        main.process(format!("{}!", names[1])),
    );
    let deadlock = deadlock_of(&system);
    assert_eq!(deadlock.waits[1].process, "right!");
    assert_eq!(system.report().unwrap().end, End::Deadlock);
}

#[test]
fn a_clone_that_keeps_a_channel_open_is_named() {
    let _watch = watchdog();
    let mut system = strict("kept");
    let main = system.executor("main").build().unwrap();
    let (jobs, todo) = luna::channel::<u32>();
    let _kept = jobs.clone();
    main.process("source").spawn_ok(async move {
        jobs.send(1).await?;
        Ok(())
    });
    main.process("worker").spawn_ok(async move {
        while todo.recv().await.is_ok() {}
        Ok(())
    });
    let deadlock = deadlock_of(&system);
    if COMPLETE {
        assert_eq!(
            deadlock.waits[0].partner,
            Partner::Ended("source".to_owned())
        );
        let text = deadlock.to_string();
        assert!(text.contains("a clone of that end still lives"), "{text}");
    }
}

/// Played by children of these tests.
#[test]
fn part() {
    match common::part().as_deref() {
        Some("system") => messages::run_stuck(false),
        Some("alone") => messages::run_stuck(true),
        #[cfg(unix)]
        Some("ends") => messages::run_revived(messages::Then::Ends),
        #[cfg(unix)]
        Some("goes on") => messages::run_revived(messages::Then::GoesOn),
        #[cfg(unix)]
        Some("stuck again") => messages::run_revived(messages::Then::IsStuckAgain),
        _ => {}
    }
}
