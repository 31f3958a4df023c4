//! What delays a part, by where the model has it run.

use luna_model::Model;
use luna_model::schedule::{Costs, Known, Row, Seen, Verdict};
use std::time::Duration;

const BODIES: &str = r#"
[process.Works]
body = "loop { work }"
[process.Pair]
part.one = { process = "Works", priority = 9 }
part.two = { process = "Works", priority = 3, cost = "2 us" }
"#;

fn model(parts: &str) -> Model {
    Model::parse("m.toml", &format!("{BODIES}{parts}")).unwrap_or_else(|error| panic!("{error}"))
}

fn rows(parts: &str) -> Vec<Row> {
    model(parts).schedule(&Costs::new()).rows
}

fn us(count: u64) -> Option<Duration> {
    Some(Duration::from_micros(count))
}

#[test]
fn parts_take_from_the_part_around_them_what_they_do_not_state() {
    let rows = rows(
        r#"
[system.part.pair]
process = "Pair"
on = "fast"
period = "100 us"
deadline = "50 us"
cost = "10 us"
[executor.fast]
core = 0
policy = "rr:10"
"#,
    );
    let names: Vec<&str> = rows.iter().map(|row| row.name.as_str()).collect();
    assert_eq!(names, ["pair.one", "pair.two"]);
    let costs = [&rows[0], &rows[1]].map(|row| (row.cost, row.longest_poll, row.deadline));
    assert_eq!(costs, [(us(10), us(10), us(50)), (us(2), us(2), us(50))]);
    // The other's poll; and the other's job, before its own.
    assert_eq!([rows[0].bound, rows[1].bound], [us(12), us(12)]);
}

/// Three processes of 10 µs.
fn three(on: [&str; 3], executors: &str) -> Vec<Row> {
    let parts = on
        .iter()
        .zip(["a", "b", "c"])
        .zip(1..)
        .map(|((on, name), priority)| {
            format!(
                "[system.part.{name}]\nprocess = \"Works\"\non = \"{on}\"\npriority = {priority}\n\
             period = \"100 us\"\ncost = \"10 us\"\n"
            )
        });
    rows(&(parts.collect::<String>() + executors))
}

#[test]
fn each_process_on_a_thread_has_one_of_its_own() {
    let executors = "[executor.own]\nkind = \"thread\"\ncore = 1\npolicy = \"fifo:9\"\n\
                     [executor.above]\ncore = 1\npolicy = \"fifo:10\"\n";
    let rows = three(["own", "own", "above"], executors);
    // Threads of one level may run before each other, whatever the priorities.
    assert_eq!([0, 1, 2].map(|n| rows[n].bound), [us(30), us(30), us(10)]);
}

#[test]
fn cores_of_different_hosts_are_different() {
    let executors = "[executor.one]\nprogram = \"p\"\ncore = 1\npolicy = \"fifo:9\"\n\
                     [executor.two]\nprogram = \"q\"\ncore = 1\npolicy = \"fifo:10\"\n\
                     [executor.three]\nprogram = \"r\"\ncore = 1\npolicy = \"fifo:10\"\n\
                     [program.p]\nhost = \"here\"\n[program.q]\nhost = \"there\"\n\
                     [program.r]\nhost = \"here\"\n[host.here]\n[host.there]\n";
    let rows = three(["one", "two", "three"], executors);
    // Two programs of one host share its core.
    assert_eq!([0, 1, 2].map(|n| rows[n].bound), [us(20), us(10), us(10)]);
}

#[test]
fn a_real_time_executor_on_no_core_leaves_those_below_it_unknown() {
    let executors = "[executor.high]\ncore = 1\npolicy = \"fifo:50\"\n\
                     [executor.low]\ncore = 1\npolicy = \"fifo:9\"\n\
                     [executor.any]\npolicy = \"fifo:10\"\n";
    let rows = three(["high", "low", "any"], executors);
    let verdicts = [0, 1, 2].map(|n| rows[n].verdict);
    assert_eq!(
        verdicts,
        [Verdict::Holds, Verdict::Unknown, Verdict::Unknown]
    );
    let advice = |n: usize| rows[n].advice.as_deref();
    assert_eq!(
        advice(1),
        Some("`c` may run before it: state the core of `any`")
    );
    assert_eq!(
        advice(2),
        Some("`any` is on no core: write `core = …` in its table")
    );
}

