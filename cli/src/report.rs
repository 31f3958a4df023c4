//! From the library's report to what the commands print. All that the program knows of the report's
//! form is in this file.

use crate::alloc::Counts;
use crate::histogram_text::duration;
use crate::output::{Cause, Kept, Late, Logged, Loop, Measurement, Missing, Quantiles, Spread};
use luna::report::{
    Distribution, LateCause, LateCauseKind, LateCycle, LoggingReport, LoopReport, Shortfall,
};
use luna::{End, Exit, Report};
use std::time::Duration;

/// What was measured by the executor `executor`, with `loops` first among its loops.
pub(crate) fn measurement(
    report: &Report,
    executor: &str,
    loops: &[&str],
    counts: Counts,
) -> Measurement {
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

/// How the loop `name` kept time, in two lines: the slots with the latencies, and the cause of the
/// worst, where it was measured.
pub(crate) fn verdict(report: &Report, name: &str) -> String {
    let Some(one) = report.loops.get(name).filter(|one| one.cycles > 0) else {
        return format!("{name}: no cycle ran\n");
    };
    let missed = match one.missed {
        0 => "none missed".to_owned(),
        missed => format!("{missed} missed"),
    };
    let wake = &one.wake_latency;
    let why = match one.late_cycles.first() {
        None => format!(
            "no cycle began more than {} late",
            duration(nanos(one.late_after))
        ),
        Some(worst) => match worst.causes().as_slice() {
            [] => format!("the worst, slot {}: no cause was measured", worst.number),
            causes => {
                let causes: Vec<_> = causes.iter().map(ToString::to_string).collect();
                format!("the worst, slot {}: {}", worst.number, causes.join("; "))
            }
        },
    };
    format!(
        "{name}: {} of {} slots kept, {missed}; wake-up latency p99 {}, worst {}\n{why}\n",
        one.cycles,
        one.slots_elapsed,
        duration(nanos(wake.percentile(99.0))),
        duration(nanos(wake.max())),
    )
}

/// So that they are not said again: the library prints them at the start.
pub(crate) fn clear_shortfalls(report: &mut Report) {
    let of_threads = report.threads.iter_mut();
    let of_threads = of_threads.map(|thread| &mut thread.shortfalls);
    for shortfalls in of_threads.chain([&mut report.shortfalls]) {
        shortfalls.clear();
    }
}

/// The wake-up latencies of the loop `name`: (ns, count).
pub(crate) fn latencies<'a>(
    report: &'a Report,
    name: &str,
) -> impl Iterator<Item = (u64, u64)> + use<'a> {
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

#[cfg(test)]
mod tests {
    use super::*;
    use luna::prelude::*;

    const PERIOD: Duration = Duration::from_millis(10);

    /// Of a loop `servo` with a cycle of each duration, on a virtual clock.
    fn report_of(cycles: &[Duration]) -> Report {
        let mut system = System::new("machine");
        system.virtual_clock();
        let main = system.executor("main").build().expect("an executor");
        let cycles = cycles.to_vec();
        let servo = main.process("servo").spawn(async move {
            let mut tick = luna::periodic("servo", PERIOD)?;
            for cycle in cycles {
                tick.next().await;
                luna::after(cycle).await;
            }
            Ok(())
        });
        servo.expect("a process");
        system.run().expect("it runs")
    }

    #[test]
    fn slots_that_were_kept() {
        let report = report_of(&[PERIOD / 2; 5]);
        assert_eq!(
            verdict(&report, "servo"),
            "servo: 5 of 5 slots kept, none missed; wake-up latency p99 0 ns, worst 0 ns\n\
             no cycle began more than 1 ms late\n"
        );
        assert_eq!(verdict(&report, "timer"), "timer: no cycle ran\n");
    }

    #[test]
    fn missed_slots_have_a_cause_only_if_it_was_measured() {
        let mut report = report_of(&[PERIOD / 2, PERIOD * 5 / 2, PERIOD / 2]);
        let text = verdict(&report, "servo");
        let one = &report.loops["servo"];
        assert!(one.missed > 0 && one.late > 0, "{one:?}");
        let slots = format!(
            "servo: {} of {} slots kept, {} missed; ",
            one.cycles,
            one.cycles + one.missed,
            one.missed
        );
        assert!(text.starts_with(&slots), "{text}");
        let slot = one.late_cycles[0].number;
        let cause = format!("\nthe worst, slot {slot}: the cycle before overran by ");
        assert!(text.contains(&cause), "{text}");
        let worst = &mut report.loops.get_mut("servo").expect("its loop").late_cycles[0];
        worst.own_overrun = Duration::ZERO;
        let unknown = format!("\nthe worst, slot {slot}: no cause was measured\n");
        let text = verdict(&report, "servo");
        assert!(
            text.ends_with(&unknown) && text.lines().count() == 2,
            "{text}"
        );
    }
}
