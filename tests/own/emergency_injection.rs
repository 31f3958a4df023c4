//! Emergencies at random instants of a system's start, run and end, of every kind, several at once.
//! Each function runs once if there was an emergency, never twice, and never without one.
//!
//! LUNA_EMERGENCIES sets how many; the default is 150. LUNA_SEED repeats a run, as far as the
//! machine allows. Crashes are injected into programs of their own, one for each hundred of the
//! others.

use crate::common;
use common::{Program, Random, SpawnOk, say, seed, watchdog, with_signals};
use luna::prelude::*;
use luna::report::FunctionOutcome;
use luna::safety::{Degree, OnOverrun, Watchdog};
use luna::{End, Error};
use luna_platform::clock::Instant;
use std::io::Write;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex};
use std::time::Duration;

/// What triggers, and whether it is certain that the system notices it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Kind {
    Panic,
    Raised,
    Overrun,
    Watchdog,
    /// A driver's thread that loses its device.
    Device,
    Signal,
}

const KINDS: [Kind; 6] = [
    Kind::Panic,
    Kind::Raised,
    Kind::Overrun,
    Kind::Watchdog,
    Kind::Device,
    Kind::Signal,
];

fn emergencies() -> u64 {
    let asked = std::env::var("LUNA_EMERGENCIES").ok();
    asked.and_then(|asked| asked.parse().ok()).unwrap_or(150)
}

fn micros(random: &mut Random, most: u64) -> Duration {
    Duration::from_micros(random.below(most))
}

/// Keeps the processor, by the machine's clock: a virtual one stands meanwhile.
fn burn(time: Duration) {
    let end = Instant::now_real() + time;
    while Instant::now_real() < end {
        std::hint::spin_loop();
    }
}

/// Takes its time before, in and after its body.
struct Phased {
    before: Duration,
    within: Duration,
    after: Duration,
}

impl Process for Phased {
    fn pre_run(&mut self) -> luna::Result<()> {
        burn(self.before);
        Ok(())
    }

    async fn run(&mut self) -> luna::Result<()> {
        luna::after(self.within).await;
        Ok(())
    }

    fn post_run(&mut self) {
        burn(self.after);
    }
}

/// What happened in one round.
#[derive(Default)]
struct Record {
    /// The functions' numbers, as they ran.
    ran: Mutex<Vec<usize>>,
    /// A trigger that the system must notice was reached.
    is_certain: AtomicBool,
    triggers: AtomicUsize,
}

const FUNCTIONS: usize = 3;

/// Adds the trigger; returns the thread's work, if the trigger is a thread.
fn add(
    kind: Kind,
    number: usize,
    system: &mut System,
    random: &mut Random,
    record: &Arc<Record>,
) -> Option<Box<dyn FnOnce() + Send>> {
    let name = format!("{kind:?} {number}");
    let delay = micros(random, 400);
    let record = record.clone();
    let reach = move |is_certain: bool| {
        record.is_certain.fetch_or(is_certain, Ordering::SeqCst);
        record.triggers.fetch_add(1, Ordering::SeqCst);
    };
    let place = random.below(4);
    let process = |system: &mut System| match place {
        0 => common::Placement::Executor.process(system, &name, &name),
        1 => common::Placement::Thread.process(system, &name, &name),
        // On a real-time core, where an emergency worker waits.
        _ => {
            let cores = luna_platform::thread::available_cores();
            let core = cores[(place as usize) % cores.len()];
            let executor = system.executor(&name).core(core).policy(Policy::fifo(10));
            executor.build().unwrap().process(&name)
        }
    };
    match kind {
        Kind::Panic => {
            let body = async move {
                luna::after(delay).await;
                reach(true);
                panic!("injected");
            };
            process(system).spawn_ok(body);
        }
        Kind::Raised => {
            let body = async move {
                luna::after(delay).await;
                reach(true);
                Err(luna::emergency(Error::other("injected")))
            };
            process(system).spawn_ok(body);
        }
        Kind::Overrun => {
            let body = async move {
                // Its very first poll may be one.
                reach(false);
                luna::after(delay).await;
                // It is one as this poll ends, unless the clock stands still.
                burn(Duration::from_micros(2));
                reach(true);
                Ok(())
            };
            let process = process(system).poll_budget(Duration::from_nanos(1));
            process.on_overrun(OnOverrun::Emergency).spawn_ok(body);
        }
        Kind::Watchdog => {
            let trigger = system.safety();
            let watchdog = Watchdog::new(delay);
            watchdog.feed();
            let expiries = watchdog.process(move || {
                reach(true);
                trigger.raise(Error::other("not fed"));
            });
            process(system).spawn_ok(expiries);
        }
        Kind::Device => {
            let trigger = system.safety();
            let delay = micros(random, 2500);
            return Some(Box::new(move || {
                std::thread::sleep(delay);
                reach(false);
                trigger.raise(Error::other("device lost"));
            }));
        }
        Kind::Signal => {
            #[cfg(unix)]
            {
                use nix::sys::signal::{Signal, kill};
                let signal = [Signal::SIGINT, Signal::SIGTERM][random.below(2) as usize];
                let delay = micros(random, 2500);
                return Some(Box::new(move || {
                    std::thread::sleep(delay);
                    reach(false);
                    kill(nix::unistd::getpid(), signal).unwrap();
                }));
            }
        }
    }
    None
}

