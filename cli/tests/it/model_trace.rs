//! `luna model trace`, on recordings of systems that ran.

use crate::run::{example, file, luna_model, path, text};
use luna::log::Logging;
use luna::prelude::*;
use luna_events::code;
use luna_logger::format::{Event, Losing, Record, Subject, Writer};
use std::fs;
use std::path::Path;

/// What a run of commstime differs in.
#[derive(Clone, Copy, Default)]
pub(crate) struct Run {
    /// All on one virtual clock.
    pub(crate) is_virtual: bool,
    /// Each process is on a thread of its own.
    pub(crate) on_threads: bool,
    /// After so many numbers, delta passes one on twice.
    pub(crate) stutters_after: Option<u64>,
}

/// Runs the system of `examples/models/commstime.toml` for so many rounds, and records it.
pub(crate) fn commstime(file: &Path, rounds: u64, run: Run) -> luna::Result<()> {
    let channel = |name: &str| {
        let (sender, receiver) = luna::channel::<u64>();
        (sender.named(name), receiver)
    };
    let (to_delta, from_prefix) = channel("to_delta");
    let (to_successor, from_delta) = channel("to_successor");
    let (to_prefix, from_successor) = channel("to_prefix");
    let (out, to_consumer) = channel("out");
    let mut system = System::new("commstime");
    if run.is_virtual {
        system.virtual_clock();
    }
    system.log(Logging::to_file(file).replacing().room_for_events(1 << 18));
    let executors = match run.on_threads {
        true => ["one", "two", "three", "four"],
        false => ["main"; 4],
    };
    let mut built = Vec::new();
    for name in executors {
        if built.last().is_none_or(|(last, _)| *last != name) {
            built.push((name, system.executor(name).build()?));
        }
    }
    let on = |at: usize| &built[at.min(built.len() - 1)].1;
    on(0).process("prefix").spawn(async move {
        to_delta.send(0).await?;
        loop {
            to_delta.send(from_successor.recv().await?).await?;
        }
    })?;
    on(1).process("delta").spawn(async move {
        for number in 0.. {
            let value = from_prefix.recv().await?;
            luna::par!(to_successor.send(value), out.send(value)).await?;
            if Some(number) == run.stutters_after {
                out.send(value).await?;
            }
        }
        Ok(())
    })?;
    on(2).process("successor").spawn(async move {
        loop {
            to_prefix.send(from_delta.recv().await? + 1).await?;
        }
    })?;
    on(3).process("consumer").spawn(async move {
        for _ in 0..rounds {
            to_consumer.recv().await?;
        }
        to_consumer.poison();
        Ok(())
    })?;
    // It ends by the poison.
    let _ = system.run();
    Ok(())
}

pub(crate) fn traced(model: &str, recording: &Path, more: &[&str]) -> (Option<i32>, String) {
    let output = luna_model(&[&["trace", model, path(recording)], more].concat());
    let said = format!("{}{}", text(&output.stdout), text(&output.stderr));
    (output.status.code(), said)
}

#[test]
fn commstime_is_a_trace_of_its_model() {
    let runs = [
        ("one.luna", Run::default()),
        (
            "threads.luna",
            Run {
                on_threads: true,
                ..Run::default()
            },
        ),
        (
            "virtual.luna",
            Run {
                is_virtual: true,
                ..Run::default()
            },
        ),
        (
            "virtual-threads.luna",
            Run {
                is_virtual: true,
                on_threads: true,
                ..Run::default()
            },
        ),
    ];
    for (name, run) in runs {
        let recording = file(&format!("trace-{name}"));
        commstime(&recording, 500, run).expect("it runs");
        let (code, said) = traced(path(&example("commstime.toml")), &recording, &[]);
        assert_eq!(code, Some(0), "{name}: {said}");
        assert!(said.starts_with("trace accepted: "), "{name}: {said}");
        assert!(said.contains("of 4 channels, from "), "{name}: {said}");
        let count = said.split(' ').nth(2).and_then(|count| count.parse().ok());
        assert!(
            count.is_some_and(|count: u64| count >= 2000),
            "{name}: {said}"
        );
    }
}

