//! Signals with a default action that ends the program: the emergency functions run first. Each
//! system runs in a program of its own.

#![cfg(all(target_os = "linux", not(luna_portable)))]

use crate::common;

use common::{Program, SpawnOk, has_real_time, skip, watchdog};
use luna::End;
use luna::prelude::*;
use nix::libc;
use nix::sys::resource::{Resource, setrlimit};
use std::os::unix::process::ExitStatusExt;
use std::sync::atomic::{AtomicU32, Ordering};
use std::time::Duration;

/// These ask for an end in order, and are the run's end.
const REQUESTS: [i32; 3] = [libc::SIGINT, libc::SIGTERM, libc::SIGHUP];

/// By default these do nothing, stop the program, or let it go on.
const HARMLESS: [i32; 8] = [
    libc::SIGCHLD,
    libc::SIGCONT,
    libc::SIGSTOP,
    libc::SIGTSTP,
    libc::SIGTTIN,
    libc::SIGTTOU,
    libc::SIGURG,
    libc::SIGWINCH,
];

/// These are handled in any case: the program has crashed, or is asked to end.
const ALWAYS: [i32; 7] = [
    libc::SIGSEGV,
    libc::SIGBUS,
    libc::SIGFPE,
    libc::SIGILL,
    libc::SIGABRT,
    libc::SIGINT,
    libc::SIGTERM,
];

/// All signals that end a program by default, but SIGKILL and those between
/// that the C library keeps for itself.
fn ending() -> impl Iterator<Item = i32> {
    let kept = 32..libc::SIGRTMIN();
    (1..=libc::SIGRTMAX()).filter(move |number| {
        !HARMLESS.contains(number) && *number != libc::SIGKILL && !kept.contains(number)
    })
}

fn send_to_this_program(number: i32) {
    // SAFETY: a plain system call.
    assert_eq!(unsafe { libc::kill(libc::getpid(), number) }, 0);
}

/// Says what a signal does in this program, whatever the program that has started it said.
fn set_action(number: i32, action: libc::sighandler_t) {
    // SAFETY: the action is the default, to ignore it, or `count`, which does what a handler may.
    assert_ne!(unsafe { libc::signal(number, action) }, libc::SIG_ERR);
}

static COUNTED: AtomicU32 = AtomicU32::new(0);

extern "C" fn count(_: libc::c_int) {
    COUNTED.fetch_add(1, Ordering::Relaxed);
}

/// What the child programs run; nothing when this program runs it as a test.
#[test]
fn part() {
    let Some(part) = common::part() else { return };
    let _watch = watchdog();
    // No dump of this program's memory is wanted.
    setrlimit(Resource::RLIMIT_CORE, 0, 0).unwrap();
    let mut system = System::new("signalled");
    system.on_emergency("first", || println!("function 1"));
    system.on_emergency_within("hangs", Duration::from_millis(10), || {
        loop {
            std::thread::park();
        }
    });
    system.on_emergency("second", || println!("function 2"));
    match part.as_str() {
        "hog" => {
            // In microseconds. The kernel's own end of it comes later, and without a word.
            setrlimit(Resource::RLIMIT_RTTIME, 50_000, 20_000_000).unwrap();
            set_action(libc::SIGXCPU, libc::SIG_DFL);
            let executor = system.executor("hog").policy(Policy::fifo(10)).build();
            executor.unwrap().process("hog").spawn_ok(async {
                loop {
                    std::hint::spin_loop();
                }
            });
            system.run().unwrap();
        }
        "handled" | "ignored" => {
            let own: Vec<i32> = ending().filter(|one| !ALWAYS.contains(one)).collect();
            let handler: extern "C" fn(libc::c_int) = count;
            let action = match part.as_str() {
                "handled" => handler as *const () as libc::sighandler_t,
                _ => libc::SIG_IGN,
            };
            for &number in &own {
                set_action(number, action);
            }
            let expected = own.len() as u32 * u32::from(part == "handled");
            let executor = system.executor("control").build().unwrap();
            executor.process("sender").spawn_ok(async move {
                own.iter().for_each(|&number| send_to_this_program(number));
                while COUNTED.load(Ordering::Relaxed) < expected {
                    luna::after(Duration::from_millis(1)).await;
                }
                Ok(())
            });
            let report = system.run().unwrap();
            assert_eq!(report.end, End::Completed);
            println!("completed");
        }
        "many" => {
            set_action(libc::SIGRTMIN(), libc::SIG_DFL);
            let mut system = System::new("signalled often");
            system.on_emergency_within("first", Duration::from_secs(60), || {
                println!("begun");
                let mut line = String::new();
                std::io::stdin().read_line(&mut line).unwrap();
                println!("function 1");
            });
            system.on_emergency("second", || println!("function 2"));
            let executor = system.executor("control").build().unwrap();
            executor.process("waiting").spawn_ok(async {
                println!("ready");
                std::future::pending().await
            });
            system.run().unwrap();
        }
        number => {
            let number: i32 = number.parse().unwrap();
            set_action(number, libc::SIG_DFL);
            let executor = system.executor("control").build().unwrap();
            executor.process("sender").spawn_ok(async move {
                send_to_this_program(number);
                std::future::pending().await
            });
            let report = system.run().unwrap();
            assert_eq!(report.end, End::Signal(number));
            println!("{report}");
            std::process::exit(70 + number);
        }
    }
}

