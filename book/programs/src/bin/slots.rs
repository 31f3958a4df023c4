//! The slots of a loop, and what happens to those that it misses.
// ANCHOR: all
use luna::prelude::*;
use std::time::Duration;

fn main() -> luna::Result<()> {
    let mut system = System::new("slots");
    system.virtual_clock();
    let main = system.executor("main").build()?;
    main.process("loop").spawn(async {
        let mut tick = luna::periodic("loop", Duration::from_millis(1))?;
        for busy in [0, 0, 2_400, 0, 0] {
            let cycle = tick.next().await;
            println!(
                "slot {}, {:?} after its begin, {} missed before it",
                cycle.number, cycle.lateness, cycle.missed
            );
            luna::after(Duration::from_micros(busy)).await; // the cycle waits so long
        }
        Ok(())
    })?;
    let report = system.run()?;
    let figures = &report.loops["loop"];
    println!("{} cycles, {} missed", figures.cycles, figures.missed);
    Ok(())
}
// ANCHOR_END: all
