//! Alternatives with partners on their own executor, until a partner from another thread comes:
//! every value once, and in order.

#![cfg(not(loom))]

use luna_channels::{
    Alternative, Buffer, Receiver, RecvError, Sender, alt, buffered, channel, pri_alt,
};
use luna_executors::{Executor, Exit, ProcessSpec, yield_now};
use luna_platform::thread::Attributes;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

/// So many that all locks are biased to the executor before any other thread comes.
const WARM: u64 = 100;
/// How many the process sends over each channel, and the thread.
const EACH: u64 = 200;
const ROUNDS: usize = 40;
const CHANNELS: usize = 3;

/// What is sent: by which sender, over which channel, and its number.
type Item = (bool, usize, u64);

#[derive(Clone, Copy)]
enum Server {
    Fair,
    Prioritized,
    Registered,
}

/// What came over each channel, from the process and from the thread: each in order.
#[derive(Default)]
struct Seen([[u64; 2]; CHANNELS]);

impl Seen {
    fn note(&mut self, from: usize, received: Result<Item, RecvError>) {
        let (is_thread, channel, number) = received.unwrap();
        assert_eq!(channel, from);
        let next = &mut self.0[channel][usize::from(is_thread)];
        assert_eq!(number, *next);
        *next += 1;
    }

    fn is_all(&self) -> bool {
        self.0 == [[EACH; 2]; CHANNELS]
    }
}

async fn serve(inputs: [Receiver<Item>; CHANNELS], server: Server) {
    let mut seen = Seen::default();
    let [a, b, c] = &inputs;
    let mut registered = match server {
        Server::Registered => Some(Alternative::fair(&inputs)),
        _ => None,
    };
    while !seen.is_all() {
        let (from, received) = match (server, &mut registered) {
            (Server::Registered, Some(inputs)) => inputs.recv().await,
            (Server::Prioritized, _) => pri_alt! {
                x = a.recv() => (0, x),
                x = b.recv() => (1, x),
                x = c.recv() => (2, x),
            },
            _ => alt! {
                x = a.recv() => (0, x),
                x = b.recv() => (1, x),
                x = c.recv() => (2, x),
            },
        };
        seen.note(from, received);
    }
}

/// Waits on a plain thread until the process has done so many.
fn wait_until_warm(done: &AtomicU64) {
    while done.load(Ordering::Acquire) < WARM {
        std::thread::yield_now();
    }
}

fn run(server: Server) {
    for _ in 0..ROUNDS {
        let executor = Executor::start(Attributes::new("home")).unwrap();
        let (outputs, inputs): (Vec<Sender<Item>>, Vec<_>) =
            (0..CHANNELS).map(|_| channel()).unzip();
        let inputs: [Receiver<Item>; CHANNELS] = inputs.try_into().unwrap();
        let done = Arc::new(AtomicU64::new(0));
        let elsewhere = {
            let (outputs, done) = (outputs.clone(), done.clone());
            std::thread::spawn(move || {
                wait_until_warm(&done);
                for number in 0..EACH {
                    for (channel, output) in outputs.iter().enumerate() {
                        output.blocking_send((true, channel, number)).unwrap();
                    }
                }
            })
        };
        let here = executor.spawn(ProcessSpec::new("here"), move || async move {
            for number in 0..EACH {
                for (channel, output) in outputs.iter().enumerate() {
                    output.send((false, channel, number)).await.unwrap();
                }
                done.fetch_add(1, Ordering::Release);
            }
        });
        let serving = executor.spawn(ProcessSpec::new("server"), move || serve(inputs, server));
        executor.release();
        for process in [here, serving] {
            assert_eq!(process.wait(), Exit::Completed);
        }
        elsewhere.join().unwrap();
    }
}

#[test]
fn a_thread_comes_to_a_fair_alternative_on_the_fast_path() {
    run(Server::Fair);
}

#[test]
fn a_thread_comes_to_a_prioritized_alternative_on_the_fast_path() {
    run(Server::Prioritized);
}

#[test]
fn a_thread_comes_to_a_registered_alternative_on_the_fast_path() {
    run(Server::Registered);
}

/// The alternative is notified of its channel once, and looks for the second sender itself.
#[test]
fn a_registered_alternative_receives_from_both_senders_that_wait_at_one_channel() {
    let executor = Executor::start(Attributes::new("home")).unwrap();
    let (sender, receiver) = channel::<u64>();
    let received = Arc::new(AtomicU64::new(0));
    let mut processes = Vec::new();
    for name in ["first", "second"] {
        let sender = sender.clone();
        processes.push(executor.spawn(ProcessSpec::new(name), move || async move {
            for number in 0..EACH {
                sender.send(number).await.unwrap();
            }
        }));
    }
    let count = received.clone();
    let server = executor.spawn(ProcessSpec::new("server"), move || async move {
        // Kept: a channel that ends notifies the alternative.
        let _sender = sender;
        let receivers = [receiver];
        let mut inputs = Alternative::fair(&receivers);
        for _ in 0..2 * EACH {
            // Both senders wait when it looks.
            yield_now().await;
            inputs.recv().await.1.unwrap();
            count.fetch_add(1, Ordering::Relaxed);
        }
    });
    processes.push(
        executor.spawn(ProcessSpec::new("judge"), move || async move {
            // Each lets all processes run that can.
            for _ in 0..20 * EACH {
                yield_now().await;
            }
            assert_eq!(received.load(Ordering::Relaxed), 2 * EACH);
        }),
    );
    executor.release();
    for process in processes.into_iter().rev().chain([server]) {
        assert_eq!(process.wait(), Exit::Completed);
    }
}

