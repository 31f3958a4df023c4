//! What of a recording is converted.

use super::events::Names;
use super::recording::{each, time};
use crate::args::{Convert, Selection};
use crate::failure::Failure;
use glob::Pattern;
use luna_core::events::code;
use luna_logger::format::{Event, Record, Subject};
use std::collections::{BTreeMap, HashSet};
use std::path::Path;

/// What a recording has, found by reading it once.
struct Contents {
    start: Option<u64>,
    signals: BTreeMap<u32, String>,
    names: Names,
}

/// Decides which records are converted; by default all.
#[derive(Default)]
pub(super) struct Filter {
    /// The recording's first time: all others count from it, here and in the scope.
    pub(super) start: u64,
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
}

impl Filter {
    /// Reads what the recording has, and finds there what the command line names.
    pub(super) fn of(arguments: &Convert) -> Result<Filter, Failure> {
        let contents = Contents::of(&arguments.file)?;
        let start = contents.start.unwrap_or_default();
        let Selection {
            signals,
            events,
            process,
            from,
            until,
        } = &arguments.selection;
        let after = |seconds: &Option<std::time::Duration>| {
            seconds.map(|after| start.saturating_add(after.as_nanos() as u64))
        };
        let chosen = |kind: &str, patterns: &[Pattern], names: Vec<(u32, &str)>| {
            choose(patterns, &names).map_err(|pattern| Failure::Log {
                path: arguments.file.clone(),
                error: missing(kind, &pattern, &names),
            })
        };
        let signal_names = contents
            .signals
            .iter()
            .map(|(number, name)| (*number, name.as_str()));
        let of = |subject| {
            contents
                .names
                .all(subject)
                .map(|(number, name, _)| (number, name))
                .collect()
        };
        let mut filter = Filter {
            start,
            from: after(from),
            until: after(until),
            signals: chosen("signal", signals, signal_names.collect())?,
            codes: chosen("kind of event", events, of(Subject::Code))?,
            processes: chosen("process", process, of(Subject::Process))?,
            ..Filter::default()
        };
        if let Some(name) = &arguments.per_cycle {
            let exact = Pattern::new(&Pattern::escape(name))
                .into_iter()
                .collect::<Vec<_>>();
            let found = chosen("loop", &exact, of(Subject::Loop))?;
            filter.cycles = found.and_then(|found| found.into_iter().min());
        }
        let of_chosen = |subject| {
            let all = contents.names.all(subject);
            all.filter(|(_, _, parent)| filter.is_chosen(*parent))
                .map(|(number, ..)| number)
                .collect()
        };
        (filter.loops, filter.sub_processes) =
            (of_chosen(Subject::Loop), of_chosen(Subject::SubProcess));
        Ok(filter)
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

    /// Whether the record begins a cycle of the loop whose cycles are rows.
    pub(super) fn is_cycle(&self, record: &Record<'_>) -> bool {
        let is_slot =
            |event: &Event| event.code == code::SLOT && Some(event.subject) == self.cycles;
        matches!(record, Record::Event(event) if is_slot(event)) && self.is_in_time(record)
    }

    fn is_in_time(&self, record: &Record<'_>) -> bool {
        time(record).is_none_or(|time| {
            self.from.is_none_or(|from| time >= from) && self.until.is_none_or(|until| time < until)
        })
    }

    /// Whether a row is a cycle.
    pub(super) fn is_per_cycle(&self) -> bool {
        self.cycles.is_some()
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
    fn of(path: &Path) -> Result<Contents, Failure> {
        let mut contents = Contents {
            start: None,
            signals: BTreeMap::new(),
            names: Names::default(),
        };
        each(path, &Filter::default(), |record| {
            contents.names.take(record);
            let epoch = match record {
                Record::Epoch { time, .. } => Some(*time),
                _ => None,
            };
            contents.start = contents.start.or(epoch).or(time(record));
            if let Record::Signal(info) = record {
                contents.signals.insert(info.number, info.name.to_owned());
            }
            Ok(())
        })?;
        Ok(contents)
    }
}

/// The numbers of what has a name of the patterns: nothing without patterns, since all is meant
/// then. A pattern that no name has is an error.
fn choose(patterns: &[Pattern], names: &[(u32, &str)]) -> Result<Option<HashSet<u32>>, Pattern> {
    if patterns.is_empty() {
        return Ok(None);
    }
    let mut chosen = HashSet::new();
    for pattern in patterns.iter().filter(|pattern| pattern.as_str() != "none") {
        let before = chosen.len();
        let found = names.iter().filter(|(_, name)| pattern.matches(name));
        chosen.extend(found.map(|(number, _)| *number));
        if chosen.len() == before && !names.iter().any(|(_, name)| pattern.matches(name)) {
            return Err(pattern.clone());
        }
    }
    Ok(Some(chosen))
}

fn missing(kind: &str, pattern: &Pattern, names: &[(u32, &str)]) -> String {
    let mut there: Vec<&str> = names.iter().map(|(_, name)| *name).collect();
    there.sort_unstable();
    there.dedup();
    match there.is_empty() {
        true => format!("it has no {kind} `{pattern}`, and none at all"),
        false => format!(
            "it has no {kind} `{pattern}`; there are {}",
            there.join(", ")
        ),
    }
}
