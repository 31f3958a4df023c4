//! The wake protocol on every interleaving: no wake is lost or slept through, and none relies on
//! another. And the protocol by which it is seen that all sleep: never while something is under
//! way, and always in the end.
//!
//! Run with `RUSTFLAGS="--cfg loom" cargo test -p luna-core --release --lib`.

use crate::inbound::Inbound;
use crate::quiescence::{Look, Quiescence, Sleeper, look};
use crate::remote_wakes::{RemoteWakes, WakeSlot};
use loom::sync::Arc;
use loom::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use loom::thread;
use luna_platform::clock::Instant;
use luna_platform::futex::Futex;
use std::time::Duration;

/// The executor's part that its wakers see, and a process' part: its wake slot, and what its wakers
/// bring.
struct Process {
    slot: WakeSlot,
    level: u8,
    brought: AtomicUsize,
}

impl Process {
    fn wake(&self, inbound: &Inbound) {
        self.brought.fetch_add(1, Ordering::Relaxed);
        inbound.wake(&self.slot, self.level);
    }
}

/// Processes at these levels, each of which is a member by its place.
fn processes<const N: usize>(levels: [u8; N]) -> (Arc<[Process; N]>, RemoteWakes<usize>) {
    let mut remote_wakes = RemoteWakes::new();
    let mut member = 0;
    let processes = levels.map(|level| {
        let slot = remote_wakes.enter(member);
        member += 1;
        Process {
            slot,
            level,
            brought: AtomicUsize::new(0),
        }
    });
    (Arc::new(processes), remote_wakes)
}

/// The owner's loop, as in `executor::round`: runs processes until all has been seen that
/// `expected` wakes bring. Returns which members ran. With `spins`, it looks before it sleeps.
fn run_until<const N: usize>(
    inbound: &Inbound,
    remote_wakes: &RemoteWakes<usize>,
    processes: &[Process; N],
    expected: usize,
    spins: bool,
) -> Vec<usize> {
    let mut runs = Vec::new();
    let mut seen = [0; N];
    while seen.iter().sum::<usize>() < expected {
        match inbound.signals().highest_level() {
            Some(level) => inbound.take(level, remote_wakes, |member| {
                assert_eq!(processes[member].level, level);
                runs.push(member);
                seen[member] = processes[member].brought.load(Ordering::Relaxed);
            }),
            None if spins && inbound.spin(Duration::ZERO, Instant::NEVER, || false) => {}
            None => inbound.sleep(Instant::NEVER),
        }
    }
    runs
}

fn model(f: impl Fn() + Sync + Send + 'static) {
    let mut builder = loom::model::Builder::new();
    // Three switches where a thread could have gone on reach every known kind of lost wake, and
    // bound the search.
    builder.preemption_bound = builder.preemption_bound.or(Some(3));
    builder.check(f);
}

/// Wakers of these members, all at once, and the owner, which must see all that they bring.
fn all_are_seen<const N: usize, const W: usize>(levels: [u8; N], wakers: [usize; W]) {
    all_are_seen_by(levels, wakers, false);
}

fn all_are_seen_by<const N: usize, const W: usize>(
    levels: [u8; N],
    wakers: [usize; W],
    spins: bool,
) {
    model(move || {
        let inbound = Arc::new(Inbound::new());
        let (processes, remote_wakes) = processes(levels);
        let wakers = wakers.map(|member| {
            let (inbound, processes) = (inbound.clone(), processes.clone());
            thread::spawn(move || processes[member].wake(&inbound))
        });
        let runs = run_until(&inbound, &remote_wakes, &processes, W, spins);
        for waker in wakers {
            waker.join().unwrap();
        }
        // A member that came with what was seen before may be left.
        let mut left = 0;
        while let Some(level) = inbound.signals().highest_level() {
            inbound.take(level, &remote_wakes, |_| left += 1);
        }
        assert!(runs.len() + left <= W, "{runs:?}: ran without being woken");
    });
}

#[test]
fn a_wake_is_never_slept_through() {
    all_are_seen([3], [0]);
}

#[test]
fn a_wake_is_seen_by_an_owner_that_looks_before_it_sleeps() {
    all_are_seen_by([3], [0], true);
}

#[test]
fn two_wakers_of_an_owner_that_looks_before_it_sleeps() {
    all_are_seen_by([3, 7], [0, 1], true);
}

/// The second process' wake slot is not among those beside the signals.
#[test]
fn a_wake_of_a_distant_slot_is_never_missed() {
    all_are_seen([3, 3], [1]);
}

#[test]
fn two_wakers_of_one_process_further_off() {
    all_are_seen([7, 7], [1, 1]);
}

#[test]
fn two_wakers_of_two_processes_at_one_level() {
    all_are_seen([3, 3], [0, 1]);
}

#[test]
fn two_wakers_at_two_levels() {
    all_are_seen([0, 31], [0, 1]);
}

#[test]
fn two_wakers_of_one_process() {
    all_are_seen([7], [0, 0]);
}

/// One waker stands still for ever after any of its steps: the wake of another is seen all the
/// same.
#[test]
fn a_waker_that_goes_no_further_holds_up_nobody() {
    for (member, steps) in [(0, 0), (0, 1), (1, 0), (1, 1), (1, 2)] {
        model(move || {
            let inbound = Arc::new(Inbound::new());
            let (processes, remote_wakes) = processes([7, 7]);
            let slot = &processes[member].slot;
            if steps > 0 {
                slot.mark_word(&inbound.first, 7);
            }
            if steps > 1 {
                slot.mark_summary(7);
            }
            let waker = {
                let (inbound, processes) = (inbound.clone(), processes.clone());
                thread::spawn(move || processes[member].wake(&inbound))
            };
            assert!(!run_until(&inbound, &remote_wakes, &processes, 1, false).is_empty());
            waker.join().unwrap();
        });
    }
}

