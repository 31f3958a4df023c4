//! Four processes become ready at one instant. Executors and levels say which runs first.
// ANCHOR: all
use luna::prelude::*;
use std::time::Duration;

fn main() -> luna::Result<()> {
    let mut system = System::new("order");
    system.virtual_clock();
    let urgent = system.executor("urgent").policy(Policy::fifo(80)).build()?;
    let slow = system.executor("slow").policy(Policy::fifo(20)).build()?;

    for (executor, name, level) in [
        (&slow, "planner", 31),
        (&urgent, "position loop", 20),
        (&urgent, "current loop", 30),
        (&slow, "display", 5),
    ] {
        executor.process(name).priority(level).spawn(async move {
            luna::after(Duration::from_millis(1)).await;
            println!("{name}");
            Ok(())
        })?;
    }
    system.run()?;
    Ok(())
}
// ANCHOR_END: all
