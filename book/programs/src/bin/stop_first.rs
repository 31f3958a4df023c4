//! A stop before all other work: what `pri_alt!` does, and what it does not.
// ANCHOR: late
use luna::prelude::*;
use std::time::Duration;

const STEP: Duration = Duration::from_millis(10);

/// Prefers the stop whenever it chooses. During a step it does not choose.
async fn late(stop: Receiver<()>, steps: Receiver<u32>) -> luna::Result<()> {
    loop {
        pri_alt! {
            stopped = stop.recv() => return stopped.map_err(luna::Error::from),
            step = steps.recv() => {
                println!("  step {} begins", step?);
                luna::after(STEP).await; // it moves
            },
        }
    }
}
// ANCHOR_END: late

// ANCHOR: prompt
/// Waits only where the stop is the first choice.
async fn prompt(stop: Receiver<()>, steps: Receiver<u32>) -> luna::Result<()> {
    let (mut is_moving, mut arrives) = (false, luna::now());
    loop {
        pri_alt! {
            stopped = stop.recv() => return stopped.map_err(luna::Error::from),
            _ = luna::at(arrives), if is_moving => is_moving = false,
            step = steps.recv(), if !is_moving => {
                println!("  step {} begins", step?);
                (is_moving, arrives) = (true, luna::now() + STEP);
            },
        }
    }
}
// ANCHOR_END: prompt

// ANCHOR: use
fn run(name: &str, is_prompt: bool) -> luna::Result<()> {
    let mut system = System::new(name);
    system.virtual_clock();
    let main = system.executor("main").build()?;
    let (press, stop) = luna::buffered(Buffer::fifo(1));
    let (plan, steps) = luna::buffered(Buffer::fifo(8));
    let (press, plan) = (press.named("stop"), plan.named("steps"));
    println!("{name}:");
    main.process("axis").priority(20).spawn(async move {
        let begin = luna::now();
        if is_prompt {
            prompt(stop, steps).await?;
        } else {
            late(stop, steps).await?;
        }
        println!("  stopped after {:?}", luna::now() - begin);
        Ok(())
    })?;
    main.process("operator").spawn(async move {
        for step in 1..=3 {
            plan.send(step).await?; // all three wait when the stop comes
        }
        luna::after(STEP / 2).await;
        press.send(()).await?;
        luna::after(STEP).await; // and holds its ends as long
        Ok(())
    })?;
    system.run()?;
    Ok(())
}

fn main() -> luna::Result<()> {
    run("late", false)?;
    run("prompt", true)
}
// ANCHOR_END: use
