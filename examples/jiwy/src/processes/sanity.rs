//! The safety layer (the thesis' *SanityCheck*): what reaches a motor passes all of it. And the writers behind it, which write to the machine.

use super::control::Command;
use crate::network::Findings;
use crate::parts::sanity::{EndStopGuard, Limit, Slew};
use luna::prelude::*;
use luna::record::{self, Value};
use std::sync::Arc;

/// Limits duties, and lets none pass that is no number.
pub(crate) struct Limiter {
    pub(crate) limit: Limit,
    pub(crate) commands: Receiver<Command>,
    pub(crate) limited: Sender<Command>,
    pub(crate) findings: Arc<Findings>,
}

impl Process for Limiter {
    async fn run(&mut self) -> luna::Result<()> {
        while let Ok(mut command) = self.commands.recv().await {
            command.duty = self.limit.check(command.duty, command.raw);
            self.limited.send(command).await?;
        }
        Ok(())
    }

    fn post_run(&mut self) {
        let _ = self.findings.limit.set(self.limit.clone());
    }
}

/// Lets duties change only so fast.
pub(crate) struct SlewLimiter {
    pub(crate) slew: Slew,
    pub(crate) commands: Receiver<Command>,
    pub(crate) slewed: Sender<Command>,
    pub(crate) findings: Arc<Findings>,
}

impl Process for SlewLimiter {
    async fn run(&mut self) -> luna::Result<()> {
        while let Ok(mut command) = self.commands.recv().await {
            command.duty = self.slew.check(command.duty, command.elapsed);
            self.slewed.send(command).await?;
        }
        Ok(())
    }

    fn post_run(&mut self) {
        let _ = self.findings.slew.set(self.slew.clone());
    }
}

/// Lets nothing drive a calibrated axis into its end stops.
pub(crate) struct Guard {
    pub(crate) guard: EndStopGuard,
    pub(crate) commands: Receiver<Command>,
    pub(crate) guarded: Sender<Command>,
    pub(crate) findings: Arc<Findings>,
}

impl Process for Guard {
    async fn run(&mut self) -> luna::Result<()> {
        while let Ok(mut command) = self.commands.recv().await {
            if let Some(angle) = command.angle {
                command.duty = self.guard.check(command.duty, angle);
            }
            self.guarded.send(command).await?;
        }
        Ok(())
    }

    fn post_run(&mut self) {
        let _ = self.findings.guard.set(self.guard.clone());
    }
}

/// What is written to a bridge.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Drive {
    duty: f64,
    enable: bool,
}

/// Lets commands pass while the machine is safe; then the motor is off for good.
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

/// Gives each writer its part.
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
        record::output("register", &value);
        register.send(value).await?;
    }
    record::output("register", &last);
    register.send(last).await?;
    Ok(())
}
