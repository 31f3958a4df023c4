//! Blackboards.

use crate::child::Program;
use crate::shared::{is_long, watchdog};
use crate::{Block, block, channel_name, files};
use luna_ipc::{Blackboard, IpcError, WriterState};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering::SeqCst};

/// Large enough that a thread which loses its core is mostly in the middle of a copy.
type Large = [u64; WORDS];
const WORDS: usize = 8192;

#[test]
fn readers_see_the_newest_value_its_number_and_its_age() {
    let name = channel_name("board-values");
    let board = Blackboard::new(&name)
        .entry("block", block(0))
        .entry("speed", 0.5_f32);
    let mut writer = board.write().unwrap();
    let mut blocks = writer.take::<Block>("block").unwrap();
    let reader = Blackboard::new(&name).read().unwrap();
    let other = Blackboard::new(&name).read().unwrap();
    assert_eq!(reader.keys().collect::<Vec<_>>(), ["block", "speed"]);
    let entries = [&reader, &other].map(|reader| reader.entry::<Block>("block").unwrap());
    let mut last = 0;
    for number in 0..10 {
        for entry in &entries {
            let reading = entry.get().unwrap();
            assert_eq!((reading.value, reading.number), (block(number), number + 1));
            assert_eq!(reading.writer, WriterState::Open);
            assert!(reading.set.as_nanos() >= last);
            last = reading.set.as_nanos();
            assert!(reading.age().as_nanos() < u128::from(last));
        }
        blocks.set(block(number + 1));
    }
    let speed = other.entry::<f32>("speed").unwrap().get().unwrap();
    assert_eq!((speed.value, speed.number), (0.5, 1));
    // Its files go with the last one, and the readers keep the values.
    drop((writer, blocks));
    let reading = entries[0].get().unwrap();
    assert_eq!(
        (reading.value, reading.writer),
        (block(10), WriterState::Closed)
    );
    assert_eq!(files(&name).len(), 2);
    drop((reader, other, entries));
    assert!(files(&name).is_empty());
}

#[test]
fn keys_and_types_are_checked() {
    let name = channel_name("board-types");
    let why = |error: IpcError| error.to_string();
    let twice = Blackboard::new(&name).entry("a", 1_u8).entry("a", 1_u8);
    assert!(why(twice.write().unwrap_err()).contains("`a` is there twice"));
    let long = Blackboard::new(&name).entry(&"k".repeat(65), 1_u8);
    assert!(why(long.write().unwrap_err()).contains("longer than 64"));
    assert!(files(&name).is_empty());

    let mut writer = Blackboard::new(&name).entry("a", 1_u32).write().unwrap();
    let error = Blackboard::new(&name)
        .entry("a", 1_u32)
        .write()
        .unwrap_err();
    assert!(matches!(error, IpcError::Busy { .. }), "{error}");
    assert!(why(writer.take::<i32>("a").unwrap_err()).contains("`i32`"));
    let _entry = writer.take::<u32>("a").unwrap();
    assert!(why(writer.take::<u32>("a").unwrap_err()).contains("was taken"));
    let reader = Blackboard::new(&name).read().unwrap();
    let error = why(reader.entry::<f32>("a").unwrap_err());
    assert!(
        error.contains("`f32`") && error.contains("`u32`"),
        "{error}"
    );
    assert!(why(reader.entry::<u32>("b").unwrap_err()).contains("`b` is not there"));
    let newer = Blackboard::new(&name).layout_version(2).read().unwrap();
    assert!(why(newer.entry::<u32>("a").unwrap_err()).contains("layout version 2"));
    // A channel of that name is another thing.
    drop((reader, newer));
    let error = why(luna_ipc::receiver::<u32>(&name).unwrap_err());
    assert!(error.contains("`blackboard`"), "{error}");
    drop((writer, _entry));
    assert!(files(&name).is_empty());
}

#[test]
fn no_value_is_torn_and_none_goes_back() {
    let _watchdog = watchdog();
    let values = if is_long() { 20_000 } else { 3_000 };
    let name = channel_name("board-torn");
    let board = Blackboard::new(&name).entry::<Large>("large", [0; WORDS]);
    let mut writer = board.write().unwrap();
    let mut large = writer.take::<Large>("large").unwrap();
    let seen = Arc::new(AtomicU64::new(0));
    let readers: Vec<_> = (0..4)
        .map(|_| {
            let entry = Blackboard::new(&name)
                .read()
                .unwrap()
                .entry::<Large>("large");
            let (entry, seen) = (entry.unwrap(), seen.clone());
            std::thread::spawn(move || {
                let mut last = 0;
                while last < values {
                    // A reader that was kept from its core tries again.
                    let Ok(reading) = entry.get() else { continue };
                    let first = reading.value[0];
                    assert!(reading.value.iter().all(|word| *word == first), "torn");
                    assert_eq!(first + 1, reading.number);
                    assert!(first >= last);
                    if first > last {
                        seen.fetch_add(1, SeqCst);
                    }
                    last = first;
                }
            })
        })
        .collect();
    let mut number = 0;
    while readers.iter().any(|reader| !reader.is_finished()) {
        number += 1;
        large.set([number; WORDS]);
    }
    for reader in readers {
        reader.join().unwrap();
    }
    assert!(seen.load(SeqCst) > 2, "the sides overlapped");
}

#[test]
fn a_writer_that_is_killed_leaves_a_whole_value_and_the_next_one_goes_on() {
    let _watchdog = watchdog();
    let name = channel_name("board-killed");
    let mut last = 0;
    let mut kept = None;
    for round in 0..10 {
        let mut program = Program::start("board", &name, Path::new(""));
        program.wait_until_there();
        let reader = Blackboard::new(&name).read().unwrap();
        assert_eq!(reader.writer(), WriterState::Open);
        let entry = reader.entry::<Large>("large").unwrap();
        // Somewhere in a value.
        while entry.get().map_or(0, |reading| reading.number) < last + 100 + round {
            std::hint::spin_loop();
        }
        let watched = reader.clone();
        let (go, gone) = std::sync::mpsc::channel();
        let watch = std::thread::spawn(move || {
            luna::run(async move {
                let state = watched.watch();
                go.send(()).unwrap();
                assert_eq!(state.await?, WriterState::Died);
                Ok(())
            })
        });
        gone.recv().unwrap();
        program.kill();
        program.wait();
        watch.join().unwrap().unwrap();
        let reading = entry.get().unwrap();
        assert!(
            reading.value.iter().all(|word| *word == reading.value[0]),
            "torn"
        );
        assert_eq!(reading.writer, WriterState::Died);
        assert!(reading.number > last);
        last = reading.number;
        // A reader keeps the numbers for the next writer.
        kept = Some(entry);
    }
    drop(kept);
    assert!(files(&name).is_empty());
}

#[test]
fn a_writer_with_other_keys_is_refused_while_there_are_readers() {
    let name = channel_name("board-keys");
    let writer = Blackboard::new(&name).entry("a", 1_u32).write().unwrap();
    let reader = Blackboard::new(&name).read().unwrap();
    drop(writer);
    let other = Blackboard::new(&name).entry("a", 1_u32).entry("b", 2_u32);
    let error = other.write().unwrap_err().to_string();
    assert!(error.contains("key `b` differs"), "{error}");
    let same = Blackboard::new(&name).entry("a", 7_u32).write().unwrap();
    let reading = reader.entry::<u32>("a").unwrap().get().unwrap();
    assert_eq!(
        (reading.value, reading.number, reading.writer),
        (7, 2, WriterState::Open)
    );
    drop((same, reader));
    assert!(files(&name).is_empty());
}
