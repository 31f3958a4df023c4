//! The plant's ends of actuators' and sensors' channels, for all types of values.

use luna::{Receiver, Sender, TryRecvError, TrySendError};
use std::cell::Cell;
use std::future::{Future, poll_fn};
use std::pin::Pin;
use std::task::Poll;

/// A value of a sensor's channel, made of what a plant's output is.
///
/// ```
/// use luna_plants::Measured;
///
/// assert_eq!(i32::from_value(-7.0), Some(-7));
/// assert_eq!(i32::from_value(0.5), None);
/// assert_eq!(u8::from_value(300.0), None);
/// assert_eq!(bool::from_value(1.0), Some(true));
///
/// struct Millimetres(f64);
/// impl Measured for Millimetres {
///     const NAME: &str = "length";
///     fn from_value(value: f64) -> Option<Self> { Some(Self(1000.0 * value)) }
/// }
/// # assert_eq!(Millimetres::from_value(1.0).unwrap().0, 1000.0);
/// ```
pub trait Measured: Sized {
    /// The type's name in errors: "i32".
    const NAME: &str;

    /// Converts the finite `value`; none if the type cannot represent it. Must not allocate or
    /// block.
    fn from_value(value: f64) -> Option<Self>;
}

impl Measured for f64 {
    const NAME: &str = "f64";

    fn from_value(value: f64) -> Option<Self> {
        Some(value)
    }
}

impl Measured for f32 {
    const NAME: &str = "f32";

    fn from_value(value: f64) -> Option<Self> {
        Some(value as f32).filter(|value| value.is_finite())
    }
}

/// 0 and 1.
impl Measured for bool {
    const NAME: &str = "bool";

    fn from_value(value: f64) -> Option<Self> {
        if value == 0.0 {
            Some(false)
        } else if value == 1.0 {
            Some(true)
        } else {
            None
        }
    }
}

macro_rules! whole {
    ($($type:ident),+) => { $(
        impl Measured for $type {
            const NAME: &str = stringify!($type);

            fn from_value(value: f64) -> Option<Self> {
                // A cast saturates, and truncates.
                let cast = value as $type;
                (f64::from(cast) == value).then_some(cast)
            }
        }
    )+ };
}
whole!(i8, u8, i16, u16, i32, u32);

/// The place of a value between a plant and its channel's operation.
pub(super) type Slot = Cell<Option<f64>>;

/// Why an end is of no use any more.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Gone {
    Closed,
    Poisoned,
}

/// Moves values from or to a slot, for ever; pending when the slot has to be served. Created once,
/// so that an exchange allocates nothing.
pub(super) type Pump<'a> = Pin<Box<dyn Future<Output = Gone> + 'a>>;

pub(super) trait ActuatorEnd: Send {
    /// The newest value received, if any.
    fn newest(&self) -> Result<Option<f64>, Gone>;

    /// Fills the slot whenever it is empty.
    fn pump<'a>(&'a self, slot: &'a Slot) -> Pump<'a>;

    fn poison(&self);
}

/// The limit of values received from an actuator at a time: a register holds one, and so does a
/// rendezvous with one writer.
const MAX_AT_ONCE: usize = 16;

impl<T: Into<f64> + Send> ActuatorEnd for Receiver<T> {
    fn newest(&self) -> Result<Option<f64>, Gone> {
        let mut newest = None;
        for _ in 0..MAX_AT_ONCE {
            match self.try_recv() {
                Ok(value) => newest = Some(value.into()),
                Err(TryRecvError::Poisoned) => return Err(Gone::Poisoned),
                Err(TryRecvError::Closed) if newest.is_none() => return Err(Gone::Closed),
                Err(_) => break,
            }
        }
        Ok(newest)
    }

    fn pump<'a>(&'a self, slot: &'a Slot) -> Pump<'a> {
        Box::pin(async move {
            loop {
                match self.recv().await {
                    Ok(value) => slot.set(Some(value.into())),
                    Err(error) if error.is_poisoned() => return Gone::Poisoned,
                    Err(_) => return Gone::Closed,
                }
                until(slot, |value| value.is_none()).await;
            }
        })
    }

    fn poison(&self) {
        Receiver::poison(self);
    }
}

pub(super) trait SensorEnd: Send {
    /// The type of the channel, if it has not this value.
    fn refuses(&self, value: f64) -> Option<&'static str>;

    /// Sends the value, if there is room or a reader waits.
    fn offer(&self, value: f64) -> Result<(), Gone>;

    /// Empties the slot whenever it is filled.
    fn pump<'a>(&'a self, slot: &'a Slot) -> Pump<'a>;

    fn poison(&self);
}

impl<T: Measured + Send> SensorEnd for Sender<T> {
    fn refuses(&self, value: f64) -> Option<&'static str> {
        T::from_value(value).is_none().then_some(T::NAME)
    }

    fn offer(&self, value: f64) -> Result<(), Gone> {
        let Some(value) = T::from_value(value) else {
            return Ok(());
        };
        match self.try_send(value) {
            Ok(()) | Err(TrySendError::Full(_)) => Ok(()),
            Err(TrySendError::Closed(_)) => Err(Gone::Closed),
            Err(TrySendError::Poisoned(_)) => Err(Gone::Poisoned),
        }
    }

    fn pump<'a>(&'a self, slot: &'a Slot) -> Pump<'a> {
        Box::pin(async move {
            loop {
                until(slot, |value| value.is_some()).await;
                if let Some(value) = slot.get().and_then(T::from_value) {
                    match self.send(value).await {
                        Ok(()) => {}
                        Err(error) if error.is_poisoned() => return Gone::Poisoned,
                        Err(_) => return Gone::Closed,
                    }
                }
                slot.set(None);
            }
        })
    }

    fn poison(&self) {
        Sender::poison(self);
    }
}

/// Pending until the plant has done its part. The plant polls it afterwards, so no wake-up is
/// needed.
async fn until(slot: &Slot, done: impl Fn(Option<f64>) -> bool) {
    poll_fn(|_| {
        if done(slot.get()) {
            Poll::Ready(())
        } else {
            Poll::Pending
        }
    })
    .await;
}
