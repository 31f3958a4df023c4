//! CSP events of systems, as their recordings have them.

mod losses;
mod waits;

use luna::log::{Logging, Sink};
use luna::prelude::*;
use luna_events::code;
use luna_logger::format::{Event, Reader, Record, Subject};
use std::collections::{BTreeMap, HashMap};
use std::io;
use std::sync::{Arc, Mutex};
use std::task::Poll;

/// A recording in memory.
#[derive(Default, Clone)]
struct Memory(Arc<Mutex<Vec<u8>>>);

impl Sink for Memory {
    fn begin(&mut self, head: &[u8]) -> io::Result<()> {
        self.block(head)
    }

    fn block(&mut self, block: &[u8]) -> io::Result<()> {
        self.0.lock().unwrap().extend_from_slice(block);
        Ok(())
    }
}

/// What a recording holds of events.
#[derive(Default)]
struct Decoded {
    events: Vec<Event>,
    names: HashMap<(Subject, u32), String>,
    parents: HashMap<(Subject, u32), u32>,
    executors: HashMap<u32, (u32, u8)>,
    threads: BTreeMap<u32, String>,
    lost: u64,
}

impl Decoded {
    fn read(recording: &Memory) -> Decoded {
        let bytes = recording.0.lock().unwrap();
        let mut reader = Reader::new(&bytes[..]).unwrap();
        let mut decoded = Decoded::default();
        let mut lost = HashMap::new();
        while let Some(record) = reader.next().unwrap() {
            match record {
                Record::Event(event) => decoded.events.push(event),
                Record::Name {
                    subject,
                    number,
                    parent,
                    name,
                    runs_on,
                } => {
                    decoded.names.insert((subject, number), name.to_owned());
                    decoded.parents.insert((subject, number), parent);
                    if let Some(runs_on) = runs_on {
                        decoded
                            .executors
                            .insert(number, (runs_on.executor, runs_on.level));
                    }
                }
                Record::Thread { number, name } => {
                    decoded.threads.insert(number, name.to_owned());
                }
                Record::Losses {
                    of: luna_logger::format::Losing::Events(thread),
                    lost: number,
                } => {
                    lost.insert(thread, number);
                }
                _ => {}
            }
        }
        decoded.lost = lost.values().sum();
        decoded
    }

    fn name(&self, subject: Subject, number: u64) -> &str {
        let name = self.names.get(&(subject, number as u32));
        name.map_or("", String::as_str)
    }

    fn process(&self, number: u64) -> &str {
        self.name(Subject::Process, number)
    }

    fn of(&self, code: u16) -> impl Iterator<Item = &Event> {
        self.events.iter().filter(move |event| event.code == code)
    }

    /// Each communication: the channel, the sender, the receiver.
    fn communications(&self) -> Vec<(&str, &str, &str)> {
        self.of(code::COMMUNICATION)
            .map(|event| {
                (
                    self.name(Subject::Channel, event.subject.into()),
                    self.process(event.arguments[0]),
                    self.process(event.arguments[1]),
                )
            })
            .collect()
    }

    /// All of it in words, without the numbers that differ from run to run of one program.
    fn lines(&self) -> Vec<String> {
        let line = |event: &Event| {
            let [a, b] = event.arguments;
            let what = self.name(Subject::Code, event.code.into());
            let time = event.time;
            let of = |number: u64| self.process(number);
            match event.code {
                code::COMMUNICATION => {
                    let channel = self.name(Subject::Channel, event.subject.into());
                    format!("{time} {what} {channel}: {} {}", of(a), of(b))
                }
                code::ASLEEP | code::AWAKE => {
                    let executor = self.name(Subject::Executor, event.subject.into());
                    format!("{time} {what} {executor}")
                }
                code::SLOT | code::LATE => {
                    let one = self.name(Subject::Loop, event.subject.into());
                    format!("{time} {what} {one}: {a} {b}")
                }
                code::READY | code::SPAWNED => {
                    format!("{time} {what} {}: {}", of(event.subject.into()), of(a))
                }
                code::WAITING => {
                    let on = self.name(Subject::Channel, b);
                    format!("{time} {what} {}: {a} {on}", of(event.subject.into()))
                }
                _ => format!("{time} {what} {}: {a} {b}", of(event.subject.into())),
            }
        };
        self.events.iter().map(line).collect()
    }
}

fn recorded(system: &mut System) -> Memory {
    let memory = Memory::default();
    system.log(Logging::to_sink(memory.clone()).events());
    memory
}

