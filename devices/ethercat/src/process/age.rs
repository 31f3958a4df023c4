//! The last value from a channel, and its age.

use luna::{Receiver, TryRecvError};

/// How many values are taken of one channel at a time: a register has one.
const MAX_AT_ONCE: usize = 16;

/// The far end of a channel of set-points.
#[derive(Debug)]
pub(super) struct SetPoints<T> {
    pub(super) channel: Receiver<T>,
    pub(super) newest: Option<T>,
    /// Cycles without a newer one.
    age: u32,
    /// How many there may be; any number if none.
    pub(super) greatest_age: Option<u32>,
    pub(super) has_ended: bool,
}

impl<T: Copy> SetPoints<T> {
    pub(super) fn new(channel: Receiver<T>) -> Self {
        Self {
            channel,
            newest: None,
            age: 0,
            greatest_age: None,
            has_ended: false,
        }
    }

    /// Takes the newest value, while it has a writer. It ages only while the link `is_driving`:
    /// before, the writer may wait for the first sample.
    pub(super) fn take(&mut self, is_driving: bool) {
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
                    return;
                }
                Err(_) => return,
            }
        }
    }

    /// For how many cycles nothing new has come, if these are too many. None before the first
    /// value, and after the writers' end.
    pub(super) fn overdue(&self) -> Option<u32> {
        self.newest?;
        let most = self.greatest_age?;
        (self.age > most).then_some(self.age)
    }
}

#[cfg(test)]
mod tests {
    use super::SetPoints;
    use luna::Buffer;

    #[test]
    fn a_value_is_overdue_when_nothing_new_came_for_longer_than_may_be() {
        let (sender, receiver) = luna::buffered(Buffer::overwrite_oldest(1));
        let mut points = SetPoints::new(receiver);
        points.greatest_age = Some(3);
        let mut cycle = |is_driving| {
            points.take(is_driving);
            (points.newest, points.overdue())
        };
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
        assert_eq!(cycle(true), (Some(1), Some(4)));
        // Late, but there.
        sender.try_send(3).unwrap();
        assert_eq!(cycle(true), (Some(3), None));
        // A writer that has gone is not late.
        drop(sender);
        for _ in 0..10 {
            assert_eq!(cycle(true), (None, None));
        }
    }
}
