//! Events of hubs: in blocks that a sink loses later, and of two hubs at a time.

use luna_events::{self as events, Kind, code};
use luna_logger::format::{Losing, Reader, Record, RunsOn, Subject, Tally};
use luna_logger::{Hub, Logging, Recorder, Sink};
use std::collections::BTreeMap;
use std::io;
use std::sync::{Arc, Condvar, Mutex, mpsc};

/// A sink that loses what it took, as one with a broken connection does, until it is switched to
/// keep it.
#[derive(Default, Clone)]
struct Flaky(Arc<(Mutex<State>, Condvar)>);

#[derive(Default)]
struct State {
    bytes: Vec<u8>,
    keeps: bool,
    /// How many events were in what it gave back.
    given_back: u64,
    tally: Tally,
    wants_declarations: bool,
}

impl Flaky {
    fn keeping() -> Self {
        let sink = Self::default();
        sink.keep();
        sink
    }

    fn keep(&self) {
        self.0.0.lock().unwrap().keeps = true;
    }

    /// Waits until this many events were lost.
    fn await_given_back(&self, events: u64) {
        let state = self.0.0.lock().unwrap();
        let is_missing = |state: &mut State| state.given_back < events;
        drop(self.0.1.wait_while(state, is_missing).unwrap());
    }

    fn read(&self) -> Contents {
        let mut contents = Contents::default();
        let bytes = self.0.0.lock().unwrap().bytes.clone();
        let mut reader = Reader::new(&bytes[..]).unwrap();
        loop {
            match reader.next() {
                Ok(Some(record)) => contents.learn(&record),
                Ok(None) => return contents,
                // Blocks are missing.
                Err(_) => drop(reader.resume().unwrap()),
            }
        }
    }
}

impl Sink for Flaky {
    fn begin(&mut self, head: &[u8]) -> io::Result<()> {
        self.0.0.lock().unwrap().bytes.extend(head);
        Ok(())
    }

    fn block(&mut self, block: &[u8]) -> io::Result<()> {
        let mut state = self.0.0.lock().unwrap();
        if state.keeps {
            state.bytes.extend(block);
        } else {
            let mut tally = Tally::default();
            tally.add(block);
            state.given_back += tally.events.values().sum::<u64>();
            state.tally.add(block);
            state.wants_declarations = true;
            self.0.1.notify_all();
        }
        Ok(())
    }

    fn wants_declarations(&mut self) -> bool {
        std::mem::take(&mut self.0.0.lock().unwrap().wants_declarations)
    }

    fn take_lost(&mut self) -> Tally {
        std::mem::take(&mut self.0.0.lock().unwrap().tally)
    }
}

#[derive(Debug, Default)]
struct Contents {
    /// Codes, subjects and first numbers.
    events: Vec<(u16, u32, u64)>,
    names: BTreeMap<(u8, u32), String>,
    runs_on: BTreeMap<u32, Option<RunsOn>>,
    lost: u64,
}

impl Contents {
    fn learn(&mut self, record: &Record<'_>) {
        match record {
            Record::Event(event) => {
                let Some(name) = self.name(Subject::Code, event.code.into()) else {
                    panic!("the code {} has no name", event.code);
                };
                assert!(!name.is_empty());
                self.events
                    .push((event.code, event.subject, event.arguments[0]));
            }
            Record::Name {
                subject,
                number,
                name,
                runs_on,
                ..
            } => {
                self.names
                    .insert((*subject as u8, *number), (*name).to_owned());
                if *subject == Subject::Process {
                    self.runs_on.insert(*number, *runs_on);
                }
            }
            Record::Losses {
                of: Losing::Events(_),
                lost,
            } => self.lost = *lost,
            _ => {}
        }
    }

    fn name(&self, subject: Subject, number: u32) -> Option<&str> {
        let name = self.names.get(&(subject as u8, number));
        name.map(String::as_str)
    }
}

fn start(hub: &Arc<Hub>, sink: &Flaky) -> Recorder {
    Recorder::start(hub, Logging::to_sink(sink.clone()).events()).unwrap()
}

// Each test has processes of its own: all hubs hear of their names.

