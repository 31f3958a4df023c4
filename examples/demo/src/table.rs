//! Table 4 of the LUNA paper (the thesis' appendix I): how well a robot's loop keeps its time, and
//! how long a cycle takes. This run's row beside the paper's.

use crate::columns;
use luna::Report;
use luna_jiwy::network::{self, LOOP};
use serde::Serialize;
use std::fmt::Write;

/// A row of the table. On a virtual clock, time stops while processes run: there the processing
/// takes none.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub(crate) struct Row {
    /// As asked for.
    pub(crate) rate_hz: f64,
    /// How many cycles there were.
    pub(crate) cycles: u64,
    /// From one cycle's begin to the next.
    pub(crate) cycle_ms: CycleTime,
    /// The standard deviation of that.
    pub(crate) stddev_us: f64,
    /// From a cycle's begin until all that control have done their part of it and the timer asks
    /// for the next.
    pub(crate) processing_us: Processing,
    /// The processor time of the controlling executor, by cycles: the processing, and its sleep and
    /// wake-up too. None where the system does not count it, and on a virtual clock.
    pub(crate) processor_us: Option<f64>,
    /// How often the processor went to a process, by cycles.
    pub(crate) switches: Switches,
}

/// From one cycle's begin to the next, in ms.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub(crate) struct CycleTime {
    pub(crate) mean: f64,
    pub(crate) min: f64,
    pub(crate) max: f64,
}

/// How long the processing took, in µs.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub(crate) struct Processing {
    pub(crate) mean: f64,
    pub(crate) p50: f64,
    pub(crate) p99: f64,
    pub(crate) max: f64,
}

/// How often the processor went to a process, by cycles.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub(crate) struct Switches {
    /// Switches to a controlling process: the processing time is that of these.
    pub(crate) control: f64,
    /// Switches to any process, with the simulated machine and the operator.
    pub(crate) all: f64,
}

/// The row of `report` for the run at `rate`, with the controlling processes on the executor
/// `control`; none if their loop never ran.
pub(super) fn row(report: &Report, rate: u32, control: &str) -> Option<Row> {
    let timer = report.loops.get(LOOP).filter(|timer| timer.cycles > 0)?;
    let cycles = timer.cycles as f64;
    let ms = |time: std::time::Duration| time.as_secs_f64() * 1e3;
    let us = |time: std::time::Duration| time.as_secs_f64() * 1e6;
    let polls = |of: fn(&str) -> bool| {
        let processes = report.processes.iter();
        let counted = processes.filter(|process| of(&process.name));
        counted.map(|process| process.polls).sum::<u64>() as f64 / cycles
    };
    let thread = report.threads.iter().find(|thread| thread.name == control);
    Some(Row {
        rate_hz: rate.into(),
        cycles: timer.cycles,
        cycle_ms: CycleTime {
            mean: timer.cycle_time.mean_nanos() / 1e6,
            min: ms(timer.cycle_time.min()),
            max: ms(timer.cycle_time.max()),
        },
        stddev_us: timer.cycle_time.stddev_nanos() / 1e3,
        processing_us: Processing {
            mean: timer.run_time.mean_nanos() / 1e3,
            p50: us(timer.run_time.percentile(50.0)),
            p99: us(timer.run_time.percentile(99.0)),
            max: us(timer.run_time.max()),
        },
        processor_us: thread
            .and_then(|thread| thread.processor_time)
            .map(|time| us(time) / cycles),
        switches: Switches {
            control: polls(network::controls),
            all: polls(|_| true),
        },
    })
}

