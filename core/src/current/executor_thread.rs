//! Priority inheritance of executor threads: the boosts by processes of other OS priorities.

use super::inheritance::Counts;
use crate::path::{self, Call};
use crate::wait_list::WaitList;
use alloc::sync::Arc;
#[cfg(not(loom))]
use core::cell::OnceCell;
use core::sync::atomic::{AtomicBool, AtomicU8, AtomicU32, Ordering};
use luna_platform::boost::{self, Scheduling};
use luna_platform::lock::PiLock;

/// The highest priority of the real-time policies.
const HIGHEST: u8 = 99;

/// The boost by a deadline thread, which is above all priorities: the highest that leaves an
/// emergency above it.
const OF_DEADLINE: u8 = 97;

/// The boost by a client on a thread of this rank.
pub(super) fn boost_from(rank: u8) -> u8 {
    if rank > HIGHEST { OF_DEADLINE } else { rank }
}

/// The number of boosts that the system has refused, and the first of them: its priority and the
/// system's error.
static REFUSED: AtomicU32 = AtomicU32::new(0);
static FIRST_REFUSED: AtomicU32 = AtomicU32::new(0);

/// An executor's thread, which can be boosted above its own priority.
///
/// # Invariants
///
/// Whenever the lock is free, the thread runs at the highest priority that is counted in `boosts`,
/// or at its own if none is; unless the system has refused, or the executor has been left.
pub(super) struct ExecutorThread {
    boosts: PiLock<Boosts>,
    now: AtomicU8,
    /// The system has refused the last change of the thread's priority.
    is_behind: AtomicBool,
    /// The thread's own real-time priority when it was last read.
    own_rank: AtomicU8,
    /// A plain thread: the program may change its policy at any time, so it is read again before
    /// each boost.
    is_plain: bool,
}

/// The boosts of a thread, under the lock `ExecutorThread::boosts`.
pub(super) struct Boosts {
    own: Scheduling,
    /// The waits of the thread itself, if it is a plain one.
    pub(super) waits: WaitList,
    counts: Counts<{ HIGHEST as usize + 1 }>,
    /// The priority that was set for the thread; 0 is its own.
    applied: u8,
    left: bool,
}

impl Boosts {
    /// Counts the begin or the end of a boost to `priority`. `false`: it was not counted.
    pub(super) fn count(&mut self, priority: u8, more: bool) -> bool {
        self.counts.count(priority.min(HIGHEST), more)
    }
}

impl ExecutorThread {
    /// The calling thread, which becomes an executor's.
    pub(super) fn new() -> Arc<Self> {
        Self::of_calling(false)
    }

    /// A thread that is never boosted: its processes are, but the system is not notified.
    pub(super) fn unboosted() -> Arc<Self> {
        let thread = Self::of_calling(false);
        thread.boosts.lock().left = true;
        thread
    }

    fn of_calling(is_plain: bool) -> Arc<Self> {
        let own = boost::scheduling();
        let thread = Arc::new(Self {
            own_rank: AtomicU8::new(own.rank()),
            is_plain,
            boosts: PiLock::new(Boosts {
                own,
                waits: WaitList::new(),
                counts: Counts::new(),
                applied: 0,
                left: false,
            }),
            now: AtomicU8::new(0),
            is_behind: AtomicBool::new(false),
        });
        // A thread's first lock asks the system for the thread id: do it here, off the real-time
        // path.
        drop(thread.boosts.lock());
        thread
    }

    /// The highest boost; 0 if there is none.
    #[inline]
    pub(super) fn boost(&self) -> u8 {
        self.now.load(Ordering::Relaxed)
    }

    /// Changes the boosts under the lock of the executor's boosts, and sets the thread's priority
    /// if the highest one changes. That happens under the lock too: two concurrent system calls
    /// could leave the thread at the wrong priority.
    pub(super) fn change(&self, change: impl FnOnce(&mut Boosts)) {
        let mut boosts = self.boosts.lock();
        change(&mut boosts);
        self.apply(&mut boosts);
    }

