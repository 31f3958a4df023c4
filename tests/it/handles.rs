//! Processes seen from outside: their handles.

use crate::common;
use common::{PLACEMENTS, SpawnOk, in_process, watchdog};
use luna::prelude::*;
use luna::process::ProcessState;
use luna::{Error, Exit};
use std::sync::Arc;
use std::time::Duration;

#[test]
fn before_the_run_there_is_none() {
    let _watch = watchdog();
    let mut system = System::new("early");
    let executor = system.executor("main").build().unwrap();
    let id = executor
        .process("one")
        .priority(7)
        .spawn_ok(async { Ok(()) });
    assert!(system.process_handle(id).is_none() && executor.process_handle(id).is_none());
    system.run().unwrap();
    // And after it there still is, from both.
    for handle in [
        system.process_handle(id).unwrap(),
        executor.process_handle(id).unwrap(),
    ] {
        assert_eq!(
            (handle.name(), handle.id(), handle.priority()),
            ("one", id, 7)
        );
        assert_eq!(
            (handle.state(), handle.exit(), handle.polls()),
            (ProcessState::Ended, Some(Exit::Completed), 1)
        );
        assert_eq!(handle.wait(), Exit::Completed);
        handle.cancel();
        assert_eq!(handle.exit(), Some(Exit::Completed), "it has ended already");
        assert!(format!("{handle:?}").contains("one"));
    }
}

#[test]
fn a_cancelled_process_withdraws_what_it_waited_for() {
    let _watch = watchdog();
    for place in PLACEMENTS {
        let (sender, receiver) = luna::channel();
        let counted = Arc::new(());
        let value = counted.clone();
        let mut system = System::new("cancelled");
        let own_sender = sender.clone();
        let id = place
            .process(&mut system, "place", "offering")
            .spawn_ok(async move { Ok(own_sender.send(value).await?) });
        let other = system.executor("other").build().unwrap();
        let own = other.clone();
        other.process("canceller").spawn_ok(async move {
            let offering = own.process_handle(id).unwrap();
            while offering.state() != ProcessState::Waiting {
                luna::after(Duration::from_micros(100)).await;
            }
            offering.cancel();
            assert_eq!(offering.join().await, Exit::Cancelled);
            assert!(receiver.try_recv().unwrap_err().is_empty());
            assert_eq!(
                Arc::strong_count(&counted),
                1,
                "the value is gone with the offer"
            );
            drop(sender);
            assert!(
                receiver.try_recv().unwrap_err().is_closed(),
                "and its end with its body"
            );
            Ok(())
        });
        let error = system.run().unwrap_err();
        assert_eq!(error, in_process("offering", Error::Cancelled));
    }
}

#[test]
fn exits_after_a_panic() {
    let _watch = watchdog();
    let mut system = System::new("exits");
    let executor = system.executor("main").build().unwrap();
    let waiting = executor
        .process("waiting")
        .spawn_ok(std::future::pending::<luna::Result<()>>());
    let culprit = executor
        .process("culprit")
        .priority(0)
        .spawn_ok(async { panic!("{}", "formatted") });
    system.run().unwrap_err();
    let exit = |id| system.process_handle(id).unwrap().exit().unwrap();
    assert_eq!(exit(culprit), Exit::Panicked("formatted".to_owned()));
    assert_eq!(exit(waiting), Exit::Cancelled);
}
