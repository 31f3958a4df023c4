//! The loops of a link: from a wire to a channel, and from a channel to a wire.

use crate::Counts;
use crate::end::{Stop, UntilStopped};
use luna::external::{Fault, FromBytes, LinkError, Packer, Splitter, ToBytes, Wire, WireStop};
use luna::{Receiver, Sender};
use std::io::ErrorKind;
use std::pin::pin;
use std::time::Duration;

/// What a link does with a broken record: one that is garbled, cut off, or too long. All are
/// [counted](Counts::bad).
///
/// The value's type decides first: one that represents broken records ([`FromBytes::from_bad`]),
/// such as `Result<T, BadRecord>`, gets them all.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
#[non_exhaustive]
pub enum OnBad {
    /// It ends with the record as its error. The device is not lost by that.
    #[default]
    End,
    /// It drops the record, and continues with the next.
    Drop,
}

/// The transports differ in what an empty read and a refusal mean.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Kind {
    /// Bytes in a row. No bytes are the end.
    Stream,
    /// Packets, independent of each other: an empty one is broken, and one that is refused is lost.
    Packets,
}

/// Until something ends it.
pub(crate) async fn pump_in<T: FromBytes + Send>(
    wire: &mut Wire,
    splitter: &mut Splitter,
    sender: &Sender<T>,
    kind: Kind,
    on_bad: OnBad,
    counts: &Counts,
) -> UntilStopped {
    let mut ended = pin!(sender.ended());
    let mut is_at_end = false;
    loop {
        let record = if is_at_end {
            splitter.finish()
        } else {
            splitter.next_record()
        };
        let decoded = match record {
            Some(Ok(bytes)) => T::from_bytes(bytes).map_err(Fault::Malformed),
            Some(Err(bad)) => Err(bad.fault),
            None if is_at_end => return Err(Stop::HungUp),
            None => {
                match wire.read(splitter.room(), ended.as_mut()).await {
                    Ok(0) if kind == Kind::Packets => counts.one_bad(),
                    Ok(0) => is_at_end = true,
                    Ok(count) => splitter.filled(count),
                    Err(stop) => unless_refused(stop, kind, counts)?,
                }
                continue;
            }
        };
        let value = match decoded {
            Ok(value) => {
                counts.record();
                value
            }
            Err(fault) => {
                counts.one_bad();
                match (T::from_bad(splitter.bad(fault)), on_bad) {
                    (Ok(value), _) => value,
                    // A record that was cut off by hanging up: the hang-up is the cause.
                    (Err(_), _) if is_at_end => continue,
                    (Err(_), OnBad::Drop) => continue,
                    (Err(bad), OnBad::End) => return Err(bad.into()),
                }
            }
        };
        sender.send(value).await?;
    }
}

/// Writes records until the end or an error. With `is_unsent` the packer's last record is written
/// first; afterwards that shows whether a record was not written completely.
pub(crate) async fn pump_out<T: ToBytes + Send>(
    wire: &mut Wire,
    packer: &mut Packer,
    is_unsent: &mut bool,
    receiver: &Receiver<T>,
    kind: Kind,
    patience: Option<Duration>,
    counts: &Counts,
) -> UntilStopped {
    let mut poisoned = pin!(receiver.poisoned());
    loop {
        if !*is_unsent {
            packer.pack(&receiver.recv().await?)?;
            *is_unsent = true;
        }
        let number = counts.records() + 1;
        let written = wire.write(packer.packed(), number, poisoned.as_mut(), patience);
        match written.await {
            Ok(()) => counts.record(),
            Err(stop) => unless_refused(stop, kind, counts)?,
        }
        *is_unsent = false;
    }
}

/// A packet that was refused because no program listens does not end the link.
fn unless_refused(stop: WireStop, kind: Kind, counts: &Counts) -> Result<(), Stop> {
    match &stop {
        WireStop::Failed(LinkError::Read(error) | LinkError::Write { error, .. })
            if kind == Kind::Packets && error.kind() == ErrorKind::ConnectionRefused =>
        {
            counts.one_refused();
            Ok(())
        }
        _ => Err(stop.into()),
    }
}
