//! What is measured: the programs, and what their latencies are to be.

/// How many cycles a run has.
const CYCLES: u32 = 700;
/// The same at 10 kHz.
const FAST_CYCLES: u32 = 2000;

/// How a row's figures are read from what its program prints.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Reading {
    /// From a line with `p50 1.23 p99 1.23 max 1.23 us`.
    Line,
    /// From the JSON object of the command `luna`: the loop of this name.
    Json(&'static str),
    /// From cyclictest's last line, in ns: its longest alone.
    Cyclictest,
}

/// Which of a row's figures a goal is about.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Which {
    Median,
    Max,
    Both,
}

/// What a row is to reach: at most this factor of another row's figure, plus some µs.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Goal {
    pub(crate) which: Which,
    pub(crate) factor: f64,
    pub(crate) of: &'static str,
    pub(crate) plus: f64,
}

/// A row of the table.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Row {
    pub(crate) name: &'static str,
    /// What is run in the guest.
    pub(crate) command: String,
    /// How often. Each run begins at another phase of the kernel's tick and of what else is
    /// periodic. The figures are the medians of the runs' percentiles, and the longest of all.
    pub(crate) runs: u32,
    pub(crate) reading: Reading,
    /// How much its longest latency may exceed the recorded one, as a fraction.
    pub(crate) longest: f64,
    pub(crate) goal: Option<Goal>,
}

/// The rows, by the boots that they share. The boots may be at the same time.
pub(crate) struct Boots {
    pub(crate) quiet: Vec<Row>,
    /// Beside hackbench, which needs the whole processor for as long as it runs.
    pub(crate) loaded: Vec<Row>,
}

/// What runs before the loaded rows: two groups of forty processes that send each other messages,
/// until the guest ends. The shell that starts the measured programs gets more of the processor, so
/// that their start does not take seconds; their loops have policies of their own.
pub(crate) const LOAD: &str = "\
hackbench -g 2 -l 100000000 > /dev/null 2>&1 &
renice -n -20 -p $$
sleep 0.5";

/// How much the longest latency of a quiet loop may exceed the recorded one. Most arrangements in
/// memory and phases made 6 %. A loop beside others is met by chance while the executor goes to
/// sleep, which made 64 % once.
const QUIET: f64 = 0.25;
const BESIDE_OTHERS: f64 = 1.0;
/// The same beside hackbench, whose longest sections are met by chance: they made half as much
/// again.
const LOADED: f64 = 0.6;
/// The same of a busy executor's: one of 2 µs was three times as long where the alarm's thread came
/// behind the deadline.
const BUSY: f64 = 5.0;
/// Of what is not LUNA's, medians alone are judged: they say whether the kernel is the same.
const FOREIGN: f64 = f64::INFINITY;

/// A turn of a busy executor: a process that yields, and the next that is taken. By
/// tools/instructions that is less than 200 instructions, or 0.4 µs.
const TURN: f64 = 0.4;
/// What a deadline that a busy executor notices may take beyond the turn.
const NOTICE: f64 = 2.0;

/// All rows.
pub(crate) fn all() -> Boots {
    let bare = |mode, name| Row {
        name,
        command: format!("/lab/bare {mode} {CYCLES}"),
        runs: 2,
        reading: Reading::Line,
        longest: FOREIGN,
        goal: None,
    };
    let jitter = |name: &'static str, runs, options: &str, goal| Row {
        name,
        command: format!("/lab/luna jitter --core 0 --json {options}"),
        runs,
        reading: Reading::Json("jitter"),
        longest: match name {
            _ if name.starts_with("hackbench") => LOADED,
            _ if name.contains("--others") => BESIDE_OTHERS,
            _ => QUIET,
        },
        goal,
    };
    let busy = |name, goal| Row {
        name,
        command: format!("/lab/{name} 0"),
        runs: 2,
        reading: Reading::Line,
        longest: BUSY,
        goal,
    };
    let cyclictest = |name, interval: u32, cycles: u32| Row {
        name,
        command: format!("cyclictest -m -q -N -p 80 -i {interval} -l {cycles} -a 0 -t 1"),
        runs: 3,
        reading: Reading::Cyclictest,
        longest: FOREIGN,
        goal: None,
    };
    let at_most = |which, factor, of| {
        Some(Goal {
            which,
            factor,
            of,
            plus: 0.0,
        })
    };
    let noticed = |of| {
        Some(Goal {
            which: Which::Median,
            factor: 1.0,
            of,
            plus: TURN + NOTICE,
        })
    };
    let slow = format!("--loops {CYCLES}");
    let fast = format!("--interval 100 --loops {FAST_CYCLES}");
    let quiet = vec![
        bare("clock", "bare clock_nanosleep"),
        bare("futex", "bare futex"),
        bare("timerfd", "bare timerfd, read"),
        bare("epoll", "bare timerfd, by epoll"),
        Row {
            name: "tokio's interval",
            command: format!("/lab/tokio_interval {CYCLES}"),
            runs: 1,
            reading: Reading::Line,
            longest: FOREIGN,
            goal: None,
        },
        jitter(
            "luna jitter",
            3,
            &slow,
            at_most(Which::Both, 1.05, "bare futex"),
        ),
        jitter(
            "luna jitter --others 10",
            5,
            &format!("{slow} --others 10"),
            None,
        ),
        jitter(
            "luna jitter --others 50",
            5,
            &format!("{slow} --others 50"),
            at_most(Which::Max, 1.25, "luna jitter"),
        ),
        Row {
            name: "demo's timer, 51 processes",
            command: "/lab/luna-demo --core 0 --seconds 1 --json".to_owned(),
            runs: 2,
            reading: Reading::Json("timer"),
            longest: QUIET,
            goal: at_most(Which::Both, 1.05, "luna jitter"),
        },
        busy("busy idle", None),
        busy("busy busy", noticed("busy idle")),
        busy("busy busy-other", noticed("busy idle")),
        busy("busy busy-rr", noticed("busy idle")),
        busy("busy busy-thread", noticed("busy idle")),
        busy("busy busy-deadline", noticed("busy idle")),
        busy("busy idle-manager", None),
        busy("busy busy-manager", noticed("busy idle-manager")),
    ];
    let loaded = vec![
        cyclictest("hackbench: cyclictest", 1000, CYCLES),
        jitter("hackbench: luna jitter", 3, &slow, None),
        cyclictest("hackbench: cyclictest, 10 kHz", 100, FAST_CYCLES),
        jitter(
            "hackbench: luna jitter, 10 kHz",
            3,
            &fast,
            at_most(Which::Max, 1.1, "hackbench: cyclictest, 10 kHz"),
        ),
    ];
    Boots { quiet, loaded }
}

impl Boots {
    /// The rows of both, in the order of the table.
    pub(crate) fn rows(&self) -> impl Iterator<Item = &Row> {
        self.quiet.iter().chain(&self.loaded)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeSet;

    #[test]
    fn each_row_has_its_own_name_and_each_goal_a_row() {
        let boots = all();
        let names: BTreeSet<_> = boots.rows().map(|row| row.name).collect();
        assert_eq!(names.len(), boots.rows().count());
        for goal in boots.rows().filter_map(|row| row.goal) {
            assert!(names.contains(goal.of), "{goal:?}");
        }
    }
}
