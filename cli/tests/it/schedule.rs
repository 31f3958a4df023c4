//! `luna model schedule`: bounds and verdicts.

use crate::run::{self, luna_model, text};
use std::fs;
use std::process::Output;

pub(crate) const MODEL: &str = r#"
name = "arm"

[process.Works]
body = "loop { work }"

[system.part.servo]
process = "Works"
on = "fast"
period = "1 ms"
priority = 20
cost = "120 us"
longest_poll = "40 us"

[system.part.logger]
process = "Works"
on = "fast"
period = "10 ms"
priority = 5
cost = "2 ms"
longest_poll = "300 us"

[executor.fast]
core = 2
policy = "fifo:80"

[schedule]
latency = "20 us"
"#;

/// Runs the command on `model`, with these options.
pub(crate) fn schedule(name: &str, model: &str, options: &[&str]) -> Output {
    let path = run::file(&format!("schedule-{name}.toml"));
    fs::write(&path, model).unwrap();
    luna_model(&[&["schedule", run::path(&path)], options].concat())
}

pub(crate) fn out(output: &Output) -> &str {
    text(&output.stdout)
}

pub(crate) fn err(output: &Output) -> &str {
    text(&output.stderr)
}

/// What it has printed, without the ends of lines.
pub(crate) fn flat(output: &Output) -> String {
    let words: Vec<&str> = out(output).split_whitespace().collect();
    words.join(" ")
}

/// The words of the part's row.
pub(crate) fn row<'a>(said: &'a str, part: &str) -> Vec<&'a str> {
    let mut rows = said
        .lines()
        .map(|line| line.split_whitespace().collect::<Vec<_>>());
    rows.find(|words| words.first() == Some(&part))
        .unwrap_or_else(|| panic!("{part} in {said}"))
}

#[test]
fn bounds_within_the_deadlines_exit_with_0() {
    let output = schedule("holds", MODEL, &[]);
    let said = out(&output);
    assert_eq!(output.status.code(), Some(0), "{said}{}", err(&output));
    // A poll of the logger, its own cost, and the latency.
    assert_eq!(
        row(said, "servo"),
        [
            "servo", "fast", "2", "fifo:80", "20", "1000.0", "120.0", "40.0", "440.0", "-",
            "1000.0", "560.0", "holds"
        ]
    );
    // Its own cost, three of the servo, and the latency.
    assert_eq!(row(said, "logger")[8], "2380.0");
    assert!(
        said.contains("core 2: 32.0 % for real-time parts\n"),
        "{said}"
    );
}

#[test]
fn a_bound_beyond_its_deadline_exits_with_1_and_says_what_to_change() {
    let model = MODEL.replacen("priority = 20", "priority = 20\ndeadline = \"400 us\"", 1);
    let output = schedule("exceeds", &model, &[]);
    let said = out(&output);
    assert_eq!(output.status.code(), Some(1), "{said}");
    assert_eq!(row(said, "servo")[11..], ["-40.0", "exceeds"]);
    let said = flat(&output);
    assert!(
        said.contains("to at most 260µs (`logger` has one of 300µs)"),
        "{said}"
    );
}

#[test]
fn without_a_policy_or_with_too_much_to_do_there_is_no_bound() {
    for (from, to, why) in [
        (
            "policy = \"fifo:80\"",
            "policy = \"other\"",
            "write `policy = \"fifo:80\"` in its table",
        ),
        (
            "cost = \"2 ms\"",
            "cost = \"9 ms\"",
            "ask for 102.0 % of the core",
        ),
    ] {
        let output = schedule("none", &MODEL.replacen(from, to, 1), &[]);
        let said = flat(&output);
        assert_eq!(output.status.code(), Some(1), "{said}");
        assert!(said.contains("unbounded") && said.contains(why), "{said}");
    }
}

#[test]
fn what_is_not_known_exits_with_4_and_a_file_of_costs_adds_it() {
    let model = MODEL.replacen("cost = \"120 us\"\nlongest_poll = \"40 us\"\n", "", 1);
    let output = schedule("open", &model, &[]);
    let said = out(&output);
    assert_eq!(output.status.code(), Some(4), "{said}");
    assert_eq!(row(said, "servo").last(), Some(&"unknown"));
    assert!(said.contains("servo: its cost is not known"), "{said}");
    assert!(said.contains("logger: `servo` runs before it"), "{said}");

    let costs = run::file("schedule-costs.toml");
    let path = run::path(&costs);
    fs::write(
        &costs,
        "servo = { cost = \"120 us\", longest_poll = \"40 us\" }\n",
    )
    .unwrap();
    let output = schedule("open", &model, &["--costs", path]);
    assert_eq!(output.status.code(), Some(0), "{}", out(&output));
    assert_eq!(row(out(&output), "servo")[8], "440.0");

    fs::write(&costs, "servi = { cost = \"120 us\" }\n").unwrap();
    let output = schedule("open", &model, &["--costs", path]);
    assert_eq!(output.status.code(), Some(2));
    let said = err(&output);
    assert!(
        said.contains(":1:1: the model has no process of this name: `servi`"),
        "{said}"
    );
}

#[test]
fn a_part_without_an_executor_is_not_counted_and_one_without_a_period_named() {
    let extra = "[system.part.stray]\nprocess = \"Works\"\n[system.part.event]\nprocess = \"Works\"\n\
                 on = \"fast\"\npriority = 9\ncost = \"5 us\"\n";
    let output = schedule("stray", &format!("{MODEL}\n{extra}"), &[]);
    let said = out(&output);
    assert_eq!(output.status.code(), Some(4), "{said}");
    assert!(
        said.contains("not counted, since they name no executor: stray"),
        "{said}"
    );
    assert!(said.contains("logger: `event` runs before it"), "{said}");
    // Its poll is known, which is all that the servo needs.
    assert_eq!(row(said, "servo").last(), Some(&"holds"), "{said}");
    assert!(said.contains("and what is not known"), "{said}");
}

#[test]
fn a_part_that_may_wait_for_another_is_named() {
    let model = MODEL
        .replacen("body = \"loop { work }\"", "ports = { out = \"send\" }\nbody = \"loop { out! }\"\n[process.Takes]\nports = { input = \"receive\" }\nbody = \"loop { input? }\"", 1)
        .replace("process = \"Works\"", "process = \"Works\"\nbind = { out = \"c\" }");
    let extra = "[system.channel]\nc = {}\n[system.part.sink]\nprocess = \"Takes\"\nbind = { input = \"c\" }\non = \"other\"\n[executor.other]\npolicy = \"other\"\n";
    let output = schedule("waits", &format!("{model}\n{extra}"), &[]);
    let said = flat(&output);
    assert_eq!(output.status.code(), Some(0), "{said}{}", err(&output));
    assert!(
        said.contains("leave out waits for other processes and for a time: servo, logger"),
        "{said}"
    );
    assert!(said.contains("560.0 holds* logger"), "{said}");
}

#[test]
fn json_has_the_same() {
    let output = schedule("json", MODEL, &["--json"]);
    let said: serde_json::Value = serde_json::from_str(out(&output)).expect("it is JSON");
    assert_eq!(said["latency_ns"], 20_000);
    let servo = &said["parts"][0];
    assert_eq!(servo["name"], "servo");
    assert_eq!(servo["bound_ns"], 440_000);
    assert_eq!(servo["slack_ns"], 560_000);
    assert_eq!(servo["verdict"], "holds");
    let utilization = said["cores"][0]["utilization"].as_f64();
    assert!(
        utilization.is_some_and(|share| (share - 0.32).abs() < 1e-9),
        "{said}"
    );
}
