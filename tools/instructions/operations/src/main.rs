//! LUNA's hot operations, each as a network on one executor without a real-time policy, in which
//! one process counts laps.
//!
//! `luna-instructions` runs this program in callgrind, with `do` and an operation's name. `list`
//! prints the compiler, the C library, this program's path, and the operations, each with the
//! number of operations by which its last two laps differ.

mod alternatives;
mod channels;
mod deadlines;
mod laps;
mod networks;
mod processes;
mod shared;

use luna::prelude::*;
use std::env;

/// Something that is counted.
struct Operation {
    /// What it is called in tables and in the recorded figures.
    name: &'static str,
    /// The number of steps of the shorter of both laps: enough for rare events to have their share.
    steps: u64,
    /// How many operations a step is.
    each: u64,
    /// Does the laps.
    run: fn(u64) -> luna::Result<()>,
}

const fn operation(
    name: &'static str,
    (steps, each): (u64, u64),
    run: fn(u64) -> luna::Result<()>,
) -> Operation {
    Operation {
        name,
        steps,
        each,
        run,
    }
}

/// All of them, in the order of the tables.
static ALL: &[Operation] = &[
    operation(
        "commstime cycle, sequential delta",
        (500, 1),
        networks::commstime_sequential,
    ),
    operation(
        "commstime cycle, parallel delta",
        (500, 1),
        networks::commstime_parallel,
    ),
    operation(
        "commstime cycle, with deadlines",
        (500, 1),
        networks::commstime_with_deadlines,
    ),
    operation("ring of 1000, a hop", (16, networks::RING), networks::ring),
    operation("rendezvous", (500, 1), channels::rendezvous),
    operation(
        "rendezvous, with deadlines",
        (500, 1),
        channels::rendezvous_with_deadlines,
    ),
    operation(
        "rendezvous with a timeout, with deadlines",
        (500, 1),
        channels::rendezvous_in_time,
    ),
    operation("buffered send and recv", (500, 1), channels::buffered),
    operation(
        "buffered send_timeout and recv_timeout",
        (500, 1),
        channels::buffered_in_time,
    ),
    operation(
        "buffered send_deadline and recv_deadline",
        (500, 1),
        channels::buffered_until,
    ),
    operation(
        "try_send and try_recv, plain thread",
        (500, 1),
        channels::plain_thread,
    ),
    operation("alt! of 2", (512, 1), alternatives::alt_2),
    operation("alt! of 8", (512, 1), alternatives::alt_8),
    operation("Alternative of 8", (512, 1), alternatives::registered::<8>),
    operation(
        "Alternative of 64",
        (2048, 1),
        alternatives::registered::<64>,
    ),
    operation(
        "Alternative of 1024",
        (32_768, 1),
        alternatives::registered::<1024>,
    ),
    operation("switch", (500, 2), processes::switch),
    operation(
        "switch, with deadlines",
        (500, 2),
        processes::switch_with_deadlines,
    ),
    operation("wake itself", (500, 1), processes::wake_itself),
    operation("spawn and join", (192, 1), processes::spawn_and_join),
    operation(
        "start and join, one of many",
        (2048, 1),
        processes::start_and_join,
    ),
    operation(
        "timeout set and cancelled, with deadlines",
        (500, 1),
        processes::timeout,
    ),
    operation("timer armed and expired", (40, 1), processes::timer),
    operation("barrier of 8, a round", (200, 1), shared::barrier),
    operation("mutex lock and unlock", (500, 1), shared::mutex),
];

fn main() -> luna::Result<()> {
    let arguments: Vec<String> = env::args().skip(1).collect();
    match &arguments[..] {
        [command] if command == "list" => list(),
        [command, name] if command == "do" => {
            let chosen = ALL.iter().find(|operation| operation.name == name);
            let Operation { steps, run, .. } = chosen.expect("an operation of the list");
            return run(*steps);
        }
        _ => eprintln!("This program is run by luna-instructions."),
    }
    Ok(())
}

fn list() {
    println!("{}", env!("LUNA_COMPILER"));
    println!("{}", c_library());
    let path = env::current_exe().expect("the kernel knows it");
    println!("{}", path.display());
    for Operation {
        name, steps, each, ..
    } in ALL
    {
        println!("{} {name}", steps * each);
    }
}

/// What copies memory, allocates, and makes system calls.
#[cfg(target_env = "gnu")]
fn c_library() -> String {
    // SAFETY: the function takes nothing and returns a text that ends with a zero and is never
    // changed or freed.
    let version = unsafe { std::ffi::CStr::from_ptr(libc::gnu_get_libc_version()) };
    format!("glibc {}", version.to_string_lossy())
}

#[cfg(not(target_env = "gnu"))]
fn c_library() -> String {
    "not glibc".to_owned()
}

/// Runs what `spawn` puts on a system's one executor.
fn on_one_executor<T>(
    name: &str,
    spawn: impl FnOnce(&luna::Executor) -> luna::Result<T>,
) -> luna::Result<()> {
    let mut system = System::new(name);
    let executor = system.executor("executor").build()?;
    spawn(&executor)?;
    system.run()?;
    Ok(())
}
