//! Small models, each for one rule of the meaning.

use luna_model::{Exploration, FindingKind, Model};

/// Two processes with a channel `c` from the first to the second.
fn pair(channel: &str, sender: &str, receiver: &str) -> Exploration {
    let text = format!(
        "[process.A]\nports.c = \"send\"\nvariables.x = \"0..9\"\nbody = \"{sender}\"\n\
         [process.B]\nports.c = \"receive\"\nvariables.x = \"0..9\"\nbody = \"{receiver}\"\n\
         [system.channel]\nc = {{ {channel} }}\n[system.part]\n\
         a = {{ process = \"A\", bind.c = \"c\" }}\nb = {{ process = \"B\", bind.c = \"c\" }}\n"
    );
    let model = Model::parse("pair.toml", &text).unwrap_or_else(|problem| panic!("{problem}"));
    model.explore(10_000)
}

fn kinds(explored: &Exploration) -> Vec<FindingKind> {
    assert!(explored.is_complete);
    explored
        .findings
        .iter()
        .map(|found| found.kind.clone())
        .collect()
}

#[test]
fn a_process_ends_at_a_closed_channel() {
    assert_eq!(kinds(&pair("", "c!; c!", "loop { c? }")), []);
    assert_eq!(kinds(&pair("", "loop { c! }", "c?; c?")), []);
    // What waits for ever does not close.
    let explored = pair("", "c!; stop", "loop { c? }");
    assert_eq!(kinds(&explored), [FindingKind::Deadlock]);
}

#[test]
fn branches_that_begin_and_end_for_ever_compute_for_ever() {
    for body in [
        "loop { par { skip | skip } }",
        "loop { par { x = 1 | stop } }; c!",
        "loop { par { x = 1; par { x = 2 | skip } | skip } }",
    ] {
        let found = kinds(&pair("", body, "stop"));
        let expected = match body.contains("stop") {
            true => FindingKind::Deadlock,
            false => FindingKind::Livelock,
        };
        assert!(found.contains(&expected), "{body}: {found:?}");
    }
}

#[test]
fn a_guard_with_a_false_precondition_is_not_evaluated() {
    let send = "alt { c! 8 / x if x != 0 | skip }";
    let explored = pair("type = '0..9'", send, "c?");
    assert_eq!(kinds(&explored), []);
}

#[test]
fn a_closed_buffer_gives_what_it_holds() {
    let explored = pair(
        "buffer = 'fifo 2'",
        "c!; c!",
        "wait; c?; c?; got; c?; never",
    );
    assert_eq!(kinds(&explored), []);
    let unreached: Vec<&str> = explored.unreached.iter().map(|u| u.what.as_str()).collect();
    // The third receive finds the channel closed, so that what follows is not come to.
    assert_eq!(unreached, ["the receive from c"]);
}

#[test]
fn buffers_overwrite_as_they_say() {
    let sent = "c!1; c!2; c!3; done; stop";
    let received = |first: u8, second: u8| {
        format!("loop {{ c?x; if x == {first} {{ c?x; assert x != {second} }} }}")
    };
    let breaks = |kind: &str, first, second| {
        let channel = format!("buffer = '{kind}', type = '0..9'");
        let explored = pair(&channel, sent, &received(first, second));
        kinds(&explored).contains(&FindingKind::Assertion)
    };
    // After 1 the 3 comes only where the 2 was overwritten.
    assert!(!breaks("fifo 2", 1, 3));
    assert!(breaks("overwrite_newest 2", 1, 3));
    assert!(breaks("overwrite_newest 1", 1, 3));
    // The oldest is lost, never the one behind it.
    assert!(!breaks("overwrite_oldest 2", 1, 3));
    assert!(breaks("overwrite_oldest 1", 1, 3));
}

#[test]
fn a_guard_of_a_false_condition_is_shut() {
    let explored = pair(
        "type = '0..9'",
        "loop { c!x }",
        "alt { c?x if x > 0 => got }",
    );
    assert_eq!(kinds(&explored), [FindingKind::Deadlock]);
    let there = &explored.findings[0].there;
    assert!(
        there
            .iter()
            .any(|line| line.starts_with("b has no open guard")),
        "{there:?}"
    );
}

#[test]
fn two_output_guards_meet_two_input_guards() {
    let explored = pair(
        "",
        "loop { alt { c! => x = 1 | c! => x = 2 } }",
        "loop { alt { c? | c? } }",
    );
    assert_eq!(kinds(&explored), []);
    assert_eq!(explored.unreached, []);
}

#[test]
fn polling_is_a_livelock_and_waiting_for_a_time_is_none() {
    let polls = pair("", "loop { work; c! }", "loop { alt { c? | skip } }");
    assert_eq!(kinds(&polls), [FindingKind::Livelock]);
    let there = &polls.findings[0].there;
    assert_eq!(there[0], "for ever:");
    assert!(there[1].starts_with("b skips"), "{there:?}");
    assert_eq!(
        kinds(&pair(
            "",
            "loop { work; c! }",
            "loop { alt { c? | after } }"
        )),
        []
    );
}

#[test]
fn computing_for_ever_is_a_livelock() {
    let explored = pair("", "loop { x = 1 - x }", "c?");
    assert_eq!(kinds(&explored), [FindingKind::Livelock]);
}

