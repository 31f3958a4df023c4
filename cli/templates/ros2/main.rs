//! A mobile base as a node of a ROS 2 graph: it takes `/cmd_vel`, moves two wheels in a loop at
//! 1 kHz, and publishes `/joint_states`. Without a ROS 2 graph it says so, and stands still.
//!
//! `cargo run --release -- 60` runs for a minute; Ctrl-C ends it earlier.

mod base;
mod bridge;
#[cfg(test)]
mod tests;

use luna::prelude::*;
use std::time::Duration;

fn main() -> luna::Result<()> {
    let mut system = System::new(env!("CARGO_PKG_NAME"));
    // `--deployment system.toml` is taken out: what that file states goes over what is stated in
    // src/base.rs and src/bridge.rs.
    let arguments = system.deployment_arguments(std::env::args().skip(1))?;
    let seconds = seconds(&arguments)?;
    let ends = base::describe(&mut system, Duration::from_secs(seconds))?;
    bridge::describe(&mut system, ends)?;

    // All processes start together here. It returns when all have ended.
    let report = system.run()?;

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
