//! Replaying: what each process is told.
//!
//! The time of a replay's virtual clock is the stamp of the event that is next: who has an event with a stamp sleeps until then, and the clock moves
//! when nobody can run, that is when all that came before has happened.

use super::error::{Divergence, RecordError};
use super::event::{Event as Noted, Kind};
use super::recorder::RecordReport;
use super::recording::Recording;
use luna_platform::clock::{Instant, VirtualClock};
use luna_platform::current;
use luna_platform::tape::{About, Event, Tape, Turn, What};
use luna_platform::timer_queue::Sleep;
use std::cell::{Cell, RefCell};
use std::collections::{BTreeMap, HashMap, VecDeque};
use std::pin::Pin;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::task::{Context, Poll};

/// After all stamps: who has not ended by then waits for something that was not recorded.
const END: u64 = 1 << 61;
/// How often a process is polled without an event, when one of its strands is past what was recorded: the others may have some left.
const MOST_IDLE_POLLS: u32 = 1000;
/// After all stamps, and before the end: what was under way when its process was cut.
const LATE: u64 = 1 << 60;

type Queues = BTreeMap<u32, VecDeque<Noted>>;
/// A process: its parent's number or 0, its name, and which it is of these.
type Key = (u32, String, u32);

/// What replays a system.
pub(crate) struct Replayer {
    system: String,
    parameters: Vec<(String, String)>,
    is_whole: bool,
    /// The number from 1 of each process, and its events.
    processes: Mutex<HashMap<Key, (u32, Queues)>>,
    /// How many processes of each name there were, by who spawned them.
    names: Mutex<HashMap<(u32, String), u32>>,
    first: Mutex<Option<RecordError>>,
    differs: AtomicBool,
    /// All that was recorded has happened: what is left is dropped, and what comes of that was not recorded.
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
            names: Mutex::default(),
            first: Mutex::default(),
            differs: AtomicBool::new(false),
            is_over: AtomicBool::new(false),
            replayed: AtomicU64::new(0),
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
        let strands = queues.into_iter();
        let strands = strands.map(|(path, events)| (path, Strand::new(events)));
        Track {
            replayer: self.clone(),
            name: name.to_owned(),
            number,
            strands: RefCell::new(strands.collect()),
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
                lost: 0,
                outside: 0,
                bytes: 0,
            }),
        }
    }
}

fn lock<T>(mutex: &Mutex<T>) -> std::sync::MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// When what bears this stamp happens.
fn at(stamp: u64) -> Instant {
    VirtualClock::ORIGIN + std::time::Duration::from_nanos(stamp.min(END) * 2)
}

/// When what bears this stamp happens if it does not wait: its partner, which may, is there by then.
fn after(stamp: u64) -> Instant {
    at(stamp) + std::time::Duration::from_nanos(1)
}

/// What replays one process.
pub(crate) struct Track {
    replayer: Arc<Replayer>,
    name: String,
    /// In the recording, from 1.
    number: u32,
    strands: RefCell<HashMap<u32, Strand>>,
    end: RefCell<Pin<Box<Sleep>>>,
    begun: Cell<bool>,
    outputs: Cell<u64>,
    /// The recording says nothing more of it.
    past_end: Cell<bool>,
    /// It returned in the recording. Else what a strand does after its last event was not recorded any more.
    returns: bool,
    /// A strand has done something at once after that: it cannot be made to wait for that.
    has_overrun: Cell<bool>,
    /// How often it was polled since the last event or operation.
    idle_polls: Cell<u32>,
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum Stage {
    Idle,
    Entering,
    Running(Turn),
}

/// A strand of a process.
struct Strand {
    events: VecDeque<Noted>,
    operations: u64,
    stage: Stage,
    /// The present operation does not wait, and has taken its event.
    is_call: bool,
    /// What it sleeps in.
    sleep: Option<Pin<Box<Sleep>>>,
}

impl Strand {
    fn new(events: VecDeque<Noted>) -> Self {
        Self {
            events,
            operations: 0,
            stage: Stage::Idle,
            is_call: false,
            sleep: None,
        }
    }

