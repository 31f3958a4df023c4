//! The generated controller and the one in Rust give the same.

use luna_external_code_example::{Pid, generated_pid};

/// Relative to the output's range. The operations are the same; a C compiler may contract some of
/// them, which rounds once less.
const TOLERANCE: f64 = 1e-9;

/// Numbers from 0 to 1 (xorshift), from the seed `LUNA_SEED`; without it always the same.
struct Random(u64);

impl Random {
    fn new() -> Self {
        let seed = std::env::var("LUNA_SEED")
            .ok()
            .and_then(|seed| seed.parse().ok());
        Self(seed.unwrap_or(20_261_121) | 1)
    }

    fn next(&mut self) -> f64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        (self.0 >> 11) as f64 / (1u64 << 53) as f64
    }
}

#[test]
fn over_ten_thousand_random_steps() {
    let mut random = Random::new();
    let mut generated = generated_pid();
    generated.initialize(0.0);
    let mut own = Pid::new(0.0, 0.0);
    let (mut time, mut angle, mut target) = (0.0, 0.0, 0.0);
    let (mut limited, mut free, mut widest) = (0, 0, 0.0_f64);
    for n in 0..10_000 {
        // Steps of uneven length, some of zero; targets that jump; angles that wander.
        if random.next() < 0.95 {
            time += random.next() * 2e-3;
        }
        if random.next() < 0.03 {
            target = 2.0 * random.next() - 1.0;
        }
        angle += 0.02 * (target - angle) + 2e-3 * (random.next() - 0.5);
        let [duty] = generated.step([target, angle], time).unwrap();
        let expected = own.step(target, angle, time);
        assert!(
            (duty - expected).abs() <= TOLERANCE,
            "step {n}: {duty}, {expected}"
        );
        widest = widest.max((duty - expected).abs());
        if expected.abs() == 0.6 {
            limited += 1;
        } else {
            free += 1;
        }
    }
    println!("at most {widest} apart; {limited} at the limit");
    // Both ranges were covered.
    assert!(limited > 200 && free > 200, "{limited}, {free}");
}

#[test]
fn two_of_them_do_not_share_their_states() {
    let (mut one, mut other) = (generated_pid(), generated_pid());
    one.initialize(0.0);
    other.initialize(0.0);
    one.step([1.0, 0.0], 0.1).unwrap();
    assert_ne!(one.states(), other.states());
    assert_eq!(one.parameters(), &[1.2, 6.0, 0.02, 0.002, 0.6]);
    one.set_parameter(4, 0.1);
    assert_eq!(one.step([1.0, 0.0], 0.2), Ok([0.1]));
}
