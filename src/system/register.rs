//! The register of started processes: those that live, and what is remembered of those that have
//! ended.
//!
//! A process is found by its number, and an end is reported by number too, so no operation here
//! takes longer for the number of other processes. What is remembered is bounded: of the processes
//! that were spawned on an executor while the system ran, only the last that ended are kept; the
//! rest is counted.

use super::plan::Member;
use crate::csp::process::{Common, Phases};
use crate::csp::supervised::{Ended, Verdict};
use crate::error::Error;
use crate::report::{EarlierProcesses, ProcessReport};
use crate::safety::{Cause, Emergency};
use luna_core::current::ProcessId;
use luna_core::{Exit, Name, ProcessHandle};
use rustc_hash::{FxHashMap, FxHashSet};
use std::collections::{BTreeMap, BTreeSet, HashSet, VecDeque};

/// Default number of ended processes that are remembered.
pub(super) const REMEMBERED: usize = 1024;

/// Work that is left for a process that has ended, to be done outside of the plan's lock.
#[derive(Default)]
pub(super) struct Reaped {
    pub(super) resident: Option<Box<dyn Phases>>,
    /// The process that owns it, by its place in the order of starts and its name.
    pub(super) of: Option<(u32, String)>,
    /// Its poll monitor ended it for an overrun.
    pub(super) ended_for_overrun: bool,
    pub(super) error: Option<Error>,
    /// The handle of a forgotten process: a panic's payload is the user's, and is dropped with it.
    pub(super) forgotten: Option<ProcessHandle>,
}

/// The error of that failed process which was started first, with its place in the order of starts.
#[derive(Default)]
pub(super) struct First(Option<(u32, Error)>);

impl First {
    pub(super) fn keep(&mut self, order: u32, error: &Error) {
        if self.0.as_ref().is_none_or(|(other, _)| order < *other) {
            self.0 = Some((order, error.clone()));
        }
    }

    pub(super) fn get(&self) -> Option<&Error> {
        self.0.as_ref().map(|(_, error)| error)
    }
}

#[derive(Default)]
pub(crate) struct Register {
    members: FxHashMap<ProcessId, Member>,
    names: FxHashSet<Name>,
    /// Number of processes ever started: the next one's place in the order. From four billion on
    /// all have the same place.
    started: u32,
    /// The processes with budgets, in the order of their start.
    monitored: BTreeSet<(u32, ProcessId)>,
    /// The processes that ended before they were entered here.
    premature: HashSet<ProcessId>,
    reaped: VecDeque<Reaped>,
    has_news: bool,
    /// The processes that have ended and may be forgotten, in the order of their ends.
    ended: VecDeque<ProcessId>,
    pub(super) most_ended: usize,
    earlier: EarlierProcesses,
    forgotten: Numbers,
    pub(super) first_error: First,
    pub(super) first_panic: First,
    /// A panic while cleaning up after a process, as the error of that process.
    pub(super) first_cleanup: First,
    /// Number of looks at members, one by one or all together.
    #[cfg(test)]
    looks: std::cell::Cell<usize>,
}

impl Register {
    /// Takes a name, unless a remembered process has it.
    pub(super) fn take_name(&mut self, name: &Name) -> bool {
        self.names.insert(name.clone())
    }

    pub(super) fn give_name_back(&mut self, name: &Name) {
        self.names.remove(name);
    }

    /// Makes room for `more` more processes.
    pub(super) fn reserve(&mut self, more: usize) {
        self.members.reserve(more);
    }

    #[inline]
    pub(super) fn enter(&mut self, id: ProcessId, mut member: Member, emergency: &Emergency) {
        member.order = self.started;
        self.started = self.started.saturating_add(1);
        if member.ledger.is_some() {
            self.monitored.insert((member.order, id));
        }
        self.members.insert(id, member);
        if !self.premature.is_empty() && self.premature.remove(&id) {
            self.note_end(id, emergency);
        }
    }

    /// Forgets a process that ended and was not entered.
    pub(super) fn never_entered(&mut self, id: ProcessId) {
        self.premature.remove(&id);
    }

    /// Looks at the processes that have ended. O(their number).
    #[inline]
    pub(super) fn note_ends(&mut self, common: &Common) {
        let emergency = &common.emergency;
        let registry = &common.registry;
        registry.take_ended(|one| self.note_end(one.id(), emergency));
    }

