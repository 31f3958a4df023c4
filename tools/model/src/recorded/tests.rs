//! What was recorded as models.

use super::{Recorded, RecordedChannel, RecordedExecutor, RecordedProcess, name_in_model};
use crate::Model;
use crate::network::Buffering;
use std::time::Duration;

fn process(name: &str) -> RecordedProcess {
    RecordedProcess {
        name: name.to_owned(),
        ..RecordedProcess::default()
    }
}

fn channel(name: &str, held: usize, from: &[usize], to: &[usize]) -> RecordedChannel {
    let users = |users: &[usize]| users.iter().copied().map(Some).collect();
    RecordedChannel {
        buffer: None,
        name: name.to_owned(),
        held,
        least: 2,
        senders: users(from),
        receivers: users(to),
    }
}

fn parse(recorded: &Recorded) -> Model {
    let text = recorded.to_model("a.luna\nb");
    Model::parse("a.toml", &text).unwrap_or_else(|problem| panic!("{problem}\n{text}"))
}

#[test]
fn what_ran_becomes_a_model_with_all_that_is_known() {
    let recorded = Recorded {
        system: "a \"quoted\" name".to_owned(),
        processes: vec![
            RecordedProcess {
                priority: Some(7),
                period: Some(Duration::from_micros(1500)),
                executor: Some("main thread".to_owned()),
                ..process("pan/control")
            },
            process("motor[0]"),
            process("idle"),
            process("outside"),
        ],
        channels: vec![
            channel("torque[0]", 0, &[0], &[1]),
            channel("image", 3, &[0], &[1]),
            channel("log", 300, &[1], &[]),
            channel("own", 0, &[0], &[0]),
            channel("own too", 0, &[1], &[]),
            channel("größe", 0, &[], &[1]),
        ],
        executors: vec![RecordedExecutor {
            name: "main thread".to_owned(),
            policy: Some("deadline:200000/500000/1000000".to_owned()),
            core: Some(1),
            ..Default::default()
        }],
    };
    let model = parse(&recorded);
    let network = &model.network;
    assert_eq!(network.name, "a \"quoted\" name");
    let names: Vec<&str> = model.process_names().collect();
    let expected = ["idle", "motor_0", "outside", "outside_", "pan_control"];
    assert_eq!(names, expected);
    let channels: Vec<&str> = model.channel_names().collect();
    assert_eq!(
        channels,
        ["größe", "image", "log", "own", "own_too", "torque_0"]
    );
    let control = &network.processes[4];
    assert_eq!(control.priority, Some(7));
    assert_eq!(control.period, Some(Duration::from_micros(1500)));
    assert_eq!(control.on.as_deref(), Some("main_thread"));
    let kinds = network.channels.iter().map(|channel| channel.kind);
    let (rendezvous, fifo, overwriting) = (
        Buffering::Rendezvous,
        Buffering::Fifo(3),
        Buffering::OverwriteOldest(2),
    );
    let expected = [
        rendezvous,
        fifo,
        overwriting,
        rendezvous,
        rendezvous,
        rendezvous,
    ];
    assert!(kinds.eq(expected));
    let own_too = &network.channels[4];
    assert_eq!(
        (&own_too.senders[..], &own_too.receivers[..]),
        (&[1][..], &[3][..])
    );
    let own = &network.channels[3];
    assert_eq!((&own.senders[..], &own.receivers[..]), (&[4][..], &[4][..]));
}

#[test]
fn any_name_is_one_of_a_model() {
    for name in [
        "", "[", "a.b[3].c", "2", "if", "über", "_", "a_", "a-b", "system", "x\ny",
    ] {
        let recorded = Recorded {
            processes: vec![process(name), process("other one")],
            channels: vec![channel(name, 0, &[0], &[1])],
            ..Recorded::default()
        };
        let model = parse(&recorded);
        let word = name_in_model(name);
        assert!(model.process_names().any(|found| found == word), "{name}");
        assert_eq!(model.channel_names().next(), Some(word.as_str()));
    }
}

#[test]
fn what_is_known_of_one_process_stays_with_another_of_its_name() {
    let known = RecordedProcess {
        priority: Some(7),
        ..process("worker")
    };
    for processes in [
        vec![known.clone(), process("worker")],
        vec![process("worker"), known],
    ] {
        let recorded = Recorded {
            processes,
            ..Recorded::default()
        };
        assert_eq!(parse(&recorded).network.processes[0].priority, Some(7));
    }
}
