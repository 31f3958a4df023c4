//! A server that waits for one of many: a producer sends to it over all channels in turn.

use crate::laps::laps;
use crate::on_one_executor;
use luna::prelude::*;

/// Sends a number to each in turn, until the receivers are gone.
async fn producer(outputs: Vec<Sender<u64>>) -> luna::Result<()> {
    for number in 0.. {
        let output = &outputs[number as usize % outputs.len()];
        if output.send(number).await.is_err() {
            break;
        }
    }
    Ok(())
}

fn channels<const N: usize>() -> (Vec<Sender<u64>>, Vec<Receiver<u64>>) {
    (0..N).map(|_| luna::channel()).unzip()
}

pub(crate) fn alt_2(steps: u64) -> luna::Result<()> {
    on_one_executor("alt of 2", |executor| {
        let (outputs, inputs) = channels::<2>();
        executor.process("producer").spawn(producer(outputs))?;
        executor.process("server").spawn(move || async move {
            let [a, b] = &inputs[..] else { unreachable!() };
            laps(steps, async |expected| {
                let got = alt! {
                    x = a.recv() => x,
                    x = b.recv() => x,
                };
                assert_eq!(got, Ok(expected));
            })
            .await
        })
    })
}

pub(crate) fn alt_8(steps: u64) -> luna::Result<()> {
    on_one_executor("alt of 8", |executor| {
        let (outputs, inputs) = channels::<8>();
        executor.process("producer").spawn(producer(outputs))?;
        executor.process("server").spawn(move || async move {
            let [a, b, c, d, e, f, g, h] = &inputs[..] else {
                unreachable!()
            };
            laps(steps, async |expected| {
                let got = alt! {
                    x = a.recv() => x,
                    x = b.recv() => x,
                    x = c.recv() => x,
                    x = d.recv() => x,
                    x = e.recv() => x,
                    x = f.recv() => x,
                    x = g.recv() => x,
                    x = h.recv() => x,
                };
                assert_eq!(got, Ok(expected));
            })
            .await
        })
    })
}

pub(crate) fn registered<const N: usize>(steps: u64) -> luna::Result<()> {
    on_one_executor("registered", |executor| {
        let (outputs, inputs) = channels::<N>();
        executor.process("producer").spawn(producer(outputs))?;
        executor.process("server").spawn(move || async move {
            let mut alternative = Alternative::fair(&inputs);
            laps(steps, async |expected| {
                let (index, got) = alternative.recv().await;
                assert_eq!((index as u64, got), (expected % N as u64, Ok(expected)));
            })
            .await
        })
    })
}
