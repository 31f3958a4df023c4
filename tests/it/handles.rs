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
fn states_of_a_process() {
    let _watch = watchdog();
    let mut system = System::new("states");
    let executor = system.executor("main").build().unwrap();
    let (go, gone) = luna::channel();
    let own = executor.clone();
    // At lower priority, on the same executor: so the state it reads does not change until its next
    // await.
    let watched = executor
        .process("watched")
        .priority(10)
        .spawn_ok(async move {
            gone.recv().await?;
            Ok(())
        });
    let low = executor
        .process("low")
        .priority(1)
        .spawn_ok(async { Ok(()) });
    executor
        .process("watching")
        .priority(5)
        .spawn_ok(async move {
            let watched = own.process_handle(watched).unwrap();
            assert_eq!(watched.state(), ProcessState::Waiting);
            assert_eq!(
                own.process_handle(low).unwrap().state(),
                ProcessState::Ready
            );
            // The rendezvous makes it ready, and lets it run since it is of higher priority.
            go.send(()).await?;
            assert_eq!((watched.state(), watched.polls()), (ProcessState::Ended, 2));
            luna::yield_now().await;
            Ok(())
        });
    system.run().unwrap();
    assert_eq!(
        system.process_handle(low).unwrap().state(),
        ProcessState::Ended
    );
}

#[test]
fn a_process_that_runs_says_so() {
    let _watch = watchdog();
    let mut system = System::new("running");
    let executor = system.executor("main").build().unwrap();
    let own = executor.clone();
    let (notify, notified) = luna::buffered(Buffer::fifo(1));
    let id = executor.process("self").spawn_ok(async move {
        let id = notified.recv().await?;
        let myself = own.process_handle(id).unwrap();
        assert_eq!(myself.state(), ProcessState::Running);
        // Cancelled by itself: at its next await.
        myself.cancel();
        assert_eq!(myself.state(), ProcessState::Running);
        std::future::pending().await
    });
    notify.try_send(id).unwrap();
    assert!(system.run().is_err());
    assert_eq!(
        system.process_handle(id).unwrap().exit(),
        Some(Exit::Cancelled)
    );
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
fn many_join_and_wait() {
    let _watch = watchdog();
    let (go, gone) = luna::channel::<()>();
    let (id_of, ids) = luna::buffered(Buffer::fifo(1));
    let mut system = System::new("joined");
    let left = system.executor("left").build().unwrap();
    let right = system.executor("right").build().unwrap();
    let id = left
        .process("joined")
        .spawn_ok(async move { Ok(gone.recv().await?) });
    let mut joining = Vec::new();
    for (number, place) in (0..8).zip([&left, &right].into_iter().cycle()) {
        let own = place.clone();
        let joins = async move {
            assert_eq!(
                own.process_handle(id).unwrap().join().await,
                Exit::Completed
            );
            Ok(())
        };
        joining.push(place.process(format!("joining {number}")).spawn_ok(joins));
    }
    let own = right.clone();
    let last = async move {
        // Lets it end when a plain thread waits for it too, and all others wait.
        let handle = ids.recv().await?;
        for id in joining {
            while own.process_handle(id).unwrap().state() != ProcessState::Waiting {
                luna::after(Duration::from_micros(100)).await;
            }
        }
        // A join that is dropped leaves no trace.
        assert!(
            futures_lite::future::poll_once(own.process_handle(handle).unwrap().join())
                .await
                .is_none()
        );
        go.send(()).await?;
        Ok(())
    };
    right.process("last").priority(0).spawn_ok(last);
    let own = left.clone();
    let waiting = std::thread::spawn(move || {
        let handle = loop {
            match own.process_handle(id) {
                Some(handle) => break handle,
                None => std::thread::yield_now(),
            }
        };
        id_of.try_send(id).unwrap();
        handle.wait()
    });
    system.run().unwrap();
    assert_eq!(waiting.join().unwrap(), Exit::Completed);
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
