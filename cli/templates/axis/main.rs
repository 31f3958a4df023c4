//! One axis: a simulated motor, a PID loop at 1 kHz, set-points, and a safety layer between the
//! loop and the motor.
//!
//! `cargo run --release -- 60` runs for a minute; Ctrl-C ends it earlier, with the bridge off.

mod axis;
#[cfg(test)]
mod tests;

use luna::prelude::*;
use std::time::Duration;

fn main() -> luna::Result<()> {
    let mut system = System::new(env!("CARGO_PKG_NAME"));
    // `--deployment system.toml` is taken out: what that file states goes over what is stated in
    // src/axis.rs. `--set axis/kp=5` sets a parameter, `--parameters FILE` many.
    let arguments = system.deployment_arguments(std::env::args().skip(1))?;
    let arguments = system.parameter_arguments(arguments)?;
    let seconds = seconds(&arguments)?;
    let outcome = axis::describe(&mut system, 0.8, Duration::from_secs(seconds))?;

    // All processes start together here. It returns when all have ended.
    let report = system.run()?;

    println!("{report}");
    println!("largest error: {:.4} rad", outcome.largest_error());
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
