//! Bad input: each is a typed error that names the value and says what to do.

use crate::common;
use common::{COMPLETE, PLACEMENTS, SpawnOk, setup_error, skip};
use luna::Error;
use luna::error::SetupError;
use luna::prelude::*;
use luna_platform::thread::{AttributeError, PolicyError};

fn has_one_core() -> bool {
    let online = std::fs::read_to_string("/sys/devices/system/cpu/online");
    online.is_ok_and(|cores| !cores.contains(['-', ',']))
}

#[test]
fn a_core_that_does_not_exist() {
    if !COMPLETE {
        return skip("the portable layer does not know the cores");
    }
    if has_one_core() {
        return skip("a machine with one core refuses none");
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
    for place in PLACEMENTS {
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
                .spawn_ok(async { Ok(()) });
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
        .spawn_ok(async { Ok(()) });

    // Executors and threads share one list of names.
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
    left.process("drive").spawn_ok(async { Ok(()) });
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
    // What was refused has taken neither name.
    system.executor("other").build().unwrap();
    let taken = system.thread("own").process("fan");
    setup_error(taken.spawn(async { Ok(()) }), &["`own`"]);
    left.process("fan").spawn_ok(async { Ok(()) });

    // What is refused leaves nothing behind.
    left.process("left").spawn_ok(async { Ok(()) });
    let names: Vec<_> = system
        .run()
        .unwrap()
        .processes
        .into_iter()
        .map(|process| process.name)
        .collect();
    assert_eq!(names, ["of own", "drive", "fan", "left"]);
}

#[test]
fn a_buffer_without_room() {
    let error = setup_error(
        luna::channel::try_buffered::<u8>(Buffer::fifo(0)).map_err(Error::from),
        &["capacity 0", "channel()"],
    );
    assert!(matches!(error, SetupError::System { .. }));
}
