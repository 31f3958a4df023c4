//! Calls, barriers, locks and registered alternatives between processes, with interrupts.

use luna_bare::cpu;
use luna_channels::lock_sync::{Mutex, Semaphore};
use luna_channels::{Alternative, Barrier, Buffer, buffered, call_channel};
use luna_core::{Executor, ProcessSpec, yield_now};
use std::cell::Cell;
use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering};

fn at(level: u8) -> ProcessSpec {
    ProcessSpec::new("process").level(level)
}

/// An interrupt at one place in five, which sends as long as there is room.
fn begin(seed: u64) -> luna_channels::Receiver<u32> {
    cpu::begin(seed, 5);
    let (sender, receiver) = buffered(Buffer::fifo(2));
    let next = Cell::new(0);
    cpu::add_interrupt(1, move || {
        if sender.try_send(next.get()).is_ok() {
            next.set(next.get() + 1);
        }
        next.get() < 10
    });
    receiver
}

#[test]
fn each_call_gets_its_reply() {
    for seed in 0..200 {
        let interrupts = begin(seed);
        let executor = Executor::new();
        let (client, server) = call_channel::<u32, u32>();
        executor.spawn(at(5), move || async move {
            while let Ok(call) = server.accept().await {
                let request = *call;
                yield_now().await;
                call.reply(request * 2).unwrap();
            }
        });
        for level in [20, 10] {
            let client = client.clone();
            executor.spawn(at(level), move || async move {
                for request in 0..5 {
                    assert_eq!(client.call(request).await.unwrap(), request * 2);
                }
            });
        }
        drop(client);
        executor.spawn(at(15), move || async move {
            for value in 0..10 {
                assert_eq!(interrupts.recv().await, Ok(value));
            }
        });
        executor.run();
    }
}

#[test]
fn a_server_inherits_the_level_of_its_client() {
    cpu::begin(1, 0);
    let executor = Executor::new();
    let (client, server) = call_channel::<(), ()>();
    let order = Arc::new(AtomicU32::new(0));
    let come = |expected, order: &AtomicU32| {
        assert_eq!(order.fetch_add(1, Ordering::Relaxed), expected);
    };
    let (serves, handle) = (order.clone(), executor.handle().clone());
    executor.spawn(at(5), move || async move {
        let call = server.accept().await.unwrap();
        come(1, &serves);
        let between = serves.clone();
        handle.spawn(at(10), move || async move { come(4, &between) });
        for _ in 0..3 {
            yield_now().await;
        }
        come(2, &serves);
        call.reply(()).unwrap();
        // Below the one between them again.
        yield_now().await;
        come(5, &serves);
    });
    executor.spawn(at(20), move || async move {
        come(0, &order);
        client.call(()).await.unwrap();
        come(3, &order);
    });
    executor.run();
}

#[test]
fn no_party_passes_a_barrier_before_the_others_have_come() {
    for seed in 0..200 {
        let _interrupts = begin(seed);
        let executor = Executor::new();
        let (barrier, round) = (Barrier::new(3), Arc::new(AtomicU32::new(0)));
        for party in 0..3 {
            let (barrier, round) = (barrier.clone(), round.clone());
            executor.spawn(at(5 + party), move || async move {
                for number in 0..4 {
                    round.fetch_add(1, Ordering::Relaxed);
                    barrier.sync().await;
                    assert!(round.load(Ordering::Relaxed) >= 3 * (number + 1));
                }
            });
        }
        executor.run();
        assert_eq!(round.load(Ordering::Relaxed), 12);
    }
}

#[test]
fn a_mutex_has_one_holder_and_a_semaphore_as_many_as_permits() {
    for seed in 0..200 {
        let _interrupts = begin(seed);
        let executor = Executor::new();
        let (mutex, permits) = (Arc::new(Mutex::new(0)), Arc::new(Semaphore::new(2)));
        let inside = Arc::new(AtomicU32::new(0));
        for level in [5, 6, 7, 20] {
            let (mutex, permits, inside) = (mutex.clone(), permits.clone(), inside.clone());
            executor.spawn(at(level), move || async move {
                for _ in 0..3 {
                    let mut count = mutex.lock().await.unwrap();
                    let before = *count;
                    yield_now().await;
                    *count = before + 1;
                    drop(count);
                    let permit = permits.acquire().await.unwrap();
                    assert!(inside.fetch_add(1, Ordering::Relaxed) < 2);
                    yield_now().await;
                    inside.fetch_sub(1, Ordering::Relaxed);
                    drop(permit);
                }
            });
        }
        executor.run();
        assert_eq!(*mutex.try_lock().unwrap(), 12);
    }
}

#[test]
fn a_registered_alternative_takes_from_interrupts_and_processes() {
    for seed in 0..200 {
        let interrupts = begin(seed);
        let executor = Executor::new();
        let (sender, receiver) = luna_channels::channel();
        executor.spawn(at(5), move || async move {
            for value in 0..10 {
                sender.send(value).await.unwrap();
            }
        });
        executor.spawn(at(10), move || async move {
            let mut next = [0, 0];
            let inputs = [interrupts, receiver];
            let mut either = Alternative::fair(&inputs);
            while next != [10, 10] {
                let (index, value) = either.recv().await;
                let Ok(value) = value else {
                    continue;
                };
                assert_eq!(value, next[index], "seed {seed}");
                next[index] += 1;
            }
        });
        executor.run();
    }
}
