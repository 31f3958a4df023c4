//! What a command found: as text for people.

use crate::alloc::Counts;
use crate::histogram_text;
use crate::output::Measurement;
use std::fmt;

/// A count with its noun: `1 signal`, `2 signals`.
#[derive(Debug)]
pub struct Count(pub u64, pub &'static str);

impl fmt::Display for Count {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Count(number, what) = self;
        let ending = match number {
            1 => "",
            _ if what.ends_with('s') => "es",
            _ => "s",
        };
        write!(f, "{number} {what}{ending}")
    }
}

/// What was obtained. What was not is printed when the system starts, with what to do about it.
pub fn header(measurement: &Measurement) -> String {
    let core = match measurement.core {
        Some(core) => format!("core {core}"),
        None => "any core".to_owned(),
    };
    format!("policy {} on {core}\n", measurement.policy)
}

/// The wake-up latency of a loop, given as (ns, count).
pub fn latency(name: &str, values: impl Iterator<Item = (u64, u64)>) -> String {
    format!(
        "wake-up latency of {name}\n{}",
        histogram_text::draw(values)
    )
}

/// What the allocator counted.
pub fn memory(measurement: &Measurement) -> String {
    let Counts {
        allocations,
        reallocations,
        frees,
    } = measurement.counts;
    format!(
        "on the real-time path: allocations {allocations}, reallocations {reallocations}, frees {frees}\n"
    )
}

/// Printed when a run was cut short.
pub fn ending(measurement: &Measurement) -> &'static str {
    match measurement.complete {
        true => "",
        false => "the run was not complete\n",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn measurement() -> Measurement {
        Measurement {
            policy: "fifo:80".to_owned(),
            core: Some(1),
            missing: Vec::new(),
            complete: true,
            counts: Counts {
                allocations: 1,
                reallocations: 2,
                frees: 3,
            },
            loops: Vec::new(),
            logging: None,
        }
    }

    #[test]
    fn header_says_what_was_obtained() {
        assert_eq!(header(&measurement()), "policy fifo:80 on core 1\n");
        let poor = Measurement {
            policy: "other".to_owned(),
            core: None,
            ..measurement()
        };
        assert_eq!(header(&poor), "policy other on any core\n");
    }

    #[test]
    fn memory_and_ending() {
        assert_eq!(
            memory(&measurement()),
            "on the real-time path: allocations 1, reallocations 2, frees 3\n"
        );
        assert_eq!(ending(&measurement()), "");
        assert_ne!(
            ending(&Measurement {
                complete: false,
                ..measurement()
            }),
            ""
        );
    }
}
