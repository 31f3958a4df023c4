//! Replaying: the recorded events of each process.
//!
//! The time of a replay's virtual clock is the stamp of the event that is next: a process that has
//! an event with a stamp sleeps until then, and the clock moves when no process can run, that is
//! when all that came before has happened.

mod branch_log;
mod replay_log;
mod stamps;
mod track;

pub(crate) use track::Track;

use super::error::RecordError;
use super::event::{Event as Noted, Kind};
use super::recorder::{RecordReport, lock};
use super::recording::Recording;
use branch_log::BranchLog;
use luna_core::timer_queue::Sleep;
use stamps::{END, at};
use std::cell::{Cell, RefCell};
use std::collections::{BTreeMap, HashMap, VecDeque};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex};

type Queues = BTreeMap<u32, VecDeque<Noted>>;
/// A process: its parent's number or 0, its name, and which it is of these.
type Key = (u32, String, u32);

/// What replays a system.
#[derive(Default)]
pub(crate) struct Replayer {
    system: String,
    parameters: Vec<(String, String)>,
    is_whole: bool,
    /// The number from 1 of each process, and its events.
    processes: Mutex<HashMap<Key, (u32, Queues)>>,
    /// Number of processes of each name, by the process that spawned them.
    names: Mutex<HashMap<(u32, String), u32>>,
    first: Mutex<Option<RecordError>>,
    differs: AtomicBool,
    /// All that was recorded has happened: what is left is dropped, and what comes of that was not
    /// recorded.
    is_over: AtomicBool,
    replayed: AtomicU64,
}

impl Replayer {
    pub(crate) fn new(recording: &Recording) -> Arc<Self> {
        let mut processes = HashMap::new();
        for (number, process) in (1..).zip(&recording.processes) {
            let mut queues = Queues::new();
            for event in &process.events {
                let queue = queues.entry(event.path).or_default();
                queue.push_back(event.clone());
            }
            let key = (process.parent, process.name.clone(), process.occurrence);
            processes.insert(key, (number, queues));
        }
        Arc::new(Self {
            system: recording.system.clone(),
            parameters: recording.parameters.clone(),
            is_whole: recording.is_whole,
            processes: Mutex::new(processes),
            ..Self::default()
        })
    }

    /// What parameters began with.
    pub(crate) fn parameters(&self) -> &[(String, String)] {
        &self.parameters
    }

    /// Compares the system's name.
    pub(crate) fn check_system(&self, name: &str) -> Result<(), RecordError> {
        if self.system == name {
            return Ok(());
        }
        Err(RecordError::OtherProgram {
            recorded: format!("system `{}`", self.system),
            found: format!("system `{name}`"),
        })
    }

    /// What is to replay a process of this name.
    pub(crate) fn track(self: &Arc<Self>, parent: u32, name: &str) -> Track {
        let occurrence = {
            let mut names = lock(&self.names);
            let count = names.entry((parent, name.to_owned())).or_default();
            *count += 1;
            *count - 1
        };
        let key = (parent, name.to_owned(), occurrence);
        let known = lock(&self.processes).remove(&key);
        if known.is_none() && self.is_whole {
            self.note(RecordError::OtherProgram {
                recorded: "no such process".to_owned(),
                found: format!("process `{name}`"),
            });
        }
        // One that is not known has a number that no other one has.
        let (number, queues) = known.unwrap_or((u32::MAX, Queues::new()));
        let returns = queues
            .get(&0)
            .and_then(VecDeque::back)
            .is_some_and(|event| event.kind == Kind::Ended);
        let branch_logs = queues.into_iter();
        let branch_logs = branch_logs.map(|(path, events)| (path, BranchLog::new(events)));
        Track {
            replayer: self.clone(),
            name: name.to_owned(),
            number,
            branch_logs: RefCell::new(branch_logs.collect()),
            end: RefCell::new(Box::pin(Sleep::until(at(END)))),
            begun: Cell::new(false),
            outputs: Cell::new(0),
            past_end: Cell::new(false),
            returns,
            has_overrun: Cell::new(false),
            idle_polls: Cell::new(0),
        }
    }

    fn note(&self, error: RecordError) {
        self.differs.store(true, Ordering::Relaxed);
        lock(&self.first).get_or_insert(error);
    }

    fn differs(&self) -> bool {
        self.differs.load(Ordering::Relaxed)
    }

    /// What has come of it, when the system has ended.
    pub(crate) fn finish(&self) -> Result<RecordReport, RecordError> {
        if let Some(error) = lock(&self.first).take() {
            return Err(error);
        }
        let left = lock(&self.processes).keys().next().cloned();
        match left {
            Some((_, name, _)) if self.is_whole => Err(RecordError::OtherProgram {
                recorded: format!("process `{name}`"),
                found: "no such process".to_owned(),
            }),
            _ => Ok(RecordReport {
                events: self.replayed.load(Ordering::Relaxed),
                ..RecordReport::default()
            }),
        }
    }
}
