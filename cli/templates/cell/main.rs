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
    let seconds = seconds(&arguments)?;
    let cell = cell::describe(&mut system, Duration::from_secs(seconds), None)?;

    // All processes start together here. It returns when all have ended.
    let report = system.run()?;

    println!("{report}");
    println!("{} blocks were stacked", cell.stacked());
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