#[test]
fn what_a_model_does_not_allow_is_shown_with_what_it_does() {
    let recording = file("trace-stutter.luna");
    let run = Run {
        stutters_after: Some(2),
        ..Run::default()
    };
    commstime(&recording, 20, run).expect("it runs");
    let (code, said) = traced(path(&example("commstime.toml")), &recording, &[]);
    assert_eq!(code, Some(1), "{said}");
    // The third number is the third on `out`, and comes a fourth time. What is rejected is that, or
    // the next number that delta takes too late.
    let not_allowed = said
        .lines()
        .skip_while(|line| *line != "not allowed:")
        .nth(1);
    let not_allowed = not_allowed.expect("it is shown");
    assert!(not_allowed.contains("delta -> consumer: out"), "{said}");
    let before = said.matches("delta -> consumer: out").count();
    assert!(before >= 2 && said.contains("before it:"), "{said}");
    assert!(said.contains("allowed there:\n"), "{said}");
    assert!(said.contains("prefix -> delta: to_delta"), "{said}");
    assert!(
        said.contains("delta is to receive from to_delta, line "),
        "{said}"
    );

    // With the channel hidden, nothing is left to object to.
    let (code, said) = traced(
        path(&example("commstime.toml")),
        &recording,
        &["--hide", "out"],
    );
    assert_eq!(code, Some(0), "{said}");
    assert!(said.contains("of 3 channels"), "{said}");
}

#[test]
fn a_changed_model_rejects_the_recording() {
    let recording = file("trace-changed.luna");
    commstime(&recording, 20, Run::default()).expect("it runs");
    let model = fs::read_to_string(path(&example("commstime.toml"))).unwrap();
    let changed = file("trace-changed.toml");
    // The numbers are to reach the consumer after the successor has passed them on.
    let body = "loop { from?x; par { on!x | out!x } }";
    assert!(model.contains(body));
    fs::write(
        &changed,
        model.replace(body, "loop { from?x; on!x; from?x; out!x; on!x }"),
    )
    .unwrap();
    let (code, said) = traced(path(&changed), &recording, &[]);
    assert_eq!(code, Some(1), "{said}");
    assert!(said.contains("trace rejected after "), "{said}");

    fs::write(
        &changed,
        model.replace("system.part.consumer", "system.part.sink"),
    )
    .unwrap();
    let (code, said) = traced(path(&changed), &recording, &[]);
    assert_eq!(code, Some(1), "{said}");
    assert!(
        said.contains("processes that the model does not have: consumer\n"),
        "{said}"
    );
    assert!(
        said.contains("processes that the recording does not have: sink\n"),
        "{said}"
    );

    let renamed = model
        .replace("\nout = {", "\nresult = {")
        .replace("out = \"out\"", "out = \"result\"")
        .replace("from = \"out\"", "from = \"result\"");
    fs::write(&changed, renamed).unwrap();
    let (code, said) = traced(path(&changed), &recording, &[]);
    assert_eq!(code, Some(1), "{said}");
    assert!(
        said.contains("channels that the model does not have: out (left out)"),
        "{said}"
    );
    assert!(
        said.contains("channels that the recording does not have: result"),
        "{said}"
    );
    let (code, said) = traced(path(&changed), &recording, &["--hide", "result"]);
    assert_eq!(code, Some(0), "{said}");
    let (code, said) = traced(path(&changed), &recording, &["--hide", "out"]);
    assert_eq!(code, Some(2), "{said}");
    assert!(
        said.contains("it has no such channel; there are "),
        "{said}"
    );
}

#[test]
fn ends_are_compared_on_request() {
    let recording = file("trace-ends.luna");
    commstime(&recording, 20, Run::default()).expect("it runs");
    // In the model no process ends.
    let (code, said) = traced(path(&example("commstime.toml")), &recording, &["--ends"]);
    assert_eq!(code, Some(1), "{said}");
    assert!(said.contains("by the ends\n"), "{said}");
    assert!(
        said.contains("consumer ended, and cannot in the model"),
        "{said}"
    );
    // With a consumer that ends, the others end by their closed channels.
    let model = fs::read_to_string(path(&example("commstime.toml"))).unwrap();
    let ending = |rounds: u32| {
        let body = format!("body = \"\"\"\nfor k in 0..{rounds} {{");
        let changed = file("trace-ends.toml");
        fs::write(&changed, model.replace("body = \"\"\"\nloop {", &body)).unwrap();
        traced(path(&changed), &recording, &["--ends"])
    };
    let (code, said) = ending(20);
    assert_eq!(code, Some(0), "{said}");
    let (code, said) = ending(21);
    assert_eq!(code, Some(1), "{said}");
    let (code, said) = ending(19);
    assert_eq!(code, Some(1), "{said}");
    assert!(said.contains("not allowed:"), "{said}");
}

