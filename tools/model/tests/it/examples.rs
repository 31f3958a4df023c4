//! The models of `examples/models`, each with the verdict that it is to have.

use crate::{is_long, skip};
use luna_model::{Exploration, FindingKind, Model, SpinError, TEMPLATE};
use std::fs;
use std::path::PathBuf;
use std::time::{Duration, Instant};

/// What a check may take.
const LIMIT: Duration = Duration::from_secs(10);

fn text(name: &str) -> String {
    let path = PathBuf::from(env!("CARGO_MANIFEST_DIR"))
        .join("../../examples/models")
        .join(name);
    fs::read_to_string(&path).expect("the example is there")
}

fn parsed(name: &str, text: &str) -> Model {
    Model::parse(name, text).unwrap_or_else(|problem| panic!("{problem}"))
}

fn model(name: &str) -> Model {
    parsed(name, &text(name))
}

fn explore(model: &Model) -> Exploration {
    explore_within(LIMIT, model)
}

fn explore_within(limit: Duration, model: &Model) -> Exploration {
    let begin = Instant::now();
    let explored = model.explore(model.max_states());
    assert!(begin.elapsed() < limit, "{:?}", begin.elapsed());
    assert!(explored.is_complete);
    assert_eq!(explored.unreached, []);
    explored
}

#[test]
fn philosophers_deadlock_in_a_circle() {
    let explored = explore(&model("philosophers.toml"));
    let [deadlock] = &explored.findings[..] else {
        panic!("{explored:#?}");
    };
    assert_eq!(deadlock.kind, FindingKind::Deadlock);
    // Each thinks and takes a fork: there is no shorter way.
    assert_eq!(deadlock.trace.len(), 10);
    let circle = "circle, each waits for the next: philosopher[0] -> fork[1] -> philosopher[1] \
                  -> fork[2] -> philosopher[2] -> fork[3] -> philosopher[3] -> fork[4] -> \
                  philosopher[4] -> fork[0] -> philosopher[0]";
    assert_eq!(deadlock.there.last().map(String::as_str), Some(circle));
    let svg = deadlock.to_svg();
    for (class, count) in [("n", 10), ("l", 10), ("a", 5), ("d", 5)] {
        let found = svg.matches(&format!("class=\"{class}\"")).count();
        assert_eq!(found, count, "{class} in {svg}");
    }
    assert!(svg.contains(&circle.replace('>', "&gt;")), "{svg}");
}

#[test]
fn the_other_examples_are_right() {
    for name in [
        "philosophers-repaired.toml",
        "commstime.toml",
        "sorting-pump.toml",
        "sieve.toml",
    ] {
        let explored = explore(&model(name));
        assert_eq!(explored.findings, [], "{name}");
    }
}

/// Some 160 000 states: 2 s without optimization on a machine that does nothing else.
fn is_right(name: &str) {
    let explored = explore_within(Duration::from_secs(60), &model(name));
    assert_eq!(explored.findings, [], "{name}");
    assert!(explored.states > 100_000, "{name}: {}", explored.states);
}

#[test]
fn jiwy_is_right() {
    is_right("jiwy.toml");
}

#[test]
fn the_production_cell_is_right() {
    is_right("production-cell.toml");
}

#[test]
fn the_template_is_right() {
    let template = Model::parse("template.toml", TEMPLATE).expect("the template is a model");
    assert_eq!(explore(&template).findings, []);
}

fn spin_has_the_verdict(model: &Model, expected: &[FindingKind]) {
    let found = match model.check_with_spin() {
        Ok(found) => found,
        Err(SpinError::Missing { program, .. }) => {
            return skip(&format!("{program} is missing"));
        }
        Err(error) => panic!("{error}"),
    };
    let kinds: Vec<FindingKind> = found.findings.iter().map(|f| f.kind.clone()).collect();
    assert_eq!(kinds, expected);
    assert!(found.incomplete.is_empty(), "{found:?}");
}

#[test]
fn spin_finds_the_deadlock_of_philosophers() {
    spin_has_the_verdict(&model("philosophers.toml"), &[FindingKind::Deadlock]);
}

#[test]
fn spin_finds_the_repaired_philosophers_right() {
    spin_has_the_verdict(&model("philosophers-repaired.toml"), &[]);
}

