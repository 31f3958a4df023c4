//! The declarations, and the state of each process, for viewers that connect later.

use luna_logger::format::{ClockBase, Encoder, Event, Losing, Record, RunsOn, SignalInfo, Type};
use std::collections::BTreeMap;
use std::sync::Arc;

/// Names longer than that are cut: what a page can show.
pub(super) const LONGEST: usize = 256;
/// More of a kind are not kept.
const MAX: usize = 1 << 15;
/// The limit of bytes in all, as they are in blocks: a viewer gets them all at once. Alarms, and
/// records that exist once, have their own room.
const MAX_BYTES: usize =
    super::MAX_DECLARED - MAX_LOSS_BYTES - super::alarms::MAX_BYTES - (4 << 10);
/// Bytes reserved for losses, so that they are sent even if the rest is full.
const MAX_LOSS_BYTES: usize = 64 << 10;

/// The largest size of a record without its texts: kind, length and numbers (five bytes for 32
/// bits, ten for 64).
const THREAD: usize = 3 + 5 + 2;
const SIGNAL: usize = 3 + 5 + 2 + 3 * 2;
const NAME: usize = 3 + 1 + 5 + 5 + 2 + 10;
const LOSSES: usize = 3 + 1 + 5 + 10;
const STATE: usize = 3 + 5 + 10 + 3 + 5 + 2 * 10;

/// Codes of events that change the state of a process: ready, running, waiting, done.
const STATES: std::ops::RangeInclusive<u16> = 1..=4;
const EMERGENCY: u16 = 12;

#[derive(Debug, Default)]
pub(super) struct Declared {
    room: Room<MAX_BYTES>,
    room_of_losses: Room<MAX_LOSS_BYTES>,
    session: Option<(String, ClockBase, String)>,
    threads: BTreeMap<u32, String>,
    signals: BTreeMap<u32, Signal>,
    names: BTreeMap<(u8, u32), Name>,
    losses: BTreeMap<(u8, u32), (Losing, u64)>,
    epoch: Option<(u64, i64)>,
    states: BTreeMap<u32, Event>,
    emergency: Option<Event>,
}

/// Room for `BYTES` bytes.
#[derive(Debug, Default)]
struct Room<const BYTES: usize> {
    bytes: usize,
    /// Something was not kept.
    is_short: bool,
}

#[derive(Debug, PartialEq)]
struct Signal {
    element_type: Type,
    elements: u8,
    name: String,
    unit: String,
    description: String,
}

#[derive(Debug, PartialEq)]
struct Name {
    subject: luna_logger::format::Subject,
    parent: u32,
    name: String,
    runs_on: Option<RunsOn>,
}

trait Declaration: PartialEq {
    /// The bytes that it has at most in a block.
    fn bytes(&self) -> usize;
}

impl Declaration for String {
    fn bytes(&self) -> usize {
        THREAD + self.len()
    }
}

impl Declaration for Signal {
    fn bytes(&self) -> usize {
        SIGNAL + self.name.len() + self.unit.len() + self.description.len()
    }
}

impl Declaration for Name {
    fn bytes(&self) -> usize {
        NAME + self.name.len()
    }
}

impl Declaration for (Losing, u64) {
    fn bytes(&self) -> usize {
        LOSSES
    }
}

impl Declaration for Event {
    fn bytes(&self) -> usize {
        STATE
    }
}

impl<const BYTES: usize> Room<BYTES> {
    /// Keeps a value, unless the limit is reached. Returns whether it is kept and was not known
    /// before.
    fn keep<K: Ord, V: Declaration>(&mut self, of: &mut BTreeMap<K, V>, key: K, value: V) -> bool {
        let known = of.get(&key);
        if known == Some(&value) {
            return false;
        }
        let without = self.bytes - known.map_or(0, V::bytes);
        let is_new = known.is_none();
        if (is_new && of.len() >= MAX) || without + value.bytes() > BYTES {
            self.is_short = true;
            return false;
        }
        self.bytes = without + value.bytes();
        of.insert(key, value);
        true
    }
}

