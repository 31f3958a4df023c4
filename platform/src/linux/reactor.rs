//! One epoll, with an eventfd for other threads. Its thread sleeps in `ppoll`, which takes the
//! deadline.
//!
//! The kernel ends a sleep in `ppoll` under a real-time policy in the timer's interrupt itself. A
//! timerfd would expire in a kernel thread of low priority on PREEMPT_RT. `epoll_wait` knows
//! milliseconds alone, and `epoll_pwait2` is missing before Linux 5.11.
//!
//! The eventfd is watched edge-triggered, so it is never read: each write to it is an edge of its
//! own, whatever it has counted to.

use super::clock::timespec;
use crate::clock::Instant;
use crate::path::{self, Call};
use crate::reactor::{Ended, FIRST_RESERVED_TOKEN, Interest, ReactorError, Readiness};
use nix::errno::Errno;
use nix::poll::{PollFd, PollFlags, ppoll};
use nix::sys::epoll::{Epoll, EpollCreateFlags, EpollEvent, EpollFlags, EpollTimeout};
use nix::sys::eventfd::{EfdFlags, EventFd};
use std::os::fd::{AsFd, AsRawFd, BorrowedFd};

/// The eventfd's token.
const WAKE: u64 = FIRST_RESERVED_TOKEN;

/// A longer sleep, in nanoseconds, is made in two: the kernel may end that of an ordinary thread
/// late by 1/1000 of its length, or by 1/200 with a low nice value.
const LONG_SLEEP: u64 = 4_000_000;

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
    waker: EventFd,
}

impl Reactor {
    /// A reactor without files.
    ///
    /// # Errors
    ///
    /// The process has no file descriptors left (it takes two), or (elsewhere)
    /// [`ReactorError::Unsupported`].
    pub fn new() -> Result<Reactor, ReactorError> {
        let epoll =
            Epoll::new(EpollCreateFlags::EPOLL_CLOEXEC).map_err(refused("epoll_create1"))?;
        // Non-blocking: a counter at its end, after 2^64 wakes, must not block the waking thread.
        let waker = EventFd::from_flags(EfdFlags::EFD_CLOEXEC | EfdFlags::EFD_NONBLOCK)
            .map_err(refused("eventfd"))?;
        let edge = EpollFlags::EPOLLIN | EpollFlags::EPOLLET;
        epoll
            .add(&waker, EpollEvent::new(edge, WAKE))
            .map_err(refused("epoll_ctl"))?;
        Ok(Reactor { epoll, waker })
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
    /// With a deadline that has passed it polls without waiting. One system call, and one more if
    /// it waits; two more if the deadline is more than 4 ms away. A wake from before the wait ends
    /// it at once. May end spuriously after a signal.
    ///
    /// # Errors
    ///
    /// None that the caller could cause.
    pub fn wait(
        &self,
        deadline: Instant,
        on_ready: &mut dyn FnMut(u64, Readiness),
    ) -> Result<Ended, ReactorError> {
        while deadline > Instant::now_real() {
            match self.sleep(deadline) {
                Ok(true) => break,
                Ok(false) => {}
                Err(Errno::EINTR) => return Ok(Ended::default()),
                Err(error) => return Err(refused("ppoll")(error)),
            }
        }
        let mut ended = Ended {
            timed_out: deadline <= Instant::now_real(),
            ..Ended::default()
        };
        let mut events = [EpollEvent::empty(); EVENTS];
        let count = path::expected(Call::Sleep, || {
            self.epoll.wait(&mut events, EpollTimeout::ZERO)
        });
        for event in &events[..count.map_err(refused("epoll_wait"))?] {
            if event.data() == WAKE {
                ended.woken = true;
            } else {
                ended.files += 1;
                on_ready(event.data(), readiness(event.events()));
            }
        }
        Ok(ended)
    }

    /// Sleeps until there is an event, or until `deadline` or somewhat before; returns whether
    /// there is an event.
    fn sleep(&self, deadline: Instant) -> Result<bool, Errno> {
        let left = deadline.nanos_since(Instant::now_real());
        let left = match left {
            0..LONG_SLEEP => left,
            _ => left - left / 128,
        };
        let left = (deadline != Instant::NEVER).then(|| timespec(left).into());
        let mut epoll = [PollFd::new(self.epoll.0.as_fd(), PollFlags::POLLIN)];
        path::expected(Call::Sleep, || ppoll(&mut epoll, left, None)).map(|ready| ready > 0)
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

fn file_refused(fd: BorrowedFd<'_>, error: Errno) -> ReactorError {
    let fd = fd.as_raw_fd();
    match error {
        Errno::EPERM => ReactorError::AlwaysReady { fd },
        Errno::EEXIST => ReactorError::AlreadyRegistered { fd },
        Errno::ENOENT => ReactorError::NotRegistered { fd },
        error => refused("epoll_ctl")(error),
    }
}
