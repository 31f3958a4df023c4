//! The channels of a client.

use crate::Counts;
use crate::point::{Place, Source, Value};
use luna::channel::{ChannelEnd, Ended, TryRecvError, TrySendError};
use luna::{Error, Receiver, Sender};
use std::future::{Future, poll_fn};
use std::pin::Pin;
use std::task::Poll;

/// The most registers of a request, and bits in as many bytes: rmodbus takes frames of 255 bytes.
const LONGEST: u16 = 120;

/// How many values of a channel are written in a cycle at most, so that reads have their turn.
const WRITES: usize = 16;

/// A point that is read into a channel.
pub(crate) trait Reading: Send {
    fn place(&self) -> Place;
    /// Sends the value, if there is room.
    fn give(&self, raw: &[u16], counts: &Counts);
    fn ended(&self) -> Ended<'_>;
}

/// A point that is written from a channel.
pub(crate) trait Writing: Send {
    fn place(&self) -> Place;
    /// How many values a cycle may take: those that wait at its begin.
    fn waiting(&self) -> usize;
    /// How many values are in the channel, without those of senders that wait.
    fn buffered(&self) -> usize;
    /// A value that waits.
    fn take(&mut self) -> luna::Result<Option<Taken>>;
    /// Resolves when its senders are gone; values may be left.
    fn ended(&self) -> Ended<'_>;
    /// Whether its senders are gone, and no values are left.
    fn is_over(&self) -> bool;
}

/// A value to write.
pub(crate) struct Taken {
    pub(crate) raw: [u16; 2],
    pub(crate) number: f64,
}

pub(crate) struct ReadPoint<T> {
    pub(crate) source: Source<T>,
    pub(crate) sender: Sender<T>,
}

pub(crate) struct WritePoint<T> {
    pub(crate) source: Source<T>,
    pub(crate) receiver: Receiver<T>,
    pub(crate) is_over: bool,
}

impl<T: Value> Reading for ReadPoint<T> {
    fn place(&self) -> Place {
        self.source.place
    }

    fn give(&self, raw: &[u16], counts: &Counts) {
        match self.sender.try_send(T::decode(raw, self.source.order)) {
            Ok(()) => counts.add_value(),
            Err(TrySendError::Full(_)) => counts.add_dropped(),
            // The client finds that before its next cycle.
            Err(_) => {}
        }
    }

    fn ended(&self) -> Ended<'_> {
        self.sender.ended()
    }
}

impl<T: Value> Writing for WritePoint<T> {
    fn place(&self) -> Place {
        self.source.place
    }

    fn waiting(&self) -> usize {
        // A sender without a buffer waits too.
        self.buffered().clamp(1, WRITES)
    }

    fn buffered(&self) -> usize {
        self.receiver.buffered()
    }

    fn take(&mut self) -> luna::Result<Option<Taken>> {
        match self.receiver.try_recv() {
            Ok(value) => Ok(Some(Taken {
                raw: value.encode(self.source.order),
                number: value.number(),
            })),
            Err(TryRecvError::Closed) => {
                self.is_over = true;
                Ok(None)
            }
            Err(TryRecvError::Poisoned) => Err(Error::Poisoned),
            Err(_) => Ok(None),
        }
    }

    fn ended(&self) -> Ended<'_> {
        self.receiver.ended()
    }

    fn is_over(&self) -> bool {
        self.is_over
    }
}

/// All channels of a client but that of its events.
#[derive(Default)]
pub(crate) struct Points {
    pub(crate) readings: Vec<Box<dyn Reading>>,
    pub(crate) writings: Vec<Box<dyn Writing>>,
    pub(crate) blocks: Vec<Block>,
}

/// What one request reads: points that follow each other without a gap.
#[derive(Debug, PartialEq, Eq)]
pub(crate) struct Block {
    pub(crate) place: Place,
    /// Those of `readings`, which are in the order of places.
    pub(crate) readings: std::ops::Range<usize>,
    /// The code of the last exception that was reported, until it succeeds.
    pub(crate) refused: Option<crate::Code>,
}

impl Points {
    /// Makes the requests anew: some points have gone, or came. A request that stays keeps what was
    /// reported of it.
    pub(crate) fn arrange(&mut self) {
        self.readings.sort_by_key(|reading| {
            let place = reading.place();
            (place.table, place.address)
        });
        let places: Vec<Place> = self.readings.iter().map(|point| point.place()).collect();
        let before = std::mem::replace(&mut self.blocks, blocks(&places));
        for block in &mut self.blocks {
            let same = before.iter().find(|old| old.place == block.place);
            block.refused = same.and_then(|old| old.refused);
        }
    }