impl Declared {
    /// Keeps a declaration. Returns whether viewers are to get it: not if they know it, nor if
    /// there is no room for it.
    pub(super) fn take(&mut self, record: &Record<'_>) -> bool {
        match *record {
            Record::Session {
                system,
                clock,
                written_by,
            } => {
                let session = Some((cut(system), clock, cut(written_by)));
                let is_new = self.session != session;
                self.session = session;
                is_new
            }
            Record::Thread { number, name } => self.room.keep(&mut self.threads, number, cut(name)),
            Record::Signal(info) => {
                let signal = Signal {
                    element_type: info.element_type,
                    elements: info.elements,
                    name: cut(info.name),
                    unit: cut(info.unit),
                    description: cut(info.description),
                };
                self.room.keep(&mut self.signals, info.number, signal)
            }
            // They are not shown, and their number is unbounded: viewers that connect later do not
            // get them.
            Record::Name {
                subject: luna_logger::format::Subject::SubProcess,
                ..
            } => true,
            Record::Name {
                subject,
                number,
                parent,
                name,
                runs_on,
            } => {
                let name = Name {
                    subject,
                    parent,
                    name: cut(name),
                    runs_on,
                };
                self.room
                    .keep(&mut self.names, (subject as u8, number), name)
            }
            Record::Losses { of, lost } => {
                let key = match of {
                    Losing::Signal(number) => (1, number),
                    Losing::Messages(number) => (2, number),
                    Losing::Events(number) => (3, number),
                    Losing::Blocks => (4, 0),
                };
                self.room_of_losses.keep(&mut self.losses, key, (of, lost))
            }
            Record::Epoch { time, unix } => {
                let epoch = Some((time, unix));
                let is_new = self.epoch != epoch;
                self.epoch = epoch;
                is_new
            }
            _ => true,
        }
    }

    /// Keeps the state that an event leads to.
    pub(super) fn event(&mut self, event: &Event) {
        if STATES.contains(&event.code) {
            self.room.keep(&mut self.states, event.subject, *event);
        } else if event.code == EMERGENCY {
            self.emergency = Some(*event);
        }
    }

    /// The last event of an emergency.
    pub(super) fn emergency(&self) -> Option<&Event> {
        self.emergency.as_ref()
    }

    /// Whether there was more than is kept.
    pub(super) fn is_short(&self) -> bool {
        self.room.is_short || self.room_of_losses.is_short
    }

    pub(super) fn type_of(&self, signal: u32) -> Option<Type> {
        self.signals.get(&signal).map(|signal| signal.element_type)
    }

    /// All of it, as blocks, with some alarms.
    pub(super) fn blocks<'a>(&self, alarms: impl Iterator<Item = Record<'a>>) -> Vec<Arc<[u8]>> {
        let mut blocks = Vec::new();
        let mut encoder = Encoder::new();
        let mut put = |record: Record<'_>| {
            encoder.put(&record);
            if encoder.is_full() {
                blocks.push(encoder.block().into());
                encoder.next();
            }
        };
        if let Some((system, clock, written_by)) = &self.session {
            put(Record::Session {
                system,
                clock: *clock,
                written_by,
            });
        }
        for (number, name) in &self.threads {
            let number = *number;
            put(Record::Thread { number, name });
        }
        for (number, signal) in &self.signals {
            put(Record::Signal(SignalInfo {
                number: *number,
                element_type: signal.element_type,
                elements: signal.elements,
                name: &signal.name,
                unit: &signal.unit,
                description: &signal.description,
            }));
        }
        for ((_, number), name) in &self.names {
            put(Record::Name {
                subject: name.subject,
                number: *number,
                parent: name.parent,
                name: &name.name,
                runs_on: name.runs_on,
            });
        }
        if let Some((time, unix)) = self.epoch {
            put(Record::Epoch { time, unix });
        }
        for (of, lost) in self.losses.values() {
            let (of, lost) = (*of, *lost);
            put(Record::Losses { of, lost });
        }
        alarms.for_each(&mut put);
        for event in self.states.values().chain(&self.emergency) {
            put(Record::Event(*event));
        }
        if !encoder.is_empty() {
            blocks.push(encoder.block().into());
        }
        blocks
    }
}

