//! The rules of a safety block. Every signal of its unit passes it: what the sensors read, what
//! drives the motor, what the unit is to do, and what it says to its neighbours. It keeps the
//! neighbours' states.
//!
//! 1. A sensor that reads what cannot be, or an axis that is driven and does not move, is a
//!    *fault*. It lasts until the operator reports a repair.
//! 2. A unit with a fault has its motor off. It stays where it is.
//! 3. A unit *halts* while the unit ahead of it has failed: it gives to that one.
//! 4. A unit with a safe position goes there while the unit behind it has failed; one without goes
//!    on with what it has.
//! 5. No block is let go, and none is announced to be welcome, except by a unit that runs.
//!
//! A unit has failed if it says that it has a fault, or if what was heard of it last is too old.

use crate::messages::{Condition, Drive, Goal, Order, Sensors, Setpoint, Status, View};
use crate::parameters::{
    DRIVEN, MOVED, NEIGHBOUR_TIMEOUT, PERIOD, POSITION_RANGE, Parameters, STUCK_AFTER, Unit,
};
use luna::time::Instant;
use luna_safety_blocks::{Block, Blocked, Limit, Range, Sample, SettingError};
use std::time::Duration;

/// What is known of a neighbour.
#[derive(Debug, Clone, Copy, Default)]
struct Neighbour {
    status: Status,
    /// When its last status was sent, or before.
    heard: Option<Instant>,
}

impl Neighbour {
    fn says(status: Status) -> Self {
        let heard = luna::now() - Duration::from_micros(status.age.into());
        let heard = Some(heard);
        Self { status, heard }
    }

    fn has_failed(&self, now: Instant) -> bool {
        let is_silent = |heard| now - heard > NEIGHBOUR_TIMEOUT;
        self.status.condition.is_failed() || self.heard.is_none_or(is_silent)
    }
}

/// The safety block of a unit, without its channels. All its functions are for the real-time path:
/// O(1), no allocation.
#[derive(Debug)]
pub struct Safety {
    parameters: &'static Parameters,
    /// Whether neighbours' failures are heeded: only a test says no.
    heeds: bool,
    range: Range,
    limit: Limit,
    motion: Blocked,
    ahead: Neighbour,
    behind: Neighbour,
    order: Order,
    sensors: Sensors,
    has_fault: bool,
    now: Instant,
}

impl Safety {
    /// Of this unit. `heeds` is false for a test that shows what the rules 3 and 4 prevent.
    ///
    /// # Errors
    ///
    /// None with the figures of [`parameters`](crate::parameters).
    pub fn new(unit: Unit, heeds: bool) -> Result<Self, SettingError> {
        Ok(Self {
            parameters: unit.parameters(),
            heeds,
            range: Range::new(-POSITION_RANGE, POSITION_RANGE)?,
            limit: Limit::new(-1.0, 1.0)?,
            motion: Blocked::new(DRIVEN, MOVED, STUCK_AFTER)?,
            ahead: Neighbour::default(),
            behind: Neighbour::default(),
            order: Order::default(),
            sensors: Sensors::default(),
            has_fault: false,
            now: luna::now(),
        })
    }

    /// The unit ahead has sent its status.
    pub fn ahead(&mut self, status: Status) {
        self.ahead = Neighbour::says(status);
    }

    /// The unit behind has sent its status.
    pub fn behind(&mut self, status: Status) {
        self.behind = Neighbour::says(status);
    }

    /// The sensors' readings of a cycle. Returns what the controller may see of them: of a broken
    /// one the last good reading.
    pub fn sensors(&mut self, read: Sensors) -> Sensors {
        self.now = luna::now();
        let sample = Sample::new(read.position, PERIOD);
        let is_broken = self.range.step(&sample).fault().is_some();
        self.has_fault |= is_broken;
        let position = match is_broken {
            true => self.sensors.position,
            false => read.position,
        };
        self.sensors = Sensors { position, ..read };
        self.sensors
    }

    /// The command block's order. Returns what the controller is to reach.
    pub fn order(&mut self, order: Order) -> Setpoint {
        if order.repairs != self.order.repairs {
            self.has_fault = false;
            self.motion.reset();
        }
        self.order = order;
        let goal = match (self.condition(), self.parameters.safe) {
            (Condition::Safe, Some(position)) => Goal::Position(position),
            _ => order.goal,
        };
        let law = order.law;
        Setpoint { goal, law }
    }

    /// The controller's output. Returns what the motor gets.
    pub fn drive(&mut self, duty: f64) -> Drive {
        let moves = matches!(self.condition(), Condition::Running | Condition::Safe);
        let sample = |value| Sample::new(value, PERIOD).beside(self.sensors.position);
        let limited = self.limit.step(&sample(duty)).or(0.0);
        let wanted = if moves { limited } else { 0.0 };
        let verdict = self.motion.step(&sample(wanted));
        self.has_fault |= verdict.fault().is_some();
        let release = self.order.release
            && self.condition() == Condition::Running
            && self.sensors.given < self.ahead_accepts();
        let duty = verdict.or(0.0);
        Drive { duty, release }
    }

