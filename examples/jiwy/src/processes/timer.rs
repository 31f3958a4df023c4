//! Makes the model periodic (the thesis' *TimerWriter*): one loop, which the whole model waits for
//! in each cycle.

use super::Slots;
use luna::prelude::*;
use std::time::Duration;

/// A cycle begins.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Tick {
    /// Since the cycle before.
    pub(crate) elapsed: Duration,
}

/// Begins `cycles` cycles, for pan and for tilt.
pub(crate) async fn write_timer(
    period: Duration,
    cycles: u64,
    ticks: [Sender<Tick>; 2],
) -> luna::Result<()> {
    let mut tick = luna::periodic(crate::network::LOOP, period)?;
    let mut slots = Slots::new(period);
    for _ in 0..cycles {
        // By slots, not by wake-up times; a missed slot is part of the elapsed time.
        let elapsed = slots.elapsed(tick.next().await.deadline);
        for axis in &ticks {
            axis.send(Tick { elapsed }).await?;
        }
    }
    Ok(())
}

/// Begins a cycle of one axis: both of its readers read.
pub(crate) async fn read_timer(
    ticks: Receiver<Tick>,
    position: Sender<Tick>,
    joystick: Sender<Tick>,
) -> luna::Result<()> {
    while let Ok(tick) = ticks.recv().await {
        position.send(tick).await?;
        joystick.send(tick).await?;
    }
    Ok(())
}
