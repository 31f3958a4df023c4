//! What the recorder knows of events: the names of their subjects, and which are recorded.
//!
//! A name is recorded before the first event that mentions its subject, and again where a block
//! with it was lost. So a recording has the names of its subjects, and no others.

use crate::format::{Event, Record, RunsOn, Subject};
use crate::lane::Head;
use luna_events::{Kind, Losses, Name, Names, TEXT, TEXT_HEAD, code};
use rustc_hash::{FxHashMap, FxHashSet};
use std::collections::{BTreeMap, HashMap, VecDeque};
use std::sync::Arc;

/// Identifies a named subject: its kind and its number.
type Key = u64;

fn key(kind: Kind, number: u64) -> Key {
    (kind as u64) << 32 | number & u64::from(u32::MAX)
}

/// How many names of processes of other systems are kept.
const MAX_STRANGERS: usize = 4096;

/// The events of a recording.
#[derive(Default)]
pub(super) struct Events {
    /// The source of names; none if no events are recorded. This is the only lasting reference:
    /// when it is dropped, no names are collected.
    names: Option<Arc<Names>>,
    known: FxHashMap<Key, Name>,
    /// Subjects with recorded names, and those without a name.
    declared: FxHashSet<Key>,
    are_codes_declared: bool,
    /// A name that comes in parts, by thread.
    parts: HashMap<u32, Parts>,
    /// Subjects that ended in the present block: their names can be dropped after it.
    ended: Vec<Key>,
    /// Processes of other systems, the most recently named: their ends are not reported here.
    strangers: VecDeque<Key>,
    in_block: FxHashMap<u32, u64>,
    refused: FxHashMap<u32, u64>,
    losses: Vec<(u32, Losses)>,
    recorded: u64,
}

struct Parts {
    name: Name,
    bytes: Vec<u8>,
    length: usize,
}

impl Events {
    pub(super) fn new(names: Option<Arc<Names>>) -> Self {
        Self {
            names,
            ..Self::default()
        }
    }

    /// Adds a thread or executor that records events.
    pub(super) fn add(&mut self, thread: u32, losses: Losses) {
        self.losses.push((thread, losses));
    }

    /// Learns of new names.
    pub(super) fn take_names(&mut self) {
        let Some(names) = &self.names else { return };
        for name in names.take() {
            self.learn(name);
        }
    }

    fn learn(&mut self, name: Name) {
        let key = key(name.kind, name.number.into());
        if name.kind == Kind::Process && name.runs_on.is_none() {
            // Its end is reported elsewhere.
            self.strangers.push_back(key);
            if self.strangers.len() > MAX_STRANGERS
                && let Some(oldest) = self.strangers.pop_front()
            {
                self.known.remove(&oldest);
                self.declared.remove(&oldest);
            }
        }
        // A later name replaces the one before, also if that was recorded.
        self.declared.remove(&key);
        self.known.insert(key, name);
    }

