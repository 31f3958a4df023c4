//! Blocking a thread until it is woken, and until a future is done.

use crate::clock::Instant;
use crate::current;
use crate::futex::{Futex, Waited};
use std::future::Future;
use std::pin::{Pin, pin};
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::task::{Context, Poll, Wake, Waker};

const EMPTY: u32 = 0;
const PARKED: u32 = 1;
const NOTIFIED: u32 = 2;

/// Lets one thread sleep until others wake it. A wake that comes first is kept. Real-time path: yes; a system call only to sleep,
/// and to wake a thread that does.
///
/// ```
/// use luna_platform::clock::Instant;
/// use luna_platform::park::Parker;
///
/// let parker = Parker::new();
/// parker.unpark();
/// assert!(parker.park(Instant::NEVER)); // at once: the wake came first
/// assert!(!parker.park(Instant::now())); // the deadline came
/// ```
#[derive(Debug)]
pub struct Parker {
    state: Futex,
}

impl Parker {
    /// A parker that nobody has woken.
    #[expect(clippy::new_without_default, reason = "belongs to one thread: made on purpose, not by default")]
    pub fn new() -> Self {
        Self { state: Futex::new(EMPTY) }
    }

    /// Sleeps until a wake, which it takes, or until `deadline`; says whether it was woken. Called by one thread alone.
    pub fn park(&self, deadline: Instant) -> bool {
        let word = self.state.word();
        if word.compare_exchange(EMPTY, PARKED, Ordering::Acquire, Ordering::Acquire).is_err() {
            // Notified before.
            word.store(EMPTY, Ordering::Relaxed);
            std::sync::atomic::fence(Ordering::Acquire);
            return true;
        }
        loop {
            let waited = self.state.wait(PARKED, deadline);
            if word.compare_exchange(NOTIFIED, EMPTY, Ordering::Acquire, Ordering::Relaxed).is_ok() {
                return true;
            }
            if waited == Waited::TimedOut {
                return word.swap(EMPTY, Ordering::Acquire) == NOTIFIED;
            }
        }
    }

    /// Wakes the thread, or lets its next `park` return at once. From any thread.
    #[inline]
    pub fn unpark(&self) {
        if self.state.word().swap(NOTIFIED, Ordering::Release) == PARKED {
            self.state.wake_one();
        }
    }
}

impl Wake for Parker {
    fn wake(self: Arc<Self>) {
        self.unpark();
    }

    fn wake_by_ref(self: &Arc<Self>) {
        self.unpark();
    }
}

/// Blocks this thread until `future` is done.
///
/// # Panics
///
/// On the thread of an executor, where it would stop all its processes: await there.
///
/// ```
/// assert_eq!(luna_platform::park::block_on(async { 1 + 1 }), 2);
/// ```
#[track_caller]
pub fn block_on<F: Future>(future: F) -> F::Output {
    match block_on_until(pin!(future), Instant::NEVER) {
        Some(output) => output,
        None => unreachable!("a wait without a deadline does not time out"),
    }
}

/// Blocks this thread until `future` is done or `deadline` has come. At the deadline the future is polled once more, so that
/// what it says is exact. Panics as [`block_on`] does.
#[track_caller]
pub fn block_on_until<F: Future>(mut future: Pin<&mut F>, deadline: Instant) -> Option<F::Output> {
    assert!(
        current::may_block(),
        "a blocking call inside a process of an executor would stop the whole executor: await the operation instead, or run the \
         process on an OS thread of its own"
    );
    thread_local! {
        // A thread blocks in one call at a time; nested calls (a poll that blocks) make a parker of their own.
        static PARKER: std::cell::Cell<Option<Arc<Parker>>> = const { std::cell::Cell::new(None) };
    }
    let parker = PARKER.take().unwrap_or_else(|| Arc::new(Parker::new()));
    let waker = Waker::from(parker.clone());
    let mut cx = Context::from_waker(&waker);
    let output = loop {
        if let Poll::Ready(output) = future.as_mut().poll(&mut cx) {
            break Some(output);
        }
        if !parker.park(deadline) {
            break match future.as_mut().poll(&mut cx) {
                Poll::Ready(output) => Some(output),
                Poll::Pending => None,
            };
        }
    };
    PARKER.set(Some(parker));
    output
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_wake_from_another_thread_ends_the_wait() {
        let parker = Arc::new(Parker::new());
        let other = parker.clone();
        let thread = std::thread::spawn(move || other.unpark());
        assert!(parker.park(Instant::NEVER));
        thread.join().unwrap();
    }

    #[test]
    fn block_on_until_gives_up_at_the_deadline() {
        assert_eq!(block_on_until(pin!(std::future::pending::<()>()), Instant::now()), None);
        assert_eq!(block_on_until(pin!(std::future::ready(7)), Instant::now()), Some(7));
    }
}
