//! Names, from the code that makes a named object to its listeners.

use crate::ring::{Reader, Writer, ring_of};
use luna_core::current;
use luna_core::events::{self, Kind, Listening, place};
use luna_machine::counter::Counter;
use luna_platform::lock::PiLock;
use std::collections::LinkedList;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Weak};

/// Something with a name.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Name {
    /// The kind of the object.
    pub kind: Kind,
    /// Its number.
    pub number: u32,
    /// The number of its parent; 0 if it has none.
    pub parent: u32,
    /// Its name.
    pub text: String,
    /// For a process: the number of its executor, and its level there. None for a process that is
    /// in another recording, or in none.
    pub runs_on: Option<(u32, u8)>,
}

/// The names that were not taken yet.
#[derive(Debug)]
pub struct Names {
    id: u64,
    list: PiLock<LinkedList<Name>>,
    _listening: Listening,
}

/// A name in a node of its own, which is allocated before the lock is taken: an executor may have
/// to wait for a thread that holds the lock to name something.
fn node(name: Name) -> LinkedList<Name> {
    LinkedList::from([name])
}

static LISTENERS: PiLock<Vec<Weak<Names>>> = PiLock::new(Vec::new());

/// Listens to the names of each process, channel, barrier, lock and loop of the program that is
/// named from now on, until the result is dropped.
///
/// ```
/// use luna_events::{self as events, Kind};
///
/// let names = events::listen();
/// events::name(Kind::Channel, 4_000_000_001, 0, || "setpoint".to_owned());
/// assert!(names.take().iter().any(|name| name.text == "setpoint"));
/// ```
pub fn listen() -> Arc<Names> {
    static NEXT: AtomicU64 = AtomicU64::new(1);
    let names = Arc::new(Names {
        id: NEXT.fetch_add(1, Ordering::Relaxed),
        list: PiLock::new(LinkedList::new()),
        _listening: events::listen(named),
    });
    let mut listeners = LISTENERS.lock();
    listeners.retain(|one| one.strong_count() > 0);
    listeners.push(Arc::downgrade(&names));
    names
}

impl Names {
    /// The id of this listener, unique in the program. Never 0.
    pub fn id(&self) -> u64 {
        self.id
    }

    /// As [`ring`](super::ring), of a thread or executor that is traced for this listener.
    ///
    /// ```
    /// use luna_events as events;
    ///
    /// let (one, other) = (events::listen(), events::listen());
    /// let (writer, _reader) = one.ring(16, 0, None);
    /// events::attach(writer);
    /// assert!(events::is_for(one.id()) && !events::is_for(other.id()));
    /// # events::detach();
    /// ```
    pub fn ring(&self, room: usize, number: u32, counter: Option<Counter>) -> (Writer, Reader) {
        ring_of(self.id, room, number, counter)
    }

    /// The names since the last call.
    pub fn take(&self) -> Vec<Name> {
        let names = std::mem::take(&mut *self.list.lock());
        names.into_iter().collect()
    }

    /// Reports a name to this listener alone.
    pub fn name(&self, kind: Kind, number: u32, parent: u32, text: String) {
        self.put(node(Name {
            kind,
            number,
            parent,
            text,
            runs_on: None,
        }));
    }

    /// No allocation. O(1).
    fn put(&self, mut node: LinkedList<Name>) {
        self.list.lock().append(&mut node);
    }
}

/// Whether the calling thread is traced for this listener: see [`Names::id`].
#[inline]
pub fn is_for(listener: u64) -> bool {
    place().is_some_and(|(whose, _)| whose == listener)
}

/// Gives a name to all listeners.
#[cold]
fn named(kind: Kind, number: u32, parent: u32, text: String, level: Option<u8>) {
    let on_path = current::set_on_path(false);
    let place = place();
    let name = Name {
        kind,
        number,
        parent,
        text,
        runs_on: None,
    };
    // Everything is allocated before the lock is taken, and freed after it is released. A listener
    // that was added meanwhile stands last, and gets none.
    let most = LISTENERS.lock().len();
    let mut room: Vec<_> = (0..most).map(|_| node(name.clone())).collect();
    let mut heard = Vec::with_capacity(most);
    {
        let listeners = LISTENERS.lock();
        for names in listeners.iter().filter_map(Weak::upgrade) {
            let own = place.filter(|(whose, _)| *whose == names.id);
            // An executor's number has a meaning in its own recording alone.
            if (kind != Kind::Executor || own.is_some())
                && let Some(mut node) = room.pop()
            {
                let runs_on = own.zip(level);
                for name in &mut node {
                    name.runs_on = runs_on.map(|((_, executor), level)| (executor, level));
                }
                names.put(node);
            }
            if heard.len() < most {
                heard.push(names);
            }
        }
    }
    drop((room, heard));
    current::set_on_path(on_path);
}
