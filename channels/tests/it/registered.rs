//! `Alternative`: order, fairness, adding and removing, ends of channels, cancelling, and all of it
//! across threads.

#![cfg(not(loom))]

use futures_lite::future::{block_on, poll_once};
use luna_channels::{Alternative, Buffer, Receiver, RecvError, Sender, alt, buffered, channel};
use luna_core::{Executor, Exit, ProcessSpec};
use luna_platform::thread::Attributes;
use std::pin::pin;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

fn ends<T: Send>(count: usize) -> (Vec<Sender<T>>, Vec<Receiver<T>>) {
    (0..count).map(|_| channel()).unzip()
}

fn stores<T: Send>(count: usize) -> (Vec<Sender<T>>, Vec<Receiver<T>>) {
    (0..count).map(|_| buffered(Buffer::fifo(8))).unzip()
}

fn recv<T: Send>(alternative: &mut Alternative<'_, T>) -> (usize, Result<T, RecvError>) {
    block_on(poll_once(alternative.recv())).expect("a channel is ready")
}

fn waits<T: Send>(alternative: &mut Alternative<'_, T>) -> bool {
    block_on(poll_once(alternative.recv())).is_none()
}

#[test]
fn fair_takes_the_least_recently_chosen_of_the_ready() {
    let (senders, receivers) = stores(3);
    let mut inputs = Alternative::fair(&receivers);
    assert!(waits(&mut inputs));
    for sender in &senders {
        (0..3).for_each(|value| sender.try_send(value).unwrap());
    }
    let order: Vec<usize> = (0..9).map(|_| recv(&mut inputs).0).collect();
    assert_eq!(order, [0, 1, 2, 0, 1, 2, 0, 1, 2]);
    // 2 was chosen last, 0 least recently; the order of becoming ready does not matter.
    for index in [2, 1, 0] {
        senders[index].try_send(9).unwrap();
    }
    assert_eq!([0, 1, 2].map(|_| recv(&mut inputs).0), [0, 1, 2]);
    senders[0].try_send(0).unwrap();
    assert_eq!(recv(&mut inputs), (0, Ok(0)));
    for index in [0, 1, 2] {
        senders[index].try_send(9).unwrap();
    }
    assert_eq!([0, 1, 2].map(|_| recv(&mut inputs).0), [1, 2, 0]);
    assert!(waits(&mut inputs));
}

#[test]
fn prioritized_takes_the_first_of_the_ready() {
    let (senders, receivers) = stores(3);
    let mut inputs = Alternative::prioritized(&receivers);
    for sender in senders.iter().rev() {
        (0..2).for_each(|value| sender.try_send(value).unwrap());
    }
    let order: Vec<usize> = (0..6).map(|_| recv(&mut inputs).0).collect();
    assert_eq!(order, [0, 0, 1, 1, 2, 2]);
}

#[test]
fn a_sender_finds_it_while_it_waits_and_waits_while_it_does_not() {
    let (senders, receivers) = ends::<u32>(2);
    let mut inputs = Alternative::fair(&receivers);
    {
        let mut waiting = pin!(inputs.recv());
        assert!(block_on(poll_once(waiting.as_mut())).is_none());
        assert!(senders[1].try_send(1).is_ok(), "it waits as any receiver");
        assert!(senders[0].try_send(0).is_err(), "it has one");
        assert_eq!(block_on(waiting), (1, Ok(1)));
    }
    assert!(senders[1].try_send(1).is_err());
    let mut send = pin!(senders[0].send(7));
    assert!(block_on(poll_once(send.as_mut())).is_none());
    assert_eq!(recv(&mut inputs), (0, Ok(7)));
    assert_eq!(block_on(send), Ok(()));
    // One that others have emptied meanwhile is not ready after all.
    let mut send = pin!(senders[0].send(8));
    assert!(block_on(poll_once(send.as_mut())).is_none());
    assert_eq!(receivers[0].try_recv(), Ok(8));
    assert!(waits(&mut inputs));
}

