//! What an FMU is given, and what becomes of what it says.

use super::build::{Odd, fmu};
use super::{MS, VERSIONS, odd, open};
use crate::spawn::SpawnOk;
use luna::log::Logging;
use luna::prelude::*;
use luna_logger::format::{Reader, Record};
use luna_plants::fmu::{Fmu, FmuError, Version};
use luna_plants::{Checked, Plant};

/// The FMU opens the path of its resources with `y.txt` behind it.
#[test]
fn it_finds_its_resources() {
    for version in VERSIONS {
        let reads = |resource| Odd {
            flag: Some("-DREADS"),
            resource,
            ..Odd::default()
        };
        let mut plant = odd(version, reads(Some("2.5"))).unwrap();
        let mut y = [0.0];
        plant.measure(&mut y).unwrap();
        assert_eq!(y, [2.5], "{version}");
        for (resource, why) in [
            (None, "y.txt is not in the resources"),
            (Some("none"), "there is no number in y.txt"),
        ] {
            let error = odd(version, reads(resource)).unwrap_err();
            let FmuError::Refused { said, .. } = &error else {
                panic!("{error}")
            };
            assert!(said.starts_with(why), "{version}: {said}");
        }
    }
}

/// The messages in a recording: level, target and text.
fn messages(recording: &[u8]) -> Vec<(String, String, String)> {
    let mut reader = Reader::new(recording).unwrap();
    let mut all = Vec::new();
    while let Some(record) = reader.next().unwrap() {
        if let Record::Message {
            level,
            target,
            text,
            ..
        } = record
        {
            all.push((level.to_string(), target.to_owned(), text.to_owned()));
        }
    }
    all
}

#[test]
fn what_it_logs_is_a_message() {
    for (version, is_debugged) in VERSIONS
        .into_iter()
        .flat_map(|one| [(one, false), (one, true)])
    {
        let mut system = System::new("fmu");
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("run.luna");
        system.log(Logging::to_file(&file));
        let main = system.executor("main").build().unwrap();
        let fmu = Fmu::open(fmu(version, Odd::default())).unwrap();
        let fmu = fmu.parameter("fault", 16.0).unwrap();
        main.process("plant").spawn_ok(async move {
            let fmu = match is_debugged {
                true => fmu.debug_log(),
                false => fmu,
            };
            let mut plant = Checked::new(fmu.instantiate("oven", &["u"], &["y"]).unwrap());
            for _ in 0..4 {
                plant.step(MS).unwrap();
            }
            Ok(())
        });
        system.run().unwrap();
        // A recording has also what other threads of the program say: those of other tests.
        let mut all = messages(&std::fs::read(&file).unwrap());
        all.retain(|(_, target, _)| target == "fmu oven");
        // Version 2 makes its texts of arguments.
        let behind = match version {
            Version::Two => " (1.5, 7, 2, 3, 4, 5, 6, 7, 8.5, end)",
            Version::Three => "",
        };
        let mut expected = vec![
            ("WARN", format!("logStatusWarning: hot{behind}")),
            ("INFO", format!("logEvents: a step{behind}")),
            // Version 3 ends the text by a line's end.
            (
                "ERROR",
                format!("too hot{}", if behind.is_empty() { "" } else { "\n" }) + behind,
            ),
        ];
        if is_debugged {
            expected.insert(0, ("INFO", format!("logEvents: instantiating{behind}")));
        }
        let expected: Vec<_> = expected
            .into_iter()
            .map(|(level, text)| (level.to_owned(), "fmu oven".to_owned(), text))
            .collect();
        assert_eq!(all, expected, "{version}");
    }
}

/// Also without a system, and of an FMU that gives nulls and no environment.
#[test]
fn it_may_log_where_there_is_no_recording() {
    for version in VERSIONS {
        let fmu = open(version).parameter("fault", 13.0).unwrap().debug_log();
        let mut plant = Checked::new(fmu.instantiate("lag", &["u"], &["y"]).unwrap());
        for _ in 0..6 {
            plant.step(MS).unwrap();
        }
    }
}
