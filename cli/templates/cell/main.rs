//! A small cell: a feeder, a conveyor, a press and a stacker, and a watch over them. Each is a
//! process, and they communicate over channels alone.
//!
//! `cargo run --release -- 60` feeds for a minute; Ctrl-C ends it earlier, with the press open.

mod cell;
#[cfg(test)]
mod tests;

use luna::prelude::*;
use std::time::Duration;

fn main() -> luna::Result<()> {
    let mut system = System::new(env!("CARGO_PKG_NAME"));
    // `--deployment system.toml` is taken out: what that file states goes over what is stated in
    // src/cell.rs.
    let arguments = system.deployment_arguments(std::env::args().skip(1))?;
    let seconds = match arguments.first() {
        Some(text) => text.parse().map_err(luna::Error::other)?,
        None => 10,
    };
    let cell = cell::describe(&mut system, Duration::from_secs(seconds), None)?;

    // All processes start together here. It returns when all have ended.
    let report = system.run()?;

    println!("{report}");
    println!("{} blocks were stacked", cell.stacked());
    Ok(())
}
