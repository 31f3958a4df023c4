//! Parameters: where their values come from, what is refused, and when a process sees a new value.
#![cfg(feature = "toml")]

use crate::common;
mod declared;
mod files;
mod moved;
mod sets;

use common::{TempFile, setup_error, watchdog};
use luna::Error;
use luna::error::SetupError;
use luna::parameters::Parameters;
use luna::parameters::{DeclareError, Reason, SetError, Source, Value};
use luna::prelude::*;
use luna::system::ProcessBuilder;
use std::fmt::Write as _;
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex};
use std::time::Duration;

const MS: Duration = Duration::from_millis(1);

#[derive(Debug, Clone, Copy, PartialEq)]
enum Mode {
    Position,
    Speed,
}

impl luna::parameters::Choice for Mode {
    const CHOICES: &'static [(&'static str, Mode)] =
        &[("position", Mode::Position), ("speed", Mode::Speed)];
}

/// One parameter of each kind.
struct All {
    kp: Parameter<f64>,
    limit: Parameter<f32>,
    count: Parameter<u8>,
    offset: Parameter<i64>,
    is_on: Parameter<bool>,
    mode: Parameter<Mode>,
    gains: Parameter<[f64; 3]>,
}

/// What they are.
type Values = (f64, f32, u8, i64, bool, Mode, [f64; 3]);

impl All {
    fn declare(process: &ProcessBuilder) -> luna::Result<Self> {
        Ok(Self {
            kp: process
                .parameter("pan/kp", 2.0)
                .unit("1/rad")
                .range(0.0..=50.0)
                .description("of the controller")
                .register()?,
            limit: process
                .parameter("pan/limit", 0.5)
                .range(0.1..=0.9)
                .register()?,
            count: process.parameter("count", 3).register()?,
            offset: process.parameter("offset", -7).range(-10..=10).register()?,
            is_on: process.parameter("is on", false).register()?,
            mode: process.parameter("mode", Mode::Position).register()?,
            gains: process
                .parameter("gains", [1.0, 2.0, 3.0])
                .range(0.0..=9.0)
                .register()?,
        })
    }

    fn get(&self) -> Values {
        (
            self.kp.get(),
            self.limit.get(),
            self.count.get(),
            self.offset.get(),
            self.is_on.get(),
            self.mode.get(),
            self.gains.get(),
        )
    }
}

const DEFAULTS: Values = (2.0, 0.5, 3, -7, false, Mode::Position, [1.0, 2.0, 3.0]);

/// Spawns a process that has what `declare` declares for it.
fn spawn_with<D: Send + 'static>(
    process: ProcessBuilder,
    declare: impl FnOnce(&ProcessBuilder) -> luna::Result<D>,
    body: impl AsyncFnOnce(&D) -> luna::Result<()> + Send + 'static,
) -> luna::Result<()> {
    let declared = declare(&process)?;
    process.spawn(move || async move { body(&declared).await })?;
    Ok(())
}

/// A system with one process that has all kinds, which `body` looks at; on a virtual clock.
fn run_with_all(
    describe: impl FnOnce(&mut System),
    body: impl AsyncFnOnce(&All) -> luna::Result<()> + Send + 'static,
) -> luna::Result<luna::Report> {
    let mut system = System::new("all");
    system.virtual_clock();
    describe(&mut system);
    let main = system.executor("main").build()?;
    spawn_with(main.process("all"), All::declare, body)?;
    system.run()
}
