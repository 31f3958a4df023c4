//! How late a loop of 1 kHz is: as an ordinary thread, under SCHED_FIFO, and with a guard spin.
// ANCHOR: all
use luna::prelude::*;
use std::time::Duration;

fn main() -> luna::Result<()> {
    for (policy, guard) in [
        (Policy::Other, 0),
        (Policy::fifo(80), 0),
        (Policy::fifo(80), 60),
    ] {
        let mut system = System::new("jitter");
        system.lock_memory();
        let main = system.executor("main").policy(policy).build()?;
        main.process("loop").spawn(async move {
            let mut tick = luna::periodic("loop", Duration::from_millis(1))?
                .guard_spin(Duration::from_micros(guard))?;
            for _ in 0..500 {
                tick.next().await;
            }
            Ok(())
        })?;
        let report = system.run()?;
        let late = &report.loops["loop"].wake_latency;
        println!(
            "{policy}, guard {guard} µs: half within {:.1} µs, 99 % within {:.1} µs, \
             all within {:.1} µs",
            late.percentile(50.0).as_secs_f64() * 1e6,
            late.percentile(99.0).as_secs_f64() * 1e6,
            late.max().as_secs_f64() * 1e6
        );
    }
    Ok(())
}
// ANCHOR_END: all
