//! Runs cases round by round, prints them as a table, and writes them as JSON.

mod apart;
mod case;
mod goal;
mod options;
mod row;

pub use apart::{finish, finish_with};
pub use case::Case;
pub use goal::{Goal, Outcome};
pub use options::is_quick;
pub use row::{Row, scenarios};

use std::{
    fs,
    panic::{self, AssertUnwindSafe},
    path::{Path, PathBuf},
    process,
    sync::mpsc::{self, RecvTimeoutError},
    thread,
    time::Duration,
};

use case::Block;
use options::Options;

use crate::machine;

/// The peer that others are compared with: cases with this prefix in `peer`.
pub const LUNA: &str = "LUNA";

/// The percentile of some nanoseconds, in microseconds.
pub fn percentile(nanos: &mut [u64], percent: usize) -> f64 {
    nanos.sort_unstable();
    nanos[(nanos.len() - 1) * percent / 100] as f64 / 1e3
}

/// No block takes this long: a block that does hangs.
const HUNG: Duration = Duration::from_secs(60);

/// Measures `cases` according to the command line, prints the tables and the goals, and writes
/// `bench/<bench>.json` in the target folder.
///
/// # Panics
///
/// A check of a case fails, or the file cannot be written.
pub fn run(bench: &str, cases: Vec<Case>) {
    let options = Options::of_program().unwrap_or_else(|message| {
        eprintln!("{message}\nusage: cargo bench --bench {bench} -- [--quick] [--filter TEXT]");
        process::exit(2);
    });
    let mut cases: Vec<Case> = cases
        .into_iter()
        .filter(|case| options.wants(case))
        .collect();
    if let Some((title, operations)) = &options.apart {
        let case = cases.iter_mut().find(|case| case.title() == *title);
        apart::run_here(case.expect("the bench has named it itself"), *operations);
    }
    if cases.is_empty() {
        eprintln!("no case of {bench} contains {:?}", options.filter);
        process::exit(2);
    }
    println!("{}", machine::head());
    let stolen_before = machine::stolen();

    let rows = measure(cases, &options);

    println!("{}{}", row::table(&rows), row::goals(&rows));
    print!(
        "{} blocks of {:?} a row, round by round",
        options.blocks(),
        options.block_length()
    );
    if let (Some(before), Some(after)) = (stolen_before, machine::stolen()) {
        print!("; the host took {:?} of CPU time meanwhile", after - before);
    }
    let folder = target_folder().join("bench");
    let file = folder.join(format!("{bench}.json"));
    let json = serde_json::to_string_pretty(&rows).expect("rows are plain data");
    fs::create_dir_all(&folder)
        .and_then(|()| fs::write(&file, json + "\n"))
        .unwrap_or_else(|error| panic!("cannot write {}: {error}", file.display()));
    println!("\n{}", file.display());
}

/// One block; its figure, which is nanoseconds if it is timed.
fn block(case: &mut Case, operations: u64, watchdog: &Watchdog) -> f64 {
    let title = case.title();
    watchdog.watch(&title);
    let result = panic::catch_unwind(AssertUnwindSafe(|| {
        if case.apart {
            return apart::run(case, operations);
        }
        match &mut case.block {
            Block::Timed(block) => block(operations).as_secs_f64() * 1e9,
            Block::Once(block) => block(),
        }
    }));
    result.unwrap_or_else(|panic| {
        eprintln!("{title}: a check failed");
        panic::resume_unwind(panic)
    })
}

/// The number of operations for a block of `length`; warms up with such a block.
fn calibrate(case: &mut Case, length: Duration, watchdog: &Watchdog) -> u64 {
    if matches!(case.block, Block::Once(_)) {
        return 1;
    }
    if case.fixed {
        return case.first;
    }
    let length = length.as_nanos() as f64;
    let mut count = case.first;
    let elapsed = loop {
        let elapsed = block(case, count, watchdog);
        if elapsed >= length / 4.0 {
            break elapsed;
        }
        let factor = (length / elapsed.max(1.0)) as u64;
        count *= factor.clamp(2, 16);
    };
    count = ((count as f64 * length / elapsed) as u64 + 1).max(case.first);
    block(case, count, watchdog);
    count
}

