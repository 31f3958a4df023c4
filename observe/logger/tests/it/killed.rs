//! A program that is killed, or has a full disk, leaves a recording that is readable to its last
//! complete block. The program is this one, started again.
#![cfg(unix)]

use crate::common;
use luna_logger::{Hub, Level, Logging, LoggingReport, Recorder, Signal, message};
use nix::sys::resource::{Resource, setrlimit};
use nix::sys::signal::{SigHandler, Signal as Number, signal};
use std::fs;
use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::Duration;

/// Where the program that is started again records to.
const FILE: &str = "LUNA_TEST_FILE";

/// A file that is gone in the end.
struct Temporary(PathBuf);

impl Temporary {
    fn new(name: &str) -> Self {
        let id = std::process::id();
        Self(std::env::temp_dir().join(format!("luna-logger-{name}-{id}.luna")))
    }
}

impl Drop for Temporary {
    fn drop(&mut self) {
        let _ = fs::remove_file(&self.0);
    }
}

/// The test `name` of this program, as a program of its own with piped output.
fn program(name: &str, file: &Path) -> Command {
    let mut program = Command::new(std::env::current_exe().unwrap());
    program
        .args([
            "--exact",
            &format!("killed::{name}"),
            "--ignored",
            "--nocapture",
        ])
        .env(FILE, file)
        .stdout(Stdio::piped());
    program
}

/// Its last line. It must have ended without error: its output is read to the end, since it could
/// not write to a closed pipe.
fn reported(mut child: Child) -> Option<String> {
    let lines = BufReader::new(child.stdout.take().unwrap()).lines();
    let reported = lines
        .map(Result::unwrap)
        .filter_map(|line| Some(line.strip_prefix("reported ")?.to_owned()))
        .last();
    assert!(child.wait().unwrap().success());
    reported
}

fn file() -> PathBuf {
    std::env::var_os(FILE)
        .expect("it is started by another test")
        .into()
}

/// Records numbers for ever, or until `enough` of them.
fn record(file: &Path, enough: u64) -> LoggingReport {
    let hub = Hub::new("killed", Default::default());
    let recording = Logging::to_file(file).every(Duration::from_millis(1));
    let recorder = Recorder::start(&hub, recording).unwrap();
    hub.enter_thread();
    let registering = hub.enter();
    let numbers = Signal::<u64>::register("numbers").unwrap();
    drop(registering);
    for n in 0..enough {
        numbers.record(n);
        if n % 1000 == 0 {
            println!("\nrecorded {n}");
            // Else most would be lost, and the file not grow.
            std::thread::sleep(Duration::from_millis(2));
        }
    }
    recorder.finish()
}

#[test]
#[ignore = "another test starts it as a program of its own"]
fn records_until_it_is_killed() {
    record(&file(), u64::MAX);
}

#[test]
#[ignore = "another test starts it as a program of its own"]
fn records_to_a_disk_that_becomes_full() {
    // A write beyond the limit is cut there, and the next one fails, as on a full disk. The limit
    // is in the middle of a block.
    setrlimit(Resource::RLIMIT_FSIZE, 200_001, 200_001).unwrap();
    // SAFETY: ignoring a signal runs nothing.
    unsafe { signal(Number::SIGXFSZ, SigHandler::SigIgn) }.unwrap();
    let report = record(&file(), 100_000);
    assert!(report.error.is_some());
    assert_eq!(report.signals[0].recorded + report.signals[0].lost, 100_000);
    println!("\nreported {} {}", report.signals[0].recorded, report.bytes);
}

#[test]
#[ignore = "another test starts it as a program of its own"]
fn records_while_standard_error_is_not_read() {
    // Until the other one has closed it.
    std::io::read_to_string(std::io::stdin()).unwrap();
    // Nothing records yet: it goes to standard error.
    message(Level::Error, "test", format_args!("not recorded"));
    let hub = Hub::new("unread", Default::default());
    let recording = Logging::to_file(file()).show_messages(Level::Info);
    let recorder = Recorder::start(&hub, recording).unwrap();
    hub.enter_thread();
    let registering = hub.enter();
    let numbers = Signal::<u64>::register("numbers").unwrap();
    drop(registering);
    for n in 0..5 {
        numbers.record(n);
        message(Level::Info, "test", format_args!("{n}"));
    }
    let report = recorder.finish();
    println!(
        "\nreported {} {} {:?}",
        report.signals[0].recorded, report.messages.recorded, report.error
    );
}

