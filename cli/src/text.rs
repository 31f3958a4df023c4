//! What a command found: as text for people.

use crate::alloc::Counts;
use crate::output::{Axis, Measurement};
use crate::{columns, histogram_text};
use std::fmt;

/// A count with its noun: `1 signal`, `2 signals`.
#[derive(Debug)]
pub(crate) struct Count(pub(crate) u64, pub(crate) &'static str);

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
pub(crate) fn header(measurement: &Measurement) -> String {
    let core = match measurement.core {
        Some(core) => format!("core {core}"),
        None => "any core".to_owned(),
    };
    format!("policy {} on {core}\n", measurement.policy)
}

/// A line for each axis, with `-` where nothing was measured.
pub(crate) fn tracking(axes: &[Axis]) -> String {
    let rows = axes.iter().map(|axis| {
        let [rms, max] = match axis.tracking_error_deg {
            Some(error) => [error.rms, error.max].map(|error| format!("{error:.2}°")),
            None => ["-", "-"].map(str::to_owned),
        };
        [axis.name.to_owned(), rms, max]
    });
    columns::of_numbers(["tracking error", "rms", "max"], rows)
}

/// The wake-up latency of a loop, given as (ns, count).
pub(crate) fn latency(name: &str, values: impl Iterator<Item = (u64, u64)>) -> String {
    format!(
        "wake-up latency of {name}\n{}",
        histogram_text::draw(values)
    )
}

/// What the allocator counted.
pub(crate) fn memory(measurement: &Measurement) -> String {
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
pub(crate) fn ending(measurement: &Measurement) -> &'static str {
    match measurement.complete {
        true => "",
        false => "the run was not complete\n",
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::output::{FinalState, TrackingError};
    use luna_jiwy::parts::sanity::Interventions;

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

    #[test]
    fn tracking_errors_stand_in_columns() {
        let axis = |name, rms: Option<f64>| Axis {
            name,
            tracking_error_deg: rms.map(|rms| TrackingError {
                rms,
                max: 2.0 * rms,
            }),
            final_state: FinalState {
                angle_deg: 0.0,
                speed_deg_per_s: 0.0,
                current_a: 0.0,
            },
            sanity: Interventions::default(),
        };
        let axes = [
            axis("pan", Some(1.234)),
            axis("tilt", Some(10.0)),
            axis("zoom", None),
        ];
        assert_eq!(
            tracking(&axes),
            "tracking error     rms     max\n\
             pan              1.23°   2.47°\n\
             tilt            10.00°  20.00°\n\
             zoom                 -       -\n"
        );
    }
}
