//! The newest value of a channel, and its age.

use luna_channels::{Receiver, TryRecvError};

/// How many values one [`SetPoints::take`] receives at most: a channel that overwrites its oldest
/// value has one.
const MAX_AT_ONCE: usize = 16;

/// The far end of a channel of set-points, for a driver that writes the newest one in each cycle.
///
/// It counts the cycles without a new value, so that the driver can stop when a controller is alive
/// and sends nothing any more.
///
/// ```
/// use luna::Buffer;
/// use luna::devices::SetPoints;
///
/// let (torque, channel) = luna::buffered(Buffer::overwrite_oldest(1));
/// let mut torques = SetPoints::new(channel);
/// torques.greatest_age(Some(1));
///
/// torque.try_send(0.5)?;
/// assert_eq!((torques.take(true), torques.overdue()), (Some(0.5), None));
/// assert_eq!((torques.take(true), torques.overdue()), (Some(0.5), None)); // a cycle old
/// assert_eq!((torques.take(true), torques.overdue()), (Some(0.5), Some(2)));
/// # Ok::<(), luna::TrySendError<f64>>(())
/// ```
#[derive(Debug)]
pub struct SetPoints<T> {
    channel: Receiver<T>,
    newest: Option<T>,
    /// Cycles without a newer one.
    age: u32,
    /// How many there may be; any number if none.
    greatest_age: Option<u32>,
    has_ended: bool,
}

impl<T: Copy> SetPoints<T> {
    /// Of this channel, without a greatest age.
    pub fn new(channel: Receiver<T>) -> Self {
        Self {
            channel,
            newest: None,
            age: 0,
            greatest_age: None,
            has_ended: false,
        }
    }

    /// After how many cycles without a new value it is [`overdue`](Self::overdue): more than these.
    /// None: never.
    pub fn greatest_age(&mut self, cycles: Option<u32>) {
        self.greatest_age = cycles;
    }

    /// Receives what has come, and returns the newest value while the channel has a sender: None
    /// before the first one and after the senders' end. To be called once a cycle. A value ages
    /// only while the device `is_driving`: before, its writer may wait for the device.
    ///
    /// Real-time path: yes. It does not wait; at most 16 values are received.
    pub fn take(&mut self, is_driving: bool) -> Option<T> {
        self.age = match is_driving {
            true => self.age.saturating_add(1),
            false => 0,
        };
        for _ in 0..MAX_AT_ONCE {
            match self.channel.try_recv() {
                Ok(value) => {
                    self.newest = Some(value);
                    self.age = 0;
                }
                Err(TryRecvError::Closed | TryRecvError::Poisoned) => {
                    self.has_ended = true;
                    self.newest = None;
                    break;
                }
                Err(_) => break,
            }
        }
        self.newest
    }

    /// What the last [`take`](Self::take) returned.
    pub fn newest(&self) -> Option<T> {
        self.newest
    }

    /// For how many cycles nothing new has come, if these are more than the greatest age. None
    /// before the first value, and after the senders' end.
    pub fn overdue(&self) -> Option<u32> {
        self.newest?;
        let most = self.greatest_age?;
        (self.age > most).then_some(self.age)
    }

    /// Whether the last [`take`](Self::take) found no sender, or a poisoned channel.
    pub fn has_ended(&self) -> bool {
        self.has_ended
    }

    /// Poisons the channel: see [`Receiver::poison`].
    pub fn poison(&self) {
        self.channel.poison();
    }
}

#[cfg(test)]
mod tests {
    use super::SetPoints;
    use luna_channels::{Buffer, buffered};

    #[test]
    fn a_value_is_overdue_when_nothing_new_came_for_longer_than_may_be() {
        let (sender, receiver) = buffered(Buffer::overwrite_oldest(1));
        let mut points = SetPoints::new(receiver);
        points.greatest_age(Some(3));
        let mut cycle = |is_driving| (points.take(is_driving), points.overdue());
        // Without a value nothing is driven.
        for _ in 0..10 {
            assert_eq!(cycle(true), (None, None));
        }
        sender.try_send(1).unwrap();
        // Before the start, a writer may pause.
        for _ in 0..10 {
            assert_eq!(cycle(false), (Some(1), None));
        }
        for _ in 0..3 {
            assert_eq!(cycle(true), (Some(1), None));
        }
        sender.try_send(2).unwrap();
        for _ in 0..4 {
            assert_eq!(cycle(true), (Some(2), None));
        }
        assert_eq!(cycle(true), (Some(2), Some(4)));
        // Late, but there.
        sender.try_send(3).unwrap();
        assert_eq!(cycle(true), (Some(3), None));
        // A writer that has ended is not late.
        drop(sender);
        for _ in 0..10 {
            assert_eq!(cycle(true), (None, None));
        }
        assert!(points.has_ended());
    }

    #[test]
    fn without_a_greatest_age_a_value_stays() {
        let (sender, receiver) = buffered(Buffer::overwrite_oldest(1));
        let mut points = SetPoints::new(receiver);
        sender.try_send(1).unwrap();
        for _ in 0..1_000 {
            assert_eq!((points.take(true), points.overdue()), (Some(1), None));
        }
    }
}
