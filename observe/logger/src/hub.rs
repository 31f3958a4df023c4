//! What the threads, the signals and the recorder of one system share.

use crate::format::{ClockBase, MAX_SIGNALS, Type};
use crate::lane::{self, Inlet};
#[cfg(feature = "events")]
use luna_core::{current, events};
use luna_platform::clock::{Counter, Instant};
#[cfg(feature = "events")]
use luna_platform::lock::PiLock;
use std::cell::{Cell, RefCell};
use std::collections::HashMap;
use std::fmt;
use std::ptr;
#[cfg(feature = "events")]
use std::sync::OnceLock;
use std::sync::atomic::{AtomicBool, AtomicU32, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, Weak};

/// The most bytes of a signal's name, unit and description.
const MAX_NAME: usize = 255;
const MAX_UNIT: usize = 63;
const MAX_DESCRIPTION: usize = 1023;

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

/// The names of a system's signals, the rings of its threads, and whether anything is recorded.
///
/// Threads [enter](Self::enter) it; what they register and record then belongs to it. Clones of its
/// `Arc` are the same hub.
pub struct Hub {
    /// Whether a recorder reads the rings.
    recording: AtomicBool,
    pub(crate) stamp: Stamp,
    pub(crate) system: String,
    base: TimeBase,
    /// Messages lost on threads that have no ring.
    pub(crate) lost_messages: AtomicU64,
    registry: Mutex<Registry>,
    /// The names of subjects, for a recorder of events. The recorder owns them while it records.
    #[cfg(feature = "events")]
    names: OnceLock<Heard>,
    /// The log for the rare events of threads without a ring of their own.
    #[cfg(feature = "events")]
    others: PiLock<Option<events::Writer>>,
}

/// The recorder's collection of names. Only the recorder holds it, so that no names are collected
/// after its end.
#[cfg(feature = "events")]
struct Heard {
    id: u64,
    names: Weak<events::Names>,
}

/// What a recording needs that has begun.
pub(crate) struct Begun {
    #[cfg(feature = "events")]
    pub(crate) names: Option<Arc<events::Names>>,
}

/// The reading end of a ring of events.
#[cfg(feature = "events")]
pub(crate) struct EventInlet {
    /// Of a thread that is not known by a lane of its own.
    pub(crate) name: Option<String>,
    pub(crate) events: events::Reader,
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

/// What a signal is, for the recorder.
#[derive(Debug, Clone)]
pub(crate) struct Declared {
    pub(crate) name: Arc<str>,
    pub(crate) unit: Arc<str>,
    pub(crate) description: Arc<str>,
    pub(crate) element_type: Type,
    pub(crate) elements: u8,
    pub(crate) losses: Arc<Losses>,
}

impl Declared {
    /// Whether its texts can be recorded.
    pub(crate) fn check(&self) -> Result<(), RegisterError> {
        for (what, text, most) in [
            ("name", &self.name, MAX_NAME),
            ("unit", &self.unit, MAX_UNIT),
            ("description", &self.description, MAX_DESCRIPTION),
        ] {
            if text.len() > most {
                return Err(RegisterError::TooLong {
                    signal: self.name.to_string(),
                    what,
                    most,
                });
            }
        }
        if self.name.is_empty() {
            return Err(RegisterError::NoName);
        }
        Ok(())
    }
}

/// How many samples of a signal were dropped before they reached the recorder, and how many handles
/// use it.
#[derive(Debug, Default)]
pub(crate) struct Losses {
    lost: AtomicU64,
    users: AtomicU32,
}

impl Losses {
    #[cold]
    #[inline(never)]
    pub(crate) fn count(&self) {
        self.lost.fetch_add(1, Ordering::Relaxed);
    }

    pub(crate) fn get(&self) -> u64 {
        self.lost.load(Ordering::Relaxed)
    }

    pub(crate) fn join(&self) {
        self.users.fetch_add(1, Ordering::Relaxed);
    }

    pub(crate) fn leave(&self) {
        self.users.fetch_sub(1, Ordering::Relaxed);
    }

