//! CSP events in words: the names that a recording has for their numbers.

use super::record::{Event, Record, Subject};
use luna_events::code;
use std::collections::{HashMap, HashSet};

/// The names that a recording has declared until now. They put its events in words.
///
/// ```
/// use luna_events::code;
/// use luna_logger::format::{Event, Names, Record, Subject};
///
/// let mut names = Names::default();
/// for (subject, number, name) in [
///     (Subject::Code, code::COMMUNICATION.into(), "communication"),
///     (Subject::Process, 3, "servo"),
///     (Subject::Channel, 3, "torque"),
/// ] {
///     names.take(&Record::Name { subject, number, parent: 0, name, runs_on: None });
/// }
/// let event = Event {
///     thread: 0,
///     time: 0,
///     code: code::COMMUNICATION,
///     subject: 3,
///     arguments: [3, 0],
/// };
/// let words = names.words(&event);
/// assert_eq!((&*words.what, &*words.subject), ("communication", "torque"));
/// assert_eq!((&*words.first, &*words.second), ("servo", ""));
/// ```
#[derive(Debug, Default)]
pub struct Names {
    /// With the number of the parent.
    names: HashMap<(Subject, u32), (String, u32)>,
    threads: HashMap<u32, String>,
    forgets: bool,
    /// Of these it forgets the names next.
    ended: Vec<(Subject, u32)>,
}

/// An event in words; a field without meaning is empty. `docs/events.md` lists what the fields are.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Words {
    /// The kind of event.
    pub what: String,
    /// The name of its subject.
    pub subject: String,
    /// Its first number.
    pub first: String,
    /// Its second number.
    pub second: String,
}

/// So many processes and sub-processes keep their names at least after they have ended: the events
/// of other threads may come later.
const KEPT: usize = 4096;

impl Names {
    /// For a recording without an end: the names of processes and sub-processes, and of their
    /// loops, are forgotten some time after they have ended.
    pub fn forgetting() -> Names {
        Names {
            forgets: true,
            ..Names::default()
        }
    }

    /// Keeps what a record declares.
    pub fn take(&mut self, record: &Record<'_>) {
        match record {
            Record::Event(event) if self.forgets => self.note_end(event),
            Record::Name {
                subject,
                number,
                parent,
                name,
                ..
            } => {
                let reported = ((*name).to_owned(), *parent);
                self.names.insert((*subject, *number), reported);
            }
            Record::Thread { number, name } => {
                self.threads.insert(*number, (*name).to_owned());
            }
            _ => {}
        }
    }

    fn note_end(&mut self, event: &Event) {
        let of = match event.code {
            code::DONE => Subject::Process,
            code::SUB_DONE => Subject::SubProcess,
            _ => return,
        };
        self.ended.push((of, event.subject));
        if self.ended.len() == 2 * KEPT {
            let gone: HashSet<_> = self.ended.drain(..KEPT).collect();
            self.names.retain(|name, (_, parent)| {
                let whole = match name.0 {
                    Subject::Loop | Subject::SubProcess => (Subject::Process, *parent),
                    _ => *name,
                };
                !(gone.contains(name) || gone.contains(&whole))
            });
        }
    }

    /// The number, name and parent of all that are of this kind.
    pub fn all(&self, of: Subject) -> impl Iterator<Item = (u32, &str, u32)> {
        let all = self
            .names
            .iter()
            .filter(move |((subject, _), _)| *subject == of);
        all.map(|((_, number), (name, parent))| (*number, name.as_str(), *parent))
    }

    /// Its name, or its kind and number.
    pub fn of(&self, subject: Subject, number: u64) -> String {
        let kind = match subject {
            Subject::Process => "process",
            Subject::Executor => "executor",
            Subject::Channel => "channel",
            Subject::Barrier => "barrier",
            Subject::Lock => "lock",
            Subject::Loop => "loop",
            Subject::SubProcess => "sub-process",
            _ => "event",
        };
        let known = u32::try_from(number).ok();
        let known = known.and_then(|number| self.names.get(&(subject, number)));
        known.map_or_else(|| format!("{kind} {number}"), |(name, _)| name.clone())
    }

    /// A process' name; empty for none.
    pub fn process(&self, number: u64) -> String {
        match number {
            0 => String::new(),
            number => self.of(Subject::Process, number),
        }
    }

    /// A thread's name, or its number.
    pub fn thread(&self, number: u32) -> String {
        let known = self.threads.get(&number);
        known.map_or_else(|| format!("thread {number}"), String::clone)
    }

    /// The process that a loop belongs to; 0 if it is not known.
    pub fn process_of_loop(&self, number: u32) -> u32 {
        let known = self.names.get(&(Subject::Loop, number));
        known.map_or(0, |(_, parent)| *parent)
    }

    /// What a process waits for, in the words of `WAITING`; empty if that is not known.
    fn awaited(&self, [kind, number]: [u64; 2]) -> String {
        let kinds = [
            Subject::Channel,
            Subject::Barrier,
            Subject::Lock,
            Subject::Loop,
        ];
        let kind = kinds.into_iter().find(|one| *one as u64 == kind);
        kind.map_or_else(String::new, |kind| self.of(kind, number))
    }

