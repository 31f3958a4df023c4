//! Fair alternatives: of the ready ends the least recently chosen is taken. Exact sequences.

#![cfg(not(loom))]

use crate::common;
use common::{Watchdog, pending, ready};
use futures_lite::future::block_on;
use luna_channels::{Buffer, Receiver, Sender, alt, buffered, channel, pri_alt};
use std::thread;

/// Chooses among three, those that are `open`; says which.
async fn choose(from: &[Receiver<u32>; 3], open: [bool; 3]) -> usize {
    alt! {
        value = from[0].recv(), if open[0] => { value.unwrap(); 0 }
        value = from[1].recv(), if open[1] => { value.unwrap(); 1 }
        value = from[2].recv(), if open[2] => { value.unwrap(); 2 }
    }
}

/// Three channels on which something is always ready.
fn full() -> ([Sender<u32>; 3], [Receiver<u32>; 3]) {
    let [(s0, r0), (s1, r1), (s2, r2)] = [(); 3].map(|()| buffered(Buffer::allocating_unbounded()));
    for sender in [&s0, &s1, &s2] {
        (0..100).for_each(|n| sender.try_send(n).unwrap());
    }
    ([s0, s1, s2], [r0, r1, r2])
}

#[test]
fn all_ready_each_gets_its_turn() {
    let (_senders, from) = full();
    let order: Vec<_> = (0..9).map(|_| block_on(choose(&from, [true; 3]))).collect();
    assert_eq!(order, [0, 1, 2, 0, 1, 2, 0, 1, 2]);
}

#[test]
fn preconditions_that_switch_on_and_off() {
    let (_senders, from) = full();
    let all = [true; 3];
    let mut order = Vec::new();
    for open in [
        all,
        [false, true, true],
        [true, true, false],
        all,
        [true, false, true],
        all,
        [false, false, true],
        all,
        all,
    ] {
        order.push(block_on(choose(&from, open)));
    }
    // By hand: each time the open one that was chosen longest ago.
    assert_eq!(order, [0, 1, 0, 2, 0, 1, 2, 0, 1]);
}

#[test]
fn one_that_becomes_ready_late_comes_next() {
    let [(s0, r0), (s1, r1), (s2, r2)] = [(); 3].map(|()| buffered(Buffer::fifo(10)));
    let from = [r0, r1, r2];
    for sender in [&s0, &s1] {
        (0..5).for_each(|n| sender.try_send(n).unwrap());
    }
    let mut order: Vec<_> = (0..4).map(|_| block_on(choose(&from, [true; 3]))).collect();
    s2.try_send(0).unwrap();
    s2.try_send(1).unwrap();
    order.extend((0..4).map(|_| block_on(choose(&from, [true; 3]))));
    assert_eq!(order, [0, 1, 0, 1, 2, 0, 1, 2]);
}

#[test]
fn what_was_chosen_while_it_waited_counts_too() {
    let [(s0, r0), (s1, r1), (s2, r2)] = [channel(), channel(), channel()];
    let from = [r0, r1, r2];
    let mut waits = Box::pin(choose(&from, [true; 3]));
    pending(&mut waits);
    s0.try_send(0).unwrap();
    assert_eq!(ready(&mut waits), 0);
    let mut sends = [&s0, &s1, &s2].map(|sender| Box::pin(sender.send(1)));
    sends.iter_mut().for_each(pending);
    let order: Vec<_> = (0..3).map(|_| block_on(choose(&from, [true; 3]))).collect();
    assert_eq!(order, [1, 2, 0]);
}

#[test]
#[cfg_attr(luna_one_cpu, ignore = "needs threads")]
fn ends_keep_their_turn_as_they_move_between_threads() {
    let (senders, from) = full();
    let mut ends = (senders, from);
    let mut order = Vec::new();
    for _ in 0..7 {
        // A new thread each time, with a count of its own that starts anew.
        (ends, order) = thread::spawn(move || {
            order.push(block_on(choose(&ends.1, [true; 3])));
            (ends, order)
        })
        .join()
        .unwrap();
    }
    assert_eq!(order, [0, 1, 2, 0, 1, 2, 0]);
}