    fn is_used(&self) -> bool {
        self.users.load(Ordering::Relaxed) > 0
    }
}

#[derive(Default)]
struct Registry {
    signals: Vec<Declared>,
    numbers: HashMap<Arc<str>, u32>,
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
        let counter = Counter::of_machine().filter(|_| base == TimeBase::Machine);
        Arc::new(Hub {
            recording: AtomicBool::new(false),
            stamp: counter.map_or(Stamp::Clock, Stamp::Counter),
            system: system.to_owned(),
            base,
            lost_messages: AtomicU64::new(0),
            registry: Mutex::default(),
            #[cfg(feature = "events")]
            names: OnceLock::new(),
            #[cfg(feature = "events")]
            others: PiLock::new(None),
        })
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
            events::detach();
        }
        if is_new && self.is_recording() {
            lane::prepare(self);
        }
    }

    /// Creates the ring of the executor that the calling thread is now, if events are recorded and
    /// it has none. Call it before a process runs there. Several executors may share a thread
    /// ([`TimeBase::OfThread`]). Not for the real-time path: it allocates, once.
    ///
    /// ```
    /// use luna_logger::{Hub, Logging, Recorder};
    /// use luna_core::events::{self, code};
    ///
    /// let file = std::env::temp_dir().join(format!("luna-events-{}.luna", std::process::id()));
    /// let hub = Hub::new("bench", Default::default());
    /// let recorder = Recorder::start(&hub, Logging::to_file(&file).events()).unwrap();
    /// hub.enter_thread();
    /// hub.enter_executor();
    /// events::report(code::DONE, 7, || [code::ended::OK, 0]);
    /// let report = recorder.finish();
    /// assert_eq!((report.events.recorded, report.events.lost), (1, 0));
    /// # std::fs::remove_file(file).unwrap();
    /// ```
    #[cfg(feature = "events")]
    #[inline]
    pub fn enter_executor(self: &Arc<Self>) {
        if let Some(heard) = self.names.get()
            && !events::is_for(heard.id)
        {
            self.make_events(heard);
        }
    }

    /// Records an event, also on a thread without a ring for this hub. There it takes a lock, so it
    /// is for rare events. Does not allocate.
    #[cfg(feature = "events")]
    pub fn report(&self, of: u16, subject: u32, arguments: [u64; 2]) {
        let is_here = |heard: &Heard| events::is_for(heard.id);
        if self.names.get().is_some_and(is_here) {
            events::report(of, subject, || arguments);
        } else if let Some(others) = &mut *self.others.lock() {
            others.put(of, subject, arguments);
        }
    }

    #[cfg(feature = "events")]
    #[cold]
    fn make_events(self: &Arc<Self>, heard: &Heard) {
        if !self.is_recording() || current::on_path() {
            return;
        }
        let Some(names) = heard.names.upgrade() else {
            return;
        };
        // Executors that share a thread are distinguished; otherwise the thread is known by its
        // samples and messages.
        let known = match self.base {
            TimeBase::Machine => lane::number(self),
            TimeBase::OfThread => None,
        };
        let Some(rooms) = self.registry().rooms else {
            return;
        };
        let (number, writer) = self.add_events(&names, known, rooms.events, lane::thread_name);
        names.name(events::Kind::Executor, number, lane::thread_name(number));
        events::attach(writer);
    }

    /// Creates a ring for the thread with this number, or else gives it a number and this name.
    #[cfg(feature = "events")]
    fn add_events(
        &self,
        names: &events::Names,
        known: Option<u32>,
        room: usize,
        name: impl FnOnce(u32) -> String,
    ) -> (u32, events::Writer) {
        let counter = match self.stamp {
            Stamp::Counter(counter) => Some(counter),
            Stamp::Clock => None,
        };
        let mut registry = self.registry();
        let number = known.unwrap_or_else(|| {
            let next = registry.threads;
            registry.threads += 1;
            next
        });
        let (writer, events) = names.ring(room, number, counter);
        registry.events.push(EventInlet {
            name: known.is_none().then(|| name(number)),
            events,
        });
        (number, writer)
    }

    /// Names a subject that existed before the recording: its kind and number. Allocates.
    #[cfg(feature = "events")]
    pub fn name(&self, kind: events::Kind, number: u32, name: String) {
        if let Some(names) = self.names.get().and_then(|heard| heard.names.upgrade()) {
            names.name(kind, number, name);
        }
    }

    /// Whether events are recorded.
    #[cfg(feature = "events")]
    pub fn records_events(&self) -> bool {
        self.names.get().is_some()
    }

    /// Takes the rings of events that are new.
    #[cfg(feature = "events")]
    pub(crate) fn take_events(&self) -> Vec<EventInlet> {
        std::mem::take(&mut self.registry().events)
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

    #[cfg(feature = "events")]
    fn listen(&self) -> Arc<events::Names> {
        let names = events::listen();
        // It is recorded once.
        let _ = self.names.set(Heard {
            id: names.id(),
            names: Arc::downgrade(&names),
        });
        const FEW: usize = 64;
        let (_, others) = self.add_events(&names, None, FEW, |_| "other threads".to_owned());
        *self.others.lock() = Some(others);
        names
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
        match self.base {
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
        signals.extend_from_slice(&registry.signals[signals.len()..]);
    }

    /// Puts rings back that were taken too early.
    pub(crate) fn give_back(&self, inlets: Vec<Inlet>) {
        if !inlets.is_empty() {
            self.registry().inlets.extend(inlets);
        }
    }

    /// Assigns a number to a signal.
    pub(crate) fn declare(&self, declared: Declared) -> Result<(u32, Arc<Losses>), RegisterError> {
        declared.check()?;
        let name = || declared.name.to_string();
        let mut registry = self.registry();
        if let Some(&number) = registry.numbers.get(&declared.name) {
            let there = &registry.signals[number as usize];
            let is_same = there.element_type == declared.element_type
                && there.elements == declared.elements
                && there.unit == declared.unit;
            // All handles are gone: a process that is started again continues its signal.
            if there.losses.is_used() || !is_same {
                return Err(RegisterError::Duplicate { signal: name() });
            }
            there.losses.join();
            return Ok((number, there.losses.clone()));
        }
        let number = registry.signals.len();
        if number >= MAX_SIGNALS {
            return Err(RegisterError::TooMany { signal: name() });
        }
        let losses = declared.losses.clone();
        losses.join();
        registry
            .numbers
            .insert(declared.name.clone(), number as u32);
        registry.signals.push(declared);
        Ok((number as u32, losses))
    }

    fn registry(&self) -> MutexGuard<'_, Registry> {
        self.registry.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

fn latest() -> MutexGuard<'static, Weak<Hub>> {
    LATEST.lock().unwrap_or_else(PoisonError::into_inner)
}

impl fmt::Debug for Hub {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Hub")
            .field("system", &self.system)
            .field("recording", &self.is_recording())
            .finish_non_exhaustive()
    }
}

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

/// Why a signal cannot be registered.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum RegisterError {
    /// It was not registered in `pre_run` of a process.
    #[error(
        "signal `{signal}` was registered outside of `pre_run`; register it in `pre_run` of the process that records it (`impl luna::Process`)"
    )]
    NotInPreRun {
        /// The signal's name.
        signal: String,
    },
    /// Another signal has the name.
    #[error(
        "the name `{signal}` is taken: another signal of the system has it, or had it with another type or unit; name signals with what they are of, such as \"pump/flow\""
    )]
    Duplicate {
        /// The name.
        signal: String,
    },
    /// Its name is empty.
    #[error("a signal has an empty name; give it one")]
    NoName,
    /// One of its texts is too long.
    #[error("the {what} of signal `{signal}` has more than {most} bytes; use a shorter one")]
    TooLong {
        /// The signal's name.
        signal: String,
        /// Which of its texts.
        what: &'static str,
        /// How many bytes it may have.
        most: usize,
    },
    /// There are as many signals as a recording may have.
    #[error(
        "signal `{signal}` is one more than the {MAX_SIGNALS} that a recording may have; record arrays"
    )]
    TooMany {
        /// The signal's name.
        signal: String,
    },
}
