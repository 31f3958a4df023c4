//! `alternative`: a server communicates over any one of n channels at a time; all on one core.
//!
//! *Input*: one writer writes to the channels in turn, so that the server finds at most one ready.
//! *Stressed*: a writer for each channel, so that nearly all are always ready (N. C. Brown, P. H.
//! Welch, "An introduction to the Kent C++CSP library", 2003). *Output* is the same with a server
//! that writes and a reader, or readers.
//!
//! The server checks that the numbers of each channel come in sequence; LUNA's also that the choice
//! was fair.

#[path = "alternative/ours.rs"]
mod ours;
#[path = "alternative/peers.rs"]
mod peers;

use std::{
    future::Future,
    time::{Duration, Instant},
};

use luna_benches::{
    channels::{AsyncChannel, Channel, Crossbeam, Flume, Kanal, Receiving, Sending, TokioMpsc},
    executors::{Executor, Smol, Threads, Tokio, TokioLocal, on_one_core},
    external,
    harness::{Case, Goal, is_quick, run},
    ours::{Luna, LunaChannel},
    primitives,
    processes::{producer, sink, warm_up},
};

const INPUT: &str = "alternative, input";
const STRESSED: &str = "alternative, input, stressed";
const OUTPUT: &str = "alternative, output";
const STRESSED_OUTPUT: &str = "alternative, output, stressed";
const UNIT: &str = "ns/message";

/// The limit of threads.
const MAX_THREADS: usize = 64;

/// How many channels an alternative is over.
fn sizes() -> &'static [usize] {
    if is_quick() {
        &[1, 8, 32]
    } else {
        &[1, 8, 32, 64, 256, 1_024]
    }
}

/// The state of a server: the next number of each channel, and when the clock started.
#[derive(Debug)]
struct Record {
    counts: Vec<u64>,
    left: u64,
    timed: u64,
    start: Instant,
}

impl Record {
    /// For a number of messages after a warm-up, over a number of channels.
    fn new(channels: usize, messages: u64) -> Self {
        Record {
            counts: vec![0; channels],
            left: warm_up(messages) + messages,
            timed: messages,
            start: Instant::now(),
        }
    }

    /// The number that is the next of this channel.
    fn next(&self, channel: usize) -> u64 {
        self.counts[channel]
    }

    /// Notes a message, with its number. Returns whether more are expected.
    ///
    /// # Panics
    ///
    /// The number is not the channel's next.
    fn note(&mut self, channel: usize, number: u64) -> bool {
        assert_eq!(number, self.counts[channel], "out of sequence");
        self.counts[channel] += 1;
        self.left -= 1;
        if self.left == self.timed {
            self.start = Instant::now();
        }
        self.left > 0
    }

    fn elapsed(&self) -> Duration {
        self.start.elapsed()
    }

    /// # Panics
    ///
    /// When a channel was chosen twice as often as another one.
    fn assert_fair(&self) {
        let least = self.counts.iter().min().expect("there are channels");
        let most = self.counts.iter().max().expect("there are channels");
        assert!(*most <= 2 * least + 2, "unfair: {least} to {most}");
    }
}

/// Writes to the outputs in turn until the readers are gone.
async fn in_turn(mut outputs: Vec<impl Sending>) {
    for number in 0.. {
        for output in &mut outputs {
            if output.send(number).await.is_err() {
                return;
            }
        }
    }
}

/// Reads from the inputs in turn until the writers are gone.
async fn out_of_turn(mut inputs: Vec<impl Receiving>) {
    use luna_benches::channels::Received;
    loop {
        for input in &mut inputs {
            if input.recv().await.value().is_none() {
                return;
            }
        }
    }
}

fn channels<C: Channel>(size: usize) -> (Vec<C::Sender>, Vec<C::Receiver>) {
    (0..size).map(|_| C::new_pair()).unzip()
}

/// A server that reads.
fn reading<E: Executor, C: Channel, F: Future<Output = Duration> + Send + 'static>(
    server: impl Fn(Vec<C::Receiver>, Record) -> F + Send + Sync,
    size: usize,
    stressed: bool,
    messages: u64,
) -> Duration {
    on_one_core(|executor: &E| {
        let (outputs, inputs) = channels::<C>(size);
        if stressed {
            for output in outputs {
                executor.start(producer(output));
            }
        } else {
            executor.start(in_turn(outputs));
        }
        let server = executor.spawn(server(inputs, Record::new(size, messages)));
        executor.block_on(server)
    })
}

/// A server that writes.
fn writing<E: Executor, C: Channel, F: Future<Output = Duration> + Send + 'static>(
    server: impl Fn(Vec<C::Sender>, Record) -> F + Send + Sync,
    size: usize,
    stressed: bool,
    messages: u64,
) -> Duration {
    on_one_core(|executor: &E| {
        let (outputs, inputs) = channels::<C>(size);
        if stressed {
            for input in inputs {
                executor.start(sink(input));
            }
        } else {
            executor.start(out_of_turn(inputs));
        }
        let server = executor.spawn(server(outputs, Record::new(size, messages)));
        executor.block_on(server)
    })
}

