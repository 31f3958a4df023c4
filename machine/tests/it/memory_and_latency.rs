//! Locked memory, heap in advance, short wake-ups: held while a guard lives, and a shortfall that
//! says how to get them.

#![cfg(not(loom))]

use luna_machine::latency::DmaLatency;
use luna_machine::memory::{lock_memory, prefault_heap};
use luna_machine::shortfall::Shortfall;

#[test]
fn a_latency_is_held_or_a_shortfall() {
    match DmaLatency::hold() {
        // A second one beside it is no conflict.
        Ok(_held) => assert!(DmaLatency::hold().is_ok()),
        Err(shortfall @ Shortfall::DmaLatency(_)) => {
            report!("skipped: a_latency_is_held_or_a_shortfall: {shortfall}")
        }
        Err(other) => panic!("{other:?}"),
    }
}

#[cfg(not(all(target_os = "linux", not(luna_portable))))]
#[test]
fn the_portable_backend_locks_nothing() {
    let shortfall = lock_memory().unwrap_err();
    assert!(matches!(shortfall, Shortfall::MemoryLock(_)), "{shortfall}");
    prefault_heap(1 << 20).unwrap();
}

#[cfg(all(target_os = "linux", not(luna_portable)))]
mod linux {
    use super::*;
    use luna_platform::thread::{Attributes, spawn};
    use nix::sys::resource::{UsageWho, getrusage};
    use std::convert::Infallible;
    use std::fs;

    /// The bytes that the kernel counts as locked for this process.
    fn locked() -> u64 {
        let status = fs::read_to_string("/proc/self/status").unwrap();
        let line = status
            .lines()
            .find_map(|line| line.strip_prefix("VmLck:"))
            .unwrap();
        line.trim().trim_end_matches(" kB").parse::<u64>().unwrap() << 10
    }

    // One test, since the lock is the whole process'.
    #[test]
    fn memory_is_locked_until_the_last_lock_is_dropped() {
        let first = match lock_memory() {
            Ok(lock) => lock,
            Err(shortfall @ Shortfall::MemoryLock(_)) => {
                assert_eq!(locked(), 0, "a refusal changes nothing");
                report!("skipped: memory_is_locked_until_the_last_lock_is_dropped: {shortfall}");
                return;
            }
            Err(other) => panic!("{other:?}"),
        };
        assert!(locked() > 0);
        let second = lock_memory().unwrap();
        drop(first);
        assert!(locked() > 0);
        // Threads still start, and their stacks are locked.
        let before = locked();
        let threads: Vec<_> = (0..8)
            .map(|_| {
                let (go, may_go) = std::sync::mpsc::channel::<()>();
                let body = move |()| may_go.recv();
                (
                    go,
                    spawn(Attributes::new("locked"), |_| Ok::<_, Infallible>(()), body).unwrap(),
                )
            })
            .collect();
        assert!(locked() >= before + (8 << 20), "{} to {}", before, locked());
        for (go, thread) in threads {
            drop(go);
            assert!(
                thread.join().unwrap().is_err(),
                "it waited until the sender was dropped"
            );
        }
        drop(second);
        assert_eq!(locked(), 0);
    }

    #[test]
    fn the_heap_keeps_what_it_was_given() {
        // In a thread of its own the heap would be another arena; the test's thread may be one
        // already, which is as good.
        const BYTES: usize = 32 << 20;
        prefault_heap(BYTES).unwrap();
        let before = getrusage(UsageWho::RUSAGE_THREAD)
            .unwrap()
            .minor_page_faults();
        let blocks: Vec<Vec<u8>> = (0..16).map(|_| vec![1; 1 << 20]).collect();
        let faults = getrusage(UsageWho::RUSAGE_THREAD)
            .unwrap()
            .minor_page_faults()
            - before;
        assert_eq!(
            blocks.iter().map(|block| block.len()).sum::<usize>(),
            16 << 20
        );
        if cfg!(target_env = "gnu") {
            // Fetched only now, they would be 4096.
            assert!(faults < 400, "{faults} page faults");
        }
    }
}
