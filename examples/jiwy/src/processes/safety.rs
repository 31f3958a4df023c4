//! Checks whether the machine follows its commands, and acts if it does not.

use super::control::Command;
use super::readers::Position;
use crate::AXES;
use crate::parts::faults::Fault;
use luna::prelude::*;
use luna_safety_blocks::{Block, Blocked, MaxRate, Sample, Verdict};

/// Detects an encoder with impossible values.
pub(crate) async fn watch_encoder(
    mut plausible: MaxRate,
    axis: usize,
    positions: Receiver<Position>,
    faults: Sender<(usize, Fault)>,
) -> luna::Result<()> {
    while let Ok(Position {
        raw, since_read, ..
    }) = positions.recv().await
    {
        if let Verdict::Refused(found) = plausible.step(&Sample::new(raw, since_read)) {
            faults.send((axis, Fault::Found(found))).await?;
        }
    }
    Ok(())
}

/// Detects an axis that is driven and does not move. During calibration it has to come to rest at
/// its stops.
pub(crate) async fn watch_motion(
    mut blocked: Blocked,
    axis: usize,
    commands: Receiver<Command>,
    faults: Sender<(usize, Fault)>,
) -> luna::Result<()> {
    while let Ok(command) = commands.recv().await {
        let sample = Sample::new(command.duty, command.elapsed).beside(command.raw);
        if command.angle.is_some()
            && let Verdict::Refused(found) = blocked.step(&sample)
        {
            faults.send((axis, Fault::Found(found))).await?;
        }
    }
    Ok(())
}

/// Switches both motors off at the first fault, and raises an emergency with it, which ends the
/// system.
pub(crate) async fn keep_safe(
    faults: Receiver<(usize, Fault)>,
    gates: [Sender<()>; 2],
) -> luna::Result<()> {
    let Ok((axis, fault)) = faults.recv().await else {
        return Ok(());
    };
    for gate in &gates {
        // The gate may have ended.
        let _ = gate.send(()).await;
    }
    let cause = luna::Error::other(format!("{}: {fault}", AXES[axis].name));
    Err(luna::emergency(cause))
}
