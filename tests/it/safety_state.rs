//! The safety state: what is latched, which process reported it, and how it is left.

use crate::common;
use common::{SpawnOk, watchdog};
use luna::prelude::*;
use luna::safety::{Cause, Degree, ResetError};
use luna::{End, Error};
use std::future::Future;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, mpsc};
use std::time::Duration;

fn why(text: &str) -> Error {
    Error::other(text)
}

#[test]
fn it_only_gets_worse_until_it_is_reset() {
    let _watch = watchdog();
    let system = System::new("state");
    let safety = system.safety();
    assert_eq!(
        (safety.degree(), safety.state().latched),
        (Degree::Normal, None)
    );
    safety.warn(why("warm"));
    safety.warn(why("warmer"));
    assert_eq!(safety.state().to_string(), "warning: warm");
    assert!(!safety.is_safe_state());
    safety.enter_safe_state(why("hot"));
    safety.warn(why("still warm"));
    assert!(safety.is_safe_state());
    let state = safety.state();
    assert_eq!(state.to_string(), "safe state: hot");
    let said: Vec<_> = state.events.iter().map(ToString::to_string).collect();
    assert_eq!(
        said,
        [
            "warning: warm",
            "warning: warmer",
            "safe state: hot",
            "warning: still warm"
        ]
    );
    safety.reset(why("cool")).unwrap();
    let state = safety.state();
    assert_eq!((state.degree, state.latched), (Degree::Normal, None));
    assert!(matches!(
        state.events.last().unwrap().cause,
        Cause::Reset(_)
    ));
    // The next one is latched anew.
    safety.warn(why("warm again"));
    assert_eq!(safety.state().to_string(), "warning: warm again");
}

#[test]
fn an_emergency_is_not_reset() {
    let _watch = watchdog();
    let mut system = System::new("emergency");
    let safety = system.safety();
    let main = system.executor("main").build().unwrap();
    main.process("raiser").spawn_ok(async {
        let safety = luna::safety::current().unwrap();
        safety.enter_safe_state(why("first"));
        Err(luna::emergency(why("then")))
    });
    system.run().unwrap_err();
    assert_eq!(safety.reset(why("please")), Err(ResetError::Emergency));
    let state = safety.state();
    assert_eq!(state.to_string(), "emergency: then, by process `raiser`");
    assert_eq!(state.events.len(), 2);
}

#[test]
fn the_cause_and_the_process_of_each_kind() {
    let _watch = watchdog();
    let mut system = System::new("panic");
    let main = system.executor("main").build().unwrap();
    main.process("culprit")
        .spawn_ok(async { panic!("on purpose") });
    system.run().unwrap_err();
    let latched = system.safety().state().latched.unwrap();
    assert_eq!(
        (latched.cause, latched.who.as_deref()),
        (Cause::Panic, Some("culprit"))
    );

    let mut system = System::new("overrun");
    let main = system.executor("main").build().unwrap();
    main.process("hog")
        .poll_budget(Duration::from_nanos(1))
        .on_overrun(luna::safety::OnOverrun::Emergency)
        .spawn_ok(std::future::pending::<luna::Result<()>>());
    system.run().unwrap_err();
    let latched = system.safety().state().latched.unwrap();
    assert_eq!(
        (latched.cause, latched.degree),
        (Cause::Overrun, Degree::Emergency)
    );

    let mut system = System::new("deadlock");
    system.strict();
    let (sender, receiver) = luna::channel::<()>();
    let main = system.executor("main").build().unwrap();
    main.process("waiting").spawn_ok(async move {
        let _kept = sender;
        Ok(receiver.recv().await?)
    });
    system.run().unwrap_err();
    let latched = system.safety().state().latched.unwrap();
    assert_eq!(latched.cause, Cause::Deadlock);
}

