//! The format: what was written is read. Any other input is an error with its offset, never a
//! panic, and never uses unbounded memory.

use luna_logger::Level;
use luna_logger::format::{
    ClockBase, Event, Losing, ReadErrorKind, Reader, Record, RunsOn, SignalInfo, Subject, Type,
    Value, Values, Writer,
};
use proptest::prelude::*;

const NAMES: [&str; 3] = ["arm/angle", "ü", ""];

/// A record from its kind and two numbers. Signals 0 to 2 are declared before.
fn record(kind: u8, small: u32, large: u64, bytes: &[u8; 24]) -> Record<'_> {
    let name = NAMES[small as usize % NAMES.len()];
    match kind {
        0 => Record::Session {
            system: name,
            clock: ClockBase::Virtual,
            written_by: "test",
        },
        1 => Record::Thread {
            number: small,
            name,
        },
        2 => Record::Sample {
            signal: small % 3,
            time: large,
            values: match small % 3 {
                0 => Values::from_bytes(Type::F64, &bytes[..8]),
                1 => Values::from_bytes(Type::I16, &bytes[..6]),
                _ => Values::from_bytes(Type::U8, &bytes[..1]),
            },
        },
        3 => Record::Message {
            thread: small,
            time: large,
            level: Level::Warn,
            process: small,
            truncated: large & 1 != 0,
            target: name,
            text: "the text",
        },
        4 => Record::Event(Event {
            thread: small,
            time: large,
            code: small as u16,
            subject: small,
            arguments: [large, 1],
        }),
        5 => Record::Name {
            subject: Subject::Process,
            number: small,
            parent: 0,
            name,
            runs_on: small.is_multiple_of(2).then_some(RunsOn {
                executor: small,
                level: small as u8,
            }),
        },
        6 => Record::Losses {
            of: Losing::Events(small),
            lost: large,
        },
        7 => Record::Epoch {
            time: large,
            unix: -(small as i64),
        },
        _ => Record::End { time: large },
    }
}

fn declarations() -> [Record<'static>; 3] {
    [(Type::F64, 1), (Type::I16, 3), (Type::U8, 1)].map({
        let mut number = 0;
        move |(element_type, elements)| {
            number += 1;
            Record::Signal(SignalInfo {
                number: number - 1,
                element_type,
                elements,
                name: NAMES[number as usize - 1],
                unit: "rad",
                description: "",
            })
        }
    })
}

/// A file of the records, with a block's end where requested.
fn file(steps: &[(u8, u32, u64, bool)], bytes: &[u8; 24]) -> Vec<u8> {
    let mut writer = Writer::new(Vec::new()).unwrap();
    for declaration in &declarations() {
        writer.put(declaration).unwrap();
    }
    for (kind, small, large, ends_block) in steps {
        writer.put(&record(*kind, *small, *large, bytes)).unwrap();
        if *ends_block {
            writer.end_block().unwrap();
        }
    }
    writer.finish().unwrap()
}

/// The records' texts, and the error at the end.
fn read(bytes: &[u8]) -> (Vec<String>, Option<luna_logger::format::ReadError>) {
    let mut records = Vec::new();
    let mut reader = match Reader::new(bytes) {
        Ok(reader) => reader,
        Err(error) => return (records, Some(error)),
    };
    loop {
        match reader.next() {
            Ok(Some(record)) => records.push(format!("{record:?}")),
            Ok(None) => return (records, None),
            Err(error) => {
                assert!(reader.next().unwrap().is_none(), "nothing follows an error");
                return (records, Some(error));
            }
        }
    }
}

