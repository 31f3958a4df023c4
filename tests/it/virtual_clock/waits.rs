//! Loops, timers and timeouts, and what is asked of a machine that is not there.

use super::{HOUR, MS, Notes, simulated, watchdog};
use crate::common::SpawnOk;
use luna::error::SetupError;
use luna::prelude::*;
use luna::safety::{OnOverrun, Watchdog};
use luna::{Error, Instant};
use std::time::Duration;

#[test]
fn periods_that_do_not_divide_and_periods_out_of_range() {
    let _alive = watchdog();
    let (system, main) = simulated();
    let body = async {
        let zero = luna::periodic("zero", Duration::ZERO);
        assert!(matches!(
            zero,
            Err(Error::Setup(SetupError::ZeroPeriod { .. }))
        ));
        let huge = luna::periodic("huge", Duration::MAX);
        assert!(matches!(
            huge,
            Err(Error::Setup(SetupError::PeriodTooLong { .. }))
        ));
        let start = luna::now();
        let mut third = luna::periodic("third", Duration::from_nanos(333_333_333))?;
        for _ in 0..3 {
            third.next().await;
        }
        assert_eq!((luna::now() - start).as_nanos(), 999_999_999);
        let century = Duration::from_secs(100 * 365 * 24 * 3600);
        let mut rare = luna::periodic("rare", century)?;
        let before = luna::now();
        rare.next().await;
        assert_eq!(luna::now() - before, century);
        let mut shortest = luna::periodic("shortest", Duration::from_nanos(1))?;
        for number in 1..=1000 {
            assert_eq!(shortest.next().await.number, number);
        }
        Ok(())
    };
    main.process("periods").spawn_ok(body);
    system.run().unwrap();
}

#[test]
fn a_cycle_that_waits_too_long_is_overrun_as_ever() {
    let _alive = watchdog();
    let (system, main) = simulated();
    let body = async {
        let mut tick = luna::periodic("slow", MS * 10)?;
        tick.next().await;
        luna::after(MS * 25).await;
        let cycle = tick.next().await;
        assert_eq!((cycle.number, cycle.missed, cycle.lateness), (3, 1, MS * 5));
        Ok(())
    };
    main.process("slow").spawn_ok(body);
    let report = system.run().unwrap();
    assert_eq!(
        (report.loops["slow"].missed, report.loops["slow"].overruns),
        (1, 1)
    );
}

#[test]
fn a_timer_that_goes_while_another_of_its_instant_fires() {
    let _alive = watchdog();
    let (system, main) = simulated();
    let notes = Notes::default();
    let (stop, stopped) = luna::channel::<()>();
    let own = notes.clone();
    // Both are due at once. The first to be served removes the other's timer, whether that is
    // already readied or not.
    let firing = async move {
        luna::after(MS).await;
        own.note("fired");
        stop.send(()).await?;
        Ok(())
    };
    main.process("firing").priority(20).spawn_ok(firing);
    let own = notes.clone();
    let dropped = async move {
        luna::pri_alt! {
            _ = stopped.recv() => own.note("stopped"),
            _ = luna::after(MS) => own.note("late"),
        }
        let mut timer = luna::Timer::new();
        timer.set(MS);
        timer.cancel();
        luna::alt! {
            _ = timer.expired() => own.note("never"),
            _ = luna::after(MS * 2) => own.note("after"),
        }
        Ok(())
    };
    main.process("dropped").priority(10).spawn_ok(dropped);
    let report = system.run();
    let seen = notes.take();
    // The delay has expired before the sender could send. The alternative takes the delay only if
    // no process has sent, and the sender is the more urgent process.
    assert_eq!(seen[0], (1000, "fired".into()));
    assert_eq!(seen[1].0, 1000);
    assert_eq!(seen[2], (3000, "after".into()));
    assert_eq!(seen[1].1 == "stopped", report.is_ok());
}

#[test]
fn timeouts_and_watchdogs_and_ticks_go_by_it() {
    let _alive = watchdog();
    let (system, main) = simulated();
    let watchdog = Watchdog::new(MS * 50);
    let fed = watchdog.clone();
    let feeds = async move {
        let mut ticks = luna::ticks(MS * 20)?;
        for number in 1..=5 {
            assert_eq!(ticks.tick().await.number, number);
            fed.feed();
        }
        Ok(())
    };
    main.process("feeds").spawn_ok(feeds);
    let guards = async move {
        let start = luna::now();
        watchdog.expired().await;
        // It expires when more than its timeout has passed without a feed.
        let hungry = MS * 150 + Duration::from_nanos(1);
        assert_eq!(luna::now() - start, hungry);
        let (_sender, receiver) = luna::channel::<()>();
        assert!(receiver.recv_timeout(HOUR).await.is_err());
        assert_eq!(luna::now() - start, hungry + HOUR);
        Ok(())
    };
    main.process("guards").spawn_ok(guards);
    system.run().unwrap();
}

#[test]
fn ticks_that_are_made_outside_begin_when_they_are_waited_for() {
    let _alive = watchdog();
    let (system, main) = simulated();
    let mut ticks = luna::ticks(MS).unwrap();
    let start = Instant::from_nanos(5_000_000_000);
    let mut given = luna::ticks(MS).unwrap().starting_at(start);
    let body = async move {
        luna::after(MS * 10).await;
        let now = luna::now();
        for number in 1..=3 {
            let tick = ticks.tick().await;
            assert_eq!((tick.number, tick.slot), (number, now + MS * number as u32));
        }
        assert_eq!(given.tick().await.slot, start);
        Ok(())
    };
    main.process("ticks").spawn_ok(body);
    system.run().unwrap();
}

#[test]
fn a_guard_spin_and_other_wishes_of_real_time_ask_for_nothing() {
    let _alive = watchdog();
    let mut system = System::new("wishes");
    system.virtual_clock().strict().lock_memory();
    let main = system
        .executor("main")
        .core(4095)
        .policy(Policy::fifo(80))
        .spin_before_sleep(MS / 10)
        .build()
        .unwrap();
    let body = async {
        let mut tick = luna::periodic("servo", MS)?.guard_spin(MS / 20)?;
        for number in 1..=1000 {
            let cycle = tick.next().await;
            assert_eq!((cycle.number, cycle.lateness), (number, Duration::ZERO));
        }
        Ok(())
    };
    main.process("servo").spawn_ok(body);
    let report = system.run().unwrap();
    assert_eq!(report.all_shortfalls().count(), 0);
    assert_eq!(report.processes[0].polls, 1001, "no turn was spun away");
}

#[test]
fn computing_takes_no_time_so_a_budget_holds() {
    let _alive = watchdog();
    let (system, main) = simulated();
    let body = async {
        // However long that takes on the machine.
        let sum: u64 = std::hint::black_box((0..1_000_000_u64).sum());
        assert!(sum > 0);
        Ok(())
    };
    let process = main.process("busy").poll_budget(Duration::from_nanos(1));
    process.on_overrun(OnOverrun::Emergency).spawn_ok(body);
    let report = system.run().unwrap();
    assert_eq!(report.processes[0].budgets[0].overruns, 0);
    let (system, main) = simulated();
    let waits = async {
        let mut tick = luna::periodic("waits", MS * 10)?;
        tick.next().await;
        luna::after(MS * 2).await;
        tick.next().await;
        Ok(())
    };
    main.process("waits").cycle_budget(MS).spawn_ok(waits);
    let report = system.run().unwrap();
    assert_eq!(report.processes[0].budgets[0].overruns, 1, "waiting does");
}
