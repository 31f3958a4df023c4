//! Timer channels: ticks and timers, alone and as guards.

use crate::ALLOCATOR;
use crate::common;

use common::{PLACEMENTS, SpawnOk, burn_until};
use luna::prelude::*;
use luna::{Error, Instant, Timer};
use std::time::Duration;

const MS: Duration = Duration::from_millis(1);

/// Wherever it runs and however late it is served, a tick lies on its grid, in its slot, and all
/// slots are accounted for.
#[test]
fn ticks_lie_on_their_grid() {
    own_process!();
    for place in PLACEMENTS {
        let mut system = System::new("grid");
        let process = place.process(&mut system, "place", "ticking");
        process.spawn_ok(async {
            let first = luna::now() + 2 * MS;
            let mut ticks = luna::ticks(MS)?.starting_at(first);
            let mut last = 0;
            for round in 0..20 {
                let tick = ticks.tick().await;
                assert_eq!(tick.slot, first + MS * (tick.number as u32 - 1));
                assert!(tick.lateness < MS);
                assert_eq!(tick.number, last + tick.missed + 1);
                last = tick.number;
                assert!(luna::now() >= tick.slot);
                assert!(ticks.next_slot() > tick.slot);
                if round == 10 {
                    // Three slots pass whole.
                    burn_until(tick.slot + 4 * MS);
                    let late = ticks.tick().await;
                    assert!(late.missed >= 3);
                    assert_eq!(late.number, last + late.missed + 1);
                    last = late.number;
                }
            }
            Ok(())
        });
        system.run().unwrap();
    }
}

/// What was not chosen is not used up: other guards, and waits that are dropped, take no tick away.
#[test]
fn ticks_among_other_guards() {
    own_process!();
    let (sender, receiver) = luna::channel::<u32>();
    let mut system = System::new("guards");
    let executor = system.executor("main").build().unwrap();
    executor.process("source").spawn_ok(async move {
        for n in 0..500 {
            sender.send(n).await?;
            luna::yield_now().await;
        }
        Ok(())
    });
    executor.process("both").spawn_ok(async move {
        let mut ticks = luna::ticks(MS)?;
        let (mut received, mut slots) = (0, 0);
        while slots < 10 || received < 500 {
            luna::alt! {
                n = receiver.recv(), if received < 500 => {
                    assert_eq!(n?, received);
                    received += 1;
                }
                tick = ticks.tick() => {
                    slots += tick.missed + 1;
                    assert_eq!(tick.number, slots);
                }
            }
        }
        Ok(())
    });
    system.run().unwrap();
}

/// In the order written: a due tick before a ready channel, and a ready channel before a due tick.
#[test]
fn priority_between_a_tick_and_a_channel() {
    own_process!();
    let (sender, receiver) = luna::buffered(Buffer::fifo(4));
    luna::run(async {
        let mut ticks = luna::ticks(Duration::from_secs(1000))?.starting_at(luna::now());
        sender.try_send(1)?;
        let chosen = luna::pri_alt! {
            tick = ticks.tick() => tick.number,
            _ = receiver.recv() => 0,
        };
        assert_eq!(chosen, 1);
        let mut ticks = luna::ticks(Duration::from_secs(1000))?.starting_at(luna::now());
        let chosen = luna::pri_alt! {
            n = receiver.recv() => n?,
            _ = ticks.tick() => 7,
        };
        assert_eq!(chosen, 1);
        // It is due still.
        let chosen = luna::pri_alt! {
            _ = receiver.recv() => unreachable!("nobody sends"),
            tick = ticks.tick() => tick.number,
            skip => 7,
        };
        assert_eq!(chosen, 1);
        // And now it is not, for long.
        let chosen = luna::alt! { _ = ticks.tick() => 7, skip => 2 };
        assert_eq!(chosen, 2);
        Ok(())
    })
    .unwrap();
}