/// The network of the bench, so many rounds of it, on one executor.
fn commstime(system: &mut System, rounds: u64) -> luna::Result<()> {
    let (a, from_prefix) = luna::channel::<u64>();
    let (b, to_successor) = luna::channel::<u64>();
    let (c, from_successor) = luna::channel::<u64>();
    let (d, to_consumer) = luna::channel::<u64>();
    let (a, b, c, d) = (a.named("a"), b.named("b"), c.named("c"), d.named("d"));
    let main = system.executor("main").build()?;
    main.process("prefix").spawn(async move {
        a.send(0).await?;
        while let Ok(number) = from_successor.recv().await {
            if a.send(number).await.is_err() {
                break;
            }
        }
        Ok(())
    })?;
    main.process("delta").spawn(async move {
        while let Ok(number) = from_prefix.recv().await {
            if d.send(number).await.is_err() || b.send(number).await.is_err() {
                break;
            }
        }
        Ok(())
    })?;
    main.process("successor").spawn(async move {
        while let Ok(number) = to_successor.recv().await {
            if c.send(number + 1).await.is_err() {
                break;
            }
        }
        Ok(())
    })?;
    main.process("consumer").spawn(async move {
        for round in 0..rounds {
            assert_eq!(to_consumer.recv().await?, round);
        }
        Ok(())
    })?;
    Ok(())
}

fn commstime_on_virtual_time(rounds: u64) -> luna::Result<(luna::Report, Decoded)> {
    let mut system = System::new("commstime");
    system.virtual_clock();
    let memory = recorded(&mut system);
    commstime(&mut system, rounds)?;
    let report = system.run()?;
    Ok((report, Decoded::read(&memory)))
}

#[test]
fn commstime_is_told_communication_by_communication() -> luna::Result<()> {
    let rounds = 5;
    let (report, decoded) = commstime_on_virtual_time(rounds)?;
    let round = [
        ("a", "prefix", "delta"),
        ("d", "delta", "consumer"),
        ("b", "delta", "successor"),
        ("c", "successor", "prefix"),
    ];
    let communications = decoded.communications();
    // The consumer leaves after the last round it counts. The others go on until they find its end
    // gone.
    let expected: Vec<_> = (0..rounds).flat_map(|_| round).collect();
    assert_eq!(communications[..expected.len()], expected);
    assert!(communications.len() <= expected.len() + 1);
    let counts = report.logging.unwrap().events;
    assert_eq!(
        (counts.recorded, counts.lost),
        (decoded.events.len() as u64, 0)
    );
    // Each turn begins and ends, one after the other, on the executor of its process.
    let mut turn = None;
    for event in &decoded.events {
        match event.code {
            code::RUNNING => assert_eq!(turn.replace(event.subject), None),
            code::WAITING => assert_eq!(turn.take(), Some(event.subject)),
            code::DONE => {
                assert_eq!(event.arguments[0], code::ended::OK);
                turn = None;
            }
            _ => {}
        }
        if matches!(event.code, code::RUNNING | code::WAITING | code::DONE) {
            let (executor, level) = decoded.executors[&event.subject];
            assert_eq!((executor, level), (event.thread, 16));
            assert_eq!(decoded.name(Subject::Executor, executor.into()), "main");
        }
    }
    assert_eq!(decoded.of(code::DONE).count(), 4);
    // It waits at the channel that it then communicates by.
    let first = decoded.of(code::WAITING).next().unwrap();
    assert_eq!(
        (
            decoded.process(first.subject.into()),
            decoded.name(Subject::Channel, first.arguments[1])
        ),
        ("prefix", "a")
    );
    Ok(())
}

#[test]
fn on_virtual_time_each_recording_is_the_same() -> luna::Result<()> {
    let (_, one) = commstime_on_virtual_time(20)?;
    let (_, other) = commstime_on_virtual_time(20)?;
    assert_eq!(one.lines(), other.lines());
    Ok(())
}

