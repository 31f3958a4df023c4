//! Processes that are replaced by name, and the errors if a replacement does not fit.

use crate::common;
use common::{PLACEMENTS, SpawnOk, watchdog};
use luna::Error;
use luna::error::SetupError;
use luna::prelude::*;
use luna::system::ProcessBuilder;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::rc::Rc;
use std::time::Duration;

struct SensorEnds {
    values: Sender<u32>,
}

struct OtherEnds {
    #[expect(dead_code, reason = "makes the type differ from the other")]
    values: Sender<u32>,
}

/// A network of a sensor, which says 1, and a reader, which says what it read.
fn build(
    system: &mut System,
    place: common::Placement,
) -> luna::Result<std::sync::mpsc::Receiver<u32>> {
    let (values, read) = luna::channel();
    let (notify, notified) = std::sync::mpsc::channel();
    place
        .process(system, "sensors", "sensor")
        .priority(20)
        .replaceable(SensorEnds { values }, |ends| async move {
            ends.values.send(1).await?;
            Ok(())
        })?;
    system
        .executor("main")
        .build()?
        .process("reader")
        .spawn(async move {
            while let Ok(value) = read.recv().await {
                notify.send(value).unwrap();
            }
            Ok(())
        })?;
    Ok(notified)
}

fn setup(error: Error) -> SetupError {
    let Error::Setup(error) = error else {
        panic!("{error}")
    };
    error
}

#[test]
fn the_stand_in_runs_instead_with_its_ends() {
    let _watch = watchdog();
    for place in PLACEMENTS {
        let mut system = System::new("replaced");
        system
            .stand_in("sensor", |ends: SensorEnds| async move {
                ends.values.send(7).await?;
                ends.values.send(8).await?;
                Ok(())
            })
            .unwrap();
        let notified = build(&mut system, place).unwrap();
        let report = system.run().unwrap();
        assert_eq!(notified.iter().collect::<Vec<_>>(), [7, 8]);
        assert_eq!(report.stand_ins, ["sensor"]);
        assert!(report.to_string().contains("stand-ins for: sensor\n"));
        let names: Vec<_> = report.processes.iter().map(|one| &*one.name).collect();
        assert_eq!(names, ["sensor", "reader"]);
    }
}

#[test]
fn without_one_it_is_the_process_itself() {
    let _watch = watchdog();
    for place in PLACEMENTS {
        let mut system = System::new("itself");
        let notified = build(&mut system, place).unwrap();
        let report = system.run().unwrap();
        assert_eq!(notified.iter().collect::<Vec<_>>(), [1]);
        assert!(report.stand_ins.is_empty());
        assert!(!report.to_string().contains("stand-ins"));
    }
}

#[test]
fn all_that_can_be_spawned_can_stand_in() {
    struct Sensor(SensorEnds);

    impl Process for Sensor {
        async fn run(&mut self) -> luna::Result<()> {
            self.0.values.send(2).await?;
            Ok(())
        }
    }

    let _watch = watchdog();
    let place = PLACEMENTS[0];
    let mut system = System::new("a type");
    system.stand_in("sensor", Sensor).unwrap();
    let notified = build(&mut system, place).unwrap();
    system.run().unwrap();
    assert_eq!(notified.iter().collect::<Vec<_>>(), [2]);

    // A closure with a future that stays on its thread.
    let mut system = System::new("a closure");
    system
        .stand_in("sensor", |ends: SensorEnds| {
            move || async move {
                let value = Rc::new(3);
                ends.values.send(*value).await?;
                Ok(())
            }
        })
        .unwrap();
    let notified = build(&mut system, place).unwrap();
    system.run().unwrap();
    assert_eq!(notified.iter().collect::<Vec<_>>(), [3]);
}

#[test]
fn channels_that_do_not_fit_are_named_with_both_types() {
    let mut system = System::new("misfit");
    system
        .stand_in("sensor", |ends: OtherEnds| async move {
            drop(ends);
            Ok(())
        })
        .unwrap();
    let error = setup(build(&mut system, PLACEMENTS[0]).unwrap_err());
    let SetupError::StandInDoesNotFit {
        process,
        has,
        takes,
    } = &error
    else {
        panic!("{error}")
    };
    assert_eq!(process, "sensor");
    assert!(has.ends_with("SensorEnds") && takes.ends_with("OtherEnds"));
    let text = error.to_string();
    assert!(text.contains(has) && text.contains(takes), "{text}");

    // Ends that have no type of their own are compared as well.
    let mut system = System::new("tuples");
    system
        .stand_in("sensor", |_: (Sender<u32>, Receiver<f64>)| async { Ok(()) })
        .unwrap();
    let main = system.executor("main").build().unwrap();
    let ends = (luna::channel::<u32>().0, luna::channel::<f32>().1);
    let refused = main
        .process("sensor")
        .replaceable(ends, |_| async { Ok(()) });
    assert!(matches!(
        setup(refused.unwrap_err()),
        SetupError::StandInDoesNotFit { .. }
    ));
}

#[test]
fn a_name_that_nobody_declared_is_said_with_those_there_are() {
    let _watch = watchdog();
    let mut system = System::new("nobody");
    system
        .stand_in("sensr", |_: SensorEnds| async { Ok(()) })
        .unwrap();
    let notified = build(&mut system, PLACEMENTS[0]).unwrap();
    let error = system.run().unwrap_err();
    assert_eq!(
        error.to_string(),
        "there is a stand-in for process `sensr`, but no such process that can be replaced; there are [\"sensor\"]"
    );
    // Nothing has run.
    drop(system);
    assert_eq!(notified.iter().count(), 0);

    let mut system = System::new("none");
    system
        .stand_in("sensor", |_: SensorEnds| async { Ok(()) })
        .unwrap();
    let error = setup(system.run().unwrap_err());
    assert!(matches!(error, SetupError::NobodyToReplace { known, .. } if known.is_empty()));
}

