//! Loops that cannot be: a typed error each, and nothing taken by what was refused.

use crate::common::{SpawnOk, setup_error, watchdog};
use luna::Error;
use luna::error::SetupError;
use luna::prelude::*;
use std::time::Duration;

/// What a process gets that does nothing but what `body` says.
fn in_a_process<T: Send + 'static>(body: impl AsyncFnOnce() -> T + Send + 'static) -> T {
    let (sender, receiver) = luna::buffered(Buffer::fifo(1));
    let mut system = super::system("around one");
    let executor = system.executor("main").build().unwrap();
    executor.process("one").spawn_ok(move || async move {
        let value = body().await;
        sender.try_send(value)?;
        Ok(())
    });
    system.run().unwrap();
    receiver.try_recv().unwrap()
}

#[test]
fn two_loops_of_one_name() {
    let _watch = watchdog();
    let period = Duration::from_millis(1);
    let (first_is_there, second_may) = luna::channel();
    let (ended, end) = luna::channel::<()>();
    let mut system = super::system("twins");
    let left = system.executor("left").build().unwrap();
    let right = system.executor("right").build().unwrap();
    left.process("first").spawn_ok(async move {
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
    });
    right.process("second").spawn_ok(async move {
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
        // Its statistics are in the report under this name, so the name stays taken when the
        // loop has ended.
        luna::periodic("other", period).map(drop)?;
        assert!(luna::periodic("other", period).is_err());
        Ok(())
    });
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
        luna::periodic("x".repeat(63), period).unwrap();
        luna::periodic("", period).unwrap();
    });
}

#[test]
fn more_loops_than_room_was_set_aside_for() {
    let _watch = watchdog();
    let mut system = super::system("many");
    system.max_loops(2);
    let executor = system.executor("main").build().unwrap();
    executor.process("one").spawn_ok(async {
        let _first = luna::periodic("first", Duration::from_millis(1))?;
        drop(luna::periodic("second", Duration::from_millis(1))?);
        luna::periodic("third", Duration::from_millis(1)).map(drop)
    });
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
fn room_for_loops_is_one_reserve_of_the_system() {
    let _watch = watchdog();
    for processes in [1, 100] {
        let mut system = super::system("reserve");
        let executor = system.executor("main").build().unwrap();
        for number in 1..processes {
            executor
                .process(number.to_string())
                .spawn_ok(async { Ok(()) });
        }
        executor.process("loops").spawn_ok(async {
            let make =
                |number: usize| luna::periodic(format!("loop {number}"), Duration::from_millis(1));
            let mut first = make(0)?;
            let _others: Vec<_> = (1..10).map(|number| make(number).unwrap()).collect();
            // Those that have ended count.
            (10..16).for_each(|number| drop(make(number).unwrap()));
            let name = "loop 16".to_owned();
            assert_eq!(
                make(16).err(),
                Some(Error::Setup(SetupError::TooManyLoops { name, most: 16 }))
            );
            // The loops that there are go on.
            first.next().await;
            Ok(())
        });
        let loops = system.run().unwrap().loops;
        assert_eq!((loops.len(), loops["loop 0"].cycles), (16, 1));
    }
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
