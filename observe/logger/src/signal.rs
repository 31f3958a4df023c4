//! Signals: numbers over time.

use crate::hub::Hub;
use crate::lane::{self, Head};
use crate::registry::{Declared, Losses, RegisterError};
use crate::sample::Sample;
use std::marker::PhantomData;
use std::panic::{RefUnwindSafe, UnwindSafe};
use std::sync::Arc;

/// A number, a boolean or a small vector over time, which a process records.
///
/// Register it in `pre_run`, where memory may be allocated; [`record`](Self::record) is for the
/// real-time path. Clones are the same signal, for processes on other threads. When all of them are
/// dropped the name can be used again for a signal of the same type and unit.
///
/// A process that is an `async` block has its signals declared where it is spawned, from a builder
/// that knows the system ([`Hub::signal`]). Everywhere else registering is refused: in `main` no
/// system would record the signal, and in a body it would allocate on the real-time path. A system
/// calls `pre_run` between [`Hub::enter`] and the end of its guard. A program without a system does
/// the same by hand.
///
/// ```
/// use luna_logger::{Hub, Recorder, Logging, Signal, WriterSink};
///
/// let hub = Hub::new("arm", Default::default());
/// let recorder =
///     Recorder::start(&hub, Logging::to_sink(WriterSink::new(std::io::sink()))).unwrap();
/// let _inside = hub.enter();
/// let position = Signal::<[f64; 3]>::with_unit("arm/position", "m")
///     .description("of the gripper")
///     .register()?;
/// position.record([0.1, 0.2, 0.3]);
/// assert!(Signal::<f64>::register("arm/position").is_err());
/// assert_eq!(recorder.finish().signals[0].recorded, 1);
/// # Ok::<(), luna_logger::RegisterError>(())
/// ```
pub struct Signal<T> {
    head: Head,
    hub: Arc<Hub>,
    losses: Arc<Losses>,
    carries: PhantomData<fn(T)>,
}

// Its shared state is changed without calling user code in between, so a panic leaves it
// consistent.
impl<T> UnwindSafe for Signal<T> {}
impl<T> RefUnwindSafe for Signal<T> {}

impl<T: Sample> Signal<T> {
    /// Registers a signal without a unit. Not for the real-time path: it allocates, and takes a
    /// lock.
    ///
    /// # Errors
    ///
    /// The call is outside of `pre_run`; the name is taken, empty or of more than 255 bytes; or
    /// there are 65 536 signals.
    pub fn register(name: &str) -> Result<Signal<T>, RegisterError> {
        SignalBuilder::of_hub(None, name).register()
    }

    /// A signal to be, measured in `unit`.
    pub fn with_unit(name: &str, unit: &str) -> SignalBuilder<T> {
        SignalBuilder::of_hub(None, name).unit(unit)
    }

    /// Records a sample, with the time of the call.
    ///
    /// Real-time path: yes. Wait-free, O(elements), no allocation and no system call; one branch
    /// while nothing is recorded. A sample is dropped and counted if the ring has no room, or on
    /// the path of a thread that was not prepared ([`Hub::enter_thread`]). Off the path, such a
    /// thread creates its ring with the first sample, which allocates.
    #[inline]
    pub fn record(&self, value: T) {
        if self.hub.is_recording() {
            lane::sample(&self.hub, self.head, &self.losses, value);
        }
    }
}

impl<T> Clone for Signal<T> {
    fn clone(&self) -> Self {
        self.losses.join();
        Self {
            head: self.head,
            hub: self.hub.clone(),
            losses: self.losses.clone(),
            carries: PhantomData,
        }
    }
}

impl<T> Drop for Signal<T> {
    fn drop(&mut self) {
        self.losses.leave();
    }
}

luna_platform::debug_fields!(impl[T] Signal<T>, |signal| number: signal.head.signal());

/// A signal to be: see [`Signal::with_unit`].
#[must_use = "a signal is made by `register`"]
#[derive(Debug, Clone)]
pub struct SignalBuilder<T> {
    /// That of the `pre_run` that runs when it is registered, if none is stated.
    hub: Option<Arc<Hub>>,
    name: Arc<str>,
    unit: Arc<str>,
    description: Arc<str>,
    carries: PhantomData<fn(T)>,
}

impl<T: Sample> SignalBuilder<T> {
    pub(crate) fn of_hub(hub: Option<Arc<Hub>>, name: &str) -> Self {
        Self {
            hub,
            name: name.into(),
            unit: "".into(),
            description: "".into(),
            carries: PhantomData,
        }
    }

    /// What the signal is measured in.
    pub fn unit(mut self, unit: &str) -> Self {
        self.unit = unit.into();
        self
    }

    /// A short description of the signal.
    pub fn description(mut self, text: &str) -> Self {
        self.description = text.into();
        self
    }

    /// Registers the signal: with its hub, or with the system that runs a `pre_run` on the calling
    /// thread.
    ///
    /// # Errors
    ///
    /// As [`Signal::register`], but with a hub of its own the signal may be registered anywhere;
    /// also a unit longer than 63 bytes or a description longer than 1023.
    pub fn register(self) -> Result<Signal<T>, RegisterError> {
        let declared = Declared {
            name: self.name,
            unit: self.unit,
            description: self.description,
            element_type: T::TYPE,
            elements: T::ELEMENTS as u8,
            losses: Arc::default(),
        };
        let Some(hub) = self.hub.or_else(Hub::for_registration) else {
            // What is wrong with its texts is wrong everywhere, and is reported first.
            declared.check()?;
            return Err(RegisterError::NotInPreRun {
                signal: declared.name.to_string(),
            });
        };
        let (number, losses) = hub.declare(declared)?;
        Ok(Signal {
            head: Head::new(Head::SAMPLE, 2 + T::ELEMENTS, number),
            hub,
            losses,
            carries: PhantomData,
        })
    }
}
