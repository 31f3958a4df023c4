//! One of several programs: its records with numbers and names that are unique among all.

use super::MAX_PROGRAMS;
use luna_events::code;
use luna_logger::format::{Event, Subject};
use std::borrow::Cow;
use std::collections::HashMap;
use std::time::{Duration, Instant};

/// Of which messages were lost that belong to no thread.
const NO_THREAD: u32 = u32::MAX;

#[derive(Debug)]
pub(super) struct Program {
    /// Its place among the programs.
    pub(super) place: u32,
    pub(super) name: String,
    pub(super) is_live: bool,
    /// Its recording is whole.
    pub(super) has_ended: bool,
    /// Counts the recordings that were its own, one after the other.
    pub(super) turn: u32,
    /// The last time that it has reported, on the common clock.
    pub(super) last: u64,
    pub(super) heard: Instant,
    /// What is to be added to its times, when that is known.
    pub(super) shift: Option<i64>,
    /// The numbers of its signals among those of all.
    pub(super) signals: HashMap<u32, u32>,
    pub(super) lost_blocks: u64,
}

impl Program {
    pub(super) fn new(place: u32, name: String) -> Self {
        Self {
            place,
            name,
            is_live: true,
            has_ended: false,
            turn: 0,
            last: 0,
            heard: Instant::now(),
            shift: None,
            signals: HashMap::new(),
            lost_blocks: 0,
        }
    }

    /// Whether another recording may continue it.
    pub(super) fn has_gone(&self, silent: Duration) -> bool {
        !self.is_live || self.has_ended || self.heard.elapsed() >= silent
    }

    /// A time on the common clock.
    pub(super) fn time(&self, time: u64) -> u64 {
        time.saturating_add_signed(self.shift.unwrap_or(0))
    }

    /// A number that no other program has; 0 stays 0, which names nothing. Numbers above 67 million
    /// may meet.
    pub(super) fn number(&self, number: u32) -> u32 {
        match number {
            0 => 0,
            number => number.wrapping_mul(MAX_PROGRAMS).wrapping_add(self.place),
        }
    }

    pub(super) fn thread(&self, number: u32) -> u32 {
        match number {
            NO_THREAD => NO_THREAD - self.place,
            number => number.wrapping_mul(MAX_PROGRAMS).wrapping_add(self.place),
        }
    }

    fn argument(&self, number: u64) -> u64 {
        u32::try_from(number).map_or(number, |number| self.number(number).into())
    }

    /// The program's name and this one, unless this one begins with it.
    pub(super) fn named<'a>(&self, name: &'a str) -> Cow<'a, str> {
        let rest = name.strip_prefix(&*self.name);
        match rest.is_some_and(|rest| rest.is_empty() || rest.starts_with(['/', ' '])) {
            true => name.into(),
            false => format!("{}/{name}", self.name).into(),
        }
    }

    pub(super) fn subject(&self, of: Subject, number: u32) -> u32 {
        match of {
            // The same in all programs.
            Subject::Code => number,
            // As those of threads.
            Subject::Executor => self.thread(number),
            _ => self.number(number),
        }
    }

    /// The event with the numbers of all: `docs/events.md` says which are numbers of something.
    pub(super) fn event(&self, event: &Event) -> Event {
        let [a, b] = event.arguments;
        let subject = match event.code {
            code::STOLEN => event.subject,
            code::ASLEEP | code::AWAKE => self.thread(event.subject),
            _ => self.number(event.subject),
        };
        let arguments = match event.code {
            code::READY | code::SPAWNED => [self.argument(a), b],
            code::COMMUNICATION | code::SUB_RUNNING => [self.argument(a), self.argument(b)],
            code::WAITING | code::SUB_WAITING if a != code::STILL_READY => [a, self.argument(b)],
            code::ALTERNATIVE => [a, self.argument(b)],
            _ => [a, b],
        };
        Event {
            thread: self.thread(event.thread),
            time: self.time(event.time),
            code: event.code,
            subject,
            arguments,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_name_has_its_programs_name_once() {
        let program = Program::new(0, "feeder".to_owned());
        for (name, named) in [
            ("speed", "feeder/speed"),
            ("feeder", "feeder"),
            ("feeder/speed", "feeder/speed"),
            ("feeder controller", "feeder controller"),
            ("feeder-belt/speed", "feeder/feeder-belt/speed"),
            ("", "feeder/"),
        ] {
            assert_eq!(program.named(name), named);
        }
    }

    #[test]
    fn numbers_in_events_are_those_of_all_and_others_stay() {
        let program = Program::new(3, String::new());
        let own = |n: u32| n * MAX_PROGRAMS + 3;
        let event = |code, arguments| {
            let event = program.event(&Event {
                thread: 1,
                time: 7,
                code,
                subject: 5,
                arguments,
            });
            assert_eq!((event.thread, event.time), (own(1), 7));
            (event.subject, event.arguments)
        };
        let wide = |n: u32| u64::from(own(n));
        assert_eq!(event(code::READY, [2, 0]), (own(5), [wide(2), 0]));
        assert_eq!(event(code::READY, [0, 0]), (own(5), [0, 0]));
        assert_eq!(
            event(code::COMMUNICATION, [2, 4]),
            (own(5), [wide(2), wide(4)])
        );
        assert_eq!(event(code::WAITING, [3, 8]), (own(5), [3, wide(8)]));
        assert_eq!(event(code::WAITING, [255, 0]), (own(5), [255, 0]));
        assert_eq!(event(code::ALTERNATIVE, [1, 8]), (own(5), [1, wide(8)]));
        assert_eq!(event(code::SLOT, [100, 200]), (own(5), [100, 200]));
        assert_eq!(event(code::LATE, [100, 0x6201]), (own(5), [100, 0x6201]));
        assert_eq!(event(code::ASLEEP, [0, 0]), (own(5), [0, 0]));
        assert_eq!(event(code::STOLEN, [9, 9]), (5, [9, 9]));
        assert_eq!(event(code::LINK, [9, 1 << 40]), (own(5), [9, 1 << 40]));
    }
}