#[test]
fn a_thread_comes_to_an_alternative_that_offers_on_the_fast_path() {
    for _ in 0..ROUNDS {
        let executor = Executor::start(Attributes::new("home")).unwrap();
        let (left, from_left) = channel::<u64>();
        let (right, from_right) = channel::<u64>();
        let done = Arc::new(AtomicU64::new(0));
        let offering = executor.spawn(ProcessSpec::new("offers"), move || async move {
            // Until one of the readers has enough and goes.
            let mut next = 0;
            loop {
                let sent = alt! {
                    sent = left.send(next) => sent,
                    sent = right.send(next) => sent,
                };
                match sent {
                    Ok(()) => next += 1,
                    Err(unsent) => break assert_eq!(unsent.value, next),
                }
            }
        });
        let elsewhere = {
            let (from_right, done) = (from_right.clone(), done.clone());
            std::thread::spawn(move || {
                wait_until_warm(&done);
                let mut last = None;
                while let Ok(number) = from_right.blocking_recv() {
                    assert!(last < Some(number));
                    last = Some(number);
                }
            })
        };
        let here = executor.spawn(ProcessSpec::new("here"), move || async move {
            let mut last = None;
            for _ in 0..EACH {
                for input in [&from_left, &from_right] {
                    let number = input.recv().await.unwrap();
                    assert!(last < Some(number));
                    last = Some(number);
                }
                done.fetch_add(1, Ordering::Release);
            }
        });
        executor.release();
        for process in [offering, here] {
            assert_eq!(process.wait(), Exit::Completed);
        }
        elsewhere.join().unwrap();
    }
}

/// A buffer is plain too, and the slow path may have been the last one there. The alternative finds
/// what is stored. A process beside it would end one that waits for long.
#[test]
fn what_a_buffer_stores_is_found_on_the_fast_path() {
    let executor = Executor::start(Attributes::new("home")).unwrap();
    let (output, input) = buffered(Buffer::fifo(2));
    let (_never, other) = channel::<u64>();
    let both = executor.spawn(ProcessSpec::new("both ends"), move || async move {
        for number in 0..WARM {
            // By the slow path.
            output.try_send(number).unwrap();
            let received = match number % 2 {
                0 => pri_alt! {
                    x = other.recv() => x,
                    x = input.recv() => x,
                },
                _ => input.recv().await,
            };
            assert_eq!(received, Ok(number));
        }
    });
    let waits = both.clone();
    let watch = executor.spawn(ProcessSpec::new("watch"), move || async move {
        for _ in 0..10_000 {
            yield_now().await;
        }
        waits.cancel();
    });
    executor.release();
    assert_eq!(watch.wait(), Exit::Completed);
    assert_eq!(both.wait(), Exit::Completed);
}

/// An alternative has chosen, and has not run since. What waits at its other channel until it
/// withdraws its guard there keeps its order.
#[test]
fn the_guard_of_an_alternative_that_has_chosen_gives_way_on_the_fast_path() {
    let executor = Executor::start(Attributes::new("home")).unwrap();
    let (to_first, first) = channel::<usize>();
    let (to_second, second) = channel::<usize>();
    let (sender, receivers) = (to_second.clone(), [(); 4].map(|()| second.clone()));
    let mut processes = vec![
        executor.spawn(ProcessSpec::new("chooses"), move || async move {
            for _ in 0..WARM {
                assert!(first.try_recv().is_err() && second.try_recv().is_err());
            }
            let chosen = pri_alt! { x = first.recv() => x, x = second.recv() => x };
            assert_eq!(chosen, Ok(0));
        }),
        executor.spawn(ProcessSpec::new("is chosen"), move || async move {
            to_first.send(0).await.unwrap();
        }),
        executor.spawn(ProcessSpec::new("comes too late"), move || async move {
            sender.send(0).await.unwrap();
        }),
    ];
    // The last one comes when the alternative has gone on, the others before.
    for (number, receiver) in receivers.into_iter().enumerate() {
        processes.push(
            executor.spawn(ProcessSpec::new("receives"), move || async move {
                for _ in 0..2 * (number / 3) {
                    yield_now().await;
                }
                assert_eq!(receiver.recv().await, Ok(number));
            }),
        );
    }
    processes.push(
        executor.spawn(ProcessSpec::new("sends"), move || async move {
            for _ in 0..4 {
                yield_now().await;
            }
            for number in 1..4 {
                to_second.send(number).await.unwrap();
            }
        }),
    );
    executor.release();
    for process in processes {
        assert_eq!(process.wait(), Exit::Completed);
    }
}

