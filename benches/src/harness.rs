//! Runs cases round by round, prints them as a table, and writes them as JSON.

use std::{
    fmt, fs,
    panic::{self, AssertUnwindSafe},
    path::{Path, PathBuf},
    process,
    sync::mpsc::{self, RecvTimeoutError},
    thread,
    time::Duration,
};

use core_affinity::CoreId;
use serde::Serialize;

use crate::machine;

/// The peer to which the others are compared: a case whose `peer` begins with this.
pub const LUNA: &str = "LUNA";

/// No block takes this long, so one that does waits for something that never comes.
const HUNG: Duration = Duration::from_secs(60);

/// One scenario with one peer.
pub struct Case {
    /// The scenario; cases of the same name stand in one table.
    pub name: &'static str,
    /// Who is measured, and how.
    pub peer: &'static str,
    /// Of one operation, such as `ns/cycle`.
    pub unit: &'static str,
    block: Box<dyn FnMut(u64) -> Duration>,
}

impl Case {
    /// A case that is measured by calling `block` many times.
    ///
    /// `block` gets a number of operations, performs at least as many, checks their result (it panics when the result
    /// is wrong), and returns how long just that number took. What it started has ended when it returns. It is called
    /// on a thread that is not pinned; see [`on_core`] and [`on_cores`].
    pub fn new(
        name: &'static str,
        peer: &'static str,
        unit: &'static str,
        block: impl FnMut(u64) -> Duration + 'static,
    ) -> Self {
        let block = Box::new(block);
        Case {
            name,
            peer,
            unit,
            block,
        }
    }
}

impl fmt::Debug for Case {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Case")
            .field("name", &self.name)
            .field("peer", &self.peer)
            .field("unit", &self.unit)
            .finish_non_exhaustive()
    }
}

/// The cores that this process may use: all, or those that `taskset` left.
///
/// # Panics
///
/// When the system does not tell.
pub fn cores() -> Vec<CoreId> {
    let cores = core_affinity::get_core_ids().unwrap_or_default();
    assert!(
        !cores.is_empty(),
        "the system does not tell which cores there are"
    );
    cores
}

/// The core for a scenario on one core: the first.
///
/// # Panics
///
/// As [`cores`].
pub fn one_core() -> CoreId {
    cores()[0]
}

/// The cores for a scenario on two: the first two, or nothing where there is one only.
///
/// # Panics
///
/// As [`cores`].
pub fn two_cores() -> Option<[CoreId; 2]> {
    cores().first_chunk().copied()
}

/// Runs `work` on a thread of its own that is pinned to `core`, as are the threads that `work` starts.
///
/// # Panics
///
/// When the thread cannot be pinned, or `work` panics.
pub fn on_core<T: Send>(core: CoreId, work: impl FnOnce() -> T + Send) -> T {
    thread::scope(|scope| join(scope.spawn(|| pinned(core, work))))
}

/// Runs two pieces of work at the same time, each as with [`on_core`]; returns the second's result.
///
/// # Panics
///
/// When a thread cannot be pinned, or one of the two panics.
pub fn on_cores<T: Send>(
    cores: [CoreId; 2],
    first: impl FnOnce() + Send,
    second: impl FnOnce() -> T + Send,
) -> T {
    thread::scope(|scope| {
        let first = scope.spawn(move || pinned(cores[0], first));
        let second = scope.spawn(move || pinned(cores[1], second));
        let result = join(second);
        join(first);
        result
    })
}

fn pinned<T>(core: CoreId, work: impl FnOnce() -> T) -> T {
    assert!(
        core_affinity::set_for_current(core),
        "cannot pin a thread to {core:?}"
    );
    work()
}

fn join<T>(thread: thread::ScopedJoinHandle<'_, T>) -> T {
    thread
        .join()
        .unwrap_or_else(|panic| panic::resume_unwind(panic))
}

/// What the command line asks for.
#[derive(Debug, Default, PartialEq)]
struct Options {
    quick: bool,
    filter: String,
}

