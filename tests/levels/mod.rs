//! One executor with processes of several levels, and the order of what happens there: for tests of
//! priority inheritance.

#![allow(dead_code, reason = "each test program uses some of it")]

use crate::common::{Log, SpawnOk};
use luna::prelude::*;
use luna::system::ProcessBuilder;
use luna::yield_now;
use luna_core::current;

pub(crate) fn level() -> u8 {
    current::priority().level
}

/// A system with one executor.
pub(crate) fn on_one_executor(build: impl FnOnce(&dyn Fn(&str, u8) -> ProcessBuilder)) {
    let mut system = System::new("levels");
    let executor = system.executor("one").build().unwrap();
    build(&|name, level| executor.process(name).priority(level));
    system.run().unwrap();
}

/// A process that becomes ready for long when it is sent a message, and logs each time that it
/// runs.
pub(crate) fn burner(process: ProcessBuilder, log: &Log) -> luna::Sender<()> {
    let (start, started) = luna::channel::<()>();
    let log = log.clone();
    process.spawn_ok(async move {
        started.recv().await?;
        for _ in 0..50 {
            log.add("burn");
            yield_now().await;
        }
        Ok(())
    });
    start
}
