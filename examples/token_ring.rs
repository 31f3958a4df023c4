//! Ten thousand processes in a ring pass a token round, first on one executor, then on two.
//!
//! The time of a hop is that of a rendezvous and of the switch to the next process, with the memory
//! of ten thousand processes going through the caches. On two executors each runs one half of the
//! ring: all but two hops of a lap stay within their executor, and the processes' code is the same.
//!
//! A classic of languages with cheap processes: occam, Erlang, Go. The thesis behind LUNA went to
//! 10 000 processes, too.

use luna::prelude::*;
use std::time::Instant;

const PROCESSES: u32 = 10_000;
const LAPS: u32 = 50;

/// Passes the token on, and counts the hop.
async fn node(input: Receiver<u32>, output: Sender<u32>) -> luna::Result<()> {
    while let Ok(hops) = input.recv().await {
        output.send(hops + 1).await?;
    }
    Ok(()) // the ring is open now: this closes the next channel
}

/// Sends the token round, then opens the ring.
async fn head(input: Receiver<u32>, output: Sender<u32>, executors: u32) -> luna::Result<()> {
    output.send(1).await?; // a first lap: afterwards every process waits for the token
    assert_eq!(input.recv().await?, PROCESSES);

    let begin = Instant::now();
    let mut hops = 0;
    for _ in 0..LAPS {
        output.send(hops + 1).await?;
        hops = input.recv().await?;
    }
    let time = begin.elapsed();
    assert_eq!(hops, PROCESSES * LAPS);
    let hop = (time / hops).as_nanos();
    println!("{PROCESSES} processes on {executors} executor(s): {hop} ns a hop");
    Ok(())
}

fn ring(executors: u32) -> luna::Result<()> {
    let mut system = System::new("ring");
    let places = (0..executors)
        .map(|n| system.executor(format!("executor {n}")).build())
        .collect::<luna::Result<Vec<_>>>()?;

    let (first, mut pipe) = luna::channel();
    for n in 1..PROCESSES {
        let (output, next) = luna::channel();
        places[(n * executors / PROCESSES) as usize]
            .process(format!("node {n}"))
            .spawn(node(pipe, output))?;
        pipe = next;
    }
    places[0]
        .process("head")
        .spawn(head(pipe, first, executors))?;
    system.run()?;
    Ok(())
}

fn main() -> luna::Result<()> {
    ring(1)?;
    ring(2)
}
