//! What only looks does not end control: a recording, a notice or an announcement that reaches the
//! limit of files, or whose reader is gone, is a loss that is reported. The kernel raises SIGXFSZ and
//! SIGPIPE there, which end a program by default. Each system runs in a program of its own.

#![cfg(all(target_os = "linux", not(luna_portable), feature = "logger"))]

use crate::common;
use common::{Program, SpawnOk, TempFile, skip, watchdog};
use luna::error::Error;
use luna::log::{Logging, WriterSink};
use luna::prelude::*;
use luna::replay::{self, RecordError};
use luna::safety::{Degree, Guardian};
use luna::{End, Report};
use luna_logger::format::Reader;
use nix::libc;
use nix::sys::resource::{Resource, setrlimit};
use nix::sys::signal::{SigHandler, Signal as Posix, signal};
use std::fs::{self, OpenOptions};
use std::os::fd::AsRawFd;
use std::time::Duration;

const FILE: &str = "LUNA_TEST_FILE";
const LIMIT: u64 = 64 << 10;

/// Records more than the limit, at a pace that the recorder keeps.
struct Records(Option<Signal<u64>>);

impl Process for Records {
    fn pre_run(&mut self) -> luna::Result<()> {
        self.0 = Some(Signal::register("number")?);
        Ok(())
    }

    async fn run(&mut self) -> luna::Result<()> {
        for number in 0..20_000 {
            if let Some(signal) = &self.0 {
                signal.record(number);
            }
            replay::output("number", &number);
            if number % 200 == 0 {
                luna::after(Duration::from_millis(1)).await;
            }
        }
        Ok(())
    }
}

/// The report of a run that is complete, though something may not have been written.
fn complete(system: &System) -> (Report, Option<Error>) {
    let error = system.run().err();
    let report = system.report().unwrap();
    assert_eq!(report.end, End::Completed, "{error:?}");
    (report, error)
}

/// What the child programs run; nothing when this program runs it as a test.
#[test]
fn part() {
    let Some(part) = common::part() else { return };
    let _watch = watchdog();
    for number in [Posix::SIGXFSZ, Posix::SIGPIPE] {
        // SAFETY: the default action runs nothing.
        unsafe { signal(number, SigHandler::SigDfl) }.unwrap();
    }
    let limit = if part == "notices" { 0 } else { LIMIT };
    setrlimit(Resource::RLIMIT_FSIZE, limit, limit).unwrap();
    let file = std::env::var_os(FILE).unwrap_or_default();
    let mut system = System::new("limited");
    system.on_emergency("neutral", || println!("function"));
    let main = system.executor("main").build().unwrap();
    match part.as_str() {
        "recording" => {
            main.process("records").spawn_ok(Records(None));
            system.log(Logging::to_file(file));
            let logging = complete(&system).0.logging.unwrap();
            let signal = &logging.signals[0];
            assert!(signal.lost > 0 && signal.recorded > 0, "{logging}");
            assert_eq!(signal.lost + signal.recorded, 20_000, "{logging}");
            assert!(logging.error.unwrap().contains("File too large"));
        }
        "replay log" => {
            main.process("records").spawn_ok(Records(None));
            system.record(file);
            let error = complete(&system).1;
            let is_of_file = matches!(error, Some(Error::Record(RecordError::File { .. })));
            assert!(is_of_file, "{error:?}");
        }
        "notices" => {
            let ours = OpenOptions::new().append(true).open(file).unwrap();
            // SAFETY: plain system call on descriptors that are open.
            assert!(unsafe { libc::dup2(ours.as_raw_fd(), 2) } == 2);
            // Neither can be written, and two errors are two notices.
            system.announce();
            for name in ["one", "two"] {
                let fails = async { Err(Error::other("in vain")) };
                main.process(name).spawn_ok(fails);
            }
            complete(&system);
        }
        "pipe" => {
            let (reader, writer) = std::io::pipe().unwrap();
            system.log(Logging::to_sink(WriterSink::new(writer)));
            main.process("records").spawn_ok(async move {
                drop(reader);
                luna::log::message(luna::log::Level::Info, "it", format_args!("lost"));
                Ok(())
            });
            let logging = complete(&system).0.logging.unwrap();
            assert_eq!(logging.messages.lost, 1, "{logging}");
        }
        "guardian" => {
            system.guardian(Guardian::command("/bin/sh").arg("-c").arg("echo ready"));
            main.process("waits").spawn_ok(async {
                let safety = luna::safety::current().unwrap();
                // Until it is known that the guardian has ended.
                while safety.degree() != Degree::Warning {
                    luna::after(Duration::from_millis(1)).await;
                }
                Ok(())
            });
            complete(&system);
        }
        other => panic!("no part {other}"),
    }
    println!("complete");
}

#[track_caller]
fn completes(part: &str, file: &TempFile) {
    let mut program = std::process::Command::new(std::env::current_exe().unwrap());
    program.env(FILE, &file.0);
    let ended = Program::start_by(program, "write_signals::part", part).end();
    let said = ended.said(&["function", "complete"]);
    assert!(
        ended.status.success() && said == ["complete"],
        "{part}: {ended:?}"
    );
}

#[test]
fn a_recording_that_reaches_the_limit_of_files_is_a_loss() {
    let _watch = watchdog();
    let file = TempFile::new("limited.luna");
    completes("recording", &file);
    // What was taken back ends the file at a whole block.
    let bytes = fs::read(&file.0).unwrap();
    assert!(bytes.len() as u64 <= LIMIT);
    let mut reader = Reader::new(&bytes[..]).unwrap();
    while reader.next().unwrap().is_some() {}
    completes("replay log", &TempFile::new("limited.replay"));
}

#[test]
fn notices_and_announcements_that_cannot_be_written_end_nothing() {
    let _watch = watchdog();
    completes("notices", &TempFile::with("errors", "of before"));
}

#[test]
fn a_reader_that_is_gone_ends_nothing() {
    let _watch = watchdog();
    completes("pipe", &TempFile::new("none"));
    if !std::path::Path::new("/bin/sh").exists() {
        return skip("there is no /bin/sh");
    }
    completes("guardian", &TempFile::new("none"));
}
