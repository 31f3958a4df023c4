use super::*;
use proptest::prelude::*;

const MHZ: f64 = 1e6;
const MS: Duration = Duration::from_millis(1);

fn raw(count: u16, stamp: u16) -> RawEncoder {
    RawEncoder {
        count,
        stamp,
        index: None,
        quadrature_error: false,
    }
}

#[test]
fn follows_over_wraps_both_ways() {
    for step in [700_i64, -700] {
        let (mut tracker, mut stamps) = (Tracker::new(1e6), Stamps::new(MHZ));
        for n in 0..1_000_i64 {
            let position = step * n;
            stamps.update((n * 1_000) as u16, MS);
            let read = raw((65_000 + position) as u16, (n * 1_000) as u16);
            assert_eq!(
                tracker.update(read, &stamps, MS).unwrap().position,
                position
            );
        }
    }
}

#[test]
fn a_silence_that_may_hide_a_wrap_loses_the_position() {
    let (mut tracker, mut stamps) = (Tracker::new(1e6), Stamps::new(MHZ));
    stamps.update(0, Duration::ZERO);
    tracker
        .update(raw(0, 0), &stamps, Duration::from_secs(9))
        .unwrap();
    tracker.update(raw(20_000, 0), &stamps, 30 * MS).unwrap();
    let lost = tracker.update(raw(20_000, 0), &stamps, 33 * MS);
    assert_eq!(lost, Err(Lost::Wrapped));
    // And it stays so.
    assert_eq!(tracker.update(raw(20_000, 0), &stamps, MS), lost);
}

#[test]
fn a_counter_that_was_reset_loses_the_position() {
    let (mut tracker, mut stamps) = (Tracker::new(100_000.0), Stamps::new(MHZ));
    stamps.update(0, Duration::ZERO);
    tracker.update(raw(5_000, 0), &stamps, MS).unwrap();
    tracker.update(raw(5_100, 0), &stamps, MS).unwrap();
    assert_eq!(
        tracker.update(raw(0, 0), &stamps, MS),
        Err(Lost::Jumped { by: -5_100 })
    );
}

#[test]
fn lost_counts_lose_the_position_unless_ignored() {
    let stamps = Stamps::new(MHZ);
    let broken = RawEncoder {
        quadrature_error: true,
        ..raw(0, 0)
    };
    assert_eq!(
        Tracker::new(1e6).update(broken, &stamps, MS),
        Err(Lost::Quadrature)
    );
    let mut ignoring = Tracker::new(1e6).ignoring_quadrature_errors();
    assert!(ignoring.update(broken, &stamps, MS).is_ok());
}

#[test]
fn the_rate_is_that_between_edges() {
    // An edge each 3.2 ms, read each 1 ms.
    let (mut tracker, mut stamps) = (Tracker::new(1e6), Stamps::new(MHZ));
    let mut rates = Vec::new();
    for n in 0..100_u64 {
        let now = n * 1_000;
        let edges = now / 3_200;
        stamps.update(now as u16, MS);
        let read = raw(edges as u16, (edges * 3_200) as u16);
        rates.push(tracker.update(read, &stamps, MS).unwrap().rate);
    }
    for rate in &rates[10..] {
        // Where it waits for an edge it cannot know yet that it is not slower.
        assert!((*rate - 312.5).abs() < 0.01, "{rate}");
    }
}

#[test]
fn the_rate_sinks_when_no_edge_comes_and_is_zero_there_and_back() {
    let (mut tracker, mut stamps) = (Tracker::new(1e6), Stamps::new(MHZ));
    for n in 0..4_u16 {
        stamps.update(n * 1_000, MS);
        tracker.update(raw(n * 10, n * 1_000), &stamps, MS).unwrap();
    }
    let mut last = f64::INFINITY;
    for n in 4..200_u64 {
        stamps.update((n * 1_000) as u16, MS);
        let rate = tracker.update(raw(30, 3_000), &stamps, MS).unwrap().rate;
        assert!(rate <= last && rate > 0.0 && rate <= 1e6 / ((n - 3) * 1_000) as f64);
        last = rate;
    }
    stamps.update(200_000_u64 as u16, MS);
    let there_and_back = raw(30, 199_900_u64 as u16);
    assert_eq!(
        tracker.update(there_and_back, &stamps, MS).unwrap().rate,
        0.0
    );
}

#[test]
fn the_index_is_where_it_was_passed() {
    let (mut tracker, mut stamps) = (Tracker::new(1e6), Stamps::new(MHZ));
    stamps.update(0, MS);
    assert_eq!(
        tracker.update(raw(65_530, 0), &stamps, MS).unwrap().index,
        None
    );
    let passed = RawEncoder {
        index: Some(65_534),
        ..raw(10, 0)
    };
    let read = tracker.update(passed, &stamps, MS).unwrap();
    assert_eq!((read.position, read.index), (16, Some(4)));
    assert_eq!(
        tracker.update(raw(20, 0), &stamps, MS).unwrap().index,
        Some(4)
    );
}

