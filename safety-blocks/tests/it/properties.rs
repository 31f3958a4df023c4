//! Properties for all inputs: limits, rates, no false alarm within the documented bounds, and each
//! fault found within its bound.

use crate::common;
use common::seeded;
use luna_safety_blocks::{
    Agreement, Alarm, Block, Blocked, Chain, DeadMan, Disagreement, EndStop, Fault, Frozen, Limit,
    MaxRate, Noise, Range, RateLimit, Reaction, Reactor, Recovery, Response, Sample, Timeout,
    Verdict, Vote,
};
use proptest::prelude::*;
use std::time::Duration;

const MS: Duration = Duration::from_millis(1);

/// Any number: the odd ones often.
fn any_number() -> impl Strategy<Value = f64> {
    prop_oneof![
        4 => -3.0..3.0f64,
        1 => any::<f64>(),
        1 => prop::sample::select(vec![
            f64::NAN, f64::INFINITY, f64::NEG_INFINITY, 0.0, -0.0, f64::MAX, f64::MIN, f64::MIN_POSITIVE, 5e-324,
        ]),
    ]
}

fn any_elapsed() -> impl Strategy<Value = Duration> {
    prop_oneof![
        3 => 0u64..5_000_000,
        1 => prop::sample::select(vec![0, 1, 1_000_000_000, u64::MAX]),
    ]
    .prop_map(Duration::from_nanos)
}

fn any_sample() -> impl Strategy<Value = Sample> {
    let feedback = prop_oneof![4 => any_number().prop_map(Some), 1 => Just(None)];
    (any_number(), feedback, any_elapsed()).prop_map(|(value, feedback, elapsed)| Sample {
        value,
        feedback,
        elapsed,
    })
}

fn samples() -> impl Strategy<Value = Vec<Sample>> {
    prop::collection::vec(any_sample(), 1..80)
}

fn any_response() -> impl Strategy<Value = Response> {
    let reaction =
        prop::sample::select(vec![Reaction::Warn, Reaction::Neutral, Reaction::Emergency]);
    let recovery = prop_oneof![
        Just(Recovery::Reset),
        (0u32..20).prop_map(|ms| Recovery::After(ms * MS)),
    ];
    let limited = prop::option::of((0u32..20).prop_map(|ms| ms * MS));
    (reaction, recovery, limited).prop_map(|(reaction, recovery, limited)| {
        let response = Response::new(reaction).recovery(recovery);
        limited.map_or(response, |time| response.limited_for(time))
    })
}

/// One of each kind, for limits within -1 to 1.
fn all_blocks() -> Vec<(&'static str, Box<dyn Block + Send>)> {
    vec![
        ("limit", Box::new(Limit::new(-1.0, 1.0).unwrap())),
        ("rate", Box::new(RateLimit::new(10.0).unwrap())),
        ("end stop", Box::new(EndStop::new(-1.0, 1.0).unwrap())),
        ("range", Box::new(Range::new(-1.0, 1.0).unwrap())),
        ("largest rate", Box::new(MaxRate::new(10.0).unwrap())),
        ("frozen", Box::new(Frozen::new(0.0, MS).unwrap())),
        ("noise", Box::new(Noise::new(0.1, 10).unwrap())),
        ("apart", Box::new(Disagreement::new(0.1, MS).unwrap())),
        ("blocked", Box::new(Blocked::new(0.1, 0.1, MS).unwrap())),
    ]
}

fn steps(block: &mut impl Block, samples: impl IntoIterator<Item = Sample>) -> Option<usize> {
    samples
        .into_iter()
        .position(|sample| matches!(block.step(&sample), Verdict::Refused(_)))
}