impl Options {
    fn parse(arguments: impl IntoIterator<Item = String>) -> Result<Self, String> {
        let mut options = Options::default();
        let mut by_cargo_bench = false;
        let mut arguments = arguments.into_iter();
        while let Some(argument) = arguments.next() {
            match argument.as_str() {
                "--quick" => options.quick = true,
                "--filter" => options.filter = arguments.next().ok_or("--filter needs a text")?,
                "--bench" => by_cargo_bench = true,
                _ => return Err(format!("unknown argument {argument}")),
            }
        }
        // `cargo test --benches` runs the program too: it wants the checks, not the figures.
        options.quick |= !by_cargo_bench;
        Ok(options)
    }

    fn wants(&self, case: &Case) -> bool {
        let text = format!("{} {}", case.name, case.peer).to_lowercase();
        text.contains(&self.filter.to_lowercase())
    }

    fn blocks(&self) -> usize {
        if self.quick { 3 } else { 9 }
    }

    fn block_length(&self) -> Duration {
        Duration::from_millis(if self.quick { 10 } else { 100 })
    }
}

/// A line of the table, as it stands in the JSON file.
#[derive(Debug, Serialize)]
struct Row {
    name: &'static str,
    peer: &'static str,
    unit: &'static str,
    median: f64,
    min: f64,
    /// The number of measured blocks.
    samples: usize,
}