    /// Sleeps until all before this instant has happened.
    fn wait_for(&mut self, until: Instant, cx: &mut Context<'_>) -> Poll<()> {
        if self
            .sleep
            .as_ref()
            .is_none_or(|sleep| sleep.deadline() != until)
        {
            self.sleep = Some(Box::pin(Sleep::until(until)));
        }
        let Some(sleep) = &mut self.sleep else {
            return Poll::Ready(());
        };
        let polled = sleep.as_mut().poll(cx);
        if polled.is_ready() {
            self.sleep = None;
        }
        polled
    }

    /// Sleeps until the calls can happen that follow the present operation and take something.
    fn wait_for_calls(&mut self, cx: &mut Context<'_>) -> Poll<()> {
        let mut stamp = 0;
        for (event, number) in self.events.iter().zip(self.operations + 1..) {
            if event.operation != number || !event.is_call {
                break;
            }
            if let Kind::Outcome { stamp: taken, .. } = event.kind
                && taken != 0
            {
                // Of several in a row the last: nobody else runs between them here, so what they take has to be there before the first.
                stamp = taken;
            }
        }
        match stamp {
            0 => Poll::Ready(()),
            stamp => self.wait_for(after(stamp), cx),
        }
    }
}

impl Track {
    /// Whether the body is not to be polled any more: it has come further than the recording, or the replay has come to a difference, and it would only go on.
    pub(crate) fn rests(&self) -> bool {
        let is_at_cut = |strand: &Strand| {
            let next = strand.events.front();
            next.is_some_and(|event| {
                matches!(event.kind, Kind::Cut(_)) && event.operation <= strand.operations
            })
        };
        if self.has_overrun.get() || self.strands.borrow().get(&0).is_some_and(is_at_cut) {
            let polls = self.idle_polls.get() + 1;
            self.idle_polls.set(polls);
            if polls > MOST_IDLE_POLLS {
                self.past_end.set(true);
            }
        }
        self.past_end.get() || self.replayer.differs()
    }

    /// Whether the body may be polled for the first time.
    pub(crate) fn begins(&self, cx: &mut Context<'_>) -> bool {
        if !self.begun.get() {
            let mut strands = self.strands.borrow_mut();
            let polled = strands
                .get_mut(&0)
                .map_or(Poll::Ready(()), |strand| strand.wait_for_calls(cx));
            self.begun.set(polled.is_ready());
        }
        self.begun.get()
    }

    /// Whether nothing more comes, so that the body, which is at rest, is to be dropped.
    pub(crate) fn is_over(&self, cx: &mut Context<'_>) -> bool {
        let is_over = self.end.borrow_mut().as_mut().poll(cx).is_ready();
        if is_over {
            self.replayer.is_over.store(true, Ordering::Relaxed);
            self.check_rest();
        }
        is_over
    }

    /// The process has returned.
    pub(crate) fn end(&self) {
        if self.is_off() {
            return;
        }
        let mut strands = self.strands.borrow_mut();
        let strand = strands
            .entry(0)
            .or_insert_with(|| Strand::new(VecDeque::new()));
        let next = strand.events.front();
        if next
            .is_some_and(|event| event.kind == Kind::Ended && event.operation == strand.operations)
        {
            strand.events.pop_front();
            self.replayer.replayed.fetch_add(1, Ordering::Relaxed);
            drop(strands);
            return self.check_rest();
        }
        let operation = strand.operations;
        let expected = next.map(told);
        drop(strands);
        match expected {
            Some(expected) => self.differ(operation, None, expected, "the process returns".into()),
            None => self.beyond(operation, "the process returns"),
        }
    }

    /// All that was recorded has to have come again.
    fn check_rest(&self) {
        if self.replayer.differs() || !self.replayer.is_whole || self.past_end.get() {
            return;
        }
        let strands = self.strands.borrow();
        for strand in strands.values() {
            let next = strand.events.front();
            if let Some(event) = next.filter(|event| !matches!(event.kind, Kind::Cut(_))) {
                let (expected, operation) = (told(event), event.operation);
                return self.differ(operation, None, expected, "nothing".into());
            }
        }
    }

