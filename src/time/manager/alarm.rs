//! What the manager's thread sleeps in: a timer for each timer group, and one for the next deadline
//! of a callback.

use super::timer_groups::Arm;
use crate::error::SetupError;
use luna_core::park::Parker;
use luna_platform::clock::Instant;
use luna_platform::lock::PiLock;
use luna_platform::reactor::Reactor;
#[cfg(unix)]
use luna_platform::reactor::ReactorError;
use luna_platform::timer_fd::TimerFd;
use std::time::Duration;

/// The timers, which any thread arms and one waits for.
pub(super) enum Alarm {
    /// The kernel's.
    Files(Files),
    /// Where the kernel has no timers that are files: the thread's own sleep.
    Sleep(Sleep),
}

pub(super) struct Files {
    reactor: Reactor,
    /// The timer_groups', and the callbacks' as the last.
    timers: Box<[TimerFd]>,
}

pub(super) struct Sleep {
    parker: Parker,
    timers: PiLock<Box<[Armed]>>,
}

/// When a timer expires next, and its period: none for one that expires once.
#[derive(Clone, Copy)]
struct Armed {
    next: Instant,
    period: u64,
}

const DISARMED: Armed = Armed {
    next: Instant::NEVER,
    period: 0,
};

impl Alarm {
    /// With timers for `timer_groups` timer groups. Allocates; a file for each timer and three
    /// more.
    pub(super) fn new(timer_groups: usize) -> Result<Self, SetupError> {
        match files(timer_groups)? {
            Some(files) => Ok(Alarm::Files(files)),
            None => Ok(Alarm::Sleep(Sleep {
                parker: Parker::new(),
                timers: PiLock::new(vec![DISARMED; timer_groups + 1].into()),
            })),
        }
    }

    /// Arms the callbacks' timer; [`Instant::NEVER`] disarms it. From any thread; one system call.
    pub(super) fn arm_once(&self, deadline: Instant) {
        match self {
            Alarm::Files(files) => {
                if let Some(timer) = files.timers.last() {
                    let armed = timer.arm_at(deadline);
                    debug_assert!(armed.is_ok(), "{armed:?}");
                }
            }
            Alarm::Sleep(sleep) => {
                let last = sleep.timers.lock().len() - 1;
                sleep.set(
                    last,
                    Armed {
                        next: deadline,
                        period: 0,
                    },
                );
            }
        }
    }

    /// Sleeps until a timer expires or [`wake`](Self::wake) is called; calls `expired` with the
    /// number of each timer group with an expired timer, and how often it has expired. May end
    /// without a cause.
    pub(super) fn wait(&self, expired: &mut dyn FnMut(usize, u64)) {
        match self {
            Alarm::Files(files) => {
                let timer_groups = files.timers.len() - 1;
                let mut on_ready = |token: u64, _| {
                    let number = token as usize;
                    // One that was disarmed meanwhile did not expire; an error would be that.
                    let times = files.timers[number].take().unwrap_or(0);
                    if times > 0 && number < timer_groups {
                        expired(number, times);
                    }
                };
                let ended = files.reactor.wait(Instant::NEVER, &mut on_ready);
                debug_assert!(ended.is_ok(), "{ended:?}");
            }
            Alarm::Sleep(sleep) => sleep.wait(expired),
        }
    }

    /// Ends the present wait, or the next.
    pub(super) fn wake(&self) {
        match self {
            Alarm::Files(files) => files.reactor.wake(),
            Alarm::Sleep(sleep) => sleep.parker.unpark(),
        }
    }
}

impl Arm for Alarm {
    fn arm(&self, base: usize, first: Instant, period: u64) {
        match self {
            Alarm::Files(files) => {
                let armed = files.timers[base].arm_periodic(first, Duration::from_nanos(period));
                debug_assert!(armed.is_ok(), "{armed:?}");
            }
            Alarm::Sleep(sleep) => sleep.set(
                base,
                Armed {
                    next: first,
                    period,
                },
            ),
        }
    }

    fn now(&self) -> Instant {
        Instant::now()
    }

