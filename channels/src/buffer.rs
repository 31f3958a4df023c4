//! Buffers: what a channel holds between a send and a receive, and what happens when it is full.

use crate::error::BufferError;

/// How many values a channel can hold, and what a send does when they are that many. See
/// [`buffered`](crate::buffered).
///
/// ```
/// use luna_channels::{Buffer, buffered};
///
/// let (setpoint, latest) = buffered::<f64>(Buffer::overwrite_oldest(1));
/// setpoint.try_send(1.0)?;
/// setpoint.try_send(2.0)?; // never waits
/// assert_eq!(latest.try_recv(), Ok(2.0));
/// # Ok::<(), luna_channels::TrySendError<f64>>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Buffer {
    pub(crate) capacity: usize,
    pub(crate) when_full: WhenFull,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum WhenFull {
    Wait,
    DropOldest,
    DropNewest,
    Grow,
}

impl Buffer {
    /// Holds up to `capacity` values; a send waits while it is full.
    pub const fn fifo(capacity: usize) -> Buffer {
        Buffer {
            capacity,
            when_full: WhenFull::Wait,
        }
    }

    /// Holds the last `capacity` values: a send into a full one drops the oldest, and never waits.
    pub const fn overwrite_oldest(capacity: usize) -> Buffer {
        Buffer {
            capacity,
            when_full: WhenFull::DropOldest,
        }
    }

    /// Holds the first `capacity - 1` values and the last one: a send into a full one replaces the
    /// newest, and never waits.
    pub const fn overwrite_newest(capacity: usize) -> Buffer {
        Buffer {
            capacity,
            when_full: WhenFull::DropNewest,
        }
    }

    /// Holds any number of values, and **allocates** as it grows: a send never waits, and is not
    /// for the real-time path. What is sent faster than it is received fills the memory.
    ///
    /// ```
    /// use luna_channels::{Buffer, buffered};
    ///
    /// let (log, lines) = buffered::<u32>(Buffer::allocating_unbounded());
    /// for n in 0..1000 {
    ///     log.try_send(n)?; // never full
    /// }
    /// assert_eq!(lines.buffered(), 1000);
    /// # Ok::<(), luna_channels::TrySendError<u32>>(())
    /// ```
    pub const fn allocating_unbounded() -> Buffer {
        Buffer {
            capacity: usize::MAX,
            when_full: WhenFull::Grow,
        }
    }

    /// No buffer at all.
    pub(crate) const RENDEZVOUS: Buffer = Buffer::fifo(0);

    /// How many values room is set aside for.
    pub(crate) fn reserved(self) -> usize {
        match self.when_full {
            WhenFull::Grow => 0,
            _ => self.capacity,
        }
    }

    pub(crate) fn validate(self) -> Result<Self, BufferError> {
        if self.capacity == 0 {
            return Err(BufferError::ZeroCapacity);
        }
        Ok(self)
    }
}
