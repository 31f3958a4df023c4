//! Each operation with a waker that panics in each of its functions, at each point of the
//! operation's life.

use crate::common::Random;
use crate::hostile_futures::actors::{
    Call, Temper, VALUES, WAKERS, endure, silence_expected_panics, waker,
};
use crate::hostile_futures::one_at_a_time;
use crate::hostile_futures::world::{KINDS, Operation, PLAIN_KINDS, World};
use luna_core::{Executor, ExecutorHandle, Exit, ProcessSpec};
use luna_platform::thread::Attributes;
use std::sync::atomic::Ordering;
use std::task::{Context, Poll, Waker};

/// What ends an operation that waits.
#[derive(Clone, Copy)]
enum End {
    /// It is dropped.
    Drop,
    /// Its partners come, with operations that do not wait.
    Partners,
    /// Its partners come and wait, and go.
    WaitingPartners,
    /// All channels end.
    Break,
}

const ENDS: [End; 4] = [End::Drop, End::Partners, End::WaitingPartners, End::Break];

/// Polls an operation that is not over.
fn poll(operation: &mut Option<Operation>, waker: &Waker) {
    let Some(under_way) = operation else {
        return;
    };
    let polled = endure(|| under_way.poll(&mut Context::from_waker(waker)));
    if let Some(Poll::Ready(result)) = polled {
        endure(|| drop(result));
        let over = operation.take();
        endure(|| drop(over));
    }
}

fn attempt(piece: &mut dyn FnMut()) {
    endure(piece);
}

/// Takes an operation of this kind through its life.
fn live(kind: usize, temper: Temper, end: End, executor: Option<ExecutorHandle>, seed: u64) {
    let mut random = Random::new(seed);
    let world = World::new(executor, true);
    // So that a lock is waited for, and a permit.
    let mut before = Vec::new();
    for kind in [16, 17] {
        let mut operation = loop {
            // A value that is not used may panic in its drop.
            if let Some(made) = endure(|| world.operation(kind, &mut random)) {
                break made.unwrap();
            }
        };
        let held = operation.poll(&mut Context::from_waker(Waker::noop()));
        before.push((held, operation));
    }
    if kind == 18 {
        drop(before.remove(0));
    }
    let hostile = [waker(temper, &world, seed), waker(temper, &world, seed + 1)];
    let mut operation = endure(|| world.operation(kind, &mut random)).flatten();
    if operation.is_some() {
        // The second takes the first one's place, and the third the second's.
        poll(&mut operation, &hostile[0]);
        poll(&mut operation, &hostile[1]);
        poll(&mut operation, &hostile[0]);
        // A poll that panicked has left it as it was: now it waits, if it has to.
        poll(&mut operation, Waker::noop());
        poll(&mut operation, &hostile[1]);
        match end {
            End::Drop => {}
            End::Partners => world.touch_all(&mut random, attempt),
            End::WaitingPartners => {
                for partner in 0..PLAIN_KINDS {
                    let mut partner = endure(|| world.operation(partner, &mut random)).flatten();
                    poll(&mut partner, &hostile[0]);
                    poll(&mut partner, &hostile[1]);
                    endure(|| drop(partner));
                }
            }
            End::Break => {
                for _ in 0..20 {
                    endure(|| world.break_something(&mut random));
                }
            }
        }
        poll(&mut operation, Waker::noop());
        endure(|| drop(operation));
    }
    for (held, operation) in before {
        endure(|| drop(held));
        endure(|| drop(operation));
    }
    for waker in hostile {
        endure(|| drop(waker));
    }
    // No node is left in a list: every later operation finds the world as it was.
    world.touch_all(&mut random, attempt);
    endure(|| drop(world));
}

fn try_every_operation(kinds: usize, executor: Option<&ExecutorHandle>) {
    let counts = || [&WAKERS, &VALUES].map(|count| count.load(Ordering::Relaxed));
    let before = counts();
    for kind in 0..kinds {
        for call in [Call::Clone, Call::Wake, Call::Drop] {
            for end in ENDS {
                for seed in 1..12 {
                    live(
                        kind,
                        Temper::always(call),
                        end,
                        executor.cloned(),
                        seed * 977,
                    );
                    // On an executor, its other processes may still have a waker.
                    if executor.is_none() {
                        assert_eq!(
                            counts(),
                            before,
                            "wakers and values left by operation {kind}; {} {} {seed}",
                            call as u8,
                            end as u8
                        );
                    }
                }
            }
        }
    }
}

/// One test, since it counts all wakers and values that there are.
#[test]
fn every_operation_endures_wakers_and_values_that_panic() {
    let _alone = one_at_a_time();
    silence_expected_panics();
    try_every_operation(PLAIN_KINDS, None);
    let executor = Executor::start(Attributes::new("hostile")).unwrap();
    let handle = executor.handle().clone();
    let process = executor.spawn(ProcessSpec::new("tries"), move || async move {
        try_every_operation(KINDS, Some(&handle));
    });
    executor.release();
    assert_eq!(process.wait(), Exit::Completed);
    executor.stop();
}
