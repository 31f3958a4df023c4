//! What a rendezvous costs on this machine: on one executor, and between two.
// ANCHOR: all
use luna::prelude::*;
use std::time::Instant;

const MESSAGES: u32 = 20_000;

fn main() -> luna::Result<()> {
    for executors in [1, 2] {
        let mut system = System::new("cost");
        let left = system.executor("left").build()?;
        let right = system.executor("right").build()?;
        let (output, input) = luna::channel();
        left.process("source").spawn(async move {
            for n in 0..MESSAGES {
                output.send(n).await?;
            }
            Ok(())
        })?;
        let sink = if executors == 1 { left } else { right };
        sink.process("sink").spawn(async move {
            let start = Instant::now();
            while input.recv().await.is_ok() {}
            let each = start.elapsed() / MESSAGES;
            println!("executors {executors}: {} ns a message", each.as_nanos());
            Ok(())
        })?;
        system.run()?;
    }
    Ok(())
}
// ANCHOR_END: all
