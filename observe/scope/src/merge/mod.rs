//! Several programs as one recording: on one time axis, with the program's name before each name.
//!
//! Declarations are passed on at once. What has a time waits until all programs have reported later
//! ones, so that times are in order.

mod files;
mod held;
mod program;
#[cfg(test)]
mod tests;

use held::{Held, What};
use luna_events::code;
use luna_logger::format::{ClockBase, Losing, MAX_SIGNALS, Record, RunsOn, SignalInfo, Subject};
use program::Program;
use std::cmp::Reverse;
use std::collections::{BinaryHeap, HashMap};
use std::time::{Duration, Instant};

pub use files::{MergeError, merge};

/// The most programs: as many as a receiver has senders.
pub(crate) const MAX_PROGRAMS: u32 = 64;
/// A program that has said nothing for this time is not waited for.
const SILENCE: Duration = Duration::from_millis(200);
/// The limit of the bytes of records that wait.
const MAX_HELD: usize = 64 << 20;
/// The characters of a system's name that are shown.
const MAX_NAME: usize = 64;
/// Clocks that differ by less, in ns, are one clock: the time of the day may be set a little.
const SAME_CLOCK: i64 = 1_000_000_000;

/// Takes a record of the merged recording.
pub(crate) type Out<'a> = &'a mut dyn FnMut(&Record<'_>);

/// The place of a program among the others, while no other recording continues it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Place {
    number: usize,
    turn: u32,
}

#[derive(Debug, Default)]
pub(crate) struct Merge {
    programs: Vec<Program>,
    /// The numbers of all signals, by the program's place and their name.
    signals: HashMap<(u32, String), u32>,
    held: BinaryHeap<Reverse<Held>>,
    /// The bytes of those.
    held_bytes: usize,
    taken: u64,
    /// From the common clock to ns since 1970.
    day: Option<i64>,
    /// The program that gives the counts of stolen time: all read the same counts.
    counts_stolen: Option<u32>,
    /// The last time of a recording's end.
    end: Option<u64>,
}

impl Merge {
    /// A program begins. It continues one of the same name that has ended, or has been silent for
    /// this time, as one that was killed is. None: there are too many.
    pub(crate) fn begin(
        &mut self,
        system: &str,
        clock: ClockBase,
        silent: Duration,
        out: Out<'_>,
    ) -> Option<Place> {
        let cut: String = system.chars().take(MAX_NAME).collect();
        let system = if cut.is_empty() { "unnamed" } else { &cut };
        let mut name = system.to_owned();
        let mut others = 1;
        let place = loop {
            match self.programs.iter().position(|one| one.name == name) {
                None => break self.programs.len(),
                Some(place) if self.programs[place].has_gone(silent) => break place,
                Some(_) => {
                    others += 1;
                    name = format!("{system} {others}");
                }
            }
        };
        let number = u32::try_from(place)
            .ok()
            .filter(|place| *place < MAX_PROGRAMS)?;
        match self.programs.get_mut(place) {
            Some(program) => {
                program.is_live = true;
                program.has_ended = false;
                program.turn += 1;
                program.heard = Instant::now();
                program.signals.clear();
                program.shift = None;
            }
            None => self.programs.push(Program::new(number, name)),
        }
        let names: Vec<_> = self.programs.iter().map(|one| one.name.as_str()).collect();
        out(&Record::Session {
            system: &names.join(", "),
            clock,
            written_by: concat!("luna-scope ", env!("CARGO_PKG_VERSION")),
        });
        let turn = self.programs[place].turn;
        Some(Place {
            number: place,
            turn,
        })
    }

    /// The program, unless another recording continues it.
    fn program(&mut self, place: Place) -> Option<&mut Program> {
        let program = self.programs.get_mut(place.number);
        program.filter(|program| program.turn == place.turn)
    }

    /// A program's recording has ended, or comes no more.
    pub(crate) fn end(&mut self, place: Place) {
        let Some(program) = self.program(place) else {
            return;
        };
        program.is_live = false;
        let program = &self.programs[place.number];
        if self.counts_stolen == Some(program.place) {
            self.counts_stolen = None;
        }
    }

    /// Whether a program is there.
    pub(crate) fn is_live(&self) -> bool {
        self.programs.iter().any(|program| program.is_live)
    }

