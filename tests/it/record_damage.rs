//! Damaged recordings, and programs other than the recorded ones: all of it is noticed, and nothing
//! panics or hangs. What takes a replay each time is tried at a part of the places; `LUNA_LONG=1`
//! tries all.

use crate::common::{TempFile, sample};
use luna::prelude::*;
use luna::replay::{self, RecordError, Recording};
use luna::{Buffer, Error};
use std::path::PathBuf;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex};

type Outputs = Arc<Mutex<Vec<(&'static str, u64)>>>;

/// What a changed program does otherwise.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
enum Change {
    Nothing,
    Output,
    OtherOutput,
    MoreOutputs,
    FewerSends,
    Guards,
    LooksAtTheClock,
    NoTry,
    Returns,
    GoesOn,
    SystemName,
    ProcessName,
    OneMore,
    OneLess,
}

fn network(outputs: &Outputs, change: Change) -> luna::Result<System> {
    static INPUT: AtomicU64 = AtomicU64::new(1);
    let mut system = System::new(match change {
        Change::SystemName => "other",
        _ => "small",
    });
    let left = system.executor("left").build()?;
    let right = system.executor("right").build()?;
    let (first, both) = luna::channel::<u64>();
    let (buffered, stored) = luna::buffered::<u64>(Buffer::fifo(8));
    let second = first.clone();
    left.process("first").spawn(async move {
        for round in 0..3 {
            first
                .send(replay::input("first", || INPUT.fetch_add(1, Ordering::Relaxed)) + round)
                .await?;
        }
        if change == Change::GoesOn {
            luna::after(std::time::Duration::ZERO).await;
        }
        Ok(())
    })?;
    let sends = if change == Change::FewerSends { 2 } else { 3 };
    let name = if change == Change::ProcessName {
        "third"
    } else {
        "second"
    };
    right.process(name).spawn(async move {
        for round in 0..sends {
            second.send(100 + round).await?;
        }
        for round in 0..6 {
            buffered.send(round).await?;
        }
        Ok(())
    })?;
    let out = outputs.clone();
    left.process("sink").spawn(async move {
        let give = |name, value| {
            replay::output(name, &value);
            out.lock().unwrap().push((name, value));
        };
        let mut stored_values = 0;
        while let Ok(mut value) = both.recv().await {
            value += u64::from(change == Change::Output);
            give(
                if change == Change::OtherOutput {
                    "other"
                } else {
                    "sum"
                },
                value,
            );
            if change != Change::NoTry
                && let Ok(value) = stored.try_recv()
            {
                stored_values += 1;
                give("tried", value);
            }
            if change == Change::LooksAtTheClock {
                luna::now();
            }
        }
        if change == Change::Returns {
            return Ok(());
        }
        while stored_values < 6 {
            let value = match change {
                Change::Guards => pri_alt! {
                    value = both.recv(), if false => value?,
                    value = stored.recv() => value?,
                },
                _ => pri_alt! {
                    value = stored.recv() => value?,
                    value = both.recv(), if false => value?,
                },
            };
            stored_values += 1;
            give("stored", value);
        }
        give("time", luna::now().as_nanos());
        if change == Change::MoreOutputs {
            give("time", 1);
        }
        Ok(())
    })?;
    if change != Change::OneLess {
        left.process("idle").spawn(async { Ok(()) })?;
    }
    if change == Change::OneMore {
        left.process("more").spawn(async { Ok(()) })?;
    }
    Ok(system)
}

fn recorded(file: &TempFile) -> Vec<(&'static str, u64)> {
    let outputs = Outputs::default();
    network(&outputs, Change::Nothing)
        .and_then(|mut system| system.record(&file.0).replace_recordings().run())
        .unwrap();
    Arc::try_unwrap(outputs).unwrap().into_inner().unwrap()
}

fn replay(
    recording: &Recording,
    change: Change,
) -> (luna::Result<luna::Report>, Vec<(&'static str, u64)>) {
    let outputs = Outputs::default();
    let report = network(&outputs, change).and_then(|mut system| system.replay(recording).run());
    let outputs = std::mem::take(&mut *outputs.lock().unwrap());
    (report, outputs)
}

/// Writes other bytes in place of the file's.
fn write(file: &TempFile, bytes: &[u8]) {
    std::fs::write(&file.0, bytes).unwrap();
}

fn word(bytes: &[u8]) -> u32 {
    u32::from_le_bytes(bytes[..4].try_into().unwrap())
}

/// The ranges of what the checksums of the blocks are of.
fn blocks(file: &[u8]) -> Vec<std::ops::Range<usize>> {
    let mut blocks = Vec::new();
    let mut at = 14;
    while at < file.len() {
        let end = at + 8 + word(&file[at..]) as usize;
        blocks.push(at + 8..end);
        at = end;
    }
    blocks
}

/// Makes the checksum of block `number` right.
fn mend(file: &mut [u8], number: usize, block: std::ops::Range<usize>) {
    let mut hasher = crc32fast::Hasher::new();
    hasher.update(&(number as u64 + 1).to_le_bytes());
    hasher.update(&file[block.clone()]);
    let sum = hasher.finalize().to_le_bytes();
    file[block.start - 4..block.start].copy_from_slice(&sum);
}

#[test]
fn a_changed_byte_is_noticed_wherever_it_is() {
    let file = TempFile::new("byte");
    recorded(&file);
    let whole = std::fs::read(&file.0).unwrap();
    for at in 0..whole.len() {
        for bit in [0, 3, 7] {
            let mut changed = whole.clone();
            changed[at] ^= 1 << bit;
            write(&file, &changed);
            assert!(Recording::open(&file.0).is_err(), "byte {at}, bit {bit}");
        }
    }
}

#[test]
fn a_byte_that_is_changed_with_its_checksum_is_noticed_or_changes_nothing() {
    let file = TempFile::new("mended");
    let outputs = recorded(&file);
    let whole = std::fs::read(&file.0).unwrap();
    let (mut noticed, mut harmless) = (0, 0);
    let blocks = blocks(&whole);
    let places = blocks.iter().enumerate().flat_map(|(number, block)| {
        let bits = move |at| [0, 6].map(|bit| (number, block, at, bit));
        block.clone().flat_map(bits)
    });
    // An odd part, so that both bits are met.
    for (number, block, at, bit) in sample(places, 5) {
        let mut changed = whole.clone();
        changed[at] ^= 1 << bit;
        mend(&mut changed, number, block.clone());
        write(&file, &changed);
        let replayed = Recording::open(&file.0)
            .map_err(Error::from)
            .map(|recording| replay(&recording, Change::Nothing));
        match replayed {
            Ok((Ok(_), again)) => {
                assert_eq!(again, outputs, "byte {at}, bit {bit}");
                harmless += 1;
            }
            Ok((Err(error), _)) | Err(error) => {
                assert!(
                    matches!(error, Error::Record(_)),
                    "byte {at}, bit {bit}: {error}"
                );
                noticed += 1;
            }
        }
    }
    // A stamp that leaves the order as it was says the same.
    assert!(
        noticed > harmless,
        "{noticed} noticed, {harmless} without meaning"
    );
}

#[test]
fn a_file_that_ends_too_early_is_noticed_and_replayed_up_to_there() {
    let file = TempFile::new("truncated");
    recorded(&file);
    let whole = std::fs::read(&file.0).unwrap();
    let replayed: Vec<_> = sample(0..whole.len(), 4).collect();
    for length in 0..whole.len() {
        write(&file, &whole[..length]);
        let error = Recording::open(&file.0).unwrap_err();
        assert!(
            matches!(
                error,
                RecordError::Truncated { .. } | RecordError::NoRecording
            ),
            "{length}: {error}"
        );
        match Recording::salvage(&file.0) {
            Ok((recording, wrong)) => {
                assert_eq!(wrong, Some(error));
                assert!(!recording.is_whole());
                if !recording.system().is_empty() && replayed.contains(&length) {
                    // The events of `first` may be lost, and those of `second` not: without a
                    // stamp of the first communications, `second` comes first then.
                    match replay(&recording, Change::Nothing).0 {
                        Ok(_) => {}
                        Err(Error::Record(RecordError::Diverged(found))) => {
                            assert_eq!(found.process, "sink", "{length}: {found}");
                        }
                        Err(other) => panic!("{length}: {other}"),
                    }
                }
            }
            Err(other) => assert_eq!(other, error),
        }
    }
}

#[test]
fn other_files_are_no_recordings() {
    let file = TempFile::new("other");
    assert!(matches!(
        Recording::open(&file.0),
        Err(RecordError::File { .. })
    ));
    write(&file, b"ELF or anything");
    assert_eq!(
        Recording::open(&file.0).unwrap_err(),
        RecordError::NoRecording
    );
    recorded(&file);
    let mut later = std::fs::read(&file.0).unwrap();
    later[8] = 99;
    let mut hasher = crc32fast::Hasher::new();
    hasher.update(&0_u64.to_le_bytes());
    hasher.update(&later[..10]);
    let sum = hasher.finalize().to_le_bytes();
    later[10..14].copy_from_slice(&sum);
    write(&file, &later);
    assert_eq!(
        Recording::open(&file.0).unwrap_err(),
        RecordError::Version(99)
    );
    let nowhere = PathBuf::from("/nowhere/at/all");
    let run = network(&Outputs::default(), Change::Nothing)
        .and_then(|mut system| system.record(nowhere).run());
    assert!(matches!(run, Err(Error::Record(RecordError::File { .. }))));
    let of_the_logger = std::env::temp_dir().join("luna-record-damage.luna");
    let run = network(&Outputs::default(), Change::Nothing)
        .and_then(|mut system| system.record(&of_the_logger).run());
    let refused = RecordError::NameOfTheLogger {
        path: of_the_logger.display().to_string(),
    };
    assert_eq!(run.map(drop), Err(Error::Record(refused)));
    assert!(!of_the_logger.exists());
}

#[test]
fn a_changed_program_is_noticed() {
    let file = TempFile::new("program");
    let outputs = recorded(&file);
    let recording = Recording::open(&file.0).unwrap();
    let (same, again) = replay(&recording, Change::Nothing);
    assert_eq!((same.map(drop), again), (Ok(()), outputs));
    for change in [
        Change::Output,
        Change::OtherOutput,
        Change::MoreOutputs,
        Change::Guards,
        Change::FewerSends,
        Change::LooksAtTheClock,
        Change::NoTry,
        Change::Returns,
        Change::GoesOn,
    ] {
        match replay(&recording, change).0 {
            Err(Error::Record(RecordError::Diverged(at))) => {
                let processes: &[&str] = match change {
                    // The sink first misses the process with the earlier last send.
                    Change::FewerSends => &["second", "sink"],
                    Change::GoesOn => &["first"],
                    _ => &["sink"],
                };
                assert!(processes.contains(&&*at.process), "{change:?}: {at}");
                assert_eq!(
                    at.output.is_some(),
                    matches!(
                        change,
                        Change::Output | Change::OtherOutput | Change::MoreOutputs
                    ),
                    "{change:?}: {at}"
                );
            }
            other => panic!("{change:?}: {other:?}"),
        }
    }
    for change in [
        Change::SystemName,
        Change::ProcessName,
        Change::OneMore,
        Change::OneLess,
    ] {
        let replayed = replay(&recording, change).0;
        assert!(
            matches!(
                replayed,
                Err(Error::Record(RecordError::OtherProgram { .. }))
            ),
            "{change:?}: {replayed:?}"
        );
    }
}

#[test]
fn what_does_not_fit_is_counted_and_the_replay_goes_up_to_there() {
    let file = TempFile::new("overflow");
    let count = 1000;
    let system = || {
        let mut system = System::new("talker");
        let main = system.executor("main").build()?;
        main.process("talker").spawn(async move {
            for number in 0..count {
                replay::output("number", &number);
            }
            luna::after(std::time::Duration::ZERO).await;
            Ok(())
        })?;
        Ok::<_, Error>(system)
    };
    let report = system()
        .and_then(|mut system| system.record_room(&file.0, 256).run())
        .unwrap();
    let recorded = report.record.unwrap();
    assert!(recorded.lost > 0 && recorded.events > 0, "{recorded:?}");
    // The outputs, and that the process has returned.
    assert_eq!(recorded.events + recorded.lost, count + 1);
    let recording = Recording::open(&file.0).unwrap();
    assert!(!recording.is_whole());
    assert_eq!(recording.events(), recorded.events);
    let replayed = system()
        .and_then(|mut system| system.replay(&recording).run())
        .unwrap();
    assert_eq!(replayed.record.unwrap().events, recorded.events);
}