#[test]
#[cfg_attr(luna_one_cpu, ignore = "needs threads")]
fn no_open_end_that_is_ready_is_passed_over_by_another_twice() {
    // In any thread, and whatever preconditions say: an alternative that passes it over bears the
    // greater stamp from then on.
    let (senders, from) = full();
    let mut ends = (senders, from);
    let mut chosen_before = [0_usize; 3];
    let mut random = common::Random::seeded();
    for step in 0..150 {
        let open = [0, 1, 2].map(|_| random.below(3) > 0);
        if !open.contains(&true) {
            continue;
        }
        let chosen;
        (ends, chosen) = thread::spawn(move || {
            let chosen = block_on(choose(&ends.1, open));
            (ends, chosen)
        })
        .join()
        .unwrap();
        for n in 0..3 {
            if n == chosen {
                chosen_before[n] = 0;
            } else if open[n] {
                chosen_before[n] += 1;
            }
        }
        assert!(chosen_before.iter().all(|&n| n <= 2), "step {step}");
    }
}

#[test]
fn outputs_and_inputs_take_turns() {
    let ((to, _held), (filled, from)) = (
        buffered(Buffer::overwrite_oldest(1)),
        buffered(Buffer::fifo(10)),
    );
    (0..5).for_each(|n| filled.try_send(n).unwrap());
    let order: String = (0..6)
        .map(|n| {
            block_on(async {
                alt! {
                    sent = to.send(n) => { sent.unwrap(); 's' }
                    value = from.recv() => { value.unwrap(); 'r' }
                }
            })
        })
        .collect();
    assert_eq!(order, "srsrsr");
}

#[test]
fn an_ended_channel_takes_its_turn_and_no_more() {
    let ((ended, from_ended), (full, from_full)) = (channel::<u8>(), buffered(Buffer::fifo(10)));
    drop(ended);
    (0..5).for_each(|n| full.try_send(n).unwrap());
    let order: Vec<_> = (0..6)
        .map(|_| {
            block_on(async {
                alt! {
                    value = from_ended.recv() => value.is_err(),
                    value = from_full.recv() => { value.unwrap(); false }
                }
            })
        })
        .collect();
    assert_eq!(order, [true, false, true, false, true, false]);
}

#[test]
fn a_pri_alt_goes_by_the_order_written_and_counts_for_nobody() {
    let (_senders, from) = full();
    for _ in 0..5 {
        let first = block_on(async {
            pri_alt! {
                value = from[2].recv() => value.map(|_| 2),
                value = from[0].recv() => value.map(|_| 0),
            }
        });
        assert_eq!(first, Ok(2));
    }
    let order: Vec<_> = (0..3).map(|_| block_on(choose(&from, [true; 3]))).collect();
    assert_eq!(order, [0, 1, 2]);
}

#[test]
fn clones_of_an_end_have_turns_of_their_own() {
    let (sender, receiver) = buffered(Buffer::fifo(10));
    (0..4).for_each(|n| sender.try_send(n).unwrap());
    let other = receiver.clone();
    let order: Vec<_> = (0..4)
        .map(|_| {
            block_on(async {
                alt! {
                    value = receiver.recv() => { value.unwrap(); 1 }
                    value = other.recv() => { value.unwrap(); 2 }
                }
            })
        })
        .collect();
    assert_eq!(order, [1, 2, 1, 2]);
    // Also while they wait, when a partner makes both ready at once.
    let (sender, receiver) = channel();
    let other = receiver.clone();
    let mut order = Vec::new();
    for n in 0..4 {
        let mut waits = Box::pin(async {
            alt! {
                value = receiver.recv() => (1, value),
                value = other.recv() => (2, value),
            }
        });
        pending(&mut waits);
        sender.try_send(n).unwrap();
        let (end, value) = ready(&mut waits);
        assert_eq!(value, Ok(n));
        order.push(end);
    }
    assert_eq!(order, [1, 2, 1, 2]);
}

#[test]
#[cfg_attr(luna_one_cpu, ignore = "needs threads")]
fn under_load_from_threads_every_sender_is_served() {
    let _watchdog = Watchdog::new();
    let [(s0, r0), (s1, r1), (s2, r2)] = [channel(), channel(), channel()];
    let from = [r0, r1, r2];
    thread::scope(|scope| {
        for sender in [s0, s1, s2] {
            scope.spawn(move || while sender.blocking_send(0).is_ok() {});
        }
        let mut served = [0; 3];
        while served.iter().any(|&n| n < 100) {
            served[block_on(choose(&from, [true; 3]))] += 1;
        }
        drop(from);
    });
}
