//! The programs, systems and channels of this computer, as data.

use glob::Pattern;
use luna::inspect::{AnnouncedSystem, ThreadKind, announced_systems};
use luna_ipc::any::{AnyType, AnyValue};
use luna_ipc::look::{self, Found, Kind};
use serde::Serialize;
use std::collections::{BTreeMap, BTreeSet};
use std::io;
use std::thread::sleep;
use std::time::{Duration, Instant};

/// All that was found: what `luna list --json` prints.
#[derive(Debug, Serialize)]
pub(super) struct Survey {
    pub(super) programs: Vec<Program>,
    pub(super) channels: Vec<Channel>,
    pub(super) blackboards: Vec<Board>,
    /// The time between the two looks that rates are made of; none if there was one look.
    pub(super) interval_s: Option<f64>,
    /// Names with files that killed programs have left.
    pub(super) left_behind: usize,
    /// Names and systems of other users, or of another version.
    pub(super) hidden: usize,
}

/// A program that has a side of something, or an announced system.
#[derive(Debug, Serialize)]
pub(super) struct Program {
    pub(super) pid: u32,
    pub(super) program: String,
    pub(super) systems: Vec<System>,
}

#[derive(Debug, Serialize)]
pub(super) struct System {
    pub(super) name: String,
    pub(super) threads: Vec<Thread>,
    pub(super) addresses: BTreeMap<String, String>,
}

#[derive(Debug, Serialize)]
pub(super) struct Thread {
    pub(super) name: String,
    /// `executor` or `os_thread`.
    pub(super) kind: &'static str,
    pub(super) policy: String,
    pub(super) core: Option<usize>,
    pub(super) processes: usize,
}

/// A side of a channel.
#[derive(Debug, Serialize)]
pub(super) struct Side {
    /// None if it has not said so, or is in another PID namespace.
    pub(super) pid: Option<u32>,
    pub(super) program: Option<String>,
    /// The announced systems of that program.
    pub(super) systems: Vec<String>,
    /// Its link sleeps until it is woken.
    pub(super) sleeps: bool,
}

/// The type of a value.
#[derive(Debug, Serialize)]
pub(super) struct Type {
    pub(super) name: String,
    pub(super) size: u64,
    pub(super) align: u64,
    pub(super) version: u32,
}

#[derive(Debug, Serialize)]
pub(super) struct Channel {
    pub(super) name: String,
    /// `channel`, `serde`, `loan` or `call`.
    pub(super) kind: &'static str,
    #[serde(rename = "type")]
    pub(super) value: Type,
    pub(super) sender: Option<Side>,
    pub(super) receiver: Option<Side>,
    pub(super) state: State,
    /// Openings of the sender's side and the receiver's: two of them name a session.
    pub(super) openings: [u64; 2],
    pub(super) sent: u64,
    pub(super) taken: u64,
    pub(super) per_second: Option<f64>,
}

/// How a channel is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub(super) enum State {
    /// It has no other side yet.
    NoSender,
    NoReceiver,
    /// Both are there, and their session is about to begin or to end.
    Joining,
    /// A value waits to be taken.
    UnderWay,
    /// The next value is to be sent.
    Joined,
}

impl State {
    pub(super) fn word(self) -> &'static str {
        match self {
            State::NoSender => "waits for a sender",
            State::NoReceiver => "waits for a receiver",
            State::Joining => "begins or ends",
            State::UnderWay => "a value waits to be taken",
            State::Joined => "waits for a value",
        }
    }
}

#[derive(Debug, Serialize)]
pub(super) struct Board {
    pub(super) name: String,
    pub(super) writer: Option<Side>,
    /// Those that show what they have open.
    pub(super) readers: Vec<Side>,
    pub(super) has_readers: bool,
    pub(super) keys: Vec<Key>,
}

