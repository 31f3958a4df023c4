//! Scheduling policies and what is wrong with a priority.

use std::fmt;
use std::str::FromStr;
use std::time::Duration;

/// The priority of the timer manager's thread. Users have 1 to 97.
pub const TIMER_PRIORITY: u8 = 98;

/// The priority of the emergency manager's thread: above everything else that runs.
pub const EMERGENCY_PRIORITY: u8 = 99;

/// The highest priority that a user can ask for; the lowest is 1.
pub const HIGHEST_USER_PRIORITY: u8 = 97;

/// How the operating system schedules a thread.
///
/// Priorities of the real-time policies go from 1 (lowest) to 99; a user has 1 to 97, see
/// [`validate_user`](Self::validate_user). A real-time thread runs until it waits or one of higher
/// priority is ready.
///
/// ```
/// use luna_platform::thread::Policy;
///
/// let policy: Policy = "fifo:80".parse()?;
/// assert_eq!(policy, Policy::fifo(80));
/// assert_eq!(policy.to_string(), "fifo:80");
/// assert!(policy.is_real_time() && policy.validate_user().is_ok());
/// assert!(Policy::fifo(98).validate_user().is_err()); // the timer manager's
/// # Ok::<(), luna_platform::thread::PolicyError>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
#[non_exhaustive]
pub enum Policy {
    /// The fair scheduler's: no promise when the thread runs.
    #[default]
    Other,
    /// `SCHED_FIFO` with a priority: first come, first served among threads of one priority.
    Fifo(u8),
    /// `SCHED_RR` with a priority: as `Fifo`, but threads of one priority take turns.
    RoundRobin(u8),
    /// `SCHED_DEADLINE`: up to `runtime` of a processor in each `period`, given within `deadline`
    /// of its begin, the earliest deadline first. See [`deadline`](Self::deadline).
    Deadline {
        /// The time on a processor that the thread is promised in each period, and held to, in
        /// nanoseconds.
        runtime: u64,
        /// From the begin of a period until it has had that, in nanoseconds.
        deadline: u64,
        /// How often it gets that, in nanoseconds.
        period: u64,
    },
}

/// The shortest runtime that the kernel counts, in nanoseconds.
const SHORTEST_RUNTIME: u64 = 1 << 10;

/// Whole nanoseconds, saturating.
const fn whole_nanos(time: Duration) -> u64 {
    let nanos = time.as_nanos();
    if nanos > u64::MAX as u128 {
        u64::MAX
    } else {
        nanos as u64
    }
}

impl Policy {
    /// `SCHED_FIFO` at `priority`. Not checked here: see [`validate_user`](Self::validate_user).
    pub const fn fifo(priority: u8) -> Policy {
        Policy::Fifo(priority)
    }

    /// `SCHED_RR` at `priority`. Not checked here: see [`validate_user`](Self::validate_user).
    pub const fn round_robin(priority: u8) -> Policy {
        Policy::RoundRobin(priority)
    }

