//! Whether a thread that runs processes sleeps with nothing of its own that could wake it: the
//! basis of a deadlock report.
//!
//! A thread of the system (an executor's, or that of an OS-thread process) is *still* while it
//! sleeps without a deadline and without files to wait for. It publishes this in a word of its own,
//! which no other thread writes on the path. The left column is the thread, the right one the
//! observer (not real-time):
//!
//! ```text
//!   thread                                  observer
//!   1 publishes that it sleeps              a reads every word: all still?
//!   2 sets STILL (read-modify-write);       b no wake pushed, no call on the pool anywhere?
//!     if it was WATCHED: rings              c reads every word again: as in a?
//!   3 sleeps                                if not: sets WATCHED at one that is not still,
//!   4 clears STILL, counts the wake         and sleeps
//!   5 takes what was pushed
//! ```
//!
//! **If a, b and c hold, there is an instant, between a and c, at which every thread slept and
//! nothing was under way among them.** The count makes every value of a word last for one stretch
//! of time, so each thread was still from its a to its c: all of them between the last a and the
//! first c. An observer that sees a thread's step 2 sees all that the thread did before it
//! (release, acquire). So in b every wake that a thread has pushed to another is seen, or that the
//! other has taken it since. It takes in step 5 alone, after step 4 or before it fell still: in the
//! first case c sees another count; in the second the wake was followed before. A call on the pool
//! is counted by its thread before step 2, and its end after the wake that it leads to. What
//! remains are wakes from threads outside of the system: they may come at any time, and the next
//! look finds them.
//!
//! **Nothing is missed:** the steps on a word are read-modify-write operations. So either 2 comes
//! before WATCHED was set, and the observer sees STILL, or the thread sees WATCHED and rings.
//!
//! A thread that never sleeps without a deadline, as one with a periodic loop, does nothing of all
//! this. Any other pays two read-modify-write operations for a sleep, on a word that others write
//! only to watch it. A count of the threads that are awake would be one word for all of them. It
//! would also touch zero whenever one thread wakes another and sleeps before that one has woken.

use alloc::vec::Vec;
use luna_platform::sync::atomic::{AtomicU64, AtomicUsize, Ordering};

const STILL: u64 = 1;
/// The next time that the thread falls still, it rings.
const WATCHED: u64 = 2;
/// One wake. The rest of the word counts them.
const WAKE: u64 = 4;

/// The quiescence state that a thread publishes.
#[derive(Debug)]
pub(crate) struct Quiescence {
    word: AtomicU64,
    /// Calls on the pool that this thread's processes have begun.
    calls: AtomicUsize,
}

/// A value of the word: one stretch of sleep.
pub(crate) type Stretch = u64;

impl Quiescence {
    pub(crate) fn new() -> Self {
        Self {
            word: AtomicU64::new(0),
            calls: AtomicUsize::new(0),
        }
    }

    /// The thread is about to sleep until others wake it. Returns whether to ring. Owner only.
    #[must_use = "the observer sleeps until the ring"]
    pub(crate) fn become_quiescent(&self) -> bool {
        self.word.fetch_or(STILL, Ordering::AcqRel) & WATCHED != 0 && self.take_watch()
    }

    /// The thread has woken, and has not yet taken what was pushed. Owner only, after
    /// `become_quiescent`.
    pub(crate) fn wake(&self) {
        self.word.fetch_add(WAKE - STILL, Ordering::AcqRel);
    }

    /// A process of this thread begins a call on the pool. Owner only.
    pub(crate) fn begin_call(&self) {
        self.calls.fetch_add(1, Ordering::Relaxed);
    }

    /// Such a call has ended and has woken its waiter. Returns whether to ring.
    #[must_use = "the observer sleeps until the ring"]
    pub(crate) fn end_call(&self) -> bool {
        self.calls.fetch_sub(1, Ordering::AcqRel) == 1 && self.take_watch()
    }

    /// Clears the watch; returns whether there was one. One thread rings for a watch, however many
    /// find it.
    fn take_watch(&self) -> bool {
        self.word.fetch_and(!WATCHED, Ordering::AcqRel) & WATCHED != 0
    }

    /// The present stretch of sleep, if the thread is still: steps a and c.
    pub(crate) fn stretch(&self) -> Option<Stretch> {
        let word = self.word.load(Ordering::Acquire);
        (word & STILL != 0).then_some(word & !WATCHED)
    }

    /// Whether calls are under way: part of step b.
    pub(crate) fn has_calls(&self) -> bool {
        self.calls.load(Ordering::Acquire) > 0
    }

    /// Requests a ring when the thread falls still for the next time, or its last call ends.
    pub(crate) fn watch(&self) {
        self.word.fetch_or(WATCHED, Ordering::AcqRel);
    }
}