proptest! {
    #![proptest_config(seeded())]

    /// No block lets a value pass that is not finite, or accepts a sample that is not finite.
    #[test]
    fn what_is_not_finite_never_passes(samples in samples()) {
        for (name, mut block) in all_blocks() {
            for sample in &samples {
                let verdict = block.step(sample);
                if let Some(fault) = sample.not_finite() {
                    // By its text, since NaN is not equal to itself.
                    prop_assert_eq!(format!("{verdict:?}"), format!("{:?}", Verdict::Refused(fault)), "{}", name);
                }
                prop_assert!(verdict.or(0.0).is_finite(), "{}", name);
            }
        }
    }

    /// A chain of all blocks in any order (but the end stop behind the rate limit), with any
    /// responses, puts out finite values within the limits, no faster than allowed.
    #[test]
    fn a_chain_keeps_its_limits_whatever_comes(
        samples in samples(),
        order in Just((0..9).collect::<Vec<usize>>()).prop_shuffle(),
        responses in prop::collection::vec(any_response(), 9),
    ) {
        let mut order = order;
        let at = |block| order.iter().position(|&one| one == block).unwrap();
        let (rate, stop) = (at(1), at(2));
        (order[rate.min(stop)], order[rate.max(stop)]) = (1, 2);
        let mut chain = Chain::new(0.0).unwrap();
        let mut blocks: Vec<_> = all_blocks().into_iter().map(Some).collect();
        for (&index, response) in order.iter().zip(&responses) {
            let (name, block) = blocks[index].take().unwrap();
            chain = chain.then(name, block, *response).unwrap();
        }
        let mut last = 0.0;
        for sample in &samples {
            let out = chain.step(sample, |_| {});
            prop_assert!((-1.0..=1.0).contains(&out), "{out}");
            // To neutral it may go at once.
            let change = 10.0 * sample.elapsed.as_secs_f64();
            prop_assert!(out == 0.0 || (out - last).abs() <= change + 1e-12, "{last} to {out}");
            // Never into the stop.
            let into = sample.feedback.is_none_or(|at| !at.is_finite() || at >= 1.0 && out > 0.0 || at <= -1.0 && out < 0.0);
            prop_assert!(out == 0.0 || !into, "{out} at {:?}", sample.feedback);
            last = out;
        }
    }

    /// With the limit first, neutral too is come to at the rate.
    #[test]
    fn a_rate_is_kept_to_neutral_too_if_it_stands_last(samples in samples(), response in any_response()) {
        let mut chain = Chain::new(0.0).unwrap()
            .then("limit", Limit::new(-1.0, 1.0).unwrap(), response).unwrap()
            .then("rate", RateLimit::new(10.0).unwrap(), Reaction::Warn).unwrap();
        let (mut last, mut is_over) = (0.0, false);
        for sample in samples {
            let sample = Sample { feedback: None, ..sample };
            let out = chain.step(&sample, |alarm| is_over |= alarm.reaction == Reaction::Emergency);
            if is_over {
                break; // The system ends, and nothing is put out any more.
            }
            let change = 10.0 * sample.elapsed.as_secs_f64();
            prop_assert!(f64::abs(out - last) <= change * (1.0 + 1e-12) + 1e-15, "{last} to {out}");
            last = out;
        }
    }

    /// A limiter changes nothing that is in order.
    #[test]
    fn what_is_in_order_passes_unchanged(
        values in prop::collection::vec(-1.0..=1.0f64, 1..50), position in -0.999..0.999f64,
    ) {
        let mut limit = Limit::new(-1.0, 1.0).unwrap();
        let mut rate = RateLimit::new(2.0).unwrap();
        let mut stop = EndStop::new(-1.0, 1.0).unwrap();
        for value in values {
            let sample = Sample::new(value, Duration::from_secs(1)).beside(position);
            prop_assert_eq!(limit.step(&sample), Verdict::Pass(value));
            prop_assert_eq!(rate.step(&sample), Verdict::Pass(value));
            prop_assert_eq!(stop.step(&sample), Verdict::Pass(value));
        }
    }

    /// Within a stop's hysteresis a drive into it does not flicker; a drive out of it is always
    /// allowed.
    #[test]
    fn an_end_stop_does_not_flicker(noise in prop::collection::vec(-0.01..0.01f64, 1..50)) {
        let mut stop = EndStop::new(-1.0, 1.0).unwrap().hysteresis(0.02).unwrap();
        let at = |position, value| Sample::new(value, MS).beside(position);
        let _ = stop.step(&at(1.0, 0.1));
        for noise in noise {
            prop_assert_eq!(stop.step(&at(1.0 + noise, 0.1)).or(f64::NAN), 0.0);
            prop_assert_eq!(stop.step(&at(1.0 + noise, -0.1)), Verdict::Pass(-0.1));
        }
        prop_assert_eq!(stop.step(&at(0.98, 0.1)), Verdict::Pass(0.1));
    }

    /// An axis that moves at its largest speed, with jitter, is never too fast; a jump always is,
    /// in the same sample.
    #[test]
    fn jumps_are_seen_at_once_and_motion_never(
        motion in prop::collection::vec((-0.999..0.999f64, 1u64..3_000_000), 1..60), jump in prop_oneof![-9.0..-0.1f64, 0.1..9.0f64],
    ) {
        let mut block = MaxRate::new(10.0).unwrap();
        let (mut position, mut last) = (0.0, None);
        for (part, nanos) in motion {
            let elapsed = Duration::from_nanos(nanos);
            position += part * 10.0 * elapsed.as_secs_f64();
            prop_assert_eq!(block.step(&Sample::new(position, elapsed)), Verdict::Pass(position));
            last = Some(position);
        }
        let broken = Sample::new(last.unwrap() + jump, MS);
        let is_seen = matches!(block.step(&broken), Verdict::Refused(Fault::TooFast { .. }));
        prop_assert!(is_seen);
    }

    /// Noise, acceleration, and speed with jitter within the documented bounds raise no alarm;
    /// noise beyond its bound is found in time.
    #[test]
    fn noise_is_found_in_time_and_never_where_there_is_none(
        noise in prop::collection::vec(-1.0..=1.0f64, 100..400), samples in 10u32..60,
        acceleration in -20.0..20.0f64, speed in -3.0..3.0f64, amount in 1e-4..1e-1f64, outlier in prop::option::of(0usize..100),
    ) {
        let period = 1e-3;
        let level = 4.0 * amount + f64::abs(acceleration) * period * period + 1e-12;
        let mut block = Noise::new(level, samples).unwrap();
        for (n, noise) in noise.iter().enumerate() {
            let time = n as f64 * period;
            let value = speed * time + 0.5 * acceleration * time * time + amount * noise;
            prop_assert!(matches!(block.step(&Sample::new(value, MS)), Verdict::Pass(_)), "{n}");
        }
        // An outlier in silence is no noise, however large it is.
        block.reset();
        for n in 0..200 {
            let value = if Some(n) == outlier { 1e6 } else { 0.0 };
            prop_assert_eq!(block.step(&Sample::new(value, MS)), Verdict::Pass(value));
        }
        // Whatever its mean was: second differences of twice the level.
        let shaking = (0..).map(|n| Sample::new(if n % 2 == 0 { 0.5 } else { -0.5 } * level * (1.0 + 1e-6), MS));
        let found = steps(&mut block, shaking.take(1000)).unwrap() as u32 + 1;
        prop_assert!(found <= samples, "{found} of {samples}");
        prop_assert!(f64::from(found) <= (0.7 * f64::from(samples)).ceil() + 2.0, "{found} of {samples}");
    }

    /// Output without motion is found within its time and one sample, for any jitter; motion, or no
    /// drive, never is.
    #[test]
    fn a_blocked_actuator_is_found_in_time_and_a_free_one_never(
        free in prop::collection::vec((0.3..1.0f64, 1u64..2_000_000), 1..60), jitter in prop::collection::vec(1u64..2_000_000, 400), drive in 0.3..1.0f64,
    ) {
        let time = 20 * MS;
        let mut block = Blocked::new(0.3, 2e-3, time).unwrap();
        let (mut position, mut since) = (0.0, Duration::ZERO);
        for (output, nanos) in free {
            let elapsed = Duration::from_nanos(nanos);
            since += elapsed;
            // It moves just in time.
            if since >= time - 3 * MS {
                (position, since) = (position + 2.1e-3, Duration::ZERO);
            }
            prop_assert_eq!(block.step(&Sample::new(output, elapsed).beside(position)), Verdict::Pass(output));
        }
        // From here on it is jammed.
        let (mut jammed, mut longest, mut found) = (Duration::ZERO, Duration::ZERO, false);
        for nanos in jitter {
            let elapsed = Duration::from_nanos(nanos);
            jammed += elapsed;
            longest = longest.max(elapsed);
            found = matches!(block.step(&Sample::new(drive, elapsed).beside(position)), Verdict::Refused(Fault::Blocked { .. }));
            if found {
                break;
            }
        }
        prop_assert!(found && jammed <= time + longest, "{jammed:?}");
        // Nor is one that is not driven.
        block.reset();
        let rests = std::iter::repeat_n(Sample::new(0.29, MS).beside(1.0), 200);
        prop_assert_eq!(steps(&mut block, rests), None);
    }

    /// A frozen sensor is found within its time and one sample; a moving one never.
    #[test]
    fn a_frozen_sensor_is_found_in_time_and_a_live_one_never(
        values in prop::collection::vec(-1.0..1.0f64, 1..60), jitter in prop::collection::vec(1u64..2_000_000, 400),
    ) {
        let time = 10 * MS;
        let mut block = Frozen::new(1e-3, time).unwrap();
        for (n, value) in values.into_iter().enumerate() {
            // At least 2e-3 between two of them.
            let value = value + if n % 2 == 0 { 2.0 } else { -2.0 };
            prop_assert_eq!(block.step(&Sample::new(value, 9 * MS)), Verdict::Pass(value));
        }
        let (mut frozen, mut found) = (Duration::ZERO, false);
        for (n, nanos) in jitter.into_iter().enumerate() {
            let elapsed = Duration::from_nanos(nanos);
            let verdict = block.step(&Sample::new(7.0, elapsed));
            found = matches!(verdict, Verdict::Refused(Fault::Frozen { .. }));
            if found {
                prop_assert!(frozen < time && frozen + elapsed >= time);
                break;
            }
            // The first one is still a change.
            if n > 0 {
                frozen += elapsed;
            }
        }
        prop_assert!(found);
    }

    /// Two sensors may be apart for less than the time; for longer they are found within it and one
    /// sample.
    #[test]
    fn a_disagreement_is_found_in_time_and_a_short_one_never(
        short in prop::collection::vec((0u64..10, -1.0..1.0f64), 1..30), apart in prop_oneof![-5.0..-0.11f64, 0.11..5.0f64],
    ) {
        let mut block = Disagreement::new(0.1, 10 * MS).unwrap();
        for (length, value) in short {
            for _ in 0..length {
                prop_assert_eq!(block.step(&Sample::new(value, MS).beside(value + 1.0)), Verdict::Pass(value));
            }
            prop_assert_eq!(block.step(&Sample::new(value, MS).beside(value + 0.099)), Verdict::Pass(value));
        }
        let wrong = std::iter::repeat_n(Sample::new(1.0, MS).beside(1.0 + apart), 100);
        prop_assert_eq!(steps(&mut block, wrong), Some(10));
    }

    /// The output of two channels lies between their values, or between neutral and one of them.
    #[test]
    fn the_output_of_two_channels_lies_between_their_values(
        rounds in prop::collection::vec((prop::option::of(any_number()), prop::option::of(any_number()), any_elapsed()), 1..50),
        vote in prop::sample::select(vec![Vote::OneOutOfTwo, Vote::TwoOutOfTwo]), neutral in -1.0..1.0f64, tolerance in 0.0..1.0f64,
    ) {
        let mut agreement = Agreement::new(vote, neutral, tolerance, 3 * MS).unwrap();
        for (a, b, elapsed) in rounds {
            let good = |value: Option<f64>| value.filter(|value| value.is_finite());
            let out = match agreement.step(a, b, elapsed) {
                Verdict::Refused(_) => continue,
                Verdict::Pass(value) => {
                    prop_assert!(good(a).is_some() && good(b).is_some());
                    value
                }
                Verdict::Limited(value, _) => {
                    prop_assert!(vote == Vote::TwoOutOfTwo && (good(a).is_none() || good(b).is_none()));
                    value
                }
            };
            let (a, b) = (good(a).unwrap_or(out), good(b).unwrap_or(out));
            match vote {
                Vote::OneOutOfTwo => {
                    prop_assert!((out - neutral).abs() <= (a - neutral).abs() && (out - neutral).abs() <= (b - neutral).abs());
                    prop_assert!(out == a || out == b || out == neutral);
                }
                Vote::TwoOutOfTwo => prop_assert!(out == a || out == b),
            }
        }
    }

    /// A dead-man is held exactly while the key has been refreshed in time since it was pressed,
    /// and not for too long.
    #[test]
    fn a_dead_man_is_held_exactly_while_it_is(
        events in prop::collection::vec((prop::option::of(0u32..4), 0u64..40), 1..80), must_change in any::<bool>(),
    ) {
        let mut block = DeadMan::new(30 * MS).unwrap().held_at_most(200 * MS).unwrap();
        if must_change {
            block = block.must_change();
        }
        // The definition: when the key was pressed, when it was refreshed last, by which number.
        let (mut now, mut held): (u64, Option<(u64, u64, u32)>) = (0, None);
        let mut spent = false;
        for (key, ms) in events {
            now += ms;
            if held.is_some_and(|(pressed, refreshed, _)| now - refreshed >= 30 || now - pressed >= 200) {
                (held, spent) = (None, true);
            }
            match (key, &mut held) {
                (Some(0), _) => (held, spent) = (None, false),
                (Some(key), None) if !spent => held = Some((now, now, key)),
                (Some(key), Some((_, refreshed, last))) if !must_change || key != *last => (*refreshed, *last) = (now, key),
                _ => {}
            }
            let is_held = block.step(key, ms as u32 * MS).is_ok();
            prop_assert_eq!(is_held, held.is_some(), "at {} ms", now);
            prop_assert_eq!(block.expires_in().is_some(), is_held);
        }
    }

    /// Set-points that come in time pass; silence is found when the time is over, and not before.
    #[test]
    fn silence_is_seen_exactly_when_its_time_is_over(gaps in prop::collection::vec(0u64..50, 1..50), silent in 0u64..100) {
        let mut timeout = Timeout::new(50 * MS, -1.0).unwrap();
        for (n, gap) in gaps.iter().enumerate() {
            prop_assert_eq!(timeout.step(Some(n as f64), *gap as u32 * MS), Verdict::Pass(n as f64));
        }
        let verdict = timeout.step(None, silent as u32 * MS);
        prop_assert_eq!(matches!(verdict, Verdict::Refused(_)), silent >= 50);
    }

    /// Neutral is held from a fault until samples have been good for the set time without a break;
    /// the output is always finite.
    #[test]
    fn neutral_is_held_until_it_has_recovered(faults in prop::collection::vec(any::<bool>(), 1..200), hold in 0usize..20) {
        let response = Response::new(Reaction::Neutral).recovery(Recovery::After(hold as u32 * MS));
        let mut reactor = Reactor::new("any", -7.0, response).unwrap();
        let mut good = usize::MAX;
        for is_bad in faults {
            let verdict = if is_bad { Verdict::Refused(Fault::NoFeedback) } else { Verdict::Pass(1.0) };
            let (value, alarm): (f64, Option<Alarm>) = reactor.react(verdict, 1.0, MS);
            let was_good = good > hold;
            good = if is_bad { 0 } else { good.saturating_add(1) };
            // The first good one counts as no time yet.
            prop_assert_eq!(value, if good > hold { 1.0 } else { -7.0 });
            prop_assert_eq!(alarm.is_some(), was_good && is_bad);
            prop_assert_eq!(reactor.monitor().is_held(), value == -7.0);
        }
    }
}