    /// `SCHED_DEADLINE` for one loop on a thread of its own: `runtime` within `deadline` in each
    /// `period`. Not checked here: see [`validate_user`](Self::validate_user).
    ///
    /// Properties to know before choosing it:
    ///
    /// - **It ranks above all priorities.** A deadline thread preempts SCHED_FIFO 99 too, and with
    ///   it the timer manager and the emergency manager: neither acts on its core while it uses its
    ///   runtime. It counts as more urgent than any priority where processes wait.
    /// - **It is held to its runtime.** A thread that has used it up sleeps until its next period,
    ///   at any point of its work. Give it the longest cycle and a margin; a guard spin counts.
    /// - **It may not be pinned.** The kernel refuses it to a thread that may not run on all cores
    ///   of its root domain, so requesting a core too is an error before the start, and a program
    ///   under `taskset` does not get it.
    /// - **It is for OS-thread processes alone.** An executor under it is refused: the budget would
    ///   stop all its processes at once, and its bands mean nothing to it.
    /// - **It is admitted.** The kernel refuses it when all deadline threads together would take
    ///   more than its share of the processors (95 % as a rule), and to a process without
    ///   CAP_SYS_NICE: no limit replaces that.
    /// - **It does not fork as it is.** Threads made here have `SCHED_RESET_ON_FORK`, so that what
    ///   a library starts on one is an ordinary thread; without it the kernel would refuse the
    ///   start.
    /// - **It inherits no priority**, since none is above it. A thread that works for it inherits
    ///   SCHED_FIFO 97, so that an emergency still preempts it.
    ///
    /// ```
    /// use luna_platform::thread::{Attributes, Policy};
    /// use std::time::Duration;
    ///
    /// let [runtime, deadline, period] = [200, 500, 1000].map(Duration::from_micros);
    /// let servo = Policy::deadline(runtime, deadline, period);
    /// assert_eq!(servo.to_string(), "deadline:200000/500000/1000000");
    /// assert!(Attributes::new("servo").policy(servo).validate().is_ok());
    /// assert!(Attributes::new("servo").policy(servo).core(1).validate().is_err());
    /// let impossible = Policy::deadline(Duration::from_millis(2), period, period);
    /// assert!(impossible.validate_user().is_err());
    /// ```
    pub const fn deadline(runtime: Duration, deadline: Duration, period: Duration) -> Policy {
        Policy::Deadline {
            runtime: whole_nanos(runtime),
            deadline: whole_nanos(deadline),
            period: whole_nanos(period),
        }
    }

    /// Whether it is `SCHED_DEADLINE`.
    pub const fn is_deadline(self) -> bool {
        matches!(self, Policy::Deadline { .. })
    }

    /// Whether threads of this policy run before all others.
    pub const fn is_real_time(self) -> bool {
        !matches!(self, Policy::Other)
    }

    /// The real-time priority, 0 for [`Other`](Self::Other) and [`Deadline`](Self::Deadline), which
    /// have none.
    pub const fn priority(self) -> u8 {
        match self {
            Policy::Other | Policy::Deadline { .. } => 0,
            Policy::Fifo(priority) | Policy::RoundRobin(priority) => priority,
        }
    }

    /// How urgent a thread of this policy is beside others: the priority, or 100 for
    /// [`Deadline`](Self::Deadline), which is above them all.
    pub const fn rank(self) -> u8 {
        match self {
            Policy::Deadline { .. } => EMERGENCY_PRIORITY + 1,
            other => other.priority(),
        }
    }

    /// Whether a user may ask for this policy.
    ///
    /// # Errors
    ///
    /// [`PolicyError::OutOfRange`] for a real-time priority outside 1 to 97, [`PolicyError::Times`]
    /// for times of a deadline policy that no kernel grants: 1024 ns ≤ runtime ≤ deadline ≤ period
    /// ≤ 292 years.
    pub const fn validate_user(self) -> Result<(), PolicyError> {
        self.validate(HIGHEST_USER_PRIORITY)
    }

    /// As [`validate_user`](Self::validate_user), for the framework's own threads: up to 99.
    pub(super) const fn validate_framework(self) -> Result<(), PolicyError> {
        self.validate(EMERGENCY_PRIORITY)
    }

    const fn validate(self, highest: u8) -> Result<(), PolicyError> {
        if let Policy::Deadline {
            runtime,
            deadline,
            period,
        } = self
        {
            let ordered = SHORTEST_RUNTIME <= runtime && runtime <= deadline && deadline <= period;
            return if ordered && period <= i64::MAX as u64 {
                Ok(())
            } else {
                Err(PolicyError::Times { policy: self })
            };
        }
        if self.is_real_time() && (self.priority() == 0 || self.priority() > highest) {
            return Err(PolicyError::OutOfRange {
                policy: self,
                highest,
            });
        }
        Ok(())
    }
}

