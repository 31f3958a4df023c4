//! What the threads, the signals and the recorder of one system share.

#[cfg(feature = "events")]
mod events;

use crate::format::ClockBase;
use crate::lane::{self, Inlet};
use crate::registry::{Declared, Losses, RegisterError, Signals};
use crate::sample::Sample;
use crate::signal::SignalBuilder;
use luna_machine::counter::Counter;
use luna_platform::clock::Instant;
use std::cell::{Cell, RefCell};
use std::ptr;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, OnceLock, PoisonError, Weak};

#[cfg(feature = "events")]
pub(crate) use events::EventInlet;

/// What the time stamps of a system come from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
#[non_exhaustive]
pub enum TimeBase {
    /// The machine's clock, read from the processor's counter where possible.
    #[default]
    Machine,
    /// The clock of each thread: for systems on a virtual clock.
    OfThread,
}

impl TimeBase {
    fn with_stamp(self) -> (Self, Stamp) {
        let counter = Counter::of_machine().filter(|_| self == TimeBase::Machine);
        (self, counter.map_or(Stamp::Clock, Stamp::Counter))
    }
}

/// The names of a system's signals, the rings of its threads, and whether anything is recorded.
///
/// Threads [enter](Self::enter) it; what they register and record then belongs to it. Clones of its
/// `Arc` are the same hub.
pub struct Hub {
    /// Whether a recorder reads the rings.
    recording: AtomicBool,
    /// Of a system, it is known when the system starts.
    time: OnceLock<(TimeBase, Stamp)>,
    pub(crate) system: String,
    /// Messages lost on threads that have no ring.
    pub(crate) lost_messages: AtomicU64,
    registry: Mutex<Registry>,
    #[cfg(feature = "events")]
    events: events::Events,
}

/// What a recording needs that has begun.
pub(crate) struct Begun {
    #[cfg(feature = "events")]
    pub(crate) names: Option<Arc<luna_events::Names>>,
}

/// What time stamps are read from.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Stamp {
    /// In its ticks.
    Counter(Counter),
    /// The thread's clock, in nanoseconds.
    Clock,
}

impl Stamp {
    #[inline(always)]
    pub(crate) fn now(self) -> u64 {
        match self {
            Stamp::Counter(counter) => counter.read(),
            Stamp::Clock => Instant::now().as_nanos(),
        }
    }
}

/// The sizes of a thread's rings, in words of 8 bytes.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Rooms {
    pub(crate) samples: usize,
    pub(crate) messages: usize,
    /// How many events; 0 if none are recorded.
    #[cfg(feature = "events")]
    pub(crate) events: usize,
}

#[derive(Default)]
struct Registry {
    signals: Signals,
    /// Rings that the recorder has not taken yet.
    inlets: Vec<Inlet>,
    #[cfg(feature = "events")]
    events: Vec<EventInlet>,
    threads: u32,
    rooms: Option<Rooms>,
}

thread_local! {
    static HUB: RefCell<Option<Arc<Hub>>> = const { RefCell::new(None) };
    /// Whether this thread ever entered a hub: the first access to `HUB`, which is dropped with the
    /// thread, may allocate.
    static HAS_ENTERED: Cell<bool> = const { Cell::new(false) };
    /// Whether signals may be registered on this thread: between `Hub::enter` and the end of its
    /// guard.
    static MAY_REGISTER: Cell<bool> = const { Cell::new(false) };
}

/// Messages lost on the path by threads that have entered no hub. The hub that began to record last
/// takes them over.
static HOMELESS: AtomicU64 = AtomicU64::new(0);

/// The hub that began to record last: for messages of threads that have entered none.
static LATEST: Mutex<Weak<Hub>> = Mutex::new(Weak::new());

impl Hub {
    /// Creates a hub of `system`. It records nothing until a [`Recorder`](crate::Recorder) is
    /// started on it.
    pub fn new(system: &str, base: TimeBase) -> Arc<Hub> {
        let hub = Self::of_system(system);
        hub.set_time(base);
        hub
    }

    /// As [`new`](Self::new), where the clock is chosen later: call
    /// [`set_time`](Self::set_time) before a recorder is started.
    pub fn of_system(system: &str) -> Arc<Hub> {
        Arc::new(Hub {
            recording: AtomicBool::new(false),
            time: OnceLock::new(),
            system: system.to_owned(),
            lost_messages: AtomicU64::new(0),
            registry: Mutex::default(),
            #[cfg(feature = "events")]
            events: events::Events::default(),
        })
    }

