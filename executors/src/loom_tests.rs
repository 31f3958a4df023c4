//! The wake protocol on every interleaving: nobody is lost, nobody comes twice, nobody sleeps through a wake. And the protocol by which it is
//! seen that all sleep: never while something is under way, and always in the end.
//!
//! Run with `RUSTFLAGS="--cfg loom" cargo test -p luna-executors --release --lib`.

use crate::inbound::Inbound;
use crate::link::Link;
use crate::presence::{Look, Presence, Sleeper, look};
use crate::run_queue::RunQueue;
use loom::sync::Arc;
use loom::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use loom::thread;
use luna_platform::clock::Instant;
use luna_platform::futex::Futex;
use std::ptr::NonNull;

/// A process: its link, and whether it is queued, as async-task's state would say.
struct Node {
    link: Link,
    is_scheduled: AtomicBool,
    level: u8,
}

unsafe fn nothing(_: NonNull<Link>) {}

impl Node {
    /// On the heap for as long as the program: loom's threads have no scope.
    fn leak(level: u8) -> &'static Node {
        Box::leak(Box::new(Node {
            link: Link::new(nothing),
            is_scheduled: AtomicBool::new(false),
            level,
        }))
    }

    /// A waker's work: schedules the process unless it is scheduled.
    fn wake(&'static self, inbound: &Inbound) {
        if !self.is_scheduled.swap(true, Ordering::AcqRel) {
            // SAFETY: the node lives for ever, and is in no queue unless it is scheduled.
            unsafe { inbound.push(self.level, NonNull::from(&self.link)) };
        }
    }
}

