//! What a look at the clock costs, and a system call.

use super::{Bounds, By, Measured, Measurement};
use crate::doctor::finding::Finding;
use luna::now;
use luna_platform::futex::Futex;
use std::hint::black_box;
use std::time::Duration;

/// How many operations are timed together: a single one is as short as the clock's own cost.
const BATCH: u64 = 1000;
/// Enough for a median.
const MAX_BATCHES: usize = 1000;

/// At most half of `each`.
pub(super) fn clock_read(each: Duration) -> Finding {
    let measurement = Measurement {
        name: "clock-read".to_owned(),
        why: "a loop reads the clock several times a cycle, each poll with a budget twice",
        advice: "see `clock-source`",
        bounds: Bounds {
            good: 100,
            bad: 2_000,
            by: By::Median,
        },
    };
    measurement.finding(batches(each, || {
        black_box(now());
    }))
}

/// At most half of `each`.
pub(super) fn system_call(each: Duration) -> Finding {
    let measurement = Measurement {
        name: "system-call".to_owned(),
        why: "waking and sleeping are system calls: this is the least that each of them costs",
        advice: "see which mitigations the kernel has (`lscpu`), and whether a seccomp filter or a tracer looks at every call",
        bounds: Bounds {
            good: 1_000,
            bad: 20_000,
            by: By::Median,
        },
    };
    let nobody = Futex::new(0);
    measurement.finding(batches(each, || nobody.wake_one()))
}

fn batches(each: Duration, mut call: impl FnMut()) -> Result<Measured, String> {
    let end = now() + each / 2;
    let mut times = Vec::with_capacity(MAX_BATCHES);
    while times.len() < MAX_BATCHES && now() < end {
        let before = now();
        for _ in 0..BATCH {
            call();
        }
        times.push(now().nanos_since(before) / BATCH);
    }
    Ok(Measured {
        times,
        how: format!("batches of {BATCH}, this thread"),
    })
}
