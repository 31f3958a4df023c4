//! Locks allocate nothing, wherever their users run and however they end.

use crate::ALLOCATOR;
use crate::common;

use common::{COMPLETE, has_real_time, watchdog};
use luna::ProcessBuilder;
use luna::prelude::*;
use luna::sync::{Condition, Mutex, Semaphore};
use std::time::Duration;

const ROUNDS: u64 = 2000;

#[derive(Clone)]
struct Locks {
    turn: Mutex<u64>,
    inner: Mutex<u64>,
    changed: Condition,
    permits: Semaphore,
}

/// Takes turns with the other one, so that each waits for the other all the time.
async fn take_turns(locks: Locks, own: u64) -> luna::Result<()> {
    // What the first ones prepare once.
    let mut counted = ALLOCATOR.here();
    for round in 0..ROUNDS {
        if round == 10 {
            counted = ALLOCATOR.here();
        }
        let guard = locks.turn.lock().await?;
        let theirs = |turn: &mut u64| *turn % 2 != own;
        let mut guard = locks.changed.wait_while(guard, theirs).await?;
        // Held while this one waits for another: a chain.
        *locks.inner.lock().await? += 1;
        *guard += 1;
        drop(guard);
        locks.changed.notify_all();
        let permit = locks.permits.acquire().await?;
        if round % 50 == 0 {
            let late = locks
                .permits
                .acquire_timeout(Duration::from_micros(1))
                .await;
            assert!(late.is_err());
            let guard = locks.turn.lock().await?;
            let at_once = Duration::ZERO;
            drop(locks.changed.wait_timeout(guard, at_once).await?);
            drop(locks.inner.lock_timeout(Duration::from_micros(1)).await);
        }
        drop(permit);
        drop(locks.inner.try_lock());
    }
    assert_eq!(ALLOCATOR.here(), counted);
    Ok(())
}

#[test]
fn nothing_is_allocated_or_freed_by_locks_on_the_path() {
    own_process!();
    let _watch = watchdog();
    // Where policies are given, threads inherit them too.
    let inherits = COMPLETE && has_real_time();
    let policy = |priority| {
        if inherits {
            Policy::fifo(priority)
        } else {
            Policy::Other
        }
    };
    let mut system = System::new("locks");
    let above = system.executor("above").policy(policy(30)).build().unwrap();
    let below = system.executor("below").policy(policy(20)).build().unwrap();
    let alone = system.thread("alone").policy(policy(10));
    let pairs: [[ProcessBuilder; 2]; 3] = [
        [
            above.process("a").priority(20),
            below.process("b").priority(10),
        ],
        [
            below.process("c").priority(20),
            below.process("d").priority(10),
        ],
        [above.process("e").priority(5), alone.process("f")],
    ];
    let inner = Mutex::new(0);
    for pair in pairs {
        let locks = Locks {
            turn: Mutex::new(0),
            inner: inner.clone(),
            changed: Condition::new(),
            permits: Semaphore::new(1),
        };
        for (own, process) in pair.into_iter().enumerate() {
            let locks = locks.clone();
            process.spawn(take_turns(locks, own as u64)).unwrap();
        }
    }
    system.run().unwrap();
    assert_eq!(*inner.try_lock().unwrap(), 6 * ROUNDS);
    assert_eq!(luna_core::current::refused_boosts(), None);
}