    /// An event in words.
    pub fn words(&self, event: &Event) -> Words {
        let what = self.of(Subject::Code, event.code.into());
        let [a, b] = event.arguments;
        let subject: u64 = event.subject.into();
        let number = |number: u64| number.to_string();
        let none = String::new;
        let (subject, first, second) = match event.code {
            code::READY | code::SPAWNED => (self.process(subject), self.process(a), none()),
            code::RUNNING => (self.process(subject), none(), none()),
            code::WAITING if a == code::STILL_READY => {
                (self.process(subject), "still ready".to_owned(), none())
            }
            code::WAITING => (self.process(subject), self.awaited([a, b]), none()),
            code::DONE => {
                let how = match a {
                    code::ended::OK => "ok",
                    code::ended::ERROR => "error",
                    code::ended::PANICKED => "panicked",
                    _ => "cancelled",
                };
                (self.process(subject), how.to_owned(), none())
            }
            code::COMMUNICATION => (
                self.of(Subject::Channel, subject),
                self.process(a),
                self.process(b),
            ),
            code::ALTERNATIVE => {
                let channel = match b {
                    0 => none(),
                    channel => self.of(Subject::Channel, channel),
                };
                (self.process(subject), number(a), channel)
            }
            code::ASLEEP | code::AWAKE => (self.of(Subject::Executor, subject), none(), none()),
            code::SLOT => (self.of(Subject::Loop, subject), number(a), number(b)),
            code::LATE => (self.of(Subject::Loop, subject), number(a), late_cause(b)),
            code::EMERGENCY => {
                let (degree, signal) = match (a, b) {
                    (0, _) => ("normal", ""),
                    (1, _) => ("warning", ""),
                    (2, _) => ("safe state", ""),
                    (_, 1) => ("stopped", "SIGHUP"),
                    (_, 2) => ("stopped", "SIGINT"),
                    (_, 15) => ("stopped", "SIGTERM"),
                    _ => ("emergency", ""),
                };
                (self.process(subject), degree.to_owned(), signal.to_owned())
            }
            code::SUB_RUNNING => {
                let around = match b {
                    0 => none(),
                    around => self.of(Subject::SubProcess, around),
                };
                let one = self.of(Subject::SubProcess, subject);
                (one, self.process(a), around)
            }
            code::SUB_WAITING => {
                let one = self.of(Subject::SubProcess, subject);
                (one, self.awaited([a, b]), none())
            }
            code::SUB_DONE => {
                let how = match a {
                    code::sub_ended::RETURNED => "returned",
                    _ => "dropped",
                };
                let one = self.of(Subject::SubProcess, subject);
                (one, how.to_owned(), none())
            }
            code::LINK => {
                let way = match code::link::is_taken(b) {
                    true => "taken",
                    false => "sent",
                };
                (self.process(subject), number(a), way.to_owned())
            }
            code::STOLEN => (format!("core {subject}"), number(a), number(b)),
            code::PRIORITY => (self.process(subject), number(a), number(b)),
            _ => (number(subject), number(a), number(b)),
        };
        Words {
            what,
            subject,
            first,
            second,
        }
    }
}

/// The cause of a late cycle with its share, from the second number of its event. A recording that
/// was made before there were shares names none.
fn late_cause(argument: u64) -> String {
    use code::late;
    let cause = match late::cause(argument) {
        late::LOOP_ITSELF => "the loop itself",
        late::OTHER_PROCESS => "another process",
        late::OTHER_THREAD => "another thread",
        _ => "unknown",
    };
    match late::percent(argument) {
        0 => "unknown".to_owned(),
        percent => format!("{cause} ({percent} %)"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_cause_of_a_late_cycle_has_its_share() {
        use code::late;
        let words = |cause, percent| late_cause(late::argument(cause, percent, Some(1)));
        assert_eq!(words(late::OTHER_PROCESS, 98), "another process (98 %)");
        assert_eq!(words(late::UNKNOWN, 0), "unknown");
        assert_eq!(
            late_cause(late::OTHER_PROCESS),
            "unknown",
            "without a share"
        );
    }

    #[test]
    fn names_of_what_has_ended_are_forgotten_in_an_endless_recording() {
        let (mut all, mut some) = (Names::default(), Names::forgetting());
        let ends = 10 * KEPT as u32;
        for number in 1..=ends {
            let name = |subject, parent| Record::Name {
                subject,
                number,
                parent,
                name: "one",
                runs_on: None,
            };
            let end = |code| {
                Record::Event(Event {
                    thread: 0,
                    time: 0,
                    code,
                    subject: number,
                    arguments: [0, 0],
                })
            };
            for record in [
                name(Subject::Process, 0),
                name(Subject::Loop, number),
                name(Subject::SubProcess, number),
                end(code::SUB_DONE),
                end(code::DONE),
            ] {
                all.take(&record);
                some.take(&record);
            }
        }
        assert_eq!(all.names.len(), 3 * ends as usize);
        assert!(some.names.len() <= 4 * KEPT, "{}", some.names.len());
        assert_eq!(some.of(Subject::Process, ends.into()), "one");
        assert_eq!(some.of(Subject::Process, 1), "process 1");
    }
}
