//! What `luna demo` found of the camera: as JSON, and as text.

use crate::columns;
use crate::replay::Recorded;
use crate::table::Row;
use luna_command::output::Measurement;
use luna_jiwy::parts::sanity::Interventions;
use serde::Serialize;

/// What `luna demo --json` prints.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub(crate) struct Demo {
    /// Side by side with the axes.
    #[serde(flatten)]
    pub(crate) measurement: Measurement,
    /// The run's row of the paper's table 4; nothing if its loop never came to run.
    pub(crate) table_4: Option<Row>,
    /// What was recorded, if that was asked for.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) record: Option<Recorded>,
    /// Pan, tilt.
    pub(crate) axes: Vec<Axis>,
}

/// How one axis was controlled.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub(crate) struct Axis {
    /// `pan` or `tilt`.
    pub(crate) name: &'static str,
    /// Set-point against measured angle, over all cycles; `None` if no cycle measured it.
    pub(crate) tracking_error_deg: Option<TrackingError>,
    /// Where the mechanism was at the end.
    pub(crate) final_state: FinalState,
    /// How often the safety layer changed a duty.
    pub(crate) sanity: Sanity,
}

/// How often each rule of the safety layer changed a duty.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize)]
pub(crate) struct Sanity {
    /// It was no finite number.
    pub(crate) not_finite: u64,
    /// It was too large.
    pub(crate) limited: u64,
    /// It changed too fast.
    pub(crate) slewed: u64,
    /// It led into an end stop.
    pub(crate) guarded: u64,
}

impl From<Interventions> for Sanity {
    fn from(counts: Interventions) -> Self {
        let Interventions {
            not_finite,
            limited,
            slewed,
            guarded,
        } = counts;
        Self {
            not_finite,
            limited,
            slewed,
            guarded,
        }
    }
}

/// Set-point against measured angle, in degrees.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub(crate) struct TrackingError {
    /// The root of the mean square.
    pub(crate) rms: f64,
    /// The largest, either way.
    pub(crate) max: f64,
}

/// A mechanism at the end of a run.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub(crate) struct FinalState {
    /// Of the joint.
    pub(crate) angle_deg: f64,
    /// Of the joint.
    pub(crate) speed_deg_per_s: f64,
    /// In the armature.
    pub(crate) current_a: f64,
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

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::{Value, json, to_value};

    #[test]
    fn an_axis_without_a_measurement_has_a_null() {
        let axis = |tracking_error_deg| Axis {
            name: "pan",
            tracking_error_deg,
            final_state: FinalState {
                angle_deg: 3.0,
                speed_deg_per_s: 4.0,
                current_a: 5.0,
            },
            sanity: Sanity::default(),
        };
        let measured = to_value(axis(Some(TrackingError { rms: 1.0, max: 2.0 }))).unwrap();
        assert_eq!(
            measured["tracking_error_deg"],
            json!({"rms": 1.0, "max": 2.0})
        );
        assert_eq!(measured["sanity"]["slewed"], 0);
        assert_eq!(
            to_value(axis(None)).unwrap()["tracking_error_deg"],
            Value::Null
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
            sanity: Sanity::default(),
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