#[test]
fn a_timer_that_is_set_fires_once() {
    own_process!();
    luna::run(async {
        let mut timer = Timer::new();
        for _ in 0..5 {
            timer.set(MS);
            let deadline = timer.deadline().unwrap();
            assert_eq!(timer.expired().await, deadline);
            assert!(luna::now() >= deadline);
            assert_eq!(timer.deadline(), None);
            let chosen = luna::alt! { _ = timer.expired() => 1, skip => 2 };
            assert_eq!(chosen, 2);
        }
        // A deadline that has passed fires at once.
        timer.set_at(Instant::from_nanos(1));
        let chosen = luna::alt! { _ = timer.expired() => 1, skip => 2 };
        assert_eq!(chosen, 1);
        Ok(())
    })
    .unwrap();
}

#[test]
fn a_timer_that_is_not_set_never_fires() {
    own_process!();
    luna::run(async {
        let mut timer = Timer::default();
        let fires = luna::alt! { _ = timer.expired() => true, _ = luna::after(2 * MS) => false };
        assert!(!fires);
        timer.set(MS);
        assert!(timer.cancel() && !timer.cancel());
        let fires = luna::alt! { _ = timer.expired() => true, _ = luna::after(5 * MS) => false };
        assert!(!fires);
        Ok(())
    })
    .unwrap();
}

/// The timer goes on while other guards are chosen, and a new time replaces the old one, later or
/// sooner.
#[test]
fn a_timer_outlives_the_waits_for_it() {
    own_process!();
    luna::run(async {
        let mut timer = Timer::new();
        timer.set(5 * MS);
        let deadline = timer.deadline().unwrap();
        let fired = loop {
            luna::alt! {
                fired = timer.expired() => break fired,
                _ = luna::after(MS / 10) => assert_eq!(timer.deadline(), Some(deadline)),
            }
        };
        assert_eq!(fired, deadline);

        let start = luna::now();
        timer.set(Duration::from_secs(1000));
        let fires = luna::alt! { _ = timer.expired() => true, _ = luna::after(MS) => false };
        assert!(!fires);
        timer.set(MS);
        timer.expired().await;
        timer.set(MS);
        let later = luna::now() + 5 * MS;
        timer.set_at(later);
        assert_eq!(timer.expired().await, later);
        assert!(luna::now() - start < Duration::from_secs(500));
        Ok(())
    })
    .unwrap();
}

/// Ticks that are always due are no way to keep others from running.
#[test]
fn overdue_ticks_let_others_run() {
    own_process!();
    let mut system = System::new("overdue");
    let executor = system.executor("main").build().unwrap();
    let (done, is_done) = luna::channel::<()>();
    executor
        .process("overdue")
        .priority(31)
        .spawn_ok(async move {
            let mut ticks = luna::ticks(Duration::from_nanos(1))?;
            while is_done.try_recv().is_err_and(|error| error.is_empty()) {
                ticks.tick().await;
            }
            Ok(())
        });
    executor
        .process("other")
        .priority(31)
        .spawn_ok(async move { done.send(()).await.map_err(Error::from) });
    system.run().unwrap();
}

/// No tick, no timer and no heartbeat of a watchdog allocates or frees, once the process has waited
/// for the first time.
#[test]
fn nothing_is_allocated() {
    own_process!();
    luna::run(async {
        let mut ticks = luna::ticks(MS / 10)?;
        let mut timer = Timer::new();
        let watchdog = luna::safety::Watchdog::new(MS);
        let before = ALLOCATOR.here();
        for _ in 0..50 {
            timer.set(MS);
            watchdog.reset();
            for _ in 0..3 {
                luna::alt! {
                    _ = ticks.tick() => watchdog.feed(),
                    _ = timer.expired() => timer.set(MS),
                    _ = watchdog.expired() => watchdog.reset(),
                }
            }
            timer.set(MS / 10);
            timer.expired().await;
        }
        watchdog.expired().await;
        assert_eq!(ALLOCATOR.here(), before);
        Ok(())
    })
    .unwrap();
}