/// A row of the paper: system, rate (Hz), cycle time (ms: mean, min, max), its standard deviation
/// (µs), processing time (µs).
type PaperRow = (&'static str, f64, [f64; 3], f64, f64);

/// Measured for about 60 s a row, on a PC/104 of 600 MHz. Its timer could not keep 1000 Hz, but
/// 1000.15.
const PAPER: [PaperRow; 9] = [
    (
        "LUNA, user threads",
        100.0,
        [10.00, 9.93, 11.00],
        39.6,
        111.6,
    ),
    ("LUNA, user threads", 1000.0, [1.00, 0.80, 2.01], 35.8, 89.3),
    (
        "LUNA, user threads",
        1000.15,
        [1.00, 0.79, 1.21],
        33.2,
        87.3,
    ),
    ("LUNA, OS threads", 100.0, [10.00, 9.97, 11.00], 39.1, 214.3),
    ("LUNA, OS threads", 1000.0, [1.00, 0.96, 2.00], 14.4, 185.6),
    ("LUNA, OS threads", 1000.15, [1.00, 0.95, 1.05], 8.3, 190.8),
    ("CTC++", 100.0, [11.00, 10.90, 11.11], 14.8, 199.0),
    ("CTC++", 1000.0, [1.18, 0.91, 2.10], 386.5, 174.5),
    ("CTC++", 1000.15, [1.00, 0.91, 1.10], 20.7, 172.5),
];

/// The run's row above those of the paper at its rate, and what its columns are. `took` is the real
/// duration of the run: on a virtual clock nothing else is shown.
pub(super) fn text(row: &Row, is_virtual: bool, took: std::time::Duration) -> String {
    let Row {
        cycle_ms,
        processing_us,
        switches,
        ..
    } = row;
    let work = match is_virtual {
        true => "-".to_owned(),
        false => format!("{:.1}", processing_us.mean),
    };
    let head = [
        "table 4", "rate, Hz", "mean, ms", "min", "max", "sd, us", "work, us", "switches",
    ];
    let this_run = [
        "this run".to_owned(),
        row.rate_hz.to_string(),
        format!("{:.4}", cycle_ms.mean),
        format!("{:.4}", cycle_ms.min),
        format!("{:.4}", cycle_ms.max),
        format!("{:.1}", row.stddev_us),
        work,
        format!("{:.1}", switches.control),
    ];
    // The rate that its timer could keep is the same to it.
    let of_paper = PAPER
        .iter()
        .filter(|(_, rate, ..)| rate.round() == row.rate_hz);
    let of_paper = of_paper.map(|(who, rate, [mean, min, max], stddev, work)| {
        [
            format!("paper: {who}"),
            rate.to_string(),
            format!("{mean:.2}"),
            format!("{min:.2}"),
            format!("{max:.2}"),
            format!("{stddev:.1}"),
            format!("{work:.1}"),
            "about 50".to_owned(),
        ]
    });
    let mut text = columns::of_numbers(head, std::iter::once(this_run).chain(of_paper));
    let _ = if is_virtual {
        writeln!(
            text,
            "the machine took {:.2} us a cycle, for {:.1} switches among all processes on one thread",
            took.as_secs_f64() * 1e6 / row.cycles as f64,
            switches.all
        )
    } else {
        let processor = row.processor_us.map_or_else(String::new, |time| {
            format!("; the executor's processor time, with its sleep and wake-up: {time:.1} us")
        });
        writeln!(
            text,
            "work, from the cycle's begin until the timer asks for the next: p50 {:.1}, p99 {:.1}, max {:.1} us{processor}",
            processing_us.p50, processing_us.p99, processing_us.max
        )
    };
    text
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Duration;

    fn row_at(rate_hz: f64) -> Row {
        Row {
            rate_hz,
            cycles: 60_000,
            cycle_ms: CycleTime {
                mean: 1.0,
                min: 0.95,
                max: 1.25,
            },
            stddev_us: 3.25,
            processing_us: Processing {
                mean: 4.5,
                p50: 4.0,
                p99: 9.0,
                max: 30.0,
            },
            processor_us: Some(12.5),
            switches: Switches {
                control: 90.0,
                all: 100.0,
            },
        }
    }

    #[test]
    fn the_papers_rows_at_the_rate_stand_below_this_runs() {
        let text = text(&row_at(1000.0), false, Duration::from_secs(60));
        let lines: Vec<&str> = text.lines().collect();
        assert_eq!(
            lines[..3],
            [
                "table 4                    rate, Hz  mean, ms     min     max  sd, us  work, us  switches",
                "this run                       1000    1.0000  0.9500  1.2500     3.2       4.5      90.0",
                "paper: LUNA, user threads      1000      1.00    0.80    2.01    35.8      89.3  about 50",
            ]
        );
        assert_eq!(lines.len(), 9);
        assert!(
            lines[3].contains("1000.15") && lines[7].contains("172.5"),
            "{text}"
        );
        assert_eq!(
            lines[8],
            "work, from the cycle's begin until the timer asks for the next: p50 4.0, p99 9.0, max 30.0 us; \
             the executor's processor time, with its sleep and wake-up: 12.5 us"
        );
    }

    #[test]
    fn there_are_three_of_the_paper_at_100_hz_and_none_at_a_rate_that_it_has_not() {
        let lines = |rate| {
            let text = text(&row_at(rate), false, Duration::ZERO);
            text.lines()
                .filter(|line| line.starts_with("paper"))
                .count()
        };
        assert_eq!((lines(100.0), lines(250.0)), (3, 0));
    }

    #[test]
    fn on_a_virtual_clock_only_the_machine_takes_time() {
        let row = Row {
            processor_us: None,
            ..row_at(1000.0)
        };
        let text = text(&row, true, Duration::from_millis(300));
        assert!(text.contains("     3.2         -      90.0\n"), "{text}");
        assert!(
            text.ends_with("the machine took 5.00 us a cycle, for 100.0 switches among all processes on one thread\n"),
            "{text}"
        );
    }
}
