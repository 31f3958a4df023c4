//! Alternatives with partners on their own executor, until a partner from another thread comes:
//! every value once, and in order.

#![cfg(not(loom))]

use futures_lite::future::poll_once;
use luna_channels::{
    Alternative, Buffer, Receiver, RecvError, Sender, alt, buffered, channel, pri_alt,
};
use luna_core::{Executor, Exit, ProcessSpec, yield_now};
use luna_platform::thread::Attributes;
use std::pin::Pin;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::task::{Context, Wake, Waker};

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

/// The alternative is notified of its channel once, and looks for the second sender itself. That
/// one lets the others run `pause` times before it sends.
fn receive_from_two_senders(pause: usize) {
    let executor = Executor::start(Attributes::new("home")).unwrap();
    let (sender, receiver) = channel::<u64>();
    let received = Arc::new(AtomicU64::new(0));
    let mut processes = Vec::new();
    for (name, pause) in [("first", 0), ("second", pause)] {
        let sender = sender.clone();
        processes.push(executor.spawn(ProcessSpec::new(name), move || async move {
            for number in 0..EACH {
                for _ in 0..pause {
                    yield_now().await;
                }
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
fn a_registered_alternative_receives_from_both_senders_that_wait_at_one_channel() {
    receive_from_two_senders(0);
}

/// The first one alone has waited on the fast path.
#[test]
fn a_registered_alternative_receives_from_a_sender_that_waits_behind_another() {
    receive_from_two_senders(4);
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

/// Notes that it was woken.
#[derive(Default)]
struct Woken(AtomicBool);

impl Wake for Woken {
    fn wake(self: Arc<Self>) {
        self.0.store(true, Ordering::Relaxed);
    }
}

/// A process waits in an alternative, then polls it with another waker, as a combinator does. That
/// waker is woken by a sender of the executor.
#[test]
fn an_alternative_that_was_polled_with_another_waker_is_met_on_the_fast_path() {
    for is_registered in [false, true] {
        let executor = Executor::start(Attributes::new("home")).unwrap();
        let (_idle, first) = channel::<u64>();
        let (output, second) = channel::<u64>();
        let server = executor.spawn(ProcessSpec::new("chooses"), move || async move {
            for _ in 0..WARM {
                assert!(first.try_recv().is_err() && second.try_recv().is_err());
            }
            let inputs = [first, second];
            let mut registered = Alternative::fair(&inputs);
            let mut waits: Pin<Box<dyn Future<Output = _>>> = match is_registered {
                true => Box::pin(async { registered.recv().await.1 }),
                false => Box::pin(async {
                    pri_alt! { x = inputs[0].recv() => x, x = inputs[1].recv() => x }
                }),
            };
            assert!(poll_once(waits.as_mut()).await.is_none());
            let woken = Arc::new(Woken::default());
            let waker = Waker::from(woken.clone());
            let polled = waits.as_mut().poll(&mut Context::from_waker(&waker));
            assert!(polled.is_pending());
            while !woken.0.load(Ordering::Relaxed) {
                yield_now().await;
            }
            assert_eq!(waits.await, Ok(7));
        });
        let client = executor.spawn(ProcessSpec::new("sends"), move || async move {
            output.send(7).await.unwrap();
        });
        executor.release();
        assert_eq!(server.wait(), Exit::Completed);
        assert_eq!(client.wait(), Exit::Completed);
    }
}