    /// Says what time stamps are read from. Only the first call counts.
    pub fn set_time(&self, base: TimeBase) {
        self.time.get_or_init(|| base.with_stamp());
    }

    /// What time stamps are read from: the machine's clock, unless something else was chosen.
    fn time(&self) -> (TimeBase, Stamp) {
        *self.time.get_or_init(|| TimeBase::Machine.with_stamp())
    }

    pub(crate) fn stamp(&self) -> Stamp {
        self.time().1
    }

    /// A signal of this hub to be. Its [`register`](SignalBuilder::register) may be called on any
    /// thread, also before a recorder is started. Not for the real-time path: it allocates.
    ///
    /// ```
    /// use luna_logger::{Hub, Logging, Recorder, WriterSink};
    ///
    /// let hub = Hub::new("pump", Default::default());
    /// let flow = hub.signal::<f64>("flow").unit("l/s").register().unwrap();
    /// let recorder =
    ///     Recorder::start(&hub, Logging::to_sink(WriterSink::new(std::io::sink()))).unwrap();
    /// flow.record(0.5);
    /// assert_eq!(recorder.finish().signals[0].recorded, 1);
    /// ```
    pub fn signal<T: Sample>(self: &Arc<Self>, name: &str) -> SignalBuilder<T> {
        SignalBuilder::of_hub(Some(self.clone()), name)
    }

    /// Makes this the hub of the calling thread until the guard is dropped; then the previous hub
    /// is active again. Until then the thread may also register signals. A system does this around
    /// each `pre_run`.
    ///
    /// ```
    /// use luna_logger::{Hub, Signal};
    ///
    /// let hub = Hub::new("pump", Default::default());
    /// let _inside = hub.enter();
    /// let flow = Signal::<f64>::register("flow").unwrap();
    /// assert!(Signal::<f64>::register("flow").is_err()); // the hub's names are taken once
    /// ```
    pub fn enter(self: &Arc<Self>) -> Entered {
        HAS_ENTERED.set(true);
        Entered {
            before: HUB.with(|hub| hub.borrow_mut().replace(self.clone())),
            could_register: MAY_REGISTER.replace(true),
        }
    }

    /// Makes this the hub of the calling thread for good. If something is recorded, it makes the
    /// thread's rings. Call it on each thread that runs processes, before they run. The thread then
    /// records but registers nothing: [`enter`](Self::enter) allows that. Not for the real-time
    /// path: it allocates, once.
    pub fn enter_thread(self: &Arc<Self>) {
        HAS_ENTERED.set(true);
        let is_new = HUB.with(|hub| {
            let mut hub = hub.borrow_mut();
            let is_new = !hub.as_ref().is_some_and(|there| Arc::ptr_eq(there, self));
            if is_new {
                *hub = Some(self.clone());
            }
            is_new
        });
        #[cfg(feature = "events")]
        if is_new {
            // They were another's.
            luna_events::detach();
        }
        if is_new && self.is_recording() {
            lane::prepare(self);
        }
    }

    /// Whether samples and messages are kept.
    #[inline(always)]
    pub fn is_recording(&self) -> bool {
        self.recording.load(Ordering::Relaxed)
    }

    /// The hub that the calling thread has entered.
    pub(crate) fn of_thread() -> Option<Arc<Hub>> {
        HUB.try_with(|hub| hub.borrow().clone()).ok().flatten()
    }

    /// The hub in which the calling thread may register signals now.
    pub(crate) fn for_registration() -> Option<Arc<Hub>> {
        Self::of_thread().filter(|_| MAY_REGISTER.get())
    }

    /// The hub that a message of this thread goes to. A thread without rings must not call this on
    /// the path.
    pub(crate) fn for_messages() -> Option<Arc<Hub>> {
        Self::of_thread()
            .filter(|hub| hub.is_recording())
            .or_else(|| latest().upgrade())
            .filter(|hub| hub.is_recording())
    }

