//! The connections of a link, its begin and its end.

use crate::common;
use common::{PERIOD, SpawnOk, patient, register, samples, turning, wait_until};
use luna::prelude::*;
use luna_mesa::{Actuator, Card, LayoutError, LinkError, Reading, Sample};
use luna_mesa_sim::{Card as SimCard, Server, Settings};
use std::sync::Arc;
use std::time::Duration;

#[test]
fn pins_duties_and_enables_go_where_they_are_connected_to() {
    let server = Arc::new(turning());
    server.with_card(|card, _| card.set_level(14, false));
    let (duty, duties) = register();
    let (wrong, wrongs) = register();
    let (enable, enables) = register();
    let (level, levels) = register();
    let (_other, others) = register();
    let (low, lows) = register::<Sample<bool>>();
    let (high, highs) = register::<Sample<bool>>();
    let mut link = patient(&server);
    link.pwm_with_enable(1, duties, enables)
        .pwm(2, wrongs)
        .output(12, false, levels)
        .output(13, true, others)
        .input(14, low)
        .input(33, high);
    let process = link.process().unwrap();
    let health = process.health();
    let looked = server.clone();
    let mut system = System::new("test");
    let main = system.executor("main").build().unwrap();
    main.process("control").spawn_ok(async move {
        lows.recv().await?;
        assert!(
            looked.with_card(|card, _| card.driven_level(12) == Some(false)
                && card.driven_level(13) == Some(true)
                && card.duty(1) == 0.0)
        );
        duty.send(-0.5).await?;
        wrong.send(f64::NAN).await?;
        level.send(true).await?;
        until(&looked, &lows, |card| card.driven_level(12) == Some(true)).await?;
        assert_eq!(looked.with_card(|card, _| card.duty(1)), 0.0, "not enabled");
        enable.send(true).await?;
        until(&looked, &lows, |card| card.duty(1) == -0.5).await?;
        assert_eq!(looked.with_card(|card, _| card.duty(2)), 0.0);
        duty.send(7.0).await?;
        until(&looked, &lows, |card| card.duty(1) == 4095.0 / 4096.0).await?;
        // Its writer goes: it is off, the others stay.
        drop(enable);
        until(&looked, &lows, |card| card.duty(1) == 0.0).await?;
        assert!(!looked.with_card(|card, _| card.is_neutral()));
        let levels = [lows.recv().await?, highs.recv().await?];
        assert_eq!(levels.map(|sample| sample.held()), [false, true]);
        Ok(())
    });
    main.process("card").spawn_ok(process);
    drop(_other);
    system.run().unwrap();
    assert!(health.not_finite() > 0);
    wait_until(&server, SimCard::is_neutral);
}

/// Waits for cycles until the card is so.
async fn until(
    server: &Server,
    cycles: &Receiver<Sample<bool>>,
    is_so: impl Fn(&SimCard) -> bool,
) -> luna::Result<()> {
    for _ in 0..2_000 {
        if server.with_card(|card, _| is_so(card)) {
            return Ok(());
        }
        cycles.recv().await?;
    }
    panic!("it never came to be so");
}

/// So slow that the link's counter may be unread for half a minute, as on a busy machine.
const SLOW: f64 = 1_000.0;

/// Turns encoder 3, which is at position 0 at count `zero`, to a count. Returns the position read
/// there.
async fn turn(
    server: &Server,
    counts: &Receiver<Sample<Reading>>,
    zero: i64,
    to: i64,
) -> luna::Result<Reading> {
    loop {
        let read = counts.recv().await?.held();
        let at = zero + read.position;
        if at == to {
            return Ok(read);
        }
        // As far as it may go between any two readings.
        let next = (at + 4).min(to);
        server.with_card(|card, now| card.turn_encoder(3, next, now));
    }
}

#[test]
fn the_index_is_latched_once() {
    let server = Arc::new(Server::start(Settings::default()).unwrap());
    server.with_card(|card, now| {
        card.turn_encoder(3, 990, now);
        card.set_index(3, 1_000);
    });
    let (count, counts) = samples();
    let mut link = patient(&server);
    link.encoder(3, SLOW, count).latch_index(3);
    let process = link.process().unwrap();
    let mut system = System::new("test");
    let main = system.executor("main").build().unwrap();
    main.process("card").spawn_ok(process);
    main.process("control").spawn_ok(async move {
        let first = counts.recv().await?.held();
        assert_eq!((first.position, first.index), (0, None));
        for (to, position, index) in [
            (995, 5, None),
            (1_020, 30, Some(10)),
            (2_050, 1_060, Some(10)),
        ] {
            let read = turn(&server, &counts, 990, to).await?;
            assert_eq!((read.position, read.index), (position, index));
        }
        Ok(())
    });
    // The link has no actuator: it ends with its readers.
    system.run().unwrap();
}

