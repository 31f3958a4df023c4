//! A simulated machine in real time, and a recorder that passes its blocks to a scope.

use super::machine::Machine;
use luna_logger::Sink;
use luna_logger::format::Encoder;
use luna_scope::Scope;
use std::sync::mpsc::{RecvTimeoutError, Sender, channel};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

pub struct Feeder {
    end: Option<Sender<()>>,
    thread: Option<JoinHandle<u64>>,
}

impl Feeder {
    /// Feeds until it is dropped.
    pub fn start(scope: &Scope, machine: Machine) -> Feeder {
        Feeder::start_at(scope, machine, Duration::ZERO)
    }

    /// Gives so much of the recording at once, and goes on from there.
    pub fn start_at(scope: &Scope, mut machine: Machine, at: Duration) -> Feeder {
        let mut sink = scope.sink().unwrap();
        let (end, ended) = channel();
        let thread = std::thread::spawn(move || {
            let begun = Instant::now();
            let mut encoder = Encoder::new();
            let mut refused = 0;
            sink.begin(&Encoder::head()).unwrap();
            while ended.recv_timeout(Duration::from_millis(10)) == Err(RecvTimeoutError::Timeout) {
                let now = (at + begun.elapsed()).as_nanos() as u64;
                machine.until(now, &mut |record| {
                    encoder.put(record);
                    if encoder.is_full() {
                        give(&mut sink, &mut encoder, &mut refused);
                    }
                });
                give(&mut sink, &mut encoder, &mut refused);
            }
            refused
        });
        Feeder {
            end: Some(end),
            thread: Some(thread),
        }
    }

    /// Ends it. Returns how many blocks were refused.
    pub fn end(mut self) -> u64 {
        self.end = None;
        self.thread.take().unwrap().join().unwrap()
    }
}

fn give(sink: &mut impl Sink, encoder: &mut Encoder, refused: &mut u64) {
    if encoder.is_empty() {
        return;
    }
    match sink.block(encoder.block()) {
        Ok(()) => encoder.next(),
        Err(_) => {
            *refused += 1;
            encoder.discard();
        }
    }
}

impl Drop for Feeder {
    fn drop(&mut self) {
        self.end = None;
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}
