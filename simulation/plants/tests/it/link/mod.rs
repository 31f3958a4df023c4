//! Plants connected to processes: by the clock and in lock-step, their begin, their end, and their
//! failures.

mod devices;
mod exchange;
mod faults;

use luna::prelude::*;
use luna_plants::{Plant, PlantLink, PlantProcess};
use std::time::Duration;

const MS: Duration = Duration::from_millis(1);

/// The two port methods of a plant with all ports in one array, this many inputs first.
macro_rules! inputs_first {
    ($inputs:literal) => {
        fn inputs(&self) -> &[Port] {
            &self.ports[..$inputs]
        }

        fn outputs(&self) -> &[Port] {
            &self.ports[$inputs..]
        }
    };
}
use inputs_first;

fn register<T: Send>() -> (Sender<T>, Receiver<T>) {
    luna::buffered(Buffer::overwrite_oldest(1))
}

fn system(name: &str) -> (System, luna::Executor) {
    let mut system = System::new(name);
    let main = system.executor("main").build().unwrap();
    (system, main)
}

/// The plant as a process, at either of its paces: a millisecond a step.
fn process<P: Plant + Send + 'static>(link: PlantLink<P>, lock_step: bool) -> PlantProcess<P> {
    let process = if lock_step {
        link.lock_step(MS)
    } else {
        link.periodic(MS)
    };
    process.unwrap()
}