#[derive(Debug, Serialize)]
pub(super) struct Key {
    pub(super) key: String,
    #[serde(rename = "type")]
    pub(super) value_type: Type,
    pub(super) number: u64,
    pub(super) per_second: Option<f64>,
    pub(super) age_s: f64,
    /// The newest value, if its type can be printed.
    pub(super) value: Option<serde_json::Value>,
    #[serde(skip)]
    pub(super) text: Option<String>,
}

impl From<&luna_ipc::TypeInfo> for Type {
    fn from(info: &luna_ipc::TypeInfo) -> Self {
        Self {
            name: info.name.clone(),
            size: info.size,
            align: info.align,
            version: info.version,
        }
    }
}

/// One look.
struct Look {
    all: look::All,
    at: Instant,
}

impl Look {
    fn now(names: &[Pattern]) -> io::Result<Self> {
        let mut all = look::all()?;
        let is_meant = |found: &Found| {
            names.is_empty() || names.iter().any(|pattern| pattern.matches(&found.name))
        };
        all.found.retain(is_meant);
        let at = Instant::now();
        Ok(Self { all, at })
    }

    fn found(&self, name: &str) -> Option<&Found> {
        self.all.found.iter().find(|found| found.name == name)
    }
}

impl Survey {
    /// Looks twice, so long apart, at what has these names; at all, if there are none.
    pub(super) fn of(names: &[Pattern], interval: Duration) -> io::Result<Self> {
        let first = match interval.is_zero() {
            true => None,
            false => Some(Look::now(names)?),
        };
        sleep(interval);
        let announced = announced_systems()?;
        let last = Look::now(names)?;
        let (alive, left): (Vec<&Found>, Vec<&Found>) =
            last.all.found.iter().partition(|found| found.is_alive());
        let seconds = first
            .as_ref()
            .map(|first| (last.at - first.at).as_secs_f64());
        let known = Known(&announced.systems);
        let before = |found: &Found| {
            let before = first.as_ref()?.found(&found.name)?;
            // Else it was opened anew by both sides, and its numbers began anew.
            let goes_on = before
                .openings
                .iter()
                .zip(found.openings)
                .all(|(a, b)| *a <= b);
            goes_on.then_some(before)
        };
        let (boards, channels): (Vec<&Found>, Vec<&Found>) = alive
            .into_iter()
            .partition(|found| found.kind == Kind::Blackboard);
        let channels: Vec<Channel> = channels
            .into_iter()
            .map(|found| {
                let counts = before(found).map(|before| (before.sent, found.sent));
                channel(found, per_second(counts, seconds), &known)
            })
            .collect();
        let blackboards: Vec<Board> = boards
            .into_iter()
            .map(|found| board(found, before(found), seconds, &known))
            .collect();
        let sides = channels
            .iter()
            .flat_map(|channel| channel.sender.iter().chain(&channel.receiver))
            .chain(
                blackboards
                    .iter()
                    .flat_map(|board| board.writer.iter().chain(&board.readers)),
            );
        let mut pids: BTreeSet<u32> = sides.filter_map(|side| side.pid).collect();
        if names.is_empty() {
            pids.extend(announced.systems.iter().map(|system| system.pid));
        }
        let programs = pids.into_iter().map(|pid| known.program(pid)).collect();
        Ok(Self {
            programs,
            channels,
            blackboards,
            interval_s: seconds,
            left_behind: left.len(),
            hidden: last.all.hidden + announced.hidden,
        })
    }
}

fn per_second(counts: Option<(u64, u64)>, seconds: Option<f64>) -> Option<f64> {
    let ((before, now), seconds) = (counts?, seconds?);
    let grown = now.checked_sub(before)?;
    (seconds > 0.0).then(|| grown as f64 / seconds)
}

