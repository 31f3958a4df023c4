//! The world model, at 10 Hz and soft real-time: where the ball is and how it rolls, by a Kalman
//! filter in `nalgebra`; and from that, how the robot is to walk.

use crate::messages::{Body, Internal, Request, Shown, Wish};
use crate::parameters::STEP;
use nalgebra::{Matrix2, Matrix2x4, Matrix4, Vector2, Vector4};

/// The variance of what the camera sees, in m².
const CAMERA: f64 = 6e-4;
/// How the ball's speed changes by itself: its variance in each s, in m²/s².
const RESTLESS: f64 = 2e-3;
/// From the ball the robot keeps this distance, in m.
const DISTANCE: f64 = 0.5;
/// The length of a step for each m that the ball is further.
const EAGER: f64 = 0.25;

/// The world model.
#[derive(Debug, Default)]
pub struct World {
    ball: Option<Ball>,
    body: Body,
}

/// The ball's place and speed, and how uncertain they are.
#[derive(Debug, Clone, Copy)]
struct Ball {
    time: f64,
    state: Vector4<f64>,
    covariance: Matrix4<f64>,
}

impl Ball {
    fn predict(&mut self, time: f64) {
        let dt = time - self.time;
        let mut motion = Matrix4::identity();
        (motion[(0, 2)], motion[(1, 3)]) = (dt, dt);
        let mut noise = Matrix4::zeros();
        (noise[(2, 2)], noise[(3, 3)]) = (RESTLESS * dt, RESTLESS * dt);
        self.state = motion * self.state;
        self.covariance = motion * self.covariance * motion.transpose() + noise;
        self.time = time;
    }

    fn correct(&mut self, seen: &Vector2<f64>) {
        let see = Matrix2x4::<f64>::identity();
        let uncertain: Matrix2<f64> =
            see * self.covariance * see.transpose() + Matrix2::identity() * CAMERA;
        // It is positive definite: the camera's variance is in it.
        if let Some(inverse) = uncertain.try_inverse() {
            let gain = self.covariance * see.transpose() * inverse;
            self.state += gain * (seen - see * self.state);
            self.covariance = (Matrix4::identity() - gain * see) * self.covariance;
        }
    }
}

impl World {
    /// Balance has said how the robot stands.
    pub fn body(&mut self, body: Body) {
        self.body = body;
    }

    /// The camera has seen the ball, so far from the robot.
    pub fn see(&mut self, from_robot: &Vector2<f64>) {
        let seen = self.body.mass + from_robot;
        let time = self.body.time;
        if let Some(ball) = &mut self.ball {
            ball.predict(time);
            ball.correct(&seen);
        } else {
            self.ball = Some(Ball {
                time,
                state: Vector4::new(seen.x, seen.y, 0.0, 0.0),
                covariance: Matrix4::from_diagonal(&Vector4::new(CAMERA, CAMERA, 0.1, 0.1)),
            });
        }
    }

    /// From the robot to the ball, if it was seen.
    fn distance(&self) -> Option<f64> {
        self.ball.map(|ball| ball.state.x - self.body.mass.x)
    }

    /// How the robot is to walk.
    pub fn wish(&self, request: &Request) -> Wish {
        let step = EAGER * (self.distance().unwrap_or(0.0) - DISTANCE);
        Wish {
            walk: request.walk && self.ball.is_some(),
            step: step.clamp(0.0, STEP),
        }
    }

    /// The values that the operator has chosen.
    pub fn show(&self, request: &Request) -> Shown {
        let middle = (self.body.feet[0] + self.body.feet[1]) / 2.0;
        let value = |what| match what {
            Internal::BallDistance => self.distance().unwrap_or(f64::NAN),
            Internal::BallSpeed => self.ball.map_or(f64::NAN, |ball| ball.state.z),
            Internal::Steps => f64::from(self.body.steps),
            Internal::Capture => (self.body.capture - middle).norm(),
        };
        Shown {
            time: self.body.time,
            values: request.show.map(|what| (what, value(what))),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const REQUEST: Request = Request {
        walk: true,
        law: 0,
        show: [Internal::BallDistance, Internal::BallSpeed, Internal::Steps],
    };

    #[test]
    fn one_sight_counts_once() {
        let mut world = World::default();
        world.see(&Vector2::new(1.0, 0.0));
        assert_eq!(world.ball.unwrap().covariance[(0, 0)], CAMERA);
        world.see(&Vector2::new(1.0, 0.0));
        let twice = world.ball.unwrap().covariance[(0, 0)];
        assert!((twice - CAMERA / 2.0).abs() < 1e-12, "{twice}");
    }

    #[test]
    fn the_ball_is_followed_by_its_noisy_sights() {
        let mut world = World::default();
        assert!(!world.wish(&REQUEST).walk);
        for n in 0..100 {
            let time = f64::from(n) * 0.1;
            let noise = if n % 2 == 0 { 0.03 } else { -0.03 };
            world.body(Body {
                time,
                ..Body::default()
            });
            world.see(&Vector2::new(1.0 + 0.1 * time + noise, noise));
        }
        let [distance, speed, steps] = world.show(&REQUEST).values.map(|(_, value)| value);
        assert!((distance - 1.99).abs() < 0.02, "{distance}");
        assert!((speed - 0.1).abs() < 0.02 && steps == 0.0, "{speed}");
        assert_eq!(world.wish(&REQUEST).step, STEP);
        let walk = false;
        assert!(!world.wish(&Request { walk, ..REQUEST }).walk);
    }
}
