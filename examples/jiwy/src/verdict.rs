//! What is said first of a run.

use luna::Report;
use std::time::Duration;

/// How the loop `name` kept time, in two lines: the slots with the latencies, and the cause of the
/// worst, where it was measured.
#[must_use]
pub fn verdict(report: &Report, name: &str) -> String {
    let Some(one) = report.loops.get(name).filter(|one| one.cycles > 0) else {
        return format!("{name}: no cycle ran\n");
    };
    let missed = match one.missed {
        0 => "none missed".to_owned(),
        missed => format!("{missed} missed"),
    };
    let wake = &one.wake_latency;
    let why = match one.late_cycles.first() {
        None => format!("no cycle began more than {} late", micros(one.late_after)),
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
        micros(wake.percentile(99.0)),
        micros(wake.max()),
    )
}

fn micros(time: Duration) -> String {
    format!("{:.1} µs", time.as_secs_f64() * 1e6)
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
            "servo: 5 of 5 slots kept, none missed; wake-up latency p99 0.0 µs, worst 0.0 µs\n\
             no cycle began more than 1000.0 µs late\n"
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
