//! Faults of the network and the card: no wrong value ever reaches a controller, and the link ends
//! as documented.

use crate::common;
use common::{
    FASTEST, PERIOD, SpawnOk, Truth, fault, patient, register, samples, turning, wait_until,
};
use hostmot2::encoder::Lost;
use luna::prelude::*;
use luna::{End, Report};
use luna_mesa::{Actuator, Bucket, Card, Fault, Health, Link};
use luna_mesa_sim::Faults;
use std::sync::atomic::{AtomicU32, Ordering};
use std::sync::{Arc, Mutex};
use std::time::Duration;

/// Runs `link` with a controller that checks its samples, and drives PWM generator 0 at a quarter.
/// It calls `at_cycle` before each cycle, with its number, and ends after `cycles` of them.
fn run(
    link: Link,
    cycles: u32,
    at_cycle: impl FnMut(u32) + Send + 'static,
) -> (luna::Result<Report>, Truth, Arc<Health>, u32) {
    run_with(FASTEST, link, cycles, at_cycle)
}

/// As [`run`], with another greatest speed.
fn run_with(
    fastest: f64,
    mut link: Link,
    cycles: u32,
    mut at_cycle: impl FnMut(u32) + Send + 'static,
) -> (luna::Result<Report>, Truth, Arc<Health>, u32) {
    let (count, counts) = samples();
    let (duty, duties) = register::<f64>();
    link.encoder(0, fastest, count).pwm(0, duties);
    let process = link.process().unwrap();
    let health = process.health();
    let mut system = System::new("test");
    let neutral = process.neutral();
    let calls = Arc::new(AtomicU32::new(0));
    let called = calls.clone();
    system.on_emergency("card", move || {
        called.fetch_add(1, Ordering::Relaxed);
        neutral.engage();
    });
    let main = system.executor("main").build().unwrap();
    let truth = Arc::new(Mutex::new(Truth::default()));
    let shared = truth.clone();
    main.process("control").spawn_ok(async move {
        for cycle in 0..cycles {
            at_cycle(cycle);
            let sample = counts.recv().await?;
            shared.lock().unwrap().check(sample);
            duty.send(0.25).await?;
        }
        Ok(())
    });
    main.process("card").spawn_ok(process);
    let outcome = system.run();
    drop(main);
    let truth = std::mem::take(&mut *truth.lock().unwrap());
    (outcome, truth, health, calls.load(Ordering::Relaxed))
}

/// A bad network: 1 % is lost, 5 % overtaken, 2 % doubled, all is delayed, some until the next
/// cycle.
fn bad() -> Faults {
    Faults {
        loss: 0.01,
        doubling: 0.02,
        reordering: 0.05,
        held_up: PERIOD * 3 / 2,
        delay: [Duration::ZERO, Duration::from_micros(200)],
    }
}

#[test]
fn loss_reordering_doubles_and_silences_never_make_a_wrong_value() {
    let server = Arc::new(turning());
    let link = patient(&server);
    let breaker = server.clone();
    let (outcome, truth, health, calls) = run(link, 1_500, move |cycle| match cycle {
        100 => breaker.set_faults(bad()),
        300 | 600 | 900 => breaker.silence(Duration::from_millis(20)),
        1_200 => breaker.set_faults(Faults::NONE),
        _ => {}
    });
    assert_eq!(outcome.unwrap().end, End::Completed);
    assert_eq!(calls, 0);
    assert_eq!(truth.fresh + truth.stale, 1_500);
    // The silences alone are some ten cycles each.
    assert!(truth.stale >= 20 && truth.longest >= 5, "{truth:?}");
    assert!(truth.fresh > 1_000, "{truth:?}");
    assert!(
        health.dropped() > 0 && health.writes_behind() > 0,
        "{health:?}"
    );
    assert!(health.longest_silence() >= 5, "{health:?}");
    wait_until(&server, |card| card.is_neutral());
}

#[test]
fn it_recovers_when_the_network_does() {
    let server = Arc::new(turning());
    let link = patient(&server);
    let breaker = server.clone();
    let driven = Arc::new(Mutex::new(Vec::new()));
    let looked = driven.clone();
    let (outcome, truth, ..) = run(link, 400, move |cycle| match cycle {
        50 => breaker.set_faults(Faults { loss: 0.6, ..bad() }),
        200 => breaker.set_faults(Faults::NONE),
        250.. => looked
            .lock()
            .unwrap()
            .push(breaker.with_card(|card, _| card.duty(0))),
        _ => {}
    });
    outcome.unwrap();
    assert!(truth.stale >= 20, "{truth:?}");
    assert!(driven.lock().unwrap().iter().all(|duty| *duty == 0.25));
}

