//! Commstime: four processes in a loop make the natural numbers. The first network of many a CSP
//! course.
//!
//! ```text
//!            +--------+  a   +-------+  d
//!     +----->| prefix |----->| delta |-----> consume
//!     |      +--------+      +-------+
//!   c |      +--------+          |
//!     +------|  succ  |<---------+ b
//!            +--------+
//! ```
//!
//! `prefix` sends a 0 and then passes on what it receives; `delta` sends each number to both its
//! outputs, in parallel; `succ` adds one. A cycle is four rendezvous, and its time has been the
//! measure of CSP systems for decades. The processes in the loop run without an end condition:
//! `consume` poisons its channel when it has received enough, and that ends all four.
//!
//! From the occam courses of P. H. Welch, University of Kent.

use luna::prelude::*;
use std::time::Instant;

const CYCLES: u32 = 100_000;

// ANCHOR: processes
async fn prefix(first: u32, input: Receiver<u32>, output: Sender<u32>) -> luna::Result<()> {
    output.send(first).await?;
    loop {
        output.send(input.recv().await?).await?;
    }
}

async fn delta(input: Receiver<u32>, left: Sender<u32>, right: Sender<u32>) -> luna::Result<()> {
    loop {
        let n = input.recv().await?;
        par!(left.send(n), right.send(n)).await?;
    }
}

async fn succ(input: Receiver<u32>, output: Sender<u32>) -> luna::Result<()> {
    loop {
        output.send(input.recv().await? + 1).await?;
    }
}
// ANCHOR_END: processes

async fn consume(input: Receiver<u32>) -> luna::Result<()> {
    let begin = Instant::now();
    for expected in 0..CYCLES {
        assert_eq!(input.recv().await?, expected);
    }
    println!("{} ns a cycle", (begin.elapsed() / CYCLES).as_nanos());
    input.poison();
    Ok(())
}

// ANCHOR: network
fn main() -> luna::Result<()> {
    let (a, a_in) = luna::channel();
    let (b, b_in) = luna::channel();
    let (c, c_in) = luna::channel();
    let (d, d_in) = luna::channel();
    let end = luna::run(async {
        par!(
            prefix(0, c_in, a),
            delta(a_in, b, d),
            succ(b_in, c),
            consume(d_in)
        )
        .await
    });
    assert!(end.is_err_and(|error| error.is_poisoned()));
    Ok(())
}
// ANCHOR_END: network
