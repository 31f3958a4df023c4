//! A rendezvous, a register, and the two ends of a channel: closed and poisoned.
use luna::prelude::*;

// ANCHOR: rendezvous
/// A send returns when its value was taken.
async fn rendezvous() -> luna::Result<()> {
    let (output, input) = luna::channel();
    par!(
        async move {
            for n in 1..=2 {
                println!("offered {n}");
                output.send(n).await?;
                println!("{n} was taken");
            }
            Ok::<(), luna::Error>(())
        },
        async move {
            luna::after(std::time::Duration::from_millis(10)).await;
            while let Ok(n) = input.recv().await {
                println!("took {n}");
            }
            Ok(())
        },
    )
    .await?;
    Ok(())
}
// ANCHOR_END: rendezvous

// ANCHOR: register
/// A buffer of one that overwrites its oldest value: the reader gets the latest one.
async fn register() -> luna::Result<()> {
    let (output, input) = luna::buffered(Buffer::overwrite_oldest(1));
    for temperature in [20.5, 20.7, 21.0] {
        output.send(temperature).await?; // never waits
    }
    println!("it is {} degrees", input.recv().await?);
    Ok(())
}
// ANCHOR_END: register

// ANCHOR: ends
/// A channel that closes still has its values. A channel that is poisoned has none.
async fn ends() -> luna::Result<()> {
    let (output, input) = luna::buffered(Buffer::fifo(4));
    output.send("last").await?;
    drop(output);
    println!("{:?}, then {:?}", input.recv().await, input.recv().await);

    let (output, input) = luna::buffered(Buffer::fifo(4));
    output.send("lost").await?;
    output.poison();
    println!("{:?}", input.recv().await);
    Ok(())
}
// ANCHOR_END: ends

fn main() -> luna::Result<()> {
    let mut system = System::new("channels");
    system.virtual_clock();
    let main = system.executor("main").build()?;
    main.process("all").spawn(async {
        rendezvous().await?;
        register().await?;
        ends().await
    })?;
    system.run()?;
    Ok(())
}
