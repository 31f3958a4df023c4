//! The source of the camera's targets.

use super::Slots;
use crate::AXES;
use crate::joystick::Playback;
use luna::prelude::*;
use std::time::Duration;

/// The joystick is sampled as often as it was recorded.
const PERIOD: Duration = Duration::from_millis(10);

/// Plays the recording to both axes until they have ended.
///
/// A type and not an async function, which would drop what it holds when it returns, still on the
/// real-time path: the recording is heap memory.
pub(crate) struct Joystick {
    pub(crate) playback: Playback,
    pub(crate) sticks: [Sender<f64>; 2],
}

impl Process for Joystick {
    async fn run(&mut self) -> luna::Result<()> {
        let mut tick = luna::periodic("joystick", PERIOD)?;
        let mut slots = Slots::new(Duration::ZERO);
        let mut time = 0.0;
        loop {
            time += slots.elapsed(tick.next().await.deadline).as_secs_f64();
            let deflection = self.playback.at(time);
            for (axis, stick) in AXES.iter().zip(&self.sticks) {
                // From outside: a replay need not have the same file.
                let deflected = luna::replay::input("joystick", || (axis.stick)(deflection));
                if stick.send(deflected).await.is_err() {
                    return Ok(());
                }
            }
        }
    }
}
