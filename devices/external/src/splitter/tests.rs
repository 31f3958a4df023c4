//! Each framing, however the bytes come.

use super::*;
use crate::Prefix;

const fn too_long(most: usize) -> Fault {
    Fault::TooLong { most }
}

type Got = Vec<Result<Vec<u8>, Fault>>;

/// The records of `bytes`, read in pieces of at most `piece` bytes.
fn split(framing: Framing, bytes: &[u8], piece: usize) -> Got {
    let mut splitter = Splitter::new(framing).unwrap();
    let mut got = Vec::new();
    let mut note = |record: Result<&[u8], BadRecord>| {
        let record = record.map(<[u8]>::to_vec);
        if let Err(bad) = record {
            assert_eq!(bad.number, got.len() as u64 + 1);
        }
        got.push(record.map_err(|bad| bad.fault));
    };
    let mut rest = bytes;
    while !rest.is_empty() {
        let room = splitter.room();
        let count = room.len().min(rest.len()).min(piece);
        assert!(count > 0, "there is room when nothing is whole");
        room[..count].copy_from_slice(&rest[..count]);
        rest = &rest[count..];
        splitter.filled(count);
        while let Some(record) = splitter.next_record() {
            note(record);
        }
    }
    if let Some(record) = splitter.finish() {
        note(record);
    }
    got
}

/// The same however the bytes come.
#[track_caller]
fn always(framing: Framing, bytes: &[u8], expected: &[Result<&[u8], Fault>]) {
    let expected: Got = expected.iter().map(|r| r.map(<[u8]>::to_vec)).collect();
    for piece in (1..20).chain([4095, 4096, 4097, usize::MAX]) {
        assert_eq!(
            split(framing, bytes, piece),
            expected,
            "in pieces of {piece}"
        );
    }
}

#[test]
fn fixed() {
    let framing = Framing::fixed(3);
    always(framing, b"", &[]);
    always(framing, b"abcdef", &[Ok(b"abc"), Ok(b"def")]);
    always(
        framing,
        b"abcde",
        &[Ok(b"abc"), Err(Fault::Cut { came: 2 })],
    );
}

#[test]
fn fixed_records_longer_than_a_read_ahead() {
    let record = [7; 5000];
    let both = [record, record].concat();
    always(Framing::fixed(5000), &both, &[Ok(&record), Ok(&record)]);
}

#[test]
fn lines() {
    let framing = Framing::lines(4);
    always(
        framing,
        b"a\n\nabcd\nabc\r\nabcd\r\n",
        &[Ok(b"a"), Ok(b""), Ok(b"abcd"), Ok(b"abc"), Ok(b"abcd")],
    );
    always(
        framing,
        b"abcde\nab\nabcde\r\nabcdefghijklm\n",
        &[
            Err(too_long(4)),
            Ok(b"ab"),
            Err(too_long(4)),
            Err(too_long(4)),
        ],
    );
    always(
        framing,
        b"a\nrest",
        &[Ok(b"a"), Err(Fault::Cut { came: 4 })],
    );
    always(framing, b"too long to be true", &[Err(too_long(4))]);
}

#[test]
fn a_last_line_without_an_end() {
    let framing = Framing::lines(4).or_end_of_file();
    always(framing, b"a\nrest", &[Ok(b"a"), Ok(b"rest")]);
    always(framing, b"a\n", &[Ok(b"a")]);
    always(framing, b"rest\r", &[Err(too_long(4))]);
}

#[test]
fn delimited_by_any_byte() {
    let framing = Framing::delimited(0, 8);
    always(framing, b"\r\n\0x\r\0", &[Ok(b"\r\n"), Ok(b"x\r")]);
}

#[test]
fn prefixed() {
    always(
        Framing::prefixed(Prefix::U8, 3),
        b"\x03abc\x00\x01z",
        &[Ok(b"abc"), Ok(b""), Ok(b"z")],
    );
    always(
        Framing::prefixed(Prefix::U16Big, 300),
        b"\x00\x02ab\x00\x01c",
        &[Ok(b"ab"), Ok(b"c")],
    );
    always(
        Framing::prefixed(Prefix::U32Little, 3),
        b"\x04\0\0\0long\x02\0\0\0ok",
        &[Err(too_long(3)), Ok(b"ok")],
    );
    always(
        Framing::prefixed(Prefix::U16Little, 3),
        b"\x01\0a\x03\0bc",
        &[Ok(b"a"), Err(Fault::Cut { came: 4 })],
    );
    // Cut within the prefix; within what is skipped.
    always(
        Framing::prefixed(Prefix::U32Big, 3),
        b"\0\0",
        &[Err(Fault::Cut { came: 2 })],
    );
    always(
        Framing::prefixed(Prefix::U8, 3),
        b"\xffabc",
        &[Err(too_long(3))],
    );
}

#[test]
fn prefixes_say_their_greatest_length() {
    for (prefix, bytes) in [
        (Prefix::U8, &b"\xff"[..]),
        (Prefix::U16Big, b"\x01\x02"),
        (Prefix::U16Little, b"\x02\x01"),
        (Prefix::U32Big, b"\x01\x02\x03\x04"),
        (Prefix::U32Little, b"\x04\x03\x02\x01"),
    ] {
        let length = prefix.read(bytes).unwrap();
        let mut again = [0; 4];
        prefix.write(length as usize, &mut again);
        assert_eq!(&again[..prefix.size()], bytes);
        assert!(length == 0xff || length == 0x0102 || length == 0x0102_0304);
    }
}

#[test]
fn chunks_and_packets_are_what_is_read() {
    assert_eq!(
        split(Framing::chunks(4), b"abcdef", 4),
        [Ok(b"abcd".to_vec()), Ok(b"ef".to_vec())]
    );
    let mut splitter = Splitter::new(Framing::packets(4)).unwrap();
    for (packet, expected) in [
        (&b"abcd"[..], Ok(&b"abcd"[..])),
        (b"abcde", Err(too_long(4))),
        (b"x", Ok(b"x")),
    ] {
        splitter.room()[..packet.len()].copy_from_slice(packet);
        splitter.filled(packet.len());
        let got = splitter.next_record().unwrap();
        assert_eq!(got.map_err(|bad| bad.fault), expected);
        assert_eq!(splitter.next_record(), None);
    }
    assert_eq!(splitter.finish(), None);
}