fn measure(mut cases: Vec<Case>, options: &Options) -> Vec<Row> {
    let watchdog = Watchdog::start();
    let operations: Vec<u64> = cases
        .iter_mut()
        .map(|case| calibrate(case, options.block_length(), &watchdog))
        .collect();

    let mut samples = vec![Vec::new(); cases.len()];
    for round in 0..options.blocks() {
        for (index, case) in cases.iter_mut().enumerate() {
            if round < case.most_blocks {
                let count = operations[index];
                let figure = block(case, count, &watchdog);
                samples[index].push(figure / count as f64);
            }
        }
    }
    let mut rows: Vec<Row> = cases
        .iter()
        .zip(samples)
        .map(|(case, samples)| Row::new(case, samples))
        .collect();
    for (index, case) in cases.iter().enumerate() {
        rows[index].goals = goal::outcomes(case, index, &cases, &rows);
    }
    rows
}

fn median(samples: &[f64]) -> f64 {
    let mut sorted = samples.to_vec();
    sorted.sort_by(f64::total_cmp);
    let middle = sorted.len() / 2;
    if sorted.len() % 2 == 1 {
        sorted[middle]
    } else {
        (sorted[middle - 1] + sorted[middle]) / 2.0
    }
}

/// Ends the program when a case hangs, and names the case.
#[derive(Debug)]
struct Watchdog(mpsc::Sender<String>);

impl Watchdog {
    fn start() -> Self {
        let (sender, receiver) = mpsc::channel();
        thread::spawn(move || {
            let mut watched = String::new();
            loop {
                match receiver.recv_timeout(HUNG) {
                    Ok(next) => watched = next,
                    Err(RecvTimeoutError::Disconnected) => return,
                    Err(RecvTimeoutError::Timeout) => {
                        eprintln!("{watched}: no end after {HUNG:?}");
                        process::exit(1);
                    }
                }
            }
        });
        Watchdog(sender)
    }

    fn watch(&self, title: &str) {
        let sent = self.0.send(title.to_owned());
        sent.expect("the watchdog lives as long as its sender");
    }
}

/// Cargo's target folder.
pub fn target_folder() -> PathBuf {
    // A relative path is relative to cargo's working directory, which a bench does not know.
    if let Some(folder) = std::env::var_os("CARGO_TARGET_DIR").map(PathBuf::from)
        && folder.is_absolute()
    {
        return folder;
    }
    // The bench is somewhere in the target folder, which cargo marks as a cache.
    let program = std::env::current_exe().unwrap_or_default();
    let marked = program
        .ancestors()
        .find(|folder| folder.join("CACHEDIR.TAG").exists());
    marked.map_or_else(|| machine::workspace().join("target"), Path::to_owned)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn smoke() {
        let cases = vec![
            Case::new("sleep", "std", "ns/sleep", |operations| {
                Duration::from_micros(operations)
            }),
            Case::new("few", "std", "ns/sleep", Duration::from_millis)
                .exactly(7)
                .blocks(2),
            Case::once("memory", "std", "bytes", || 5.0),
        ];
        let options = Options {
            quick: true,
            ..Options::default()
        };
        let rows = measure(cases, &options);
        assert_eq!(rows.len(), 3);
        assert_eq!(rows[0].samples, 3);
        assert!((rows[0].median - 1000.0).abs() < 1e-6, "{rows:?}");
        assert_eq!(rows[1].samples, 2);
        assert!((rows[1].median - 1e6).abs() < 1e-3, "{rows:?}");
        assert_eq!(rows[2].median, 5.0);
    }

    #[test]
    fn median_of_odd_and_even() {
        assert_eq!(median(&[3.0, 1.0, 2.0]), 2.0);
        assert_eq!(median(&[4.0, 1.0, 2.0, 3.0]), 2.5);
    }
}
