//! tokio's side of the page for readers with tokio.
use std::time::Duration;
use tokio::sync::{mpsc, oneshot, watch};
use tokio::time::{MissedTickBehavior, interval, timeout};

// ANCHOR: actor
enum Request {
    Add(u32),
    Total(oneshot::Sender<u32>),
}

async fn counter(mut requests: mpsc::Receiver<Request>) {
    let mut total = 0;
    while let Some(request) = requests.recv().await {
        match request {
            Request::Add(n) => total += n,
            Request::Total(answer) => drop(answer.send(total)),
        }
    }
}

async fn user(requests: mpsc::Sender<Request>) -> Option<u32> {
    requests.send(Request::Add(2)).await.ok()?;
    requests.send(Request::Add(3)).await.ok()?;
    let (answer, total) = oneshot::channel();
    requests.send(Request::Total(answer)).await.ok()?;
    total.await.ok()
}
// ANCHOR_END: actor

// ANCHOR: select
async fn merge(mut left: mpsc::Receiver<u32>, mut right: mpsc::Receiver<u32>) -> u32 {
    let mut sum = 0;
    loop {
        tokio::select! {
            Some(n) = left.recv() => sum += n,
            Some(n) = right.recv() => sum += n,
            else => return sum, // both are closed
        }
    }
}
// ANCHOR_END: select

// ANCHOR: loop
async fn control(targets: watch::Receiver<f64>) -> f64 {
    let mut tick = interval(Duration::from_millis(1));
    tick.set_missed_tick_behavior(MissedTickBehavior::Skip);
    let mut place = 0.0;
    for _ in 0..100 {
        tick.tick().await;
        place += (*targets.borrow() - place) * 0.1;
    }
    place
}
// ANCHOR_END: loop

// ANCHOR: timeout
async fn next(input: &mut mpsc::Receiver<u32>) -> Option<u32> {
    match timeout(Duration::from_millis(5), input.recv()).await {
        Ok(value) => value,
        Err(_) => Some(0), // nothing came in time
    }
}
// ANCHOR_END: timeout

// ANCHOR: main
#[tokio::main(flavor = "current_thread")]
async fn main() {
    let (requests, input) = mpsc::channel(8);
    let (_, total) = tokio::join!(counter(input), user(requests));
    println!("total {total:?}");
    // ANCHOR_END: main

    let ((a, left), (b, right)) = (mpsc::channel(8), mpsc::channel(8));
    for n in 1..=3 {
        let _ = (a.send(n).await, b.send(10 * n).await);
    }
    drop((a, b));
    println!("sum {}", merge(left, right).await);

    let (target, targets) = watch::channel(0.0);
    let _ = target.send(1.0);
    println!("place {:.2}", control(targets).await);

    let (sender, mut input) = mpsc::channel(8);
    let first = next(&mut input).await;
    drop(sender);
    println!("{first:?} {:?}", next(&mut input).await);
}
