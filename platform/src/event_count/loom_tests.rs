//! Events that one of a crew hears of alone, and jobs that it does: none is lost, and whoever runs one is watched.

use super::*;
use crate::relay::{Leg, Relay};
use crate::sync::Arc;
use crate::sync::atomic::AtomicBool;

struct Crew {
    events: EventCount,
    relay: Relay,
    /// The others are to look after who runs: what the timer says when it expires.
    is_due: AtomicBool,
}

impl Crew {
    fn new() -> Arc<Self> {
        let crew = Self {
            events: EventCount::new(),
            relay: Relay::new(),
            is_due: AtomicBool::new(false),
        };
        crew.relay.add();
        crew.events.join();
        Arc::new(crew)
    }

    /// A member that hangs in its job for ever, or leaves behind who does; says which.
    fn serve(&self, interrupt: impl FnOnce()) -> bool {
        let mut interrupt = Some(interrupt);
        loop {
            let seen = self.events.get();
            match self.relay.take(u8::from(interrupt.is_none())) {
                Leg::Run(_) => {
                    self.is_due.store(true, Ordering::Release);
                    return true;
                }
                Leg::Watch(turn) => {
                    assert!(self.relay.leave_behind(turn));
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

/// A handler interrupts the wait of one, who alone hears of it, and hangs: the timer wakes the other.
#[test]
fn one_who_is_interrupted_acts_and_is_watched() {
    loom::model(|| {
        let crew = Crew::new();
        let (first, second, timer) = (crew.clone(), crew.clone(), crew.clone());
        let second = loom::thread::spawn(move || second.serve(|| ()));
        let timer = loom::thread::spawn(move || {
            while !timer.is_due.load(Ordering::Acquire) {
                loom::thread::yield_now();
            }
            timer.events.announce();
        });
        let has_run = first.serve(|| {
            crew.relay.begin();
            crew.events.announce_here();
        });
        assert_ne!(has_run, second.join().unwrap());
        timer.join().unwrap();
        assert!(crew.relay.is_done());
    });
}

/// A second crew joins while a member of the first is told alone: it hears of it all the same.
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
