//! Execution times and responses from the turns of a recording.
//!
//! A job of a process with a loop is a cycle: from its slot until the process waits for the next
//! one. A job of another process is what it does from when it is woken until it waits again. The
//! time of a turn is that of the clock: what has preempted it is in it.

use crate::convert::open;
use crate::failure::{Failure, failed};
use crate::model::names;
use luna_events::code;
use luna_logger::format::{ClockBase, Event, Losing, Names, Record, Subject};
use luna_model::Model;
use luna_model::schedule::{Costs, Known, Releases};
use std::cmp::Reverse;
use std::collections::{BTreeMap, BinaryHeap, HashMap};
use std::path::Path;
use std::time::Duration;

/// So many events are held back to put those of all threads in order.
const WINDOW: usize = 1 << 20;

/// What of a recording is missing.
#[derive(Debug, Default)]
pub(super) struct Missing {
    pub(super) events: u64,
    /// Some of it cannot be read, or it has no end.
    pub(super) is_damaged: bool,
}

/// What was measured, by the names of the model, and what is missing.
pub(super) fn read(path: &Path, model: &Model) -> Result<(Costs, Missing), Failure> {
    let mut reader = open(path)?;
    let mut measured = Measured::default();
    let mut missing = Missing::default();
    loop {
        match reader.next() {
            Ok(None) => break,
            Ok(Some(Record::Session {
                clock: ClockBase::Virtual,
                ..
            })) => {
                let error = "it was recorded on a virtual clock, on which turns take no time: \
                             record on the machine's clock, or state costs in the model";
                return Err(failed(path)(error));
            }
            Ok(Some(record)) => measured.take(&record),
            Err(error) => {
                eprintln!("luna: {}: {error}", path.display());
                missing.is_damaged = true;
                // The blocks after the damage are as good as those before.
                if !matches!(reader.resume(), Ok(Some(_))) {
                    break;
                }
            }
        }
    }
    missing.events = measured.lost.values().sum::<u64>() + reader.missing_blocks();
    missing.is_damaged |= !reader.has_ended();
    let costs = measured.end(model).ok_or_else(|| {
        let error = "it has no turns: it was recorded without events (`Logging::events`, or \
                     LUNA_LOG_EVENTS in its environment)";
        failed(path)(error)
    })?;
    Ok((costs, missing))
}

/// Time, place in the recording, code, subject, arguments.
type Entry = (u64, u64, u16, u32, [u64; 2]);

#[derive(Default)]
struct Measured {
    names: Names,
    waiting: BinaryHeap<Reverse<Entry>>,
    number: u64,
    processes: HashMap<u32, Process>,
    lost: HashMap<Losing, u64>,
}

impl Measured {
    fn take(&mut self, record: &Record<'_>) {
        self.names.take(record);
        match record {
            Record::Event(event) => self.hold(event),
            Record::Losses {
                of: of @ (Losing::Events(_) | Losing::Blocks),
                lost,
            } => {
                self.lost.insert(*of, *lost);
            }
            _ => {}
        }
    }

    fn hold(&mut self, event: &Event) {
        let is_meant = matches!(
            event.code,
            code::READY | code::RUNNING | code::WAITING | code::DONE | code::SLOT
        );
        if !is_meant {
            return;
        }
        self.number += 1;
        let entry = (
            event.time,
            self.number,
            event.code,
            event.subject,
            event.arguments,
        );
        self.waiting.push(Reverse(entry));
        if self.waiting.len() > WINDOW
            && let Some(Reverse(entry)) = self.waiting.pop()
        {
            self.event(entry);
        }
    }

    fn event(&mut self, (time, _, code, subject, [a, b]): Entry) {
        let number = match code {
            code::SLOT => self.names.process_of_loop(subject),
            _ => subject,
        };
        let process = self.processes.entry(number).or_default();
        match code {
            code::READY => process.ready(time),
            code::RUNNING => process.running(time),
            code::WAITING if a == code::STILL_READY => process.yields(time),
            code::WAITING => process.waits(time, a == Subject::Loop as u64),
            code::DONE => *process = std::mem::take(process).done(time),
            code::SLOT => process.slot(subject, time, b),
            _ => {}
        }
    }

    /// None if there was no turn.
    fn end(mut self, model: &Model) -> Option<Costs> {
        while let Some(Reverse(entry)) = self.waiting.pop() {
            self.event(entry);
        }
        let modelled = names::numbered(model.process_names());
        let mut all: BTreeMap<String, Known> = BTreeMap::new();
        for (number, process) in self.processes {
            // A loop of a process that is not known.
            if number == 0 || !process.has_run {
                continue;
            }
            let known = process.known();
            let name = self.names.process(number.into());
            let name = names::find(&modelled, &name).map_or(name, |(known, _)| known.to_owned());
            match all.get_mut(&name) {
                None => {
                    all.insert(name, known);
                }
                // Several of one name: the longest of all, and none of their releases.
                Some(former) => {
                    former.cost = former.cost.max(known.cost);
                    former.longest_poll = former.longest_poll.max(known.longest_poll);
                    former.response = former.response.max(known.response);
                    former.arrivals = None;
                }
            }
        }
        let mut costs = Costs::new();
        let is_empty = all.is_empty();
        for (name, known) in all {
            costs.insert(name, known);
        }
        (!is_empty).then_some(costs)
    }
}

