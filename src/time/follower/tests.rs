//! The arithmetic alone: a leader with a rate and a phase of its own, exact ticks and noisy ones.

use super::*;
use proptest::prelude::*;

const PERIOD: u64 = 1_000_000;

/// A loop that is moved as `Periodic` is: by a hundredth of the period in a cycle at most.
struct Loop {
    slot: u64,
    follower: Follower,
}

impl Loop {
    fn new(slot: u64) -> Self {
        let follower = Follower::new(Duration::from_nanos(PERIOD)).unwrap();
        Self { slot, follower }
    }

    fn cycle(&mut self, leader: Option<u64>, error: u64) -> Followed {
        let leader = leader.map(|at| LeaderTick {
            at: Instant::from_nanos(at),
            error: Duration::from_nanos(error),
        });
        let followed = self
            .follower
            .step(Instant::from_nanos(self.slot), 0, leader);
        let most = (PERIOD / 100) as i64;
        let moved = followed.correction.clamp(-most, most);
        self.slot = (self.slot + PERIOD).saturating_add_signed(moved);
        followed
    }
}

/// The leader's last slot at `now`.
fn leader(first: u64, period: f64, now: u64) -> u64 {
    let number = ((now - first) as f64 / period).floor();
    first + (number * period) as u64
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn it_locks_from_any_phase_and_rate(
        phase in 0..PERIOD,
        ppm in -1_000.0_f64..1_000.0,
        noise in prop::collection::vec(-2_000_i64..2_000, 400),
        late in 0_u64..3,
    ) {
        let first = 10_000_000_000;
        let period = PERIOD as f64 * (1.0 + ppm / 1e6);
        let mut here = Loop::new(first + 5 * PERIOD + phase);
        for (number, noise) in noise.into_iter().enumerate() {
            // Ticks come up to two cycles late.
            let tick = leader(first, period, here.slot - late * PERIOD);
            let followed = here.cycle(Some(tick.saturating_add_signed(noise)), 2_000);
            if number >= 150 {
                prop_assert_eq!(followed.state, FollowState::Locked, "in cycle {}", number);
            }
        }
        prop_assert!((here.follower.rate_ppm() - ppm).abs() < 60.0);
        prop_assert!(here.follower.phase_error().count() >= 250);
    }
}

#[test]
fn a_silent_leader_is_kept_in_step_with_by_the_learned_rate() {
    let (first, period) = (10_000_000_000, PERIOD as f64 * 1.000_2);
    let mut here = Loop::new(first + 5 * PERIOD + 300_000);
    for _ in 0..400 {
        let tick = leader(first, period, here.slot);
        here.cycle(Some(tick), 0);
    }
    assert_eq!(here.follower.state(), FollowState::Locked);
    for number in 1..=100 {
        let followed = here.cycle(None, 0);
        let expected = match number <= 10 {
            true => FollowState::Locked,
            false => FollowState::FreeRunning,
        };
        assert_eq!(followed.state, expected);
    }
    assert_eq!(here.follower.losses(), 1);
    let tick = leader(first, period, here.slot);
    let followed = here.cycle(Some(tick), 0);
    // 200 ppm in 100 cycles would be 20 µs.
    let error = followed.phase_error.unwrap().abs();
    assert!(error < 500, "{error} ns");
    assert_eq!(followed.state, FollowState::Acquiring);
}

#[test]
fn a_phase_is_kept_and_a_vague_tick_is_not_used() {
    let first = 10_000_000_000;
    let mut here = Loop::new(first + 5 * PERIOD);
    here.follower = here.follower.phase(Duration::from_micros(250));
    for _ in 0..200 {
        let tick = leader(first, PERIOD as f64, here.slot);
        here.cycle(Some(tick), 0);
    }
    let behind = (here.slot - first) % PERIOD;
    assert!(behind.abs_diff(250_000) < 10, "{behind} ns");
    let followed = here.cycle(Some(here.slot - 400_000), 60_000);
    assert_eq!(followed.phase_error, None);
    assert_eq!(here.follower.refused(), 1);
}