#[test]
fn events_in_blocks_that_are_given_back_are_lost_and_names_come_again() {
    let sink = Flaky::default();
    let hub = Hub::new("pump", Default::default());
    let recorder = start(&hub, &sink);
    hub.enter_thread();
    hub.enter_executor();
    events::name_process(7, 16, || "pump".to_owned());
    for _ in 0..3 {
        events::begin_turn(7);
    }
    sink.await_given_back(3);
    sink.keep();
    for _ in 0..2 {
        events::begin_turn(7);
    }
    let report = recorder.finish();
    assert_eq!((report.events.recorded, report.events.lost), (2, 3));
    let contents = sink.read();
    // Each with the name of its code, which `learn` looks for.
    assert_eq!(contents.events, [(code::RUNNING, 7, 0); 2]);
    assert_eq!(contents.lost, 3);
    assert_eq!(contents.name(Subject::Process, 7), Some("pump"));
    let executor = contents.runs_on[&7].unwrap().executor;
    assert!(contents.name(Subject::Executor, executor).is_some());
    events::detach();
}

#[test]
fn of_two_hubs_each_has_its_own_events_and_executors() {
    let sinks = [Flaky::keeping(), Flaky::keeping()];
    let hubs = ["one", "other"].map(|name| Hub::new(name, Default::default()));
    let [one, other] = [0, 1].map(|index| start(&hubs[index], &sinks[index]));
    std::thread::scope(|scope| {
        let (has_entered, enters) = mpsc::channel();
        let (goes_on, waits) = mpsc::channel();
        let second = hubs[1].clone();
        scope.spawn(move || {
            second.enter_thread();
            second.enter_executor();
            events::name_executor(|| "of the other".to_owned());
            has_entered.send(()).unwrap();
            waits.recv().unwrap();
            events::report_executor(code::ASLEEP);
        });
        enters.recv().unwrap();
        // On this thread, which is the first's, with the same number there.
        hubs[0].enter_thread();
        hubs[0].enter_executor();
        events::name_executor(|| "of the one".to_owned());
        events::name_process(8, 16, || "pump".to_owned());
        events::report_executor(code::ASLEEP);
        hubs[0].report(code::EMERGENCY, 8, [1, 0]);
        hubs[1].report(code::EMERGENCY, 8, [2, 0]);
        goes_on.send(()).unwrap();
    });
    events::detach();
    let reports = [one, other].map(Recorder::finish);
    for report in reports {
        assert_eq!((report.events.recorded, report.events.lost), (2, 0));
    }
    let contents = sinks.map(|sink| sink.read());
    let number = |contents: &Contents| {
        let asleep = contents.events.iter().find(|event| event.0 == code::ASLEEP);
        asleep.unwrap().1
    };
    assert_eq!(number(&contents[0]), number(&contents[1]));
    let executors = contents
        .each_ref()
        .map(|contents| contents.name(Subject::Executor, number(contents)).unwrap());
    assert_eq!(executors, ["of the one", "of the other"]);
    let degrees = contents.each_ref().map(|contents| {
        let mut emergencies = contents
            .events
            .iter()
            .filter(|event| event.0 == code::EMERGENCY);
        let degree = emergencies.next().unwrap().2;
        assert!(emergencies.next().is_none());
        degree
    });
    assert_eq!(degrees, [1, 2]);
    // Both know the process, and one where it runs.
    let names = contents
        .each_ref()
        .map(|contents| contents.name(Subject::Process, 8).unwrap());
    assert_eq!(names, ["pump"; 2]);
    assert_eq!(
        contents[0].runs_on[&8].unwrap().executor,
        number(&contents[0])
    );
    assert_eq!(contents[1].runs_on[&8], None);
}

#[test]
fn names_come_in_order_and_only_during_a_recording() {
    let names = events::listen();
    // Numbers that have no name.
    let first = 4_000_000_000;
    for number in first..first + 3 {
        events::name(Kind::Barrier, number, 0, || format!("barrier {number}"));
    }
    let own: Vec<u32> = names
        .take()
        .iter()
        .filter(|name| name.kind == Kind::Barrier)
        .map(|name| name.number)
        .collect();
    assert_eq!(own, [first, first + 1, first + 2]);
    events::name(Kind::Lock, first, 0, String::new);
    drop(names);
    let anew = events::listen();
    assert!(anew.take().iter().all(|name| name.kind != Kind::Lock));
}
