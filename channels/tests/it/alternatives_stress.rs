//! Alternatives against alternatives, plain operations, and cancellation, on two executors and
//! plain threads: every value once.

#![cfg(not(loom))]

use luna_channels::{Receiver, Sender, alt, channel, pri_alt};
use luna_core::{Executor, Exit, ProcessSpec};
use luna_platform::thread::Attributes;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

const MESSAGES: u64 = 5_000;

/// Exchanges with a partner that does the same: in each round one of them sends and the other
/// receives.
async fn exchange(to: Sender<u64>, from: Receiver<u64>, fair: bool, sums: Arc<[AtomicU64; 2]>) {
    let mut next = 1;
    let (mut sent, mut received) = (0, 0);
    loop {
        let over = if fair {
            alt! {
                value = from.recv() => match value { Ok(value) => { received += value; false } Err(_) => true },
                outcome = to.send(next), if next <= MESSAGES => match outcome { Ok(()) => { sent += next; next += 1; next > MESSAGES } Err(_) => true },
            }
        } else {
            pri_alt! {
                outcome = to.send(next), if next <= MESSAGES => match outcome { Ok(()) => { sent += next; next += 1; next > MESSAGES } Err(_) => true },
                value = from.recv() => match value { Ok(value) => { received += value; false } Err(_) => true },
            }
        };
        if over {
            break;
        }
    }
    // What the partner still offers is received, or it sees that this side is gone.
    sums[0].fetch_add(sent, Ordering::Relaxed);
    sums[1].fetch_add(received, Ordering::Relaxed);
}

/// Invariant 6: two processes with opposite alternatives make progress; and nothing is lost or
/// doubled on the way.
#[test]
fn opposite_alternatives_on_two_executors_make_progress() {
    for (left_fair, right_fair) in [(true, true), (true, false), (false, false)] {
        let sums = Arc::new([AtomicU64::new(0), AtomicU64::new(0)]);
        let (to_right, from_left) = channel();
        let (to_left, from_right) = channel();
        let executors =
            ["left", "right"].map(|name| Executor::start(Attributes::new(name)).unwrap());
        let left = {
            let sums = sums.clone();
            executors[0].spawn(ProcessSpec::new("left"), move || {
                exchange(to_right, from_right, left_fair, sums)
            })
        };
        let right = {
            let sums = sums.clone();
            executors[1].spawn(ProcessSpec::new("right"), move || {
                exchange(to_left, from_left, right_fair, sums)
            })
        };
        for executor in &executors {
            executor.release();
        }
        assert_eq!(left.wait(), Exit::Completed);
        assert_eq!(right.wait(), Exit::Completed);
        assert_eq!(
            sums[0].load(Ordering::Relaxed),
            sums[1].load(Ordering::Relaxed)
        );
    }
}
