//! What is known of a model's parts, and what is not.

use super::*;
use crate::Model;

const PROCESSES: &str = r#"
name = "m"
[process.Works]
body = "loop { work }"
[process.Waits]
body = "loop { alt { after => work } }"
[process.Skips]
ports = { a = "receive" }
body = "loop { alt { skip if 0 == 1 | a? } }"
[process.Polls]
ports = { a = "receive" }
body = "loop { alt { skip | a? } }"
[process.Sends]
ports = { a = "send" }
body = "loop { a! }"
"#;

/// A part on its own executor of core 2.
fn part(name: &str, executor: &str, run: &str) -> String {
    format!(
        "[system.part.{name}]\nprocess = \"Works\"\non = \"{name}\"\n{run}\n\
         [executor.{name}]\n{executor}\n"
    )
}

fn schedule(parts: &[String], costs: &str) -> Schedule {
    let text = format!("{PROCESSES}{}", parts.concat());
    let model = Model::parse("m.toml", &text);
    let model = model.unwrap_or_else(|problem| panic!("{problem}"));
    let costs = model.parse_costs("costs.toml", costs).expect("costs");
    model.schedule(&costs)
}

const LO: &str = "period = \"10 ms\"\ncost = \"500 us\"";

/// The verdict and the advice of `lo`, on core 2 at 50, beside `hi`.
fn beside(executor: &str) -> (&'static str, String) {
    let lo = part("lo", "core = 2\npolicy = \"fifo:50\"", LO);
    let hi = part("hi", executor, "period = \"1 ms\"\ncost = \"100 us\"");
    let found = schedule(&[lo, hi], "");
    let row = &found.rows[0];
    assert_eq!(row.name, "lo");
    (row.verdict.word(), row.advice.clone().unwrap_or_default())
}

#[test]
fn what_may_have_any_policy_may_run_before() {
    assert_eq!(beside("core = 2\npolicy = \"other\"").0, "holds");
    assert_eq!(beside("core = 3").0, "holds");
    for executor in ["core = 2", ""] {
        let (verdict, advice) = beside(executor);
        assert_eq!(verdict, "unknown");
        assert_eq!(advice, "`hi` may run before it: state the policy of `hi`");
    }
    let (verdict, advice) = beside("policy = \"fifo:50\"");
    let expected = "`hi` may run before it: state the core of `hi`";
    assert_eq!((verdict, advice.as_str()), ("unknown", expected));
    let (verdict, advice) = beside("core = 2\npolicy = \"deadline:2000/4000/4000\"");
    assert_eq!(verdict, "unknown");
    assert!(advice.contains("no bound covers `deadline"), "{advice}");
}

#[test]
fn a_part_of_an_unknown_policy_is_unknown() {
    let found = schedule(&[part("lo", "core = 2", LO)], "");
    assert_eq!(found.rows[0].verdict, Verdict::Unknown);
    let advice = found.rows[0].advice.as_deref();
    assert!(advice.is_some_and(|advice| advice.contains("`lo` is not known")));
    assert!(found.cores.is_empty());
}

#[test]
fn what_is_on_no_host_may_be_on_any() {
    let hosts = "[program.p]\nhost = \"robot\"\n[host.robot]\n".to_owned();
    let lo = part("lo", "core = 2\npolicy = \"fifo:50\"\nprogram = \"p\"", LO);
    let run = "period = \"1 ms\"\ncost = \"900 us\"";
    let hi = part("hi", "core = 2\npolicy = \"fifo:90\"", run);
    let found = schedule(&[hosts, lo, hi], "");
    let [lo, hi] = &found.rows[..] else {
        panic!("{found:?}");
    };
    let expected = "`hi` may run before it: state the program of `hi`, and the host of that";
    assert_eq!(lo.advice.as_deref(), Some(expected));
    // The other one has the lower rank, wherever it is.
    assert_eq!(hi.verdict, Verdict::Holds);
    assert!(
        found
            .cores
            .iter()
            .all(|core| core.host.is_empty() || core.is_more)
    );
}

#[test]
fn a_measured_poll_does_not_replace_a_stated_cost() {
    let with = |costs| {
        let lo = part("lo", "core = 2\npolicy = \"fifo:50\"", LO);
        schedule(&[lo], costs).rows[0].longest_poll
    };
    let micros = |count| Some(Duration::from_micros(count));
    assert_eq!(with("lo = { longest_poll = \"10 us\" }"), micros(500));
    assert_eq!(with("lo = { longest_poll = \"600 us\" }"), micros(600));
    assert_eq!(with("lo = { cost = \"700 us\" }"), micros(700));
}

#[test]
fn a_wait_for_time_or_for_a_partner_is_one() {
    let part = |process: &str, more: &str| {
        let lo = part("lo", "core = 2\npolicy = \"fifo:50\"", LO);
        let lo = lo.replace("Works", process) + more;
        let others = "[system.channel]\nc = {}\n\
                      [system.part.other]\nprocess = \"Skips\"\nbind.a = \"c\"\n\
                      [system.part.sends]\nprocess = \"Sends\"\nbind.a = \"c\"\n";
        schedule(&[lo, others.to_owned()], "").rows[0].may_wait
    };
    assert!(part("Waits", ""));
    let bound = "[system.part.lo.bind]\na = \"c\"\n";
    assert!(part("Skips", bound));
    assert!(!part("Polls", bound));
}

#[test]
fn a_cycle_of_actions_is_one_poll_if_that_is_stated() {
    let with = |poll: &str| {
        let run = format!("{LO}\npriority = 5{poll}");
        let lo = part("lo", "core = 2\npolicy = \"fifo:50\"", &run);
        let hi = "[system.part.hi]\nprocess = \"Works\"\non = \"lo\"\npriority = 9\n\
                  period = \"600 us\"\ncost = \"200 us\"\n";
        let rows = schedule(&[lo, hi.to_owned()], "").rows;
        rows[0].bound
    };
    let micros = |count| Some(Duration::from_micros(count));
    assert_eq!(with("\nlongest_poll = \"500 us\""), micros(700));
    assert_eq!(with(""), micros(900));
}
