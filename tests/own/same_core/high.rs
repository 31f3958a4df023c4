//! The high side: it wakes at random instants, operates once, and counts what happened meanwhile.

use crate::common::Random;
use crate::kernel::{Kept, KeptOff};
use crate::same_core::shared::{How, Shared, low};
use crate::same_core::stage::Placement;
use luna_platform::clock::Instant;
use luna_platform::futex::Futex;
use std::future::Future;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::Duration;

/// How many operations of the low side may end during one of the high side that needs no partner:
/// none, except the one that was in progress.
const WITHOUT_PARTNER: u64 = 1;
/// During one that does: the one that was under way, and the one that serves it.
const WITH_PARTNER: u64 = 2;
/// How many steps of the burner, of 2 µs of processor time or a little more, may fall into an
/// operation that does not wait for the low side. An operation that waited for the low side without
/// boosting it would wait for the rest of a burst, which is at least 500 µs.
const BURNT: u64 = 25;

pub(crate) struct High {
    pub(crate) place: Placement,
    pub(crate) random: Random,
    pub(crate) rounds: u32,
    shared: Arc<Shared>,
    kept_off: KeptOff,
    scene: &'static str,
    /// Whether a call boosts the low side to this one's priority: both are processes.
    inherits: bool,
}

/// What was so when an operation began.
struct Before {
    low: u64,
    burnt: u64,
    kept: Kept,
}

impl High {
    /// To be called on the high side's thread.
    pub(crate) fn new(
        shared: Arc<Shared>,
        (place, low): (Placement, Placement),
        rounds: u32,
        random: Random,
    ) -> Self {
        Shared::set_thread(&shared.high_thread);
        Self {
            inherits: place != Placement::Plain && low != Placement::Plain,
            place,
            random,
            rounds,
            shared,
            kept_off: KeptOff::new(),
            scene: "",
        }
    }

    pub(crate) fn enter(&mut self, scene: &'static str) {
        self.scene = scene;
    }

    /// The low side is to go on with the next scene.
    pub(crate) fn leave(&mut self) {
        self.shared.scene.fetch_add(1, Ordering::SeqCst);
    }

    /// Leaves the core to the low side until a random instant.
    pub(crate) async fn pause(&mut self) {
        let until = Instant::now() + Duration::from_nanos(10_000 + self.random.below(60_000));
        match self.place {
            // The timer of its executor or thread.
            Placement::Executor | Placement::Thread => luna::at(until).await,
            Placement::Plain => {
                let nobody_wakes = Futex::new(0);
                while Instant::now() < until {
                    nobody_wakes.wait(0, until);
                }
            }
        }
    }

    /// How to operate this time.
    pub(crate) fn how(&mut self) -> How {
        match self.random.below(4) {
            0 | 1 => How::Try,
            2 if self.place != Placement::Executor => How::Block,
            _ => How::Await,
        }
    }

    /// One operation that does not wait for a partner.
    pub(crate) fn try_to<T>(&mut self, operation: impl FnOnce() -> T) -> T {
        let before = self.begin(How::Try);
        let outcome = operation();
        self.end(before, How::Try, WITHOUT_PARTNER);
        outcome
    }

    /// The same, of a future that is ready at its first polls.
    pub(crate) async fn try_in<F: Future>(&mut self, operation: F) -> F::Output {
        let before = self.begin(How::Try);
        let outcome = operation.await;
        self.end(before, How::Try, WITHOUT_PARTNER);
        outcome
    }

    /// One that waits for the low side.
    pub(crate) async fn wait_for<F: Future>(&mut self, operation: F) -> F::Output {
        let before = self.begin(How::Await);
        let outcome = operation.await;
        self.end(before, How::Await, WITH_PARTNER);
        outcome
    }

    /// An operation that waits for the low side, which inherits this side's priority for it. As for
    /// one that does not wait, nothing of a priority in between runs meanwhile.
    pub(crate) async fn call<F: Future>(&mut self, operation: F) -> F::Output {
        let before = self.begin(How::Await);
        let outcome = operation.await;
        if self.inherits {
            self.note_burnt(&before);
        }
        self.end(before, How::Await, WITH_PARTNER);
        outcome
    }

    /// One that blocks its thread for that.
    pub(crate) fn block<T>(&mut self, operation: impl FnOnce() -> T) -> T {
        let before = self.begin(How::Block);
        let outcome = operation();
        self.end(before, How::Block, WITH_PARTNER);
        outcome
    }

    fn begin(&mut self, how: How) -> Before {
        let shared = &self.shared;
        let number = shared.high.fetch_add(1, Ordering::Relaxed) + 1;
        if shared.low_state.load(Ordering::Relaxed) == low::OPERATES {
            shared.high_in_low.fetch_add(1, Ordering::Relaxed);
        }
        let kept = self.kept_off.so_far();
        shared.begin(number, how);
        Before {
            low: shared.low.load(Ordering::SeqCst),
            burnt: shared.burnt.load(Ordering::SeqCst),
            kept,
        }
    }

    fn end(&mut self, before: Before, how: How, most: u64) {
        let shared = &self.shared;
        let low = shared.low.load(Ordering::SeqCst) - before.low;
        shared.end();
        if how == How::Try {
            self.note_burnt(&before);
        }
        if low <= most {
            return;
        }
        // If it was ready to run and a thread above all user threads had the core, the low side's
        // part in it cannot be determined.
        let kept = self.kept_off.so_far();
        if kept.differs_from(&before.kept) {
            shared.excused.fetch_add(1, Ordering::Relaxed);
            return;
        }
        shared.violations.lock().unwrap().push(format!(
            "`{}`, {how:?}: {low} operations of the low side, at most {most} expected; {:?}, then {kept:?}",
            self.scene, before.kept
        ));
    }
}

impl High {
    fn note_burnt(&self, before: &Before) {
        let burnt = self.shared.burnt.load(Ordering::SeqCst) - before.burnt;
        self.shared.most_burnt.fetch_max(burnt, Ordering::Relaxed);
        if burnt > BURNT {
            self.shared.inverted.fetch_add(1, Ordering::Relaxed);
        }
    }
}

impl Drop for High {
    fn drop(&mut self) {
        // Also if it panics, so that the low side ends.
        self.shared.over.store(true, Ordering::SeqCst);
    }
}