fn steps() -> impl Strategy<Value = Vec<(u8, u32, u64, bool)>> {
    prop::collection::vec((0u8..9, any::<u32>(), any::<u64>(), prop::bool::ANY), 0..20)
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 64, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn what_was_written_is_read(steps in steps(), bytes in any::<[u8; 24]>()) {
        let (read, error) = read(&file(&steps, &bytes));
        prop_assert!(error.is_none(), "{error:?}");
        let declared = declarations().map(|record| format!("{record:?}"));
        let written = steps.iter().map(|(kind, small, large, _)| {
            format!("{:?}", record(*kind, *small, *large, &bytes))
        });
        prop_assert_eq!(read, declared.into_iter().chain(written).collect::<Vec<_>>());
    }

    /// Every length that a file can be cut to.
    #[test]
    fn a_truncated_file_gives_all_complete_blocks(steps in steps(), bytes in any::<[u8; 24]>()) {
        let whole = file(&steps, &bytes);
        let (all, _) = read(&whole);
        let mut before = 0;
        for length in 1..whole.len() {
            let (some, error) = read(&whole[..length]);
            prop_assert_eq!(&some[..], &all[..some.len()]);
            prop_assert!(some.len() >= before, "less is read of a longer file");
            before = some.len();
            // At a block's end it looks like a whole one.
            if let Some(error) = error {
                prop_assert!(error.is_truncated(), "{error}");
                prop_assert!(error.offset() < length as u64);
            }
        }
    }

    /// A changed byte is found by the checksum, or by the block structure; the records before it
    /// are valid.
    #[test]
    fn a_changed_byte_is_an_error_with_its_place(
        steps in steps(),
        bytes in any::<[u8; 24]>(),
        at in any::<prop::sample::Index>(),
        change in 1u8..=255,
    ) {
        let whole = file(&steps, &bytes);
        let (all, _) = read(&whole);
        let mut changed = whole.clone();
        let at = at.index(whole.len());
        changed[at] ^= change;
        let (some, error) = read(&changed);
        prop_assert_eq!(&some[..], &all[..some.len()]);
        // The minor version and the free bytes of the head mean nothing to this reader.
        if !(10..16).contains(&at) {
            let error = error.expect("a changed byte was not found");
            prop_assert!(error.offset() <= at as u64, "{error} though byte {at} is wrong");
        }
    }

    #[test]
    fn anything_at_all_is_read_without_a_panic(bytes in prop::collection::vec(any::<u8>(), 0..400)) {
        read(&bytes);
        let mut recording = Writer::new(Vec::new()).unwrap().finish().unwrap();
        recording.extend_from_slice(&bytes);
        read(&recording);
    }

    /// Malformed records in a block with a correct checksum.
    #[test]
    fn any_records_are_read_without_a_panic(records in prop::collection::vec(any::<u8>(), 1..400)) {
        read(&around(&records));
    }
}

