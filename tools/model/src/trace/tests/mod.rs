//! What is a trace of a model, and what is not.

mod walks;

use super::{Communication, Party, TraceOptions, TraceVerdict};
use crate::Model;

/// Times of different threads may be wrong by so much.
const SKEW: u64 = 40;

fn options() -> TraceOptions {
    TraceOptions {
        skew: SKEW,
        ..TraceOptions::default()
    }
}

const RELAY: &str = r#"
    [process.Source]
    ports = { to = "send" }
    body = "loop { to! }"
    [process.Relay]
    ports = { from = "receive", to = "send" }
    body = "loop { from?; work; to! }"
    [process.Sink]
    ports = { from = "receive" }
    body = "loop { from?; after_all }"
    [system.channel]
    a = {}
    b = {}
    [system.part]
    source = { process = "Source", bind.to = "a" }
    relay = { process = "Relay", bind = { from = "a", to = "b" } }
    sink = { process = "Sink", bind.from = "b" }
"#;

fn relay() -> Model {
    Model::parse("relay.toml", RELAY).unwrap_or_else(|problem| panic!("{problem}"))
}

fn event(time: u64, channel: usize, sender: usize, receiver: usize) -> Communication {
    Communication {
        thread: 0,
        time,
        channel,
        sender: Party::Process(sender),
        receiver: Party::Process(receiver),
    }
}

#[test]
fn a_rejection_tells_what_was_allowed_and_where_the_processes_are() {
    let model = relay();
    let (a, b) = (event(1, 0, 0, 1), event(2, 1, 1, 2));
    let traced = model.trace(&[a, b, a, a], &options());
    let TraceVerdict::Rejected(rejected) = traced.verdict else {
        panic!("{traced:?}");
    };
    assert_eq!((traced.accepted, rejected.event), (3, 3));
    assert_eq!(rejected.before, [0, 1, 2]);
    assert_eq!(rejected.allowed, ["relay -> sink: b"]);
    assert_eq!(
        rejected.there,
        ["relay is to work, line 7", "source is to send on a, line 4"]
    );
}

#[test]
fn a_hidden_channel_may_be_used_at_any_time() {
    let model = relay();
    let a = event(1, 0, 0, 1);
    let all = [a, a, a];
    assert_eq!(model.trace(&all, &options()).accepted, 1);
    let hidden = TraceOptions {
        hidden: vec![1],
        ..options()
    };
    let traced = model.trace(&all, &hidden);
    assert_eq!(traced.verdict, TraceVerdict::Accepted);
}

#[test]
fn what_is_outside_takes_part_unrecorded_or_without_its_name() {
    let model = relay();
    let from_outside = Communication {
        sender: Party::None,
        ..event(1, 0, 0, 1)
    };
    let b = event(2, 1, 1, 2);
    let outside = TraceOptions {
        unrecorded: vec![0],
        ..options()
    };
    for events in [&[from_outside, b, from_outside, b][..], &[b, b]] {
        let traced = model.trace(events, &outside);
        assert_eq!(traced.verdict, TraceVerdict::Accepted, "{events:?}");
    }
    // A process of the recording that the model does not have is none that it does not know.
    let stranger = Communication {
        sender: Party::Stranger,
        ..from_outside
    };
    let traced = model.trace(&[stranger], &outside);
    assert!(matches!(traced.verdict, TraceVerdict::Rejected(_)));
    // With all processes recorded, nothing is outside.
    let traced = model.trace(&[from_outside], &options());
    assert!(matches!(traced.verdict, TraceVerdict::Rejected(_)));
}

#[test]
fn times_of_threads_order_what_is_further_apart_than_the_skew() {
    let model = relay();
    let on = |thread, event| Communication { thread, ..event };
    let verdict = |apart| {
        // The relay's thread recorded both of its communications the wrong way round.
        let events = [
            on(1, event(100, 1, 1, 2)),
            on(0, event(100 + apart, 0, 0, 1)),
        ];
        model.trace(&events, &options()).verdict
    };
    assert_eq!(verdict(SKEW), TraceVerdict::Accepted);
    assert!(matches!(verdict(SKEW + 1), TraceVerdict::Rejected(_)));
}

#[test]
fn limits_are_told() {
    let model = relay();
    let few = TraceOptions {
        max_states: 1,
        ..options()
    };
    let traced = model.trace(&[event(1, 0, 0, 1), event(2, 1, 1, 2)], &few);
    assert_eq!(traced.verdict, TraceVerdict::TooLarge);
}

