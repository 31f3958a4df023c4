//! External channels: broken input is reported where it occurs, and the data around it is kept.

#![cfg(unix)]

use crate::common;
use crate::external::run_beside_thread;
use common::{PLACEMENTS, Random, with_ends};
use luna::Error;
use luna::external::{BadRecord, Fault, Frame, Framing, FromBytes, LinkError, Malformed, Prefix};
use std::io::Write;

/// A digit.
#[derive(Debug, PartialEq, Clone, Copy)]
struct Digit(u8);

impl FromBytes for Digit {
    fn from_bytes(bytes: &[u8]) -> Result<Digit, Malformed> {
        match bytes {
            [digit @ b'0'..=b'9'] => Ok(Digit(digit - b'0')),
            _ => Err(Malformed("it is no digit")),
        }
    }
}

/// What a receiver gets of a file with these bytes, and how the link ended.
fn read<T: FromBytes + Send + 'static>(
    place: common::Placement,
    bytes: &[u8],
    framing: Framing,
) -> (Vec<T>, luna::Result<()>) {
    let (near, mut far) = std::io::pipe().unwrap();
    far.write_all(bytes).unwrap();
    drop(far);
    let (sender, records) = luna::channel::<T>();
    let (result, results) = std::sync::mpsc::channel();
    let link = luna::external::input(near, sender, framing);
    let reader = async move {
        let mut got = Vec::new();
        loop {
            match records.recv().await {
                Ok(record) => got.push(record),
                Err(error) => {
                    // The same holds for a link that fails: what it has sent stays received, and
                    // what is buffered stays too.
                    assert!(error.is_closed());
                    result.send(got).map_err(|_| Error::Closed)?;
                    return Ok(());
                }
            }
        }
    };
    let outcome = run_beside_thread(place, "input", link, reader).map(drop);
    (results.recv().unwrap(), outcome)
}

#[track_caller]
fn assert_bad(outcome: luna::Result<()>, number: u64, fault: Fault) {
    match outcome {
        Err(Error::Process { name, source }) => {
            assert_eq!(name, "input");
            match *source {
                Error::External(LinkError::Record(bad)) => {
                    assert_eq!((bad.number, bad.fault), (number, fault));
                }
                other => panic!("{other:?}"),
            }
        }
        other => panic!("{other:?}"),
    }
}

#[test]
fn a_plain_channel_ends_at_the_first_broken_record() {
    let Some(_watch) = with_ends() else { return };
    let malformed = Fault::Malformed(Malformed("it is no digit"));
    for place in PLACEMENTS {
        for (bytes, framing, good, number, fault) in [
            (&b"1\n2\nx\n4\n"[..], Framing::lines(3), 2, 3, malformed),
            (
                b"1\n2222222\n3\n",
                Framing::lines(3),
                1,
                2,
                Fault::TooLong { most: 3 },
            ),
            (b"1\n2\n3", Framing::lines(3), 2, 3, Fault::Cut { came: 1 }),
            (
                b"\x00\x011\x00",
                Framing::prefixed(Prefix::U16Big, 1),
                1,
                2,
                Fault::Cut { came: 1 },
            ),
            (
                b"\x011\xff2",
                Framing::prefixed(Prefix::U8, 1),
                1,
                2,
                Fault::TooLong { most: 1 },
            ),
        ] {
            let (got, outcome) = read::<Digit>(place, bytes, framing);
            let expected: Vec<_> = (1..=good).map(Digit).collect();
            assert_eq!(got, expected);
            assert_bad(outcome, number, fault);
        }
        let (got, outcome) = read::<[u8; 2]>(place, b"abcde", Framing::fixed(2));
        assert_eq!(got, [*b"ab", *b"cd"]);
        assert_bad(outcome, 3, Fault::Cut { came: 1 });
    }
}

#[test]
fn a_channel_of_results_goes_on() {
    let Some(_watch) = with_ends() else { return };
    for place in PLACEMENTS {
        let (got, outcome) = read::<Result<Digit, BadRecord>>(
            place,
            b"1\nx\n22222222\n4\n\n6\n7",
            Framing::lines(3),
        );
        outcome.unwrap();
        let malformed = Fault::Malformed(Malformed("it is no digit"));
        let got: Vec<_> = got
            .into_iter()
            .zip(1..)
            .map(|(record, number)| {
                record.map_err(|bad| {
                    assert_eq!(bad.number, number);
                    bad.fault
                })
            })
            .collect();
        assert_eq!(
            got,
            [
                Ok(Digit(1)),
                Err(malformed),
                Err(Fault::TooLong { most: 3 }),
                Ok(Digit(4)),
                Err(malformed),
                Ok(Digit(6)),
                Err(Fault::Cut { came: 1 }),
            ]
        );
    }
}

#[test]
fn a_record_that_no_frame_holds() {
    let Some(_watch) = with_ends() else { return };
    let (got, outcome) = read::<Frame<2>>(PLACEMENTS[0], b"ab\nabc\n", Framing::lines(3));
    assert_eq!(got, [Frame::new(b"ab").unwrap()]);
    let fault = Fault::Malformed(Malformed("it does not fit in its `Frame`"));
    assert_bad(outcome, 2, fault);
}

/// Random bytes, however long the file: each byte is in a record, a delimiter, or a record that is
/// reported as broken.
#[test]
fn no_byte_is_lost_in_silence() {
    let Some(_watch) = with_ends() else { return };
    let mut random = Random::seeded();
    for _ in 0..20 {
        let length = random.below(20_000) as usize;
        let bytes: Vec<u8> = (0..length).map(|_| random.below(24) as u8 + 1).collect();
        let most = 1 + random.below(40) as usize;
        let framing = Framing::delimited(7, most).or_end_of_file();
        let (got, outcome) = read::<Result<Frame<64>, BadRecord>>(PLACEMENTS[1], &bytes, framing);
        outcome.unwrap();
        let mut expected: Vec<&[u8]> = bytes.split(|byte| *byte == 7).collect();
        if expected.last().is_some_and(|last| last.is_empty()) {
            expected.pop();
        }
        assert_eq!(got.len(), expected.len());
        for (record, expected) in got.iter().zip(expected) {
            match record {
                Ok(record) => assert_eq!(&**record, expected),
                Err(bad) => {
                    assert_eq!(bad.fault, Fault::TooLong { most });
                    assert!(expected.len() > most);
                }
            }
        }
    }
}

#[test]
fn a_value_that_no_reader_would_understand() {
    let Some(_watch) = with_ends() else { return };
    for place in PLACEMENTS {
        let (mut far, near) = std::io::pipe().unwrap();
        let (source, outgoing) = luna::channel::<Frame<8>>();
        let link = luna::external::output(outgoing, near, Framing::lines(8));
        let sends = async move {
            source.send(Frame::new(b"good").unwrap()).await?;
            source.send(Frame::new(b"bad\nline").unwrap()).await?;
            let late = Frame::new(b"late").unwrap();
            let error = source.send(late).await.unwrap_err();
            assert!(error.is_closed() && error.into_inner() == late);
            Ok(())
        };
        let fault = Fault::HoldsDelimiter { delimiter: b'\n' };
        let outcome = run_beside_thread(place, "input", link, sends);
        assert_bad(outcome.map(drop), 2, fault);
        let mut text = String::new();
        std::io::Read::read_to_string(&mut far, &mut text).unwrap();
        assert_eq!(text, "good\n");
    }
}
