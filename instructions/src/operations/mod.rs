//! The operations that are counted: each a network on one executor, without a real-time policy, with one process that counts laps.

mod alternatives;
mod channels;
mod networks;
mod processes;
mod shared;

use luna::prelude::*;

/// Something that is counted.
#[derive(Debug)]
pub(crate) struct Operation {
    /// What it is called in tables and in the recorded figures.
    pub(crate) name: &'static str,
    /// How many steps the shorter of both laps has: enough for what happens now and then to be there in its share.
    pub(crate) steps: u64,
    /// How many operations a step is.
    pub(crate) each: u64,
    /// Does the laps.
    pub(crate) run: fn(u64) -> luna::Result<()>,
}

/// All of them, in the order of the tables.
pub(crate) static ALL: &[Operation] = &[
    Operation {
        name: "commstime cycle, sequential delta",
        steps: 500,
        each: 1,
        run: networks::commstime_sequential,
    },
    Operation {
        name: "commstime cycle, parallel delta",
        steps: 500,
        each: 1,
        run: networks::commstime_parallel,
    },
    Operation {
        name: "ring of 1000, a hop",
        steps: 3,
        each: networks::RING,
        run: networks::ring,
    },
    Operation {
        name: "rendezvous",
        steps: 500,
        each: 1,
        run: channels::rendezvous,
    },
    Operation {
        name: "buffered send and recv",
        steps: 500,
        each: 1,
        run: channels::buffered,
    },
    Operation {
        name: "try_send and try_recv, plain thread",
        steps: 500,
        each: 1,
        run: channels::plain_thread,
    },
    Operation {
        name: "alt! of 2",
        steps: 512,
        each: 1,
        run: alternatives::alt_2,
    },
    Operation {
        name: "alt! of 8",
        steps: 512,
        each: 1,
        run: alternatives::alt_8,
    },
    Operation {
        name: "Alternative of 8",
        steps: 512,
        each: 1,
        run: alternatives::registered::<8>,
    },
    Operation {
        name: "Alternative of 64",
        steps: 512,
        each: 1,
        run: alternatives::registered::<64>,
    },
    Operation {
        name: "Alternative of 1024",
        steps: 2048,
        each: 1,
        run: alternatives::registered::<1024>,
    },
    Operation {
        name: "switch",
        steps: 500,
        each: 2,
        run: processes::switch,
    },
    Operation {
        name: "wake itself",
        steps: 500,
        each: 1,
        run: processes::wake_itself,
    },
    Operation {
        name: "spawn and join",
        steps: 64,
        each: 1,
        run: processes::spawn_and_join,
    },
    Operation {
        name: "timer armed and expired",
        steps: 40,
        each: 1,
        run: processes::timer,
    },
    Operation {
        name: "barrier of 8, a round",
        steps: 200,
        each: 1,
        run: shared::barrier,
    },
    Operation {
        name: "mutex lock and unlock",
        steps: 500,
        each: 1,
        run: shared::mutex,
    },
];

/// Runs what `spawn` puts on a system's one executor.
fn on_one_executor(
    name: &str,
    spawn: impl FnOnce(&luna::Executor) -> luna::Result<()>,
) -> luna::Result<()> {
    let mut system = System::new(name);
    let executor = system.executor("executor").build()?;
    spawn(&executor)?;
    system.run()?;
    Ok(())
}
