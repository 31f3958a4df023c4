//! CSP events in words: the names that a recording has for their numbers.

use luna_core::events::code;
use luna_logger::format::{Event, Record, Subject};
use std::collections::HashMap;

/// The names until now.
#[derive(Default)]
pub(super) struct Names {
    names: HashMap<(Subject, u32), (String, u32)>,
    threads: HashMap<u32, String>,
}

/// An event in words; a field without meaning is empty.
pub(super) struct Words {
    pub(super) what: String,
    pub(super) subject: String,
    pub(super) first: String,
    pub(super) second: String,
}

impl Names {
    /// Keeps the names of a record.
    pub(super) fn take(&mut self, record: &Record<'_>) {
        match record {
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

    /// The number, name and parent of all that are of this kind.
    pub(super) fn all(&self, of: Subject) -> impl Iterator<Item = (u32, &str, u32)> {
        let all = self
            .names
            .iter()
            .filter(move |((subject, _), _)| *subject == of);
        all.map(|((_, number), (name, parent))| (*number, name.as_str(), *parent))
    }

    /// Its name, or its kind and number.
    pub(super) fn of(&self, subject: Subject, number: u64) -> String {
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
    fn process(&self, number: u64) -> String {
        match number {
            0 => String::new(),
            number => self.of(Subject::Process, number),
        }
    }

    pub(super) fn thread(&self, number: u32) -> Option<&str> {
        self.threads.get(&number).map(String::as_str)
    }

    /// The process that a loop belongs to; 0 if it is not known.
    pub(super) fn process_of_loop(&self, number: u32) -> u32 {
        let known = self.names.get(&(Subject::Loop, number));
        known.map_or(0, |(_, parent)| *parent)
    }

    /// What a process waits for, in the words of `WAITING`; empty if that is not known.
    pub(super) fn awaited(&self, [kind, number]: [u64; 2]) -> String {
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
    pub(super) fn words(&self, event: &Event) -> Words {
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
                let degree = match a {
                    0 => "normal",
                    1 => "warning",
                    2 => "safe state",
                    _ => "emergency",
                };
                (self.process(subject), degree.to_owned(), none())
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
}