    /// Forgets points without another end. Returns whether there are any left.
    pub(crate) async fn forget_ended(&mut self) -> luna::Result<bool> {
        let before = self.readings.len();
        let mut kept = Vec::with_capacity(before);
        for reading in self.readings.drain(..) {
            match now(reading.ended()).await {
                None => kept.push(reading),
                Some(ChannelEnd::Closed) => {}
                Some(ChannelEnd::Poisoned) => return Err(Error::Poisoned),
            }
        }
        self.readings = kept;
        if self.readings.len() < before {
            self.arrange();
        }
        self.writings.retain(|writing| !writing.is_over());
        Ok(!self.readings.is_empty() || !self.writings.is_empty())
    }

    /// Does `work`, unless all channels end before, or one is poisoned; then it gives none.
    /// Values may be left in the channels of those to write.
    pub(crate) async fn unless_over<T>(
        &self,
        work: impl Future<Output = T>,
    ) -> luna::Result<Option<T>> {
        let readings = self.readings.iter().map(|point| point.ended());
        let writings = self.writings.iter().map(|point| point.ended());
        let mut ends: Vec<Pin<Box<Ended<'_>>>> = readings.chain(writings).map(Box::pin).collect();
        let mut work = std::pin::pin!(work);
        poll_fn(|cx| {
            let mut is_poisoned = false;
            ends.retain_mut(|end| match end.as_mut().poll(cx) {
                Poll::Pending => true,
                Poll::Ready(ChannelEnd::Closed) => false,
                Poll::Ready(ChannelEnd::Poisoned) => {
                    is_poisoned = true;
                    false
                }
            });
            if is_poisoned {
                return Poll::Ready(Err(Error::Poisoned));
            }
            if ends.is_empty() {
                return Poll::Ready(Ok(None));
            }
            work.as_mut().poll(cx).map(|done| Ok(Some(done)))
        })
        .await
    }
}

/// How a channel has ended already, if it has.
async fn now(ended: Ended<'_>) -> Option<ChannelEnd> {
    let mut ended = std::pin::pin!(ended);
    poll_fn(|cx| match ended.as_mut().poll(cx) {
        Poll::Ready(end) => Poll::Ready(Some(end)),
        Poll::Pending => Poll::Ready(None),
    })
    .await
}

/// The requests for points in the order of their places.
fn blocks(places: &[Place]) -> Vec<Block> {
    let mut blocks: Vec<Block> = Vec::new();
    for (number, place) in places.iter().enumerate() {
        let longest = match place.table {
            crate::Table::Coil | crate::Table::Discrete => LONGEST * 16,
            _ => LONGEST,
        };
        if let Some(last) = blocks.last_mut() {
            let end = u32::from(last.place.address) + u32::from(last.place.width);
            let own_end = u32::from(place.address) + u32::from(place.width);
            let width = own_end.max(end) - u32::from(last.place.address);
            let follows = u32::from(place.address) <= end && width <= u32::from(longest);
            if last.place.table == place.table && follows {
                last.place.width = width as u16;
                last.readings.end = number + 1;
                continue;
            }
        }
        blocks.push(Block {
            place: *place,
            readings: number..number + 1,
            refused: None,
        });
    }
    blocks
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Table;

    fn place(table: Table, address: u16, width: u16) -> Place {
        Place {
            table,
            address,
            width,
        }
    }

    #[test]
    fn neighbours_are_one_request_and_gaps_and_tables_divide() {
        let places = [
            place(Table::Coil, 0, 1),
            place(Table::Input, 0, 2),
            place(Table::Input, 2, 1),
            place(Table::Input, 2, 2),
            place(Table::Input, 5, 1),
            place(Table::Input, 65_534, 2),
        ];
        let found: Vec<_> = blocks(&places)
            .iter()
            .map(|block| {
                (
                    block.place.address,
                    block.place.width,
                    block.readings.clone(),
                )
            })
            .collect();
        assert_eq!(
            found,
            [(0, 1, 0..1), (0, 4, 1..4), (5, 1, 4..5), (65_534, 2, 5..6)]
        );
    }

    #[test]
    fn no_request_is_longer_than_a_frame() {
        let places: Vec<_> = (0..1_000).map(|at| place(Table::Holding, at, 1)).collect();
        let made = blocks(&places);
        assert!(made.iter().all(|block| block.place.width <= LONGEST));
        assert_eq!(
            made.iter().map(|block| block.readings.len()).sum::<usize>(),
            1_000
        );
    }
}
