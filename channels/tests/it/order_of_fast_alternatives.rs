//! Alternatives with all partners on their own executor: which one is served, and when.

#![cfg(not(loom))]

use futures_lite::future::poll_once;
use luna_channels::{Alternative, alt, channel, pri_alt};
use luna_core::{Executor, Exit, ProcessSpec, yield_now};
use luna_platform::thread::Attributes;

/// So many that all locks are biased to the executor.
const WARM: u64 = 100;
const CHANNELS: usize = 3;

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

/// Each choice lets the more urgent sender run before it is over, and is dropped then. What it has
/// received is the next value of the channel.
#[test]
fn a_choice_that_is_dropped_when_it_gave_way_returns_its_value_on_the_fast_path() {
    let executor = Executor::start(Attributes::new("home")).unwrap();
    let (output, first) = channel::<u64>();
    let (_idle, second) = channel::<u64>();
    let sender = executor.spawn(ProcessSpec::new("sends").level(5), move || async move {
        for number in 0.. {
            if output.send(number).await.is_err() {
                break;
            }
        }
    });
    let server = executor.spawn(ProcessSpec::new("chooses").level(1), move || async move {
        let mut given_back = 0;
        for expected in 0..3 * WARM {
            let choice = poll_once(async {
                alt! { x = first.recv() => x, x = second.recv() => x }
            });
            let got = match choice.await {
                Some(got) => got,
                None => {
                    given_back += 1;
                    first.recv().await
                }
            };
            assert_eq!(got, Ok(expected));
        }
        assert!(given_back > WARM, "{given_back}");
    });
    executor.release();
    assert_eq!(server.wait(), Exit::Completed);
    assert_eq!(sender.wait(), Exit::Completed);
}