#[test]
fn attention_is_never_slept_through() {
    model(|| {
        let inbound = Arc::new(Inbound::new());
        let request = Arc::new(AtomicBool::new(false));
        let (other, asked) = (inbound.clone(), request.clone());
        let asker = thread::spawn(move || {
            asked.store(true, Ordering::Release);
            other.ask_attention();
        });
        loop {
            if inbound.signals().attention() {
                inbound.take_attention();
                assert!(request.load(Ordering::Acquire));
                break;
            }
            inbound.sleep(Instant::NEVER);
        }
        asker.join().unwrap();
    });
}

/// An executor's thread that answers each attention with one to the next such thread, as long as
/// there are hops to make.
struct TestSleeper {
    inbound: Inbound,
    quiescence: Quiescence,
}

impl Sleeper for TestSleeper {
    fn quiescence(&self) -> &Quiescence {
        &self.quiescence
    }

    fn is_woken(&self) -> bool {
        self.inbound.is_signalled()
    }
}

/// Threads that pass one message on, `hops` times, and an observer that checks whether all are
/// still.
struct Ring {
    sleepers: [TestSleeper; 2],
    hops: usize,
    made: AtomicUsize,
    ended: AtomicBool,
    changes: Futex,
}

impl Ring {
    fn new(hops: usize) -> Arc<Self> {
        let sleeper = || TestSleeper {
            inbound: Inbound::new(),
            quiescence: Quiescence::new(),
        };
        Arc::new(Self {
            sleepers: [sleeper(), sleeper()],
            hops,
            made: AtomicUsize::new(0),
            ended: AtomicBool::new(false),
            changes: Futex::new(0),
        })
    }

    /// The life of one thread, as `executor::round`.
    fn live(&self, number: usize) {
        let sleeper = &self.sleepers[number];
        loop {
            if sleeper.inbound.is_signalled() {
                sleeper.inbound.take_attention();
                if self.ended.load(Ordering::Acquire) {
                    return;
                }
                if self.made.load(Ordering::Relaxed) < self.hops {
                    self.made.fetch_add(1, Ordering::Relaxed);
                    self.sleepers[1 - number].inbound.ask_attention();
                }
            } else {
                sleeper
                    .inbound
                    .sleep_quiescent(&sleeper.quiescence, || self.ring());
            }
        }
    }

    fn ring(&self) {
        self.changes.word().fetch_add(1, Ordering::Release);
        self.changes.wake_all();
    }

    /// Looks until all are still, as the thread that runs a system.
    fn watch_until_still(&self) {
        let sleepers = [&self.sleepers[0], &self.sleepers[1]];
        loop {
            let seen = self.changes.word().load(Ordering::Acquire);
            match look(&sleepers) {
                Look::Quiescent(_) => return,
                Look::Stirring => drop(self.changes.wait(seen, Instant::NEVER)),
                Look::Unclear => thread::yield_now(),
            }
        }
    }

    fn end(&self) {
        self.ended.store(true, Ordering::Release);
        self.sleepers
            .iter()
            .for_each(|sleeper| sleeper.inbound.ask_attention());
    }
}

fn all_are_still_when_the_last_hop_is_made(hops: usize) {
    let mut builder = loom::model::Builder::new();
    builder.preemption_bound = builder.preemption_bound.or(Some(2));
    builder.check(move || {
        let ring = Ring::new(hops);
        ring.sleepers[0].inbound.ask_attention();
        let lives = [0, 1].map(|number| {
            let ring = ring.clone();
            thread::spawn(move || ring.live(number))
        });
        // It returns: a thread that falls still as the last rings.
        ring.watch_until_still();
        assert_eq!(
            ring.made.load(Ordering::Relaxed),
            hops,
            "seen as still while a message was under way"
        );
        ring.end();
        for life in lives {
            life.join().unwrap();
        }
    });
}

#[test]
fn quiescence_is_seen_when_there_is_nothing_to_do() {
    all_are_still_when_the_last_hop_is_made(0);
}

#[test]
fn quiescence_is_not_seen_while_a_wake_is_under_way() {
    all_are_still_when_the_last_hop_is_made(1);
}

#[test]
fn quiescence_is_not_seen_while_the_answer_to_a_wake_is_under_way() {
    all_are_still_when_the_last_hop_is_made(2);
}

#[test]
fn a_call_on_the_pool_is_seen_until_its_wake_was_made() {
    let mut builder = loom::model::Builder::new();
    // Three take two minutes.
    builder.preemption_bound = builder.preemption_bound.or(Some(2));
    builder.check(|| {
        let ring = Ring::new(0);
        // Thread 1 has ended its work for good; thread 0 has begun a call. The call's end wakes it.
        assert!(!ring.sleepers[1].quiescence.become_quiescent());
        ring.sleepers[0].quiescence.begin_call();
        let (own, buddy) = (ring.clone(), ring.clone());
        let sleeper = thread::spawn(move || own.live(0));
        let buddy = thread::spawn(move || {
            buddy.made.fetch_add(1, Ordering::Relaxed);
            buddy.sleepers[0].inbound.ask_attention();
            if buddy.sleepers[0].quiescence.end_call() {
                buddy.ring();
            }
        });
        ring.watch_until_still();
        assert_eq!(ring.made.load(Ordering::Relaxed), 1);
        ring.end();
        sleeper.join().unwrap();
        buddy.join().unwrap();
    });
}
