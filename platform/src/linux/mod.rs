//! The complete backend: Linux, through `nix` where it has the call and `libc` where it has not.

mod alternate_stack;
pub mod boost;
mod deadline;
pub mod inside;
pub mod lock;
pub(crate) mod reactor;
pub(crate) mod thread;

pub(crate) mod clock {
    use crate::path::{self, Call};
    use nix::time::{ClockId, clock_gettime};
    use std::time::Duration;

    /// `CLOCK_MONOTONIC` in nanoseconds: the clock that futex deadlines, timerfd and cyclictest
    /// use.
    #[inline]
    pub(crate) fn monotonic_nanos() -> u64 {
        let mut now = libc::timespec {
            tv_sec: 0,
            tv_nsec: 0,
        };
        // SAFETY: `now` is a valid timespec to write to; CLOCK_MONOTONIC always exists, so the call
        // cannot fail.
        unsafe { libc::clock_gettime(libc::CLOCK_MONOTONIC, &mut now) };
        now.tv_sec as u64 * 1_000_000_000 + now.tv_nsec as u64
    }

    /// An instant as the kernel takes absolute deadlines.
    pub(crate) fn timespec(nanos: u64) -> libc::timespec {
        libc::timespec {
            tv_sec: (nanos / 1_000_000_000) as libc::time_t,
            tv_nsec: (nanos % 1_000_000_000) as libc::c_long,
        }
    }

    /// The time that the calling thread has run.
    pub(crate) fn processor_time() -> Option<Duration> {
        let time = || clock_gettime(ClockId::CLOCK_THREAD_CPUTIME_ID).ok();
        path::expected(Call::Account, time).map(Duration::from)
    }
}

pub mod fence {
    //! An asymmetric pair of fences, one of which costs nothing: `membarrier(2)`.

    use nix::errno::Errno;
    use std::sync::atomic::{AtomicU8, Ordering, compiler_fence};

    const REGISTER: libc::c_long = libc::MEMBARRIER_CMD_REGISTER_PRIVATE_EXPEDITED as libc::c_long;
    const EXPEDITED: libc::c_long = libc::MEMBARRIER_CMD_PRIVATE_EXPEDITED as libc::c_long;

    const GLOBAL: libc::c_long = libc::MEMBARRIER_CMD_GLOBAL as libc::c_long;

    const UNASKED: u8 = 0;
    const AVAILABLE: u8 = 1;
    const REFUSED: u8 = 2;
    static STATE: AtomicU8 = AtomicU8::new(UNASKED);

    /// Asks the kernel for the heavy fence, once for the program. Off the real-time path: the first
    /// call may take milliseconds.
    pub fn prepare() {
        if STATE.load(Ordering::Acquire) == UNASKED {
            let granted = call(REGISTER).and_then(|()| call(EXPEDITED)).is_ok();
            STATE.store(if granted { AVAILABLE } else { REFUSED }, Ordering::Release);
        }
    }

    /// Whether the heavy fence can be had.
    #[inline]
    pub fn is_available() -> bool {
        STATE.load(Ordering::Relaxed) == AVAILABLE
    }

    /// Orders what this thread does for a thread that calls [`heavy`]. No instruction.
    #[inline(always)]
    pub fn light() {
        compiler_fence(Ordering::SeqCst);
    }

    /// A full fence on this thread, and on each other running thread of the program. A system call.
    pub fn heavy() {
        let fenced = crate::path::expected(crate::path::Call::Fence, || match call(EXPEDITED) {
            // The kernel allocates a set of processors to interrupt on machines with very many. The
            // slow command needs no memory.
            Err(Errno::ENOMEM) => call(GLOBAL),
            fenced => fenced,
        });
        // What was granted once is not refused: the kernel keeps the registration with the address
        // space.
        if let Err(error) = fenced {
            panic!("the kernel refused a memory barrier that it had granted: {error}");
        }
    }

    fn call(command: libc::c_long) -> Result<(), Errno> {
        // SAFETY: the call takes no pointers.
        Errno::result(unsafe { libc::syscall(libc::SYS_membarrier, command, 0, 0) }).map(drop)
    }
}

pub(crate) mod futex {
    //! A word to wait on: one system call to sleep until an absolute deadline, one to wake.

    use super::clock::timespec;
    use crate::clock::Instant;
    use crate::futex::Waited;
    use nix::errno::Errno;
    use std::ptr;
    use std::sync::atomic::AtomicU32;

    /// A 32-bit word that threads can wait on.
    ///
    /// Change the word first, through [`word`](Self::word), then wake: a thread that is about to
    /// wait sees the change or the wake.
    #[derive(Debug)]
    #[repr(transparent)]
    pub struct Futex {
        word: AtomicU32,
    }

    impl Futex {
        /// A word that holds `value`.
        pub const fn new(value: u32) -> Self {
            Self {
                word: AtomicU32::new(value),
            }
        }

        /// The word itself.
        #[inline]
        pub fn word(&self) -> &AtomicU32 {
            &self.word
        }

        /// Waits while the word holds `expected`, at most until `deadline` ([`Instant::NEVER`]:
        /// without end).
        ///
        /// One system call. May end without a cause, so call it in a loop.
        pub fn wait(&self, expected: u32, deadline: Instant) -> Waited {
            let until = timespec(deadline.as_nanos());
            let until: *const libc::timespec = if deadline == Instant::NEVER {
                ptr::null()
            } else {
                &until
            };
            // SAFETY: the word outlives the call, `until` is null or points to a timespec on this
            // stack. FUTEX_WAIT_BITSET takes its deadline as absolute on CLOCK_MONOTONIC.
            let outcome = unsafe {
                libc::syscall(
                    libc::SYS_futex,
                    self.word.as_ptr(),
                    libc::FUTEX_WAIT_BITSET | libc::FUTEX_PRIVATE_FLAG,
                    expected,
                    until,
                    ptr::null::<u32>(),
                    libc::FUTEX_BITSET_MATCH_ANY,
                )
            };
            if outcome == -1 && Errno::last_raw() == libc::ETIMEDOUT {
                Waited::TimedOut
            } else {
                Waited::Woken
            }
        }

        /// Wakes one waiting thread: the one of highest priority. One system call.
        /// Async-signal-safe.
        pub fn wake_one(&self) {
            self.wake(1);
        }

        /// Wakes all waiting threads. One system call, O(threads). Async-signal-safe.
        pub fn wake_all(&self) {
            self.wake(i32::MAX);
        }

        fn wake(&self, threads: i32) {
            // SAFETY: FUTEX_WAKE only uses the address as a key.
            unsafe {
                libc::syscall(
                    libc::SYS_futex,
                    self.word.as_ptr(),
                    libc::FUTEX_WAKE | libc::FUTEX_PRIVATE_FLAG,
                    threads,
                );
            }
        }
    }
}
