//! Bad input: a typed error each, whose message names the value and says what to do.

mod common;

use common::{COMPLETE, PLACES, skip, watchdog};
use luna::prelude::*;
use luna::{Error, SetupError};
use luna_platform::thread::{AttributeError, PolicyError};
use std::time::Duration;

/// The set-up error, after a look at its message.
#[track_caller]
fn setup_error<T: std::fmt::Debug>(outcome: luna::Result<T>, parts: &[&str]) -> SetupError {
    let error = match outcome.unwrap_err() {
        Error::Process { source, .. } => *source,
        error => error,
    };
    let text = error.to_string();
    for part in parts {
        assert!(text.contains(part), "`{part}` is not in: {text}");
    }
    match error {
        Error::Setup(error) => error,
        other => panic!("expected a set-up error, got {other:?}"),
    }
}

/// What a process gets that does nothing but what `body` says.
fn in_a_process<T: Send + 'static>(body: impl AsyncFnOnce() -> T + Send + 'static) -> T {
    let (sender, receiver) = luna::buffered(Buffer::fifo(1));
    let mut system = System::new("around one");
    let executor = system.executor("main").build().unwrap();
    executor
        .process("one")
        .spawn(move || async move {
            let value = body().await;
            sender.try_send(value)?;
            Ok(())
        })
        .unwrap();
    system.run().unwrap();
    receiver.try_recv().unwrap()
}

#[test]
fn a_core_that_does_not_exist() {
    if !COMPLETE {
        return skip("the portable layer does not know the cores");
    }
    let mut system = System::new("wrong");
    for core in [4096, usize::MAX] {
        let of_executor = system.executor("control").core(core).build();
        let of_thread = system
            .thread("console")
            .core(core)
            .process("operator")
            .spawn(async { Ok(()) });
        for (outcome, name) in [
            (of_executor.map(drop), "control"),
            (of_thread.map(drop), "console"),
        ] {
            let error = setup_error(
                outcome,
                &[&format!("core {core}"), name, "choose one of [0"],
            );
            let SetupError::NoSuchCore {
                of,
                core: named,
                available,
            } = error
            else {
                panic!("{error:?}")
            };
            assert_eq!((of.as_str(), named), (name, core));
            assert!(available.contains(&0));
        }
    }
}

#[test]
fn a_priority_out_of_range() {
    let mut system = System::new("wrong");
    for priority in [0, 98, 99, 100, 200, 255] {
        for policy in [Policy::fifo(priority), Policy::round_robin(priority)] {
            let of_executor = system.executor("place").policy(policy).build().map(drop);
            let of_thread = system
                .thread("place")
                .policy(policy)
                .process("one")
                .spawn(async { Ok(()) })
                .map(drop);
            for outcome in [of_executor, of_thread] {
                let error = setup_error(
                    outcome,
                    &["`place`", &policy.to_string(), "1 (lowest) to 97"],
                );
                let SetupError::Attributes(AttributeError::Policy { name, error }) = error else {
                    panic!("{error:?}")
                };
                assert_eq!(name, "place");
                assert_eq!(
                    error,
                    PolicyError::OutOfRange {
                        policy,
                        highest: 97
                    }
                );
            }
        }
    }
    for (name, priority) in [("lowest", 1), ("highest", 97)] {
        system
            .executor(name)
            .policy(Policy::fifo(priority))
            .build()
            .unwrap();
    }
}

#[test]
fn a_level_out_of_range() {
    for place in PLACES {
        let mut system = System::new("wrong");
        for (number, level) in [32, 255].into_iter().enumerate() {
            let process = place
                .process(&mut system, &format!("place {number}"), "drive")
                .priority(level);
            let error = setup_error(
                process.spawn(async { Ok(()) }),
                &["`drive`", &level.to_string(), "to 31"],
            );
            assert_eq!(
                error,
                SetupError::Level {
                    process: "drive".to_owned(),
                    level
                }
            );
        }
        for (name, level) in [("lowest", 0), ("highest", 31)] {
            place
                .process(&mut system, name, name)
                .priority(level)
                .spawn(async { Ok(()) })
                .unwrap();
        }
        assert_eq!(
            system.run().unwrap().processes.len(),
            2,
            "the refused ones are not there"
        );
    }
}