fn input<E: Executor, C: Channel, F: Future<Output = Duration> + Send + 'static>(
    stressed: bool,
    peer: &'static str,
    size: usize,
    server: impl Fn(Vec<C::Receiver>, Record) -> F + Send + Sync + 'static,
) -> Case {
    let name = if stressed { STRESSED } else { INPUT };
    let block = move |messages| reading::<E, C, F>(&server, size, stressed, messages);
    Case::new(name, peer, UNIT, block).size(size as u64)
}

fn output<E: Executor, C: Channel, F: Future<Output = Duration> + Send + 'static>(
    stressed: bool,
    peer: &'static str,
    size: usize,
    server: impl Fn(Vec<C::Sender>, Record) -> F + Send + Sync + 'static,
) -> Case {
    let name = if stressed { STRESSED_OUTPUT } else { OUTPUT };
    let block = move |messages| writing::<E, C, F>(&server, size, stressed, messages);
    Case::new(name, peer, UNIT, block).size(size as u64)
}

const REGISTERED: &str = "LUNA, Alternative";
const WRITTEN_OUT: &str = "LUNA, alt!";
const TOKIO: &str = "tokio mpsc(1), FuturesUnordered, spawn";
const TOKIO_SELECT: &str = "tokio mpsc(1), select!, spawn";
const FLUME: &str = "flume bounded(0), FuturesUnordered, tokio LocalSet";
const KANAL: &str = "kanal bounded_async(0), FuturesUnordered, tokio LocalSet";
const ASYNC_CHANNEL: &str = "async-channel bounded(1), FuturesUnordered, smol";
const CROSSBEAM: &str = "crossbeam bounded(0), Select, threads";

fn inputs(stressed: bool) -> Vec<Case> {
    let mut cases = Vec::new();
    for &size in sizes() {
        let registered =
            input::<Luna, LunaChannel, _>(stressed, REGISTERED, size, ours::registered);
        cases.push(match size {
            8 | 64 | 1_024 if stressed => registered.goal(Goal::AtMost(19.0)),
            _ => registered,
        });
        match size {
            1 => cases.push(input::<Luna, LunaChannel, _>(
                stressed,
                WRITTEN_OUT,
                size,
                ours::alt_of_1,
            )),
            8 => {
                let written_out =
                    input::<Luna, LunaChannel, _>(stressed, WRITTEN_OUT, size, ours::alt_of_8);
                cases.push(if stressed {
                    written_out.goal(Goal::AtMost(38.0))
                } else {
                    written_out
                });
                cases.push(input::<Tokio, TokioMpsc, _>(
                    stressed,
                    TOKIO_SELECT,
                    size,
                    peers::tokio_select_of_8,
                ));
            }
            // Its largest.
            32 => cases.push(input::<Luna, LunaChannel, _>(
                stressed,
                WRITTEN_OUT,
                size,
                ours::alt_of_32,
            )),
            _ => {}
        }
        cases.extend([
            input::<Tokio, TokioMpsc, _>(stressed, TOKIO, size, peers::unordered),
            input::<TokioLocal, Flume, _>(stressed, FLUME, size, peers::unordered),
            input::<TokioLocal, Kanal, _>(stressed, KANAL, size, peers::unordered),
            input::<Smol, AsyncChannel, _>(stressed, ASYNC_CHANNEL, size, peers::unordered),
        ]);
        if size <= MAX_THREADS {
            cases.push(input::<Threads, Crossbeam, _>(
                stressed,
                CROSSBEAM,
                size,
                peers::crossbeam_reading,
            ));
        }
        if stressed {
            let size = size as u64;
            cases.extend(external::cases(STRESSED, UNIT, "alternative", Some(size)));
        }
    }
    cases
}

fn outputs(stressed: bool) -> Vec<Case> {
    let ours = |size, server| output::<Luna, LunaChannel, _>(stressed, WRITTEN_OUT, size, server);
    let mut cases = vec![
        ours(1, ours::offer_of_1 as ours::Writing),
        ours(8, ours::offer_of_8),
        ours(32, ours::offer_of_32),
    ];
    for size in [1, 8, 32] {
        cases.push(output::<Threads, Crossbeam, _>(
            stressed,
            CROSSBEAM,
            size,
            peers::crossbeam_writing,
        ));
    }
    cases
}

fn main() {
    let mut cases = inputs(false);
    cases.extend(inputs(true));
    cases.extend(outputs(false));
    cases.extend(outputs(true));
    cases.extend(primitives::one_core_cases());
    run("alternative", cases);
}
