//! A `pre_run` that fails stops the start: no body runs, and what was prepared is cleaned up, last
//! first.

use crate::common;
use common::{Log, PLACEMENTS, SpawnOk, in_process, watchdog};
use luna::Error;
use luna::error::SetupError;
use luna::prelude::*;

#[derive(Clone, Copy, PartialEq, Eq)]
enum Preparing {
    Succeeds,
    Fails,
    Panics,
    SucceedsAndFailsToClean,
}

struct Prepared {
    name: &'static str,
    preparing: Preparing,
    log: Log,
}

impl Prepared {
    fn say(&self, phase: &str) {
        self.log.add(format!("{phase} {}", self.name));
    }
}

impl Process for Prepared {
    fn pre_run(&mut self) -> luna::Result<()> {
        self.say("pre");
        match self.preparing {
            Preparing::Fails => Err(Error::other("the sensor does not answer")),
            Preparing::Panics => panic!("the sensor answers {}", 42),
            _ => Ok(()),
        }
    }

    async fn run(&mut self) -> luna::Result<()> {
        self.say("run");
        Ok(())
    }

    fn post_run(&mut self) {
        self.say("post");
        assert!(
            self.preparing != Preparing::SucceedsAndFailsToClean,
            "in post_run, on purpose"
        );
    }
}

impl Drop for Prepared {
    fn drop(&mut self) {
        self.say("drop");
    }
}

/// Five processes. The second and the third are prepared as given; the third fails. Those before it
/// are cleaned up in the opposite order. Returns the error.
fn run_five(place: common::Placement, second: Preparing, third: Preparing) -> Error {
    let log = Log::default();
    let mut system = System::new("five");
    for (name, preparing) in [
        ("first", Preparing::Succeeds),
        ("second", second),
        ("third", third),
        ("fourth", Preparing::Succeeds),
        ("fifth", Preparing::Succeeds),
    ] {
        place.process(&mut system, name, name).spawn_ok(Prepared {
            name,
            preparing,
            log: log.clone(),
        });
    }
    let error = system.run().unwrap_err();
    // It has been started, so it is over.
    assert!(matches!(
        system.run(),
        Err(Error::Setup(SetupError::AlreadyRun { .. }))
    ));
    let late = system.executor("late").build();
    assert!(matches!(
        late,
        Err(Error::Setup(SetupError::AlreadyRun { .. }))
    ));
    drop(system);
    let (drops, phases): (Vec<_>, Vec<_>) = log
        .all()
        .into_iter()
        .partition(|event| event.starts_with("drop"));
    assert_eq!(drops.len(), 5, "{drops:?}");
    let expected = "pre first, pre second, pre third, post second, post first";
    assert_eq!(phases.join(", "), expected);
    error
}

#[test]
fn an_error_names_the_process_and_no_body_runs() {
    let _watch = watchdog();
    for place in PLACEMENTS {
        let error = run_five(place, Preparing::Succeeds, Preparing::Fails);
        let Error::Process { name, source } = &error else {
            panic!("{error:?}")
        };
        assert_eq!(name, "third");
        assert!(matches!(**source, Error::Other(_)), "{source:?}");
        assert_eq!(
            error.to_string(),
            "process `third`: the sensor does not answer"
        );
    }
}

#[test]
fn a_panic_is_such_an_error_with_its_message() {
    let _watch = watchdog();
    for place in PLACEMENTS {
        let error = run_five(place, Preparing::Succeeds, Preparing::Panics);
        let panicked = Error::Panicked("the sensor answers 42".to_owned());
        assert_eq!(error, in_process("third", panicked));
    }
}

#[test]
fn a_post_run_that_panics_on_the_way_does_not_keep_the_others_from_theirs() {
    let _watch = watchdog();
    for place in PLACEMENTS {
        let error = run_five(place, Preparing::SucceedsAndFailsToClean, Preparing::Fails);
        assert_eq!(
            error.to_string(),
            "process `third`: the sensor does not answer"
        );
    }
}

#[test]
fn emergency_functions_are_not_for_a_start_that_fails() {
    let _watch = watchdog();
    let log = Log::default();
    let mut system = System::new("not started");
    system.on_emergency("neutral", log.noter("emergency"));
    let executor = system.executor("control").build().unwrap();
    let process = Prepared {
        name: "only",
        preparing: Preparing::Panics,
        log: log.clone(),
    };
    executor.process("only").spawn_ok(process);
    system.run().unwrap_err();
    assert_eq!(log.all(), ["pre only", "drop only"]);
}
