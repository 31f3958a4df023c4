//! `emergency`: from a trigger until the first emergency function begins, for each kind of trigger,
//! idle and under load. Measured in the same minutes: the wake-up of a thread of the same priority
//! that sleeps until a deadline, as in cyclictest.
//!
//! Under SCHED_FIFO where permitted: as root, or with CAP_SYS_NICE. Each sample is a system of its
//! own. A block is a second; a figure is the median of the blocks' percentiles.

use std::{
    panic,
    sync::{
        Arc,
        atomic::{AtomicBool, AtomicU64, Ordering},
    },
    time::Duration,
};

use luna::{Error, Instant, Policy, System};
use luna_benches::harness::{Case, Goal, is_quick, percentile, run};
use luna_platform::thread::{self, Attributes, EMERGENCY_PRIORITY, Thread};

const NAMES: [[&str; 2]; 2] = [
    [
        "to the first emergency function, idle",
        "to the first emergency function, idle, 99 of 100",
    ],
    [
        "to the first emergency function, under load",
        "to the first emergency function, under load, 99 of 100",
    ],
];
const SLEEPER: &str = "sleeping thread of that priority";

/// The goal, as a multiple of the sleeping thread's wake-up.
const FACTOR: f64 = 1.2;
/// How urgent the process is that triggers, and the load.
const PRIORITY: u8 = 80;
const LOAD_PRIORITY: u8 = 40;
/// How long all sleep before a trigger.
const REST: Duration = Duration::from_micros(300);

fn slice() -> Duration {
    match is_quick() {
        true => Duration::from_millis(100),
        false => Duration::from_secs(1),
    }
}

/// What triggers.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Trigger {
    Process,
    Panic,
    Signal,
    /// A signal by a thread without a real-time policy, such as from the command `kill`.
    OrdinarySignal,
    /// A thread that is no process.
    Driver,
}

const TRIGGERS: [(Trigger, &str); 5] = [
    (Trigger::Process, "LUNA, luna::emergency"),
    (Trigger::Panic, "LUNA, a panic"),
    (Trigger::Signal, "LUNA, SIGTERM"),
    (
        Trigger::OrdinarySignal,
        "LUNA, SIGTERM of an ordinary thread",
    ),
    (Trigger::Driver, "LUNA, a driver's thread"),
];

fn terminate() {
    // SAFETY: a signal to this process, which the system watches for.
    unsafe { libc::kill(libc::getpid(), libc::SIGTERM) };
}

/// The time of one trigger, in nanoseconds.
fn triggered(by: Trigger) -> u64 {
    let (before, began) = (Arc::new(AtomicU64::new(0)), Arc::new(AtomicU64::new(0)));
    let mut system = System::new("bench");
    let first = began.clone();
    system.on_emergency("first", move || {
        first.store(luna::now().as_nanos(), Ordering::Relaxed);
    });
    let executor = system.executor("control").core(0);
    let executor = executor
        .policy(Policy::fifo(PRIORITY))
        .build()
        .expect("there is a core");
    let trigger = system.safety();
    let at = before.clone();
    let note = move || at.store(luna::now().as_nanos(), Ordering::Relaxed);
    let process = async move {
        luna::after(REST).await;
        match by {
            Trigger::Process => {
                let cause = Error::other("bench");
                note();
                Err(luna::emergency(cause))
            }
            Trigger::Panic => {
                note();
                panic!("bench")
            }
            Trigger::Signal => {
                note();
                terminate();
                std::future::pending().await
            }
            Trigger::OrdinarySignal => {
                let sender = std::thread::spawn(move || {
                    std::thread::sleep(REST);
                    note();
                    terminate();
                });
                std::future::pending::<()>().await;
                drop(sender);
                Ok(())
            }
            Trigger::Driver => {
                let driver = std::thread::spawn(move || {
                    std::thread::sleep(REST);
                    let cause = Error::other("bench");
                    note();
                    trigger.raise(cause);
                });
                std::future::pending::<()>().await;
                drop(driver);
                Ok(())
            }
        }
    };
    executor
        .process("culprit")
        .spawn(process)
        .expect("its name is free");
    let outcome = system.run();
    assert_eq!(
        outcome.is_ok(),
        matches!(by, Trigger::Signal | Trigger::OrdinarySignal),
        "it ended for another reason"
    );
    let (before, began) = (
        before.load(Ordering::Relaxed),
        began.load(Ordering::Relaxed),
    );
    assert!(before != 0 && began >= before, "the function did not run");
    began - before
}

