//! The child of a bare `fork` in a process: it ends as any program does, and what brings the
//! machine to safety is its parent's alone.

#![cfg(all(target_os = "linux", not(luna_portable)))]

use crate::common;

use common::{PLACEMENTS, Placement, Program, SpawnOk, watchdog};
use luna::End;
use luna::prelude::*;
use nix::libc;
use nix::sys::resource::{Resource, setrlimit};
use nix::sys::signal::{SigSet, Signal, raise};
use nix::sys::wait::{WaitStatus, waitpid};
use nix::unistd::{ForkResult, fork};
use std::time::Duration;

/// What the child does.
const CRASHES: [(&str, fn()); 5] = [
    ("panic", || panic!("in the child")),
    ("fault", || raise(Signal::SIGSEGV).unwrap()),
    ("abort", || std::process::abort()),
    ("end", || {
        // Threads of a system leave those to others, which are not here.
        SigSet::all().thread_unblock().unwrap();
        raise(Signal::SIGTERM).unwrap();
    }),
    ("other", || raise(Signal::SIGUSR1).unwrap()),
];

fn wanted(crash: &str) -> &'static str {
    match crash {
        "panic" => "exited 101",
        "fault" => "killed by SIGSEGV",
        "abort" => "killed by SIGABRT",
        "end" => "killed by SIGTERM",
        _ => "killed by SIGUSR1",
    }
}

/// Calls `child` in a child, and says how that has ended.
fn fork_and(child: impl FnOnce()) {
    // SAFETY: the child calls what a program with one thread may; no other thread of this one holds
    // a lock that it comes to.
    match unsafe { fork() }.unwrap() {
        ForkResult::Child => {
            child();
            // SAFETY: it ends the child without running anything.
            unsafe { libc::_exit(0) };
        }
        ForkResult::Parent { child } => match waitpid(child, None).unwrap() {
            WaitStatus::Exited(_, code) => println!("exited {code}"),
            WaitStatus::Signaled(_, signal, _) => println!("killed by {signal}"),
            other => panic!("{other:?}"),
        },
    }
}

/// A system of its own, in a child.
fn run_a_system_in_the_child() {
    let mut system = System::new("child");
    system.on_emergency("its own", || println!("the child's function"));
    let process = system.thread("own").process("raiser");
    process.spawn_ok(async {
        raise(Signal::SIGUSR1).unwrap();
        std::future::pending().await
    });
    system.run().unwrap();
}

/// What the child programs run; nothing when this program runs it as a test.
#[test]
fn part() {
    let Some(part) = common::part() else { return };
    // No dump of this program's memory is wanted.
    setrlimit(Resource::RLIMIT_CORE, 0, 0).unwrap();
    let mut system = System::new("parent");
    // So long a crash waits for it: longer than the test, if it waits in the child.
    system.on_emergency_within("the parent's", Duration::from_secs(400), || {
        println!("the parent's function");
    });
    let (crash, place) = part.split_once(" on ").unwrap();
    let place = match place {
        "Executor" => Placement::Executor,
        _ => Placement::Thread,
    };
    let crash = CRASHES.iter().find(|(name, _)| *name == crash);
    place
        .process(&mut system, "own", "parent")
        .spawn_ok(async move {
            match crash {
                Some((_, crash)) => fork_and(*crash),
                // A thread of a system runs no other.
                None => std::thread::spawn(|| fork_and(run_a_system_in_the_child))
                    .join()
                    .unwrap(),
            }
            Ok(())
        });
    let report = system.run().unwrap();
    assert_eq!(report.end, End::Completed, "{report}");
    println!("completed");
}

#[test]
fn it_ends_at_once_and_the_parent_goes_on() {
    let _watch = watchdog();
    for (crash, _) in CRASHES {
        for place in PLACEMENTS {
            let part = format!("{crash} on {place:?}");
            let ended = Program::start(&part).end();
            assert!(ended.status.success(), "{part}: {ended:?}");
            let said = [wanted(crash), "the parent's function", "completed"];
            assert_eq!(ended.said(&said), [said[0], said[2]], "{part}: {ended:?}");
        }
    }
}

#[test]
fn it_may_run_a_system_of_its_own() {
    let _watch = watchdog();
    let ended = Program::start("system on Thread").end();
    assert!(ended.status.success(), "{ended:?}");
    let said = [
        "the child's function",
        wanted("system"),
        "completed",
        "the parent's function",
    ];
    assert_eq!(ended.said(&said), said[..3], "{ended:?}");
}
