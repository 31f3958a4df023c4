//! The command blocks' state machines. A step depends on what the safety block lets them see, and
//! on little else, so that a unit that is started again goes on where its mechanics stand.
//!
//! ```text
//!  belt                                        arm
//!
//!  ╭─> carry ── a block is at the exit ─╮      ╭─> fetch ── it holds a block ──> work
//!  │                                    v      │                                   │ its time is over
//!  ╰── it is taken ── pass <── ahead ── wait   │   it is taken                     v
//!                             is ready         ╰────────────── give <── it is there ── carry
//! ```

use crate::messages::{Condition, Goal, View};
use crate::parameters::{CYCLES_OF_COMMAND, DT, Kind, Parameters, REACH};

/// What a unit is to do next.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Step {
    /// What the controller is to reach.
    pub goal: Goal,
    /// Whether an arm is to let go of its block.
    pub release: bool,
    /// Whether a block may come.
    pub ready: bool,
    /// There is nothing to do until a neighbour is ready.
    pub waits: bool,
}

/// A command block's state machine.
pub trait Plan {
    /// The next step.
    fn step(&mut self, view: &View) -> Step;
}

/// The plan of a unit.
pub fn of(parameters: &'static Parameters) -> Box<dyn Plan + Send> {
    match parameters.kind {
        Kind::Belt => Box::new(Belt { parameters }),
        Kind::Arm => Box::new(Arm {
            parameters,
            phase: Phase::Fetch,
        }),
    }
}

/// It has no state but that of its sensors.
struct Belt {
    parameters: &'static Parameters,
}

impl Plan for Belt {
    fn step(&mut self, view: &View) -> Step {
        let sensors = &view.sensors;
        let may_pass = sensors.given < view.ahead_accepts;
        let goes = sensors.count > 0 && (!sensors.exit || may_pass);
        let speed = if goes { self.parameters.speed } else { 0.0 };
        Step {
            goal: Goal::Speed(speed),
            release: false,
            ready: !sensors.entry,
            waits: !goes,
        }
    }
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum Phase {
    Fetch,
    /// For so long still, in s.
    Work(f64),
    Carry,
    Give,
}

struct Arm {
    parameters: &'static Parameters,
    phase: Phase,
}

impl Plan for Arm {
    fn step(&mut self, view: &View) -> Step {
        let Parameters {
            take, give, work, ..
        } = *self.parameters;
        let sensors = &view.sensors;
        let is_at = |place: f64| (sensors.position - place).abs() < REACH / 2.0;
        self.phase = match self.phase {
            Phase::Fetch if sensors.exit => Phase::Work(work),
            Phase::Work(left) if left <= 0.0 => Phase::Carry,
            // A door that opened since the feeder failed closes again, and begins anew.
            Phase::Work(_) if !is_at(take) => Phase::Work(work),
            Phase::Work(left) if view.condition == Condition::Running => {
                Phase::Work(left - DT * f64::from(CYCLES_OF_COMMAND))
            }
            Phase::Carry if is_at(give) => Phase::Give,
            Phase::Give if !sensors.exit => Phase::Fetch,
            phase => phase,
        };
        let may_pass = sensors.given < view.ahead_accepts;
        let (goal, waits) = match self.phase {
            Phase::Fetch => (take, is_at(take)),
            Phase::Work(_) => (take, false),
            Phase::Carry => (give, false),
            Phase::Give => (give, !may_pass),
        };
        Step {
            goal: Goal::Position(goal),
            release: self.phase == Phase::Give && may_pass,
            ready: self.phase == Phase::Fetch && is_at(take) && !sensors.exit,
            waits,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::messages::Sensors;
    use crate::parameters::Unit;

    fn view(position: f64, holds: bool, ahead_accepts: u32) -> View {
        View {
            sensors: Sensors {
                position,
                entry: holds,
                exit: holds,
                count: holds.into(),
                ..Sensors::default()
            },
            condition: Condition::Running,
            ahead_accepts,
        }
    }

    #[test]
    fn an_arm_fetches_carries_and_gives() {
        let mut plan = of(Unit::Feeder.parameters());
        assert!(!plan.step(&view(0.1, false, 0)).ready);
        assert!(plan.step(&view(0.0, false, 0)).ready);
        let step = [0; 3].map(|_| plan.step(&view(0.0, true, 0)));
        assert_eq!(step[2].goal, Goal::Position(0.15));
        let step = plan.step(&view(0.15, true, 0));
        assert!(step.waits && !step.release && !step.ready);
        assert!(plan.step(&view(0.15, true, 1)).release);
        let step = plan.step(&view(0.15, false, 1));
        assert_eq!((step.goal, step.release), (Goal::Position(0.0), false));
    }

    #[test]
    fn the_moulder_keeps_a_block_for_its_time() {
        let mut plan = of(Unit::MoulderDoor.parameters());
        let steps = (0..).find(|_| plan.step(&view(0.0, true, 0)).goal == Goal::Position(0.1));
        assert!((60..=62).contains(&steps.unwrap()), "{steps:?}");
    }

    #[test]
    fn a_belt_waits_with_a_block_at_its_exit() {
        let mut plan = of(Unit::FeederBelt.parameters());
        assert!(plan.step(&view(0.0, true, 0)).waits);
        let step = plan.step(&view(0.0, true, 1));
        assert_eq!((step.goal, step.waits), (Goal::Speed(0.25), false));
        assert!(plan.step(&view(0.0, false, 1)).waits);
    }
}
