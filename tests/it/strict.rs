//! What the system refuses: an error in a strict system; a best-effort system goes without.

#![cfg(unix)]

use crate::common;
use common::{COMPLETE, Ended, SpawnOk, as_plain_user, has_real_time, skip, watchdog};
use luna::Error;
use luna::error::SetupError;
use luna::prelude::*;
use luna::report::Shortfall;

/// Says its phases.
struct Narrator(&'static str);

impl Process for Narrator {
    fn pre_run(&mut self) -> luna::Result<()> {
        println!("pre {}", self.0);
        Ok(())
    }

    async fn run(&mut self) -> luna::Result<()> {
        println!("run {}", self.0);
        Ok(())
    }

    fn post_run(&mut self) {
        println!("post {}", self.0);
    }
}

/// An error that names the policy, the reason and the remedy.
fn assert_refused(outcome: luna::Result<luna::Report>, by: &str, policy: Policy) {
    let error = outcome.unwrap_err();
    let text = error.to_string();
    let Error::Setup(SetupError::Refused { of, shortfall }) = &error else {
        panic!("{error:?}")
    };
    assert_eq!(of, by);
    assert!(
        matches!(shortfall, Shortfall::Policy { asked, .. } if *asked == policy),
        "{shortfall:?}"
    );
    assert_eq!(
        text,
        format!(
            "strict: {by}: no policy {policy}: {}; {}",
            shortfall.why(),
            shortfall.remedy()
        )
    );
    if COMPLETE {
        let remedies = ["setcap", "limits.d", "namespace", "cgroup"];
        assert!(
            remedies
                .iter()
                .any(|remedy| shortfall.remedy().contains(remedy)),
            "{text}"
        );
    } else {
        assert!(shortfall.why().contains("portable"), "{text}");
    }
}

/// What a plain user's program runs; nothing when this program runs it as a test.
#[test]
fn part() {
    let Some(part) = common::part() else { return };
    let _watch = watchdog();
    let mut system = System::new("limited");
    match part.as_str() {
        "strict executor" => {
            system.strict();
            let control = system
                .executor("control")
                .policy(Policy::fifo(80))
                .build()
                .unwrap();
            control.process("one").spawn_ok(Narrator("one"));
            assert_refused(system.run(), "control", Policy::fifo(80));
        }
        "strict thread" => {
            system.strict();
            let main = system.executor("main").build().unwrap();
            main.process("first").spawn_ok(Narrator("first"));
            system
                .thread("calm")
                .process("second")
                .spawn_ok(Narrator("second"));
            let urgent = system.thread("urgent").policy(Policy::round_robin(7));
            urgent.process("third").spawn_ok(Narrator("third"));
            main.process("fourth").spawn_ok(Narrator("fourth"));
            assert_refused(system.run(), "third", Policy::round_robin(7));
        }
        "strict while running" => {
            system.strict();
            let late = system
                .thread("late")
                .policy(Policy::fifo(7))
                .process("late");
            let main = system.executor("main").build().unwrap();
            let spawning = async {
                let Err(Error::Setup(SetupError::Refused { of, .. })) =
                    late.spawn(Narrator("late"))
                else {
                    panic!("it was started")
                };
                assert_eq!(of, "late");
                Ok(())
            };
            main.process("spawning").spawn_ok(spawning);
            system.run().unwrap();
        }
        "strict memory" => {
            system.strict().lock_memory();
            let main = system.executor("main").build().unwrap();
            main.process("one").spawn_ok(Narrator("one"));
            match system.run() {
                Err(Error::Setup(SetupError::Refused {
                    of,
                    shortfall: Shortfall::MemoryLock(_),
                })) => {
                    assert_eq!(of, "system");
                    println!("refused");
                }
                // A plain user may have an unlimited limit.
                other => assert!(other.unwrap().shortfalls.is_empty()),
            }
        }
        "best effort" => {
            system.lock_memory();
            let control = system
                .executor("control")
                .core(0)
                .policy(Policy::fifo(80))
                .build()
                .unwrap();
            control.process("one").spawn_ok(Narrator("one"));
            let console = system.thread("console").policy(Policy::fifo(10));
            console.process("two").spawn_ok(Narrator("two"));
            let report = system.run().unwrap();
            assert!(
                report
                    .threads
                    .iter()
                    .all(|thread| thread.policy == Policy::Other),
                "{report}"
            );
            for (who, policy) in [("control", "policy fifo:80"), ("console", "policy fifo:10")] {
                let missing =
                    |(of, shortfall): (&str, &Shortfall)| of == who && shortfall.what() == policy;
                assert!(report.all_shortfalls().any(missing), "{report}");
            }
            println!("missing {}", report.all_shortfalls().count());
            print!("{report}");
        }
        other => panic!("no part {other}"),
    }
    println!("done");
}

#[track_caller]
fn assert_done(ended: &Ended) {
    assert!(
        ended.status.success() && ended.said(&["done"]).len() == 1,
        "{ended:?}"
    );
}

const PHASES: [&str; 14] = [
    "pre first",
    "pre second",
    "pre third",
    "pre fourth",
    "pre one",
    "pre two",
    "post first",
    "post second",
    "post third",
    "post fourth",
    "post one",
    "post two",
    "run one",
    "run two",
];

#[test]
fn an_executor_is_refused_before_anything_is_prepared() {
    let Some(ended) = as_plain_user("strict executor") else {
        return;
    };
    assert_done(&ended);
    assert_eq!(ended.said(&PHASES), [""; 0], "{ended:?}");
}

#[test]
fn a_thread_is_refused_and_all_that_was_prepared_is_cleaned_up_last_first() {
    let Some(ended) = as_plain_user("strict thread") else {
        return;
    };
    assert_done(&ended);
    let phases = ["pre first", "pre second", "pre third", "pre fourth"].into_iter();
    let phases = phases.chain(["post fourth", "post third", "post second", "post first"]);
    assert_eq!(ended.said(&PHASES), phases.collect::<Vec<_>>(), "{ended:?}");
    assert!(
        !ended.output.contains("run first") && !ended.output.contains("run second"),
        "{ended:?}"
    );
}

#[test]
fn a_thread_that_is_added_while_the_system_runs_is_refused_too() {
    let Some(ended) = as_plain_user("strict while running") else {
        return;
    };
    assert_done(&ended);
    assert!(
        ended.output.contains("pre late") && ended.output.contains("post late"),
        "{ended:?}"
    );
    assert!(!ended.output.contains("run late"), "{ended:?}");
}

#[test]
fn locked_memory_is_refused() {
    let Some(ended) = as_plain_user("strict memory") else {
        return;
    };
    assert_done(&ended);
    if ended.said(&["refused"]).is_empty() {
        return skip("this user may lock memory");
    }
    assert_eq!(ended.said(&PHASES), [""; 0], "{ended:?}");
}

#[test]
fn best_effort_runs_without_and_says_so_in_one_line() {
    let Some(ended) = as_plain_user("best effort") else {
        return;
    };
    assert_done(&ended);
    let mut said = ended.said(&["run one", "run two"]);
    said.sort_unstable();
    assert_eq!(said, ["run one", "run two"], "{ended:?}");
    if cfg!(all(target_os = "linux", not(luna_portable))) {
        let lines: Vec<_> = ended
            .errors
            .lines()
            .filter(|line| line.starts_with("luna:") && line.contains("setcap"))
            .collect();
        let [line] = lines[..] else {
            panic!("one line, not {lines:?}")
        };
        assert!(
            line.chars().count() <= 200 && line.contains("real-time policies"),
            "{line}"
        );
    } else {
        skip("the line: no privilege gives what the platform has not");
    }
    // All of them are in the report, with their threads, values and reasons.
    let reported = ended
        .output
        .lines()
        .filter(|line| line.trim_start().starts_with("best effort:"))
        .count();
    assert_eq!(
        ended.said(&[&format!("missing {reported}")]).len(),
        1,
        "{ended:?}"
    );
}

#[test]
fn a_strict_system_that_gets_everything_runs() {
    let _watch = watchdog();
    let mut system = System::new("strict");
    system.strict();
    let executor = system.executor("main").build().unwrap();
    executor.process("one").spawn_ok(async { Ok(()) });
    assert_eq!(
        system.run().unwrap().all_shortfalls().count(),
        0,
        "nothing was asked for"
    );

    if !has_real_time() {
        return skip("with policies: no privilege");
    }
    let mut system = System::new("strict");
    system.strict();
    let executor = system
        .executor("control")
        .core(0)
        .policy(Policy::fifo(50))
        .build()
        .unwrap();
    executor.process("one").spawn_ok(async { Ok(()) });
    let urgent = system.thread("urgent").policy(Policy::round_robin(49));
    urgent.process("two").spawn_ok(async { Ok(()) });
    let report = system.run().unwrap();
    let policies: Vec<_> = report.threads.iter().map(|thread| thread.policy).collect();
    assert_eq!(policies, [Policy::fifo(50), Policy::round_robin(49)]);
    assert!(
        report
            .threads
            .iter()
            .all(|thread| thread.shortfalls.is_empty()),
        "{report}"
    );
}
