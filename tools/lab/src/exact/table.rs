//! The printed table.

use super::gate::{Standing, Verdict};
use super::recorded::{Figures, Recorded};
use super::rows;

/// A line for each row: its figures, the recorded ones, the difference in percent, the verdict, and
/// how it stands to its goal.
pub(crate) fn print(measured: &Recorded, recorded: &Recorded) {
    println!(
        "PREEMPT_RT {}, {}, {}",
        measured.kernel, measured.qemu, measured.compiler
    );
    println!(
        "{:31} {:>8} {:>8} {:>8}   {:>8} {:>8}   {:>6} {:>6}",
        "wake-up latency, µs", "p50", "p99", "max", "recorded", "max", "p50, %", "max, %"
    );
    let shown = |figure: Option<f64>| figure.map_or("-".to_owned(), |it| format!("{it:.2}"));
    let percent = |old: Option<f64>, now: Option<f64>| match (old, now) {
        (Some(old), Some(now)) => format!("{:+.1}", 100.0 * (now / old - 1.0)),
        _ => "-".to_owned(),
    };
    let boots = rows::all();
    let is_judged = recorded.is_of_another(measured).is_none();
    for row in boots.rows() {
        let Some(now) = measured.figures.get(row.name).copied() else {
            continue;
        };
        let Figures { p50, p99, max } = now;
        let old = recorded.figures.get(row.name).copied();
        let (old_p50, old_max) = (old.and_then(|old| old.p50), old.map(|old| old.max));
        let verdict = if is_judged {
            Verdict::of(old, now, row.longest).text()
        } else {
            ""
        };
        let line = format!(
            "{:31} {:>8} {:>8} {max:>8.2}   {:>8} {:>8}   {:>6} {:>6}   {verdict}",
            row.name,
            shown(p50),
            shown(p99),
            shown(old_p50),
            shown(old_max),
            percent(old_p50, p50),
            percent(old_max, Some(max)),
        );
        println!("{}", line.trim_end());
    }
    println!();
    for row in boots.rows() {
        let now = measured.figures.get(row.name);
        let standing = row
            .goal
            .zip(now)
            .and_then(|(goal, now)| Standing::of(goal, *now, &measured.figures));
        if let Some(Standing { is_met, text }) = standing {
            println!(
                "goal {:6} {:31} {text}",
                if is_met { "met" } else { "MISSED" },
                row.name
            );
        }
    }
}