/// All records of all complete blocks, and how many errors were found.
fn read_on(bytes: &[u8]) -> (Vec<String>, usize, u64) {
    let (mut records, mut errors) = (Vec::new(), 0);
    let mut reader = Reader::new(bytes).unwrap();
    loop {
        match reader.next() {
            Ok(Some(record)) => records.push(format!("{record:?}")),
            Ok(None) => return (records, errors, reader.missing_blocks()),
            Err(_) => {
                errors += 1;
                if reader.resume().unwrap().is_none() {
                    return (records, errors, reader.missing_blocks());
                }
            }
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 64, failure_persistence: None, ..ProptestConfig::default() })]

    /// One block is changed, cut, or preceded by other bytes: all other blocks are read.
    #[test]
    fn after_damage_all_other_blocks_are_read(
        times in prop::collection::vec(any::<u64>(), 1..12),
        which in any::<prop::sample::Index>(),
        at in any::<prop::sample::Index>(),
        cut in any::<prop::sample::Index>(),
        between in prop::collection::vec(prop_oneof![Just(b'L'), Just(b'B'), any::<u8>()], 0..40),
    ) {
        let blocks: Vec<Vec<u8>> = {
            let mut encoder = luna_logger::format::Encoder::new();
            let block = |time: &u64| {
                encoder.put(&Record::End { time: *time });
                let block = encoder.block().to_vec();
                encoder.next();
                block
            };
            times.iter().map(block).collect()
        };
        let all: Vec<String> = times.iter().map(|time| format!("{:?}", Record::End { time: *time })).collect();
        let which = which.index(blocks.len());
        let others: Vec<String> = (0..all.len()).filter(|n| *n != which).map(|n| all[n].clone()).collect();
        let file_with = |damaged: &[u8]| {
            let mut file = luna_logger::format::Encoder::head().to_vec();
            for (n, block) in blocks.iter().enumerate() {
                file.extend_from_slice(if n == which { damaged } else { block });
            }
            file
        };
        let at = at.index(blocks[which].len());
        let mut changed = blocks[which].clone();
        changed[at] ^= 0x10;
        let (read, errors, missing) = read_on(&file_with(&changed));
        prop_assert_eq!(&read, &others);
        prop_assert!(errors > 0);
        prop_assert_eq!(missing, u64::from(which + 1 < blocks.len()));
        let short = &blocks[which][..cut.index(blocks[which].len())];
        // The following bytes may be those that were cut off: then only the following block is
        // damaged.
        let follows = [short, &blocks[which + 1..].concat()].concat();
        if !follows.starts_with(&blocks[which]) {
            prop_assert_eq!(&read_on(&file_with(short)).0, &others);
        }
        let longer = [&between[..], &blocks[which]].concat();
        prop_assert_eq!(&read_on(&file_with(&longer)).0, &all);
    }

    #[test]
    fn anything_at_all_is_gone_over_without_a_panic(bytes in prop::collection::vec(any::<u8>(), 0..400), records in prop::collection::vec(any::<u8>(), 1..100)) {
        let whole = around(&records);
        read_on(&[&whole[..], &bytes, &whole[16..], &bytes].concat());
    }
}

/// A file with one block of these bytes.
fn around(records: &[u8]) -> Vec<u8> {
    let mut file = Writer::new(Vec::new()).unwrap().finish().unwrap();
    let sequence = 0u32.to_le_bytes();
    let length = (records.len() as u32).to_le_bytes();
    file.extend_from_slice(b"LBLK");
    file.extend_from_slice(&sequence);
    file.extend_from_slice(&length);
    let content = [&sequence[..], &length, records].concat();
    file.extend_from_slice(&plain_crc32(&content).to_le_bytes());
    file.extend_from_slice(records);
    file
}

/// Bit by bit, as the standard has it.
fn plain_crc32(bytes: &[u8]) -> u32 {
    !bytes.iter().fold(!0u32, |state, byte| {
        (0..8).fold(state ^ u32::from(*byte), |state, _| {
            (state >> 1) ^ if state & 1 != 0 { 0xEDB8_8320 } else { 0 }
        })
    })
}

#[test]
fn the_bytes_of_a_file_are_those_of_the_documentation() {
    let mut writer = Writer::new(Vec::new()).unwrap();
    writer.put(&declarations()[1]).unwrap();
    let values = [1i16, -1, 300].map(i16::to_le_bytes).concat();
    for time in [1000, 990] {
        writer
            .put(&Record::Sample {
                signal: 1,
                time,
                values: Values::from_bytes(Type::I16, &values),
            })
            .unwrap();
    }
    let file = writer.finish().unwrap();
    let mut records = vec![3, 11, 1, 3, 3, 2, 0xC3, 0xBC, 3, b'r', b'a', b'd', 0];
    // The time is twice the distance, in seven bits a byte; one back is odd.
    records.extend([4, 9, 1, 0xD0, 0x0F, 1, 0, 0xFF, 0xFF, 0x2C, 1]);
    records.extend([4, 8, 1, 19, 1, 0, 0xFF, 0xFF, 0x2C, 1]);
    assert_eq!(file, around(&records));
    assert_eq!(file[..16], *b"\x89LUNA\r\n\x1a\x01\0\0\0\0\0\0\0");
}

