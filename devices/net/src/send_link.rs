//! The link of the sending side.

use crate::NetError;
use crate::link::{First, Line, Link, Near, first};
use crate::side::{Packet, Stop};
use luna::channel::{ChannelEnd, Extended};
use luna::realtime::off_path;
use luna::{Instant, Receiver};
use serde::Serialize;
use std::pin::pin;

/// The link of the sending side, made by [`sender`](crate::Network::sender).
pub type SendLink<T> = Link<Outward<T>>;

/// A link that sends: the near side of it.
#[expect(missing_debug_implementations, reason = "only links hold it")]
pub struct Outward<T> {
    pub(crate) receiver: Receiver<T>,
    /// Buffers whose values were acknowledged.
    pub(crate) free: Receiver<Box<[u8]>>,
    pub(crate) buffers: usize,
    /// Whether a sender goes on before the other program has taken its value.
    pub(crate) is_buffered: bool,
}

/// Refuses a value that was not acknowledged, also if the link is dropped.
struct Offered<'a, T>(Option<Extended<'a, T>>);

impl<T> Offered<'_, T> {
    fn refuse(&mut self, end: ChannelEnd) {
        if let Some(taken) = self.0.take() {
            taken.refuse(end);
        }
    }
}

impl<T> Drop for Offered<'_, T> {
    fn drop(&mut self) {
        self.refuse(ChannelEnd::Closed);
    }
}

/// The next buffer, or why there is none.
enum Next {
    Buffer(Box<[u8]>),
    Stop(Stop),
}

impl<T: Serialize + Send> Near for Outward<T> {
    async fn carry(&self, line: &Line) -> Stop {
        if let Err(stop) = self.join(line).await {
            return stop;
        }
        let mut stopped = pin!(line.stopped());
        let mut poisoned = pin!(self.receiver.poisoned());
        let mut spare = None;
        loop {
            let mut buffer = match spare.take() {
                Some(buffer) => buffer,
                None => {
                    let freed = pin!(self.free.recv());
                    let freed = pin!(first(freed, poisoned.as_mut()));
                    match next(line, first(freed, stopped.as_mut()).await) {
                        Next::Buffer(buffer) => buffer,
                        Next::Stop(stop) => return stop,
                    }
                }
            };
            let value = pin!(self.receiver.recv_extended());
            let taken = match first(value, stopped.as_mut()).await {
                First::Own(Ok(taken)) => taken,
                First::Own(Err(error)) if error.is_closed() => break,
                First::Own(Err(_)) => return Stop::Ended(ChannelEnd::Poisoned),
                First::Other(stop) => return stop,
            };
            let sent = Instant::now_real().as_nanos();
            let used = postcard::to_slice(&*taken, &mut buffer).map(|used| used.len());
            let mut offered = Offered(Some(taken));
            let length = match used {
                Ok(length) => length,
                Err(error) => {
                    offered.refuse(ChannelEnd::Poisoned);
                    return off_path(|| {
                        Stop::Failed(NetError::Encode {
                            name: line.name.clone(),
                            capacity: buffer.len(),
                            why: error.to_string(),
                        })
                    });
                }
            };
            line.status.send();
            line.shared.send(Packet {
                buffer,
                length,
                sent,
            });
            if self.is_buffered {
                drop(offered.0.take());
                continue;
            }
            // It comes back when the value is acknowledged.
            let freed = pin!(self.free.recv());
            let freed = pin!(first(freed, poisoned.as_mut()));
            match next(line, first(freed, stopped.as_mut()).await) {
                Next::Buffer(buffer) => {
                    drop(offered.0.take());
                    spare = Some(buffer);
                }
                Next::Stop(stop) => {
                    offered.refuse(match &stop {
                        Stop::Ended(end) => *end,
                        Stop::Failed(_) => ChannelEnd::Poisoned,
                    });
                    return stop;
                }
            }
        }
        // The last sender is gone, and one buffer is here. The other values are still under way.
        for _ in 1..self.buffers {
            let freed = pin!(self.free.recv());
            let freed = pin!(first(freed, poisoned.as_mut()));
            if let Next::Stop(stop) = next(line, first(freed, stopped.as_mut()).await) {
                return stop;
            }
        }
        Stop::Ended(ChannelEnd::Closed)
    }

    fn poison(&self) {
        self.receiver.poison();
    }
}

type Freed = First<Result<Box<[u8]>, luna::RecvError>, ChannelEnd>;

fn next(line: &Line, happened: First<Freed, Stop>) -> Next {
    match happened {
        First::Own(First::Own(Ok(buffer))) => Next::Buffer(buffer),
        First::Own(First::Own(Err(_))) => off_path(|| {
            let name = line.name.clone();
            Next::Stop(Stop::Failed(NetError::ThreadEnded { name }))
        }),
        First::Own(First::Other(end)) => Next::Stop(Stop::Ended(end)),
        First::Other(stop) => Next::Stop(stop),
    }
}

impl<T: Send> Outward<T> {
    /// Waits for the other program, or the end of the local channel.
    async fn join(&self, line: &Line) -> Result<(), Stop> {
        match first(pin!(self.receiver.ended()), pin!(line.joined())).await {
            // What is in the buffer is still to be delivered.
            First::Own(ChannelEnd::Closed) if self.receiver.buffered() > 0 => {
                match first(pin!(self.receiver.poisoned()), pin!(line.joined())).await {
                    First::Own(end) => Err(Stop::Ended(end)),
                    First::Other(joined) => joined,
                }
            }
            First::Own(end) => Err(Stop::Ended(end)),
            First::Other(joined) => joined,
        }
    }
}
