//! The events of a system: the names of their subjects, and the rings of its executors.

use super::{Hub, Stamp, TimeBase};
use crate::lane;
use luna_core::current;
use luna_events as events;
use luna_platform::lock::PiLock;
use std::sync::{Arc, OnceLock, Weak};

/// What a hub keeps of events.
pub(super) struct Events {
    /// The names of subjects, for a recorder of events. The recorder owns them while it records.
    names: OnceLock<Heard>,
    /// The log for the rare events of threads without a ring of their own.
    others: PiLock<Option<events::Writer>>,
}

impl Default for Events {
    fn default() -> Self {
        Self {
            names: OnceLock::new(),
            others: PiLock::new(None),
        }
    }
}

/// The recorder's collection of names. Only the recorder holds it, so that no names are collected
/// after its end.
struct Heard {
    id: u64,
    names: Weak<events::Names>,
}

/// The reading end of a ring of events.
pub(crate) struct EventInlet {
    /// Of a thread that is not known by a lane of its own.
    pub(crate) name: Option<String>,
    pub(crate) events: events::Reader,
}

impl Hub {
    /// Creates the ring of the executor that the calling thread is now, if events are recorded and
    /// it has none. Call it before a process runs there. Several executors may share a thread
    /// ([`TimeBase::OfThread`]). Not for the real-time path: it allocates, once.
    ///
    /// ```
    /// use luna_logger::{Hub, Logging, Recorder};
    /// use luna_events::{self as events, code};
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
    #[inline]
    pub fn enter_executor(self: &Arc<Self>) {
        if let Some(heard) = self.events.names.get()
            && !events::is_for(heard.id)
        {
            self.make_events(heard);
        }
    }

    /// Records an event, also on a thread without a ring for this hub. There it takes a lock, so it
    /// is for rare events. Does not allocate.
    pub fn report(&self, of: u16, subject: u32, arguments: [u64; 2]) {
        let is_here = |heard: &Heard| events::is_for(heard.id);
        if self.events.names.get().is_some_and(is_here) {
            events::report(of, subject, || arguments);
        } else if let Some(others) = &mut *self.events.others.lock() {
            others.put(of, subject, arguments);
        }
    }

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
        let known = match self.time().0 {
            TimeBase::Machine => lane::number(self),
            TimeBase::OfThread => None,
        };
        let Some(rooms) = self.registry().rooms else {
            return;
        };
        let (number, writer) = self.add_events(&names, known, rooms.events, lane::thread_name);
        names.name(events::Kind::Executor, number, 0, lane::thread_name(number));
        events::attach(writer);
    }

    /// Creates a ring for the thread with this number, or else gives it a number and this name.
    fn add_events(
        &self,
        names: &events::Names,
        known: Option<u32>,
        room: usize,
        name: impl FnOnce(u32) -> String,
    ) -> (u32, events::Writer) {
        let counter = match self.stamp() {
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

    /// Names a subject that existed before the recording: its kind and number, and what a name
    /// record has as its parent. Allocates.
    pub fn name(&self, kind: events::Kind, number: u32, of: u32, name: String) {
        if let Some(names) = self
            .events
            .names
            .get()
            .and_then(|heard| heard.names.upgrade())
        {
            names.name(kind, number, of, name);
        }
    }

    /// Whether events are recorded.
    pub fn records_events(&self) -> bool {
        self.events.names.get().is_some()
    }

    /// Takes the rings of events that are new.
    pub(crate) fn take_events(&self) -> Vec<EventInlet> {
        std::mem::take(&mut self.registry().events)
    }

    pub(super) fn listen(&self) -> Arc<events::Names> {
        let names = events::listen();
        // It is recorded once.
        let _ = self.events.names.set(Heard {
            id: names.id(),
            names: Arc::downgrade(&names),
        });
        const FEW: usize = 64;
        let (_, others) = self.add_events(&names, None, FEW, |_| "other threads".to_owned());
        *self.events.others.lock() = Some(others);
        names
    }
}
