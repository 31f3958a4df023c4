//! A dead time, exact to the nanosecond.

use crate::single::{Single, plant_of_single};
use crate::{Plant, PlantError, Port};
use std::collections::VecDeque;
use std::time::Duration;

/// A dead time: the output is the input of `delay` before. A conveyor, a pipe, a camera's exposure
/// and transfer.
///
/// Exact: times are whole nanoseconds, and changes come out in the order and at the distance at
/// which they went in, independent of the steps. At the instant of a change the output is the new
/// value. Before the first change has passed through, the output is 0 or the value of
/// [`starting_at`](Self::starting_at).
///
/// A step takes O(changes that come out), and no more come out than went in. It allocates nothing:
/// [`new`](Self::new) allocates the buffer.
///
/// ```
/// use luna_plants::{Checked, DeadTime, Port};
/// use std::time::Duration;
///
/// let ms = Duration::from_millis;
/// let belt = DeadTime::new(Port::new("put", "kg"), Port::new("arrived", "kg"), ms(30), ms(10));
/// let mut belt = Checked::new(belt);
/// belt.set("put", 2.0).unwrap();
/// let seen: Vec<f64> = (0..4)
///     .map(|_| {
///         belt.step(ms(10)).unwrap();
///         belt.get("arrived").unwrap()
///     })
///     .collect();
/// assert_eq!(seen, [0.0, 0.0, 2.0, 2.0]);
/// ```
#[derive(Debug, Clone)]
pub struct DeadTime {
    single: Single,
    delay: Duration,
    now: Duration,
    /// When a value comes out, and which. In order.
    under_way: VecDeque<(Duration, f64)>,
    room: usize,
}

impl DeadTime {
    /// A dead time of `delay` for steps of at least `shortest_step`. Allocates 24 bytes for each
    /// such step in the delay, for at most 2^20 of them.
    ///
    /// # Panics
    ///
    /// If `shortest_step` is zero, or less than a millionth of the delay.
    #[track_caller]
    pub fn new(input: Port, output: Port, delay: Duration, shortest_step: Duration) -> Self {
        assert!(!shortest_step.is_zero(), "a step takes time");
        let steps = delay.as_nanos().div_ceil(shortest_step.as_nanos());
        assert!(
            steps <= 1_000_000,
            "a dead time has room for a million steps"
        );
        // One that begins, one that ends.
        let room = steps as usize + 2;
        Self {
            single: Single::new(input, output),
            delay,
            now: Duration::ZERO,
            under_way: VecDeque::with_capacity(room),
            room,
        }
    }

    /// With `value`, in the unit of the signal, as the output until the first change has passed.
    #[must_use]
    pub fn starting_at(mut self, value: f64) -> Self {
        self.single.value = value;
        self.single.applied = value;
        self
    }
}

impl Plant for DeadTime {
    plant_of_single!();

    fn step(&mut self, time: Duration) -> Result<(), PlantError> {
        let Single { applied, value, .. } = &mut self.single;
        let last = self.under_way.back().map_or(*value, |&(_, value)| value);
        if *applied != last {
            if self.under_way.len() == self.room {
                return Err(PlantError::NoRoom { room: self.room });
            }
            self.under_way.push_back((self.now + self.delay, *applied));
        }
        self.now += time;
        while let Some(&(at, arrived)) = self.under_way.front()
            && at <= self.now
        {
            *value = arrived;
            self.under_way.pop_front();
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Checked;
    use proptest::prelude::*;

    fn dead_time(delay: Duration, step: Duration) -> Checked<DeadTime> {
        Checked::new(DeadTime::new(
            Port::new("u", "1"),
            Port::new("y", "1"),
            delay,
            step,
        ))
    }

    proptest! {
        #![proptest_config(crate::seeded())]

        #[test]
        fn the_output_is_the_input_of_then(
            delay in 0u64..5_000,
            changes in prop::collection::vec((100u64..1_000, -3i8..3), 1..200),
        ) {
            let mut plant = dead_time(Duration::from_nanos(delay), Duration::from_nanos(100));
            // (from when, what): the input as a function of time.
            let mut history = vec![(i128::MIN, 0.0)];
            let mut now = 0i128;
            for &(step, value) in &changes {
                plant.set("u", f64::from(value)).unwrap();
                history.push((now, f64::from(value)));
                plant.step(Duration::from_nanos(step)).unwrap();
                now += i128::from(step);
                let then = now - i128::from(delay);
                let expected = history.iter().rfind(|&&(from, _)| from <= then).unwrap().1;
                prop_assert_eq!(plant.get("y").unwrap(), expected);
            }
        }
    }

    #[test]
    fn steps_shorter_than_stated_are_an_error_and_nothing_is_lost_before() {
        let mut plant = dead_time(Duration::from_nanos(1000), Duration::from_nanos(500));
        let outcome: Vec<_> = (1..=5)
            .map(|n| {
                plant.set("u", f64::from(n))?;
                plant.step(Duration::from_nanos(1))
            })
            .collect();
        assert_eq!(outcome[..4], [Ok(()), Ok(()), Ok(()), Ok(())]);
        assert_eq!(outcome[4], Err(PlantError::NoRoom { room: 4 }));
    }
}