    fn differ(&self, operation: u64, output: Option<u64>, expected: String, found: String) {
        self.replayer
            .note(RecordError::Diverged(Box::new(Divergence {
                event: self.replayer.replayed.load(Ordering::Relaxed),
                process: self.name.clone(),
                operation,
                output,
                expected,
                found,
            })));
    }

    /// Something is done of which the recording says nothing more.
    fn beyond(&self, operation: u64, found: &str) {
        if self.replayer.is_whole {
            self.differ(operation, None, "nothing more".into(), found.into());
        }
        self.past_end.set(true);
    }

    fn is_off(&self) -> bool {
        self.past_end.get()
            || self.replayer.differs()
            || self.replayer.is_over.load(Ordering::Relaxed)
    }

    fn with_strand<R>(&self, f: impl FnOnce(&mut Strand) -> R) -> R {
        let mut strands = self.strands.borrow_mut();
        let strand = strands
            .entry(current::branch_path())
            .or_insert_with(|| Strand::new(VecDeque::new()));
        f(strand)
    }

    /// Takes the strand's next event, if it is of the present operation and a call as it is.
    fn take_event(&self, is_call: bool) -> Option<Noted> {
        self.with_strand(|strand| {
            let operation = strand.operations;
            strand.events.pop_front_if(|event| {
                let is_same = event.operation == operation && event.is_call == is_call;
                is_same && !matches!(event.kind, Kind::Cut(_))
            })
        })
        .inspect(|_| {
            self.idle_polls.set(0);
            self.replayer.replayed.fetch_add(1, Ordering::Relaxed);
        })
    }

    fn entering(
        &self,
        strand: &mut Strand,
        cx: &mut Context<'_>,
    ) -> Poll<Result<Turn, &'static str>> {
        let operation = strand.operations;
        let Some(event) = strand.events.front() else {
            return match current::branch_path() {
                0 => Poll::Ready(Err("it goes on")),
                // A branch that has no events, or none any more, foresees all, as its process goes on to its end.
                _ if self.returns => Poll::Ready(Ok(Turn::Look)),
                // How far it had come was not recorded.
                _ => Poll::Pending,
            };
        };
        if event.operation < operation {
            return match event.kind {
                Kind::Cut(_) => Poll::Pending,
                Kind::Ended => Poll::Ready(Err("it goes on")),
                _ => Poll::Ready(Err("another operation")),
            };
        }
        if event.operation > operation {
            return Poll::Ready(Ok(Turn::Look));
        }
        let is_cut = matches!(event.kind, Kind::Cut(_));
        if event.is_call && !is_cut {
            return Poll::Ready(Err("an operation that may wait"));
        }
        match event.kind {
            Kind::Outcome {
                what,
                number,
                stamp,
            } => {
                let polled = match what {
                    What::Done | What::Chosen if stamp != 0 => strand.wait_for(at(stamp), cx),
                    What::Failed | What::TimedOut => strand.wait_for_calls_after_this(cx),
                    _ => Poll::Ready(()),
                };
                polled.map(|()| {
                    Ok(Turn::Given(Event {
                        what,
                        number,
                        stamp,
                    }))
                })
            }
            Kind::Bytes { .. } => Poll::Ready(Ok(Turn::Look)),
            // It is the last one.
            Kind::Ended => Poll::Ready(Ok(Turn::Look)),
            // A partner may have had it all the same: so it is offered, when all else has happened.
            Kind::Cut(true) => strand.wait_for(at(LATE), cx).map(|()| Ok(Turn::Look)),
            Kind::Cut(false) => Poll::Ready(Ok(Turn::Look)),
        }
    }
}

/// An event in words.
fn told(event: &Noted) -> String {
    let call = if event.is_call { " at once" } else { "" };
    match &event.kind {
        Kind::Outcome { what, number, .. } => match what {
            What::Done => format!("a success{call}"),
            What::Failed => format!("a failure{call} ({number})"),
            What::TimedOut => "a timeout".to_owned(),
            What::Chosen => format!("guard {number}"),
            What::Time => "a look at the clock".to_owned(),
        },
        Kind::Bytes { about, bytes, .. } => match about {
            About::Input => "an input".to_owned(),
            About::Output => format!("the output {bytes:?}"),
            About::Cycle => "a cycle of a loop".to_owned(),
            About::Read => "bytes from outside".to_owned(),
        },
        Kind::Ended => "that the process returns".to_owned(),
        Kind::Cut(_) => "that the process is ended".to_owned(),
    }
}