#[test]
fn what_was_received_by_a_future_that_is_dropped_comes_next() {
    let (senders, receivers) = ends::<u32>(2);
    let mut inputs = Alternative::fair(&receivers);
    {
        let mut dropped = pin!(inputs.recv());
        assert!(block_on(poll_once(dropped.as_mut())).is_none());
        senders[0].try_send(5).unwrap();
    }
    assert!(senders[1].try_send(1).is_err());
    assert_eq!(recv(&mut inputs), (0, Ok(5)));
    {
        let mut dropped = pin!(inputs.recv());
        assert!(block_on(poll_once(dropped.as_mut())).is_none());
        senders[0].try_send(6).unwrap();
    }
    // With the alternative it goes back to its channel.
    drop(inputs);
    assert_eq!(receivers[0].try_recv(), Ok(6));
    let mut inputs = Alternative::fair(&receivers);
    {
        let mut dropped = pin!(inputs.recv());
        assert!(block_on(poll_once(dropped.as_mut())).is_none());
        senders[1].try_send(7).unwrap();
    }
    assert!(inputs.remove(1));
    assert!(waits(&mut inputs));
    assert_eq!(receivers[1].try_recv(), Ok(7));
}

#[test]
fn an_ended_channel_says_so_once_and_again_when_all_have() {
    for is_fair in [true, false] {
        let (mut senders, receivers) = ends::<u32>(3);
        let mut inputs = match is_fair {
            true => Alternative::fair(&receivers),
            false => Alternative::prioritized(&receivers),
        };
        assert!(waits(&mut inputs));
        senders[1].poison();
        assert_eq!(recv(&mut inputs), (1, Err(RecvError::Poisoned)));
        assert!(waits(&mut inputs));
        drop(senders.remove(0));
        assert_eq!(recv(&mut inputs), (0, Err(RecvError::Closed)));
        assert_eq!(inputs.len(), 3);
        {
            // What is left works as before, also where the sender claims the one that waits.
            let mut waiting = pin!(inputs.recv());
            assert!(block_on(poll_once(waiting.as_mut())).is_none());
            senders[1].try_send(7).unwrap();
            assert_eq!(block_on(waiting), (2, Ok(7)));
        }
        {
            let mut waiting = pin!(inputs.recv());
            assert!(block_on(poll_once(waiting.as_mut())).is_none());
            senders[1].poison();
            assert_eq!(block_on(waiting), (2, Err(RecvError::Poisoned)));
        }
        let ends = [
            Err(RecvError::Closed),
            Err(RecvError::Poisoned),
            Err(RecvError::Poisoned),
        ];
        // The least recently chosen, or the first.
        let order = match is_fair {
            true => [1, 0, 2, 1, 0, 2],
            false => [0; 6],
        };
        for index in order {
            assert_eq!(recv(&mut inputs), (index, ends[index]));
        }
    }
}

#[test]
fn ended_channels_are_removed_and_others_come() {
    let (mut senders, receivers) = stores::<u32>(4);
    let last = senders.pop().unwrap();
    let mut inputs = Alternative::prioritized(&receivers[..3]);
    drop(senders);
    for index in 0..3 {
        assert_eq!(recv(&mut inputs), (index, Err(RecvError::Closed)));
    }
    assert_eq!(recv(&mut inputs), (0, Err(RecvError::Closed)));
    // All have said so: now one that has not is waited for alone.
    assert_eq!(inputs.add(&receivers[3]), 3);
    assert!(waits(&mut inputs));
    last.try_send(5).unwrap();
    assert_eq!(recv(&mut inputs), (3, Ok(5)));
    assert!(inputs.remove(0) && waits(&mut inputs));
    // Without it, all have ended again.
    assert!(inputs.remove(3));
    assert_eq!(recv(&mut inputs), (1, Err(RecvError::Closed)));
    // One that comes back is new here.
    assert!(inputs.remove(1) && inputs.remove(2) && inputs.is_empty());
    assert!(waits(&mut inputs));
    let again = inputs.add(&receivers[0]);
    let open = inputs.add(&receivers[3]);
    assert_eq!(recv(&mut inputs), (again, Err(RecvError::Closed)));
    assert!(waits(&mut inputs));
    assert!(inputs.remove(open));
    assert_eq!(recv(&mut inputs), (again, Err(RecvError::Closed)));
}

