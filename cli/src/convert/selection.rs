//! What of a recording is converted.

use super::recording::{each, time};
use crate::args::{Convert, Format, Selection};
use crate::failure::{Failure, failed};
use glob::Pattern;
use luna_events::code;
use luna_logger::format::{Event, Names, Record, Subject};
use std::collections::{BTreeMap, HashSet};
use std::path::Path;

/// What a recording has, found by reading it once.
struct Contents {
    start: Option<u64>,
    epoch: Option<i128>,
    signals: BTreeMap<u32, String>,
    names: Names,
    /// How many cycles of each loop were recorded.
    cycles: BTreeMap<u32, u64>,
}

/// What has names that can be chosen.
#[derive(Clone, Copy)]
enum Kind {
    Signal,
    Event,
    Process,
    Loop,
}

/// Decides which records are converted; by default all.
#[derive(Default)]
pub(super) struct Filter {
    /// The recording's first time: all others count from it, here and in the scope.
    pub(super) start: u64,
    /// The time of the day at the origin of its clock, in ns since 1970, if it has one.
    pub(super) epoch: Option<i128>,
    /// Counted from `start`, in ns.
    from: Option<u64>,
    until: Option<u64>,
    signals: Option<HashSet<u32>>,
    codes: Option<HashSet<u32>>,
    processes: Option<HashSet<u32>>,
    /// The chosen processes' loops and sub-processes.
    loops: HashSet<u32>,
    sub_processes: HashSet<u32>,
    /// The loop with a row for each cycle.
    cycles: Option<u32>,
    /// It was named.
    is_asked_per_cycle: bool,
}

impl Filter {
    /// Reads what each recording has, and finds there what the command line names: each name in one
    /// of them at least.
    pub(super) fn of(arguments: &Convert) -> Result<Vec<Filter>, Failure> {
        let files = &arguments.files;
        let all: Result<Vec<_>, _> = files.iter().map(|path| Contents::of(path)).collect();
        let all = all?;
        let per_cycle = exactly(arguments.per_cycle.as_deref());
        let Selection {
            signals,
            events,
            process,
            ..
        } = &arguments.selection;
        for (kind, patterns) in [
            (Kind::Signal, signals),
            (Kind::Event, events),
            (Kind::Process, process),
            (Kind::Loop, &per_cycle),
        ] {
            let names: Vec<(u32, &str)> = all.iter().flat_map(|one| one.of_kind(kind)).collect();
            let is_there = |pattern: &Pattern| {
                pattern.as_str() == "none" || names.iter().any(|(_, name)| pattern.matches(name))
            };
            if let Some(pattern) = patterns.iter().find(|pattern| !is_there(pattern)) {
                let why = missing(kind, pattern, &names, files.len() > 1);
                return Err(failed(&files[0])(why));
            }
        }
        Ok(all
            .iter()
            .map(|one| Filter::of_one(one, arguments))
            .collect())
    }

    fn of_one(contents: &Contents, arguments: &Convert) -> Filter {
        let Selection {
            signals,
            events,
            process,
            from,
            until,
        } = &arguments.selection;
        let nanos = |time: &std::time::Duration| time.as_nanos() as u64;
        let chosen = |kind, patterns: &[Pattern]| choose(patterns, &contents.of_kind(kind));
        let mut filter = Filter {
            start: contents.start.unwrap_or_default(),
            epoch: contents.epoch,
            from: from.as_ref().map(nanos),
            until: until.as_ref().map(nanos),
            signals: chosen(Kind::Signal, signals),
            codes: chosen(Kind::Event, events),
            processes: chosen(Kind::Process, process),
            ..Filter::default()
        };
        let cycles = chosen(Kind::Loop, &exactly(arguments.per_cycle.as_deref()));
        filter.cycles = cycles.and_then(|found| found.into_iter().min());
        if arguments.to == Format::Csv && arguments.per_cycle.is_none() && !arguments.per_sample {
            filter.cycles = contents.most_cycles();
        }
        filter.is_asked_per_cycle = arguments.per_cycle.is_some();
        let of_chosen = |subject| {
            let all = contents.names.all(subject);
            all.filter(|(_, _, parent)| filter.is_chosen(*parent))
                .map(|(number, ..)| number)
                .collect()
        };
        (filter.loops, filter.sub_processes) =
            (of_chosen(Subject::Loop), of_chosen(Subject::SubProcess));
        filter
    }

    /// From here on times count from this one, on the recording's clock.
    pub(super) fn count_from(&mut self, start: u64) {
        self.start = start;
    }

    /// Whether the record is converted.
    pub(super) fn takes(&self, record: &Record<'_>) -> bool {
        let is_in = |set: &Option<HashSet<u32>>, number| {
            set.as_ref().is_none_or(|set| set.contains(&number))
        };
        self.is_in_time(record)
            && match record {
                Record::Signal(info) => is_in(&self.signals, info.number),
                Record::Sample { signal, .. } => is_in(&self.signals, *signal),
                Record::Message { process, .. } => self.is_chosen(*process),
                Record::Event(event) => {
                    is_in(&self.codes, event.code.into()) && self.concerns(event)
                }
                _ => true,
            }
    }