impl Tape for Track {
    fn enter(&self, cx: &mut Context<'_>) -> Poll<Turn> {
        if self.is_off() {
            return Poll::Pending;
        }
        let entered = self.with_strand(|strand| {
            match strand.stage {
                Stage::Running(turn) => return Poll::Ready(Ok(turn)),
                Stage::Entering => {}
                Stage::Idle => {
                    strand.operations += 1;
                    strand.is_call = false;
                    strand.stage = Stage::Entering;
                }
            }
            let entered = self.entering(strand, cx);
            if let Poll::Ready(Ok(turn)) = entered {
                strand.stage = Stage::Running(turn);
            }
            entered.map_err(|found| (strand.operations, strand.events.front().map(told), found))
        });
        match entered {
            Poll::Pending => Poll::Pending,
            Poll::Ready(Ok(turn)) => Poll::Ready(turn),
            Poll::Ready(Err((operation, expected, found))) => {
                match expected {
                    Some(expected) => self.differ(operation, None, expected, found.into()),
                    None => self.beyond(operation, found),
                }
                Poll::Pending
            }
        }
    }

    fn call(&self, _: bool) -> Turn {
        if self.is_off() {
            return Turn::Look;
        }
        self.with_strand(|strand| {
            strand.operations += 1;
            strand.is_call = true;
            strand.stage = Stage::Running(Turn::Look);
        });
        let turn = match self.take_event(true) {
            Some(Noted {
                kind:
                    Kind::Outcome {
                        what,
                        number,
                        stamp,
                    },
                ..
            }) => Turn::Given(Event {
                what,
                number,
                stamp,
            }),
            Some(event) => {
                let operation = event.operation;
                self.differ(operation, None, told(&event), "an operation at once".into());
                Turn::Look
            }
            None => {
                self.nothing_for(None, "an operation at once");
                Turn::Look
            }
        };
        self.with_strand(|strand| strand.stage = Stage::Running(turn));
        turn
    }

    fn is_replay(&self) -> bool {
        true
    }

    fn leave(&self, event: Event) {
        if self.is_off() {
            return;
        }
        let stage = self.with_strand(|strand| std::mem::replace(&mut strand.stage, Stage::Idle));
        let Stage::Running(turn) = stage else { return };
        self.idle_polls.set(0);
        let operation = self.with_strand(|strand| strand.operations);
        match turn {
            Turn::Given(given) => {
                if !self.with_strand(|strand| strand.is_call) {
                    self.take_event(false);
                }
                let is_same = given.what == event.what
                    && (given.number == event.number || given.what == What::Time);
                if !is_same {
                    let words = |event: Event| {
                        told(&Noted {
                            path: 0,
                            operation,
                            is_call: false,
                            kind: Kind::Outcome {
                                what: event.what,
                                number: event.number,
                                stamp: event.stamp,
                            },
                        })
                    };
                    self.differ(operation, None, words(given), words(event));
                }
            }
            _ if event.what == What::Done => {}
            _ => self.differ(
                operation,
                None,
                "a success".into(),
                "another outcome".into(),
            ),
        }
    }

    fn abandon(&self) {
        self.with_strand(|strand| strand.stage = Stage::Idle);
    }

    fn hold(&self, cx: &mut Context<'_>) -> Poll<()> {
        if self.is_off() {
            return Poll::Pending;
        }
        self.with_strand(
            |strand| match strand.events.front().map(|event| &event.kind) {
                // What came after it was not recorded any more.
                Some(Kind::Cut(_))
                    if strand.events[0].operation == strand.operations
                        && !strand.events[0].is_call =>
                {
                    Poll::Pending
                }
                _ => strand.wait_for_calls(cx),
            },
        )
    }

    fn choice(&self) -> Option<u32> {
        self.with_strand(|strand| match strand.stage {
            Stage::Running(Turn::Given(Event {
                what: What::Chosen,
                number,
                ..
            })) => u32::try_from(number).ok(),
            _ => None,
        })
    }