/// As cyclictest: how late a thread of the emergency manager's priority wakes from an absolute
/// sleep, for a slice of time.
fn sleeper() -> Vec<u64> {
    let attributes = Attributes::framework("sleeper", Policy::fifo(EMERGENCY_PRIORITY));
    let sleeps = |(): ()| {
        let (mut late, mut next) = (Vec::new(), luna::now());
        let end = next + slice();
        while next < end {
            next += Duration::from_millis(1);
            let until = libc::timespec {
                tv_sec: (next.as_nanos() / 1_000_000_000) as libc::time_t,
                tv_nsec: (next.as_nanos() % 1_000_000_000) as _,
            };
            // SAFETY: the time is valid, and the pointer for the remaining time is null.
            unsafe {
                libc::clock_nanosleep(
                    libc::CLOCK_MONOTONIC,
                    libc::TIMER_ABSTIME,
                    &raw const until,
                    std::ptr::null_mut(),
                );
            }
            late.push((luna::now() - next).as_nanos() as u64);
        }
        late
    };
    let thread = thread::spawn(attributes, |_| Ok::<_, std::io::Error>(()), sleeps);
    let thread = thread.expect("a thread can be made");
    thread.join().expect("it only sleeps")
}

/// Threads of lower priority that compute and use memory on every core, four fifths of the time, so
/// that the kernel's share for ordinary threads remains.
struct Load {
    is_over: Arc<AtomicBool>,
    threads: Vec<Thread<()>>,
}

impl Load {
    fn start() -> Self {
        let is_over = Arc::new(AtomicBool::new(false));
        let threads = thread::available_cores().into_iter().map(|core| {
            let attributes = Attributes::new("load").core(core);
            let over = is_over.clone();
            let loads = move |mut memory: Vec<u8>| {
                while !over.load(Ordering::Relaxed) {
                    let end = Instant::now() + Duration::from_millis(4);
                    while Instant::now() < end {
                        memory.rotate_left(64);
                    }
                    std::thread::sleep(Duration::from_millis(1));
                }
            };
            let attributes = attributes.policy(Policy::fifo(LOAD_PRIORITY));
            let room = |_: &_| Ok::<_, std::io::Error>(vec![1_u8; 1 << 20]);
            thread::spawn(attributes, room, loads).expect("a thread can be made")
        });
        Load {
            threads: threads.collect(),
            is_over,
        }
    }
}

impl Drop for Load {
    fn drop(&mut self) {
        self.is_over.store(true, Ordering::Relaxed);
        for thread in self.threads.drain(..) {
            thread.join().expect("it only computes");
        }
    }
}

/// The two cases of one measurement.
fn cases(
    names: [&'static str; 2],
    peer: &'static str,
    measure: impl Fn() -> Vec<u64> + 'static,
) -> [Case; 2] {
    let cases = Case::of_one(peer, names.map(|name| (name, "µs")), move || {
        let mut samples = measure();
        [50, 99].map(|percent| percentile(&mut samples, percent))
    });
    cases.map(|case| match peer {
        SLEEPER => case,
        _ => {
            let goal = Goal::Times {
                factor: FACTOR,
                name: case.name,
                peer: SLEEPER,
                size: None,
                of: "the sleeping thread's wake-up",
            };
            case.goal(goal)
        }
    })
}

fn main() {
    // The kernel does not prefer the most urgent of the threads that may take a signal, so threads
    // of a program that has to end in time block termination signals.
    let _held_back = luna_machine::signals::HeldBack::here();
    // Deliberate panics would be reported each time; those of checks still are.
    let hook = panic::take_hook();
    panic::set_hook(Box::new(move |info| {
        if info.payload_as_str() != Some("bench") {
            hook(info);
        }
    }));
    let mut all: [Vec<Case>; 4] = Default::default();
    for (loaded, names) in [(false, NAMES[0]), (true, NAMES[1])] {
        let mut add = |measured: [Case; 2]| {
            for (place, case) in measured.into_iter().enumerate() {
                all[usize::from(loaded) * 2 + place].push(case);
            }
        };
        for (trigger, peer) in TRIGGERS {
            add(cases(names, peer, move || {
                let _load = loaded.then(Load::start);
                let end = Instant::now() + slice();
                let mut samples = Vec::new();
                while Instant::now() < end {
                    samples.push(triggered(trigger));
                }
                samples
            }));
        }
        add(cases(names, SLEEPER, move || {
            let _load = loaded.then(Load::start);
            sleeper()
        }));
    }
    run("emergency", all.into_iter().flatten().collect());
}
