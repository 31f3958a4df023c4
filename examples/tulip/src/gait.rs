//! The gait, at 100 Hz: when to step and where to.
//!
//! A step is planned for a fixed time, and ends when the foot meets the ground. Within it, the
//! capture point runs away from the foot, by a known factor. So the gait knows where it will be at
//! the end, and puts the next foot beside it so that the following step can be as the one before. A
//! push moves the foothold.

use crate::legs::{Side, sign};
use crate::messages::{Body, Plan, Step, Wish};
use crate::parameters::{BESIDE, OMEGA, REACH, STEP, STEP_TIME, WIDTH};
use nalgebra::Vector2;

/// How near the capture point has to come before the first step, in m.
const NEAR: f64 = 0.006;
/// How long it stands between walking and walking, in s.
const REST: f64 = 1.0;
/// How fast the place to come to moves while it stands, in m for each cycle.
const SHIFT: f64 = 1.5e-3;
/// Steps of no length before it stands.
const LAST_STEPS: u32 = 2;

/// What the gait does.
#[derive(Debug, Clone, Copy)]
enum Phase {
    /// Stands since this time, with the capture point here.
    Stands(f64, Vector2<f64>),
    /// Shifts its weight to the left foot: so far it has come.
    Shifts(Vector2<f64>),
    Walks(Step),
}

/// The gait, without its channels.
#[derive(Debug)]
pub struct Gait {
    phase: Phase,
    /// Steps of no length since it is to stand.
    last_steps: u32,
    number: u32,
}

impl Default for Gait {
    fn default() -> Self {
        Self {
            phase: Phase::Stands(0.0, Vector2::zeros()),
            last_steps: 0,
            number: 0,
        }
    }
}

/// Where the capture point is at the begin of a step of this length on this leg, from its foot.
pub fn at_begin(stance: Side, length: f64) -> Vector2<f64> {
    let growth = (OMEGA * STEP_TIME).exp();
    let beside = -sign(stance) * WIDTH / (1.0 + growth);
    Vector2::new(length / (growth - 1.0), beside)
}

impl Gait {
    /// One cycle.
    pub fn step(&mut self, body: &Body, wish: &Wish) -> Plan {
        let middle = (body.feet[0] + body.feet[1]) / 2.0;
        match self.phase {
            Phase::Stands(since, at) => {
                let at = toward(at, middle);
                self.phase = Phase::Stands(since, at);
                if wish.walk && body.time - since > REST {
                    self.phase = Phase::Shifts(at);
                }
            }
            Phase::Shifts(at) => {
                let goal = body.feet[0] + at_begin(0, 0.0);
                let at = toward(at, goal);
                self.phase = Phase::Shifts(at);
                if (body.capture - goal).norm() < NEAR {
                    self.last_steps = 0;
                    self.phase = Phase::Walks(self.begin(body, 0));
                }
            }
            Phase::Walks(step) if body.steps >= step.number => {
                self.last_steps = if wish.walk { 0 } else { self.last_steps + 1 };
                self.phase = match self.last_steps > LAST_STEPS {
                    true => Phase::Stands(body.time, body.capture),
                    false => Phase::Walks(self.begin(body, 1 - step.stance)),
                };
            }
            Phase::Walks(_) => {}
        }
        match &mut self.phase {
            Phase::Stands(_, at) | Phase::Shifts(at) => Plan::Stand(*at),
            Phase::Walks(step) => {
                let length = if wish.walk { wish.step } else { 0.0 };
                place(step, body, length.clamp(0.0, STEP));
                Plan::Step(*step)
            }
        }
    }

    fn begin(&mut self, body: &Body, stance: Side) -> Step {
        self.number = body.steps + 1;
        let from = body.feet[1 - stance];
        Step {
            number: self.number,
            stance,
            began: body.time,
            from,
            to: from,
            capture: from,
        }
    }
}

/// Where the foot goes, and where the capture point is to be then.
fn place(step: &mut Step, body: &Body, length: f64) {
    let stance = body.feet[step.stance];
    let other = 1 - step.stance;
    let side = sign(other);
    let begin = at_begin(other, length);
    step.capture = stance + Vector2::new(length, side * WIDTH) + begin;
    // What the capture point will be if the pressure stays below the middle of the foot.
    let left = (step.began + STEP_TIME - body.time).max(0.0);
    let end = stance + (body.capture - stance) * (OMEGA * left).exp();
    let ahead = (end - begin - stance).x.clamp(-REACH, REACH);
    let beside = (side * (end - begin - stance).y).clamp(BESIDE[0], BESIDE[1]);
    step.to = stance + Vector2::new(ahead, side * beside);
}

fn toward(at: Vector2<f64>, goal: Vector2<f64>) -> Vector2<f64> {
    at + (goal - at).cap_magnitude(SHIFT)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A pendulum on the middle of each foot, pushed at a step: the gait alone keeps it up.
    #[test]
    fn footholds_alone_keep_a_pendulum_up() {
        let mut body = Body {
            feet: [Vector2::new(0.0, 0.08), Vector2::new(0.0, -0.08)],
            ..Body::default()
        };
        let mut stance = 0;
        body.capture = body.feet[0] + at_begin(0, 0.06);
        for number in 1..30 {
            let growth = (OMEGA * STEP_TIME).exp();
            let mut step = Gait::default().begin(&body, stance);
            step.began = 0.0;
            place(&mut step, &body, 0.06);
            body.capture = body.feet[stance] + (body.capture - body.feet[stance]) * growth;
            stance = 1 - stance;
            body.feet[stance] = step.to;
            if number == 10 {
                body.capture += Vector2::new(0.008, 0.004);
            }
            let off = body.capture - body.feet[stance];
            assert!(off.norm() < 0.06, "{number}: {off}");
        }
        let length = body.feet[stance].x - body.feet[1 - stance].x;
        assert!((length - 0.06).abs() < 5e-3, "{length}");
    }

    #[test]
    fn it_stands_until_it_is_to_walk() {
        let mut gait = Gait::default();
        let mut body = Body {
            feet: [Vector2::new(0.0, 0.08), Vector2::new(0.0, -0.08)],
            ..Body::default()
        };
        let (step, mut walk) = (0.05, false);
        for cycle in 0..1000 {
            body.time = f64::from(cycle) * 0.01;
            walk |= cycle == 500;
            let plan = gait.step(&body, &Wish { walk, step });
            if let Plan::Stand(at) = plan {
                body.capture = at;
            }
            let walks = matches!(plan, Plan::Step(_));
            assert!(cycle > 500 || !walks, "{cycle}");
            if cycle == 999 {
                assert!(walks);
            }
        }
    }
}
