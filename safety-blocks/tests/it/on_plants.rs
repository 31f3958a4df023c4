//! Each block on a plant with its fault injected, step by step.

use luna_plants::{Checked, FirstOrderLag, Motor, MotorState, PAN, Port};
use luna_safety_blocks::{
    Agreement, Block, Blocked, Chain, DeadMan, Disagreement, EndStop, Fault, Frozen, Limit,
    MaxRate, Range, RateLimit, Reaction, Recovery, Response, Sample, Verdict, Vote,
};
use std::time::Duration;

const MS: Duration = Duration::from_millis(1);

fn refuses(verdict: Verdict) -> bool {
    matches!(verdict, Verdict::Refused(_))
}

/// Steps a motor by a millisecond at `duty`.
fn drive(motor: &mut Motor, duty: f64) -> MotorState {
    motor.drive(duty, 1e-3);
    motor.state()
}

#[test]
fn limits_keep_a_controller_gone_mad_within_current_and_slope() {
    let mut chain = Chain::new(0.0)
        .unwrap()
        .then("limit", Limit::new(-0.3, 0.3).unwrap(), Reaction::Warn)
        .unwrap()
        .then("rate", RateLimit::new(5.0).unwrap(), Reaction::Warn)
        .unwrap();
    let mut motor = Motor::new(PAN);
    let mad = [1e9, -1e9, f64::NAN, f64::INFINITY, 0.7, f64::NEG_INFINITY];
    let mut last = 0.0;
    for n in 0..3000 {
        let asked = mad[(n / 70) % mad.len()];
        let duty = chain.step(&Sample::new(asked, MS), |_| {});
        assert!(
            duty.abs() <= 0.3 && f64::abs(duty - last) <= 5e-3 + 1e-12,
            "{duty}"
        );
        last = duty;
        let state = drive(&mut motor, duty);
        // At most the current that its part of the supply drives through the armature, with a
        // back-EMF of the same size against it.
        assert!(state.current.abs() <= 2.0 * 0.3 * PAN.supply / PAN.resistance);
    }
}

#[test]
fn an_end_stop_lets_the_axis_out_again() {
    let mut stop = EndStop::new(-1.3, 1.3).unwrap();
    let mut motor = Motor::new(PAN);
    let mut furthest = 0.0_f64;
    let mut run = |asked: f64, motor: &mut Motor| {
        for _ in 0..3000 {
            let sample = Sample::new(asked, MS).beside(motor.state().angle);
            let state = drive(motor, stop.step(&sample).or(0.0));
            furthest = furthest.max(state.angle.abs());
        }
        motor.state().angle
    };
    assert!(run(0.2, &mut motor) > 1.3);
    assert!(run(-0.2, &mut motor) < -1.3);
    assert!(furthest < PAN.end_stop, "{furthest}");
}

#[test]
fn a_broken_wire_switches_the_oven_off_at_once() {
    let oven = FirstOrderLag::new(
        Port::new("power", "W"),
        Port::new("temperature", "K"),
        1.0,
        Duration::from_secs(2),
    );
    let mut oven = Checked::new(oven);
    // A chain for a measurement: an impossible value is replaced by one that is far too hot.
    let mut chain = Chain::new(1000.0)
        .unwrap()
        .then("wire", Range::new(-20.0, 300.0).unwrap(), Reaction::Neutral)
        .unwrap();
    let mut hottest = 0.0_f64;
    for n in 0..10_000 {
        let temperature = oven.get("temperature").unwrap();
        hottest = hottest.max(temperature);
        let wire = if n < 2000 { temperature } else { -250.0 };
        let mut alarm = None;
        let measured = chain.step(&Sample::new(wire, MS), |new| alarm = Some(new));
        assert_eq!(alarm.is_some(), n == 2000);
        let power = (20.0 * (80.0 - measured)).max(0.0);
        oven.set("power", power).unwrap();
        oven.step(MS).unwrap();
    }
    // Without, it would have been driven by 6 600 W.
    assert!(hottest < 80.0);
    assert!(oven.get("temperature").unwrap() < 2.0);
}

/// The number of samples from the fault until `block` refuses a motor's angle as measured by
/// `sensor`; the motor runs to and fro.
fn found(
    mut block: impl Block,
    sample: impl Fn(MotorState, MotorState, f64) -> Sample,
) -> Option<usize> {
    let mut motor = Motor::new(PAN);
    let mut at_fault = MotorState::default();
    for n in 0..2000 {
        let duty = 0.4 * (f64::from(n) * 0.01).sin();
        let state = drive(&mut motor, duty);
        if n <= 1100 {
            at_fault = state;
        }
        let is_refused = refuses(block.step(&sample(at_fault, state, duty)));
        match n > 1100 {
            false => assert!(!is_refused, "a false alarm after {n} samples"),
            true if is_refused => return Some(n as usize - 1100),
            true => {}
        }
    }
    None
}

