//! One network in three deployments: on one executor, on two cores, on threads of their own.
// ANCHOR: network
use luna::prelude::*;
use luna::system::ProcessBuilder;

/// Two processes and their channel. Where they run is not said here.
fn network(filter: ProcessBuilder, sum: ProcessBuilder) -> luna::Result<()> {
    let (output, input) = luna::channel::<u64>();
    filter.priority(10).spawn(async move {
        for n in (0..1000).filter(|n| n % 3 == 0) {
            output.send(n).await?;
        }
        Ok(())
    })?;
    sum.priority(20).spawn(async move {
        let mut sum = 0;
        while let Ok(n) = input.recv().await {
            sum += n;
        }
        println!("{sum}");
        Ok(())
    })?;
    Ok(())
}
// ANCHOR_END: network

// ANCHOR: places
fn main() -> luna::Result<()> {
    let mut system = System::new("on one executor");
    let main = system.executor("main").policy(Policy::fifo(60)).build()?;
    network(main.process("filter"), main.process("sum"))?;
    system.run()?;

    let mut system = System::new("on two cores");
    let last = std::thread::available_parallelism()?.get() - 1;
    let left = system
        .executor("left")
        .core(0)
        .policy(Policy::fifo(60))
        .build()?;
    let right = system
        .executor("right")
        .core(last)
        .policy(Policy::fifo(80))
        .build()?;
    network(left.process("filter"), right.process("sum"))?;
    system.run()?;

    let mut system = System::new("on threads");
    let (filter, sum) = (system.thread("filter"), system.thread("sum"));
    network(filter.process("filter"), sum.process("sum"))?;
    system.run()?;
    Ok(())
}
// ANCHOR_END: places
