//! LUNA's side of the page for readers with tokio: the same as `from_tokio_theirs`.
// ANCHOR: actor
use luna::channel::{Client, Server, call_channel};
use luna::prelude::*;
use std::time::Duration;

async fn counter(adds: Receiver<u32>, totals: Server<(), u32>) -> luna::Result<()> {
    let mut total = 0;
    loop {
        pri_alt! {
            n = adds.recv() => match n {
                Ok(n) => total += n,
                Err(_) => return Ok(()), // the user has gone
            },
            call = totals.accept() => match call {
                Ok(call) => drop(call.reply(total)),
                Err(_) => return Ok(()),
            },
        }
    }
}

async fn user(adds: Sender<u32>, totals: Client<(), u32>) -> luna::Result<u32> {
    adds.send(2).await?; // a rendezvous: the counter has it
    adds.send(3).await?;
    Ok(totals.call(()).await?)
}
// ANCHOR_END: actor

// ANCHOR: select
async fn merge(left: Receiver<u32>, right: Receiver<u32>) -> u32 {
    let inputs = [left, right];
    let mut both = Alternative::fair(&inputs);
    let (mut sum, mut open) = (0, inputs.len());
    while open > 0 {
        match both.recv().await {
            (_, Ok(n)) => sum += n,
            (_, Err(_)) => open -= 1, // this one is closed
        }
    }
    sum
}
// ANCHOR_END: select

// ANCHOR: loop
async fn control(targets: Receiver<f64>) -> luna::Result<f64> {
    let mut tick = luna::periodic("control", Duration::from_millis(1))?;
    let (mut target, mut place) = (0.0, 0.0);
    for _ in 0..100 {
        tick.next().await; // how late it is, and what it missed, is in the report
        if let Ok(new) = targets.try_recv() {
            target = new;
        }
        place += (target - place) * 0.1;
    }
    Ok(place)
}
// ANCHOR_END: loop

// ANCHOR: timeout
async fn next(input: &Receiver<u32>) -> Option<u32> {
    match input.recv_timeout(Duration::from_millis(5)).await {
        Ok(value) => Some(value),
        Err(luna::RecvTimeoutError::Timeout) => Some(0), // nothing came in time
        Err(_) => None,
    }
}
// ANCHOR_END: timeout

// ANCHOR: main
fn main() -> luna::Result<()> {
    let mut system = System::new("counted");
    let main = system.executor("main").build()?;
    let ((adds, added), (client, server)) = (luna::channel(), call_channel());
    main.process("counter").spawn(counter(added, server))?;
    main.process("user").spawn(async move {
        println!("total {:?}", user(adds, client).await.ok());
        Ok(())
    })?;
    // ANCHOR_END: main
    let fifo = || luna::buffered(Buffer::fifo(8));
    let ((a, left), (b, right), (sender, input)) = (fifo(), fifo(), fifo());
    let (target, targets) = luna::buffered(Buffer::overwrite_oldest(1));
    main.process("others").priority(1).spawn(async move {
        for n in 1..=3 {
            a.send(n).await?;
            b.send(10 * n).await?;
        }
        drop((a, b));
        println!("sum {}", merge(left, right).await);

        target.send(1.0).await?;
        println!("place {:.2}", control(targets).await?);

        let first = next(&input).await;
        drop(sender);
        println!("{first:?} {:?}", next(&input).await);
        Ok(())
    })?;
    system.run()?;
    Ok(())
}
