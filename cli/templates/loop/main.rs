//! A loop at 1 kHz, and how late its cycles began.
//!
//! `cargo run --release -- 60` runs for a minute; Ctrl-C ends it earlier, in order.

#[cfg(test)]
mod tests;

use luna::prelude::*;
use std::time::Duration;

/// Of the loop, also in the tests. The system file may state another one.
const PERIOD: Duration = Duration::from_millis(1);

fn main() -> luna::Result<()> {
    let mut system = System::new(env!("CARGO_PKG_NAME"));
    // `--deployment system.toml` is taken out: what that file states goes over what is stated here.
    let arguments = system.deployment_arguments(std::env::args().skip(1))?;
    let seconds = seconds(&arguments)?;
    describe(&mut system, Duration::from_secs(seconds))?;

    // All processes start together here. It returns when all have ended.
    let report = system.run()?;

    // A row for each loop: how late its cycles began, and the time from one to the next.
    println!("{report}");
    Ok(())
}

/// How long to run: the one argument, 10 without it.
fn seconds(arguments: &[String]) -> luna::Result<u64> {
    let refused = |text: &str, why: &str| Err(luna::Error::other(format!("`{text}`: {why}")));
    match arguments {
        [] => Ok(10),
        [text] => match text.parse() {
            Ok(seconds) => Ok(seconds),
            Err(_) => refused(text, "the argument is a number of seconds"),
        },
        [_, further, ..] => refused(further, "this argument is one too many"),
    }
}

/// What the system is made of, and where each part runs. Tests describe the same one.
fn describe(system: &mut System, duration: Duration) -> luna::Result<()> {
    // An executor is one OS thread that runs many processes, the most urgent first. Where real-time
    // scheduling is not allowed it runs all the same, and one line says what to do. On the machine
    // it has a core too: see system.toml.
    let control = system
        .executor("control")
        .policy(Policy::fifo(80))
        .build()?;

    control.process("control").priority(20).spawn(async move {
        // The loop wakes up at absolute times: a late cycle does not shift the next ones.
        let mut tick = luna::periodic("control", PERIOD)?;
        let cycles = duration.as_nanos() / tick.period().as_nanos();
        loop {
            // It has the slot's number, how late it is, and how many slots were missed.
            let cycle = tick.next().await;
            // Here: read the sensors, compute, write the actuators.
            if u128::from(cycle.number) >= cycles {
                return Ok(());
            }
        }
    })?;
    Ok(())
}
