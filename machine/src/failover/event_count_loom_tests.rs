//! Events that are announced to one member alone, and jobs that it runs: none is lost, and every
//! runner is watched.

use crate::event_count::EventCount;
use crate::failover::{FailoverSequence, Leg};
use luna_platform::clock::Instant;
use luna_platform::sync::Arc;
use luna_platform::sync::atomic::{AtomicBool, Ordering};

struct EmergencyWorkers {
    events: EventCount,
    failover: FailoverSequence,
}

impl EmergencyWorkers {
    /// A member that hangs in the job for ever, or leaves a hanging runner behind; returns whether
    /// it hangs. It is interrupted as it is about to wait.
    fn serve(&self, member: u8, interrupt: impl FnOnce()) -> bool {
        let mut interrupt = Some(interrupt);
        loop {
            let seen = self.events.get();
            match self.failover.take(member) {
                Leg::Run(_) => return true,
                Leg::Watch(turn) => {
                    assert!(self.failover.leave_behind(turn));
                    return false;
                }
                Leg::Rest => {
                    if let Some(interrupt) = interrupt.take() {
                        interrupt();
                    }
                    self.events.wait(seen, Instant::NEVER);
                }
            }
        }
    }
}

/// A handler interrupts the wait of one member, which alone is notified. If that member hangs, the
/// timer wakes the other.
#[test]
fn one_that_is_interrupted_acts_and_is_watched() {
    loom::model(|| {
        let workers = Arc::new(EmergencyWorkers {
            events: EventCount::new(),
            failover: FailoverSequence::new(),
        });
        workers.failover.add();
        workers.events.join();
        let other = workers.clone();
        let second = loom::thread::spawn(move || other.serve(1, || ()));
        let hangs = workers.serve(0, || {
            workers.failover.begin();
            workers.events.announce_here();
        });
        if hangs {
            // The timer.
            workers.events.announce();
        }
        assert_ne!(hangs, second.join().unwrap());
        assert!(workers.failover.is_done());
    });
}

/// A second group joins while a member of the first alone is notified: the second is notified all
/// the same.
#[test]
fn a_crew_that_joins_meanwhile_hears_of_it() {
    loom::model(|| {
        let shared = Arc::new((EventCount::new(), AtomicBool::new(false)));
        shared.0.join();
        let other = shared.clone();
        let joins = loom::thread::spawn(move || {
            let (events, has_happened) = &*other;
            events.join();
            loop {
                let seen = events.get();
                if has_happened.load(Ordering::Acquire) {
                    return;
                }
                events.wait(seen, Instant::NEVER);
            }
        });
        shared.1.store(true, Ordering::Release);
        shared.0.announce_here();
        joins.join().unwrap();
    });
}
