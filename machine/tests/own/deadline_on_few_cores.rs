//! A program that may not use all cores, as under `taskset`, learns why SCHED_DEADLINE is refused.
//! It needs a process of its own, since the mask is read once.

#![cfg(all(target_os = "linux", not(luna_portable), not(loom)))]

use luna_machine::shortfall::{PolicyRefusal, Shortfall};
use luna_platform::thread::{Attributes, Mode, Policy, SpawnError, spawn};
use nix::sched::{CpuSet, sched_getaffinity, sched_setaffinity};
use nix::unistd::getpid;
use std::convert::Infallible;
use std::time::Duration;

#[test]
fn all_cores_or_none() {
    own_process!();
    let all = sched_getaffinity(getpid()).unwrap();
    let cores: Vec<_> = (0..CpuSet::count())
        .filter(|&core| all.is_set(core).unwrap())
        .collect();
    if cores.len() < 2 {
        println!("skipped: all_cores_or_none: needs two cores");
        return;
    }
    let mut one = CpuSet::new();
    one.set(cores[0]).unwrap();
    // The main thread's mask is what unpinned threads get.
    sched_setaffinity(getpid(), &one).unwrap();
    let time = Duration::from_millis;
    let attributes = Attributes::new("deadline")
        .policy(Policy::deadline(time(1), time(10), time(10)))
        .mode(Mode::Strict);
    let refused = spawn(attributes, |_| Ok::<_, Infallible>(()), |()| ());
    match refused {
        Err(SpawnError::Refused(refusal)) => match Shortfall::of(&refusal) {
            Shortfall::Policy { why, .. } => match &why {
                PolicyRefusal::NotAllCores { allowed } => {
                    assert_eq!(*allowed, cores[0].to_string())
                }
                PolicyRefusal::Kernel { message } => panic!("{message}"),
                _ => println!("skipped: all_cores_or_none: needs SCHED_DEADLINE: {why:?}"),
            },
            other => panic!("{other:?}"),
        },
        other => panic!("{other:?}"),
    }
}