/// What was seen of a process. Times in ns.
#[derive(Debug, Default)]
struct Process {
    has_run: bool,
    /// When its present turn began.
    begun: Option<u64>,
    longest_poll: u64,
    /// Since it was woken.
    release: Option<u64>,
    /// Woken again, before it waited.
    next_release: Option<u64>,
    cost: u64,
    longest: Job,
    releases: Releases,
    /// The last of its loops that began a cycle, and whether others did.
    loop_number: Option<u32>,
    has_several_loops: bool,
    /// The slot of its present cycle, what that has taken, and the end of its last turn.
    slot: Option<u64>,
    cycle_cost: u64,
    last_end: u64,
    /// How its last turn since the slot ended; none if that is the present one.
    turn_end: Option<TurnEnd>,
    /// So much of the present turn was of the former cycle.
    counted: u64,
    longest_cycle: Job,
}

/// How a turn ends.
#[derive(Debug)]
enum TurnEnd {
    Yields,
    Waits,
}

/// The longest of each, of all jobs.
#[derive(Debug, Default)]
struct Job {
    cost: u64,
    response: u64,
}

impl Job {
    fn take(&mut self, cost: u64, response: u64) {
        self.cost = self.cost.max(cost);
        self.response = self.response.max(response);
    }
}

impl Process {
    fn ready(&mut self, time: u64) {
        match self.release {
            None => self.released(time),
            Some(_) if self.begun.is_some() => {
                self.next_release.get_or_insert(time);
            }
            // One wake has two events if it comes from another thread.
            Some(_) => {}
        }
    }

    fn released(&mut self, time: u64) {
        self.release = Some(time);
        self.releases.add(Duration::from_nanos(time));
    }

    fn running(&mut self, time: u64) {
        if !self.has_run {
            // Until the system starts, what is ready waits.
            (self.release, self.releases) = (None, Releases::new());
        }
        self.has_run = true;
        self.begun = Some(time);
        if self.release.is_none() {
            self.released(time);
        }
    }

    fn turn_ends(&mut self, time: u64) {
        let Some(begun) = self.begun.take() else {
            return;
        };
        let length = time.saturating_sub(begun);
        // What a process does before its first cycle is no part of its loop.
        if self.slot.is_some() || self.loop_number.is_none() {
            self.longest_poll = self.longest_poll.max(length);
        }
        self.cost += length;
        self.cycle_cost += length.saturating_sub(std::mem::take(&mut self.counted));
        self.last_end = time;
    }

    /// A turn that is not the last one of its job; what has woken it meanwhile is in that, too.
    fn yields(&mut self, time: u64) {
        self.turn_ends(time);
        self.next_release = None;
        self.turn_end = Some(TurnEnd::Yields);
    }

    fn waits(&mut self, time: u64, for_slot: bool) {
        self.turn_ends(time);
        self.turn_end = Some(TurnEnd::Waits);
        if let Some(release) = self.release.take() {
            self.longest.take(self.cost, time.saturating_sub(release));
        }
        self.cost = 0;
        if let Some(next) = self.next_release.take() {
            self.released(next);
        }
        if for_slot {
            self.cycle_ends();
        }
    }

    fn cycle_ends(&mut self) {
        if let Some(slot) = self.slot.take() {
            let response = self.last_end.saturating_sub(slot);
            self.longest_cycle.take(self.cycle_cost, response);
        }
        self.cycle_cost = 0;
    }

    /// A cycle begins, in a turn that counts to it from its begin; so late.
    fn slot(&mut self, number: u32, time: u64, late: u64) {
        let former = self.loop_number.replace(number);
        if former.is_none() {
            // The turns until here were of no cycle.
            self.longest_poll = 0;
            self.cycle_cost = 0;
        }
        self.has_several_loops |= former.is_some_and(|former| former != number);
        match (self.slot, self.turn_end.take()) {
            (None, _) => {}
            (Some(_), Some(TurnEnd::Yields)) => self.cycle_ends(),
            // The former cycle is of the same turn, and over here.
            (Some(_), None) => {
                let length = time.saturating_sub(self.begun.unwrap_or(time));
                self.cycle_cost += length.saturating_sub(self.counted);
                (self.counted, self.last_end) = (length, time);
                self.cycle_ends();
            }
            // It has waited for something else too: when the cycle was over is not known.
            (Some(_), Some(TurnEnd::Waits)) => {
                self.longest_cycle.take(self.cycle_cost, 0);
                self.cycle_cost = 0;
            }
        }
        self.slot = Some(time.saturating_sub(late));
    }

    /// What was seen, without what it has not ended. Its last turn has no other end.
    fn done(mut self, time: u64) -> Self {
        if self.begun.is_some() {
            self.waits(time, true);
        }
        Self {
            begun: None,
            release: None,
            next_release: None,
            slot: None,
            cost: 0,
            cycle_cost: 0,
            ..self
        }
    }

    fn known(self) -> Known {
        let time = |nanos: u64| (nanos > 0).then(|| Duration::from_nanos(nanos));
        let poll = time(self.longest_poll);
        let (job, arrivals) = match (self.loop_number, self.has_several_loops) {
            (None, _) => (self.longest, self.releases.seen()),
            (Some(_), false) => (self.longest_cycle, None),
            // Which of several loops a cycle belongs to is not known.
            (Some(_), true) => (Job::default(), None),
        };
        Known {
            cost: time(job.cost),
            longest_poll: poll,
            response: time(job.response),
            arrivals,
        }
    }
}
