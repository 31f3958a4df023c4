//! The file of a link, whose reads and writes are recorded and replayed.

use super::wire::{Wire, WireStop as Stop};
use luna_channels::{ChannelEnd, Ended};
use luna_core::current;
use luna_core::replay_log::{Event, Turn};
use luna_replay::log::{self, Unrecorded};
use std::pin::Pin;

/// An open file that lets its link wait.
#[derive(Debug)]
pub(super) struct Device(pub(super) Wire);

impl Device {
    /// Reads what is there, to a place that is not empty; waits for some, while the channel has not
    /// `ended`. 0 is the end of the file.
    pub(super) async fn read(
        &mut self,
        to: &mut [u8],
        ended: Pin<&mut Ended<'_>>,
    ) -> Result<usize, Stop> {
        if !current::has_replay_log() {
            return self.0.read(to, ended).await;
        }
        match log::enters().await {
            Turn::Record => {
                let read = Unrecorded(self.0.read(to, ended)).await;
                match &read {
                    Ok(count) => log::note_read(&to[..*count]),
                    Err(stop) => leave_by(stop),
                }
                read
            }
            Turn::Given(event) => {
                log::leave(event);
                Err(stopped(event))
            }
            Turn::Look => match log::read(to) {
                Some(count) => {
                    log::hold().await;
                    Ok(count)
                }
                // The replay has ended.
                None => std::future::pending().await,
            },
        }
    }

    /// Writes all of `bytes`, the record `number`; waits for room, while the channel has not
    /// `ended`.
    pub(super) async fn write(
        &mut self,
        bytes: &[u8],
        number: u64,
        ended: Pin<&mut Ended<'_>>,
    ) -> Result<(), Stop> {
        if !current::has_replay_log() {
            return self.0.write(bytes, number, ended, None).await;
        }
        log::note_written(bytes);
        match log::enters().await {
            Turn::Record => {
                let written = Unrecorded(self.0.write(bytes, number, ended, None)).await;
                match &written {
                    Ok(()) => log::leave(Event::done(0)),
                    Err(stop) => leave_by(stop),
                }
                written
            }
            Turn::Given(event) => {
                log::leave(event);
                Err(stopped(event))
            }
            Turn::Look => {
                log::leave(Event::done(0));
                log::hold().await;
                Ok(())
            }
        }
    }
}

/// Records why a file was not read or written.
fn leave_by(stop: &Stop) {
    match stop {
        Stop::Ended(ChannelEnd::Closed) => log::leave(Event::failed(0)),
        Stop::Ended(ChannelEnd::Poisoned) => log::leave(Event::failed(1)),
        // An error of the system has too many forms.
        Stop::Failed(_) => {
            current::replay_log(|log| log.outside("a file of `luna::external` that fails"));
            log::leave(Event::failed(0));
        }
    }
}

/// Why the recorded device was not read or written.
fn stopped(event: Event) -> Stop {
    Stop::Ended(match event.number {
        0 => ChannelEnd::Closed,
        _ => ChannelEnd::Poisoned,
    })
}