    /// Tries again what the system has refused: see
    /// [`Inheritor::catch_up`](super::Inheritor::catch_up).
    #[inline]
    pub(super) fn catch_up(&self) {
        if self.is_behind.load(Ordering::Relaxed) {
            self.change(|_| {});
        }
    }

    /// Accesses the state under the lock of the executor's boosts.
    pub(super) fn with<R>(&self, look: impl FnOnce(&mut Boosts) -> R) -> R {
        look(&mut self.boosts.lock())
    }

    /// The thread's own real-time priority when it was last read; 0 if it has none.
    #[inline]
    pub(super) fn own_rank(&self) -> u8 {
        self.own_rank.load(Ordering::Relaxed)
    }

    /// Whether it is a plain thread's.
    pub(super) fn is_plain(&self) -> bool {
        self.is_plain
    }

    /// Reads a plain thread's own priority again, unless the thread is boosted.
    pub(super) fn refresh(&self) {
        if self.is_plain {
            self.ask(&mut self.boosts.lock());
        }
    }

    fn ask(&self, boosts: &mut Boosts) {
        if boosts.applied == 0 && !boosts.left {
            boosts.own = path::expected(Call::Boost, || boost::scheduling_again(&boosts.own));
            self.own_rank.store(boosts.own.rank(), Ordering::Relaxed);
        }
    }

    /// Leaves the executor: its thread ends, or does other things. It gets its own priority back,
    /// and is never boosted again, since its thread id may be reused.
    pub(super) fn leave(&self) {
        let mut boosts = self.boosts.lock();
        if boosts.applied != 0 {
            // A refusal leaves it boosted: it ends, or is the program's own again.
            let _ = path::expected(Call::Boost, || boost::restore(&boosts.own));
            boosts.applied = 0;
        }
        boosts.left = true;
    }

    fn apply(&self, boosts: &mut Boosts) {
        let mut highest = boosts.counts.highest();
        self.now.store(highest, Ordering::Relaxed);
        self.is_behind.store(false, Ordering::Relaxed);
        if highest == boosts.applied || boosts.left {
            return;
        }
        if self.is_plain {
            self.ask(boosts);
            // It may have raised itself since it was boosted to this.
            if highest <= self.own_rank() {
                highest = 0;
            }
            if highest == boosts.applied {
                return;
            }
        }
        let set = || match highest {
            0 => boost::restore(&boosts.own),
            _ => boost::boost(&boosts.own, highest),
        };
        if let Err(refusal) = path::expected(Call::Boost, set) {
            self.is_behind.store(true, Ordering::Relaxed);
            if REFUSED.fetch_add(1, Ordering::Relaxed) == 0 {
                FIRST_REFUSED.store(
                    u32::from(highest) | refusal.unsigned_abs() << 8,
                    Ordering::Relaxed,
                );
            }
            return;
        }
        boosts.applied = highest;
    }
}

#[cfg(not(loom))]
luna_platform::local! {
    static PLAIN: OnceCell<PlainThread> = const { OnceCell::new() };
}

/// A plain thread, until it ends.
#[cfg(not(loom))]
struct PlainThread(Arc<ExecutorThread>);

#[cfg(not(loom))]
impl Drop for PlainThread {
    fn drop(&mut self) {
        self.0.leave();
    }
}

/// The calling thread as a plain one. The first call on a thread allocates, and reads its policy
/// from the system. None while the thread ends.
#[cfg(not(loom))]
pub(super) fn plain() -> Option<Arc<ExecutorThread>> {
    PLAIN
        .try_with(|plain| {
            plain
                .get_or_init(|| PlainThread(ExecutorThread::of_calling(true)))
                .0
                .clone()
        })
        .ok()
}