/// Alternatives wait at one channel, the least urgent first. They are served by their levels.
#[test]
fn alternatives_wait_by_level_on_the_fast_path() {
    let executor = Executor::start(Attributes::new("home")).unwrap();
    let (to_idle, idle) = channel::<usize>();
    let (output, input) = channel::<usize>();
    let (starts, started): (Vec<_>, Vec<_>) = (0..CHANNELS).map(|_| channel::<()>()).unzip();
    let mut processes = Vec::new();
    for (number, started) in started.into_iter().enumerate() {
        let (idle, input) = (idle.clone(), input.clone());
        let spec = ProcessSpec::new("chooses").level(1 + number as u8);
        processes.push(executor.spawn(spec, move || async move {
            started.recv().await.unwrap();
            let received = alt! { x = idle.recv() => x, x = input.recv() => x };
            assert_eq!(received, Ok(CHANNELS - 1 - number));
        }));
    }
    processes.push(
        executor.spawn(ProcessSpec::new("sends").level(0), move || async move {
            for _ in 0..WARM {
                assert!(to_idle.try_send(0).is_err() && output.try_send(0).is_err());
            }
            for start in starts {
                start.send(()).await.unwrap();
            }
            for number in 0..CHANNELS {
                output.send(number).await.unwrap();
            }
        }),
    );
    executor.release();
    for process in processes {
        assert_eq!(process.wait(), Exit::Completed);
    }
}

/// The last guard alone is ready, so `skip` is not chosen.
#[test]
fn skip_looks_at_all_guards_on_the_fast_path() {
    let executor = Executor::start(Attributes::new("home")).unwrap();
    let (_idle, first) = channel::<u32>();
    let (output, second) = channel::<u32>();
    let sender = executor.spawn(ProcessSpec::new("sends"), move || async move {
        while output.send(7).await.is_ok() {}
    });
    let server = executor.spawn(ProcessSpec::new("chooses"), move || async move {
        for _ in 0..WARM {
            yield_now().await;
            assert!(first.try_recv().is_err());
            let fair = alt! { x = first.recv() => x, x = second.recv() => x, skip => Ok(0) };
            yield_now().await;
            let ordered = pri_alt! { x = first.recv() => x, x = second.recv() => x, skip => Ok(0) };
            assert_eq!((fair, ordered), (Ok(7), Ok(7)));
        }
    });
    executor.release();
    assert_eq!(server.wait(), Exit::Completed);
    assert_eq!(sender.wait(), Exit::Completed);
}

/// All senders wait before each selection.
#[test]
fn a_registered_alternative_takes_the_channels_in_turn_on_the_fast_path() {
    let executor = Executor::start(Attributes::new("home")).unwrap();
    let (outputs, inputs): (Vec<_>, Vec<_>) = (0..CHANNELS).map(|_| channel::<()>()).unzip();
    let senders: Vec<_> = (outputs.into_iter())
        .map(|output| {
            executor.spawn(ProcessSpec::new("sends"), move || async move {
                while output.send(()).await.is_ok() {}
            })
        })
        .collect();
    let server = executor.spawn(ProcessSpec::new("chooses"), move || async move {
        let mut registered = Alternative::fair(&inputs);
        for round in 0..3 * WARM as usize {
            yield_now().await;
            assert_eq!(registered.recv().await, (round % CHANNELS, Ok(())));
        }
    });
    executor.release();
    assert_eq!(server.wait(), Exit::Completed);
    for sender in senders {
        assert_eq!(sender.wait(), Exit::Completed);
    }
}

/// All senders wait before each choice, so the fair alternative takes their channels in turn. A
/// choice by priority in between does not count.
#[test]
fn the_least_recently_chosen_end_is_taken_on_the_fast_path() {
    let executor = Executor::start(Attributes::new("home")).unwrap();
    let (outputs, inputs): (Vec<_>, Vec<_>) = (0..CHANNELS).map(|_| channel::<usize>()).unzip();
    let senders: Vec<_> = (outputs.into_iter().enumerate())
        .map(|(from, output)| {
            executor.spawn(ProcessSpec::new("sends"), move || async move {
                while output.send(from).await.is_ok() {}
            })
        })
        .collect();
    let server = executor.spawn(ProcessSpec::new("chooses"), move || async move {
        let [a, b, c] = &inputs[..] else {
            unreachable!()
        };
        for round in 0..3 * WARM as usize {
            yield_now().await;
            let fair = alt! { x = a.recv() => x, x = b.recv() => x, x = c.recv() => x };
            assert_eq!(fair, Ok(round % CHANNELS));
            yield_now().await;
            let first = pri_alt! { x = c.recv() => x, x = a.recv() => x, x = b.recv() => x };
            assert_eq!(first, Ok(CHANNELS - 1));
        }
    });
    executor.release();
    assert_eq!(server.wait(), Exit::Completed);
    for sender in senders {
        assert_eq!(sender.wait(), Exit::Completed);
    }
}