#[test]
fn answers_that_are_always_late_are_never_used() {
    let server = Arc::new(turning());
    let mut link = patient(&server);
    link.tolerance(Bucket::new(1, 1, 200));
    let breaker = server.clone();
    let (outcome, truth, health, calls) = run(link, 1_000, move |cycle| {
        if cycle == 10 {
            // Late enough that a delayed link does not find an answer that has come meanwhile.
            let late = [PERIOD * 20, PERIOD * 40];
            breaker.set_faults(Faults {
                delay: late,
                ..Faults::NONE
            });
        }
    });
    assert!(matches!(fault(outcome), Fault::TooManyErrors { in_a_row } if in_a_row >= 40));
    assert!(truth.stale >= 40, "{truth:?}");
    assert!(health.dropped() > 0, "{health:?}");
    assert_eq!(calls, 1);
    wait_until(&server, |card| card.is_neutral());
}

#[test]
fn a_silence_without_end_is_an_emergency_and_the_watchdog_takes_the_outputs_away() {
    let server = Arc::new(turning());
    let mut link = patient(&server);
    link.tolerance(Bucket::new(10, 1, 101))
        .watchdog(Duration::from_millis(500));
    let breaker = server.clone();
    let (outcome, truth, _, calls) = run(link, 1_000, move |cycle| {
        if cycle == 100 {
            assert_eq!(breaker.with_card(|card, _| card.duty(0)), 0.25);
            breaker.silence(Duration::from_secs(3_600));
        }
    });
    assert!(matches!(fault(outcome), Fault::TooManyErrors { .. }));
    assert!(
        truth.longest <= 10,
        "the rest is the emergency's: {truth:?}"
    );
    assert_eq!(calls, 1);
    wait_until(&server, |card| {
        card.watchdog().has_bitten() && card.is_neutral()
    });
}

#[test]
fn a_watchdog_that_has_bitten_ends_it() {
    let server = Arc::new(turning());
    let mut link = patient(&server);
    link.watchdog(Duration::from_millis(50));
    let breaker = server.clone();
    let (outcome, ..) = run(link, 1_000, move |cycle| {
        if cycle == 20 {
            breaker.silence(Duration::from_millis(100));
        }
    });
    assert_eq!(fault(outcome), Fault::Bitten);
    wait_until(&server, |card| card.is_neutral());
}

#[test]
fn a_card_that_was_restarted_ends_it() {
    let server = Arc::new(turning());
    let link = patient(&server);
    let breaker = server.clone();
    let (outcome, ..) = run(link, 1_000, move |cycle| {
        if cycle == 20 {
            breaker.power_cycle();
        }
    });
    assert_eq!(fault(outcome), Fault::Foreign);
    wait_until(&server, |card| card.is_neutral());
}

#[test]
fn a_card_that_was_restarted_ends_a_link_without_outputs_too() {
    let server = Arc::new(turning());
    let (count, counts) = samples();
    let mut link = patient(&server);
    link.encoder(0, FASTEST, count).latch_index(0);
    let process = link.process().unwrap();
    let mut system = System::new("test");
    let main = system.executor("main").build().unwrap();
    let breaker = server.clone();
    main.process("control").spawn_ok(async move {
        let mut truth = Truth::default();
        for cycle in 0..1_000 {
            if cycle == 20 {
                breaker.power_cycle();
            }
            let sample = counts.recv().await?;
            // Its control register is 0 now, which looks like a completed latch.
            assert_eq!(sample.held().index, None);
            truth.check(sample);
        }
        Ok(())
    });
    main.process("card").spawn_ok(process);
    assert_eq!(fault(system.run()), Fault::Foreign);
}

