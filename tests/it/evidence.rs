//! Recordings keep what is there, also that of a program which records at the same time.

#![cfg(feature = "logger")]

use crate::common;
use common::{SpawnOk, TempFile, watchdog};
use luna::log::{Logging, RegisterError};
use luna::prelude::*;
use luna::replay::{RecordError, Recording};
use luna::{Error, Report};
use luna_logger::format::{Reader, Record};
use std::path::Path;
use std::sync::Barrier;

struct Records(Option<Signal<u64>>);

impl Process for Records {
    fn pre_run(&mut self) -> luna::Result<()> {
        let signal: Result<_, RegisterError> = Signal::register("number");
        self.0 = Some(signal?);
        Ok(())
    }

    async fn run(&mut self) -> luna::Result<()> {
        for number in 0..10 {
            if let Some(signal) = &self.0 {
                signal.record(number);
            }
        }
        Ok(())
    }
}

fn system(name: &str) -> System {
    let mut system = System::new(name);
    let main = system.executor("main").build().unwrap();
    main.process("records").spawn_ok(Records(None));
    system
}

fn place(report: &Report) -> &Path {
    Path::new(&report.logging.as_ref().unwrap().to)
}

fn samples(file: &Path) -> usize {
    let bytes = std::fs::read(file).unwrap();
    let mut reader = Reader::new(&bytes[..]).unwrap();
    let mut samples = 0;
    while let Some(record) = reader.next().unwrap() {
        samples += usize::from(matches!(record, Record::Sample { .. }));
    }
    assert!(reader.has_ended());
    samples
}

#[test]
fn two_that_record_to_one_file_at_once_have_a_file_each() {
    let _watch = watchdog();
    let file = TempFile::new("at-once.luna");
    let both = Barrier::new(2);
    let record = |name: &str| {
        let mut system = system(name);
        system.log_to(&file.0);
        both.wait();
        system.run().unwrap()
    };
    let reports = std::thread::scope(|scope| {
        let other = scope.spawn(|| record("other"));
        [record("one"), other.join().unwrap()]
    });
    let places = reports.each_ref().map(place);
    assert_ne!(places[0], places[1]);
    assert!(places.contains(&&*file.0), "{places:?}");
    for place in places {
        assert_eq!(samples(place), 10, "{place:?}");
        std::fs::remove_file(place).unwrap();
    }
}

#[test]
fn a_recording_is_replaced_on_request_alone() {
    let _watch = watchdog();
    let file = TempFile::with("kept.luna", "evidence");
    let mut first = system("first");
    first.log_to(&file.0);
    let report = first.run().unwrap();
    assert_eq!(std::fs::read(&file.0).unwrap(), b"evidence");
    assert_eq!(samples(place(&report)), 10);
    std::fs::remove_file(place(&report)).unwrap();
    for by_system in [true, false] {
        let mut second = system("second");
        if by_system {
            second.log_to(&file.0).replace_recordings();
        } else {
            second.log(Logging::to_file(&file.0).replacing());
        }
        assert_eq!(place(&second.run().unwrap()), file.0);
        assert_eq!(samples(&file.0), 10);
    }
}

/// What replays it reads the same name, so another one is no help.
#[test]
fn a_replay_log_that_is_there_ends_the_start() {
    let _watch = watchdog();
    let file = TempFile::with("kept.replay", "evidence");
    let mut first = system("first");
    let error = first.record(&file.0).run().unwrap_err();
    assert!(
        matches!(error, Error::Record(RecordError::IsThere { .. })),
        "{error}"
    );
    assert_eq!(std::fs::read(&file.0).unwrap(), b"evidence");
    let mut second = system("second");
    second.record(&file.0).replace_recordings().run().unwrap();
    assert!(Recording::open(&file.0).unwrap().is_whole());
}