    /// Looks at all processes that live: some may have ended and not been reported yet. O(their
    /// number).
    pub(super) fn look_for_ends(&mut self, emergency: &Emergency) {
        self.count_looks(self.members.len());
        let have_ended = |(id, one): (&ProcessId, &Member)| {
            let has_ended = !one.is_reaped && one.handle.exit().is_some();
            has_ended.then_some((one.order, *id))
        };
        let mut ended: Vec<_> = self.members.iter().filter_map(have_ended).collect();
        ended.sort_unstable();
        for (_, id) in ended {
            self.note_end(id, emergency);
        }
    }

    /// As [`note_ends`](Self::note_ends), for the last time.
    pub(super) fn note_last_ends(&mut self, common: &Common) {
        let emergency = &common.emergency;
        let registry = &common.registry;
        registry.close_ended(|one| self.note_end(one.id(), emergency));
    }

    /// Whether any end was noted since the last call.
    pub(super) fn take_news(&mut self) -> bool {
        std::mem::take(&mut self.has_news)
    }

    /// Notes an end: what is left of the process, its error, its cleanup, and the notifications of
    /// its end.
    fn note_end(&mut self, id: ProcessId, emergency: &Emergency) {
        self.count_looks(1);
        let Some(member) = self.members.get_mut(&id) else {
            // Otherwise its end was noted before it was reported.
            if !self.forgotten.contains(id.get()) {
                self.premature.insert(id);
            }
            return;
        };
        if std::mem::replace(&mut member.is_reaped, true) {
            return;
        }
        self.has_news = true;
        let exit = member.handle.exit();
        let said = member.handle.take_exit_value::<Verdict>();
        let said = said.and_then(|verdict| verdict.0);
        // A panicking process has triggered the emergency already, unless the panic was in the
        // thread around the body.
        if matches!(exit, Some(Exit::Panicked(_))) {
            emergency.trigger(Cause::Panic);
        }
        let ended_for_overrun = exit == Some(Exit::Cancelled)
            && (member.ledger.as_ref()).is_some_and(|ledger| ledger.is_sentenced());
        let error = exit.and_then(|exit| error_of(member, exit, said));
        member.has_failed = error.is_some();
        let (order, resident) = (member.order, member.resident.take());
        let of = (resident.is_some()).then(|| (order, member.name().to_owned()));
        member.handle.forget_body();
        let may_be_forgotten = member.may_be_forgotten();
        if let Some(error) = &error {
            self.first_error.keep(order, error);
            if is_panic(error) {
                self.first_panic.keep(order, error);
            }
        }
        if resident.is_some() || error.is_some() {
            self.reaped.push_back(Reaped {
                of,
                resident,
                ended_for_overrun,
                error,
                forgotten: None,
            });
        }
        if may_be_forgotten {
            self.ended.push_back(id);
            // Two, to make up for one that is kept for its news.
            for _ in 0..2 {
                if self.ended.len() > self.most_ended {
                    self.forget_one();
                }
            }
        }
    }

    /// Forgets the remembered process that ended first.
    fn forget_one(&mut self) {
        let Some(id) = self.ended.pop_front() else {
            return;
        };
        let Some(member) = self.members.remove(&id) else {
            return;
        };
        if let Some(ledger) = &member.ledger {
            if ledger.has_news() || ledger.emergency().is_some() {
                // There is something to be reported of it yet.
                self.members.insert(id, member);
                self.ended.push_back(id);
                return;
            }
            self.monitored.remove(&(member.order, id));
        }
        if !member.shares_name {
            self.names.remove(member.handle.as_name());
        }
        let overruns = member.ledger.as_ref().map_or(0, |ledger| {
            ledger.reports().iter().map(|one| one.overruns).sum()
        });
        self.earlier.count(&member, overruns);
        self.forgotten.insert(id.get());
        if member.has_failed {
            self.reaped.push_back(Reaped {
                forgotten: Some(member.handle),
                ..Reaped::default()
            });
        }
    }

    /// The next piece of work for a process that has ended.
    pub(super) fn next_reaped(&mut self) -> Option<Reaped> {
        self.reaped.pop_front()
    }

    #[inline]
    pub(super) fn handle(&self, id: ProcessId) -> Option<ProcessHandle> {
        self.members.get(&id).map(|member| member.handle.clone())
    }

    pub(crate) fn name(&self, id: ProcessId) -> Option<&str> {
        self.members.get(&id).map(Member::name)
    }

