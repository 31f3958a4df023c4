//! A network that loses, delays, doubles and reorders, in the same way for each seed.

use std::time::Duration;

/// The network's faults, each way: probabilities from 0 to 1.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Faults {
    /// Probability that a datagram is lost, 0 to 1.
    pub loss: f64,
    /// Probability that a datagram comes twice, 0 to 1.
    pub doubling: f64,
    /// Probability that a datagram is delayed so that others overtake it, 0 to 1.
    pub reordering: f64,
    /// For how long it is held up then.
    pub held_up: Duration,
    /// How long each one takes at least, and at most.
    pub delay: [Duration; 2],
}

impl Faults {
    /// None.
    pub const NONE: Faults = Faults {
        loss: 0.0,
        doubling: 0.0,
        reordering: 0.0,
        held_up: Duration::ZERO,
        delay: [Duration::ZERO; 2],
    };
}

impl Default for Faults {
    fn default() -> Self {
        Self::NONE
    }
}

/// What comes of one datagram: how long each copy of it takes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Sent {
    /// Nothing.
    Lost,
    /// One.
    Once(Duration),
    /// Two.
    Twice(Duration, Duration),
}

/// The faults, one after the other.
#[derive(Debug, Clone)]
pub struct Network {
    faults: Faults,
    state: u64,
}

impl Network {
    /// A network with these faults; `seed` determines the random sequence.
    pub const fn new(faults: Faults, seed: u64) -> Self {
        Self {
            faults,
            state: seed,
        }
    }

    /// Has other faults from now on.
    pub fn set_faults(&mut self, faults: Faults) {
        self.faults = faults;
    }

    /// What comes of the next datagram.
    pub fn send(&mut self) -> Sent {
        if self.faults == Faults::NONE {
            return Sent::Once(Duration::ZERO);
        }
        // All are drawn each time, so that one fault does not move the others.
        let [loss, doubling, reordering] = [(); 3].map(|()| self.draw());
        let [first, second] = [(); 2].map(|()| self.delay());
        if loss < self.faults.loss {
            return Sent::Lost;
        }
        let first = match reordering < self.faults.reordering {
            true => first + self.faults.held_up,
            false => first,
        };
        match doubling < self.faults.doubling {
            true => Sent::Twice(first, second + self.faults.held_up),
            false => Sent::Once(first),
        }
    }

    fn delay(&mut self) -> Duration {
        let [least, most] = self.faults.delay;
        least + most.saturating_sub(least).mul_f64(self.draw())
    }

    /// From 0 to less than 1: splitmix64.
    fn draw(&mut self) -> f64 {
        self.state = self.state.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut mixed = self.state;
        mixed = (mixed ^ mixed >> 30).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        mixed = (mixed ^ mixed >> 27).wrapping_mul(0x94D0_49BB_1331_11EB);
        ((mixed ^ mixed >> 31) >> 11) as f64 / (1_u64 << 53) as f64
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_seed_is_a_course_and_the_rates_are_those_asked_for() {
        let faults = Faults {
            loss: 0.01,
            doubling: 0.02,
            reordering: 0.05,
            held_up: Duration::from_millis(2),
            delay: [Duration::ZERO, Duration::from_micros(100)],
        };
        let mut network = Network::new(faults, 7);
        let course: Vec<Sent> = (0..100_000).map(|_| network.send()).collect();
        let again = Network::new(faults, 7);
        let mut again = again;
        assert!(course.iter().all(|sent| *sent == again.send()));
        let share = |is: fn(&Sent) -> bool| {
            course.iter().filter(|sent| is(sent)).count() as f64 / course.len() as f64
        };
        assert!((share(|sent| *sent == Sent::Lost) - 0.01).abs() < 0.002);
        assert!((share(|sent| matches!(sent, Sent::Twice(..))) - 0.02).abs() < 0.003);
        let held = Duration::from_millis(2);
        let is_held = |sent: &Sent| matches!(sent, Sent::Once(by) | Sent::Twice(by, _) if *by >= Duration::from_millis(2));
        assert!((share(is_held) - 0.05).abs() < 0.004);
        assert!(
            course
                .iter()
                .all(|sent| !matches!(sent, Sent::Once(by) if *by > held + faults.delay[1]))
        );
    }
}
