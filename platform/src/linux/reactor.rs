//! One epoll, with a timerfd for the deadline and an eventfd for other threads.
//!
//! Both are watched edge-triggered, so neither is ever read: arming a timer forgets what expired
//! before, and each write to an eventfd is an edge of its own, whatever it has counted to.

use super::timer_fd::TimerFd;
use crate::clock::Instant;
use crate::path::{self, Call};
use crate::reactor::{Ended, FIRST_RESERVED_TOKEN, Interest, ReactorError, Readiness};
use crate::timer_fd::TimerError;
use nix::errno::Errno;
use nix::sys::epoll::{Epoll, EpollCreateFlags, EpollEvent, EpollFlags, EpollTimeout};
use nix::sys::eventfd::{EfdFlags, EventFd};
use std::os::fd::{AsRawFd, BorrowedFd};
use std::sync::atomic::{AtomicU64, Ordering};

/// The eventfd's token.
const WAKE: u64 = FIRST_RESERVED_TOKEN;
/// The timerfd's token.
const TIMER: u64 = FIRST_RESERVED_TOKEN + 1;

/// How many events one call reports. Others are reported by the next.
const EVENTS: usize = 64;

/// Waits for files, for a deadline, and for [`wake`](Self::wake).
///
/// One thread waits; any thread may call the other functions meanwhile. Linux only; elsewhere
/// [`new`](Self::new) fails. `new` is not for the real-time path; all other functions are: they
/// allocate nothing.
///
/// ```
/// use luna_platform::clock::Instant;
/// use luna_platform::reactor::{Interest, Reactor, ReactorError};
/// use std::time::Duration;
///
/// let reactor = match Reactor::new() {
///     Err(ReactorError::Unsupported) => return Ok(()),
///     reactor => reactor?,
/// };
/// let ended = reactor.wait(Instant::now() + Duration::from_millis(1), &mut |_, _| unreachable!("no file is registered"))?;
/// assert!(ended.timed_out && !ended.woken);
/// reactor.wake(); // is not lost
/// assert!(reactor.wait(Instant::NEVER, &mut |_, _| ())?.woken);
/// # Ok::<(), ReactorError>(())
/// ```
#[derive(Debug)]
pub struct Reactor {
    epoll: Epoll,
    timer: TimerFd,
    waker: EventFd,
    /// The deadline that the timer is armed for, in nanoseconds; that of `NEVER` when it is not, or
    /// has expired. Only the thread that waits touches it; an atomic so that others may call `wake`
    /// meanwhile.
    armed: AtomicU64,
}

impl Reactor {
    /// A reactor without files.
    ///
    /// # Errors
    ///
    /// The process has no file descriptors left (it takes three), or (elsewhere)
    /// [`ReactorError::Unsupported`].
    pub fn new() -> Result<Reactor, ReactorError> {
        let epoll =
            Epoll::new(EpollCreateFlags::EPOLL_CLOEXEC).map_err(refused("epoll_create1"))?;
        let timer = TimerFd::new().map_err(timer_refused)?;
        // Non-blocking: a counter at its end, after 2^64 wakes, must not block the waking thread.
        let waker = EventFd::from_flags(EfdFlags::EFD_CLOEXEC | EfdFlags::EFD_NONBLOCK)
            .map_err(refused("eventfd"))?;
        let edge = EpollFlags::EPOLLIN | EpollFlags::EPOLLET;
        epoll
            .add(&timer, EpollEvent::new(edge, TIMER))
            .map_err(refused("epoll_ctl"))?;
        epoll
            .add(&waker, EpollEvent::new(edge, WAKE))
            .map_err(refused("epoll_ctl"))?;
        Ok(Reactor {
            epoll,
            timer,
            waker,
            armed: AtomicU64::new(Instant::NEVER.as_nanos()),
        })
    }

    /// Watches `fd`, and reports it once, with `token`, when it is as `interest` says. After that,
    /// [`rearm`](Self::rearm) it.
    ///
    /// Deregister it before it is closed; one that is closed everywhere is forgotten by itself. One
    /// system call, O(log files).
    ///
    /// # Errors
    ///
    /// A token from [`FIRST_RESERVED_TOKEN`] on, a file registered already, one that cannot be
    /// waited for, or a limit of the kernel.
    pub fn register(
        &self,
        fd: BorrowedFd<'_>,
        token: u64,
        interest: Interest,
    ) -> Result<(), ReactorError> {
        let event = event(token, interest)?;
        path::expected(Call::File, || self.epoll.add(fd, event))
            .map_err(|error| file_refused(fd, error))
    }

    /// Watches a registered `fd` for one more report, with a token and an interest anew. One that
    /// is ready already is reported by the next wait. One system call, O(log files).
    ///
    /// # Errors
    ///
    /// A token from [`FIRST_RESERVED_TOKEN`] on, or a file that is not registered.
    pub fn rearm(
        &self,
        fd: BorrowedFd<'_>,
        token: u64,
        interest: Interest,
    ) -> Result<(), ReactorError> {
        let mut event = event(token, interest)?;
        path::expected(Call::File, || self.epoll.modify(fd, &mut event))
            .map_err(|error| file_refused(fd, error))
    }

