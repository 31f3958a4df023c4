//! LUNA's side of the page for readers with Go: the same as `theirs/go/main.go`.
use luna::prelude::*;
use std::time::Duration;

// ANCHOR: pipeline
async fn numbers(output: Sender<u32>) -> luna::Result<()> {
    for n in 1..=3 {
        output.send(n).await?;
    }
    Ok(()) // dropping the sender closes the channel
}

async fn squares(input: Receiver<u32>, output: Sender<u32>) -> luna::Result<()> {
    while let Ok(n) = input.recv().await {
        output.send(n * n).await?;
    }
    Ok(())
}
// ANCHOR_END: pipeline

// ANCHOR: select
async fn watch(input: Receiver<u32>, done: Receiver<()>) -> luna::Result<&'static str> {
    loop {
        alt! {
            n = input.recv() => println!("got {}", n?),
            _ = done.recv() => return Ok("done"),
            _ = luna::after(Duration::from_millis(20)) => return Ok("nothing came"),
        }
    }
}
// ANCHOR_END: select

// ANCHOR: workers
async fn work(jobs: Receiver<u32>) -> luna::Result<u32> {
    let mut sum = 0;
    while let Ok(n) = jobs.recv().await {
        sum += n;
    }
    Ok(sum)
}

async fn share() -> luna::Result<u32> {
    let (put, jobs) = luna::channel();
    let workers = (0..3).map(|_| jobs.clone()).collect::<Vec<_>>();
    drop(jobs);
    let (sums, ()) = par!(async { luna::par_for(workers, work).await }, async move {
        for n in 1..=10 {
            put.send(n).await?;
        }
        Ok::<(), luna::Error>(())
    },)
    .await?;
    Ok(sums.iter().sum())
}
// ANCHOR_END: workers

// ANCHOR: main
fn main() -> luna::Result<()> {
    luna::run(async {
        let ((a, b), (c, d)) = (luna::channel(), luna::channel());
        par!(numbers(a), squares(b, c), async move {
            while let Ok(n) = d.recv().await {
                println!("{n}");
            }
            Ok::<(), luna::Error>(())
        })
        .await?;
        // ANCHOR_END: main

        let ((_put, input), (done, stopped)) = (luna::channel(), luna::channel());
        println!("{}", watch(input, stopped).await?);
        drop(done);
        println!("the sum is {}", share().await?);
        Ok(())
    })
}
