//! LUNA's alternatives.

use std::{future::Future, pin::Pin, time::Duration};

use luna::{Alternative, Receiver, Sender};

use crate::Record;

/// A server that writes, of whichever size.
pub(crate) type Writing = fn(Vec<Sender<u64>>, Record) -> Served;

/// What a server that writes ends with. The allocation is one a block.
pub(crate) type Served = Pin<Box<dyn Future<Output = Duration> + Send>>;

/// The alternative that stays registered.
pub(crate) async fn registered(inputs: Vec<Receiver<u64>>, mut record: Record) -> Duration {
    let mut alternative = Alternative::fair(&inputs);
    loop {
        let (channel, number) = alternative.recv().await;
        if !record.note(channel, number.expect("the writer is there")) {
            break;
        }
    }
    let elapsed = record.elapsed();
    record.assert_fair();
    elapsed
}

macro_rules! alt_of {
    ($name:ident: $($channel:literal)+) => {
        /// An `alt!` with that many guards, written out.
        pub(crate) async fn $name(inputs: Vec<Receiver<u64>>, mut record: Record) -> Duration {
            loop {
                let (channel, number) = luna::alt! {
                    $(number = inputs[$channel].recv() => ($channel, number),)+
                };
                if !record.note(channel, number.expect("the writer is there")) {
                    break;
                }
            }
            let elapsed = record.elapsed();
            record.assert_fair();
            elapsed
        }
    };
}

macro_rules! offer_of {
    ($name:ident: $($channel:literal)+) => {
        /// An `alt!` with that many output guards, written out.
        pub(crate) fn $name(outputs: Vec<Sender<u64>>, mut record: Record) -> Served {
            Box::pin(async move {
                loop {
                    let (channel, sent) = luna::alt! {
                        $(sent = outputs[$channel].send(record.next($channel)) => ($channel, sent),)+
                    };
                    sent.expect("the reader is there");
                    let number = record.next(channel);
                    if !record.note(channel, number) {
                        break;
                    }
                }
                let elapsed = record.elapsed();
                record.assert_fair();
                elapsed
            })
        }
    };
}

alt_of!(alt_of_1: 0);
alt_of!(alt_of_8: 0 1 2 3 4 5 6 7);
alt_of!(alt_of_32: 0 1 2 3 4 5 6 7 8 9 10 11 12 13 14 15 16 17 18 19 20 21 22 23 24 25 26 27 28 29 30 31);

offer_of!(offer_of_1: 0);
offer_of!(offer_of_8: 0 1 2 3 4 5 6 7);
offer_of!(offer_of_32: 0 1 2 3 4 5 6 7 8 9 10 11 12 13 14 15 16 17 18 19 20 21 22 23 24 25 26 27 28 29 30 31);
