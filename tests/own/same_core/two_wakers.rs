//! Two threads that wake one process. The lower one loses its core anywhere in a wake, and the
//! higher one must not need it to finish. The process is above both on the same core, so it has run
//! by the time the higher one's wake returns.

use crate::common::{Random, SpawnOk, say, seed};
use crate::kernel::spoilt;
use crate::same_core::stage::Placement;
use crate::same_core::{alone, cannot_run, core, rounds};
use luna::{Policy, System, after};
use luna_platform::clock::Instant;
use luna_platform::futex::Futex;
use luna_platform::thread::{Attributes, Mode, Thread, spawn};
use std::convert::Infallible;
use std::future::{Future, poll_fn};
use std::pin::pin;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, OnceLock};
use std::task::{Poll, Waker};
use std::time::Duration;

#[derive(Default)]
struct Shared {
    /// Set by the process' first poll.
    waker: OnceLock<Waker>,
    /// What the higher waker asks for, and what the process has seen of that.
    asked: AtomicU64,
    seen: AtomicU64,
    over: AtomicBool,
}

impl Shared {
    fn waker(&self) -> Waker {
        loop {
            if let Some(waker) = self.waker.get() {
                return waker.clone();
            }
            sleep(Duration::from_millis(1));
        }
    }
}

fn sleep(time: Duration) {
    let (nobody_wakes, until) = (Futex::new(0), Instant::now() + time);
    while Instant::now() < until {
        nobody_wakes.wait(0, until);
    }
}

fn thread<T: Send + 'static>(
    name: &str,
    priority: u8,
    body: impl FnOnce() -> T + Send + 'static,
) -> Thread<T> {
    let attributes = Attributes::new(name)
        .core(core())
        .policy(Policy::fifo(priority))
        .mode(Mode::Strict);
    spawn(attributes, |_| Ok::<_, Infallible>(()), |()| body()).unwrap()
}

#[test]
fn a_wake_relies_on_no_other() {
    own_process!();
    if cannot_run() {
        return;
    }
    let _alone = alone();
    for place in [Placement::Executor, Placement::Thread] {
        let shared = Arc::new(Shared::default());
        let (of_process, of_low, of_high) = (shared.clone(), shared.clone(), shared.clone());
        let mut system = System::new("two wakers");
        system.strict();
        let (core, policy) = (core(), Policy::fifo(80));
        let process = if place == Placement::Executor {
            let executor = system.executor("woken").core(core).policy(policy);
            executor.build().unwrap().process("woken")
        } else {
            system
                .thread("woken")
                .core(core)
                .policy(policy)
                .process("woken")
        };
        process.spawn_ok(async move {
            // With a pending deadline, so that no thread checks whether the system is stuck.
            let mut far = pin!(after(Duration::from_secs(1_000)));
            poll_fn(|cx| {
                let _ = of_process.waker.set(cx.waker().clone());
                let _ = far.as_mut().poll(cx);
                let asked = of_process.asked.load(Ordering::SeqCst);
                of_process.seen.store(asked, Ordering::SeqCst);
                if of_process.over.load(Ordering::SeqCst) {
                    Poll::Ready(())
                } else {
                    Poll::Pending
                }
            })
            .await;
            Ok(())
        });
        let low = thread("low", 20, move || {
            let waker = of_low.waker();
            let mut wakes = 0_u64;
            while !of_low.over.load(Ordering::SeqCst) {
                waker.wake_by_ref();
                wakes += 1;
            }
            wakes
        });
        let mut random = Random::new(seed());
        let high = thread("high", 70, move || {
            let waker = of_high.waker();
            let (wakes, mut late) = (u64::from(rounds()) * 10, 0_u64);
            for wake in 1..=wakes {
                sleep(Duration::from_nanos(10_000 + random.below(60_000)));
                of_high.asked.store(wake, Ordering::SeqCst);
                waker.wake_by_ref();
                if of_high.seen.load(Ordering::SeqCst) != wake {
                    late += 1;
                }
            }
            of_high.over.store(true, Ordering::SeqCst);
            waker.wake_by_ref();
            (wakes, late)
        });
        system.run().unwrap();
        let (wakes, late) = high.join().unwrap();
        let below = low.join().unwrap();
        say(&format!(
            "{wakes} wakes beside {below} from below ({place:?}): {late} had not come when they returned"
        ));
        assert!(late <= spoilt(wakes), "{place:?}: {late} late");
    }
}