pub(super) fn cut(text: &str) -> String {
    text[..text.floor_char_boundary(LONGEST)].to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;
    use luna_logger::format::Subject;

    fn bytes(declared: &Declared) -> usize {
        declared
            .blocks(std::iter::empty())
            .iter()
            .map(|block| block.len())
            .sum()
    }

    fn name(declared: &mut Declared, number: u32, name: &str) -> bool {
        declared.take(&Record::Name {
            subject: Subject::Process,
            number,
            parent: u32::MAX,
            name,
            runs_on: Some(RunsOn {
                executor: u32::MAX,
                level: u8::MAX,
            }),
        })
    }

    /// The greatest values, so that a record has its largest size.
    fn fill(declared: &mut Declared, texts: &str) {
        let huge = |number: u32| u32::MAX - number;
        for number in 0..MAX as u32 {
            let event = |time| Event {
                thread: u32::MAX,
                time,
                code: 3,
                subject: huge(number),
                arguments: [u64::MAX; 2],
            };
            // Far from each other, so that their differences have the largest size.
            let far = [0, u64::MAX][number as usize % 2];
            declared.event(&event(far));
            let lost = u64::MAX;
            let of = Losing::Messages(huge(number));
            declared.take(&Record::Losses { of, lost });
            declared.take(&Record::Signal(SignalInfo {
                number: huge(number),
                element_type: Type::F64,
                elements: u8::MAX,
                name: texts,
                unit: texts,
                description: texts,
            }));
            let thread = huge(number);
            declared.take(&Record::Thread {
                number: thread,
                name: texts,
            });
            name(declared, huge(number), texts);
        }
    }

    #[test]
    fn the_kept_bytes_are_limited() {
        for texts in ["", "x", &"x".repeat(200), &"x".repeat(5000)] {
            let mut declared = Declared::default();
            let long = "x".repeat(5000);
            declared.take(&Record::Session {
                system: &long,
                clock: ClockBase::Monotonic,
                written_by: &long,
            });
            assert!(!declared.is_short());
            fill(&mut declared, texts);
            assert!(declared.is_short());
            let bytes = bytes(&declared);
            let most = super::super::MAX_DECLARED;
            assert!((most * 3 / 4..=most).contains(&bytes), "{bytes}");
        }
    }

    #[test]
    fn known_declarations_are_not_sent_again() {
        let mut declared = Declared::default();
        assert!(name(&mut declared, 7, "pan"));
        assert!(!name(&mut declared, 7, "pan"));
        assert!(name(&mut declared, 7, "tilt"));
        let thread = |number| Record::Thread { number, name: "a" };
        assert!(declared.take(&thread(1)) && declared.take(&thread(2)));
        assert!(!declared.take(&thread(1)));
        let epoch = Record::Epoch { time: 1, unix: 2 };
        assert!(declared.take(&epoch) && !declared.take(&epoch));
        assert!(!declared.is_short());
    }

    #[test]
    fn losses_are_sent_when_the_rest_is_full() {
        let mut declared = Declared::default();
        let long = "x".repeat(LONGEST);
        for number in 0..MAX as u32 {
            name(&mut declared, number, &long);
        }
        assert!(declared.is_short());
        for lost in 1..3 {
            let of = Losing::Events(1);
            assert!(declared.take(&Record::Losses { of, lost }));
        }
    }

    #[test]
    fn what_changes_gives_its_room_back() {
        let mut declared = Declared::default();
        let (long, short) = ("x".repeat(LONGEST), "");
        for text in [&long, short, &long, short].repeat(10_000) {
            assert!(name(&mut declared, 7, text));
        }
        assert_eq!(declared.room.bytes, NAME);
    }
}
