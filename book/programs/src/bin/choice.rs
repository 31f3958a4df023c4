//! A relay that chooses: it takes a value or passes one on, and it heeds a stop first of all.
// ANCHOR: relay
use luna::prelude::*;
use std::time::Duration;

async fn relay(
    input: Receiver<u32>,
    output: Sender<u32>,
    stop: Receiver<()>,
) -> luna::Result<&'static str> {
    let mut next = None; // what is on offer
    loop {
        pri_alt! {
            _ = stop.recv() => return Ok("stopped"),
            value = input.recv(), if next.is_none() => next = Some(value?),
            sent = output.send_from(&mut next), if next.is_some() => sent?,
            _ = luna::after(Duration::from_millis(100)) => return Ok("nothing happened for 100 ms"),
        }
    }
}
// ANCHOR_END: relay

// ANCHOR: use
fn main() -> luna::Result<()> {
    for is_stopped in [true, false] {
        let mut system = System::new("relay");
        system.virtual_clock();
        let main = system.executor("main").build()?;
        let (put, input) = luna::channel();
        let (output, got) = luna::channel();
        let (stop, stopped) = luna::channel();
        main.process("relay").spawn(async move {
            println!("{}", relay(input, output, stopped).await?);
            Ok(())
        })?;
        main.process("user").spawn(async move {
            put.send(7).await?;
            println!("{}", got.recv().await?);
            if is_stopped {
                stop.send(()).await?;
            }
            luna::after(Duration::from_secs(1)).await; // and holds its ends as long
            Ok(())
        })?;
        system.run()?;
    }
    Ok(())
}
// ANCHOR_END: use