#[test]
fn a_reset_clears_a_fault_and_a_lasting_fault_is_found_again() {
    let mut chain = Chain::new(0.0)
        .unwrap()
        .then(
            "motion",
            Blocked::new(0.3, 1e-3, 5 * MS).unwrap(),
            Reaction::Neutral,
        )
        .unwrap();
    let monitor = chain.monitor("motion").unwrap();
    let jammed = Sample::new(0.5, MS).beside(0.1);
    for round in 0..3 {
        let mut alarms = 0;
        let free = (0..20).filter(|_| chain.step(&jammed, |_| alarms += 1) == 0.5);
        // The first sample as the reference, and five less the one at which it is found.
        assert_eq!((free.count(), alarms), (5, 1), "round {round}");
        assert!(monitor.is_held());
        monitor.reset();
    }
}

#[test]
fn limiting_for_too_long_is_a_fault_in_the_end() {
    let response = Response::new(Reaction::Neutral).limited_for(10 * MS);
    let limit = Limit::new(-1.0, 1.0).unwrap();
    let mut chain = Chain::new(0.0)
        .unwrap()
        .then("limit", limit, response)
        .unwrap();
    let mut put_out = |value| chain.step(&Sample::new(value, MS), |_| {});
    for n in 0..100 {
        // Each tenth is in order.
        let expected = if n % 10 == 9 { 0.5 } else { 1.0 };
        assert_eq!(put_out(if n % 10 == 9 { 0.5 } else { 2.0 }), expected);
    }
    let limited = (0..).take_while(|_| put_out(2.0) == 1.0).count();
    assert_eq!(limited, 10);
    assert_eq!(put_out(0.5), 0.0);
}

