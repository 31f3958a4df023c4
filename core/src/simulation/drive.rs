//! A clock that moves only as its driver commands: lock-step with a simulator.

use crate::deferred_free::Shared;
use crate::park::Parker;
use luna_platform::clock::{Instant, VirtualClock};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

/// State shared by the driver and the simulation's thread. Plain locks: neither is on a real-time
/// path.
pub(super) struct Drive {
    pub(super) clock: Arc<VirtualClock>,
    pub(super) parker: Shared<Parker>,
    state: Mutex<State>,
    changed: Condvar,
}

struct State {
    /// Number of requests of the driver, and up to which of them all is done.
    requests: u64,
    served: u64,
    /// The latest time that the clock may reach.
    limit: Instant,
    /// The earliest deadline when all was at rest.
    next: Instant,
    has_ended: bool,
    is_undriven: bool,
}

/// The next step of the thread at rest.
pub(super) enum Order {
    /// A request has arrived since it looked.
    LookAgain,
    /// Move time, and look again.
    MoveTo(Instant),
    /// All requests are done.
    Rest,
    /// Time will never move any more.
    Undriven,
}

impl Drive {
    fn new() -> Self {
        Self {
            clock: Arc::new(VirtualClock::new()),
            parker: Shared::new(Parker::new()),
            state: Mutex::new(State {
                requests: 0,
                served: 0,
                limit: VirtualClock::ORIGIN,
                next: Instant::NEVER,
                has_ended: false,
                is_undriven: false,
            }),
            changed: Condvar::new(),
        }
    }

    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Number of requests so far: to be read before a look for a process that can run.
    pub(super) fn requests(&self) -> u64 {
        self.state().requests
    }

    /// No process could run after `requests` were made; the earliest deadline is `next`.
    pub(super) fn at_rest(&self, requests: u64, next: Instant) -> Order {
        let mut state = self.state();
        if state.requests != requests {
            return Order::LookAgain;
        }
        if next <= state.limit && next != Instant::NEVER {
            return Order::MoveTo(next);
        }
        let now = self.clock.now();
        if state.limit == Instant::NEVER {
            // After the last deadline there is nothing to move for; a process that is woken later
            // waits for the driver's leave.
            state.limit = now;
        }
        if now < state.limit {
            return Order::MoveTo(state.limit);
        }
        state.next = next;
        if state.served != requests {
            state.served = requests;
            self.changed.notify_all();
        }
        if state.is_undriven {
            Order::Undriven
        } else {
            Order::Rest
        }
    }

    pub(super) fn end(&self) {
        self.state().has_ended = true;
        self.changed.notify_all();
    }
}

/// The system's side of a driven clock. When it is dropped, its driver is notified that the system
/// is over.
pub struct DrivenClock(pub(super) Arc<Drive>);

impl Drop for DrivenClock {
    fn drop(&mut self) {
        self.0.end();
    }
}

luna_platform::debug_fields!(DrivenClock, |driven| clock: driven.0.clock);

/// Moves the time of a system, step by step: the simulator's side of lock-step co-simulation.
///
/// The system's processes run on a thread of their own; the driver is in the simulator. Time stands
/// between two calls, and each call returns when every process has come to rest at the requested
/// instant: no process can run before time moves on, or something comes from outside. All deadlines
/// up to that instant, it included, have been served in their order, each at its own instant. What
/// the simulator and the processes exchange meanwhile (through channels, or variables) is thus the
/// same in each run.
///
/// When the driver is dropped time cannot move any more: the processes that still live are
/// cancelled, and the system ends in good order.
///
/// `System::driven_clock` of the crate `luna-rt` makes one, and shows an example.
pub struct ClockDriver {
    drive: Arc<Drive>,
}

/// Why time could not be moved.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum DriveError {
    /// The system has ended, or will never run: it was dropped, or its start has failed.
    #[error("the system has ended; its clock stands at {now:?}")]
    Ended {
        /// The time on its clock.
        now: Instant,
    },
    /// Time does not go back.
    #[error("time does not go back to {asked:?}: the clock stands at {now:?}")]
    Past {
        /// The requested instant.
        asked: Instant,
        /// The time on the clock.
        now: Instant,
    },
}

impl ClockDriver {
    /// A driver, and the clock that it drives.
    pub fn new() -> (ClockDriver, DrivenClock) {
        let drive = Arc::new(Drive::new());
        (
            ClockDriver {
                drive: drive.clone(),
            },
            DrivenClock(drive),
        )
    }

    /// The time on the system's clock, also before its start and after its end.
    pub fn now(&self) -> Instant {
        self.drive.clock.now()
    }

    /// Moves time on to `instant`, and returns when every process is at rest there. Waits for the
    /// system's start, if that is still to come; and for blocking calls that processes make, as
    /// long as they take. Blocks the calling thread; not for a process.
    ///
    /// [`Instant::NEVER`] means for as long as a process has a deadline: the clock then stays where
    /// the last one was. If a process always sets another deadline, as a loop does, the call never
    /// returns.
    ///
    /// # Errors
    ///
    /// [`DriveError::Past`] before the present; [`DriveError::Ended`] if all processes ended on the
    /// way, or had before: the clock then stands where the last one did.
    pub fn advance_to(&mut self, instant: Instant) -> Result<(), DriveError> {
        let mut state = self.drive.state();
        let now = self.now();
        if state.has_ended {
            return Err(DriveError::Ended { now });
        }
        if instant < now {
            return Err(DriveError::Past {
                asked: instant,
                now,
            });
        }
        state.limit = instant;
        state.requests += 1;
        let request = state.requests;
        self.drive.parker.unpark();
        while state.served < request && !state.has_ended {
            state = self
                .drive
                .changed
                .wait(state)
                .unwrap_or_else(PoisonError::into_inner);
        }
        if state.served < request {
            return Err(DriveError::Ended { now: self.now() });
        }
        Ok(())
    }

    /// Moves time on by `duration`: as [`advance_to`](Self::advance_to). A duration of zero runs
    /// the processes that something from outside has woken; [`Duration::MAX`] moves on to
    /// [`Instant::NEVER`], as described there.
    ///
    /// # Errors
    ///
    /// [`DriveError::Ended`], as for `advance_to`.
    pub fn advance_by(&mut self, duration: Duration) -> Result<(), DriveError> {
        self.advance_to(self.now() + duration)
    }

    /// When the next deadline of a process comes, once all are at rest at the present instant;
    /// `None` if no process waits for the time. A simulator with steps of its own choice need not
    /// stop before that.
    ///
    /// # Errors
    ///
    /// [`DriveError::Ended`], as for `advance_to`.
    pub fn next_deadline(&mut self) -> Result<Option<Instant>, DriveError> {
        self.advance_by(Duration::ZERO)?;
        let next = self.drive.state().next;
        Ok((next != Instant::NEVER).then_some(next))
    }
}

impl Drop for ClockDriver {
    fn drop(&mut self) {
        let mut state = self.drive.state();
        state.is_undriven = true;
        state.requests += 1;
        drop(state);
        self.drive.parker.unpark();
    }
}

luna_platform::debug_fields!(ClockDriver, |driver| now: driver.now());