    /// Takes a record of a program. What has a time is held until it is [released](Self::release).
    pub(crate) fn take(&mut self, place: Place, record: &Record<'_>, out: Out<'_>) {
        let program = &mut self.programs[place.number];
        if program.turn != place.turn {
            return;
        }
        match *record {
            Record::Session { .. } => {}
            Record::Thread { number, name } => out(&Record::Thread {
                number: program.thread(number),
                name: &program.named(name),
            }),
            Record::Signal(info) => {
                let name = program.named(info.name);
                let next = self.signals.len() as u32;
                let key = (program.place, info.name.to_owned());
                if self.signals.len() >= MAX_SIGNALS && !self.signals.contains_key(&key) {
                    return;
                }
                let number = *self.signals.entry(key).or_insert(next);
                program.signals.insert(info.number, number);
                out(&Record::Signal(SignalInfo {
                    number,
                    name: &name,
                    ..info
                }));
            }
            Record::Name {
                subject,
                number,
                parent,
                name,
                runs_on,
            } => {
                let is_code = subject == Subject::Code;
                let named = match is_code {
                    true => name.into(),
                    false => program.named(name),
                };
                out(&Record::Name {
                    subject,
                    number: program.subject(subject, number),
                    parent: match subject {
                        // What its buffer is.
                        Subject::Channel => parent,
                        _ => program.number(parent),
                    },
                    name: &named,
                    runs_on: runs_on.map(|RunsOn { executor, level }| RunsOn {
                        executor: program.thread(executor),
                        level,
                    }),
                });
            }
            Record::Losses { of, lost } => self.losses(place, of, lost, out),
            Record::Epoch { time, unix } => {
                let day = day(time, unix);
                let common = *self.day.get_or_insert(day);
                program.shift.get_or_insert(shift(day, common));
                if program.place == 0 {
                    let time = program.time(time);
                    out(&Record::Epoch { time, unix });
                }
            }
            Record::End { time } => {
                program.has_ended = true;
                self.end = self.end.max(Some(program.time(time)));
            }
            Record::Sample {
                signal,
                time,
                values,
            } => {
                if let Some(signal) = program.signals.get(&signal) {
                    let what = What::Sample(*signal, values.element_type(), values.bytes().into());
                    self.hold(place, time, what);
                }
            }
            Record::Message {
                thread,
                time,
                level,
                process,
                truncated,
                target,
                text,
            } => {
                let what = What::Message {
                    thread: program.thread(thread),
                    level,
                    process: program.number(process),
                    truncated,
                    target: target.into(),
                    text: text.into(),
                };
                self.hold(place, time, what);
            }
            Record::Event(event) => {
                let is_counted = event.code != code::STOLEN
                    || *self.counts_stolen.get_or_insert(program.place) == program.place;
                if is_counted {
                    let what = What::Event(program.event(&event));
                    self.hold(place, event.time, what);
                }
            }
            // Of a later version.
            _ => {}
        }
    }

    fn losses(&mut self, place: Place, of: Losing, lost: u64, out: Out<'_>) {
        let program = &mut self.programs[place.number];
        let of = match of {
            Losing::Signal(signal) => match program.signals.get(&signal) {
                Some(number) => Losing::Signal(*number),
                None => return,
            },
            Losing::Messages(thread) => Losing::Messages(program.thread(thread)),
            Losing::Events(thread) => Losing::Events(program.thread(thread)),
            Losing::Blocks => {
                program.lost_blocks = lost;
                let lost = self.programs.iter().map(|one| one.lost_blocks).sum();
                return out(&Record::Losses { of, lost });
            }
        };
        out(&Record::Losses { of, lost });
    }

    fn hold(&mut self, place: Place, time: u64, what: What) {
        let program = &mut self.programs[place.number];
        // A clock that is not known by now is the common one.
        program.shift.get_or_insert(0);
        let time = program.time(time);
        program.last = program.last.max(time);
        self.taken += 1;
        let order = self.taken;
        let held = Held { time, order, what };
        self.held_bytes += held.bytes();
        self.held.push(Reverse(held));
    }

    /// Notes that a program was heard.
    pub(crate) fn hear(&mut self, place: Place, now: Instant) {
        if let Some(program) = self.program(place) {
            program.heard = now;
        }
    }

    /// Until when all programs that are there and not silent have reported what happened.
    pub(crate) fn complete_until(&self, now: Instant) -> u64 {
        let heard = self.programs.iter().filter(|program| {
            program.is_live && now.saturating_duration_since(program.heard) < SILENCE
        });
        heard.map(|program| program.last).min().unwrap_or(u64::MAX)
    }

    /// Passes on what was held until this time, in the order of the times.
    pub(crate) fn release(&mut self, until: u64, out: Out<'_>) {
        while let Some(Reverse(first)) = self.held.peek() {
            if first.time > until && self.held_bytes <= MAX_HELD {
                break;
            }
            if let Some(Reverse(held)) = self.held.pop() {
                self.held_bytes -= held.bytes();
                held.give(out);
            }
        }
    }

    /// Passes on the rest, and the end if one was recorded.
    pub(crate) fn finish(&mut self, out: Out<'_>) {
        self.release(u64::MAX, out);
        if let Some(time) = self.end {
            out(&Record::End { time });
        }
    }
}

/// From a clock to ns since 1970.
fn day(time: u64, unix: i64) -> i64 {
    unix.saturating_sub_unsigned(time)
}

/// What is to be added to the times of a clock.
fn shift(day: i64, common: i64) -> i64 {
    let apart = day.saturating_sub(common);
    // More is that of another computer, or from before a restart.
    match apart.saturating_abs() > SAME_CLOCK {
        true => apart,
        false => 0,
    }
}
