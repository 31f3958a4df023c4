//! Reads as much of a Perfetto trace as the tests of flows need: tracks, and what flows between
//! them.

use flate2::read::GzDecoder;
use std::collections::{BTreeSet, HashMap};
use std::fs::File;
use std::io::Read;
use std::path::Path;

/// A trace.
#[derive(Debug, Default)]
pub(crate) struct Trace {
    /// By their tracks.
    pub(crate) processes: HashMap<u64, String>,
    parents: HashMap<u64, u64>,
    /// The time and the track of each begin and each end.
    begins: HashMap<u64, (u64, u64)>,
    ends: HashMap<u64, (u64, u64)>,
}

impl Trace {
    fn process(&self, mut track: u64) -> &str {
        while let Some(parent) = self.parents.get(&track) {
            track = *parent;
        }
        &self.processes[&track]
    }

    /// What flows from one process to another: its begin and end, by the process' name and time.
    pub(crate) fn flows_between_processes(&self) -> BTreeSet<[(String, u64); 2]> {
        let flows = self.ends.iter().filter_map(|(flow, end)| {
            let begin = self.begins.get(flow)?;
            let flow = [begin, end].map(|(time, track)| (self.process(*track).to_owned(), *time));
            (flow[0].0 != flow[1].0).then_some(flow)
        });
        flows.collect()
    }
}

/// A field: its number, and what is in it.
enum Field<'a> {
    Number(u64),
    Bytes(&'a [u8]),
}

fn varint(bytes: &mut &[u8]) -> u64 {
    let mut value = 0;
    for shift in (0..).step_by(7) {
        let (first, rest) = bytes.split_first().expect("a whole number");
        *bytes = rest;
        value |= u64::from(first & 0x7f) << shift;
        if first & 0x80 == 0 {
            break;
        }
    }
    value
}

fn fields(mut bytes: &[u8]) -> Vec<(u64, Field<'_>)> {
    let mut fields = Vec::new();
    while !bytes.is_empty() {
        let key = varint(&mut bytes);
        let field = match key & 7 {
            0 => Field::Number(varint(&mut bytes)),
            1 => {
                let (value, rest) = bytes.split_first_chunk().expect("a whole field");
                bytes = rest;
                Field::Number(u64::from_le_bytes(*value))
            }
            2 => {
                let length = varint(&mut bytes) as usize;
                let (value, rest) = bytes.split_at(length);
                bytes = rest;
                Field::Bytes(value)
            }
            kind => panic!("a field of kind {kind}"),
        };
        fields.push((key >> 3, field));
    }
    fields
}

fn number(bytes: &[u8], of: u64) -> Option<u64> {
    fields(bytes)
        .into_iter()
        .find_map(|(number, field)| match field {
            Field::Number(value) if number == of => Some(value),
            _ => None,
        })
}

fn bytes(bytes: &[u8], of: u64) -> Option<&[u8]> {
    fields(bytes)
        .into_iter()
        .find_map(|(number, field)| match field {
            Field::Bytes(value) if number == of => Some(value),
            _ => None,
        })
}

pub(crate) fn read(path: &Path) -> Trace {
    let mut whole = Vec::new();
    let file = File::open(path).expect("a trace");
    GzDecoder::new(file)
        .read_to_end(&mut whole)
        .expect("it is compressed");
    let mut trace = Trace::default();
    for (_, packet) in fields(&whole) {
        let Field::Bytes(packet) = packet else {
            panic!("no packet");
        };
        if let Some(track) = bytes(packet, 60) {
            let uuid = number(track, 1).expect("a track has a number");
            if let Some(parent) = number(track, 5) {
                trace.parents.insert(uuid, parent);
            }
            if let Some(name) = bytes(track, 3).and_then(|process| bytes(process, 6)) {
                let name = String::from_utf8(name.to_vec()).expect("a name");
                trace.processes.insert(uuid, name);
            }
        }
        if let Some(event) = bytes(packet, 11) {
            let time = number(packet, 8).expect("a time");
            let track = number(event, 11).expect("a track");
            if let Some(flow) = number(event, 47) {
                trace.begins.insert(flow, (time, track));
            }
            if let Some(flow) = number(event, 48) {
                trace.ends.insert(flow, (time, track));
            }
        }
    }
    trace
}
