//! Begin and end of counting: laps of an operation, with a mark between them.

use std::pin::pin;
use std::task::{Context, Waker};

/// Before this function, callgrind writes its counts and resets them: `luna-instructions` passes it
/// the name.
///
/// It replaces a client request of Valgrind, which would need Valgrind's headers to build.
#[inline(never)]
#[unsafe(no_mangle)]
extern "C" fn luna_instructions_mark() {
    std::hint::black_box(());
}

/// Runs `operation`, with its number as argument, for three laps: one of `steps` to warm up, one of
/// `steps`, one of twice as many.
///
/// The third costs exactly `steps` operations more than the second: set-up and the cost of a lap
/// cancel out. It never fails, as a process' body.
pub(crate) async fn laps(steps: u64, mut operation: impl AsyncFnMut(u64)) -> luna::Result<()> {
    let mut number = 0;
    for length in [steps, steps, 2 * steps] {
        luna_instructions_mark();
        for _ in 0..length {
            operation(number).await;
            number += 1;
        }
    }
    luna_instructions_mark();
    Ok(())
}

/// The laps of an operation that never waits, on this thread.
///
/// # Panics
///
/// When it waits.
pub(crate) fn laps_here(steps: u64, mut operation: impl FnMut(u64)) {
    let all = pin!(laps(steps, async |number| operation(number)));
    let outcome = all.poll(&mut Context::from_waker(Waker::noop()));
    assert!(outcome.is_ready(), "the operation waited");
}