impl fmt::Display for Policy {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Policy::Other => f.write_str("other"),
            Policy::Fifo(priority) => write!(f, "fifo:{priority}"),
            Policy::RoundRobin(priority) => write!(f, "rr:{priority}"),
            Policy::Deadline {
                runtime,
                deadline,
                period,
            } => write!(f, "deadline:{runtime}/{deadline}/{period}"),
        }
    }
}

impl FromStr for Policy {
    type Err = PolicyError;

    /// Reads `other`, `fifo:80`, `rr:80` or `deadline:200000/500000/1000000` (runtime, deadline and
    /// period in nanoseconds), as `Display` writes them. The priority is 1 to 99, so that what was
    /// obtained can be read back from a report; what a user types is to be checked with
    /// [`validate_user`](Policy::validate_user) too.
    fn from_str(text: &str) -> Result<Policy, PolicyError> {
        if text == "other" {
            return Ok(Policy::Other);
        }
        let unknown = || PolicyError::Unknown {
            text: text.to_owned(),
        };
        let (name, priority) = text.split_once(':').ok_or_else(unknown)?;
        if name == "deadline" {
            let policy = deadline_of(priority).ok_or_else(unknown)?;
            return policy.validate_framework().map(|()| policy);
        }
        let make = match name {
            "fifo" => Policy::Fifo,
            "rr" => Policy::RoundRobin,
            _ => return Err(unknown()),
        };
        // Digits alone: `u8` would take a sign too.
        if !priority.bytes().all(|byte| byte.is_ascii_digit()) {
            return Err(unknown());
        }
        match priority.parse::<u8>() {
            Ok(priority) => make(priority).validate_framework().map(|()| make(priority)),
            Err(_) if priority.is_empty() => Err(unknown()),
            // A number, but a large one.
            Err(_) => Err(PolicyError::OutOfRange {
                policy: make(u8::MAX),
                highest: HIGHEST_USER_PRIORITY,
            }),
        }
    }
}

/// Three times in nanoseconds, with slashes between them.
fn deadline_of(text: &str) -> Option<Policy> {
    let mut times = text.split('/').map(|time| {
        // Digits alone: `u64` would take a sign too.
        let digits = time.bytes().all(|byte| byte.is_ascii_digit());
        digits
            .then(|| time.parse().ok())
            .flatten()
            .map(Duration::from_nanos)
    });
    let (runtime, deadline, period) = (times.next()??, times.next()??, times.next()??);
    times
        .next()
        .is_none()
        .then(|| Policy::deadline(runtime, deadline, period))
}

/// What is wrong with a policy.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum PolicyError {
    /// The text is no policy.
    #[error(
        "`{text}` is no scheduling policy; write other, fifo:80 or rr:80, with a priority of 1 to 97, \
         or deadline:RUNTIME/DEADLINE/PERIOD in nanoseconds"
    )]
    Unknown {
        /// What was given.
        text: String,
    },
    /// The priority is outside 1 to `highest`.
    #[error(
        "the priority of policy {policy} is out of range; choose 1 (lowest) to {highest}{}",
        if *highest == HIGHEST_USER_PRIORITY {
            ", since 98 and 99 are the timer manager's and the emergency manager's"
        } else {
            ""
        }
    )]
    OutOfRange {
        /// What was asked for; a number that does not fit its field is given as 255.
        policy: Policy,
        /// The highest priority allowed.
        highest: u8,
    },
    /// The times of a deadline policy are not in order.
    #[error(
        "the times of policy {policy} (runtime/deadline/period in ns) are impossible; choose 1024 ns \
         <= runtime <= deadline <= period"
    )]
    Times {
        /// What was asked for.
        policy: Policy,
    },
}

#[cfg(test)]
mod tests {
    use super::*;

