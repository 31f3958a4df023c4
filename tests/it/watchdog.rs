//! Watchdogs, with processes that send heartbeats and processes that do not. Unit tests beside the
//! code test their exact limits, with instants passed in.

use crate::common;
use common::{PLACEMENTS, SpawnOk, watchdog};
use luna::prelude::*;
use luna::safety::{Feeder, Watchdog};
use luna::{Error, Timer};
use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering};
use std::time::Duration;

const MS: Duration = Duration::from_millis(1);
/// Longer than any machine is busy.
const LONG: Duration = Duration::from_secs(1000);

#[test]
fn it_expires_when_nobody_feeds_it_and_stays_so() {
    let _watch = watchdog();
    for place in PLACEMENTS {
        let mut system = System::new("hungry");
        let process = place.process(&mut system, "place", "guard");
        process.spawn_ok(async {
            let watchdog = Watchdog::new(2 * MS);
            let start = luna::now();
            watchdog.expired().await;
            assert!(luna::now() - start > 2 * MS);
            for _ in 0..3 {
                watchdog.feed();
                assert!(watchdog.has_expired());
                watchdog.expired().await;
                let expired = luna::pri_alt! { _ = watchdog.expired() => true, skip => false };
                assert!(expired);
            }
            let start = luna::now();
            watchdog.reset();
            watchdog.expired().await;
            assert!(luna::now() - start > 2 * MS);
            Ok(())
        });
        system.run().unwrap();
    }
}

/// A guard beside channels, with heartbeats from elsewhere: it never expires, however long the
/// wait.
#[test]
fn fed_in_time_it_does_not_expire() {
    let _watch = watchdog();
    let watchdog = Watchdog::new(LONG);
    let fed = watchdog.clone();
    let (sender, receiver) = luna::channel::<u32>();
    let mut system = System::new("fed");
    system
        .thread("source")
        .process("source")
        .spawn_ok(async move {
            for n in 0..200 {
                fed.feed();
                sender.send(n).await?;
            }
            Ok(())
        });
    let executor = system.executor("main").build().unwrap();
    executor.process("guard").spawn_ok(async move {
        for expected in 0..200 {
            luna::alt! {
                n = receiver.recv() => assert_eq!(n?, expected),
                _ = watchdog.expired() => panic!("it was fed"),
            }
        }
        Ok(())
    });
    system.run().unwrap();
}

/// A waiter learns of heartbeats only when the timeout expires, and then sleeps on: the new timeout
/// counts from the last heartbeat.
#[test]
fn a_wait_is_counted_from_the_last_feed() {
    let _watch = watchdog();
    let timeout = 20 * MS;
    let watchdog = Watchdog::new(timeout);
    let fed = watchdog.clone();
    let mut system = System::new("counted");
    let executor = system.executor("main").build().unwrap();
    let (last, fed_last) = luna::channel();
    executor.process("feeder").spawn_ok(async move {
        let mut ticks = luna::ticks(MS)?;
        for _ in 0..50 {
            fed.feed();
            ticks.tick().await;
        }
        // Either this heartbeat is in time, and counts; or it came too late on a busy machine,
        // and the watchdog has expired before.
        let now = luna::now();
        fed.feed();
        let was_in_time = !fed.has_expired();
        last.send((now, was_in_time)).await?;
        Ok(())
    });
    executor.process("guard").spawn_ok(async move {
        let expired = async {
            watchdog.expired().await;
            Ok(luna::now())
        };
        let (expired, (fed, was_in_time)) =
            par!(expired, async { Ok(fed_last.recv().await?) }).await?;
        if was_in_time {
            assert!(expired - fed > timeout);
        }
        Ok(())
    });
    system.run().unwrap();
}

/// The process calls its function once for each time that it expires.
#[test]
fn a_process_that_calls_a_function() {
    let _watch = watchdog();
    for place in PLACEMENTS {
        let watchdog = Watchdog::new(MS);
        let calls = Arc::new(AtomicU32::new(0));
        let (own, own_calls) = (watchdog.clone(), calls.clone());
        let (signal, signals) = luna::buffered(Buffer::fifo(8));
        let mut system = System::new("called");
        place
            .process(&mut system, "watchdog", "watchdog")
            .spawn_ok(watchdog.process(move || {
                own_calls.fetch_add(1, Ordering::SeqCst);
                signal.try_send(()).unwrap();
            }));
        system
            .executor("main")
            .build()
            .unwrap()
            .process("feeder")
            .spawn_ok(async move {
                for round in 1..=3 {
                    own.feed();
                    signals.recv().await?;
                    assert!(own.has_expired());
                    assert_eq!(calls.load(Ordering::SeqCst), round);
                    own.feed();
                    luna::after(3 * MS).await;
                    assert_eq!(
                        calls.load(Ordering::SeqCst),
                        round,
                        "once, until it is reset"
                    );
                    own.reset();
                }
                assert!(own.retire());
                Ok(())
            });
        drop(watchdog);
        system.run().unwrap();
    }
}

