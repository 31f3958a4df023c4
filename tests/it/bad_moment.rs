//! Right calls at the wrong moment: a second run, a run inside a process, a spawn after the end.

use crate::common;
use common::{PLACEMENTS, SpawnOk, watchdog};
use luna::error::SetupError;
use luna::prelude::*;
use luna::{Error, Exit};
use std::sync::Arc;

fn already_run(system: &str) -> Error {
    Error::Setup(SetupError::AlreadyRun {
        system: system.to_owned(),
    })
}

#[test]
fn a_second_run() {
    let _watch = watchdog();
    let mut system = System::new("once");
    let executor = system.executor("main").build().unwrap();
    executor.process("one").spawn_ok(async { Ok(()) });
    system.run().unwrap();
    let error = system.run().unwrap_err();
    assert_eq!(error, already_run("once"));
    assert!(
        error.to_string().contains("`once`") && error.to_string().contains("build another"),
        "{error}"
    );
}

#[test]
fn a_second_run_beside_the_first_does_not_disturb_it() {
    let _watch = watchdog();
    let mut system = System::new("once");
    let executor = system.executor("main").build().unwrap();
    let own = executor.clone();
    let (running, runs) = luna::channel();
    let (tried, has_tried) = luna::channel();
    executor.process("first").spawn_ok(async move {
        running.send(()).await?;
        has_tried.recv().await?;
        // The system still takes processes.
        own.process("second").spawn(async { Ok(()) })?;
        Ok(())
    });
    let system = Arc::new(system);
    let own = system.clone();
    let running = std::thread::spawn(move || own.run());
    runs.blocking_recv().unwrap();
    assert_eq!(system.run().unwrap_err(), already_run("once"));
    tried.blocking_send(()).unwrap();
    assert_eq!(running.join().unwrap().unwrap().processes.len(), 2);
}

#[test]
fn a_system_inside_a_process() {
    let _watch = watchdog();
    for place in PLACEMENTS {
        let inner = {
            let mut inner = System::new("inner");
            let executor = inner.executor("inner").build().unwrap();
            executor.process("inner").spawn_ok(async { Ok(()) });
            Arc::new(inner)
        };
        let own = inner.clone();
        let mut outer = System::new("outer");
        place
            .process(&mut outer, "outer", "outer")
            .spawn_ok(async move {
                let error = own.run().unwrap_err();
                assert_eq!(error, Error::Setup(SetupError::Nested));
                assert!(error.to_string().contains("inside a process"), "{error}");
                assert_eq!(
                    luna::run(async { Ok(()) }),
                    Err(Error::Setup(SetupError::Nested))
                );
                luna::yield_now().await;
                Ok(())
            });
        outer.run().unwrap();
        // The refused one is as it was.
        assert_eq!(
            inner.run().unwrap().processes[0].exit,
            Some(Exit::Completed),
            "{place:?}"
        );
    }
}

#[test]
fn a_system_inside_a_run() {
    let _watch = watchdog();
    let system = System::new("inner");
    let inside = luna::run(async { Ok(system.run().map(drop)) }).unwrap();
    assert_eq!(inside, Err(Error::Setup(SetupError::Nested)));
    system.run().unwrap();
}

#[test]
fn a_system_on_a_buddy_thread_of_a_process() {
    let _watch = watchdog();
    // A blocking call is no process, so a whole system may run in it.
    let report = luna::run(async {
        luna::blocking(|| {
            let mut inner = System::new("inner");
            inner
                .executor("inner")
                .build()?
                .process("one")
                .spawn(async { Ok(()) })?;
            inner.run()
        })
        .await
    });
    assert_eq!(report.unwrap().processes.len(), 1);
}

#[test]
fn a_spawn_after_the_end() {
    let _watch = watchdog();
    let mut system = System::new("over");
    let executor = system.executor("main").build().unwrap();
    let thread = system.thread("own").process("on a thread");
    system.run().unwrap();
    for late in [executor.process("on an executor"), thread] {
        let error = late.spawn(async { Ok(()) }).unwrap_err();
        let Error::Setup(SetupError::Ended { system, process }) = &error else {
            panic!("{error:?}")
        };
        assert_eq!(system, "over");
        assert!(
            error.to_string().contains("`over`") && error.to_string().contains(process.as_str()),
            "{error}"
        );
    }
}

#[test]
fn an_executor_after_the_start() {
    let _watch = watchdog();
    let mut system = System::new("over");
    system.run().unwrap();
    assert_eq!(
        system.executor("late").build().unwrap_err(),
        already_run("over")
    );
}

#[test]
fn a_tick_under_another_runtime_says_where_it_was_made() {
    let mut ticks = luna::ticks(std::time::Duration::from_secs(3600)).unwrap();
    let (tick, line) = (ticks.tick(), line!());
    let awaited = std::panic::AssertUnwindSafe(|| futures_lite::future::block_on(tick));
    let payload = std::panic::catch_unwind(awaited).unwrap_err();
    let message = payload.downcast_ref::<String>().unwrap();
    let expected = format!("a tick, a timer or a watchdog, made at {}:{line}:", file!());
    assert!(message.starts_with(&expected), "{message}");
}
