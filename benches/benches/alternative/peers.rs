//! The peers' alternatives.

use std::time::Duration;

use futures_util::stream::{FuturesUnordered, StreamExt};
use luna_benches::channels::{Received, Receiving};

use crate::Record;

/// Any number of asynchronous receivers, by the usual means: a set of futures, in which each
/// completed future is replaced.
pub(crate) async fn unordered<R: Receiving>(inputs: Vec<R>, mut record: Record) -> Duration {
    async fn next<R: Receiving>(channel: usize, mut input: R) -> (usize, R, Option<u64>) {
        let number = input.recv().await.value();
        (channel, input, number)
    }

    let inputs = inputs.into_iter().enumerate();
    let mut offers: FuturesUnordered<_> = inputs
        .map(|(channel, input)| next(channel, input))
        .collect();
    while let Some((channel, input, number)) = offers.next().await {
        offers.push(next(channel, input));
        if !record.note(channel, number.expect("the writer is there")) {
            break;
        }
    }
    record.elapsed()
}

/// tokio's `select!`, which chooses at random.
pub(crate) async fn tokio_select_of_8(
    inputs: Vec<tokio::sync::mpsc::Receiver<u64>>,
    mut record: Record,
) -> Duration {
    let inputs: Result<[_; 8], _> = inputs.try_into();
    let [mut a, mut b, mut c, mut d, mut e, mut f, mut g, mut h] = inputs.expect("there are 8");
    loop {
        let (channel, number) = tokio::select! {
            number = a.recv() => (0, number),
            number = b.recv() => (1, number),
            number = c.recv() => (2, number),
            number = d.recv() => (3, number),
            number = e.recv() => (4, number),
            number = f.recv() => (5, number),
            number = g.recv() => (6, number),
            number = h.recv() => (7, number),
        };
        if !record.note(channel, number.expect("the writer is there")) {
            return record.elapsed();
        }
    }
}

/// crossbeam's `Select`, which blocks the server's thread.
pub(crate) async fn crossbeam_reading(
    inputs: Vec<crossbeam_channel::Receiver<u64>>,
    mut record: Record,
) -> Duration {
    let mut select = crossbeam_channel::Select::new();
    for input in &inputs {
        select.recv(input);
    }
    loop {
        let chosen = select.select();
        let channel = chosen.index();
        let number = chosen.recv(&inputs[channel]);
        if !record.note(channel, number.expect("the writer is there")) {
            return record.elapsed();
        }
    }
}

/// As [`crossbeam_reading`], with a server that writes.
pub(crate) async fn crossbeam_writing(
    outputs: Vec<crossbeam_channel::Sender<u64>>,
    mut record: Record,
) -> Duration {
    let mut select = crossbeam_channel::Select::new();
    for output in &outputs {
        select.send(output);
    }
    loop {
        let chosen = select.select();
        let channel = chosen.index();
        let number = record.next(channel);
        let sent = chosen.send(&outputs[channel], number);
        sent.expect("the reader is there");
        if !record.note(channel, number) {
            return record.elapsed();
        }
    }
}
