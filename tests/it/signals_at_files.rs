//! SIGINT and SIGTERM while the start opens a file that does not answer, and while the end waits
//! for one: each is taken at once, and the report of a run that is complete is not lost. Each
//! system runs in a program of its own.

#![cfg(all(
    target_os = "linux",
    not(luna_portable),
    feature = "logger",
    feature = "toml"
))]

use crate::common;
use common::{Program, SpawnOk, TempFile, watchdog};
use luna::error::SetupError;
use luna::log::{Logging, Sink};
use luna::prelude::*;
use luna::{End, Error, replay};
use nix::sys::stat::Mode;
use std::fs::{self, File, OpenOptions};
use std::io;

const FIFO: &str = "LUNA_TEST_FIFO";
const SIGNALS: [i32; 2] = [2, 15];

/// How the program ends whose start was interrupted.
const INTERRUPTED: i32 = 71;

/// Takes its head, and then nothing for ever.
struct Stalled;

impl Sink for Stalled {
    fn begin(&mut self, _head: &[u8]) -> io::Result<()> {
        Ok(())
    }

    fn block(&mut self, _block: &[u8]) -> io::Result<()> {
        loop {
            std::thread::park();
        }
    }
}

/// Says that it has ended.
struct Body;

impl Process for Body {
    async fn run(&mut self) -> luna::Result<()> {
        for number in 0..20_000_u32 {
            replay::output("number", &number);
        }
        Ok(())
    }

    fn post_run(&mut self) {
        println!("post_run");
    }
}

/// Its drop never ends.
struct NeverDropped;

impl Drop for NeverDropped {
    fn drop(&mut self) {
        println!("dropping");
        loop {
            std::thread::park();
        }
    }
}

/// What the child programs run; nothing when this program runs it as a test.
#[test]
fn part() {
    let Some(part) = common::part() else { return };
    let _watch = watchdog();
    let mut system = System::new("files");
    system.on_emergency("neutral", || println!("function"));
    let fifo = std::env::var_os(FIFO).unwrap_or_default();
    match part.as_str() {
        "parameters" => drop(system.parameters_from(fifo)),
        "log" => drop(system.log_to(fifo)),
        // Its rings have room for all, so the pipe fills.
        "replay log" => drop(system.record_room(fifo, 1 << 20)),
        "drop" => {
            let held = NeverDropped;
            system.on_emergency("held", move || {
                let _ = &held;
            });
        }
        "sink" => drop(system.log(Logging::to_sink(Stalled))),
        other => panic!("no part {other}"),
    }
    system.thread("own").process("body").spawn_ok(Body);
    match system.run() {
        Err(Error::Setup(error @ SetupError::StartInterrupted { .. })) => {
            println!("{error}");
            std::process::exit(INTERRUPTED);
        }
        // What could not be written is its error.
        Err(Error::Record(error)) => println!("{error}"),
        Ok(report) => println!("{report}"),
        Err(error) => panic!("{error}"),
    }
    let report = system.report().unwrap();
    assert_eq!(report.end, End::Completed);
    println!("late: {:?}", report.late_signal);
}

fn fifo(name: &str) -> TempFile {
    let fifo = TempFile::new(name);
    nix::unistd::mkfifo(&fifo.0, Mode::S_IRWXU).unwrap();
    fifo
}

#[track_caller]
fn start(part: &str, fifo: &TempFile) -> Program {
    let mut program = std::process::Command::new(std::env::current_exe().unwrap());
    program.env(FIFO, &fifo.0);
    Program::start_by(program, "signals_at_files::part", part)
}

/// Waits until as many threads of the program have this name. There is no event for it.
fn wait_for_threads(program: &Program, name: &str, number: usize) {
    let is_one = |task: io::Result<fs::DirEntry>| {
        let task = task.and_then(|task| fs::read_to_string(task.path().join("comm")));
        task.is_ok_and(|found| found.trim_end() == name)
    };
    let count = || {
        let tasks = fs::read_dir(format!("/proc/{}/task", program.number()));
        tasks.map_or(0, |tasks| {
            tasks.filter_map(|task| is_one(task).then_some(())).count()
        })
    };
    while count() != number {
        std::thread::yield_now();
    }
}

#[test]
fn a_file_that_the_start_opens_and_that_does_not_answer() {
    let _watch = watchdog();
    for part in ["parameters", "log", "replay log"] {
        for signal in SIGNALS {
            let fifo = fifo("does-not-answer");
            let program = start(part, &fifo);
            wait_for_threads(&program, "luna-opening", 1);
            program.signal(signal);
            let ended = program.end();
            assert_eq!(ended.status.code(), Some(INTERRUPTED), "{part}: {ended:?}");
            assert_eq!(
                ended.said(&["function", "post_run"]),
                ["function"],
                "{ended:?}"
            );
            let name = fifo.0.display().to_string();
            assert!(ended.output.contains(&name), "{part}: {ended:?}");
        }
    }
}

/// The run was complete: it is reported, and the program goes on as it would.
#[test]
fn a_sink_that_stalls_at_the_end() {
    let _watch = watchdog();
    for part in ["sink", "replay log"] {
        for signal in SIGNALS {
            let fifo = fifo("stalls");
            // Both ends are here, so that it opens at once; nothing is ever read.
            let _ends = open_both(&fifo);
            let mut program = start(part, &fifo);
            program.wait_for("post_run");
            // The emergency's end is certain: one thread takes signals still.
            wait_for_threads(&program, "luna-emergency", 1);
            program.signal(signal);
            let ended = program.end();
            assert!(ended.status.success(), "{part}: {ended:?}");
            let late = format!("late: Some({signal})");
            assert_eq!(ended.said(&["function", &late]), [&late], "{ended:?}");
        }
    }
}

/// While the end waits for what the program drops, for ever.
#[test]
fn a_second_one_ends_the_program_at_its_end() {
    let _watch = watchdog();
    for signal in SIGNALS {
        let mut program = start("drop", &TempFile::new("none"));
        program.wait_for("dropping");
        program.signal(2);
        // One that comes soon counts as the first one's echo, from when that was handled.
        while !has_ended(&program) {
            std::thread::sleep(luna_machine::signals::SAME_REQUEST);
            program.signal(signal);
        }
        let ended = program.end();
        assert_eq!(ended.status.code(), Some(128 + signal), "{ended:?}");
    }
}

/// Whether it is a zombie: nothing has waited for it yet.
fn has_ended(program: &Program) -> bool {
    let status = fs::read_to_string(format!("/proc/{}/status", program.number())).unwrap();
    luna_machine::facts::task::field(&status, "State")
        .unwrap()
        .starts_with('Z')
}

fn open_both(fifo: &TempFile) -> File {
    OpenOptions::new()
        .read(true)
        .write(true)
        .open(&fifo.0)
        .unwrap()
}