    /// Whether the record begins a cycle of the loop that gives the rows.
    pub(super) fn is_cycle(&self, record: &Record<'_>) -> bool {
        let is_slot =
            |event: &Event| event.code == code::SLOT && Some(event.subject) == self.cycles;
        matches!(record, Record::Event(event) if is_slot(event)) && self.is_in_time(record)
    }

    fn is_in_time(&self, record: &Record<'_>) -> bool {
        let after = |time| self.start.saturating_add(time);
        time(record).is_none_or(|time| {
            self.from.is_none_or(|from| time >= after(from))
                && self.until.is_none_or(|until| time < after(until))
        })
    }

    /// The loop whose cycles are rows.
    pub(super) fn per_cycle(&self) -> Option<u32> {
        self.cycles
    }

    /// Whether the command line names this loop: each of its cycles is a row then.
    pub(super) fn is_asked_per_cycle(&self) -> bool {
        self.is_asked_per_cycle
    }

    fn is_chosen(&self, process: u32) -> bool {
        self.processes
            .as_ref()
            .is_none_or(|chosen| chosen.contains(&process))
    }

    /// Whether the event is one of a chosen process.
    fn concerns(&self, event: &Event) -> bool {
        if self.processes.is_none() {
            return true;
        }
        let of = |process: u64| u32::try_from(process).is_ok_and(|process| self.is_chosen(process));
        let [a, b] = event.arguments;
        match event.code {
            code::COMMUNICATION => of(a) || of(b),
            code::SPAWNED => of(event.subject.into()) || of(a),
            code::SLOT | code::LATE => self.loops.contains(&event.subject),
            code::SUB_RUNNING | code::SUB_WAITING | code::SUB_DONE => {
                self.sub_processes.contains(&event.subject)
            }
            code::ASLEEP | code::AWAKE | code::STOLEN => false,
            _ => of(event.subject.into()),
        }
    }
}

impl Contents {
    /// The loop with the most cycles, of equal ones the first.
    fn most_cycles(&self) -> Option<u32> {
        let cycles = self.cycles.iter().rev();
        let most = cycles.max_by_key(|(_, cycles)| **cycles);
        most.map(|(number, _)| *number)
    }

    /// The numbers and names of all of a kind.
    fn of_kind(&self, kind: Kind) -> Vec<(u32, &str)> {
        let subject = match kind {
            Kind::Signal => {
                let all = self.signals.iter();
                return all.map(|(number, name)| (*number, &**name)).collect();
            }
            Kind::Event => Subject::Code,
            Kind::Process => Subject::Process,
            Kind::Loop => Subject::Loop,
        };
        let all = self.names.all(subject);
        all.map(|(number, name, _)| (number, name)).collect()
    }

    fn of(path: &Path) -> Result<Contents, Failure> {
        let mut contents = Contents {
            start: None,
            epoch: None,
            signals: BTreeMap::new(),
            names: Names::default(),
            cycles: BTreeMap::new(),
        };
        each(path, &Filter::default(), |record| {
            contents.names.take(record);
            let begin = match record {
                Record::Epoch { time, unix } => {
                    let day = i128::from(*unix) - i128::from(*time);
                    contents.epoch.get_or_insert(day);
                    Some(*time)
                }
                _ => None,
            };
            contents.start = contents.start.or(begin).or(time(record));
            match record {
                Record::Signal(info) => {
                    contents.signals.insert(info.number, info.name.to_owned());
                }
                Record::Event(event) if event.code == code::SLOT => {
                    *contents.cycles.entry(event.subject).or_default() += 1;
                }
                _ => {}
            }
            Ok(())
        })?;
        Ok(contents)
    }
}

/// A pattern of this name alone.
fn exactly(name: Option<&str>) -> Vec<Pattern> {
    let name = name.map(|name| Pattern::new(&Pattern::escape(name)));
    name.into_iter().flatten().collect()
}

/// The numbers of what has a name of the patterns: nothing without patterns, since all is meant
/// then.
fn choose(patterns: &[Pattern], names: &[(u32, &str)]) -> Option<HashSet<u32>> {
    if patterns.is_empty() {
        return None;
    }
    let is_meant = |name: &str| {
        let patterns = patterns.iter().filter(|pattern| pattern.as_str() != "none");
        patterns.into_iter().any(|pattern| pattern.matches(name))
    };
    let found = names.iter().filter(|(_, name)| is_meant(name));
    Some(found.map(|(number, _)| *number).collect())
}

fn missing(kind: Kind, pattern: &Pattern, names: &[(u32, &str)], are_several: bool) -> String {
    let mut there: Vec<&str> = names.iter().map(|(_, name)| *name).collect();
    there.sort_unstable();
    there.dedup();
    let what = match kind {
        Kind::Signal => "signal",
        Kind::Event => "kind of event",
        Kind::Process => "process",
        Kind::Loop => "loop",
    };
    // All but signals are declared together with events.
    let why = match kind {
        Kind::Signal => "",
        _ => {
            ": it was recorded without events (`Logging::events`, or LUNA_LOG_EVENTS in its environment)"
        }
    };
    let has = match are_several {
        true => "neither it nor another recording has a",
        false => "it has no",
    };
    match there.is_empty() {
        true => format!("{has} {what} `{pattern}`, and none at all{why}"),
        false => format!("{has} {what} `{pattern}`; there are {}", there.join(", ")),
    }
}
