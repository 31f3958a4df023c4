//! The wake protocol on every interleaving: nobody is lost, nobody comes twice, nobody sleeps through a wake.
//!
//! Run with `RUSTFLAGS="--cfg loom" cargo test -p luna-executors --release --lib`.

use crate::inbound::Inbound;
use crate::link::Link;
use crate::run_queue::RunQueue;
use loom::sync::Arc;
use loom::sync::atomic::{AtomicBool, Ordering};
use loom::thread;
use luna_platform::clock::Instant;
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
