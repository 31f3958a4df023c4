//! SCHED_DEADLINE: given and read back, or refused with a reason; no thread inherits it.

#![cfg(all(target_os = "linux", not(luna_portable), not(loom)))]

use luna_machine::shortfall::{PolicyRefusal, Shortfall};
use luna_platform::thread::{
    AttributeError, Attributes, Mode, Policy, SpawnError, Thread, available_cores, current_policy,
    spawn,
};
use std::convert::Infallible;
use std::sync::mpsc::{Receiver, Sender, channel};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Duration;

/// One test at a time: what one is given of the processors, another may be refused.
fn alone() -> MutexGuard<'static, ()> {
    static ALONE: Mutex<()> = Mutex::new(());
    ALONE.lock().unwrap_or_else(PoisonError::into_inner)
}

fn policy(runtime: u64, period: u64) -> Policy {
    let [runtime, period] = [runtime, period].map(Duration::from_micros);
    Policy::deadline(runtime, period, period)
}

fn start<T: Send + 'static>(
    policy: Policy,
    body: impl FnOnce() -> T + Send + 'static,
) -> Result<Thread<T>, SpawnError<Infallible>> {
    let attributes = Attributes::new("deadline")
        .policy(policy)
        .mode(Mode::Strict);
    spawn(attributes, |_| Ok(()), |()| body())
}

/// Why a policy was refused.
#[track_caller]
fn refusal<T: std::fmt::Debug>(
    outcome: Result<Thread<T>, SpawnError<Infallible>>,
) -> PolicyRefusal {
    match outcome {
        Err(SpawnError::Refused(refusal)) => match Shortfall::of(&refusal) {
            Shortfall::Policy { why, .. } => why,
            other => panic!("expected a refused policy, got {other:?}"),
        },
        other => panic!("expected a refusal, got {other:?}"),
    }
}

/// A thread that has the policy; says why a test is skipped where it is not given.
fn granted<T: Send + std::fmt::Debug + 'static>(
    test: &str,
    policy: Policy,
    body: impl FnOnce() -> T + Send + 'static,
) -> Option<Thread<T>> {
    match start(policy, body) {
        Ok(thread) => Some(thread),
        Err(error) => {
            report!("skipped: {test}: {error}");
            let why = refusal::<T>(Err(error));
            // Without a reason that is known, it is no skip.
            assert!(!matches!(why, PolicyRefusal::Kernel { .. }), "{why:?}");
            None
        }
    }
}

#[test]
fn smoke() {
    let _alone = alone();
    let asked = policy(500, 10_000);
    let Some(thread) = granted("smoke", asked, current_policy) else {
        return;
    };
    assert_eq!(thread.obtained().policy, asked);
    assert_eq!(thread.obtained().core, None);
    assert_eq!(thread.join().unwrap(), asked);
}

#[test]
fn each_time_is_read_back_as_it_was_asked_for() {
    let _alone = alone();
    let [runtime, deadline, period] = [300, 700, 1100].map(Duration::from_micros);
    let asked = Policy::deadline(runtime, deadline, period);
    if let Some(thread) = granted("each_time_is_read_back", asked, current_policy) {
        assert_eq!(thread.join().unwrap(), asked);
    }
}

#[test]
fn what_it_starts_is_an_ordinary_thread() {
    let _alone = alone();
    let body = || std::thread::spawn(current_policy).join().unwrap();
    if let Some(thread) = granted(
        "what_it_starts_is_an_ordinary_thread",
        policy(1000, 10_000),
        body,
    ) {
        assert_eq!(thread.join().unwrap(), Policy::Other);
    }
}

#[test]
fn best_effort_goes_on_without() {
    let _alone = alone();
    // More often than any kernel's limit allows, and without the privilege refused for the lack of
    // it.
    let asked = policy(2, 2);
    let attributes = Attributes::new("deadline").policy(asked);
    let thread = spawn(
        attributes,
        |_| Ok::<_, Infallible>(()),
        |()| current_policy(),
    )
    .unwrap();
    let shortfalls: Vec<_> = (thread.obtained().refusals.iter())
        .map(Shortfall::of)
        .collect();
    if thread.obtained().policy == asked {
        report!("skipped: best_effort_goes_on_without: this kernel gives a period of 2 µs");
        return;
    }
    assert_eq!(thread.join().unwrap(), Policy::Other);
    let [shortfall @ Shortfall::Policy { asked: of, .. }] = &shortfalls[..] else {
        panic!("{shortfalls:?}");
    };
    assert_eq!(*of, asked);
    assert!(
        shortfall
            .to_string()
            .starts_with("no policy deadline:2000/2000/2000: "),
        "{shortfall}"
    );
}

#[test]
fn a_period_beyond_the_kernels_limits_is_told_with_them() {
    let _alone = alone();
    let test = "a_period_beyond_the_kernels_limits";
    let Some(thread) = granted(test, policy(500, 10_000), || ()) else {
        return;
    };
    thread.join().unwrap();
    for period in [2, 1_000_000_000_000] {
        match start(policy(2, period), || ()) {
            Ok(_) => report!("skipped: {test}: this kernel gives a period of {period} µs"),
            Err(error) => {
                let PolicyRefusal::PeriodRange { least, most } = refusal::<()>(Err(error)) else {
                    panic!("another reason");
                };
                assert!(!(least..=most).contains(&period));
            }
        }
    }
}

#[test]
fn more_than_the_kernel_admits_is_refused_as_such() {
    let _alone = alone();
    let test = "more_than_the_kernel_admits";
    let mut waiting: Vec<(Sender<()>, Thread<_>)> = Vec::new();
    // Each takes nearly all of a core, so one of them is too many.
    for _ in 0..=available_cores().len() + 1 {
        let (end, ended): (Sender<()>, Receiver<()>) = channel();
        match start(policy(990_000, 1_000_000), move || ended.recv().is_err()) {
            Ok(thread) => waiting.push((end, thread)),
            Err(error) => {
                let text = error.to_string();
                match refusal::<()>(Err(error)) {
                    PolicyRefusal::NoBandwidth { .. } => {}
                    PolicyRefusal::Kernel { message } => panic!("{message}"),
                    _ => report!("skipped: {test}: {text}"),
                }
                return;
            }
        }
    }
    report!("skipped: {test}: this kernel admits any (sched_rt_runtime_us is -1?)");
}

#[test]
fn a_core_beside_it_is_refused_before_the_start() {
    let _alone = alone();
    let attributes = Attributes::new("deadline")
        .policy(policy(500, 1000))
        .core(0);
    let refused = spawn(attributes, |_| Ok::<_, Infallible>(()), |()| ());
    assert!(
        matches!(
            refused,
            Err(SpawnError::Attributes(AttributeError::PinnedDeadline {
                core: 0,
                ..
            }))
        ),
        "{refused:?}"
    );
}
