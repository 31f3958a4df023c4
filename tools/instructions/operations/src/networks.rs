//! Whole networks: what a user's program does all the time.

use crate::deadlines::{Beside, on_one_executor_beside};
use crate::laps::laps;
use crate::on_one_executor;
use luna::prelude::*;

/// Sends what it receives to the consumer, then to the successor.
async fn sequential_delta(
    input: Receiver<u64>,
    consumer: Sender<u64>,
    successor: Sender<u64>,
) -> luna::Result<()> {
    while let Ok(number) = input.recv().await {
        if consumer.send(number).await.is_err() || successor.send(number).await.is_err() {
            break;
        }
    }
    Ok(())
}

/// Sends what it receives to both at once.
async fn parallel_delta(
    input: Receiver<u64>,
    consumer: Sender<u64>,
    successor: Sender<u64>,
) -> luna::Result<()> {
    while let Ok(number) = input.recv().await {
        if par!(consumer.send(number), successor.send(number))
            .await
            .is_err()
        {
            break;
        }
    }
    Ok(())
}

/// Four processes pass a number round, and one of them sees each round.
fn commstime<D>(
    steps: u64,
    beside: Beside,
    delta: impl FnOnce(Receiver<u64>, Sender<u64>, Sender<u64>) -> D,
) -> luna::Result<()>
where
    D: Future<Output = luna::Result<()>> + Send + 'static,
{
    on_one_executor_beside("commstime", beside, |executor, end| {
        let (a, from_prefix) = luna::channel();
        let (b, to_successor) = luna::channel();
        let (c, from_successor) = luna::channel();
        let (d, to_consumer) = luna::channel();
        executor.process("prefix").spawn(async move {
            let mut next = 0;
            while a.send(next).await.is_ok() {
                let Ok(number) = from_successor.recv().await else {
                    break;
                };
                next = number;
            }
            Ok(())
        })?;
        executor.process("delta").spawn(delta(from_prefix, d, b))?;
        executor.process("successor").spawn(async move {
            while let Ok(number) = to_successor.recv().await {
                if c.send(number + 1).await.is_err() {
                    break;
                }
            }
            Ok(())
        })?;
        executor.process("consumer").spawn(move || async move {
            consumer(steps, to_consumer).await?;
            drop(end);
            Ok(())
        })
    })
}

async fn consumer(steps: u64, input: Receiver<u64>) -> luna::Result<()> {
    laps(steps, async |expected| {
        assert_eq!(input.recv().await, Ok(expected));
    })
    .await
}

pub(crate) fn commstime_sequential(steps: u64) -> luna::Result<()> {
    commstime(steps, Beside::Nothing, sequential_delta)
}

pub(crate) fn commstime_with_deadlines(steps: u64) -> luna::Result<()> {
    commstime(steps, Beside::Deadlines, sequential_delta)
}

pub(crate) fn commstime_parallel(steps: u64) -> luna::Result<()> {
    commstime(steps, Beside::Nothing, parallel_delta)
}

/// The number of processes in the ring, and so of hops in a lap of the token.
pub(crate) const RING: u64 = 1000;

pub(crate) fn ring(steps: u64) -> luna::Result<()> {
    on_one_executor("ring", |executor| {
        let (first, mut pipe) = luna::channel::<u64>();
        for number in 1..RING {
            let (output, next) = luna::channel();
            executor
                .process(format!("node {number}"))
                .spawn(async move {
                    while let Ok(hops) = pipe.recv().await {
                        if output.send(hops + 1).await.is_err() {
                            break;
                        }
                    }
                    Ok(())
                })?;
            pipe = next;
        }
        executor.process("head").spawn(move || async move {
            laps(steps, async |_| {
                assert_eq!(first.send(1).await, Ok(()));
                assert_eq!(pipe.recv().await, Ok(RING));
            })
            .await
        })
    })
}
