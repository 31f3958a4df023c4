//! How values are written on the command line.

use luna::Policy;
use std::ops::RangeInclusive;
use std::time::Duration;

/// The rates that Jiwy's controllers and mechanism are made and tested for, in Hz.
const RATES: RangeInclusive<u32> = 100..=4000;
/// A run of the demo takes at most a day.
const MAX_SECONDS: f64 = 86_400.0;
/// A period is at most a minute, in µs.
const MAX_INTERVAL: u64 = 60_000_000;

/// The duration of a run, in seconds: at most a day.
pub fn seconds(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Err(_) => Err("it is not a number".into()),
        Ok(value) if value > 0.0 && value <= MAX_SECONDS => Ok(value),
        Ok(_) => Err(format!(
            "it must be more than 0 and at most {MAX_SECONDS} (a day)"
        )),
    }
}

/// A number of seconds from 0 on.
pub fn instant(text: &str) -> Result<Duration, String> {
    let seconds = text.parse().ok().map(Duration::try_from_secs_f64);
    seconds
        .and_then(Result::ok)
        .ok_or("it must be a number of seconds, from 0 on".into())
}

/// Seconds, in ns.
pub fn offset(text: &str) -> Result<i64, String> {
    let seconds: Option<f64> = text.parse().ok();
    let nanos = seconds.map(|seconds| (seconds * 1e9).round());
    match nanos {
        // A century is enough, and its ns are exact to a µs.
        Some(nanos) if nanos.abs() < 3.2e18 => Ok(nanos as i64),
        _ => Err("it must be a number of seconds".into()),
    }
}

/// Cycles in a second, as Jiwy is made for.
pub fn rate(text: &str) -> Result<u32, String> {
    match text.parse::<u32>() {
        Ok(value) if RATES.contains(&value) => Ok(value),
        _ => Err(format!(
            "it must be a whole number from {} to {}",
            RATES.start(),
            RATES.end()
        )),
    }
}

/// A period in µs: at most a minute.
pub fn interval(text: &str) -> Result<u64, String> {
    match text.parse::<u64>() {
        Ok(value) if (1..=MAX_INTERVAL).contains(&value) => Ok(value),
        _ => Err(format!(
            "it must be a whole number of microseconds, from 1 to {MAX_INTERVAL} (a minute)"
        )),
    }
}

/// A scheduling policy of an executor that several processes share.
pub fn policy(text: &str) -> Result<Policy, String> {
    let policy: Policy = text.parse().map_err(|error| format!("{error}"))?;
    if policy.is_deadline() {
        return Err(
            "what is measured here shares an executor, which cannot have a deadline policy".into(),
        );
    }
    policy.validate_user().map_err(|error| format!("{error}"))?;
    Ok(policy)
}
