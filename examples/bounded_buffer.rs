//! A bounded buffer as a process: one alternative with a guard on either side.
//!
//! The buffer offers to receive while it has room and, at the same time, to send while it is not
//! empty. A guard with a false precondition is not offered. The portion on offer stays in its slot
//! until the consumer takes it (`send_from`).
//!
//! From C. A. R. Hoare, Communicating Sequential Processes (1978), 5.1, for ten portions. There,
//! and in occam, output cannot be a guard: the consumer first has to request each portion. With
//! guards on both sides the processes around the buffer need not know about it.

use luna::prelude::*;
use std::collections::VecDeque;
use std::time::Duration;

const CAPACITY: usize = 10;
const PORTIONS: u32 = 1000;

/// Neither `Copy` nor `Clone`: there is one of each.
#[derive(Debug, PartialEq)]
struct Portion(u32);

async fn buffer<T: Send>(input: Receiver<T>, output: Sender<T>) -> luna::Result<()> {
    let mut next = None; // on offer
    let mut behind = VecDeque::with_capacity(CAPACITY - 1);
    let mut open = true;
    while open || next.is_some() {
        alt! {
            portion = input.recv(), if open && behind.len() < CAPACITY - 1 => match portion {
                Ok(portion) => behind.push_back(portion),
                Err(_) => open = false, // the producer has ended: send the rest
            },
            sent = output.send_from(&mut next), if next.is_some() => sent?,
        }
        next = next.or_else(|| behind.pop_front());
    }
    Ok(())
}

async fn producer(output: Sender<Portion>, filled: Sender<()>) -> luna::Result<()> {
    let capacity = CAPACITY as u32;
    for n in 0..capacity {
        output.send(Portion(n)).await?; // the consumer does not run yet
    }
    let one_more = output.send_timeout(Portion(capacity), Duration::from_millis(5));
    let refused = one_more.await.expect_err("the buffer is full");
    assert_eq!(refused.into_inner(), Portion(capacity));
    filled.send(()).await?;
    for n in capacity..PORTIONS {
        output.send(Portion(n)).await?;
    }
    Ok(())
}

async fn consumer(input: Receiver<Portion>, filled: Receiver<()>) -> luna::Result<()> {
    filled.recv().await?;
    for n in 0..PORTIONS {
        assert_eq!(input.recv().await?, Portion(n));
    }
    assert!(input.recv().await.unwrap_err().is_closed());
    println!("{PORTIONS} portions in order; {CAPACITY} of them fit, and not one more");
    Ok(())
}

fn main() -> luna::Result<()> {
    let (put, put_in) = luna::channel();
    let (get, get_in) = luna::channel();
    let (filled, filled_in) = luna::channel();
    luna::run(async {
        par!(
            producer(put, filled),
            buffer(put_in, get),
            consumer(get_in, filled_in)
        )
        .await
    })?;
    Ok(())
}