/// How many triggers were reached, and whether the functions ran.
fn round(number: u64, seed: u64, has_signals: bool) -> (usize, bool) {
    let random = &mut Random::new(seed ^ number.wrapping_mul(0x9e37_79b9));
    let record = Arc::new(Record::default());
    let mut system = System::new("injected");
    // Budgets are of the wall's clock, and watchdogs of a time that moves.
    let is_virtual = random.below(5) == 0;
    if is_virtual {
        system.virtual_clock();
    }
    for number in 0..FUNCTIONS {
        let record = record.clone();
        system.on_emergency(&format!("function {number}"), move || {
            record.ran.lock().unwrap().push(number);
        });
    }
    for number in 0..1 + random.below(2) {
        let process = Phased {
            before: micros(random, 200),
            within: micros(random, 1000),
            after: micros(random, 200),
        };
        let name = format!("phased {number}");
        let place = common::PLACEMENTS[random.below(2) as usize];
        place.process(&mut system, &name, &name).spawn_ok(process);
    }
    let mut kinds = vec![KINDS[random.below(KINDS.len() as u64) as usize]];
    while random.below(3) == 0 {
        kinds.push(KINDS[random.below(KINDS.len() as u64) as usize]);
    }
    // A second signal is the same request for a while, and then ends the program.
    let mut has_one = !has_signals;
    kinds.retain(|&kind| kind != Kind::Signal || !std::mem::replace(&mut has_one, true));
    kinds.retain(|&kind| kind != Kind::Overrun || !is_virtual);
    let threads: Vec<_> = kinds
        .iter()
        .enumerate()
        .filter_map(|(number, &kind)| add(kind, number, &mut system, random, &record))
        .map(std::thread::spawn)
        .collect();
    let _ = system.run();
    let report = system.report().unwrap();
    // What comes after the end has no effect.
    for thread in threads {
        thread.join().unwrap();
    }
    let what = || format!("round {number} of LUNA_SEED={seed}: {kinds:?}: {report:?}");
    let ran = record.ran.lock().unwrap().clone();
    let is_emergency = match report.end {
        End::Completed => false,
        End::Signal(_) | End::Panic | End::Overrun | End::Emergency => true,
        other => panic!("{other:?}: {}", what()),
    };
    if is_emergency {
        assert_eq!(ran, [0, 1, 2], "lost or twice: {}", what());
    } else {
        assert!(ran.is_empty(), "for nothing: {ran:?}: {}", what());
    }
    let is_certain = record.is_certain.load(Ordering::SeqCst);
    assert!(is_emergency || !is_certain, "lost: {}", what());
    assert_eq!(
        report.safety.state.degree == Degree::Emergency,
        is_emergency,
        "{}",
        what()
    );
    let outcome = match is_emergency {
        true => FunctionOutcome::Ran,
        false => FunctionOutcome::NotRun,
    };
    assert!(
        report
            .safety
            .functions
            .iter()
            .all(|one| one.outcome == outcome),
        "{}",
        what()
    );
    let triggers = record.triggers.load(Ordering::SeqCst);
    // The trigger of the previous round may come late, from a thread that has to wait for a core.
    let is_late_signal = matches!(report.end, End::Signal(_));
    assert!(
        !is_emergency || triggers > 0 || is_late_signal,
        "for nothing: {}",
        what()
    );
    (triggers, is_emergency)
}

/// Signals that come when no system is there to receive them.
#[cfg(unix)]
fn survive_signals() {
    use nix::sys::signal::{SaFlags, SigAction, SigHandler, SigSet, Signal, sigaction};
    extern "C" fn ignore(_: i32) {}
    let action = SigAction::new(
        SigHandler::Handler(ignore),
        SaFlags::SA_RESTART,
        SigSet::empty(),
    );
    for signal in [Signal::SIGINT, Signal::SIGTERM] {
        // SAFETY: the handler does nothing.
        unsafe { sigaction(signal, &action) }.unwrap();
    }
}

#[cfg(not(unix))]
fn survive_signals() {}

