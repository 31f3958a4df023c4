//! A loop that records a signal and a message to a file.
// ANCHOR: all
use luna::log::{self, Level};
use luna::prelude::*;
use std::time::Duration;

fn main() -> luna::Result<()> {
    let mut system = System::new("drive");
    system.log_to("drive.luna");
    let control = system.executor("control").build()?;
    let drive = control.process("drive");
    let current = drive
        .signal("drive/current")
        .unit("A")
        .description("of the motor")
        .register()?;
    drive.spawn(async move {
        let mut tick = luna::periodic("drive", Duration::from_millis(1))?;
        for n in 0..10 {
            tick.next().await;
            current.record(f64::from(n) * 0.1); // no allocation, no system call, no wait
        }
        log::message(Level::Info, "drive", format_args!("done"));
        Ok(())
    })?;
    let report = system.run()?;
    if let Some(logging) = report.logging {
        println!("{logging}");
    }
    Ok(())
}
// ANCHOR_END: all