#[test]
fn a_stack_too_small_or_too_large() {
    let mut system = System::new("wrong");
    for (bytes, complaint) in [
        (0, "too small"),
        (128 * 1024 - 1, "too small"),
        (usize::MAX, "too large"),
    ] {
        let of_executor = system.executor("place").stack_size(bytes).build().map(drop);
        let of_thread = system
            .thread("place")
            .stack_size(bytes)
            .process("one")
            .spawn(async { Ok(()) })
            .map(drop);
        for outcome in [of_executor, of_thread] {
            let error = setup_error(outcome, &["`place`", &bytes.to_string(), complaint]);
            let asked = match error {
                SetupError::Attributes(AttributeError::StackTooSmall { asked, .. })
                    if complaint == "too small" =>
                {
                    asked
                }
                SetupError::Attributes(AttributeError::StackTooLarge { asked, .. })
                    if complaint == "too large" =>
                {
                    asked
                }
                other => panic!("{other:?}"),
            };
            assert_eq!(asked, bytes);
        }
    }
    system
        .executor("place")
        .stack_size(128 * 1024)
        .build()
        .unwrap();
}

#[test]
fn a_name_with_a_zero_byte() {
    let mut system = System::new("wrong");
    let error = setup_error(
        system.executor("con\0trol").build(),
        &[r"con\0trol", "zero byte"],
    );
    assert!(
        matches!(
            error,
            SetupError::Attributes(AttributeError::ZeroInName { .. })
        ),
        "{error:?}"
    );
}

#[test]
fn two_of_one_name() {
    let duplicate = |kind, name: &str| SetupError::DuplicateName {
        kind,
        name: name.to_owned(),
    };
    let mut system = System::new("twins");
    let left = system.executor("left").build().unwrap();
    let right = system.executor("right").build().unwrap();
    system
        .thread("own")
        .process("of own")
        .spawn(async { Ok(()) })
        .unwrap();

    // Executors and threads are told apart by one list of names.
    for name in ["left", "own"] {
        let error = setup_error(
            system.executor(name).build(),
            &["executor", &format!("`{name}`"), "already"],
        );
        assert_eq!(error, duplicate("executor", name));
        let error = setup_error(
            system.thread(name).process("x").spawn(async { Ok(()) }),
            &[&format!("`{name}`")],
        );
        assert_eq!(error, duplicate("executor", name));
    }

    // Processes of all places by another.
    left.process("drive").spawn(async { Ok(()) }).unwrap();
    for again in [
        left.process("drive"),
        right.process("drive"),
        system.thread("other").process("drive"),
    ] {
        let error = setup_error(
            again.spawn(async { Ok(()) }),
            &["process `drive`", "already"],
        );
        assert_eq!(error, duplicate("process", "drive"));
    }

    // What is refused leaves nothing behind.
    left.process("left").spawn(async { Ok(()) }).unwrap();
    let names: Vec<_> = system
        .run()
        .unwrap()
        .processes
        .into_iter()
        .map(|process| process.name)
        .collect();
    assert_eq!(names, ["of own", "drive", "left"]);
}

#[test]
fn two_loops_of_one_name() {
    let _watch = watchdog();
    let period = Duration::from_millis(1);
    let (first_is_there, second_may) = luna::channel();
    let (ended, end) = luna::channel::<()>();
    let mut system = System::new("twins");
    let left = system.executor("left").build().unwrap();
    let right = system.executor("right").build().unwrap();
    left.process("first")
        .spawn(async move {
            let _tick = luna::periodic("loop", period)?;
            let of_same_process =
                setup_error(luna::periodic("loop", period), &["loop `loop`", "already"]);
            assert_eq!(
                of_same_process,
                SetupError::DuplicateName {
                    kind: "loop",
                    name: "loop".to_owned()
                }
            );
            first_is_there.send(()).await?;
            end.recv().await?;
            Ok(())
        })
        .unwrap();
    right
        .process("second")
        .spawn(async move {
            second_may.recv().await?;
            let of_other = setup_error(luna::periodic("loop", period), &["loop `loop`"]);
            assert_eq!(
                of_other,
                SetupError::DuplicateName {
                    kind: "loop",
                    name: "loop".to_owned()
                }
            );
            ended.send(()).await?;
            // Its statistics are in the report under this name, so it stays taken when the loop has ended.
            luna::periodic("other", period).map(drop)?;
            assert!(luna::periodic("other", period).is_err());
            Ok(())
        })
        .unwrap();
    let report = system.run().unwrap();
    assert_eq!(report.loops.keys().collect::<Vec<_>>(), ["loop", "other"]);
}