    fn stamp(&self, _: bool) -> u64 {
        self.with_strand(|strand| match strand.stage {
            Stage::Running(Turn::Given(event)) => event.stamp,
            _ => 0,
        })
    }

    fn own_stamp(&self) -> u64 {
        0
    }

    fn put(&self, about: About, name: u32, bytes: &[u8]) {
        if self.is_off() {
            return;
        }
        self.with_strand(|strand| strand.operations += 1);
        let output = self.outputs.get() + 1;
        self.outputs.set(output);
        match self.take_event(true) {
            Some(Noted {
                kind:
                    Kind::Bytes {
                        about: of,
                        name: named,
                        bytes: recorded,
                    },
                ..
            }) if of == about && named == name && recorded == bytes => {}
            Some(event) => {
                let found = format!("the output {bytes:?}");
                self.differ(event.operation, Some(output), told(&event), found);
            }
            None => self.nothing_for(Some(output), "an output"),
        }
    }

    fn get(&self, about: About, name: u32, into: &mut [u8]) -> Option<usize> {
        if self.is_off() {
            return None;
        }
        let is_call = matches!(about, About::Input | About::Output);
        self.with_strand(|strand| match is_call {
            true => strand.operations += 1,
            false => strand.stage = Stage::Idle,
        });
        let what = match about {
            About::Cycle => "a cycle of a loop",
            About::Read => "bytes from outside",
            _ => "an input",
        };
        match self.take_event(is_call) {
            Some(Noted {
                kind:
                    Kind::Bytes {
                        about: of,
                        name: named,
                        bytes,
                    },
                ..
            }) if of == about && named == name && bytes.len() <= into.len() => {
                into[..bytes.len()].copy_from_slice(&bytes);
                Some(bytes.len())
            }
            Some(event) => {
                self.differ(
                    event.operation,
                    None,
                    told(&event),
                    format!("other than {what}"),
                );
                None
            }
            None => {
                self.nothing_for(None, what);
                None
            }
        }
    }

    fn strand(&self) -> u32 {
        1
    }

    fn process(&self) -> u32 {
        self.number
    }

    fn outside(&self, construct: &'static str) {
        if !self.is_off() {
            self.replayer.note(RecordError::Outside {
                process: self.name.clone(),
                construct: construct.to_owned(),
            });
        }
    }

    fn settle(&self, cx: &mut Context<'_>) -> Poll<()> {
        self.with_strand(|strand| match strand.stage {
            Stage::Running(Turn::Given(Event { stamp, .. })) if stamp != 0 => {
                strand.wait_for(after(stamp), cx)
            }
            _ => Poll::Ready(()),
        })
    }

    fn differs(&self, what: &'static str) {
        if !self.is_off() {
            let (operation, expected) = self.with_strand(|strand| {
                (
                    strand.operations,
                    match strand.stage {
                        Stage::Running(Turn::Given(_)) => "that it does",
                        _ => "something else",
                    },
                )
            });
            self.differ(operation, None, expected.into(), what.into());
        }
    }
}

impl Strand {
    /// As [`wait_for_calls`](Self::wait_for_calls), when the present operation's own event is the first.
    fn wait_for_calls_after_this(&mut self, cx: &mut Context<'_>) -> Poll<()> {
        let own = self.events.pop_front();
        let polled = self.wait_for_calls(cx);
        if let Some(own) = own {
            self.events.push_front(own);
        }
        polled
    }
}

impl Track {
    /// There is no event for what is done now.
    fn nothing_for(&self, output: Option<u64>, found: &str) {
        let (operation, expected, is_cut) = self.with_strand(|strand| {
            let next = strand.events.front();
            let is_cut = match next {
                Some(event) => {
                    matches!(event.kind, Kind::Cut(_)) && event.operation < strand.operations
                }
                None => current::branch_path() != 0 && !self.returns,
            };
            (strand.operations, next.map(told), is_cut)
        });
        if is_cut {
            return self.has_overrun.set(true);
        }
        match expected {
            Some(expected) => self.differ(operation, output, expected, found.into()),
            None => self.beyond(operation, found),
        }
    }
}