#[test]
fn alternatives_say_which_guard_they_took() -> luna::Result<()> {
    let mut system = System::new("choice");
    system.virtual_clock();
    let memory = recorded(&mut system);
    let (left, from_left) = luna::channel::<u8>();
    let (right, from_right) = luna::channel::<u8>();
    let (left, right) = (left.named("left"), right.named("right"));
    let main = system.executor("main").build()?;
    for (name, end) in [("of right", right), ("of left", left)] {
        main.process(name).spawn(async move {
            for number in 0..3 {
                end.send(number).await?;
                luna::after(std::time::Duration::from_millis(1)).await;
            }
            Ok(())
        })?;
    }
    main.process("chooser").spawn(async move {
        for _ in 0..2 {
            luna::pri_alt! {
                _ = from_left.recv() => (),
                _ = from_right.recv() => (),
            }
        }
        let both = [from_left, from_right];
        let mut inputs = luna::Alternative::fair(&both);
        for _ in 0..4 {
            inputs.recv().await.1?;
        }
        Ok(())
    })?;
    system.run()?;
    let decoded = Decoded::read(&memory);
    let choices: Vec<_> = decoded
        .of(code::ALTERNATIVE)
        .map(|event| {
            let channel = decoded.name(Subject::Channel, event.arguments[1]);
            assert_eq!(decoded.process(event.subject.into()), "chooser");
            (event.arguments[0], channel)
        })
        .collect();
    assert_eq!(choices.len(), 6);
    assert_eq!(choices[..2], [(0, "left"), (1, "right")]);
    let names = ["left", "right"];
    assert!(
        choices
            .iter()
            .all(|(index, name)| names[*index as usize] == *name)
    );
    // Each of them is a communication of the same channel by the same process.
    let received = decoded.communications();
    let channels: Vec<&str> = received.iter().map(|one| one.0).collect();
    assert_eq!(
        channels,
        choices.iter().map(|one| one.1).collect::<Vec<_>>()
    );
    assert!(received.iter().all(|(channel, sender, receiver)| {
        sender.ends_with(channel) && *receiver == "chooser"
    }));
    Ok(())
}

#[test]
fn loops_locks_priorities_and_emergencies_are_told() -> luna::Result<()> {
    let mut system = System::new("machine");
    system.virtual_clock();
    let memory = recorded(&mut system);
    let mutex = Arc::new(luna::sync::Mutex::new(0).named("table"));
    let main = system.executor("main").build()?;
    let second = system.executor("second").build()?;
    let period = std::time::Duration::from_millis(10);
    main.process("servo").priority(20).spawn(async move {
        let mut tick = luna::periodic("control loop of the arm", period)?;
        for _ in 0..3 {
            tick.next().await;
        }
        Err(luna::emergency(luna::Error::other("no index pulse")))
    })?;
    let held = mutex.clone();
    main.process("holder").priority(5).spawn(async move {
        let _guard = held.lock().await.unwrap();
        luna::after(period / 4).await;
        Ok(())
    })?;
    main.process("urgent").priority(25).spawn(async move {
        luna::after(period / 8).await;
        let _guard = mutex.lock().await.unwrap();
        Ok(())
    })?;
    let (output, input) = luna::channel::<u32>();
    let output = output.named("between");
    second
        .process("sender")
        .spawn(async move { Ok(output.send(1).await?) })?;
    main.process("receiver").spawn(async move {
        input.recv().await?;
        Ok(())
    })?;
    let outcome = system.run();
    assert!(outcome.is_err());
    let decoded = Decoded::read(&memory);

    let slots: Vec<_> = decoded
        .of(code::SLOT)
        .map(|event| {
            let name = decoded.name(Subject::Loop, event.subject.into());
            (name, event.arguments)
        })
        .collect();
    let name = "control loop of the arm";
    assert_eq!(slots, [1, 2, 3].map(|number| (name, [number, 0])));
    let parent = decoded.parents[&(Subject::Loop, 1)];
    assert_eq!(decoded.process(parent.into()), "servo");
    // On virtual time they are exactly a period apart.
    let times: Vec<u64> = decoded.of(code::SLOT).map(|event| event.time).collect();
    assert!(
        times
            .windows(2)
            .all(|two| two[1] - two[0] == period.as_nanos() as u64)
    );

    let on_lock: Vec<_> = decoded
        .of(code::WAITING)
        .filter(|event| event.arguments[0] == Subject::Lock as u64)
        .map(|event| {
            let lock = decoded.name(Subject::Lock, event.arguments[1]);
            (decoded.process(event.subject.into()), lock)
        })
        .collect();
    assert_eq!(on_lock, [("urgent", "table")]);
    let levels: Vec<_> = decoded
        .of(code::PRIORITY)
        .map(|event| (decoded.process(event.subject.into()), event.arguments))
        .collect();
    assert_eq!(levels, [("holder", [5, 25]), ("holder", [25, 5])]);

    let emergencies: Vec<_> = decoded
        .of(code::EMERGENCY)
        .map(|event| (decoded.process(event.subject.into()), event.arguments[0]))
        .collect();
    assert_eq!(emergencies, [("servo", 3)]);
    let ended: BTreeMap<_, _> = decoded
        .of(code::DONE)
        .map(|event| (decoded.process(event.subject.into()), event.arguments[0]))
        .collect();
    assert_eq!(ended["servo"], code::ended::ERROR);
    assert_eq!(ended["holder"], code::ended::OK);

    assert_eq!(
        decoded.communications(),
        [("between", "sender", "receiver")]
    );
    // Both executors share a thread, and the recording distinguishes them.
    let mut executors: Vec<_> = decoded
        .names
        .iter()
        .filter(|((subject, _), _)| *subject == Subject::Executor)
        .map(|(_, name)| name.as_str())
        .collect();
    executors.sort_unstable();
    assert_eq!(executors, ["main", "second"]);
    Ok(())
}