/// The calling thread as a plain one, if [`plain`] was called on it before.
pub(super) fn known_plain() -> Option<Arc<ExecutorThread>> {
    #[cfg(not(loom))]
    return PLAIN
        .try_with(|plain| plain.get().map(|plain| plain.0.clone()))
        .ok()
        .flatten();
    #[cfg(loom)]
    None
}

/// How many boosts the system has refused, which is no error: the process then runs at its thread's
/// own priority. With the priority of the first of them, and the system's error number.
///
/// ```
/// // No boost was refused, since no process has inherited.
/// assert_eq!(luna_core::current::refused_boosts(), None);
/// ```
#[cfg(all(feature = "std", not(loom)))]
pub fn refused_boosts() -> Option<(u32, u8, i32)> {
    let count = REFUSED.load(Ordering::Relaxed);
    let first = FIRST_REFUSED.load(Ordering::Relaxed);
    (count > 0).then_some((count, (first & 0xff) as u8, (first >> 8) as i32))
}

#[cfg(all(test, not(loom)))]
mod tests {
    use super::*;
    use luna_platform::thread::{Policy, current_policy};

    #[test]
    fn a_deadline_thread_keeps_its_policy_whatever_its_boost() {
        use core::time::Duration;
        use luna_platform::thread::{Attributes, spawn};
        let policy = Policy::deadline(
            Duration::from_millis(1),
            Duration::from_millis(10),
            Duration::from_millis(10),
        );
        let attributes = Attributes::new("deadline").policy(policy);
        let thread = spawn(
            attributes,
            |_| Ok::<_, core::convert::Infallible>(()),
            |()| {
                let own = current_policy();
                let thread = ExecutorThread::new();
                for more in [true, false] {
                    thread.change(|boosts| assert!(boosts.count(99, more)));
                    // Without the privilege it is an ordinary thread, which may have been boosted.
                    if own.is_deadline() {
                        assert_eq!(current_policy(), own);
                    }
                }
                thread.change(|boosts| assert!(boosts.count(50, true)));
                thread.leave();
                assert_eq!(current_policy(), own);
            },
        )
        .expect("best effort makes the thread");
        let obtained = thread.obtained().policy;
        thread.join().expect("the body does not panic");
        if obtained != policy {
            println!("skipped: a_deadline_thread_keeps_its_policy: needs SCHED_DEADLINE");
        }
    }

    #[test]
    fn a_deadline_thread_lends_what_leaves_an_emergency_above_it() {
        let deadline = Policy::deadline(
            core::time::Duration::from_millis(1),
            core::time::Duration::from_millis(2),
            core::time::Duration::from_millis(3),
        );
        assert_eq!(
            [0, 80, 99, deadline.rank()].map(boost_from),
            [0, 80, 99, luna_platform::thread::HIGHEST_USER_PRIORITY]
        );
    }

    #[test]
    fn a_thread_runs_at_its_boost_or_the_refusal_is_counted() {
        let own = current_policy();
        let thread = ExecutorThread::new();
        for (priority, more, highest) in [
            (50, true, 50),
            (30, true, 50),
            (50, false, 30),
            (60, true, 60),
            (60, false, 30),
            (30, false, 0),
        ] {
            thread.change(|boosts| assert!(boosts.count(priority, more)));
            assert_eq!(thread.boost(), highest);
            let now = current_policy();
            match refused_boosts() {
                None if highest == 0 => assert_eq!(now, own),
                None => assert_eq!(now, Policy::fifo(highest)),
                Some((_, asked, _)) => {
                    assert_eq!(now, own);
                    // Another test may have been the first.
                    assert!((1..=99).contains(&asked), "{asked}");
                }
            }
        }
        thread.change(|boosts| assert!(boosts.count(50, true)));
        thread.leave();
        assert_eq!(current_policy(), own);
        thread.change(|boosts| assert!(boosts.count(60, true)));
        assert_eq!(
            current_policy(),
            own,
            "an executor that was left gets no boost"
        );
    }
}
