//! What means the prologue takes it.

use super::taken;
use crate::{Buffer, Receiver, Sender, buffered, channel, pri_alt};
use luna_core::{Executor, Exit, ProcessSpec};
use luna_platform::thread::Attributes;

/// So many operations until the lock is biased, with some to spare.
const SHARED: u64 = 64;
const VALUES: u64 = 1000;

/// Lets one process send to another one of its executor. All but the first operations are those
/// of the prologue.
fn is_taken<T, F>(
    (sender, receiver): (Sender<T>, Receiver<T>),
    value: fn(u64) -> T,
    recv: fn(Receiver<T>) -> F,
) where
    T: Send + 'static,
    F: Future<Output = ()> + Send + 'static,
{
    let executor = Executor::start(Attributes::new("own")).unwrap();
    let before = taken::count();
    let sends = executor.spawn(ProcessSpec::new("sends"), move || async move {
        for number in 0..VALUES {
            assert!(sender.send(value(number)).await.is_ok());
        }
    });
    let takes = executor.spawn(ProcessSpec::new("takes"), move || recv(receiver));
    executor.release();
    for process in [sends, takes] {
        assert_eq!(process.wait(), Exit::Completed);
    }
    // Other tests of this program may add to it.
    let taken = taken::count() - before;
    assert!(taken as u64 >= 2 * (VALUES - SHARED), "{taken}");
}

async fn take_all<T>(receiver: Receiver<T>) {
    while receiver.recv().await.is_ok() {}
}

#[test]
fn words_and_long_values_go_by_the_prologue() {
    is_taken(channel(), |number| number, take_all);
    is_taken(channel(), |number| [number; 4], take_all);
}

#[test]
fn buffered_values_go_by_the_prologue() {
    // Room for all: a sender that finds it full goes on under the lock.
    let room = || buffered(Buffer::fifo(VALUES as usize));
    is_taken(room(), |number| number as u8, take_all);
}

#[test]
fn guards_are_met_by_the_prologue() {
    let executor = Executor::start(Attributes::new("own")).unwrap();
    let ((sender, receiver), (_open, other)) = (channel::<u64>(), channel::<u64>());
    let before = taken::count();
    let sends = executor.spawn(ProcessSpec::new("sends"), move || async move {
        for number in 0..VALUES {
            assert!(sender.send(number).await.is_ok());
        }
    });
    let takes = executor.spawn(ProcessSpec::new("takes"), move || async move {
        for number in 0..VALUES {
            pri_alt! {
                got = receiver.recv() => assert_eq!(got, Ok(number)),
                _ = other.recv() => panic!("nothing is sent there"),
            }
        }
    });
    executor.release();
    for process in [sends, takes] {
        assert_eq!(process.wait(), Exit::Completed);
    }
    assert!((taken::count() - before) as u64 >= VALUES - SHARED);
}
