//! Any bytes as a file: the reader must not panic, nor use more memory than a block.
//!
//! The input is read once as a whole file, and once as the records of a block with a valid header.
//! A fuzzer would not find a valid checksum.
#![no_main]

use libfuzzer_sys::fuzz_target;
use luna_logger::format::{MAX_IN_BLOCK, Reader, Record, Writer};

fn read(bytes: &[u8]) {
    let Ok(mut reader) = Reader::new(bytes) else {
        return;
    };
    loop {
        match reader.next() {
            Ok(Some(record)) => {
                // Looks at all that it holds.
                let _ = format!("{record:?}");
                if let Record::Sample { values, .. } = record {
                    assert_eq!(values.iter().count(), values.len());
                    assert!(!values.is_empty());
                }
            }
            Ok(None) => return,
            Err(error) => {
                assert!(error.offset() <= bytes.len() as u64);
                assert!(matches!(reader.next(), Ok(None)));
                if reader.resume().expect("memory can be read").is_none() {
                    return;
                }
            }
        }
    }
}

/// Bit by bit, as the standard has it.
fn crc32(bytes: &[u8]) -> u32 {
    !bytes.iter().fold(!0u32, |state, byte| {
        (0..8).fold(state ^ u32::from(*byte), |state, _| {
            (state >> 1) ^ if state & 1 != 0 { 0xEDB8_8320 } else { 0 }
        })
    })
}

fuzz_target!(|input: &[u8]| {
    read(input);
    let records = &input[..input.len().min(MAX_IN_BLOCK)];
    let mut file = Writer::new(Vec::new())
        .and_then(Writer::finish)
        .expect("a vector takes all");
    let numbers = [0u32.to_le_bytes(), (records.len() as u32).to_le_bytes()].concat();
    file.extend_from_slice(b"LBLK");
    file.extend_from_slice(&numbers);
    file.extend_from_slice(&crc32(&[&numbers, records].concat()).to_le_bytes());
    file.extend_from_slice(records);
    read(&file);
});
