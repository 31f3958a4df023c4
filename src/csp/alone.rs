//! What `luna::run` prints when its body waits and nothing can wake it: there is no system around
//! it to detect that.

use crate::notice::notice;
use crate::system::deadlock::{Sleeping, find};
use luna_channels::inspect::wait_points;
use luna_core::current::ProcessId;
use std::time::Duration;

/// How long it waits before it prints. A thread that has not used its end yet may be about to:
/// channels are not marked here.
pub(crate) const PATIENCE: Duration = Duration::from_secs(1);

/// Prints what `process` waits for, if no other thread is known to use that; returns whether it was
/// printed.
pub(crate) fn report_if_stuck(process: ProcessId) -> bool {
    let body = Sleeping {
        id: process,
        name: "main".into(),
        has_ended: false,
        joiners: Vec::new(),
    };
    let mut points = wait_points();
    for wait_point in &mut points {
        // The wait has covered unknown parties, and the result is only printed.
        wait_point.strangers = false;
    }
    let Some(found) = find("", &[body], &points, |_| false, |_, _| false) else {
        return false;
    };
    let mut text =
        String::from("luna: the body of luna::run waits, and nothing that it knows of can wake it");
    for wait in found.waits {
        text.push_str(&format!("\n  {wait}"));
    }
    notice!("{text}");
    true
}
