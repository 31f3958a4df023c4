//! Values that are short texts: times, policies.

use super::problem::Problem;
use super::table::Entry;
use luna_platform::thread::Policy;
use std::time::Duration;

/// `250 us`, `1 ms`, `2 s`.
pub fn time(entry: &Entry<'_>) -> Result<Duration, Problem> {
    let text = entry.text()?;
    let parts = text.trim().split_once(' ');
    let found = parts.and_then(|(number, unit)| {
        let number: u64 = number
            .parse()
            .ok()
            .filter(|n| (1..=1_000_000_000).contains(n))?;
        match unit.trim() {
            "ns" => Some(Duration::from_nanos(number)),
            "us" | "µs" => Some(Duration::from_micros(number)),
            "ms" => Some(Duration::from_millis(number)),
            "s" => Some(Duration::from_secs(number)),
            _ => None,
        }
    });
    let advice = "write a whole number and ns, us, ms or s: `1 ms`";
    found.ok_or_else(|| entry.problem("this is no time", advice))
}

/// `other`, `fifo:80`, `rr:80`, `deadline:200000/500000/1000000`.
pub fn policy(entry: &Entry<'_>) -> Result<String, Problem> {
    let text = entry.text()?;
    if text.parse::<Policy>().is_err() {
        let advice = "write `other`, `fifo:1` to `fifo:99`, `rr:1` to `rr:99`, or \
                      `deadline:200000/500000/1000000`: runtime, deadline and period in ns";
        return Err(entry.problem("this is no policy", advice));
    }
    Ok(text.to_owned())
}