/// Measures `cases` as the command line asks, prints the table, and writes `bench/<bench>.json` in the target folder.
///
/// # Panics
///
/// When a check of a case fails, or the file cannot be written.
pub fn run(bench: &str, cases: Vec<Case>) {
    let options = Options::parse(std::env::args().skip(1)).unwrap_or_else(|message| {
        eprintln!("{message}\nusage: cargo bench --bench {bench} -- [--quick] [--filter TEXT]");
        process::exit(2);
    });
    let cases: Vec<Case> = cases
        .into_iter()
        .filter(|case| options.wants(case))
        .collect();
    if cases.is_empty() {
        eprintln!("no case of {bench} contains {:?}", options.filter);
        process::exit(2);
    }
    println!("{}", machine::head());
    let stolen_before = machine::stolen();

    let rows = measure(cases, &options);

    println!("{}", table(&rows));
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

fn measure(mut cases: Vec<Case>, options: &Options) -> Vec<Row> {
    let watchdog = Watchdog::start();
    let block = |case: &mut Case, operations| {
        let title = format!("{}, {}", case.name, case.peer);
        watchdog.watch(&title);
        let result = panic::catch_unwind(AssertUnwindSafe(|| (case.block)(operations)));
        result.unwrap_or_else(|panic| {
            eprintln!("{title}: a check failed");
            panic::resume_unwind(panic)
        })
    };

    // Find out how many operations make a block, then warm up with such a block.
    let length = options.block_length();
    let mut operations = Vec::new();
    for case in &mut cases {
        let mut count = 64;
        let elapsed = loop {
            let elapsed = block(case, count);
            if elapsed >= length / 4 {
                break elapsed;
            }
            let factor = length.as_nanos() / elapsed.as_nanos().max(1);
            count *= factor.clamp(2, 16) as u64;
        };
        count = (count as f64 * length.as_secs_f64() / elapsed.as_secs_f64()) as u64 + 1;
        block(case, count);
        operations.push(count);
    }

    let mut samples = vec![Vec::new(); cases.len()];
    for _ in 0..options.blocks() {
        for (index, case) in cases.iter_mut().enumerate() {
            let elapsed = block(case, operations[index]);
            samples[index].push(elapsed.as_secs_f64() * 1e9 / operations[index] as f64);
        }
    }
    cases
        .iter()
        .zip(samples)
        .map(|(case, samples)| Row {
            name: case.name,
            peer: case.peer,
            unit: case.unit,
            median: median(&samples),
            min: samples.iter().copied().fold(f64::INFINITY, f64::min),
            samples: samples.len(),
        })
        .collect()
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

/// A table per scenario; the ratio is to LUNA's median, or to the best where LUNA does not take part.
fn table(rows: &[Row]) -> String {
    let mut text = String::new();
    for scenario in rows.chunk_by(|one, next| one.name == next.name) {
        let luna = scenario.iter().find(|row| row.peer.starts_with(LUNA));
        let (whose, reference) = match luna {
            Some(luna) => ("÷ LUNA", luna.median),
            None => (
                "÷ best",
                scenario
                    .iter()
                    .map(|row| row.median)
                    .fold(f64::INFINITY, f64::min),
            ),
        };
        let title = format!("{}, {}", scenario[0].name, scenario[0].unit);
        text += &format!("\n{title:<52} {:>10} {:>10} {whose:>8}\n", "median", "min");
        for row in scenario {
            let ratio = row.median / reference;
            text += &format!(
                "  {:<50} {:>10.1} {:>10.1} {ratio:>8.2}\n",
                row.peer, row.median, row.min
            );
        }
    }
    text
}

/// Ends the program when a case hangs, and says which.
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
fn target_folder() -> PathBuf {
    // A relative path is relative to where cargo was called, which a bench does not know.
    if let Some(folder) = std::env::var_os("CARGO_TARGET_DIR").map(PathBuf::from)
        && folder.is_absolute()
    {
        return folder;
    }
    // The bench lies somewhere in the target folder, which cargo marks as a cache.
    let program = std::env::current_exe().unwrap_or_default();
    let marked = program
        .ancestors()
        .find(|folder| folder.join("CACHEDIR.TAG").exists());
    marked.map_or_else(|| machine::workspace().join("target"), Path::to_owned)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parse(arguments: &[&str]) -> Result<Options, String> {
        Options::parse(arguments.iter().map(|&argument| argument.to_owned()))
    }

    fn row(name: &'static str, peer: &'static str, median: f64) -> Row {
        Row {
            name,
            peer,
            unit: "ns/cycle",
            median,
            min: median,
            samples: 1,
        }
    }

    #[test]
    fn smoke() {
        let case = Case::new("sleep", "std", "ns/sleep", |operations| {
            Duration::from_micros(operations)
        });
        let rows = measure(vec![case], &parse(&["--quick"]).unwrap());
        assert_eq!(rows.len(), 1);
        assert_eq!(rows[0].samples, 3);
        assert!((rows[0].median - 1000.0).abs() < 1e-6, "{rows:?}");
    }

    #[test]
    fn options() {
        assert!(!parse(&["--bench"]).unwrap().quick);
        assert!(parse(&["--bench", "--quick"]).unwrap().quick);
        assert!(parse(&[]).unwrap().quick, "not called by cargo bench");
        assert_eq!(parse(&["--filter", "tokio"]).unwrap().filter, "tokio");
        assert!(parse(&["--filter"]).is_err());
        assert!(parse(&["--quack"]).is_err());
    }

    #[test]
    fn filter_knows_name_and_peer() {
        let options = parse(&["--filter", "TOKIO"]).unwrap();
        let case = |peer| Case::new("commstime", peer, "ns/cycle", |_| Duration::ZERO);
        assert!(options.wants(&case("tokio mpsc(1)")));
        assert!(!options.wants(&case("smol")));
    }

    #[test]
    fn median_of_odd_and_even() {
        assert_eq!(median(&[3.0, 1.0, 2.0]), 2.0);
        assert_eq!(median(&[4.0, 1.0, 2.0, 3.0]), 2.5);
    }

    #[test]
    fn ratio_is_to_luna_else_to_the_best() {
        let both = table(&[row("a", "LUNA", 50.0), row("a", "peer", 20.0)]);
        assert!(
            both.contains("÷ LUNA") && both.contains(" 0.40\n"),
            "{both}"
        );
        let peers = table(&[row("a", "slow", 50.0), row("a", "fast", 20.0)]);
        assert!(
            peers.contains("÷ best") && peers.contains(" 2.50\n"),
            "{peers}"
        );
    }
}
