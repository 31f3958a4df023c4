//! How late a loop of 1 kHz is: as an ordinary thread, and under SCHED_FIFO with locked memory.
// ANCHOR: all
use luna::prelude::*;
use std::time::Duration;

fn main() -> luna::Result<()> {
    for policy in [Policy::Other, Policy::fifo(80)] {
        let mut system = System::new("jitter");
        system.lock_memory();
        let main = system.executor("main").policy(policy).build()?;
        main.process("loop").spawn(async {
            let mut tick = luna::periodic("loop", Duration::from_millis(1))?;
            for _ in 0..500 {
                tick.next().await;
            }
            Ok(())
        })?;
        let report = system.run()?;
        let late = &report.loops["loop"].wake_latency;
        println!(
            "{policy}: half within {} us, 99 % within {} us, all within {} us",
            late.percentile(50.0).as_micros(),
            late.percentile(99.0).as_micros(),
            late.max().as_micros()
        );
    }
    Ok(())
}
// ANCHOR_END: all
