//! `luna::run`: a process on the calling thread, without a system.

use crate::common;
use common::watchdog;
use luna::Error;
use luna::error::SetupError;
use luna::prelude::*;
use std::time::Duration;

#[test]
fn smoke() {
    assert_eq!(luna::run(async { Ok(42) }), Ok(42));
}

#[test]
fn errors_come_back_as_they_are() {
    let error = Error::other("the encoder does not answer");
    assert_eq!(luna::run(async { Err::<(), _>(error.clone()) }), Err(error));
    let (sender, receiver) = luna::channel::<u32>();
    drop(sender);
    assert_eq!(
        luna::run(async { Ok(receiver.recv().await?) }),
        Err(Error::Closed)
    );
    let (sender, receiver) = luna::channel::<u32>();
    receiver.poison();
    assert_eq!(
        luna::run(async { Ok(sender.send(1).await?) }),
        Err(Error::Poisoned)
    );
}

#[test]
fn a_run_inside_a_run_is_an_error_and_the_outer_goes_on() {
    let _watch = watchdog();
    let outcome = luna::run(async {
        let inner = luna::run(async { Ok(1) });
        assert_eq!(inner, Err(Error::Setup(SetupError::Nested)));
        assert!(inner.unwrap_err().to_string().contains("inside a process"));
        // The outer one's timers and loops are still there.
        let tick = luna::periodic("after the inner run", Duration::from_millis(1))?;
        let mut tick = tick.overrun(luna::time::Overrun::CatchUp);
        Ok(tick.next().await.number)
    });
    assert_eq!(outcome, Ok(1));
}

#[test]
fn a_run_after_a_run_starts_anew() {
    let _watch = watchdog();
    for _ in 0..3 {
        // The same loop's name each time: each run is a world of its own.
        luna::run(async {
            Ok(luna::periodic("again", Duration::from_millis(1))?
                .next()
                .await)
        })
        .unwrap();
    }
}

#[test]
fn timers_all_fire_and_none_early() {
    let _watch = watchdog();
    let fired = luna::run(async {
        let start = luna::now();
        let wait = |millis| async move {
            let deadline = start + Duration::from_millis(millis);
            luna::at(deadline).await;
            assert!(luna::now() >= deadline);
            Ok(millis)
        };
        // Also one that has passed already, and two of one deadline.
        luna::at(start).await;
        par!(wait(9), wait(3), wait(6), wait(0), wait(3)).await
    });
    assert_eq!(fired, Ok((9, 3, 6, 0, 3)));
}

#[test]
fn a_panic_passes_through_and_the_thread_can_run_again() {
    let _watch = watchdog();
    let outcome = std::panic::catch_unwind(|| luna::run::<()>(async { panic!("through") }));
    assert_eq!(outcome.unwrap_err().downcast_ref(), Some(&"through"));
    let timed = async {
        luna::after(Duration::from_millis(1)).await;
        Ok("again")
    };
    assert_eq!(luna::run(timed), Ok("again"));
}

#[test]
fn the_body_may_block_and_be_woken_from_elsewhere() {
    let _watch = watchdog();
    let (sender, receiver) = luna::channel();
    let thread = std::thread::spawn(move || sender.blocking_send(7));
    let received = luna::run(async {
        let first = receiver.recv().await?;
        assert_eq!(luna::blocking(|| 1).await, 1);
        assert!(receiver.blocking_recv().unwrap_err().is_closed());
        Ok(first)
    });
    assert_eq!(received, Ok(7));
    thread.join().unwrap().unwrap();
}

#[test]
fn outside_of_the_path() {
    // Without a system nothing is promised, so an allocator that counts sees nothing here.
    assert!(!luna::realtime::on_path());
    luna::run(async {
        assert!(!luna::realtime::on_path());
        Ok(())
    })
    .unwrap();
}