/// A controller that sends one set-point to each actuator, and then only reads, for `cycles`.
fn hung(mut link: Link, cycles: u32) -> luna::Result<Report> {
    let (count, counts) = samples();
    let (duty, duties) = register::<f64>();
    let (enable, enables) = register::<bool>();
    let (level, levels) = register::<bool>();
    link.encoder(0, FASTEST, count)
        .pwm_with_enable(0, duties, enables)
        .output(12, false, levels);
    let process = link.process().unwrap();
    let mut system = System::new("test");
    let main = system.executor("main").build().unwrap();
    main.process("control").spawn_ok(async move {
        duty.send(0.9).await?;
        enable.send(true).await?;
        level.send(true).await?;
        for _ in 0..cycles {
            counts.recv().await?;
        }
        Ok(())
    });
    main.process("card").spawn_ok(process);
    system.run()
}

#[test]
fn a_controller_that_hangs_does_not_drive_for_ever() {
    for late in [Actuator::Pwm(0), Actuator::Enable(0), Actuator::Output(12)] {
        let server = turning();
        let mut link = patient(&server);
        link.greatest_age(Actuator::Pwm(0), None)
            .greatest_age(Actuator::Output(12), None)
            .greatest_age(late, Some(PERIOD * 20));
        let overdue = Fault::Overdue {
            actuator: late,
            cycles: 21,
        };
        assert_eq!(fault(hung(link, u32::MAX)), overdue);
        wait_until(&server, |card| card.is_neutral());
    }
}

#[test]
fn the_watchdogs_time_is_the_greatest_age_if_none_is_stated() {
    let server = turning();
    let mut link = patient(&server);
    link.watchdog(PERIOD * 500);
    let overdue = Fault::Overdue {
        actuator: Actuator::Pwm(0),
        cycles: 501,
    };
    assert_eq!(fault(hung(link, u32::MAX)), overdue);
}

#[test]
fn what_is_set_once_stays_if_it_has_no_greatest_age() {
    let server = turning();
    let mut link = patient(&server);
    link.watchdog(PERIOD * 500)
        .greatest_age(Actuator::Pwm(0), None)
        .greatest_age(Actuator::Output(12), None);
    assert_eq!(hung(link, 600).unwrap().end, End::Completed);
}

#[test]
fn another_master_ends_it() {
    let server = Arc::new(turning());
    let link = patient(&server);
    let address = server.address();
    let mut others = None;
    let (outcome, ..) = run(link, 1_000, move |cycle| {
        if cycle == 20 {
            let (_duty, duties) = register();
            let mut other = Card::open(address).unwrap().link("other", PERIOD);
            other.pwm(1, duties);
            // Kept alive: its end would make the watchdog expire.
            others = Some(other.process().unwrap());
        }
        assert_eq!(others.is_some(), cycle >= 20);
    });
    assert_eq!(fault(outcome), Fault::Foreign);
}

#[test]
fn lost_counts_end_it() {
    let server = Arc::new(turning());
    let link = patient(&server);
    let breaker = server.clone();
    let (outcome, ..) = run(link, 1_000, move |cycle| {
        if cycle == 20 {
            breaker.with_card(|card, _| card.disturb_encoder(0));
        }
    });
    let lost = Fault::Encoder {
        encoder: 0,
        why: Lost::Quadrature,
    };
    assert_eq!(fault(outcome), lost);
}

#[test]
fn a_silence_in_which_the_counter_may_wrap_ends_it() {
    let server = Arc::new(turning());
    let link = patient(&server);
    let breaker = server.clone();
    // It may wrap within 0.55 s.
    let (outcome, ..) = run_with(60_000.0, link, 2_000, move |cycle| {
        if cycle == 20 {
            breaker.silence(Duration::from_millis(700));
        }
    });
    let lost = Fault::Encoder {
        encoder: 0,
        why: Lost::Wrapped,
    };
    assert_eq!(fault(outcome), lost);
}

#[test]
fn an_absent_card_is_reported_with_the_networks_error() {
    let mut server = Some(turning());
    let mut link = patient(server.as_ref().unwrap());
    link.tolerance(Bucket::new(1, 1, 250));
    let (outcome, _, health, calls) = run(link, 1_000, move |cycle| {
        if cycle == 20 {
            luna::realtime::off_path(|| drop(server.take()));
        }
    });
    assert!(matches!(fault(outcome), Fault::TooManyErrors { .. }));
    assert!(health.refused() > 0);
    assert_eq!(calls, 1);
}

#[test]
fn opening_an_absent_card_fails() {
    let address = turning().address();
    // The server has ended with the statement above.
    let error = Card::open(address).unwrap_err();
    assert!(error.to_string().contains("did not answer"), "{error}");
}
