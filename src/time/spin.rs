//! The guard spin: waking early, and waiting out the rest on the clock.

use super::Instant;

/// The longest guard, as a part of the period: what is spun away stays below one processor's
/// sixteenth.
pub(super) const LONGEST_PART: u64 = 16;

/// Waits on the clock for `slot`, and gives the time that it read last, which is not before it.
///
/// Each turn goes through the executor: any process that is ready at the process' level or above,
/// from its own queue, its timers or from outside, runs first. A process of a lower level is not
/// started, since it would hold the loop up by its whole poll. So the executor is kept from those
/// for the guard at most.
pub(super) async fn until(slot: Instant) -> Instant {
    loop {
        let now = Instant::now();
        if now >= slot {
            return now;
        }
        luna_core::yield_now().await;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::prelude::*;
    use futures_lite::future;
    use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
    use std::sync::{Arc, mpsc};

    /// Ends the program if a test hangs: a spin that lets no other process run shows so. No machine
    /// is that slow.
    fn watchdog() -> mpsc::Sender<()> {
        let (alive, ended) = mpsc::channel();
        std::thread::spawn(move || {
            let limit = std::time::Duration::from_secs(300);
            if ended.recv_timeout(limit) == Err(mpsc::RecvTimeoutError::Timeout) {
                eprintln!("a test of the guard spin hangs");
                std::process::abort();
            }
        });
        alive
    }

    /// Spins for a slot that never comes, until the stop message arrives. If the spin kept others
    /// from running, the message would never be sent.
    async fn spin(stop: Receiver<()>) -> crate::Result<()> {
        let forever = async {
            until(Instant::NEVER).await;
            Ok(())
        };
        future::or(forever, async { Ok(stop.recv().await?) }).await
    }

    #[test]
    fn one_that_is_ready_at_its_level_or_above_runs_and_nobody_below() {
        let _alive = watchdog();
        for level in [16, 17, 31] {
            let (stop, stopped) = crate::channel();
            let below = Arc::new(AtomicBool::new(false));
            let turns = Arc::new(AtomicU32::new(0));
            let mut system = System::new("spin");
            let executor = system.executor("one").build().unwrap();
            let (seen, counted) = (below.clone(), turns.clone());
            let spinner = async move {
                spin(stopped).await?;
                assert!(!seen.load(Ordering::Relaxed), "a lower process was started");
                assert_eq!(counted.load(Ordering::Relaxed), 100);
                Ok(())
            };
            executor.process("spinner").spawn(spinner).unwrap();
            let low = async move {
                below.store(true, Ordering::Relaxed);
                Ok(())
            };
            executor.process("below").priority(15).spawn(low).unwrap();
            let busy = async move {
                for _ in 0..100 {
                    turns.fetch_add(1, Ordering::Relaxed);
                    crate::yield_now().await;
                }
                Ok(stop.send(()).await?)
            };
            let process = executor.process("busy").priority(level);
            process.spawn(busy).unwrap();
            system.run().unwrap();
        }
    }

    #[test]
    fn a_wake_from_outside_is_seen_while_it_spins() {
        let _alive = watchdog();
        let (stop, stopped) = crate::channel();
        let (go, gone) = crate::channel();
        let mut system = System::new("spin");
        let here = system.executor("here").build().unwrap();
        let there = system.executor("there").build().unwrap();
        here.process("spinner").spawn(spin(stopped)).unwrap();
        let failover = async move {
            gone.recv().await?;
            Ok(stop.send(()).await?)
        };
        here.process("failover")
            .priority(20)
            .spawn(failover)
            .unwrap();
        let outside = async move { Ok(go.send(()).await?) };
        there.process("outside").spawn(outside).unwrap();
        system.run().unwrap();
    }

    #[test]
    fn a_timer_is_served_while_it_spins() {
        let _alive = watchdog();
        let (stop, stopped) = crate::channel();
        let mut system = System::new("spin");
        let here = system.executor("here").build().unwrap();
        here.process("spinner").spawn(spin(stopped)).unwrap();
        let timer = async move {
            crate::after(std::time::Duration::from_millis(1)).await;
            Ok(stop.send(()).await?)
        };
        here.process("timer").spawn(timer).unwrap();
        system.run().unwrap();
    }

    #[test]
    fn it_ends_at_the_slot_and_not_before() {
        let _alive = watchdog();
        let slot = Instant::now() + std::time::Duration::from_micros(300);
        for slot in [slot, Instant::from_nanos(0)] {
            let now = crate::run(async { Ok(until(slot).await) }).unwrap();
            assert!(now >= slot);
        }
    }
}
