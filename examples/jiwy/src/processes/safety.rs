//! Who looks whether the machine does what it is told, and what is done when it does not.

use super::control::Command;
use super::readers::Position;
use crate::AXES;
use crate::parts::faults::{Blocked, Fault, Plausible};
use luna::prelude::*;

/// Notices an encoder that says what cannot be.
pub(crate) async fn watch_encoder(
    mut plausible: Plausible,
    axis: usize,
    positions: Receiver<Position>,
    faults: Sender<(usize, Fault)>,
) -> luna::Result<()> {
    while let Ok(Position {
        raw, since_read, ..
    }) = positions.recv().await
    {
        if let Err(fault) = plausible.check(raw, since_read) {
            faults.send((axis, fault)).await?;
        }
    }
    Ok(())
}

/// Notices an axis that is driven and does not move. While it is being calibrated it is to come to rest at its stops.
pub(crate) async fn watch_motion(
    mut blocked: Blocked,
    axis: usize,
    commands: Receiver<Command>,
    faults: Sender<(usize, Fault)>,
) -> luna::Result<()> {
    while let Ok(command) = commands.recv().await {
        if command.angle.is_some()
            && let Err(fault) = blocked.check(command.duty, command.raw, command.elapsed)
        {
            faults.send((axis, fault)).await?;
        }
    }
    Ok(())
}

/// Switches both motors off at the first fault, and raises an emergency with it, which ends the system.
pub(crate) async fn keep_safe(
    faults: Receiver<(usize, Fault)>,
    gates: [Sender<()>; 2],
) -> luna::Result<()> {
    let Ok((axis, fault)) = faults.recv().await else {
        return Ok(());
    };
    for gate in &gates {
        // Nobody waits for a gate that has ended.
        let _ = gate.send(()).await;
    }
    let cause = luna::Error::other(format!("{}: {fault}", AXES[axis].name));
    Err(luna::emergency(cause))
}
