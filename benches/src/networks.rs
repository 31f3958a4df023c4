//! Networks of the measured [processes](crate::processes) that several benches run.

use std::{future::Future, time::Duration};

use core_affinity::CoreId;

use crate::{
    channels::Channel,
    cores::on_cores,
    executors::{Executor, on_one_core},
    processes::{consumer, prefix, producer, successor},
};

/// A producer and a consumer at the two ends of a channel, on one core.
pub fn one_core_stream<E: Executor, C: Channel>(
    channel: fn() -> (C::Sender, C::Receiver),
    messages: u64,
) -> Duration {
    on_one_core(|executor: &E| {
        let (output, input) = channel();
        let producer = executor.spawn(producer(output));
        let consumer = executor.spawn(consumer(input, messages));
        executor.block_on(async {
            let elapsed = consumer.await;
            producer.await;
            elapsed
        })
    })
}

/// The same on two cores, which may be one. The producer's side and the consumer's may be of
/// different kinds.
pub fn two_core_stream<P: Executor, E: Executor, C: Channel>(
    cores: [CoreId; 2],
    channel: (C::Sender, C::Receiver),
    messages: u64,
) -> Duration {
    let (output, input) = C::between_executors(channel);
    on_cores(
        cores,
        || alone::<P, _>(cores[0], producer(output)),
        || alone::<E, _>(cores[1], consumer(input, messages)),
    )
}

/// Runs one process on an executor of its own.
pub fn alone<E: Executor, T: Send + 'static>(
    core: CoreId,
    process: impl Future<Output = T> + Send + 'static,
) -> T {
    let executor = E::new(core);
    let process = executor.spawn(process);
    executor.block_on(process)
}

/// Commstime with a delta of whatever kind.
pub fn commstime<E: Executor, C: Channel, D>(
    executor: &E,
    delta: impl FnOnce(C::Receiver, C::Sender, C::Sender) -> D,
    cycles: u64,
) -> Duration
where
    D: Future<Output = ()> + Send + 'static,
{
    let (a, from_prefix) = C::new_pair();
    let (b, to_successor) = C::new_pair();
    let (c, from_successor) = C::new_pair();
    let (d, to_consumer) = C::new_pair();
    let prefix = executor.spawn(prefix(from_successor, a));
    let delta = executor.spawn(delta(from_prefix, d, b));
    let successor = executor.spawn(successor(to_successor, c));
    let consumer = executor.spawn(consumer(to_consumer, cycles));
    executor.block_on(async {
        let elapsed = consumer.await;
        prefix.await;
        delta.await;
        successor.await;
        elapsed
    })
}