#[test]
fn spin_finds_commstime_right() {
    spin_has_the_verdict(&model("commstime.toml"), &[]);
}

/// SPIN has 2 700 000 states for the four values of the model (LUNA_LONG=1), 1 000 000 for three.
#[test]
fn spin_finds_the_sorting_pump_right() {
    let text = text("sorting-pump.toml");
    let values = "{ to!0 | to!1 | to!2 | to!3 }";
    assert!(text.contains(values));
    let text = match is_long() {
        true => text,
        false => text.replace(values, "{ to!0 | to!1 | to!3 }"),
    };
    spin_has_the_verdict(&parsed("sorting-pump.toml", &text), &[]);
}

#[test]
fn spin_finds_the_sieve_right() {
    spin_has_the_verdict(&model("sieve.toml"), &[]);
}

#[test]
fn spin_shows_in_the_words_of_the_model_why_a_property_does_not_hold() {
    let text = r#"
        [process.Source]
        ports = { a = "send", b = "send" }
        body = "loop { choose { a! | b! } }"
        [process.Sink]
        ports = { a = "receive", b = "receive" }
        body = "loop { alt { a? => left | b? => right } }"
        [system.channel]
        a = {}
        b = {}
        [system.part]
        source = { process = "Source", bind = { a = "a", b = "b" } }
        sink = { process = "Sink", bind = { a = "a", b = "b" } }
        [check.ltl]
        both = "([] <> sink@left) && ([] <> sink@right)"
        one = "[] <> (sink@left || sink@right)"
    "#;
    let model = Model::parse("choice.toml", text).unwrap_or_else(|problem| panic!("{problem}"));
    let found = match model.check_with_spin() {
        Ok(found) => found,
        Err(SpinError::Missing { program, .. }) => return skip(&format!("{program} is missing")),
        Err(error) => panic!("{error}"),
    };
    let [only] = &found.findings[..] else {
        panic!("{found:#?}");
    };
    assert_eq!(only.kind, FindingKind::Ltl("both".to_owned()));
    let cycle = only
        .trace
        .iter()
        .skip_while(|step| step.text != "for ever:");
    let cycle: Vec<&str> = cycle.map(|step| step.text.as_str()).collect();
    let has = |wanted: &str| cycle.contains(&wanted);
    assert!(has("sink: left") != has("sink: right"), "{cycle:#?}");
    assert!(
        has("source -> sink: a") != has("source -> sink: b"),
        "{cycle:#?}"
    );
}

#[test]
fn spin_does_not_let_shut_guards_meet() {
    let text = r#"
        [process.A]
        ports = { c = "send" }
        body = "alt { c! if false => sent }"
        [process.B]
        ports = { c = "receive" }
        body = "alt { c? if false => got }"
        [system.channel]
        c = {}
        [system.part]
        a = { process = "A", bind.c = "c" }
        b = { process = "B", bind.c = "c" }
    "#;
    let model = Model::parse("shut.toml", text).unwrap_or_else(|problem| panic!("{problem}"));
    let found = match model.check_with_spin() {
        Ok(found) => found,
        Err(SpinError::Missing { program, .. }) => return skip(&format!("{program} is missing")),
        Err(error) => panic!("{error}"),
    };
    let kinds: Vec<FindingKind> = found.findings.iter().map(|f| f.kind.clone()).collect();
    assert_eq!(kinds, [FindingKind::Deadlock]);
}

/// The verifier offers also what a shut guard would send.
#[test]
fn spin_does_not_divide_in_a_shut_guard() {
    let text = r#"
        [process.A]
        ports = { c = "send" }
        variables = { x = "0..1" }
        body = "alt { c! 2 / x if x > 0 => sent | skip if x == 0 => shut }"
        [process.B]
        ports = { c = "receive" }
        body = "alt { c? => got | after => late }"
        [system.channel]
        c = { type = "0..2" }
        [system.part]
        a = { process = "A", bind.c = "c" }
        b = { process = "B", bind.c = "c" }
    "#;
    let model = Model::parse("divides.toml", text).unwrap_or_else(|problem| panic!("{problem}"));
    match model.check_with_spin() {
        Ok(found) => assert!(found.findings.is_empty(), "{:?}", found.findings),
        Err(SpinError::Missing { program, .. }) => skip(&format!("{program} is missing")),
        Err(error) => panic!("{error}"),
    }
}
