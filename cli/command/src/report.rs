//! From the library's report to what the commands print. All that the program knows of the report's
//! form is in this file.

use crate::alloc::Counts;
use crate::output::{Cause, Kept, Late, Logged, Loop, Measurement, Missing, Quantiles, Spread};
use luna::report::{
    Distribution, LateCause, LateCauseKind, LateCycle, LoggingReport, LoopReport, Shortfall,
};
use luna::{End, Exit, Report};
use std::time::Duration;

/// What was measured by the executor `executor`, with `loops` first among its loops.
pub fn measurement(report: &Report, executor: &str, loops: &[&str], counts: Counts) -> Measurement {
    let place = report.threads.iter().find(|thread| thread.name == executor);
    let first = loops
        .iter()
        .filter_map(|name| report.loops.get_key_value(*name));
    let others = report
        .loops
        .iter()
        .filter(|(name, _)| !loops.contains(&name.as_str()));
    Measurement {
        policy: place.map_or_else(|| "other".to_owned(), |place| place.policy.to_string()),
        core: place.and_then(|place| place.core),
        missing: report.all_shortfalls().map(missing).collect(),
        complete: complete(report),
        counts,
        loops: first
            .chain(others)
            .map(|(name, report)| one_loop(name, report))
            .collect(),
        logging: report.logging.as_ref().map(logged),
    }
}

/// Whether every process returned by itself and without an error, and every thread ended.
fn complete(report: &Report) -> bool {
    let all_returned = report
        .processes
        .iter()
        .all(|process| process.exit == Some(Exit::Completed) && !process.failed);
    report.end == End::Completed
        && all_returned
        && !report.threads.iter().any(|thread| thread.abandoned)
}

/// So that they are not said again: the library prints them at the start.
pub fn clear_shortfalls(report: &mut Report) {
    let of_threads = report.threads.iter_mut();
    let of_threads = of_threads.map(|thread| &mut thread.shortfalls);
    for shortfalls in of_threads.chain([&mut report.shortfalls]) {
        shortfalls.clear();
    }
}

/// The wake-up latencies of the loop `name`: (ns, count).
pub fn latencies<'a>(report: &'a Report, name: &str) -> impl Iterator<Item = (u64, u64)> + use<'a> {
    let latency = report.loops.get(name).map(|report| &report.wake_latency);
    latency.into_iter().flat_map(Distribution::bins)
}

fn missing((who, shortfall): (&str, &Shortfall)) -> Missing {
    Missing {
        who: who.to_owned(),
        what: shortfall.what(),
        why: shortfall.why(),
        remedy: shortfall.remedy(),
    }
}

fn one_loop(name: &str, report: &LoopReport) -> Loop {
    Loop {
        name: name.to_owned(),
        period_ns: nanos(report.period),
        slots_elapsed: report.slots_elapsed,
        slots_kept: report.cycles,
        slots_missed: report.missed,
        wake_latency_ns: quantiles(&report.wake_latency),
        cycle_time_ns: Spread {
            quantiles: quantiles(&report.cycle_time),
            mean: report.cycle_time.mean_nanos(),
            stddev: report.cycle_time.stddev_nanos(),
        },
        run_time_ns: quantiles(&report.run_time),
        late_after_ns: nanos(report.late_after),
        late: report.late,
        late_cycles: report.late_cycles.iter().map(late).collect(),
    }
}

fn late(cycle: &LateCycle) -> Late {
    Late {
        slot: cycle.number,
        lateness_ns: nanos(cycle.lateness),
        causes: cycle.causes().into_iter().map(cause).collect(),
    }
}

fn cause(cause: LateCause) -> Cause {
    let (kind, process) = match cause.kind {
        LateCauseKind::OwnOverrun => ("own_overrun", None),
        LateCauseKind::OwnProcess(name) => ("own_process", Some(name)),
        LateCauseKind::OtherProcess(name) => ("other_process", Some(name)),
        LateCauseKind::OtherThread => ("other_thread", None),
        LateCauseKind::Hypervisor => ("hypervisor", None),
        // A kind that is newer than this program.
        _ => ("other", None),
    };
    Cause {
        kind,
        process,
        explains_ns: nanos(cause.explains),
        percent: cause.percent,
    }
}

fn logged(report: &LoggingReport) -> Logged {
    let kept = |recorded, lost| Kept { recorded, lost };
    let signals = report.signals.iter();
    let samples = signals.fold(Kept::default(), |all, one| {
        kept(all.recorded + one.recorded, all.lost + one.lost)
    });
    Logged {
        to: report.to.clone(),
        bytes: report.bytes,
        samples,
        messages: kept(report.messages.recorded, report.messages.lost),
        events: kept(report.events.recorded, report.events.lost),
        error: report.error.clone(),
    }
}

fn quantiles(times: &Distribution) -> Quantiles {
    Quantiles {
        min: nanos(times.min()),
        p50: nanos(times.percentile(50.0)),
        p99: nanos(times.percentile(99.0)),
        p99_9: nanos(times.percentile(99.9)),
        max: nanos(times.max()),
    }
}

/// 64 bits of nanoseconds are 584 years.
fn nanos(time: Duration) -> u64 {
    u64::try_from(time.as_nanos()).unwrap_or(u64::MAX)
}