/// A recording by hand: `a` sends to `b` three times, and events are lost before the last time.
fn lossy(file: &Path, losses: &[Record<'_>], is_killed: bool) {
    let mut writer = Writer::new(Vec::new()).unwrap();
    let name = |subject, number, name| Record::Name {
        subject,
        number,
        parent: 0,
        name,
        runs_on: None,
    };
    for record in [
        name(Subject::Process, 1, "a"),
        name(Subject::Process, 2, "b"),
        name(Subject::Channel, 3, "c"),
    ] {
        writer.put(&record).unwrap();
    }
    let event = |time| {
        Record::Event(Event {
            thread: 0,
            time,
            code: code::COMMUNICATION,
            subject: 3,
            arguments: [1, 2],
        })
    };
    writer.put(&event(10)).unwrap();
    writer.put(&Record::Epoch { time: 15, unix: 0 }).unwrap();
    writer.put(&event(20)).unwrap();
    for loss in losses {
        writer.put(loss).unwrap();
    }
    writer.put(&event(30)).unwrap();
    if !is_killed {
        writer.put(&Record::End { time: 40 }).unwrap();
    }
    fs::write(file, writer.finish().unwrap()).unwrap();
}

/// Of what was lost it is not known where: nothing after the last mark of the recorder is rejected.
#[test]
fn what_was_lost_is_not_judged() {
    let recording = file("trace-lost.luna");
    let lost = [Record::Losses {
        of: Losing::Events(0),
        lost: 7,
    }];
    let model = file("trace-lost.toml");
    let with = |body: &str| {
        let text = format!(
            "[process.A]\nports = {{ c = \"send\" }}\nbody = \"{body}\"\n\
             [process.B]\nports = {{ c = \"receive\" }}\nbody = \"loop {{ c? }}\"\n\
             [system.channel]\nc = {{}}\n\
             [system.part]\na = {{ process = \"A\", bind.c = \"c\" }}\nb = {{ process = \"B\", bind.c = \"c\" }}\n"
        );
        fs::write(&model, text).unwrap();
    };
    lossy(&recording, &lost, false);
    with("loop { c! }");
    let (code, said) = traced(path(&model), &recording, &[]);
    assert_eq!(code, Some(4), "{said}");
    assert!(
        said.contains("a trace as far as it goes: 2 communications"),
        "{said}"
    );
    assert!(
        said.contains("7 events of the thread thread 0 were lost"),
        "{said}"
    );
    with("c!");
    let (code, said) = traced(path(&model), &recording, &[]);
    assert_eq!(code, Some(4), "{said}");
    assert!(
        said.contains("unknown after 1 communication, since something may be missing there"),
        "{said}"
    );
    with("stop");
    let (code, said) = traced(path(&model), &recording, &[]);
    assert_eq!(code, Some(1), "{said}");
    // What was lost before it was killed is not recorded.
    lossy(&recording, &[], true);
    with("c!");
    let (code, said) = traced(path(&model), &recording, &[]);
    assert_eq!(code, Some(4), "{said}");
    assert!(said.contains("the recording has no end"), "{said}");
    // The same without a loss.
    lossy(&recording, &[], false);
    let (code, said) = traced(path(&model), &recording, &[]);
    assert_eq!(code, Some(1), "{said}");
    with("for k in 0..3 { c! }");
    assert_eq!(traced(path(&model), &recording, &[]).0, Some(0));
}

#[test]
fn a_recording_without_events_is_refused() {
    let recording = file("trace-none.luna");
    let writer = Writer::new(Vec::new()).unwrap();
    fs::write(&recording, writer.finish().unwrap()).unwrap();
    let (code, said) = traced(path(&example("commstime.toml")), &recording, &[]);
    assert_eq!(code, Some(2), "{said}");
    assert!(said.contains("record it with events"), "{said}");
}