    fn disarm(&self, base: usize) {
        match self {
            Alarm::Files(files) => {
                let disarmed = files.timers[base].disarm();
                debug_assert!(disarmed.is_ok(), "{disarmed:?}");
            }
            Alarm::Sleep(sleep) => sleep.set(base, DISARMED),
        }
    }
}

impl Sleep {
    fn set(&self, number: usize, armed: Armed) {
        self.timers.lock()[number] = armed;
        // It may expire before what the thread sleeps for.
        self.parker.unpark();
    }

    fn wait(&self, expired: &mut dyn FnMut(usize, u64)) {
        let (timer_groups, first) = {
            let timers = self.timers.lock();
            let first = timers.iter().map(|armed| armed.next).min();
            (timers.len() - 1, first.unwrap_or(Instant::NEVER))
        };
        self.parker.park(first);
        let now = Instant::now();
        for number in 0..=timer_groups {
            let times = self.timers.lock()[number].take(now);
            if times > 0 && number < timer_groups {
                expired(number, times);
            }
        }
    }
}

impl Armed {
    /// How often it has expired since it was asked last.
    fn take(&mut self, now: Instant) -> u64 {
        if now < self.next {
            return 0;
        }
        if self.period == 0 {
            *self = DISARMED;
            return 1;
        }
        let times = now.nanos_since(self.next) / self.period + 1;
        self.next = self.next.plus_nanos(self.period.saturating_mul(times));
        times
    }
}

/// The kernel's timers, where it has any that are files.
#[cfg(unix)]
fn files(timer_groups: usize) -> Result<Option<Files>, SetupError> {
    use std::os::fd::AsFd;
    let reactor = match Reactor::new() {
        Err(ReactorError::Unsupported) => return Ok(None),
        reactor => reactor.map_err(refused)?,
    };
    let timer = |token| {
        let timer = TimerFd::watched().map_err(refused)?;
        reactor
            .register_standing(timer.as_fd(), token as u64)
            .map_err(refused)?;
        Ok(timer)
    };
    let timers: Result<Box<[TimerFd]>, SetupError> = (0..=timer_groups).map(timer).collect();
    Ok(Some(Files {
        timers: timers?,
        reactor,
    }))
}

#[cfg(not(unix))]
fn files(_: usize) -> Result<Option<Files>, SetupError> {
    Ok(None)
}

#[cfg(unix)]
fn refused(error: impl std::fmt::Display) -> SetupError {
    SetupError::System {
        message: format!("the timer manager has no timers: {error}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(nanos: u64) -> Instant {
        Instant::from_nanos(nanos)
    }

    #[test]
    fn a_timer_without_a_file_counts_as_one_with() {
        let mut armed = Armed {
            next: at(100),
            period: 10,
        };
        let taken = [99, 100, 105, 139, 139, 140].map(|now| armed.take(at(now)));
        assert_eq!(taken, [0, 1, 0, 3, 0, 1]);
        let mut once = Armed {
            next: at(100),
            period: 0,
        };
        assert_eq!([99, 150, 300].map(|now| once.take(at(now))), [0, 1, 0]);
    }

    fn alarms() -> [Alarm; 2] {
        let sleep = Alarm::Sleep(Sleep {
            parker: Parker::new(),
            timers: PiLock::new(vec![DISARMED; 3].into()),
        });
        [Alarm::new(2).unwrap(), sleep]
    }

    #[test]
    fn both_kinds_wait_for_the_timers_that_are_armed() {
        for alarm in alarms() {
            let mut ticks = [0; 2];
            let first = Instant::now() + Duration::from_millis(1);
            alarm.arm(1, first, 1_000_000);
            while ticks[1] < 5 {
                alarm.wait(&mut |base, times| ticks[base] += times);
                let come = Instant::now().nanos_since(first) / 1_000_000 + 1;
                assert!(ticks[1] <= come && ticks[0] == 0, "{ticks:?} of {come}");
            }
            alarm.disarm(1);
            let deadline = Instant::now() + Duration::from_millis(2);
            alarm.arm_once(deadline);
            while Instant::now() < deadline {
                alarm.wait(&mut |_, _| panic!("no base is armed"));
            }
            alarm.wake();
            alarm.wait(&mut |_, _| panic!("no base is armed"));
        }
    }
}