#[test]
fn channels_are_added_and_removed_while_it_lives() {
    let (senders, receivers) = stores::<usize>(200);
    let mut inputs = Alternative::prioritized(&receivers[..1]);
    assert!(waits(&mut inputs));
    for (index, receiver) in receivers.iter().enumerate().skip(1) {
        senders[index].try_send(index).unwrap();
        assert_eq!(inputs.add(receiver), index);
    }
    for index in 1..100 {
        assert_eq!(recv(&mut inputs), (index, Ok(index)));
        assert!(inputs.remove(index));
    }
    assert!(inputs.remove(150) && !inputs.remove(150) && !inputs.remove(7777));
    assert_eq!(recv(&mut inputs), (100, Ok(100)));
    // A freed index is used again, and comes last by priority.
    assert_eq!(inputs.add(&receivers[1]), 1);
    senders[1].try_send(0).unwrap();
    senders[199].try_send(0).unwrap();
    let order: Vec<usize> = std::iter::from_fn(|| block_on(poll_once(inputs.recv())))
        .map(|(index, _)| index)
        .collect();
    assert_eq!(order.last(), Some(&1));
    assert_eq!(order.len(), 99 - 1 + 1 + 1);
}

#[test]
fn an_alternative_that_sends_meets_one_that_receives() {
    let (senders, receivers) = ends::<u32>(2);
    let mut inputs = Alternative::fair(&receivers);
    let offer = async || {
        alt! {
            sent = senders[0].send(0) => { sent.unwrap(); 0 }
            sent = senders[1].send(1) => { sent.unwrap(); 1 }
        }
    };
    // The sender waits.
    let mut waiting = pin!(offer());
    assert!(block_on(poll_once(waiting.as_mut())).is_none());
    let (index, value) = recv(&mut inputs);
    assert_eq!(value, Ok(index as u32));
    assert_eq!(block_on(waiting), index);
    assert!(waits(&mut inputs), "its other offer is gone");
    // The receiver waits.
    let mut receiving = pin!(inputs.recv());
    assert!(block_on(poll_once(receiving.as_mut())).is_none());
    let chosen = block_on(offer());
    assert_eq!(block_on(receiving), (chosen, Ok(chosen as u32)));
}

#[test]
fn two_alternatives_share_their_channels() {
    let (senders, receivers) = ends::<u32>(2);
    let (mut one, mut other) = (Alternative::fair(&receivers), Alternative::fair(&receivers));
    assert!(waits(&mut one) && waits(&mut other));
    let mut send = pin!(senders[1].send(3));
    assert!(block_on(poll_once(send.as_mut())).is_none());
    assert_eq!(recv(&mut other), (1, Ok(3)));
    assert!(waits(&mut one));
    let mut receiving = pin!(one.recv());
    assert!(block_on(poll_once(receiving.as_mut())).is_none());
    assert!(senders[0].try_send(4).is_ok());
    assert_eq!(block_on(receiving), (0, Ok(4)));
}

#[test]
fn without_channels_it_waits() {
    assert!(waits::<u8>(&mut Alternative::fair(&[])));
}

/// Every value once, and those of one sender in order: from executors and threads, to two
/// alternatives that share all channels.
#[test]
fn many_to_two_across_executors_and_threads() {
    const CHANNELS: usize = 6;
    const EACH: u64 = 3_000;
    let (senders, receivers) = ends::<u64>(CHANNELS);
    let sum = Arc::new(AtomicU64::new(0));
    let executors = ["left", "right"].map(|name| Executor::start(Attributes::new(name)).unwrap());
    let mut processes = Vec::new();
    for (index, executor) in executors.iter().enumerate() {
        let (receivers, sum) = (receivers.clone(), sum.clone());
        processes.push(
            executor.spawn(ProcessSpec::new("server"), move || async move {
                let mut inputs = if index == 0 {
                    Alternative::fair(&receivers)
                } else {
                    Alternative::prioritized(&receivers)
                };
                let mut last = [0; CHANNELS];
                while !inputs.is_empty() {
                    match inputs.recv().await {
                        (index, Ok(value)) => {
                            assert!(value > last[index]);
                            last[index] = value;
                            sum.fetch_add(value, Ordering::Relaxed);
                        }
                        (index, Err(_)) => assert!(inputs.remove(index)),
                    }
                }
            }),
        );
        executor.release();
    }
    drop(receivers);
    let threads: Vec<_> = senders
        .into_iter()
        .map(|sender| {
            std::thread::spawn(move || {
                for value in 1..=EACH {
                    sender.blocking_send(value).unwrap();
                }
            })
        })
        .collect();
    for thread in threads {
        thread.join().unwrap();
    }
    for process in processes {
        assert_eq!(process.wait(), Exit::Completed);
    }
    assert_eq!(
        sum.load(Ordering::Relaxed),
        CHANNELS as u64 * EACH * (EACH + 1) / 2
    );
}