    /// How the unit is.
    pub fn condition(&self) -> Condition {
        let has_failed = |neighbour: &Neighbour| self.heeds && neighbour.has_failed(self.now);
        if self.has_fault {
            Condition::Faulty
        } else if !self.order.run {
            Condition::Stopped
        } else if has_failed(&self.ahead) {
            Condition::Halted
        } else if has_failed(&self.behind) && self.parameters.safe.is_some() {
            Condition::Safe
        } else {
            Condition::Running
        }
    }

    /// What the neighbours get to know.
    pub fn status(&self) -> Status {
        let condition = self.condition();
        let is_ready = self.order.ready && condition == Condition::Running;
        let accepts = self.sensors.taken + u32::from(is_ready);
        Status {
            condition,
            accepts,
            age: 0,
        }
    }

    /// What the command block sees.
    pub fn view(&self) -> View {
        View {
            sensors: self.sensors,
            condition: self.condition(),
            ahead_accepts: self.ahead_accepts(),
        }
    }

    fn ahead_accepts(&self) -> u32 {
        match self.heeds && self.ahead.has_failed(self.now) {
            true => 0,
            false => self.ahead.status.accepts,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::messages::Message;

    const WELL: Status = Status {
        condition: Condition::Running,
        accepts: 1,
        age: 0,
    };

    fn running(unit: Unit) -> Safety {
        let mut safety = Safety::new(unit, true).unwrap();
        safety.ahead(WELL);
        safety.behind(WELL);
        safety.sensors(Sensors::default());
        safety.order(Order {
            run: true,
            goal: Goal::Speed(0.1),
            release: true,
            ready: true,
            ..Order::default()
        });
        safety
    }

    fn with(condition: Condition) -> Status {
        Status { condition, ..WELL }
    }

    #[test]
    fn all_passes_while_all_is_well() {
        let mut safety = running(Unit::Extractor);
        assert_eq!(safety.condition(), Condition::Running);
        let (duty, release) = (0.2, true);
        assert_eq!(safety.drive(0.2), Drive { duty, release });
        assert_eq!(safety.status().accepts, 1);
    }

    #[test]
    fn a_failure_ahead_halts_and_one_that_only_waits_does_not() {
        for condition in [Condition::Faulty, Condition::Lost] {
            let mut safety = running(Unit::FeederBelt);
            safety.ahead(with(condition));
            assert_eq!(safety.condition(), Condition::Halted);
            assert_eq!(safety.drive(0.2), Drive::default());
            assert_eq!(
                (safety.status().accepts, safety.view().ahead_accepts),
                (0, 0)
            );
        }
        for condition in [Condition::Halted, Condition::Stopped, Condition::Safe] {
            let mut safety = running(Unit::FeederBelt);
            safety.ahead(with(condition));
            assert_eq!(safety.condition(), Condition::Running);
        }
    }

    #[test]
    fn a_failure_behind_opens_the_door_and_leaves_the_others() {
        for unit in Unit::ALL {
            let mut safety = running(unit);
            safety.behind(with(Condition::Faulty));
            let setpoint = safety.order(safety.order);
            let is_door = unit == Unit::MoulderDoor;
            let (condition, goal) = match is_door {
                true => (Condition::Safe, Goal::Position(0.1)),
                false => (Condition::Running, Goal::Speed(0.1)),
            };
            assert_eq!((safety.condition(), setpoint.goal), (condition, goal));
        }
    }

    #[test]
    fn a_silent_neighbour_has_failed() {
        let mut safety = Safety::new(Unit::Feeder, true).unwrap();
        let run = true;
        safety.order(Order {
            run,
            ..Order::default()
        });
        assert_eq!(safety.condition(), Condition::Halted);
    }

    #[test]
    fn an_old_status_is_silence() {
        let mut safety = running(Unit::FeederBelt);
        safety.ahead(WELL.aged(NEIGHBOUR_TIMEOUT / 2));
        safety.sensors(Sensors::default());
        assert_eq!(safety.condition(), Condition::Running);
        for age in [NEIGHBOUR_TIMEOUT + PERIOD, Duration::MAX] {
            safety.ahead(WELL.aged(age));
            safety.sensors(Sensors::default());
            assert_eq!(safety.condition(), Condition::Halted, "{age:?}");
        }
    }

    #[test]
    fn a_broken_sensor_is_a_fault_until_it_is_repaired() {
        let mut safety = running(Unit::Robot);
        let position = f64::NAN;
        let seen = safety.sensors(Sensors {
            position,
            ..Sensors::default()
        });
        assert_eq!(
            (seen.position, safety.condition()),
            (0.0, Condition::Faulty)
        );
        assert_eq!(safety.drive(0.2), Drive::default());
        safety.sensors(Sensors::default());
        assert_eq!(safety.condition(), Condition::Faulty);
        let repairs = 1;
        safety.order(Order {
            repairs,
            ..safety.order
        });
        assert_eq!(safety.condition(), Condition::Running);
    }

    #[test]
    fn a_driven_axis_that_stands_is_a_fault() {
        let mut safety = running(Unit::Feeder);
        let driven = (0..).find(|_| safety.drive(0.8).duty == 0.0);
        assert_eq!(driven, Some(STUCK_AFTER.as_millis() as usize));
        assert_eq!(safety.condition(), Condition::Faulty);
    }
}