#[test]
fn os_threads_and_processes_that_come_later_are_told() -> luna::Result<()> {
    let mut system = System::new("real");
    let memory = recorded(&mut system);
    let (output, input) = luna::channel::<u32>();
    let (output, input) = (output.named("numbers"), input);
    let main = system.executor("main").build()?;
    let own = main.clone();
    main.process("parent").spawn(async move {
        own.process("child").spawn(async move {
            for number in 0..100 {
                output.send(number).await?;
            }
            Ok(())
        })?;
        Ok(())
    })?;
    system
        .thread("console")
        .process("reader")
        .spawn(async move {
            let mut sum = 0;
            while let Ok(number) = input.recv().await {
                sum += number;
            }
            assert_eq!(sum, 4950);
            Ok(())
        })?;
    let report = system.run()?;
    let decoded = Decoded::read(&memory);
    let counts = report.logging.unwrap().events;
    assert_eq!(
        (counts.recorded, counts.lost),
        (decoded.events.len() as u64, 0)
    );
    assert_eq!(
        decoded.communications(),
        vec![("numbers", "child", "reader"); 100]
    );
    let spawned: Vec<_> = decoded
        .of(code::SPAWNED)
        .map(|event| {
            (
                decoded.process(event.subject.into()),
                decoded.process(event.arguments[0]),
            )
        })
        .collect();
    assert_eq!(spawned, [("child", "parent")]);
    let place = |name: &str| {
        let ((_, number), _) = decoded
            .names
            .iter()
            .find(|((subject, _), text)| *subject == Subject::Process && *text == name)
            .unwrap();
        decoded.threads[&decoded.executors[number].0].as_str()
    };
    assert_eq!(
        ["parent", "child", "reader"].map(place),
        ["main", "main", "console"]
    );
    // In each thread's order: a process that runs was ready, and one that is done says no more.
    for name in ["parent", "child", "reader"] {
        let of = decoded
            .events
            .iter()
            .filter(|event| decoded.process(event.subject.into()) == name)
            .filter(|event| matches!(event.code, code::RUNNING | code::WAITING | code::DONE));
        let codes: Vec<u16> = of.map(|event| event.code).collect();
        let (last, turns) = codes.split_last().unwrap();
        assert_eq!(*last, code::DONE);
        let (running, _) = turns.as_chunks::<2>();
        assert!(
            running
                .iter()
                .all(|two| *two == [code::RUNNING, code::WAITING])
        );
    }
    Ok(())
}

#[test]
fn a_slot_says_how_late_it_is_itself() -> luna::Result<()> {
    let mut system = System::new("late");
    system.virtual_clock();
    let memory = recorded(&mut system);
    let period = std::time::Duration::from_millis(10);
    let main = system.executor("main").build()?;
    main.process("servo").spawn(async move {
        let mut tick = luna::periodic("servo", period)?.overrun(luna::time::Overrun::SkipToGrid);
        let mut cycle = tick.next().await;
        // Into the slot behind the next.
        luna::after(5 * period / 2).await;
        let before = std::mem::replace(&mut cycle, tick.next().await);
        assert_eq!(cycle.number, before.number + 2);
        assert_eq!(cycle.lateness, period / 2);
        Ok(())
    })?;
    system.run()?;
    let decoded = Decoded::read(&memory);
    let slots: Vec<_> = decoded
        .of(code::SLOT)
        .map(|event| event.arguments)
        .collect();
    let late = (period / 2).as_nanos() as u64;
    assert_eq!(slots, [[1, 0], [3, late]]);
    // What it came after is the slot that it waited for.
    let lates: Vec<_> = decoded
        .of(code::LATE)
        .map(|event| event.arguments)
        .collect();
    let asked_for = late + period.as_nanos() as u64;
    // The core is not known where time is virtual.
    let itself = code::late::argument(code::late::LOOP_ITSELF, 100, None);
    assert_eq!(lates, [[asked_for, itself]]);
    Ok(())
}
