//! What was declared, and the state that each process is in, for who comes late.

use luna_logger::format::{ClockBase, Encoder, Event, Losing, Record, RunsOn, SignalInfo, Type};
use std::collections::BTreeMap;
use std::sync::Arc;

/// Names longer than that are cut: what a page can show.
const LONGEST: usize = 256;
/// More of a kind are not kept.
const MOST: usize = 1 << 15;

/// Codes of events that say in which state a process is: ready, running, waiting, done.
const STATES: std::ops::RangeInclusive<u16> = 1..=4;
const EMERGENCY: u16 = 12;

#[derive(Debug, Default)]
pub(super) struct Declared {
    session: Option<(String, ClockBase, String)>,
    threads: BTreeMap<u32, String>,
    signals: BTreeMap<u32, Signal>,
    names: BTreeMap<(u8, u32), Name>,
    losses: BTreeMap<(u8, u32), (Losing, u64)>,
    epoch: Option<(u64, i64)>,
    states: BTreeMap<u32, Event>,
    emergency: Option<Event>,
}

#[derive(Debug)]
struct Signal {
    element_type: Type,
    elements: u8,
    name: String,
    unit: String,
    description: String,
}

#[derive(Debug)]
struct Name {
    subject: luna_logger::format::Subject,
    parent: u32,
    name: String,
    runs_on: Option<RunsOn>,
}

impl Declared {
    /// Keeps a declaration. Says whether viewers are to get it: one that repeats what they know is not for them.
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
            Record::Thread { number, name } => keep(&mut self.threads, number, cut(name)),
            Record::Signal(info) => {
                let signal = Signal {
                    element_type: info.element_type,
                    elements: info.elements,
                    name: cut(info.name),
                    unit: cut(info.unit),
                    description: cut(info.description),
                };
                keep(&mut self.signals, info.number, signal)
            }
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
                keep(&mut self.names, (subject as u8, number), name)
            }
            Record::Losses { of, lost } => {
                let key = match of {
                    Losing::Signal(number) => (1, number),
                    Losing::Messages(number) => (2, number),
                    Losing::Events(number) => (3, number),
                    Losing::Blocks => (4, 0),
                };
                keep(&mut self.losses, key, (of, lost))
            }
            Record::Epoch { time, unix } => {
                self.epoch = Some((time, unix));
                true
            }
            _ => true,
        }
    }

    /// Remembers the state that an event says.
    pub(super) fn event(&mut self, event: &Event) {
        if STATES.contains(&event.code) {
            keep(&mut self.states, event.subject, *event);
        } else if event.code == EMERGENCY {
            self.emergency = Some(*event);
        }
    }

    /// The last event of an emergency.
    pub(super) fn emergency(&self) -> Option<&Event> {
        self.emergency.as_ref()
    }

    pub(super) fn type_of(&self, signal: u32) -> Option<Type> {
        self.signals.get(&signal).map(|signal| signal.element_type)
    }

    /// All of it, as blocks.
    pub(super) fn blocks(&self) -> Vec<Arc<[u8]>> {
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
        for event in self.states.values().chain(&self.emergency) {
            put(Record::Event(*event));
        }
        if !encoder.is_empty() {
            blocks.push(encoder.block().into());
        }
        blocks
    }
}

/// Keeps a value, unless there are too many.
fn keep<K: Ord, V>(of: &mut BTreeMap<K, V>, key: K, value: V) -> bool {
    let has_room = of.len() < MOST || of.contains_key(&key);
    if has_room {
        of.insert(key, value);
    }
    has_room
}

fn cut(text: &str) -> String {
    text[..text.floor_char_boundary(LONGEST)].to_owned()
}