    /// The names of the codes, if they are to be recorded.
    pub(super) fn codes(&mut self, mut put: impl FnMut(&Record<'_>)) {
        if self.names.is_none() || std::mem::replace(&mut self.are_codes_declared, true) {
            return;
        }
        for (number, name) in code::NAMES {
            put(&Record::Name {
                subject: Subject::Code,
                number: number.into(),
                parent: 0,
                name,
                runs_on: None,
            });
        }
    }

    /// Puts an event, and before it the names of its subjects. An entry that carries a part of a
    /// name is kept until the name is complete.
    pub(super) fn put(
        &mut self,
        thread: u32,
        time: u64,
        entry: &[u64],
        mut put: impl FnMut(&Record<'_>),
    ) {
        let head = Head(entry[0]);
        let (of, subject) = (head.code(), head.signal());
        let [a, b] = [entry[2], entry[3]];
        if of >= TEXT_HEAD {
            return self.take_part(thread, of, subject, [a, b]);
        }
        let kind = match of {
            code::COMMUNICATION => Kind::Channel,
            code::ASLEEP | code::AWAKE => Kind::Executor,
            code::SLOT | code::LATE => Kind::Loop,
            code::SUB_RUNNING | code::SUB_WAITING | code::SUB_DONE => Kind::SubProcess,
            _ => Kind::Process,
        };
        // Of a core the number is the name.
        if of != code::STOLEN {
            self.mention(kind, subject.into(), &mut put);
        }
        match of {
            code::READY | code::SPAWNED => self.mention(Kind::Process, a, &mut put),
            code::COMMUNICATION => {
                self.mention(Kind::Process, a, &mut put);
                self.mention(Kind::Process, b, &mut put);
            }
            code::ALTERNATIVE => self.mention(Kind::Channel, b, &mut put),
            code::SUB_RUNNING => {
                self.mention(Kind::Process, a, &mut put);
                self.mention(Kind::SubProcess, b, &mut put);
            }
            code::WAITING | code::SUB_WAITING => {
                let kinds = [Kind::Channel, Kind::Barrier, Kind::Lock, Kind::Loop];
                if let Some(kind) = kinds.into_iter().find(|kind| *kind as u64 == a) {
                    self.mention(kind, b, &mut put);
                }
            }
            code::DONE | code::SUB_DONE => self.ended.push(key(kind, subject.into())),
            _ => {}
        }
        put(&Record::Event(Event {
            thread,
            time,
            code: of,
            subject,
            arguments: [a, b],
        }));
        *self.in_block.entry(thread).or_default() += 1;
    }

    #[inline]
    fn mention(&mut self, kind: Kind, number: u64, put: &mut impl FnMut(&Record<'_>)) {
        let key = key(kind, number);
        if number != 0 || kind == Kind::Executor {
            if self.declared.contains(&key) {
                return;
            }
            self.declare(key, put);
        }
    }

    #[cold]
    fn declare(&mut self, key: Key, put: &mut impl FnMut(&Record<'_>)) {
        if !self.known.contains_key(&key) {
            self.take_names();
        }
        self.declared.insert(key);
        // A subject's number in recordings is that of its kind.
        let known = self.known.get(&key);
        let Some((name, subject)) =
            known.and_then(|name| Some((name, Subject::from_byte(name.kind as u8)?)))
        else {
            return;
        };
        let runs_on = name
            .runs_on
            .map(|(executor, level)| RunsOn { executor, level });
        put(&Record::Name {
            subject,
            number: name.number,
            parent: name.parent,
            name: &name.text,
            runs_on,
        });
        let parent = name.parent;
        if let Some(RunsOn { executor, .. }) = runs_on {
            self.mention(Kind::Executor, executor.into(), put);
        }
        if parent != 0 && subject != Subject::Channel {
            self.mention(Kind::Process, parent.into(), put);
        }
    }

    fn take_part(&mut self, thread: u32, of: u16, subject: u32, [a, b]: [u64; 2]) {
        if of == TEXT_HEAD {
            let kind = match a >> 32 {
                kind if kind == Kind::SubProcess as u64 => Kind::SubProcess,
                _ => Kind::Loop,
            };
            let name = Name {
                kind,
                number: subject,
                parent: b as u32,
                text: String::new(),
                runs_on: None,
            };
            let parts = Parts {
                name,
                bytes: Vec::new(),
                length: a as u32 as usize,
            };
            self.parts.insert(thread, parts);
        } else if of == TEXT
            && let Some(parts) = self.parts.get_mut(&thread)
            // Else the begin of this one was lost, or the end of that one.
            && parts.name.number == subject
        {
            parts.bytes.extend(a.to_le_bytes());
            parts.bytes.extend(b.to_le_bytes());
            if parts.bytes.len() >= parts.length
                && let Some(mut parts) = self.parts.remove(&thread)
            {
                parts.bytes.truncate(parts.length);
                parts.name.text = String::from_utf8_lossy(&parts.bytes).into_owned();
                self.learn(parts.name);
            }
        }
    }

    /// An event that the sink has no place for.
    pub(super) fn refuse(&mut self, thread: u32, entry: &[u64]) {
        let head = Head(entry[0]);
        if head.code() >= TEXT_HEAD {
            self.take_part(thread, head.code(), head.signal(), [entry[2], entry[3]]);
        } else {
            *self.refused.entry(thread).or_default() += 1;
            let kind = match head.code() {
                code::DONE => Kind::Process,
                code::SUB_DONE => Kind::SubProcess,
                _ => return,
            };
            self.ended.push(key(kind, head.signal().into()));
        }
    }

    /// The block was taken, or refused with all that is in it.
    pub(super) fn end_block(&mut self, has_failed: bool) {
        for (thread, events) in self.in_block.drain() {
            if has_failed {
                *self.refused.entry(thread).or_default() += events;
            } else {
                self.recorded += events;
            }
        }
        if has_failed {
            self.declare_again();
        }
        for key in self.ended.drain(..) {
            self.known.remove(&key);
            self.declared.remove(&key);
        }
    }

    /// Everything that was recorded is recorded again.
    pub(super) fn declare_again(&mut self) {
        self.declared.clear();
        self.are_codes_declared = false;
    }

    /// These were in blocks that the sink has taken, and could not keep.
    pub(super) fn take_back(&mut self, lost: &BTreeMap<u32, u64>) {
        for (&thread, &events) in lost {
            let events = events.min(self.recorded);
            self.recorded -= events;
            *self.refused.entry(thread).or_default() += events;
        }
    }

    /// How many of each thread were lost until now.
    pub(super) fn lost(&self) -> impl Iterator<Item = (u32, u64)> + '_ {
        self.losses.iter().map(|(thread, losses)| {
            let refused = self.refused.get(thread).copied().unwrap_or(0);
            (*thread, losses.get() + refused)
        })
    }

    pub(super) fn recorded(&self) -> u64 {
        self.recorded
    }
}
