//! The safety layer (the thesis' *SanityCheck*), which all values for a motor pass, and the writers
//! behind it, which write to the machine.

use super::control::Command;
use crate::network::Findings;
use crate::parts::sanity::Sanity;
use luna::prelude::*;
use luna::replay::{self, Value};
use luna_safety_blocks::Block;
use std::sync::{Arc, OnceLock};

/// One block of the safety layer.
pub(crate) struct Checking<B> {
    pub(crate) sanity: Sanity<B>,
    /// The angle that the block gets with a duty; without one the duty passes.
    pub(crate) angle: fn(&Command) -> Option<f64>,
    pub(crate) commands: Receiver<Command>,
    pub(crate) checked: Sender<Command>,
    pub(crate) findings: Arc<Findings>,
    /// Where it leaves in them what it has found.
    pub(crate) left: fn(&Findings) -> &OnceLock<Sanity<B>>,
}

impl<B: Block + Clone> Process for Checking<B> {
    async fn run(&mut self) -> luna::Result<()> {
        while let Ok(mut command) = self.commands.recv().await {
            if let Some(angle) = (self.angle)(&command) {
                command.duty = self.sanity.check(command.duty, angle, command.elapsed);
            }
            self.checked.send(command).await?;
        }
        Ok(())
    }

    fn post_run(&mut self) {
        let _ = (self.left)(&self.findings).set(self.sanity.clone());
    }
}

/// The values for a bridge.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Drive {
    duty: f64,
    enable: bool,
}

/// Lets commands pass while the machine is safe; after that the motor is off for good.
pub(crate) async fn gate(
    commands: Receiver<Command>,
    unsafe_now: Receiver<()>,
    seen: Sender<Command>,
    drives: Sender<Drive>,
) -> luna::Result<()> {
    let mut enable = true;
    while let Ok(mut command) = commands.recv().await {
        enable &= unsafe_now.try_recv().is_err();
        if !enable {
            command.duty = 0.0;
        }
        seen.send(command).await?;
        let duty = command.duty;
        drives.send(Drive { duty, enable }).await?;
    }
    Ok(())
}

/// Sends each writer its part.
pub(crate) async fn write_motor(
    drives: Receiver<Drive>,
    enables: Sender<bool>,
    duties: Sender<f64>,
) -> luna::Result<()> {
    while let Ok(Drive { duty, enable }) = drives.recv().await {
        enables.send(enable).await?;
        duties.send(duty).await?;
    }
    Ok(())
}

/// Writes each value to the machine, and `last` at the end.
pub(crate) async fn write_register<T: Copy + Value>(
    last: T,
    values: Receiver<T>,
    register: Sender<T>,
) -> luna::Result<()> {
    while let Ok(value) = values.recv().await {
        replay::output("register", &value);
        register.send(value).await?;
    }
    replay::output("register", &last);
    register.send(last).await?;
    Ok(())
}