    /// None if it was called before: nothing would read the rings of an earlier recording.
    pub(crate) fn begin_recording(self: &Arc<Self>, rooms: Rooms) -> Option<Begun> {
        if self.registry().rooms.replace(rooms).is_some() {
            return None;
        }
        let begun = Begun {
            #[cfg(feature = "events")]
            names: (rooms.events > 0).then(|| self.listen()),
        };
        self.recording.store(true, Ordering::Relaxed);
        let mut latest = latest();
        // Those of until now are not this one's.
        let homeless = HOMELESS.swap(0, Ordering::Relaxed);
        if let Some(before) = latest.upgrade() {
            before.lost_messages.fetch_add(homeless, Ordering::Relaxed);
        }
        *latest = Arc::downgrade(self);
        Some(begun)
    }

    /// Counts a message lost on the path by a thread without rings. Wait-free, no allocation.
    #[cold]
    pub(crate) fn count_lost_message() {
        let of_hub = || {
            let count = |hub: &RefCell<Option<Arc<Hub>>>| {
                let hub = hub.try_borrow().ok()?;
                let hub = hub.as_ref().filter(|hub| hub.is_recording())?;
                hub.lost_messages.fetch_add(1, Ordering::Relaxed);
                Some(())
            };
            HUB.try_with(count).ok().flatten()
        };
        if !HAS_ENTERED.get() || of_hub().is_none() {
            HOMELESS.fetch_add(1, Ordering::Relaxed);
        }
    }

    /// Takes over the losses of threads without a hub, if this hub began to record last. Not for
    /// the real-time path.
    pub(crate) fn take_homeless(self: &Arc<Self>) {
        let latest = latest();
        if ptr::eq(latest.as_ptr(), Arc::as_ptr(self)) {
            let lost = HOMELESS.swap(0, Ordering::Relaxed);
            self.lost_messages.fetch_add(lost, Ordering::Relaxed);
        }
    }

    pub(crate) fn end_recording(&self) {
        self.recording.store(false, Ordering::Relaxed);
    }

    /// What times count from, as written in a recording.
    pub(crate) fn clock_base(&self) -> ClockBase {
        match self.time().0 {
            TimeBase::Machine => ClockBase::Monotonic,
            TimeBase::OfThread => ClockBase::Virtual,
        }
    }

    /// Announces the rings of a thread; `make` creates them for its number. False if nothing would
    /// read them.
    pub(crate) fn add_lane(&self, make: impl FnOnce(u32, Rooms) -> Inlet) -> bool {
        let mut registry = self.registry();
        let Some(rooms) = registry.rooms.filter(|_| self.is_recording()) else {
            return false;
        };
        let number = registry.threads;
        registry.threads += 1;
        let inlet = make(number, rooms);
        registry.inlets.push(inlet);
        true
    }

    /// Returns the new rings, and the signals registered since the last call.
    pub(crate) fn take_news(&self, inlets: &mut Vec<Inlet>, signals: &mut Vec<Declared>) {
        let mut registry = self.registry();
        inlets.append(&mut registry.inlets);
        signals.extend_from_slice(registry.signals.since(signals.len()));
    }

    /// Puts rings back that were taken too early.
    pub(crate) fn give_back(&self, inlets: Vec<Inlet>) {
        if !inlets.is_empty() {
            self.registry().inlets.extend(inlets);
        }
    }

    /// Assigns a number to a signal.
    pub(crate) fn declare(&self, declared: Declared) -> Result<(u32, Arc<Losses>), RegisterError> {
        self.registry().signals.declare(declared)
    }

    fn registry(&self) -> MutexGuard<'_, Registry> {
        self.registry.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

fn latest() -> MutexGuard<'static, Weak<Hub>> {
    LATEST.lock().unwrap_or_else(PoisonError::into_inner)
}

luna_platform::debug_fields!(Hub, |hub| system: hub.system, recording: hub.is_recording());

/// Ends what [`Hub::enter`] began.
#[must_use = "the thread leaves the hub when the guard is dropped"]
#[derive(Debug)]
pub struct Entered {
    before: Option<Arc<Hub>>,
    could_register: bool,
}

impl Drop for Entered {
    fn drop(&mut self) {
        let before = self.before.take();
        MAY_REGISTER.set(self.could_register);
        // Nothing is to be restored on a thread that ends.
        let _ = HUB.try_with(|hub| *hub.borrow_mut() = before);
    }
}
