//! Two processes and a rendezvous channel: the smallest program.
// ANCHOR: all
use luna::prelude::*;

fn main() -> luna::Result<()> {
    let (numbers, printer) = luna::channel::<u32>();
    luna::run(async move {
        par!(
            async move {
                for n in 0..3 {
                    numbers.send(n).await?; // returns once the value was taken
                }
                Ok::<(), luna::Error>(()) // dropping the last sender closes the channel
            },
            async move {
                while let Ok(n) = printer.recv().await {
                    println!("{n}");
                }
                Ok(())
            },
        )
        .await?;
        Ok(())
    })
}
// ANCHOR_END: all