/// A thread as the observer of quiescence sees it.
pub(crate) trait Sleeper: Send + Sync {
    fn quiescence(&self) -> &Quiescence;
    /// Whether a wake has arrived that the thread has not taken: part of step b. Acquire.
    fn is_woken(&self) -> bool;
}

/// The result of a look at several threads.
pub(crate) enum Look {
    /// All were still at one instant, each in the given stretch.
    Quiescent(Vec<Stretch>),
    /// One thread was not still; it rings when it falls still.
    Stirring,
    /// The threads changed from look to look: look again.
    Unclear,
}

/// How often a look starts anew because a thread fell still meanwhile.
const TRIES: usize = 8;

/// Looks at the threads `sleepers`. O(sleepers), a bounded number of times; allocates.
pub(crate) fn look<S: Sleeper + ?Sized>(sleepers: &[&S]) -> Look {
    for _ in 0..TRIES {
        match all_quiescent(sleepers) {
            Ok(stretches) => return Look::Quiescent(stretches),
            Err(stirring) => {
                stirring.quiescence().watch();
                // From here on the thread acts under watch. If it is still without a cause to wake,
                // it fell still just before.
                if is_stirring(stirring) {
                    return Look::Stirring;
                }
            }
        }
    }
    Look::Unclear
}

/// Requests a ring from every thread when it falls still for the next time.
pub(crate) fn watch_all<S: Sleeper + ?Sized>(sleepers: &[&S]) {
    sleepers
        .iter()
        .for_each(|sleeper| sleeper.quiescence().watch());
}

fn is_stirring<S: Sleeper + ?Sized>(sleeper: &S) -> bool {
    sleeper.quiescence().stretch().is_none()
        || sleeper.quiescence().has_calls()
        || sleeper.is_woken()
}

/// Steps a, b and c. The error is a thread that is not still, or was not in one of the steps.
fn all_quiescent<'a, S: Sleeper + ?Sized>(sleepers: &[&'a S]) -> Result<Vec<Stretch>, &'a S> {
    let mut stretches = Vec::with_capacity(sleepers.len());
    for &sleeper in sleepers {
        stretches.push(sleeper.quiescence().stretch().ok_or(sleeper)?);
    }
    for &sleeper in sleepers {
        if sleeper.quiescence().has_calls() || sleeper.is_woken() {
            return Err(sleeper);
        }
    }
    for (&sleeper, &before) in sleepers.iter().zip(&stretches) {
        if sleeper.quiescence().stretch() != Some(before) {
            return Err(sleeper);
        }
    }
    Ok(stretches)
}

#[cfg(all(test, not(loom)))]
mod tests {
    use super::*;

    struct TestSleeper(Quiescence, bool);

    impl Sleeper for TestSleeper {
        fn quiescence(&self) -> &Quiescence {
            &self.0
        }

        fn is_woken(&self) -> bool {
            self.1
        }
    }

    #[test]
    fn all_are_still_only_if_each_is_and_nothing_is_under_way() {
        let (one, mut two) = (
            TestSleeper(Quiescence::new(), false),
            TestSleeper(Quiescence::new(), false),
        );
        assert!(!one.0.become_quiescent());
        assert!(matches!(look(&[&one, &two]), Look::Stirring));
        assert!(
            two.0.become_quiescent(),
            "the one that was awake is watched"
        );
        assert!(matches!(look(&[&one, &two]), Look::Quiescent(_)));
        two.1 = true;
        assert!(matches!(look(&[&one, &two]), Look::Stirring));
        two.1 = false;
        two.0.begin_call();
        assert!(matches!(look(&[&one, &two]), Look::Stirring));
        assert!(two.0.end_call());
        assert!(matches!(look(&[&one, &two]), Look::Quiescent(_)));
    }

    #[test]
    fn a_stretch_of_sleep_is_no_other_one() {
        let sleeper = TestSleeper(Quiescence::new(), false);
        assert!(!sleeper.0.become_quiescent());
        let Look::Quiescent(first) = look(&[&sleeper]) else {
            panic!("it is still");
        };
        sleeper.0.wake();
        assert!(!sleeper.0.become_quiescent());
        let Look::Quiescent(second) = look(&[&sleeper]) else {
            panic!("it is still");
        };
        assert_ne!(first, second);
    }

    #[test]
    fn a_watch_rings_once() {
        let sleeper = TestSleeper(Quiescence::new(), false);
        sleeper.0.watch();
        assert!(sleeper.0.become_quiescent());
        sleeper.0.wake();
        assert!(!sleeper.0.become_quiescent());
    }
}
