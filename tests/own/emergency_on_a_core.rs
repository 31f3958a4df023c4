//! An emergency worker that waits on the core of a real-time thread is woken only if it can take
//! that core over.

use crate::common;
use common::{SpawnOk, skip};
use luna::Error;
use luna::prelude::*;
use luna::report::FunctionOutcome;
use luna_platform::thread::available_cores;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc;
use std::time::Duration;

/// Longer than the watchdog waits: what keeps a function waiting is no limit.
const HOUR: Duration = Duration::from_secs(3600);

/// An executor for a real-time thread on this core.
fn on(core: usize, system: &mut System, name: &str) -> luna::Executor {
    let executor = system.executor(name).core(core);
    executor.policy(Policy::fifo(50)).build().unwrap()
}

/// A function that runs on its core, at the highest priority, does not give way to another system's
/// worker that waits there.
#[test]
fn a_function_of_another_system_on_the_same_core_does_not_keep_the_functions_waiting() {
    own_process!();
    let cores = available_cores();
    if cores.len() < 2 {
        skip("there is one core");
        return;
    }
    let mut coupled = System::new("coupled");
    let mut other = System::new("other");
    let has_begun = Arc::new(AtomicBool::new(false));
    let begun = has_begun.clone();
    other.on_emergency_within("brakes", HOUR, move || begun.store(true, Ordering::Release));
    let trigger = other.safety();
    coupled.on_emergency_within("couples", HOUR, move || {
        trigger.raise(Error::other("the other has an emergency"));
        while !has_begun.load(Ordering::Acquire) {
            std::hint::spin_loop();
        }
    });
    let (running, is_running) = mpsc::channel();
    on(cores[0], &mut other, "other")
        .process("idle")
        .spawn_ok(async move {
            running.send(()).unwrap();
            std::future::pending::<luna::Result<()>>().await
        });
    on(cores[0], &mut coupled, "coupled")
        .process("raiser")
        .spawn_ok(async { Err(luna::emergency(Error::other("now"))) });
    let other = std::thread::spawn(move || {
        other.run().unwrap_err();
        other.report().unwrap().safety
    });
    is_running.recv().unwrap();
    coupled.run().unwrap_err();
    let safety = coupled.report().unwrap().safety;
    assert_eq!(safety.functions[0].outcome, FunctionOutcome::Ran);
    let safety = other.join().unwrap();
    assert_eq!(safety.functions[0].outcome, FunctionOutcome::Ran);
}

/// Not a test: what the programs below do.
#[test]
#[cfg(all(target_os = "linux", not(luna_portable)))]
fn part() {
    if common::part().as_deref() != Some("limited") {
        return;
    }
    use luna_machine::facts::parse::core_list;
    if !common::has_real_time() {
        println!("no priorities");
        return;
    }
    let (notify, seen) = mpsc::channel();
    let mut system = System::new("limited");
    system.on_emergency_within("where", HOUR, move || {
        let status = std::fs::read_to_string("/proc/thread-self/status").unwrap();
        let cores = status
            .lines()
            .find_map(|line| line.strip_prefix("Cpus_allowed_list:"));
        let cores = core_list(cores.unwrap()).unwrap();
        notify
            .send((luna_platform::thread::current_policy(), cores))
            .unwrap();
    });
    on(available_cores()[0], &mut system, "control")
        .process("raiser")
        .spawn_ok(async { Err(luna::emergency(Error::other("now"))) });
    system.run().unwrap_err();
    let (policy, cores) = seen.recv().unwrap();
    match (policy, cores == available_cores()) {
        (Policy::Other, true) => println!("ordinary, and free to move"),
        (policy, _) => println!("{policy} on {cores:?}"),
    }
}

/// The user's threads have their policies and the emergency's do not: an ordinary thread that waits
/// on the caller's core would run after everything else there.
#[test]
#[cfg(all(target_os = "linux", not(luna_portable)))]
fn one_that_was_refused_its_priority_is_not_called() {
    own_process!();
    if available_cores().len() < 2 {
        skip("there is one core");
        return;
    }
    let Some(ended) = common::as_limited_user("limited") else {
        return;
    };
    let lines = ["no priorities", "ordinary, and free to move"];
    match ended.said(&lines)[..] {
        ["no priorities"] => skip("the limit gives no priority"),
        ["ordinary, and free to move"] => {}
        _ => panic!("{ended:?}"),
    }
}