#[test]
fn in_the_safe_state_all_goes_on() {
    let _watch = watchdog();
    let entered = Arc::new(AtomicUsize::new(0));
    let own = entered.clone();
    let mut system = System::new("safe");
    let (ran, has_run) = mpsc::channel();
    system.on_safe_state("count", move || {
        own.fetch_add(1, Ordering::SeqCst);
        ran.send(()).unwrap();
    });
    let emergencies = entered.clone();
    system.on_emergency("never", move || {
        emergencies.fetch_add(1000, Ordering::SeqCst);
    });
    system
        .thread("own")
        .process("controller")
        .spawn_ok(async move {
            let safety = luna::safety::current().unwrap();
            for round in 1..=3 {
                safety.enter_safe_state(why("no set-points"));
                safety.enter_safe_state(why("no set-points yet"));
                has_run.recv().unwrap();
                assert!(safety.is_safe_state());
                // It has been called, and returns about now.
                while let Err(error) = safety.reset(why("there they are")) {
                    assert_eq!(error, ResetError::FunctionsRun);
                    luna::yield_now().await;
                }
                assert_eq!(safety.degree(), Degree::Normal, "round {round}");
            }
            safety.enter_safe_state(why("at last"));
            has_run.recv().unwrap();
            Ok(())
        });
    let report = system.run().unwrap();
    assert_eq!(report.end, End::Completed);
    assert_eq!(entered.load(Ordering::SeqCst), 4, "once each time");
    assert!(
        report
            .to_string()
            .contains("safety: safe state: at last, by process `controller`"),
        "{report}"
    );
}

/// An emergency does not wait for a function of the safe state, whatever that one does.
#[test]
fn an_emergency_is_before_the_safe_state() {
    let _watch = watchdog();
    let (begun, has_begun) = mpsc::channel();
    let (let_go, is_let_go) = mpsc::channel::<()>();
    let mut system = System::new("both");
    system.on_safe_state("slow", move || {
        begun.send(()).unwrap();
        let _ = is_let_go.recv();
    });
    // Only the emergency function lets the other one end.
    let mut let_go = Some(let_go);
    system.on_emergency("neutral", move || drop(let_go.take()));
    system.thread("own").process("raiser").spawn_ok(async move {
        luna::safety::current()
            .unwrap()
            .enter_safe_state(why("first"));
        has_begun.recv().unwrap();
        Err(luna::emergency(why("then")))
    });
    system.run().unwrap_err();
    let safety = system.report().unwrap().safety;
    assert_eq!(
        safety.functions[0].outcome,
        luna::report::FunctionOutcome::Ran,
        "{safety}"
    );
}

#[test]
fn more_events_than_are_kept() {
    let _watch = watchdog();
    let system = System::new("talkative");
    let safety = system.safety();
    for number in 0..100 {
        safety.warn(why(&number.to_string()));
    }
    let state = safety.state();
    assert_eq!((state.events.len(), state.more_events), (64, 36));
    assert_eq!(state.to_string(), "warning: 0");
}

#[test]
fn it_is_read_and_changed_from_many_threads() {
    let _watch = watchdog();
    let system = System::new("many");
    let safety = system.safety();
    std::thread::scope(|scope| {
        for _ in 0..4 {
            scope.spawn(|| {
                for _ in 0..2000 {
                    safety.enter_safe_state(why("on"));
                    assert!(safety.reset(why("off")).is_ok());
                }
            });
        }
        for _ in 0..2000 {
            let state = safety.state();
            assert_eq!(state.latched.is_some(), state.degree != Degree::Normal);
        }
    });
    assert_eq!(safety.degree(), Degree::Normal);
}

/// An error that looks at the safety state as it is dropped.
#[derive(Debug)]
struct Looks(luna::safety::Safety, Arc<AtomicUsize>);

impl std::fmt::Display for Looks {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("looks")
    }
}

impl std::error::Error for Looks {}

impl Drop for Looks {
    fn drop(&mut self) {
        drop(self.0.state());
        self.1.fetch_add(1, Ordering::SeqCst);
    }
}

#[test]
fn causes_that_are_not_kept_are_dropped_without_the_lock() {
    let _watch = watchdog();
    let system = System::new("talkative");
    let safety = system.safety();
    let dropped = Arc::new(AtomicUsize::new(0));
    let cause = || Error::other(Looks(safety.clone(), dropped.clone()));
    for _ in 0..70 {
        safety.warn(cause());
    }
    assert_eq!(dropped.load(Ordering::SeqCst), 6);
    safety.reset(cause()).unwrap();
    assert_eq!(dropped.load(Ordering::SeqCst), 7);
}