/// The owner's loop, as in `executor::round`: runs until `expected` runs were counted. Gives the levels in the order of their runs.
fn run_until(inbound: &Inbound, nodes: &[&'static Node], expected: usize) -> Vec<u8> {
    let queue = RunQueue::new();
    let mut runs = Vec::new();
    while runs.len() < expected {
        if let Some(level) = inbound.signals().highest_level()
            && queue.highest_level() <= Some(level)
        {
            for link in inbound.take(level) {
                // SAFETY: taken from the stack, so live and in no queue.
                unsafe { queue.push_back(level, link) };
            }
        }
        match queue.pop() {
            Some(link) => {
                let node = nodes
                    .iter()
                    .find(|node| NonNull::from(&node.link) == link)
                    .unwrap();
                // A run clears the flag before it polls, so that a wake during the poll schedules again.
                assert!(
                    node.is_scheduled.swap(false, Ordering::AcqRel),
                    "ran without being scheduled"
                );
                runs.push(node.level);
            }
            None => inbound.sleep(Instant::NEVER),
        }
    }
    assert!(queue.pop().is_none());
    luna_platform::current::set_ready_levels(0);
    runs
}

fn model(f: impl Fn() + Sync + Send + 'static) {
    let mut builder = loom::model::Builder::new();
    // Three switches where a thread could have gone on reach every known kind of lost wake, and bound the search.
    builder.preemption_bound = builder.preemption_bound.or(Some(3));
    builder.check(f);
}

#[test]
fn a_wake_is_never_slept_through() {
    model(|| {
        let inbound = Arc::new(Inbound::new());
        let node = Node::leak(3);
        let other = inbound.clone();
        let waker = thread::spawn(move || node.wake(&other));
        assert_eq!(run_until(&inbound, &[node], 1), [3]);
        waker.join().unwrap();
    });
}

#[test]
fn two_wakers_of_two_processes_at_one_level() {
    model(|| {
        let inbound = Arc::new(Inbound::new());
        let nodes = [Node::leak(3), Node::leak(3)];
        let wakers = nodes.map(|node| {
            let inbound = inbound.clone();
            thread::spawn(move || node.wake(&inbound))
        });
        assert_eq!(run_until(&inbound, &nodes, 2), [3, 3]);
        for waker in wakers {
            waker.join().unwrap();
        }
    });
}

#[test]
fn two_wakers_at_two_levels() {
    model(|| {
        let inbound = Arc::new(Inbound::new());
        let nodes = [Node::leak(0), Node::leak(31)];
        let wakers = nodes.map(|node| {
            let inbound = inbound.clone();
            thread::spawn(move || node.wake(&inbound))
        });
        let mut runs = run_until(&inbound, &nodes, 2);
        runs.sort_unstable();
        assert_eq!(runs, [0, 31]);
        for waker in wakers {
            waker.join().unwrap();
        }
    });
}

#[test]
fn a_process_woken_twice_runs_once_or_twice_and_ends_unscheduled() {
    model(|| {
        let inbound = Arc::new(Inbound::new());
        let node = Node::leak(7);
        let other = inbound.clone();
        let waker = thread::spawn(move || {
            node.wake(&other);
            node.wake(&other);
        });
        let runs = run_until(&inbound, &[node], 1).len();
        waker.join().unwrap();
        let rest = if inbound.signals().highest_level().is_some() {
            inbound.take(7).count()
        } else {
            0
        };
        assert!(runs + rest <= 2);
        assert_eq!(node.is_scheduled.load(Ordering::Acquire), rest == 1);
    });
}

#[test]
fn pushes_of_one_thread_stay_in_order() {
    model(|| {
        let inbound = Arc::new(Inbound::new());
        let nodes = [Node::leak(5), Node::leak(5)];
        let other = inbound.clone();
        let waker = thread::spawn(move || nodes.iter().for_each(|node| node.wake(&other)));
        let mut seen = Vec::new();
        while seen.len() < 2 {
            if inbound.signals().highest_level().is_some() {
                seen.extend(inbound.take(5));
            } else {
                inbound.sleep(Instant::NEVER);
            }
        }
        assert_eq!(seen, nodes.map(|node| NonNull::from(&node.link)));
        waker.join().unwrap();
    });
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

/// An executor's thread that answers each attention with one to the next home, as long as there are hops to make.
struct Home {
    inbound: Inbound,
    presence: Presence,
}

impl Sleeper for Home {
    fn presence(&self) -> &Presence {
        &self.presence
    }

    fn is_woken(&self) -> bool {
        self.inbound.is_signalled()
    }
}

/// Homes that pass one message on, `hops` times, and who looks whether all are still.
struct Ring {
    homes: [Home; 2],
    hops: usize,
    made: AtomicUsize,
    ended: AtomicBool,
    changes: Futex,
}

impl Ring {
    fn new(hops: usize) -> Arc<Self> {
        let home = || Home {
            inbound: Inbound::new(),
            presence: Presence::new(),
        };
        Arc::new(Self {
            homes: [home(), home()],
            hops,
            made: AtomicUsize::new(0),
            ended: AtomicBool::new(false),
            changes: Futex::new(0),
        })
    }

    /// The life of a home, as `executor::round`.
    fn live(&self, number: usize) {
        let home = &self.homes[number];
        loop {
            if home.inbound.is_signalled() {
                home.inbound.take_attention();
                if self.ended.load(Ordering::Acquire) {
                    return;
                }
                if self.made.load(Ordering::Relaxed) < self.hops {
                    self.made.fetch_add(1, Ordering::Relaxed);
                    self.homes[1 - number].inbound.ask_attention();
                }
            } else {
                home.inbound.sleep_still(&home.presence, || self.ring());
            }
        }
    }

    fn ring(&self) {
        self.changes.word().fetch_add(1, Ordering::Release);
        self.changes.wake_all();
    }

    /// Looks until all are still, as the thread that runs a system.
    fn watch_until_still(&self) {
        let homes = [&self.homes[0], &self.homes[1]];
        loop {
            let seen = self.changes.word().load(Ordering::Acquire);
            match look(&homes) {
                Look::Still(_) => return,
                Look::Stirring => drop(self.changes.wait(seen, Instant::NEVER)),
                Look::Unclear => thread::yield_now(),
            }
        }
    }

    fn end(&self) {
        self.ended.store(true, Ordering::Release);
        self.homes
            .iter()
            .for_each(|home| home.inbound.ask_attention());
    }
}

fn all_are_still_when_the_last_hop_is_made(hops: usize) {
    let mut builder = loom::model::Builder::new();
    builder.preemption_bound = builder.preemption_bound.or(Some(2));
    builder.check(move || {
        let ring = Ring::new(hops);
        ring.homes[0].inbound.ask_attention();
        let lives = [0, 1].map(|number| {
            let ring = ring.clone();
            thread::spawn(move || ring.live(number))
        });
        // It returns: a home that falls still as the last rings.
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
fn stillness_is_seen_when_there_is_nothing_to_do() {
    all_are_still_when_the_last_hop_is_made(0);
}

#[test]
fn stillness_is_not_seen_while_a_wake_is_under_way() {
    all_are_still_when_the_last_hop_is_made(1);
}

#[test]
fn stillness_is_not_seen_while_the_answer_to_a_wake_is_under_way() {
    all_are_still_when_the_last_hop_is_made(2);
}

#[test]
fn a_call_on_the_pool_is_seen_until_its_wake_was_made() {
    let mut builder = loom::model::Builder::new();
    builder.preemption_bound = builder.preemption_bound.or(Some(3));
    builder.check(|| {
        let ring = Ring::new(0);
        // Home 1 has ended its work for good; home 0 has begun a call, whose end wakes it.
        assert!(!ring.homes[1].presence.fall_still());
        ring.homes[0].presence.begin_call();
        let (own, buddy) = (ring.clone(), ring.clone());
        let home = thread::spawn(move || own.live(0));
        let buddy = thread::spawn(move || {
            buddy.made.fetch_add(1, Ordering::Relaxed);
            buddy.homes[0].inbound.ask_attention();
            if buddy.homes[0].presence.end_call() {
                buddy.ring();
            }
        });
        ring.watch_until_still();
        assert_eq!(ring.made.load(Ordering::Relaxed), 1);
        ring.end();
        home.join().unwrap();
        buddy.join().unwrap();
    });
}
