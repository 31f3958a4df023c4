//! Where counting begins and ends: laps of an operation, with a mark between them.

use std::pin::pin;
use std::task::{Context, Poll, Waker};

/// The name of the function before which callgrind writes down what it has counted so far, and begins anew.
pub(crate) const MARK: &str = "luna_instructions_mark";

/// Does what a client request of Valgrind would, without the headers that one needs to be built.
#[inline(never)]
#[unsafe(no_mangle)]
extern "C" fn luna_instructions_mark() {
    std::hint::black_box(());
}

/// The parts of callgrind's output that hold the two laps of which the difference is taken. The first ends where the warm-up begins.
pub(crate) const SHORT_LAP: u32 = 3;
/// As long as the short one and `count` operations more.
pub(crate) const LONG_LAP: u32 = 4;

/// Does `operation`, which is told its number, for three laps: one of `count` to warm up, one of `count`, one of twice as many.
///
/// What the third costs beyond the second is `count` operations and nothing else: neither what was set up nor what a lap costs by itself.
pub(crate) async fn laps(count: u64, mut operation: impl AsyncFnMut(u64)) {
    let mut number = 0;
    for length in [count, count, 2 * count] {
        luna_instructions_mark();
        for _ in 0..length {
            operation(number).await;
            number += 1;
        }
    }
    luna_instructions_mark();
}

/// The laps of an operation that never waits, on this thread.
///
/// # Panics
///
/// When it waits.
pub(crate) fn laps_here(count: u64, mut operation: impl FnMut(u64)) {
    let all = pin!(laps(count, async |number| operation(number)));
    let outcome = all.poll(&mut Context::from_waker(Waker::noop()));
    assert_eq!(outcome, Poll::Ready(()), "the operation waited");
}