/// What the child programs run; nothing when this program runs it as a test.
#[test]
fn part() {
    let Some(part) = common::part() else { return };
    if let Some(number) = part.strip_prefix("crash ") {
        #[cfg(unix)]
        crash(number.parse().unwrap());
        panic!("{number}: no crash");
    }
    survive_signals();
    // Those on purpose would fill the log.
    let hook = std::panic::take_hook();
    std::panic::set_hook(Box::new(move |info| {
        if info.payload_as_str() != Some("injected") {
            hook(info);
        }
    }));
    let (seed, has_signals) = (part.parse().unwrap(), common::COMPLETE);
    let (mut triggers, mut ran) = (0, 0);
    for number in 0..emergencies() {
        let (reached, has_run) = round(number, seed, has_signals);
        triggers += reached;
        ran += usize::from(has_run);
    }
    println!("summary: {triggers} triggers, {ran} systems whose functions ran");
}

#[test]
fn none_is_lost_and_none_runs_twice() {
    own_process!(long);
    // The long form takes longer than a watchdog.
    let _watch = (emergencies() <= 1000).then(watchdog);
    // In a program of its own, with signals of its own.
    let ended = Program::start(&seed().to_string()).end();
    let shown = ended.errors.lines().rev().take(40).collect::<Vec<_>>();
    assert!(ended.status.success(), "{}\n{shown:#?}", ended.output);
    let summary = ended.output.lines().find(|line| line.contains("summary:"));
    say(&format!("{} systems, {}", emergencies(), summary.unwrap()));
}

/// Crashes at an instant of the system's life that `number` says.
#[cfg(unix)]
fn crash(number: u64) {
    use nix::sys::signal::{Signal, raise};
    let random = &mut Random::new(number);
    nix::sys::resource::setrlimit(nix::sys::resource::Resource::RLIMIT_CORE, 0, 0).unwrap();
    /// Whether the system lives: from the first `pre_run` to the last `post_run`. A thread that
    /// crashes holds the lock.
    static LIVES: Mutex<bool> = Mutex::new(false);
    struct Life(Phased);
    impl Process for Life {
        fn pre_run(&mut self) -> luna::Result<()> {
            *LIVES.lock().unwrap() = true;
            self.0.pre_run()
        }
        async fn run(&mut self) -> luna::Result<()> {
            self.0.run().await
        }
        fn post_run(&mut self) {
            self.0.post_run();
            // If another thread is about to crash, this lock is never acquired.
            *LIVES.lock().unwrap() = false;
        }
    }
    let mut system = System::new("crashing");
    for number in 0..FUNCTIONS {
        system.on_emergency("function", move || {
            // One write, past what the harness would keep.
            let _ = std::io::stdout().write_all(format!("ran {number}\n").as_bytes());
        });
    }
    let process = Life(Phased {
        before: micros(random, 2000),
        within: micros(random, 2000),
        after: micros(random, 2000),
    });
    system.thread("own").process("life").spawn_ok(process);
    let delay = micros(random, 6000);
    let how = random.below(4);
    std::thread::spawn(move || {
        loop {
            let lives = LIVES.lock().unwrap();
            if *lives {
                break;
            }
            drop(lives);
            std::thread::yield_now();
        }
        std::thread::sleep(delay);
        let lives = LIVES.lock().unwrap();
        if !*lives {
            // Too late for this number.
            return;
        }
        println!("crashes");
        match how {
            0 => std::process::abort(),
            1 => raise(Signal::SIGSEGV).unwrap(),
            2 => raise(Signal::SIGBUS).unwrap(),
            _ => raise(Signal::SIGFPE).unwrap(),
        }
        drop(lives);
    });
    let _ = system.run();
    println!("ended");
    std::process::exit(0);
}

#[cfg(unix)]
#[test]
fn in_crashes_neither() {
    own_process!(long);
    use std::os::unix::process::ExitStatusExt;
    let Some(_watch) = with_signals() else { return };
    let _watch = (emergencies() <= 1000).then(watchdog);
    let random = &mut Random::seeded();
    let mut crashed = 0;
    let programs = (emergencies() / 100).max(10);
    for _ in 0..programs {
        let number = random.below(u64::MAX);
        let ended = Program::start(&format!("crash {number}")).end();
        let lines: Vec<_> = ended
            .lines()
            .filter(|line| ["crashes", "ended"].contains(line) || line.starts_with("ran "))
            .collect();
        if ended.status.success() {
            assert_eq!(lines, ["ended"], "crash {number}: {ended:?}");
            continue;
        }
        crashed += 1;
        assert!(ended.status.signal().is_some(), "crash {number}: {ended:?}");
        assert_eq!(
            lines,
            ["crashes", "ran 0", "ran 1", "ran 2"],
            "crash {number}: {ended:?}"
        );
    }
    say(&format!("{programs} programs, {crashed} crashed"));
}
