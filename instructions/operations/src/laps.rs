//! Where counting begins and ends: laps of an operation, with a mark between them.

use std::pin::pin;
use std::task::{Context, Poll, Waker};

/// Before this, callgrind writes down what it has counted so far and begins anew: `luna-instructions` tells it the name.
///
/// It does what a client request of Valgrind would, without the headers that one needs to be built.
#[inline(never)]
#[unsafe(no_mangle)]
extern "C" fn luna_instructions_mark() {
    std::hint::black_box(());
}

/// Does `operation`, which is told its number, for three laps: one of `steps` to warm up, one of `steps`, one of twice as many.
///
/// What the third costs beyond the second is `steps` operations and nothing else: neither what was set up nor what a lap costs by itself.
pub(crate) async fn laps(steps: u64, mut operation: impl AsyncFnMut(u64)) {
    let mut number = 0;
    for length in [steps, steps, 2 * steps] {
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
pub(crate) fn laps_here(steps: u64, mut operation: impl FnMut(u64)) {
    let all = pin!(laps(steps, async |number| operation(number)));
    let outcome = all.poll(&mut Context::from_waker(Waker::noop()));
    assert_eq!(outcome, Poll::Ready(()), "the operation waited");
}