#[test]
#[ignore = "another test starts it as a program of its own"]
fn records_while_standard_error_is_full() {
    let hub = Hub::new("full", Default::default());
    let recording = Logging::to_file(file())
        .room_for_messages(4 << 20)
        .show_messages(Level::Info);
    let recorder = Recorder::start(&hub, recording).unwrap();
    hub.enter_thread();
    let registering = hub.enter();
    let numbers = Signal::<u64>::register("numbers").unwrap();
    drop(registering);
    // More than any pipe holds.
    let text = "x".repeat(400);
    for n in 0..5000 {
        numbers.record(n);
        message(Level::Info, "test", format_args!("{text}"));
    }
    let report = recorder.finish();
    println!(
        "\nreported {} {} {:?}",
        report.signals[0].recorded, report.messages.recorded, report.error
    );
}

/// The number of samples of the signal, which must be in order, and whether the file is complete.
fn numbers(file: &Path) -> (u64, bool) {
    let bytes = fs::read(file).unwrap();
    if bytes.is_empty() {
        return (0, false);
    }
    let (content, error) = common::read(&bytes);
    if let Some(error) = &error {
        assert!(error.is_truncated(), "{error}");
    }
    let empty = Vec::new();
    let samples = content.samples.get(&0).unwrap_or(&empty);
    assert!(samples.is_sorted_by(|(_, one), (_, next)| one[0].as_f64() < next[0].as_f64()));
    (samples.len() as u64, content.has_ended)
}

#[test]
fn what_was_moved_on_before_a_kill_can_be_read() {
    let file = Temporary::new("killed");
    let mut child = program("records_until_it_is_killed", &file.0)
        .spawn()
        .unwrap();
    // Read from until it is killed: it may not find the pipe closed before.
    let mut lines = BufReader::new(child.stdout.take().unwrap()).lines();
    // Each line shows that the program continues.
    let before = lines
        .by_ref()
        .map(Result::unwrap)
        .filter(|line| line.starts_with("recorded "))
        .map(|_| numbers(&file.0).0)
        .find(|read| *read >= 5000)
        .unwrap();
    child.kill().unwrap(); // SIGKILL
    child.wait().unwrap();
    let (read, has_ended) = numbers(&file.0);
    assert!(!has_ended);
    assert!(read >= before, "{read} of {before}");
}

#[test]
fn a_closed_standard_error_ends_no_recording() {
    let file = Temporary::new("unread");
    let mut child = program("records_while_standard_error_is_not_read", &file.0)
        .stdin(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    drop(child.stderr.take());
    // Now it may begin.
    drop(child.stdin.take());
    assert_eq!(reported(child).as_deref(), Some("5 5 None"));
    assert_eq!(numbers(&file.0), (5, true));
}

#[test]
fn an_unread_standard_error_ends_no_recording() {
    let file = Temporary::new("unread-full");
    let mut child = program("records_while_standard_error_is_full", &file.0)
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    // Open, but never read.
    let unread = child.stderr.take();
    let reported = reported(child);
    drop(unread);
    assert_eq!(reported.as_deref(), Some("5000 5000 None"));
    assert_eq!(numbers(&file.0), (5000, true));
}

#[test]
fn a_full_disk_keeps_the_blocks_before_it() {
    let file = Temporary::new("full");
    let child = program("records_to_a_disk_that_becomes_full", &file.0)
        .spawn()
        .unwrap();
    let reported = reported(child);
    // A short last block may have found room.
    let (read, _) = numbers(&file.0);
    let length = fs::metadata(&file.0).unwrap().len();
    assert_eq!(reported, Some(format!("{read} {length}")));
    assert!(read > 0 && length <= 200_001);
}
