//! The readers of an axis, which read the machine and the operator, and the scaling of their
//! values.

use super::timer::Tick;
use crate::Axis;
use luna::prelude::*;
use luna_plants::Decoder;
use std::time::Duration;

/// What the encoder's counter read.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Count {
    count: i32,
    elapsed: Duration,
    since_read: Duration,
}

/// Where an axis is, counted from wherever its encoder was switched on.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Position {
    /// In rad.
    pub(crate) raw: f64,
    /// Since the cycle before.
    pub(crate) elapsed: Duration,
    /// The time since the previous position: more than a cycle if the counter was missing in
    /// between.
    pub(crate) since_read: Duration,
}

/// Reads the counter's register in each cycle.
pub(crate) async fn read_position(
    mut newest: i32,
    ticks: Receiver<Tick>,
    register: Receiver<i32>,
    counts: Sender<Count>,
) -> luna::Result<()> {
    let mut since_read = Duration::ZERO;
    while let Ok(Tick { elapsed }) = ticks.recv().await {
        since_read += elapsed;
        let read = register.try_recv();
        if let Ok(count) = read {
            newest = count;
        }
        counts
            .send(Count {
                count: newest,
                elapsed,
                since_read,
            })
            .await?;
        if read.is_ok() {
            since_read = Duration::ZERO;
        }
    }
    Ok(())
}

/// Reads the joystick's register in each cycle.
pub(crate) async fn read_joystick(
    ticks: Receiver<Tick>,
    register: Receiver<f64>,
    deflections: Sender<f64>,
) -> luna::Result<()> {
    let mut newest = 0.0;
    while ticks.recv().await.is_ok() {
        if let Ok(deflection) = register.try_recv() {
            newest = deflection;
        }
        deflections.send(newest).await?;
    }
    Ok(())
}

/// From counts to rad.
pub(crate) async fn scale_position(
    mut decoder: Decoder,
    counts: Receiver<Count>,
    positions: [Sender<Position>; 2],
) -> luna::Result<()> {
    while let Ok(Count {
        count,
        elapsed,
        since_read,
    }) = counts.recv().await
    {
        let raw = decoder.angle(count);
        for reader in &positions {
            reader
                .send(Position {
                    raw,
                    elapsed,
                    since_read,
                })
                .await?;
        }
    }
    Ok(())
}

/// From a deflection to its angle: full deflection is the end of the axis' range.
pub(crate) async fn scale_joystick(
    axis: &'static Axis,
    deflections: Receiver<f64>,
    targets: Sender<f64>,
) -> luna::Result<()> {
    while let Ok(deflection) = deflections.recv().await {
        targets
            .send(axis.range * deflection.clamp(-1.0, 1.0))
            .await?;
    }
    Ok(())
}
