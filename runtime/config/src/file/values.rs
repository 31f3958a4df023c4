//! Values that are short texts: times, policies, cores.

use super::MAX_CORE;
use super::problem::Problem;
use super::table::Entry;
use luna_platform::thread::{EMERGENCY_PRIORITY, HIGHEST_USER_PRIORITY, Policy, PolicyError};
use std::time::Duration;

/// `250 us`, `1 ms`, `2 s`.
pub fn time(entry: &Entry<'_>) -> Result<Duration, Problem> {
    time_from(entry, 1)
}

/// As [`time`], or `0 us`.
pub fn time_or_none(entry: &Entry<'_>) -> Result<Duration, Problem> {
    time_from(entry, 0)
}

/// Of each unit.
const MOST: u64 = 1_000_000_000;

fn time_from(entry: &Entry<'_>, least: u64) -> Result<Duration, Problem> {
    let text = entry.text()?;
    let parts = text.trim().split_once(' ');
    let found = parts.and_then(|(number, unit)| {
        let number: u64 = number.parse().ok().filter(|n| (least..=MOST).contains(n))?;
        match unit.trim() {
            "ns" => Some(Duration::from_nanos(number)),
            "us" | "µs" => Some(Duration::from_micros(number)),
            "ms" => Some(Duration::from_millis(number)),
            "s" => Some(Duration::from_secs(number)),
            _ => None,
        }
    });
    let advice = format!("write a whole number from {least} to {MOST} and ns, us, ms or s: `1 ms`");
    found.ok_or_else(|| entry.problem("this is no time", advice))
}

/// `other`, `fifo:80`, `rr:80`, `deadline:200000/500000/1000000`, as a user's thread can have it.
pub fn policy(entry: &Entry<'_>) -> Result<Policy, Problem> {
    policy_to(entry, HIGHEST_USER_PRIORITY)
}

/// As [`policy`], also as only the framework's own threads have it.
pub fn policy_of_any(entry: &Entry<'_>) -> Result<Policy, Problem> {
    policy_to(entry, EMERGENCY_PRIORITY)
}

fn policy_to(entry: &Entry<'_>, most: u8) -> Result<Policy, Problem> {
    let found = match entry.text()?.parse::<Policy>() {
        Ok(policy) if policy.priority() <= most => return Ok(policy),
        Ok(policy) | Err(PolicyError::OutOfRange { policy, .. }) => PolicyError::OutOfRange {
            policy,
            highest: most,
        },
        Err(error) => error,
    };
    let message = match &found {
        PolicyError::OutOfRange { .. } => "the priority is out of range",
        PolicyError::Times { .. } => "the times (runtime/deadline/period in ns) are impossible",
        _ => {
            let advice = format!(
                "write `other`, `fifo:1` to `fifo:{most}`, `rr:1` to `rr:{most}`, or \
                 `deadline:200000/500000/1000000`: runtime, deadline and period in ns"
            );
            return Err(entry.problem("this is no policy", advice));
        }
    };
    let text = found.to_string();
    let advice = text.split_once("; ").map_or(&*text, |(_, advice)| advice);
    Err(entry.problem(message, advice))
}

/// `0` and so on; nothing for `"any"`.
pub fn core(entry: &Entry<'_>) -> Result<Option<u16>, Problem> {
    if entry.is_text() {
        return entry.one_of(&[("any", None)]);
    }
    Ok(Some(entry.number(0..=MAX_CORE)? as u16))
}
