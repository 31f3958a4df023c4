//! Systems on a virtual clock: they behave as on the real clock, time jumps, and nothing depends on
//! the machine.

use crate::common;
mod ends;
mod outside;
mod turns;
mod waits;

use common::watchdog;
use luna::prelude::*;
use std::sync::{Arc, Mutex};
use std::time::Duration;

const MS: Duration = Duration::from_millis(1);
const HOUR: Duration = Duration::from_secs(3600);

/// A system on a virtual clock, and one executor of it.
fn simulated() -> (System, luna::Executor) {
    let mut system = System::new("simulated");
    system.virtual_clock();
    let main = system.executor("main").build().unwrap();
    (system, main)
}

/// What processes note down, in the order in which they do.
#[derive(Clone, Default)]
struct Notes(Arc<Mutex<Vec<(u64, String)>>>);

impl Notes {
    /// The microseconds since the clock's beginning, with `what`.
    fn note(&self, what: impl Into<String>) {
        let micros = (luna::now().as_nanos() - 1_000_000_000) / 1000;
        self.0.lock().unwrap().push((micros, what.into()));
    }

    fn take(&self) -> Vec<(u64, String)> {
        std::mem::take(&mut self.0.lock().unwrap())
    }

    fn names(&self) -> Vec<String> {
        self.take().into_iter().map(|(_, what)| what).collect()
    }
}

async fn sleep_for(time: Duration) -> luna::Result<()> {
    luna::after(time).await;
    Ok(())
}