#[test]
fn values_stay_in_their_ranges() {
    let broken = |explored: &Exploration| {
        assert_eq!(kinds(explored), [FindingKind::Assertion]);
        explored.findings[0].there[0].clone()
    };
    let report = broken(&pair(
        "type = '0..3'",
        "for k in 0..9 { c!k }",
        "loop { c?x }",
    ));
    assert_eq!(report, "a sends 4 on c, whose values are 0..3, line 4");
    let report = broken(&pair("type = '0..20'", "c!12", "c?x"));
    assert_eq!(report, "b sets x to 12, whose values are 0..9, line 8");
    let report = broken(&pair("", "x = 8 / x; c!", "c?"));
    assert_eq!(report, "a divides by zero, line 4");
}

#[test]
fn a_branch_that_fails_ends_the_others_and_the_process() {
    let explored = pair("", "c!", "par { loop { c? } | c?; c? }; never");
    assert_eq!(kinds(&explored), []);
    // A branch that waits for ever is not ended.
    let explored = pair("", "c!", "par { loop { c? } | stop }");
    assert_eq!(kinds(&explored), [FindingKind::Deadlock]);
}

#[test]
fn what_no_run_takes_is_found() {
    let explored = pair(
        "type = '0..9'",
        "c!3; c!4",
        "c?x; if x > 3 { big } else { c?x }",
    );
    assert_eq!(kinds(&explored), []);
    let [only] = &explored.unreached[..] else {
        panic!("{:?}", explored.unreached);
    };
    assert_eq!(
        (only.line, only.what.as_str()),
        (8, "the branch of a true condition")
    );
}

#[test]
fn a_limit_on_states_is_reported() {
    let text = "[process.A]\nvariables.x = \"0..99\"\nbody = \"loop { x = (x + 1) % 100; step }\"\n\
                [system.part]\na = { process = \"A\" }\n";
    let model = Model::parse("count.toml", text).unwrap_or_else(|problem| panic!("{problem}"));
    let part = model.explore(50);
    assert_eq!((part.states, part.is_complete), (50, false));
    let all = model.explore(1000);
    assert_eq!((all.states, all.is_complete), (100, true));
}

#[test]
fn always_finds_the_shortest_way() {
    let text = "[process.A]\nvariables.x = \"0..9\"\nbody = \"for k in 0..9 { step; x = x + 1 }\"\n\
                [system.part]\na = { process = \"A\" }\n[check.always]\n\"small\" = \"a.x < 4\"\n";
    let model = Model::parse("count.toml", text).unwrap_or_else(|problem| panic!("{problem}"));
    let explored = model.explore(1000);
    assert_eq!(kinds(&explored), [FindingKind::Always("small".to_owned())]);
    let trace = explored.findings[0].trace.iter();
    let trace: Vec<&str> = trace.map(|step| step.text.as_str()).collect();
    assert_eq!(trace, ["a: step"; 4]);
}

/// Between its last receive and the end of its ends a buffer still takes a value.
#[test]
fn a_process_ends_some_time_after_its_last_step() {
    let text = "[process.A]\nports = { r = \"send\", c = \"send\" }\nbody = \"r!; c!; assert false\"\n\
                [process.B]\nports = { r = \"receive\", c = \"receive\" }\nbody = \"r?\"\n\
                [system.channel]\nr = {}\nc = { buffer = \"fifo 1\" }\n[system.part]\n\
                a = { process = \"A\", bind = { r = \"r\", c = \"c\" } }\n\
                b = { process = \"B\", bind = { r = \"r\", c = \"c\" } }\n";
    let model = Model::parse("end.toml", text).unwrap_or_else(|problem| panic!("{problem}"));
    assert_eq!(kinds(&model.explore(1000)), [FindingKind::Assertion]);
}

/// The processes that wait for ever while others go on.
fn stuck(explored: &Exploration) -> Vec<&str> {
    assert!(explored.is_complete && explored.findings.is_empty());
    let stuck = explored.stuck.iter().flat_map(|stuck| &stuck.processes);
    stuck.map(String::as_str).collect()
}

#[test]
fn what_waits_for_ever_beside_a_loop_is_named() {
    let none: [&str; 0] = [];
    let explored = pair("", "c!; loop { act }", "c?; c?");
    assert_eq!(stuck(&explored), ["b"]);
    let found = explored.stuck.expect("it is named");
    assert_eq!((found.trace.len(), found.there.len()), (1, 1));
    assert!(found.there[0].starts_with("b is to receive from c"));
    // One of the choices is enough, and a branch that waits is none if another goes on.
    let explored = pair("", "choose { loop { c! } | loop { act } }", "loop { c? }");
    assert_eq!(stuck(&explored), ["b"]);
    assert_eq!(
        stuck(&pair("", "loop { act }", "par { c? | loop { act } }")),
        none
    );
    // It may go on at some time, or has ended; a deadlock is a finding of its own.
    assert_eq!(
        stuck(&pair("", "loop { alt { c! | after } }", "loop { c? }")),
        none
    );
    assert_eq!(stuck(&pair("", "loop { act }", "skip")), none);
    assert_eq!(pair("", "stop", "c?").stuck, None);
}