/// The number of calls of a watchdog's process whose heartbeats `feed` sends. It has the only other
/// handle.
fn calls_after<F>(feed: impl FnOnce(Feeder) -> F) -> (luna::Result<()>, u32)
where
    F: Future<Output = luna::Result<()>> + Send + 'static,
{
    let watchdog = Watchdog::new(50 * MS);
    let calls = Arc::new(AtomicU32::new(0));
    let own_calls = calls.clone();
    let mut system = System::new("ends");
    system.virtual_clock();
    let executor = system.executor("main").build().unwrap();
    let process = watchdog.process(move || {
        own_calls.fetch_add(1, Ordering::SeqCst);
    });
    executor.process("watchdog").spawn_ok(process);
    executor.process("feeder").spawn_ok(feed(watchdog.feeder()));
    drop(watchdog);
    let ended = system.run().map(drop);
    (ended, calls.load(Ordering::SeqCst))
}

/// A process that is guarded does not switch its watchdog off by its end, however it ends.
#[test]
fn the_end_of_what_feeds_is_an_expiry() {
    let _watch = watchdog();
    let (ended, calls) = calls_after(|feeder| async move {
        feeder.feed();
        luna::after(10 * MS).await;
        feeder.feed();
        Ok(())
    });
    assert!(ended.is_ok());
    assert_eq!(calls, 1);
    let (ended, calls) = calls_after(|feeder| async move {
        feeder.feed();
        Err(Error::System("the sensor is gone".to_owned()))
    });
    assert!(ended.is_err());
    assert_eq!(calls, 1);
    // It never began.
    let (ended, calls) = calls_after(|feeder| async move {
        drop(feeder);
        Ok(())
    });
    assert!(ended.is_ok());
    assert_eq!(calls, 1);
}

/// An end on purpose is announced; the process of the watchdog then ends too.
#[test]
fn a_watchdog_that_is_retired_does_not_expire() {
    let _watch = watchdog();
    let (ended, calls) = calls_after(|feeder| async move {
        feeder.feed();
        luna::after(10 * MS).await;
        assert!(feeder.retire());
        Ok(())
    });
    assert!(ended.is_ok());
    assert_eq!(calls, 0);
    // Too late: it has expired.
    let (ended, calls) = calls_after(|feeder| async move {
        feeder.feed();
        luna::after(60 * MS).await;
        assert!(!feeder.retire());
        Ok(())
    });
    assert!(ended.is_ok());
    assert_eq!(calls, 1);
}

/// A process of higher priority that occupies the processor does not hide its missing heartbeat
/// from a watchdog: the late heartbeat reports it.
#[test]
fn a_late_feed_hides_nothing() {
    let _watch = watchdog();
    let watchdog = Watchdog::new(MS);
    let own = watchdog.clone();
    let mut system = System::new("hog");
    let executor = system.executor("main").build().unwrap();
    let (expired, expiries) = luna::buffered(Buffer::fifo(1));
    executor
        .process("watchdog")
        .priority(1)
        .spawn_ok(watchdog.process(move || expired.try_send(()).unwrap()));
    drop(watchdog);
    executor.process("hog").priority(31).spawn_ok(async move {
        own.feed();
        common::burn_until(luna::now() + 3 * MS);
        own.feed();
        // On the same executor, at a higher priority: no process has looked.
        assert!(expiries.try_recv().is_err());
        assert!(own.has_expired());
        expiries.recv().await.map_err(Error::from)
    });
    system.run().unwrap();
}

/// Beside a timer that is never set: the guards of one alternative do not disturb each other.
#[test]
fn beside_other_clocks() {
    let _watch = watchdog();
    luna::run(async {
        let watchdog = Watchdog::new(LONG);
        let mut timer = Timer::new();
        let mut ticks = luna::ticks(MS)?;
        for _ in 0..5 {
            luna::alt! {
                _ = watchdog.expired() => panic!("it has long time"),
                _ = timer.expired() => panic!("it is not set"),
                tick = ticks.tick() => assert!(tick.number > 0),
            }
        }
        Ok(())
    })
    .unwrap();
}