    /// Whether a process of this number has ended and was forgotten.
    pub(super) fn has_forgotten(&self, id: ProcessId) -> bool {
        self.forgotten.contains(id.get())
    }

    /// All remembered processes, in the order of their start. O(n log n).
    pub(super) fn in_order(&self) -> Vec<(ProcessId, &Member)> {
        self.count_looks(self.members.len());
        let mut all: Vec<_> = self.members.iter().map(|(id, one)| (*id, one)).collect();
        all.sort_unstable_by_key(|(_, one)| one.order);
        all
    }

    /// The processes with budgets, in the order of their start.
    pub(super) fn monitored(&self) -> impl Iterator<Item = (ProcessId, &Member)> {
        self.count_looks(self.monitored.len());
        let members = &self.members;
        self.monitored
            .iter()
            .filter_map(|(_, id)| Some((*id, members.get(id)?)))
    }

    /// The processes that have no known end.
    pub(super) fn left_behind(&mut self) -> impl Iterator<Item = &mut Member> {
        self.count_looks(self.members.len());
        self.members.values_mut().filter(|member| !member.is_reaped)
    }

    /// The overrun that ends the system, if one does, with the process that caused it.
    pub(super) fn overrun(&self) -> Option<Error> {
        self.monitored().find_map(|(_, member)| {
            let offence = member.ledger.as_ref()?.emergency()?;
            Some(offence.in_process(member.name()))
        })
    }

    pub(super) fn reports(&self) -> Vec<ProcessReport> {
        let all = self.in_order().into_iter();
        all.map(|(_, member)| process_report(member)).collect()
    }

    pub(super) fn earlier(&self) -> EarlierProcesses {
        self.earlier.clone()
    }

    #[cfg(not(test))]
    fn count_looks(&self, _: usize) {}

    #[cfg(test)]
    fn count_looks(&self, looks: usize) {
        self.looks.set(self.looks.get() + looks);
    }

    /// The total number of entries stored for processes.
    #[cfg(test)]
    pub(super) fn size(&self) -> usize {
        self.members.len()
            + self.names.len()
            + self.monitored.len()
            + self.premature.len()
            + self.reaped.len()
            + self.ended.len()
            + self.forgotten.0.len()
    }
}

fn is_panic(error: &Error) -> bool {
    matches!(error, Error::Process { source, .. } if matches!(**source, Error::Panicked(_)))
}

fn error_of(member: &Member, exit: Exit, said: Option<Ended>) -> Option<Error> {
    let offence = (member.ledger.as_ref()).and_then(|ledger| ledger.offence());
    let error = match (exit, said) {
        (Exit::Panicked(message), _) => Error::Panicked(message),
        (Exit::Cancelled, _) => offence.unwrap_or(Error::Cancelled),
        (_, Some(Ended::Returned(error))) => error,
        (_, Some(Ended::Failed(failure))) => failure.into(),
        _ => return None,
    };
    Some(error.in_process(member.name()))
}

fn process_report(member: &Member) -> ProcessReport {
    let handle = &member.handle;
    ProcessReport {
        name: member.name().to_owned(),
        exit: handle.exit(),
        failed: member.has_failed,
        polls: handle.polls(),
        longest_poll: handle.longest_poll(),
        budgets: (member.ledger.as_ref())
            .map(|ledger| ledger.reports())
            .unwrap_or_default(),
    }
}

/// A set of numbers as ranges, by their first numbers, each with its last: processes that come and
/// go leave few ranges. A range has no gaps, and there is a gap between two ranges.
#[derive(Default)]
struct Numbers(BTreeMap<u32, u32>);

impl Numbers {
    fn insert(&mut self, number: u32) {
        if let Some(mut newest) = self.0.last_entry()
            && newest.get().checked_add(1) == Some(number)
        {
            *newest.get_mut() = number;
            return;
        }
        let after = number.checked_add(1).and_then(|next| self.0.remove(&next));
        let last = after.unwrap_or(number);
        match self.0.range_mut(..=number).next_back() {
            Some((_, end)) if *end >= number => {}
            Some((_, end)) if *end + 1 == number => *end = last,
            _ => drop(self.0.insert(number, last)),
        }
    }

    fn contains(&self, number: u32) -> bool {
        let before = self.0.range(..=number).next_back();
        before.is_some_and(|(_, &last)| last >= number)
    }
}

#[cfg(test)]
mod tests;