#[test]
fn records_and_fields_of_a_later_version_are_skipped() {
    // A kind 200; an end with more bytes behind its time; a name of an unknown subject; a signal of
    // an unknown type with a sample.
    let records = [
        &[200, 3, 1, 2, 3][..],
        &[7, 4, 99, 1, 0, 0],
        &[3, 6, 5, 77, 1, 0, 0, 0],
        &[4, 4, 5, 2, 9, 9],
        &[10, 3, 14, 1, 2],
    ]
    .concat();
    let (records, error) = read(&around(&records));
    assert!(error.is_none(), "{error:?}");
    assert_eq!(records, ["End { time: 7 }"]);
}

#[test]
fn wrong_heads_and_blocks_say_what_is_wrong_and_where() {
    let good = around(&[10, 1, 14]);
    let with = |at: usize, bytes: &[u8]| {
        let mut file = good.clone();
        file[at..at + bytes.len()].copy_from_slice(bytes);
        read(&file).1.unwrap()
    };
    let error = with(8, &[9]);
    assert!(
        matches!(error.kind(), ReadErrorKind::Version { found: (9, 0) }),
        "{error}"
    );
    assert_eq!(error.offset(), 8);
    assert!(matches!(with(3, b"X").kind(), ReadErrorKind::NotARecording));
    assert!(matches!(with(16, b"X").kind(), ReadErrorKind::NoBlock));
    assert!(matches!(with(34, &[0]).kind(), ReadErrorKind::Checksum));
    // It is refused before there is memory for it.
    let error = with(24, &u32::MAX.to_le_bytes());
    assert!(
        matches!(
            error.kind(),
            ReadErrorKind::BlockTooLong { length: u32::MAX }
        ),
        "{error}"
    );
    assert_eq!(error.offset(), 16);
    // One block twice.
    let error = read(&[&good[..], &good[16..]].concat()).1.unwrap();
    assert!(
        matches!(
            error.kind(),
            ReadErrorKind::Sequence {
                expected: 1,
                found: 0
            }
        ),
        "{error}"
    );
    let text = |records: &[u8]| read(&around(records)).1.unwrap().to_string();
    for (records, what) in [
        (&[10][..], "ends too early (at byte 32)"),
        (&[10, 2, 0], "longer than its block (at byte 32)"),
        (&[10, 0], "ends too early (at byte 32)"),
        (
            &[10, 11, 255, 255, 255, 255, 255, 255, 255, 255, 255, 2, 0],
            "64 bits (at byte 32)",
        ),
        (&[10, 1, 14, 4, 3, 9, 0, 0], "not declared (at byte 35)"),
        (&[3, 6, 0, 11, 17, 0, 0, 0], "too many (at byte 32)"),
        (&[3, 6, 0, 11, 0, 0, 0, 0], "too many (at byte 32)"),
        (
            &[3, 9, 0xFF, 0xFF, 0xFF, 0x0F, 11, 1, 0, 0, 0],
            "too high (at byte 32)",
        ),
        (&[2, 4, 0, 2, 0xC3, 0x28], "UTF-8 (at byte 32)"),
    ] {
        assert!(text(records).contains(what), "{}", text(records));
    }
}

#[test]
fn values_are_exact() {
    let of = |of: Type, bytes: &[u8]| Values::from_bytes(of, bytes).iter().collect::<Vec<_>>();
    assert_eq!(
        of(Type::Bool, &[0, 1]),
        [Value::Bool(false), Value::Bool(true)]
    );
    assert_eq!(of(Type::I8, &[0xFF]), [Value::Signed(-1)]);
    assert_eq!(
        of(Type::U32, &[1, 0, 0, 0x80]),
        [Value::Unsigned(0x8000_0001)]
    );
    assert_eq!(
        of(Type::I64, &i64::MIN.to_le_bytes()),
        [Value::Signed(i64::MIN)]
    );
    assert_eq!(
        of(Type::F32, &0.1f32.to_le_bytes()),
        [Value::Float(f64::from(0.1f32))]
    );
    assert_eq!(of(Type::F64, &[0; 15]).len(), 1);
}
