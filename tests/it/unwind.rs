//! A program that runs a system, or a part of one, under `catch_unwind` needs no
//! `AssertUnwindSafe`.

use crate::common;
use common::{SpawnOk, watchdog};
use luna::prelude::*;
use std::panic::{RefUnwindSafe, UnwindSafe, catch_unwind};
use std::time::Duration;

/// It can be taken into `catch_unwind` by value and by reference.
const fn both<T: UnwindSafe + RefUnwindSafe>() {}

const _: () = {
    both::<System>();
    both::<luna::Executor>();
    both::<luna::system::ExecutorBuilder>();
    both::<luna::system::Thread>();
    both::<luna::system::ProcessBuilder>();
    both::<luna::system::Observer>();
    both::<luna::process::ProcessHandle>();
    both::<luna::Report>();
    both::<luna::report::LoopReport>();
    both::<luna::Error>();
    both::<luna::error::SetupError>();
    both::<luna::Periodic>();
    both::<luna::Instant>();
    both::<Policy>();
    both::<Buffer>();
    both::<Barrier>();
    both::<Sender<std::cell::Cell<u8>>>();
    both::<Receiver<std::cell::Cell<u8>>>();
    both::<Signal<f64>>();
};

/// An error of a user's own can be compared, with ours in it.
#[derive(Debug, Clone, PartialEq, Eq)]
enum Own {
    Luna(luna::Error),
}

#[test]
fn errors_are_equal_to_themselves() {
    fn equal<T: Eq>(one: &T, other: &T) -> bool {
        one == other
    }
    let system = |text: &str| Own::Luna(luna::Error::System(text.to_owned()));
    assert!(equal(&system("no sensor"), &system("no sensor")));
    assert!(!equal(&system("no sensor"), &system("no drive")));
    let other = luna::Error::other("no sensor");
    assert!(equal(&other, &other.clone()));
    assert!(
        !equal(&other, &luna::Error::other("no sensor")),
        "what it holds may not be comparable"
    );
}

#[test]
fn an_error_about_the_system_is_its_text() {
    let result: luna::Result<()> =
        luna::run(async { Err(luna::Error::System("no sensor".to_owned())) });
    let error = result.unwrap_err();
    assert!(matches!(&error, luna::Error::System(text) if text == "no sensor"));
    assert_eq!(format!("{error} {error:?}"), "no sensor no sensor");
    assert!(!error.is_poisoned() && !error.is_closed());
    assert!(std::error::Error::source(&error).is_none());
}

#[test]
fn a_system_is_run_and_used_behind_a_panic() {
    let _watch = watchdog();
    let mut system = System::new("caught");
    let main = system.executor("main").build().unwrap();
    // A panic in the set-up leaves the system as it was.
    let refused = catch_unwind(|| {
        main.process("replaced")
            .replaceable((), |()| -> std::future::Ready<luna::Result<()>> {
                panic!("on purpose")
            })
    });
    assert!(refused.is_err());
    main.process("bad")
        .spawn_ok(async { panic!("on purpose, too") });
    main.process("looping").spawn_ok(async {
        let mut tick = luna::periodic("loop", Duration::from_millis(1))?;
        let before = tick.next().await.number;
        let caught = catch_unwind(|| {
            let _tick = &tick;
            panic!("in a cycle")
        });
        assert!(caught.is_err());
        assert!(tick.next().await.number > before);
        Ok(())
    });
    let error = catch_unwind(move || system.run()).unwrap().unwrap_err();
    assert_eq!(
        error.to_string(),
        "process `bad`: panicked: on purpose, too"
    );
}