#[test]
fn after_a_reset_functions_have_not_run() {
    let _watch = watchdog();
    let (run, has_run) = mpsc::channel();
    let mut system = System::new("reset");
    system.on_safe_state("neutral", move || run.send(()).unwrap());
    system
        .thread("own")
        .process("controller")
        .spawn_ok(async move {
            let safety = luna::safety::current().unwrap();
            safety.enter_safe_state(why("first"));
            has_run.recv().unwrap();
            // It ends behind what it sent.
            while safety.reset(why("good again")).is_err() {
                luna::after(Duration::from_millis(1)).await;
            }
            Ok(())
        });
    let report = system.run().unwrap();
    let function = &report.safety.safe_state_functions[0];
    assert_eq!(function.outcome, luna::report::FunctionOutcome::NotRun);
    assert_eq!((function.began_after, function.took), (None, None));
}

/// No thread runs functions any more, so none is waited for.
#[test]
fn after_the_end_a_safe_state_can_be_reset() {
    let _watch = watchdog();
    let mut system = System::new("ended");
    system.on_safe_state("neutral", || ());
    let main = system.executor("main").build().unwrap();
    main.process("short").spawn_ok(async { Ok(()) });
    system.run().unwrap();
    let safety = system.safety();
    safety.enter_safe_state(why("afterwards"));
    safety.reset(why("good again")).unwrap();
    assert_eq!(safety.degree(), Degree::Normal);
}

#[test]
fn one_that_waits_for_the_safe_state_is_woken_once_it_is_entered() {
    let _watch = watchdog();
    let mut system = System::new("awaited");
    system.virtual_clock();
    let safety = system.safety();
    let main = system.executor("main").build().unwrap();
    for (place, level) in [("a", 3), ("b", 20)] {
        main.process(place).priority(level).spawn_ok(async move {
            let safety = luna::safety::current().unwrap();
            let start = luna::now();
            let mut entered = std::pin::pin!(safety.safe_state_entered());
            entered.as_mut().await;
            assert_eq!(luna::now() - start, Duration::from_millis(5));
            luna::after(Duration::from_millis(10)).await;
            // It waits again as long as it is left.
            entered.as_mut().await;
            assert_eq!(luna::now() - start, Duration::from_millis(20));
            entered.await;
            assert_eq!(luna::now() - start, Duration::from_millis(20));
            Ok(())
        });
    }
    // One that goes away before.
    main.process("goes").spawn_ok(async {
        let safety = luna::safety::current().unwrap();
        luna::after(Duration::from_millis(1)).await;
        let (_keeps, never) = luna::channel::<()>();
        let mut entered = std::pin::pin!(safety.safe_state_entered());
        let stop = std::future::poll_fn(|cx| {
            assert!(entered.as_mut().poll(cx).is_pending());
            std::task::Poll::Ready(())
        });
        assert!(never.recv_unless(stop).await.unwrap_err().is_timeout());
        Ok(())
    });
    main.process("says").spawn_ok(async move {
        luna::after(Duration::from_millis(5)).await;
        safety.enter_safe_state(why("hot"));
        luna::after(Duration::from_millis(5)).await;
        safety.reset(why("cool")).unwrap();
        luna::after(Duration::from_millis(10)).await;
        safety.warn(why("warm"));
        safety.enter_safe_state(why("hot again"));
        Ok(())
    });
    system.run().unwrap();
}

/// Threads that enter and leave it, and threads that wait: no thread sleeps on, and nothing is left
/// in the list.
#[test]
fn nobody_misses_the_safe_state() {
    let _watch = watchdog();
    let mut system = System::new("many");
    let safety = system.safety();
    let rounds = 300;
    let (asks, asked) = luna::channel::<()>();
    for number in 0..3 {
        let asks = asks.clone();
        system
            .thread(format!("waits {number}"))
            .process(format!("waits {number}"))
            .spawn_ok(async move {
                let safety = luna::safety::current().unwrap();
                for _ in 0..rounds {
                    let mut entered = std::pin::pin!(safety.safe_state_entered());
                    let first = std::future::poll_fn(|cx| {
                        std::task::Poll::Ready(entered.as_mut().poll(cx).is_ready())
                    });
                    if number == 0 && first.await {
                        continue;
                    }
                    // From now on another thread may enter it at any moment.
                    asks.send(()).await?;
                    entered.await;
                }
                Ok(())
            });
    }
    drop(asks);
    system
        .thread("enters")
        .process("enters")
        .spawn_ok(async move {
            while asked.recv().await.is_ok() {
                let _ = safety.reset(why("off"));
                safety.enter_safe_state(why("on"));
            }
            Ok(())
        });
    system.run().unwrap();
}