fn channel(found: &Found, per_second: Option<f64>, known: &Known<'_>) -> Channel {
    let state = match (&found.sender, &found.receiver) {
        (None, _) => State::NoSender,
        (_, None) => State::NoReceiver,
        (Some(_), Some(_)) if !found.is_joined => State::Joining,
        (Some(one), Some(other)) if one.has_ended || other.has_ended => State::Joining,
        _ if found.is_under_way() => State::UnderWay,
        _ => State::Joined,
    };
    let side = |program: &look::Program| known.side(program.pid, program.sleeps);
    Channel {
        name: found.name.clone(),
        kind: found.kind.word(),
        value: (&found.value).into(),
        sender: found.sender.as_ref().map(side),
        receiver: found.receiver.as_ref().map(side),
        state,
        openings: found.openings,
        sent: found.sent,
        taken: found.taken,
        per_second,
    }
}

fn board(found: &Found, before: Option<&Found>, seconds: Option<f64>, known: &Known<'_>) -> Board {
    let keys = found.keys.iter().map(|key| {
        let before = before.and_then(|found| found.keys.iter().find(|one| one.key == key.key));
        let value = printed(key);
        Key {
            key: key.key.clone(),
            value_type: (&key.value).into(),
            number: key.number,
            per_second: per_second(before.map(|one| (one.number, key.number)), seconds),
            age_s: age(key.set).as_secs_f64(),
            text: value.as_ref().map(AnyValue::to_string),
            value: value.and_then(|value| serde_json::to_value(value).ok()),
        }
    });
    let readers = match found.receiver {
        Some(_) => look::readers(found).unwrap_or_default(),
        None => Vec::new(),
    };
    Board {
        name: found.name.clone(),
        writer: found
            .sender
            .as_ref()
            .map(|writer| known.side(writer.pid, false)),
        readers: readers
            .into_iter()
            .map(|pid| known.side(pid, false))
            .collect(),
        has_readers: found.receiver.is_some(),
        keys: keys.collect(),
    }
}

/// The value of a key, if its type can be printed and it was read whole.
fn printed(key: &look::Key) -> Option<AnyValue> {
    AnyType::of(&key.value).ok()?.read(&key.bytes).ok()
}

/// How long ago that was.
fn age(set: luna::Instant) -> Duration {
    Duration::from_nanos(luna::Instant::now().nanos_since(set))
}

/// What is known of programs.
struct Known<'a>(&'a [AnnouncedSystem]);

impl Known<'_> {
    fn systems(&self, pid: u32) -> impl Iterator<Item = &AnnouncedSystem> {
        self.0.iter().filter(move |system| system.pid == pid)
    }

    /// The name of a process' program: as it was announced, whole; else as the kernel has it.
    fn name(&self, pid: u32) -> Option<String> {
        let announced = self
            .systems(pid)
            .next()
            .map(|system| system.program.clone());
        announced.or_else(|| {
            let name = std::fs::read_to_string(format!("/proc/{pid}/comm")).ok()?;
            Some(name.trim_end().to_owned())
        })
    }

    fn side(&self, pid: u32, sleeps: bool) -> Side {
        let pid = Some(pid).filter(|pid| *pid != 0);
        Side {
            pid,
            program: pid.and_then(|pid| self.name(pid)),
            systems: pid.map_or_else(Vec::new, |pid| {
                self.systems(pid)
                    .map(|system| system.name.clone())
                    .collect()
            }),
            sleeps,
        }
    }

    fn program(&self, pid: u32) -> Program {
        let systems = self.systems(pid).map(|system| System {
            name: system.name.clone(),
            threads: system.threads.iter().map(thread).collect(),
            addresses: system.addresses.iter().cloned().collect(),
        });
        Program {
            pid,
            program: self.name(pid).unwrap_or_default(),
            systems: systems.collect(),
        }
    }
}

fn thread(thread: &luna::inspect::AnnouncedThread) -> Thread {
    Thread {
        name: thread.name.clone(),
        kind: match thread.kind {
            ThreadKind::Executor => "executor",
            _ => "os_thread",
        },
        policy: thread.policy.clone(),
        core: thread.core,
        processes: thread.processes,
    }
}