const SAID: [&str; 3] = ["function 1", "function 2", "completed"];

#[test]
fn each_runs_the_functions_first() {
    let _watch = watchdog();
    for number in ending() {
        let ended = Program::start(&number.to_string()).end();
        assert_eq!(ended.said(&SAID), SAID[..2], "signal {number}: {ended:?}");
        match REQUESTS.contains(&number) {
            true => assert_eq!(ended.status.code(), Some(70 + number), "{ended:?}"),
            false => assert_eq!(ended.status.signal(), Some(number), "{ended:?}"),
        }
    }
}

#[test]
fn what_the_program_handles_or_ignores_is_left_to_it() {
    let _watch = watchdog();
    for part in ["handled", "ignored"] {
        let ended = Program::start(part).end();
        assert!(ended.status.success(), "{part}: {ended:?}");
        assert_eq!(ended.said(&SAID), SAID[2..], "{part}: {ended:?}");
    }
}

/// More than there are threads, of a kind that the kernel does not merge: none of them stops the
/// thread that runs a function.
#[test]
fn many_at_once_are_as_one() {
    let _watch = watchdog();
    let mut program = Program::start("many");
    program.wait_for("ready");
    let send = |program: &Program| {
        let process = i32::try_from(program.number()).unwrap();
        // SAFETY: a plain system call.
        assert_eq!(unsafe { libc::kill(process, libc::SIGRTMIN()) }, 0);
    };
    send(&program);
    program.wait_for("begun");
    for _ in 0..100 {
        send(&program);
    }
    program.close_input();
    let ended = program.end();
    assert_eq!(ended.said(&SAID), SAID[..2], "{ended:?}");
    assert_eq!(ended.status.signal(), Some(libc::SIGRTMIN()), "{ended:?}");
}

/// By the kernel, as its limit of real time without a sleep is over.
#[test]
fn a_process_that_takes_its_core_for_ever() {
    let _watch = watchdog();
    if !has_real_time() {
        return skip("no privilege for a real-time policy");
    }
    let ended = Program::start("hog").end();
    assert_eq!(ended.said(&SAID), SAID[..2], "{ended:?}");
    assert_eq!(ended.status.signal(), Some(libc::SIGXCPU), "{ended:?}");
}

#[test]
fn the_page_on_safety_names_them_all() {
    let page = include_str!("../../docs/safety.md");
    for number in ending().filter(|&number| number < libc::SIGRTMIN()) {
        let name = luna_machine::signals::name(number).to_string();
        assert!(page.contains(&name), "{name} is not there");
    }
    assert!(page.contains("SIGRTMIN") && page.contains("SIGRTMAX"));
}