#[test]
fn a_reversal_is_no_spike_of_the_rate() {
    // At rest on an edge: it goes up and down, a stamp or two apart, at any place between two
    // readings.
    for second in 2_001..2_100_u16 {
        let (mut tracker, mut stamps) = (Tracker::new(60_000.0), Stamps::new(MHZ));
        let readings = [
            (100, 900),
            (101, 1_999),
            (100, second),
            (101, second + 1_000),
        ];
        for (n, (count, stamp)) in readings.into_iter().enumerate() {
            stamps.update((n as u16 + 1) * 1_000, MS);
            let rate = tracker.update(raw(count, stamp), &stamps, MS).unwrap().rate;
            assert!(rate.abs() <= 1_000.0, "{n}, {second}: {rate}");
        }
    }
}

#[test]
fn after_there_and_back_an_edge_is_no_spike_of_the_rate() {
    let (mut tracker, mut stamps) = (Tracker::new(60_000.0), Stamps::new(MHZ));
    for (now, count, stamp, most) in [
        (1_000, 100, 500, 0.0),
        (2_000, 101, 1_500, 1_000.0),
        (3_000, 101, 2_999, 0.0),
        (4_000, 102, 3_001, 1_000.0),
    ] {
        stamps.update(now, MS);
        let rate = tracker.update(raw(count, stamp), &stamps, MS).unwrap().rate;
        assert!(rate.abs() <= most, "{now}: {rate}");
    }
}

#[test]
fn the_rate_is_never_beyond_the_greatest_speed() {
    let (mut tracker, mut stamps) = (Tracker::new(2_000.0), Stamps::new(MHZ));
    // Edges that jitter: the last two are a stamp apart.
    for (now, count, stamp, rate) in [
        (1_000, 100, 500, 0.0),
        (2_000, 101, 2_000, 1_000.0),
        (3_000, 102, 2_001, 2_000.0),
    ] {
        stamps.update(now, MS);
        let read = tracker.update(raw(count, stamp), &stamps, MS).unwrap();
        assert_eq!(read.rate, rate, "{now}");
    }
}

#[test]
fn an_index_latched_long_before_the_first_reading_is_not_reported() {
    let latched = |count| RawEncoder {
        index: Some(0),
        ..raw(count, 0)
    };
    let stamps = Stamps::new(MHZ);
    // 40 000 counts away, which look like 25 536 the other way; then it comes near.
    let mut tracker = Tracker::new(60_000.0);
    for count in [40_000, 40_050, 40_100] {
        assert_eq!(
            tracker.update(latched(count), &stamps, MS).unwrap().index,
            None
        );
    }
    let mut tracker = Tracker::new(60_000.0);
    let long = Duration::from_secs(1);
    assert_eq!(
        tracker.update(latched(10), &stamps, long).unwrap().index,
        None
    );
    assert_eq!(
        tracker.update(latched(12), &stamps, MS).unwrap().index,
        None
    );
    // In the millisecond since the latch was armed it made 64 counts at most.
    let mut tracker = Tracker::new(60_000.0);
    let read = tracker.update(latched(50), &stamps, MS).unwrap();
    assert_eq!((read.position, read.index), (0, Some(-50)));
    assert_eq!(
        tracker.update(latched(60), &stamps, MS).unwrap().index,
        Some(-50)
    );
}

proptest! {
    #![proptest_config(crate::seeded())]

    /// For any answers of a card: a position is the real one, or lost.
    #[test]
    fn a_position_is_right_or_lost(
        moves in prop::collection::vec((-40_000_i64..40_000, 0_u64..50_000), 1..60),
        start in any::<u16>(),
    ) {
        let (mut tracker, mut stamps) = (Tracker::new(1e6), Stamps::new(MHZ));
        let (mut position, mut time) = (0_i64, 0_u64);
        tracker.update(raw(start, 0), &stamps, Duration::ZERO).unwrap();
        for (moved, micros) in moves {
            // The machine keeps to its greatest speed.
            let moved = moved.clamp(-(micros as i64), micros as i64);
            position += moved;
            time += micros;
            let elapsed = Duration::from_micros(micros);
            stamps.update(time as u16, elapsed);
            let count = (i64::from(start) + position) as u16;
            match tracker.update(raw(count, time as u16), &stamps, elapsed) {
                Ok(read) => prop_assert_eq!(read.position, position),
                Err(lost) => {
                    prop_assert_eq!(lost, Lost::Wrapped);
                    prop_assert!(micros >= 32_000);
                    break;
                }
            }
        }
    }

    #[test]
    fn nothing_panics(
        readings in prop::collection::vec((any::<[u16; 3]>(), any::<u64>(), any::<[bool; 2]>()), 1..50),
        fastest in any::<f64>(),
    ) {
        let (mut tracker, mut stamps) = (Tracker::new(fastest), Stamps::new(MHZ));
        for ([count, stamp, now], nanos, [quadrature_error, latched]) in readings {
            let elapsed = Duration::from_nanos(nanos);
            stamps.update(now, elapsed);
            let index = latched.then_some(now);
            let _ = tracker.update(RawEncoder { count, stamp, index, quadrature_error }, &stamps, elapsed);
        }
    }
}