#[test]
fn an_index_passed_before_the_start_is_ignored() {
    let server = Arc::new(Server::start(Settings::default()).unwrap());
    server.with_card(|card, now| {
        card.turn_encoder(3, 990, now);
        card.set_index(3, 1_000);
    });
    let (count, counts) = samples();
    let mut link = patient(&server);
    link.encoder(3, SLOW, count).latch_index(3);
    let process = link.process().unwrap();
    // More than half of the counter's range from the index that it passes.
    server.with_card(|card, now| card.turn_encoder(3, 41_500, now));
    let mut system = System::new("test");
    let main = system.executor("main").build().unwrap();
    main.process("card").spawn_ok(process);
    main.process("control").spawn_ok(async move {
        let first = counts.recv().await?.held();
        assert_eq!((first.position, first.index), (0, None));
        for (to, position, index) in [(41_600, 100, None), (42_010, 510, Some(500))] {
            let read = turn(&server, &counts, 41_500, to).await?;
            assert_eq!((read.position, read.index), (position, index));
        }
        Ok(())
    });
    system.run().unwrap();
}

#[test]
fn an_emergency_takes_the_outputs_away_for_good() {
    let server = turning();
    let (duty, duties) = register();
    let (count, counts) = samples();
    let mut link = patient(&server);
    let in_use = Arc::new(());
    link.pwm(0, duties).encoder(0, common::FASTEST, count);
    link.keep(in_use.clone());
    let process = link.process().unwrap();
    let neutral = process.neutral();
    let mut system = System::new("test");
    system.on_emergency("card", {
        let neutral = neutral.clone();
        move || neutral.engage()
    });
    let main = system.executor("main").build().unwrap();
    main.process("card").spawn_ok(process);
    main.process("control").spawn_ok(async move {
        for _ in 0..20 {
            counts.recv().await?;
            duty.send(0.5).await?;
        }
        Err(luna::emergency(luna::Error::other("enough")))
    });
    assert_eq!(Arc::strong_count(&in_use), 2);
    assert!(system.run().is_err());
    assert!(neutral.is_engaged());
    assert_eq!(Arc::strong_count(&in_use), 1);
    wait_until(&server, SimCard::is_neutral);
    // Whatever of the cycles may still come: the pins stay inputs.
    let mut client = hostmot2::Client::connect(server.address()).unwrap();
    let mut late = hostmot2::lbp16::Packet::new();
    late.write_register(0x0E00, 0x5A00_0000).unwrap();
    late.write_register(0x4000, hostmot2::pwm::value(0.5))
        .unwrap();
    late.write_register(0x4400, 1).unwrap();
    client.confirmed(&late).unwrap();
    assert!(server.with_card(|card, _| card.is_neutral()));
}

#[test]
fn impossible_selections_are_reported_at_set_up() {
    let server = turning();
    let open = || Card::open(server.address()).unwrap().link("card", PERIOD);
    let refused = |link: luna_mesa::Link| link.process().unwrap_err();

    let mut link = open();
    link.encoder(4, 1e6, samples().0);
    let error = refused(link);
    assert!(matches!(
        error,
        LinkError::Layout(LayoutError::TooFew {
            asked: 5,
            there: 4,
            ..
        })
    ));
    assert!(
        error.to_string().contains("4 encoders, 5 are requested"),
        "{error}"
    );

    let mut link = open();
    link.output(34, false, register().1);
    assert!(matches!(
        refused(link),
        LinkError::Layout(LayoutError::NoPin { pin: 34 })
    ));

    let mut link = open();
    link.input(34, register().0);
    assert!(matches!(
        refused(link),
        LinkError::Layout(LayoutError::NoPin { pin: 34 })
    ));

    // Pin 3 is PWM generator 0's.
    let mut link = open();
    link.pwm(0, register().1).output(3, false, register().1);
    assert!(matches!(
        refused(link),
        LinkError::Layout(LayoutError::PinTaken { pin: 3 })
    ));

    let mut link = open();
    link.pwm(0, register().1).pwm(0, register().1);
    assert!(matches!(refused(link), LinkError::Setting(_)));

    let mut link = open();
    link.watchdog(PERIOD * 2);
    assert!(matches!(refused(link), LinkError::Setting(_)));

    let mut link = open();
    link.watchdog(Duration::from_secs(60));
    assert!(matches!(
        refused(link),
        LinkError::Layout(LayoutError::WatchdogTime { .. })
    ));

    for (actuator, age) in [
        (Actuator::Pwm(0), Some(PERIOD / 2)),
        (Actuator::Pwm(1), Some(PERIOD)),
        (Actuator::Enable(0), None),
        (Actuator::Output(0), None),
    ] {
        let mut link = open();
        link.pwm(0, register().1).greatest_age(actuator, age);
        assert!(matches!(refused(link), LinkError::Setting(_)), "{actuator}");
    }

    for patience in [0.0, 1.0, f64::NAN] {
        let mut link = open();
        link.patience(patience);
        assert!(matches!(refused(link), LinkError::Setting(_)));
    }
}