#[test]
fn a_frozen_encoder_is_found_by_each_block_that_can() {
    // Driven it moves by more than this in 30 ms. At 1100 it is driven hard.
    let frozen = Frozen::new(2e-3, 30 * MS)
        .unwrap()
        .while_driven(0.3)
        .unwrap();
    let seen = found(frozen, |frozen, _, duty| {
        Sample::new(frozen.angle, MS).beside(duty)
    });
    assert!((30..=31).contains(&seen.unwrap()), "{seen:?}");
    let blocked = Blocked::new(0.3, 2e-3, 30 * MS).unwrap();
    let seen = found(blocked, |frozen, _, duty| {
        Sample::new(duty, MS).beside(frozen.angle)
    });
    assert!((30..=31).contains(&seen.unwrap()), "{seen:?}");
    let apart = Disagreement::new(0.02, 5 * MS).unwrap();
    let seen = found(apart, |frozen, now, _| {
        Sample::new(frozen.angle, MS).beside(now.angle)
    });
    assert!((6..=40).contains(&seen.unwrap()), "{seen:?}");
    // No jump, and within its range: these do not see it.
    let fastest = MaxRate::new(15.0).unwrap();
    let sample = |frozen: MotorState, _: MotorState, _: f64| Sample::new(frozen.angle, MS);
    assert_eq!(found(fastest, sample), None);
    assert_eq!(found(Range::new(-1.5, 1.5).unwrap(), sample), None);
}

#[test]
fn a_blocked_axis_is_tried_again_after_its_time() {
    let response = Response::new(Reaction::Neutral).recovery(Recovery::After(100 * MS));
    let mut chain = Chain::new(0.0)
        .unwrap()
        .then(
            "motion",
            Blocked::new(0.3, 1e-3, 50 * MS).unwrap(),
            response,
        )
        .unwrap();
    // Held at a stop: the motor pushes, and does not move.
    let mut motor = Motor::new(PAN).starting_at(MotorState {
        angle: PAN.end_stop + 0.005,
        ..MotorState::default()
    });
    for _ in 0..500 {
        drive(&mut motor, 0.5);
    }
    let mut tries = Vec::new();
    let mut last = 0.0;
    for n in 0..400 {
        let sample = Sample::new(0.5, MS).beside(motor.state().angle);
        let duty = chain.step(&sample, |_| {});
        if (duty == 0.0) != (last == 0.0) {
            tries.push(n);
        }
        last = duty;
        // What the blocks put out does not let it spring back here: it is jammed.
        drive(&mut motor, 0.5);
    }
    // Driven for 50 ms, off for 100 and the sample that shows it to be good, and again.
    assert_eq!(tries, [0, 50, 151, 201, 302, 352]);
}

#[test]
fn a_channel_that_sticks_is_found_and_neither_drives_the_axis_alone() {
    let mut vote = Agreement::new(Vote::OneOutOfTwo, 0.0, 0.05, 10 * MS).unwrap();
    let mut motor = Motor::new(PAN);
    let mut found = None;
    for n in 0..1000 {
        let controller = |angle: f64| 2.0 * (0.5 * (f64::from(n) * 5e-3).sin() - angle);
        let a = controller(motor.state().angle);
        // B sticks at full drive.
        let b = if n < 300 { a + 0.01 } else { 1.0 };
        let verdict = vote.step(Some(a), Some(b), MS);
        if refuses(verdict) {
            found.get_or_insert(n);
        }
        let duty = verdict.or(0.0);
        assert!(duty.abs() <= a.abs(), "{duty}, {a}");
        drive(&mut motor, duty);
    }
    assert_eq!(found, Some(310));
}

#[test]
fn the_motor_stands_still_while_the_key_is_not_held() {
    let mut grip = DeadMan::new(50 * MS).unwrap().must_change();
    let mut motor = Motor::new(PAN);
    let mut let_go = None;
    for n in 0..1000u32 {
        // It is refreshed each 20 ms; after 300 ms the console repeats itself.
        let key = n.is_multiple_of(20).then(|| 1 + (n / 20).min(15));
        let held = grip.step(key, MS);
        if let Err(fault) = held {
            let_go.get_or_insert((n, fault));
        }
        drive(&mut motor, if held.is_ok() { 0.3 } else { 0.0 });
    }
    let silent = Fault::Silent {
        time: 50 * MS,
        limit: 50 * MS,
    };
    assert_eq!(let_go, Some((350, silent)));
    assert_eq!(motor.state().speed, 0.0);
}