#[test]
fn parameters_that_make_no_sense_are_refused_with_what_is_allowed() {
    let nan = f64::NAN;
    for bad in [nan, f64::INFINITY, -1.0] {
        for error in [
            Limit::new(0.0, bad).unwrap_err(),
            Range::new(0.0, bad).unwrap_err(),
            EndStop::new(0.0, bad).unwrap_err(),
            EndStop::new(0.0, 1.0).unwrap().hysteresis(bad).unwrap_err(),
            RateLimit::new(bad).unwrap_err(),
            MaxRate::new(bad).unwrap_err(),
            Frozen::new(bad, MS).unwrap_err(),
            Frozen::new(0.0, MS).unwrap().while_driven(bad).unwrap_err(),
            Noise::new(bad, 10).unwrap_err(),
            Disagreement::new(bad, MS).unwrap_err(),
            Blocked::new(bad, 0.0, MS).unwrap_err(),
            Blocked::new(1.0, bad, MS).unwrap_err(),
            Agreement::new(Vote::OneOutOfTwo, 0.0, bad, MS).unwrap_err(),
        ] {
            let text = error.to_string();
            assert!(
                text.contains(&format!("is {bad}")) && text.contains("allowed is"),
                "{text}"
            );
        }
    }
    let zero = Duration::ZERO;
    for error in [
        Frozen::new(0.0, zero).unwrap_err(),
        Blocked::new(1.0, 0.0, zero).unwrap_err(),
        Timeout::new(zero, 0.0).unwrap_err(),
        Timeout::new(MS, 0.0).unwrap().repeat(zero).unwrap_err(),
        DeadMan::new(zero).unwrap_err(),
        DeadMan::new(MS).unwrap().held_at_most(zero).unwrap_err(),
        RateLimit::new(1.0).unwrap().longest(zero).unwrap_err(),
    ] {
        assert!(
            error
                .to_string()
                .contains("is 0ns, allowed is a time above zero"),
            "{error}"
        );
    }
    let few = Noise::new(1.0, 9).unwrap_err();
    assert_eq!(
        few.to_string(),
        "noise: samples is 9, allowed is 10 or more"
    );
    // Neutral must be what the blocks let pass.
    let chain = || Chain::new(2.0).unwrap();
    let limit = Limit::new(-1.0, 1.0).unwrap();
    assert!(chain().then("limit", limit, Reaction::Warn).is_err());
    let stop = EndStop::new(-1.0, 1.0).unwrap();
    assert!(chain().then("stop", stop, Reaction::Warn).is_err());
    assert!(Chain::new(nan).is_err() && Timeout::new(MS, nan).is_err());
    assert!(Agreement::new(Vote::OneOutOfTwo, nan, 0.0, MS).is_err());
}