#[test]
fn a_period_of_zero_or_too_long() {
    let _watch = watchdog();
    in_a_process(async || {
        let error = setup_error(
            luna::periodic("drive", Duration::ZERO),
            &["`drive`", "period of 0", "at least 1 ns"],
        );
        assert_eq!(
            error,
            SetupError::ZeroPeriod {
                name: "drive".to_owned()
            }
        );
        for period in [Duration::from_nanos(i64::MAX as u64 + 1), Duration::MAX] {
            let error = setup_error(luna::periodic("drive", period), &["`drive`", "292 years"]);
            assert_eq!(
                error,
                SetupError::PeriodTooLong {
                    name: "drive".to_owned(),
                    period
                }
            );
        }
        // What was refused has taken neither the name nor the room.
        luna::periodic("drive", Duration::from_nanos(i64::MAX as u64)).unwrap();
        luna::periodic("shortest", Duration::from_nanos(1))
            .unwrap()
            .next()
            .await;
    });
}

#[test]
fn a_loops_name_too_long() {
    let _watch = watchdog();
    in_a_process(async || {
        let period = Duration::from_millis(1);
        for name in ["x".repeat(64), "ä".repeat(32)] {
            let error = setup_error(
                luna::periodic(&name, period),
                &[&name, "64 bytes", "at most 63"],
            );
            assert_eq!(error, SetupError::NameTooLong { name, most: 63 });
        }
        luna::periodic(&"x".repeat(63), period).unwrap();
        luna::periodic("", period).unwrap();
    });
}

#[test]
fn more_loops_than_room_was_set_aside_for() {
    let _watch = watchdog();
    let mut system = System::new("many");
    system.max_loops(2);
    let executor = system.executor("main").build().unwrap();
    executor
        .process("one")
        .spawn(async {
            let _first = luna::periodic("first", Duration::from_millis(1))?;
            drop(luna::periodic("second", Duration::from_millis(1))?);
            luna::periodic("third", Duration::from_millis(1)).map(drop)
        })
        .unwrap();
    let error = setup_error(system.run(), &["`third`", "the 2 ", "System::max_loops"]);
    assert_eq!(
        error,
        SetupError::TooManyLoops {
            name: "third".to_owned(),
            most: 2
        }
    );
}

#[test]
fn room_for_loops_when_none_was_asked_for() {
    let _watch = watchdog();
    in_a_process(async || {
        // One for the only process, and four more.
        let make = |number: usize| luna::periodic(&number.to_string(), Duration::from_millis(1));
        let _loops: Vec<_> = (0..5).map(|number| make(number).unwrap()).collect();
        assert!(matches!(
            make(5),
            Err(Error::Setup(SetupError::TooManyLoops { most: 5, .. }))
        ));
    });
}

#[test]
fn a_loop_outside_of_any_process() {
    let error = setup_error(
        luna::periodic("lost", Duration::from_millis(1)),
        &["`lost`", "luna::run"],
    );
    assert_eq!(
        error,
        SetupError::NoProcess {
            name: "lost".to_owned()
        }
    );
    luna::run(async { luna::periodic("found", Duration::from_millis(1)).map(drop) }).unwrap();
    assert!(luna::periodic("lost again", Duration::from_millis(1)).is_err());
}

#[test]
fn a_buffer_without_room() {
    let error = setup_error(
        luna::try_buffered::<u8>(Buffer::fifo(0)).map_err(Error::from),
        &["capacity 0", "channel()"],
    );
    assert!(matches!(error, SetupError::System { .. }));
}