#[test]
fn what_comes_too_late_twice_or_without_ends_is_refused() {
    let _watch = watchdog();
    let ready = |_: SensorEnds| async { Ok(()) };
    let mut system = System::new("late");
    let _told = build(&mut system, PLACEMENTS[0]).unwrap();
    let late = |system: &mut System| setup(system.stand_in("sensor", ready).unwrap_err());
    assert!(matches!(
        late(&mut system),
        SetupError::StandInTooLate { .. }
    ));
    system.run().unwrap();
    let error = setup(system.stand_in("other", ready).unwrap_err());
    assert!(matches!(error, SetupError::StandInTooLate { .. }));

    let mut system = System::new("twice");
    system.stand_in("sensor", ready).unwrap();
    let error = setup(system.stand_in("sensor", ready).unwrap_err());
    assert!(matches!(
        error,
        SetupError::DuplicateName {
            kind: "stand-in",
            ..
        }
    ));

    let main = system.executor("main").build().unwrap();
    let plain = main.process("sensor").spawn(async { Ok(()) });
    assert!(matches!(
        setup(plain.unwrap_err()),
        SetupError::NotReplaceable { .. }
    ));
}

#[test]
fn a_declaration_that_fails_does_not_use_up_the_stand_in() {
    type Attempt = fn(ProcessBuilder) -> ProcessBuilder;
    let _watch = watchdog();
    let attempts: [Attempt; 2] = [
        |process| process.priority(32),
        |process| process.poll_budget(Duration::ZERO),
    ];
    for attempt in attempts {
        let mut system = System::new("again");
        system
            .stand_in("sensor", |ends: SensorEnds| async move {
                ends.values.send(7).await?;
                Ok(())
            })
            .unwrap();
        let wrong = system.executor("wrong").build().unwrap();
        let values = luna::channel().0;
        attempt(wrong.process("sensor"))
            .replaceable(SensorEnds { values }, |_| async { Ok(()) })
            .unwrap_err();
        let refused = system.thread("sensors").stack_size(1).process("sensor");
        let values = luna::channel().0;
        refused
            .replaceable(SensorEnds { values }, |_| async { Ok(()) })
            .unwrap_err();
        let notified = build(&mut system, PLACEMENTS[0]).unwrap();
        let report = system.run().unwrap();
        assert_eq!(notified.iter().collect::<Vec<_>>(), [7]);
        assert_eq!(report.stand_ins, ["sensor"]);
    }
}

#[test]
fn a_name_that_is_taken_leaves_the_stand_in_and_the_declaration_as_they_were() {
    let _watch = watchdog();
    let duplicate = |error| {
        let error = setup(error);
        assert!(
            matches!(error, SetupError::DuplicateName { .. }),
            "{error:?}"
        );
    };
    // A plain process has the name: nothing is replaced, and the error says so.
    let mut system = System::new("taken");
    let main = system.executor("plain").build().unwrap();
    main.process("sensor").spawn_ok(async { Ok(()) });
    system
        .stand_in("sensor", |_: SensorEnds| async { Ok(()) })
        .unwrap();
    duplicate(build(&mut system, PLACEMENTS[0]).unwrap_err());
    let error = setup(system.run().unwrap_err());
    assert!(matches!(error, SetupError::NobodyToReplace { .. }));

    // One that is replaced has it: it still is.
    let mut system = System::new("twice");
    system
        .stand_in("sensor", |ends: SensorEnds| async move {
            ends.values.send(7).await?;
            Ok(())
        })
        .unwrap();
    let notified = build(&mut system, PLACEMENTS[0]).unwrap();
    let other = system.executor("other").build().unwrap();
    let values = luna::channel().0;
    let again = other
        .process("sensor")
        .replaceable(SensorEnds { values }, |_| async { Ok(()) });
    duplicate(again.unwrap_err());
    assert_eq!(system.run().unwrap().stand_ins, ["sensor"]);
    assert_eq!(notified.iter().collect::<Vec<_>>(), [7]);
}

#[test]
fn a_stand_in_that_panics_while_it_is_made_is_not_followed_by_the_process_itself() {
    let _watch = watchdog();
    let mut system = System::new("panics");
    system
        .stand_in(
            "sensor",
            |_: SensorEnds| -> std::future::Ready<luna::Result<()>> { panic!("as it is made") },
        )
        .unwrap();
    let main = system.executor("main").build().unwrap();
    let declare = || {
        let values = luna::channel().0;
        main.process("sensor")
            .replaceable(SensorEnds { values }, |_| async { Ok(()) })
    };
    assert!(catch_unwind(AssertUnwindSafe(declare)).is_err());
    assert!(matches!(
        setup(declare().unwrap_err()),
        SetupError::DuplicateName { .. }
    ));
}

#[test]
fn one_that_is_declared_while_the_system_runs_is_itself() {
    let _watch = watchdog();
    let mut system = System::new("while it runs");
    let main = system.executor("main").build().unwrap();
    let (values, read) = luna::channel();
    let own = main.clone();
    main.process("first").spawn_ok(async move {
        own.process("sensor")
            .replaceable(SensorEnds { values }, |ends| async move {
                ends.values.send(5).await?;
                Ok(())
            })?;
        assert_eq!(read.recv().await?, 5);
        Ok(())
    });
    system.run().unwrap();
}