    fn deadline(runtime: u64, deadline: u64, period: u64) -> Policy {
        let [runtime, deadline, period] = [runtime, deadline, period].map(Duration::from_nanos);
        Policy::deadline(runtime, deadline, period)
    }

    #[test]
    fn the_times_of_a_deadline_are_in_order() {
        for (policy, possible) in [
            (deadline(1024, 1024, 1024), true),
            (deadline(1023, 2000, 2000), false),
            (deadline(0, 0, 0), false),
            (deadline(2001, 2000, 2000), false),
            (deadline(2000, 2001, 2000), false),
            (deadline(2000, 2000, i64::MAX as u64), true),
            (deadline(2000, 2000, i64::MAX as u64 + 1), false),
        ] {
            let checked = policy.validate_user();
            assert_eq!(checked.is_ok(), possible, "{policy}");
            assert_eq!(policy.to_string().parse::<Policy>().is_ok(), possible);
            if let Err(error) = checked {
                let text = error.to_string();
                assert!(text.contains(&policy.to_string()), "{text}");
                assert!(text.contains("runtime <= deadline <= period"), "{text}");
            }
        }
    }

    #[test]
    fn a_deadline_ranks_above_every_priority() {
        let policy = deadline(2000, 3000, 4000);
        assert!(policy.is_real_time() && policy.is_deadline());
        assert_eq!(policy.priority(), 0);
        assert!(policy.rank() > Policy::fifo(EMERGENCY_PRIORITY).rank());
        assert_eq!(Policy::fifo(7).rank(), 7);
        assert_eq!(Policy::Other.rank(), 0);
    }

    #[test]
    fn text_and_back() {
        for policy in [
            Policy::Other,
            Policy::fifo(1),
            Policy::fifo(99),
            Policy::round_robin(80),
            deadline(1024, 1024, 1024),
            deadline(200_000, 500_000, 1_000_000),
        ] {
            assert_eq!(policy.to_string().parse(), Ok(policy));
        }
    }

    #[test]
    fn bad_text_is_named() {
        for text in [
            "",
            "fifo",
            "fifo:",
            "fifo:x",
            "fifo:+8",
            "fifo:-1",
            "Fifo:3",
            "other:3",
            "rr:8 ",
            "batch",
            "deadline",
            "deadline:",
            "deadline:2000",
            "deadline:2000/3000",
            "deadline:2000/3000/x",
            "deadline:2000/3000/+4000",
            "deadline:2000/3000/4000/5000",
            "deadline:2000/3000/",
        ] {
            let error = text.parse::<Policy>().unwrap_err();
            assert_eq!(
                error,
                PolicyError::Unknown {
                    text: text.to_owned()
                }
            );
            assert!(error.to_string().contains(&format!("`{text}`")), "{error}");
        }
        for text in ["fifo:0", "fifo:100", "rr:256", "fifo:99999999999999999999"] {
            assert!(
                matches!(text.parse::<Policy>(), Err(PolicyError::OutOfRange { .. })),
                "{text}"
            );
        }
    }

    #[test]
    fn users_have_1_to_97() {
        for (policy, allowed) in [
            (Policy::Other, true),
            (Policy::fifo(0), false),
            (Policy::fifo(1), true),
            (Policy::round_robin(97), true),
            (Policy::fifo(TIMER_PRIORITY), false),
            (Policy::fifo(EMERGENCY_PRIORITY), false),
            (Policy::fifo(100), false),
        ] {
            assert_eq!(policy.validate_user().is_ok(), allowed, "{policy}");
        }
        assert!(Policy::fifo(99).validate_framework().is_ok());
        assert!(Policy::fifo(100).validate_framework().is_err());
    }

    #[test]
    fn priority_of_each() {
        assert_eq!(Policy::Other.priority(), 0);
        assert!(!Policy::Other.is_real_time());
        assert_eq!(Policy::fifo(7).priority(), 7);
        assert!(Policy::round_robin(7).is_real_time());
    }
}
