//! Who moves the camera.

use super::Slots;
use crate::AXES;
use crate::joystick::Playback;
use luna::prelude::*;
use std::time::Duration;

/// The joystick is sampled as often as it was recorded.
const PERIOD: Duration = Duration::from_millis(10);

/// Plays the recording to both axes until they have ended.
///
/// A type and not an async function, since those drop what they hold when they return, still on the real-time path: the recording is memory.
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
                if stick.send((axis.stick)(deflection)).await.is_err() {
                    return Ok(());
                }
            }
        }
    }
}