#[test]
fn a_model_that_breaks_a_rule_at_once_has_no_trace() {
    let text = RELAY.replace("loop { from?; after_all }", "assert false; from?");
    let model = Model::parse("broken.toml", &text).unwrap_or_else(|problem| panic!("{problem}"));
    let traced = model.trace(&[event(1, 0, 0, 1)], &options());
    assert_eq!(traced.verdict, TraceVerdict::Broken);
}

#[test]
fn what_ended_must_be_able_to_end() {
    let text = RELAY.replace("loop { to! }", "for k in 0..2 { to! }; say");
    let model = Model::parse("ends.toml", &text).unwrap_or_else(|problem| panic!("{problem}"));
    let (a, b) = (event(1, 0, 0, 1), event(2, 1, 1, 2));
    let verdict = |events: &[Communication], ended: &[usize]| {
        let options = TraceOptions {
            ended: ended.to_vec(),
            ..options()
        };
        model.trace(events, &options).verdict
    };
    // The others end because their channels are closed.
    assert_eq!(verdict(&[a, b, a, b], &[0, 1, 2]), TraceVerdict::Accepted);
    assert_eq!(verdict(&[a, b, a, b], &[2]), TraceVerdict::Accepted);
    // The source is not done, so nothing is closed.
    let none = TraceVerdict::Unended(vec![0, 2]);
    assert_eq!(verdict(&[a, b, a], &[]), TraceVerdict::Accepted);
    assert_eq!(verdict(&[a, b], &[0, 2]), none);
    // The relay still has a value for the sink, which waits.
    let relay = TraceVerdict::Unended(vec![1, 2]);
    assert_eq!(verdict(&[a, b, a], &[0, 1, 2]), relay);
}

#[test]
fn a_rule_that_a_receive_from_a_buffer_breaks_is_named() {
    let text = "[process.Gives]\nports = { c = \"send\" }\nbody = \"c! 5\"\n\
                [process.Takes]\nports = { c = \"receive\" }\nvariables = { x = \"0..3\" }\n\
                body = \"c?x\"\n\
                [system.channel]\nc = { buffer = \"fifo 1\", type = \"0..9\" }\n\
                [system.part]\ngives = { process = \"Gives\", bind.c = \"c\" }\n\
                takes = { process = \"Takes\", bind.c = \"c\" }\n";
    let model = Model::parse("m.toml", text).unwrap_or_else(|problem| panic!("{problem}"));
    let sent = Communication {
        receiver: Party::None,
        ..event(1, 0, 0, 1)
    };
    let received = Communication {
        sender: Party::None,
        ..event(2, 0, 0, 1)
    };
    let traced = model.trace(&[sent, received], &options());
    let TraceVerdict::Rejected(rejected) = traced.verdict else {
        panic!("{traced:?}");
    };
    assert_eq!(rejected.event, 1);
    let names_range = |line: &String| line.contains("0..3") || line.contains("range");
    assert!(
        rejected.there.iter().any(names_range),
        "{:?}",
        rejected.there
    );
}

/// What was lost before any of them may explain a rejection.
#[test]
fn a_rejection_has_the_last_of_those_that_had_to_come_next() {
    let model = relay();
    let on = |thread, event| Communication { thread, ..event };
    let b = event(100, 1, 1, 2);
    let late = on(1, event(101, 1, 1, 2));
    let traced = model.trace(&[b, late], &options());
    let TraceVerdict::Rejected(rejected) = traced.verdict else {
        panic!("{traced:?}");
    };
    assert_eq!((rejected.event, rejected.latest), (0, 1));
}

#[test]
fn looking_for_ends_has_a_limit() {
    let text = RELAY.replace(
        "loop { to! }",
        "for k in 0..2 { to! }; for k in 0..50 { say }",
    );
    let model = Model::parse("ends.toml", &text).unwrap_or_else(|problem| panic!("{problem}"));
    let (a, b) = (event(1, 0, 0, 1), event(2, 1, 1, 2));
    let verdict = |max_states, ended: &[usize]| {
        let options = TraceOptions {
            ended: ended.to_vec(),
            max_states,
            ..options()
        };
        model.trace(&[a, b, a, b], &options).verdict
    };
    // With just enough states for the communications.
    let enough = (1..100).find(|limit| verdict(*limit, &[]) == TraceVerdict::Accepted);
    let enough = enough.expect("a limit that is enough");
    assert_eq!(verdict(enough, &[0, 1, 2]), TraceVerdict::TooLarge);
    assert_eq!(verdict(1000, &[0, 1, 2]), TraceVerdict::Accepted);
}
