//! Scheduling policies and what is wrong with a priority.

use std::fmt;
use std::str::FromStr;

/// The priority of the timer manager's thread. Users have 1 to 97.
pub const TIMER_PRIORITY: u8 = 98;

/// The priority of the emergency manager's thread: above everything else that runs.
pub const EMERGENCY_PRIORITY: u8 = 99;

/// The highest priority that a user can ask for; the lowest is 1.
pub const HIGHEST_USER_PRIORITY: u8 = 97;

/// How the operating system schedules a thread.
///
/// Priorities of the real-time policies go from 1 (lowest) to 99; a user has 1 to 97, see [`validate_user`](Self::validate_user).
/// A real-time thread runs until it waits or one of higher priority is ready.
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

    /// Whether threads of this policy run before all others.
    pub const fn is_real_time(self) -> bool {
        !matches!(self, Policy::Other)
    }

    /// The real-time priority, 0 for [`Other`](Self::Other).
    pub const fn priority(self) -> u8 {
        match self {
            Policy::Other => 0,
            Policy::Fifo(priority) | Policy::RoundRobin(priority) => priority,
        }
    }

    /// Whether a user may ask for this policy.
    ///
    /// # Errors
    ///
    /// [`PolicyError::OutOfRange`] for a real-time priority outside 1 to 97.
    pub const fn validate_user(self) -> Result<(), PolicyError> {
        self.validate(HIGHEST_USER_PRIORITY)
    }

    /// As [`validate_user`](Self::validate_user), for the framework's own threads: up to 99.
    pub(super) const fn validate_framework(self) -> Result<(), PolicyError> {
        self.validate(EMERGENCY_PRIORITY)
    }

    const fn validate(self, highest: u8) -> Result<(), PolicyError> {
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
        }
    }
}

impl FromStr for Policy {
    type Err = PolicyError;

    /// Reads `other`, `fifo:80` or `rr:80`, as `Display` writes them. The priority is 1 to 99, so that what was obtained can be read
    /// back from a report; what a user types is to be checked with [`validate_user`](Policy::validate_user) too.
    fn from_str(text: &str) -> Result<Policy, PolicyError> {
        if text == "other" {
            return Ok(Policy::Other);
        }
        let unknown = || PolicyError::Unknown {
            text: text.to_owned(),
        };
        let (name, priority) = text.split_once(':').ok_or_else(unknown)?;
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

/// What is wrong with a policy.
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub enum PolicyError {
    /// The text is no policy.
    Unknown {
        /// What was given.
        text: String,
    },
    /// The priority is outside 1 to `highest`.
    OutOfRange {
        /// What was asked for; a number that does not fit its field is given as 255.
        policy: Policy,
        /// The highest priority allowed.
        highest: u8,
    },
}

impl fmt::Display for PolicyError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            PolicyError::Unknown { text } => {
                write!(
                    f,
                    "`{text}` is no scheduling policy; write other, fifo:80 or rr:80, with a priority of 1 to 97"
                )
            }
            PolicyError::OutOfRange { policy, highest } => {
                write!(
                    f,
                    "the priority of policy {policy} is out of range; choose 1 (lowest) to {highest}"
                )?;
                if *highest == HIGHEST_USER_PRIORITY {
                    f.write_str(
                        ", since 98 and 99 are the timer manager's and the emergency manager's",
                    )?;
                }
                Ok(())
            }
        }
    }
}

impl std::error::Error for PolicyError {}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_and_back() {
        for policy in [
            Policy::Other,
            Policy::fifo(1),
            Policy::fifo(99),
            Policy::round_robin(80),
        ] {
            assert_eq!(policy.to_string().parse(), Ok(policy));
        }
    }

    #[test]
    fn bad_text_is_named() {
        for text in [
            "", "fifo", "fifo:", "fifo:x", "fifo:+8", "fifo:-1", "Fifo:3", "other:3", "rr:8 ",
            "batch",
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
