//! Loops over ended channels: they do not keep other processes of their executor from running, and
//! time goes on.

use crate::common;
use common::{SpawnOk, watchdog};
use luna::prelude::*;
use luna::{Error, SendError};
use std::cell::Cell;
use std::future::Future;
use std::time::Duration;

/// Far more errors than a process may have in one go.
const TOO_MANY: u32 = 10_000;

/// Merges its inputs until all have ended: with nothing but `recv`, and counting the ends.
async fn merge(is_fair: bool, inputs: Vec<Receiver<u32>>, output: Sender<u32>) -> luna::Result<()> {
    let (mut open, mut has_ended) = (inputs.len(), vec![false; inputs.len()]);
    let mut errors = 0;
    let mut alternative = match is_fair {
        true => Alternative::fair(&inputs),
        false => Alternative::prioritized(&inputs),
    };
    while open > 0 {
        match alternative.recv().await {
            (_, Ok(value)) => output.send(value).await?,
            (index, Err(_)) => {
                errors += 1;
                assert!(errors < TOO_MANY, "the others do not get on");
                open -= usize::from(!std::mem::replace(&mut has_ended[index], true));
            }
        }
    }
    Ok(())
}

async fn source(output: Sender<u32>, pause: Duration) -> luna::Result<()> {
    for n in 0..3 {
        luna::after(pause).await;
        output.send(n).await?;
    }
    Ok(())
}

async fn sum(input: Receiver<u32>) -> luna::Result<()> {
    let mut sum = 0;
    while let Ok(n) = input.recv().await {
        sum += n;
    }
    assert_eq!(sum, 6);
    Ok(())
}

/// The first input ends long before the second.
fn parts() -> [(Sender<u32>, Receiver<u32>, Duration); 2] {
    [1, 20].map(|millis| {
        let (sender, receiver) = luna::channel();
        (sender, receiver, Duration::from_millis(millis))
    })
}

#[test]
fn a_merge_ends_when_all_inputs_have() {
    let _watchdog = watchdog();
    for is_fair in [true, false] {
        for is_virtual in [true, false] {
            let mut system = System::new("merge");
            if is_virtual {
                system.virtual_clock();
            }
            let executor = system.executor("one").build().unwrap();
            let (output, sink) = luna::channel();
            let mut inputs = Vec::new();
            for (index, (sender, receiver, pause)) in parts().into_iter().enumerate() {
                inputs.push(receiver);
                let process = executor.process(format!("source {index}"));
                process.spawn_ok(source(sender, pause));
            }
            let process = executor.process("merge");
            process.spawn_ok(merge(is_fair, inputs, output));
            executor.process("sink").spawn_ok(sum(sink));
            system.run().unwrap();
        }
        let [(a, from_a, short), (b, from_b, long)] = parts();
        let (output, sink) = luna::channel();
        luna::run(async {
            par!(
                source(a, short),
                source(b, long),
                merge(is_fair, vec![from_a, from_b], output),
                sum(sink),
            )
            .await?;
            Ok(())
        })
        .unwrap();
    }
}

/// A branch that ignores errors once its sibling has failed goes on beside a third branch, which
/// ends it.
fn stubborn(fails: impl AsyncFn()) {
    let _watchdog = watchdog();
    let is_over = Cell::new(false);
    let outcome = luna::run(async {
        par!(
            async { Err::<(), _>(Error::Timeout) },
            async {
                let mut errors = 0;
                while !is_over.get() {
                    fails().await;
                    errors += 1;
                    assert!(errors < TOO_MANY, "its sibling does not run");
                }
                Ok::<_, Error>(())
            },
            async {
                luna::yield_now().await;
                is_over.set(true);
                Ok::<_, Error>(())
            },
        )
        .await
    });
    let errors: Vec<_> = outcome.unwrap_err().errors().cloned().collect();
    assert_eq!(errors, [Error::Timeout]);
}

#[test]
fn in_a_failed_branch_errors_let_siblings_run() {
    let (sender, receiver) = luna::channel::<u8>();
    stubborn(async || assert!(receiver.recv().await.is_err()));
    stubborn(async || {
        let SendError { value, .. } = sender.send(1).await.unwrap_err();
        assert_eq!(value, 1);
    });
    stubborn(async || {
        alt! {
            received = receiver.recv() => assert!(received.is_err()),
            sent = sender.send(1) => assert!(sent.is_err()),
        }
    });
    let inputs = [receiver.clone()];
    stubborn(async || assert!(Alternative::fair(&inputs).recv().await.1.is_err()));
    let (client, server) = luna::channel::call_channel::<u8, u8>();
    stubborn(async || assert!(client.call(1).await.is_err()));
    stubborn(async || assert!(server.accept().await.is_err()));
    let mutex = luna::sync::Mutex::new(());
    stubborn(async || assert!(mutex.lock().await.is_err()));
    let semaphore = luna::sync::Semaphore::new(1);
    stubborn(async || assert!(semaphore.acquire().await.is_err()));
}

/// Runs `branch` beside one that fails later; gives the errors of both.
fn beside_a_failure(branch: impl Future<Output = luna::Result<()>>) -> Vec<Error> {
    let _watchdog = watchdog();
    let fails = async {
        luna::after(Duration::from_millis(2)).await;
        Err::<(), _>(Error::Timeout)
    };
    let outcome = luna::run(async { par!(branch, fails).await });
    outcome.unwrap_err().errors().cloned().collect()
}

#[test]
fn over_no_channels_the_branch_ends() {
    let none: [Receiver<u8>; 0] = [];
    let errors = beside_a_failure(async {
        Alternative::fair(&none).recv().await.1?;
        Ok(())
    });
    assert_eq!(errors, [Error::Poisoned, Error::Timeout]);
    // All channels of this alternative were removed.
    let (_sender, receiver) = luna::channel::<u8>();
    let errors = beside_a_failure(async {
        let mut inputs = Alternative::prioritized(std::slice::from_ref(&receiver));
        assert!(inputs.remove(0));
        inputs.recv().await.1?;
        Ok(())
    });
    assert_eq!(errors, [Error::Poisoned, Error::Timeout]);
}