#[test]
fn an_ordinary_executor_delays_no_real_time_one() {
    let executors = "[executor.fast]\ncore = 1\npolicy = \"fifo:50\"\n\
                     [executor.slow]\ncore = 1\npolicy = \"other\"\n";
    let rows = three(["fast", "fast", "slow"], executors);
    assert_eq!([0, 1, 2].map(|n| rows[n].bound), [us(20), us(20), None]);
    assert_eq!(rows[2].verdict, Verdict::Unbounded);
}

#[test]
fn what_others_wake_is_counted_as_it_was_seen_and_has_no_deadline_to_keep() {
    let part = |name: &str, on: &str| {
        format!("[system.part.{name}]\nprocess = \"Works\"\non = \"{on}\"\n")
    };
    let model = model(&format!(
        "{}period = \"100 us\"\ncost = \"10 us\"\n{}{}[executor.fast]\ncore = 1\n\
         policy = \"fifo:50\"\n[executor.slow]\npolicy = \"other\"\n",
        part("a", "fast"),
        part("b", "fast"),
        part("c", "slow"),
    ));
    let mut costs = Costs::new();
    let wakes: Vec<Duration> = (0..9).map(|n| Duration::from_micros(n * 50)).collect();
    for name in ["b", "c"] {
        let known = Known {
            cost: us(20),
            arrivals: Seen::of(&wakes),
            ..Known::default()
        };
        costs.insert(name, known);
    }
    let found = model.schedule(&costs);
    let bounds = [0, 1, 2].map(|n| found.rows[n].bound);
    assert_eq!(bounds, [us(30), us(30), None]);
    let verdicts = [0, 1, 2].map(|n| found.rows[n].verdict);
    assert_eq!(
        verdicts,
        [Verdict::Holds, Verdict::Nothing, Verdict::Nothing]
    );
    assert!(
        (found.cores[0].utilization - 0.5).abs() < 0.01,
        "{:?}",
        found.cores
    );
}

#[test]
fn the_larger_of_what_is_stated_and_what_is_known_counts() {
    let model = model(
        "[system.part.a]\nprocess = \"Works\"\non = \"fast\"\nperiod = \"100 us\"\ncost = \"10 us\"\n\
         [executor.fast]\ncore = 1\npolicy = \"fifo:50\"\n[schedule]\nlatency = \"5 us\"\n",
    );
    for (known, bound) in [(8, 15), (20, 25)] {
        let mut costs = Costs::new();
        let cost = us(known);
        costs.insert(
            "a",
            Known {
                cost,
                ..Known::default()
            },
        );
        costs.insert("b", Known::default());
        let found = model.schedule(&costs);
        assert_eq!(found.rows[0].bound, us(bound));
        assert_eq!(found.strangers, ["b"]);
    }
}

#[test]
fn what_is_wrong_is_said_with_its_place() {
    let part = "[system.part.a]\nprocess = \"Works\"\n";
    for (text, expected) in [
        (
            format!("{part}cost = \"1 us\"\nlongest_poll = \"2 us\"\n"),
            "m.toml:7:14: the longest poll of this part is longer than its cost: `a`; `cost` is the \
             time of all polls of a cycle: raise it",
        ),
        (
            format!("{part}cost = \"soon\"\n"),
            "m.toml:9:8: this is no time: `\"soon\"`; write a whole number from 1 to \
             1000000000 and ns, us, ms or s: `1 ms`",
        ),
        (
            format!("{part}[schedule]\nlatenzy = \"1 us\"\n"),
            "m.toml:10:1: this key has no meaning here: `latenzy`; is `latency` meant?",
        ),
    ] {
        let error = Model::parse("m.toml", &format!("{BODIES}{text}")).expect_err("it is wrong");
        assert_eq!(error.to_string(), expected);
    }
    let costs = model(part).parse_costs("c.toml", "[a]\ncost = \"1 us\"\nlongest_poll = \"2 us\"");
    let error = costs.expect_err("it is wrong").to_string();
    assert!(error.starts_with("c.toml:1:2: the longest poll"), "{error}");
}