    /// Watches `fd` no more; no later wait reports it. One system call, O(log files).
    ///
    /// # Errors
    ///
    /// A file that is not registered.
    pub fn deregister(&self, fd: BorrowedFd<'_>) -> Result<(), ReactorError> {
        path::expected(Call::File, || self.epoll.delete(fd))
            .map_err(|error| file_refused(fd, error))
    }

    /// Waits until a file is ready, [`wake`](Self::wake) is called, or `deadline` comes
    /// ([`Instant::NEVER`]: never); calls `on_ready` with the token of each ready file, at most 64
    /// of them, before it returns.
    ///
    /// With a deadline that has passed it polls without waiting. One system call, and one more to
    /// arm the timer if the deadline is another one than last time. A wake from before the wait
    /// ends it at once. May end spuriously after a signal.
    ///
    /// # Errors
    ///
    /// None that the caller could cause.
    pub fn wait(
        &self,
        deadline: Instant,
        on_ready: &mut dyn FnMut(u64, Readiness),
    ) -> Result<Ended, ReactorError> {
        let mut events = [EpollEvent::empty(); EVENTS];
        loop {
            let is_due = deadline <= Instant::now_real();
            if !is_due
                && deadline != Instant::NEVER
                && self.armed.load(Ordering::Relaxed) != deadline.as_nanos()
            {
                self.timer.arm_at(deadline).map_err(timer_refused)?;
                self.armed.store(deadline.as_nanos(), Ordering::Relaxed);
            }
            let timeout = if is_due {
                EpollTimeout::ZERO
            } else {
                EpollTimeout::NONE
            };
            let mut ended = Ended {
                timed_out: is_due,
                ..Ended::default()
            };
            let count = match path::expected(Call::Sleep, || self.epoll.wait(&mut events, timeout))
            {
                Ok(count) => count,
                Err(Errno::EINTR) => return Ok(ended),
                Err(error) => return Err(refused("epoll_wait")(error)),
            };
            for event in &events[..count] {
                match event.data() {
                    WAKE => ended.woken = true,
                    TIMER => {
                        self.armed
                            .store(Instant::NEVER.as_nanos(), Ordering::Relaxed);
                        ended.timed_out |= deadline <= Instant::now_real();
                    }
                    token => {
                        ended.files += 1;
                        on_ready(token, readiness(event.events()));
                    }
                }
            }
            // Else it was the timer alone, armed for an earlier deadline: a later one does not
            // disarm it.
            if ended != Ended::default() || is_due {
                return Ok(ended);
            }
        }
    }

    /// Ends the present wait, or else the next. From any thread; one system call. Several before a
    /// wait end that one wait.
    pub fn wake(&self) {
        // It can fail only with a counter at its end, and then a wake is pending already.
        let _ = path::expected(Call::Wake, || self.waker.write(1));
    }
}

fn event(token: u64, interest: Interest) -> Result<EpollEvent, ReactorError> {
    if token >= FIRST_RESERVED_TOKEN {
        return Err(ReactorError::ReservedToken { token });
    }
    let wanted = match interest {
        Interest::Readable => EpollFlags::EPOLLIN | EpollFlags::EPOLLRDHUP,
        Interest::Writable => EpollFlags::EPOLLOUT,
        Interest::Both => EpollFlags::EPOLLIN | EpollFlags::EPOLLRDHUP | EpollFlags::EPOLLOUT,
    };
    Ok(EpollEvent::new(wanted | EpollFlags::EPOLLONESHOT, token))
}

fn readiness(flags: EpollFlags) -> Readiness {
    // The kernel reports these two unasked.
    let failed = flags.intersects(EpollFlags::EPOLLHUP | EpollFlags::EPOLLERR);
    let closed = failed || flags.contains(EpollFlags::EPOLLRDHUP);
    Readiness {
        readable: closed || flags.contains(EpollFlags::EPOLLIN),
        writable: failed || flags.contains(EpollFlags::EPOLLOUT),
        closed,
    }
}

fn refused(call: &'static str) -> impl Fn(Errno) -> ReactorError {
    move |error| ReactorError::Kernel {
        call,
        message: error.to_string(),
    }
}

fn timer_refused(error: TimerError) -> ReactorError {
    ReactorError::Kernel {
        call: "timerfd_create",
        message: error.to_string(),
    }
}

fn file_refused(fd: BorrowedFd<'_>, error: Errno) -> ReactorError {
    let fd = fd.as_raw_fd();
    match error {
        Errno::EPERM => ReactorError::AlwaysReady { fd },
        Errno::EEXIST => ReactorError::AlreadyRegistered { fd },
        Errno::ENOENT => ReactorError::NotRegistered { fd },
        error => refused("epoll_ctl")(error),
    }
}
