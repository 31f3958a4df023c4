//! The interface with the feature `events`.

use super::ring::{Ring, Writer};
use core::cell::{Cell, RefCell};
use core::ptr;

pub use super::names::{Name, Names, listen, name, name_executor, name_process};
pub use super::waits_in::{WaitsIn, waits_in};

luna_platform::local! {
    /// The ring of this thread's events: null, or that of the writer in `ATTACHED`.
    static RING: Cell<*const Ring> = const { Cell::new(ptr::null()) };
    static ATTACHED: RefCell<Attached> = const { RefCell::new(Attached(None)) };
}

struct Attached(Option<Writer>);

impl Drop for Attached {
    fn drop(&mut self) {
        RING.set(ptr::null());
    }
}

/// Whether the calling thread is traced. One load.
#[inline(always)]
pub fn is_on() -> bool {
    !RING.get().is_null()
}

/// From now on the calling thread's events go to this ring.
///
/// ```
/// use luna_core::events::{self, Kind, code};
///
/// let (writer, mut reader) = events::ring(16, 0, None);
/// events::attach(writer);
/// events::report(code::SLOT, 7, || [41, 250]);
/// assert!(events::is_on());
/// events::detach();
/// let mut words = Vec::new();
/// reader.take(&mut words, 16);
/// assert_eq!((words[0], &words[2..]), (7 << 32 | u64::from(code::SLOT) << 16, &[41, 250][..]));
/// assert!(reader.is_over());
/// ```
pub fn attach(writer: Writer) {
    exchange(Some(writer));
}

/// From now on the calling thread is not traced.
pub fn detach() {
    exchange(None);
}

fn exchange(writer: Option<Writer>) -> Option<Writer> {
    let before = ATTACHED.try_with(|attached| {
        let ring = writer
            .as_ref()
            .map_or(ptr::null(), |writer| ptr::from_ref(writer.ring()));
        RING.set(ptr::null());
        let before = core::mem::replace(&mut attached.borrow_mut().0, writer);
        RING.set(ring);
        before
    });
    // A thread that is ending is traced no more.
    before.ok().flatten()
}

/// The ring of an executor that shares its thread with others, while another one has its turn.
#[derive(Debug, Default)]
pub struct Kept(Option<Writer>);

impl Kept {
    /// Exchanges this ring and the thread's: before a turn and after it.
    pub fn exchange(&mut self) {
        self.0 = exchange(self.0.take());
    }
}

#[inline]
pub(super) fn put(of: u16, subject: u32, arguments: [u64; 2]) {
    let ring = RING.get();
    if !ring.is_null() {
        let head = u64::from(subject) << 32 | u64::from(of) << 16;
        // SAFETY: the pointer is that of this thread's writer, which is live: the pointer is null
        // before the writer is dropped.
        if !unsafe { (*ring).put(head, arguments) } {
            // There is no reader any more. The writer stays: this may be the real-time path.
            RING.set(ptr::null());
        }
    }
}

/// Whether the calling thread is traced for this listener: see [`Names::id`].
#[inline]
pub fn is_for(listener: u64) -> bool {
    place().is_some_and(|(whose, _)| whose == listener)
}

/// The listener that records the calling thread, and the number of the thread, or of its present
/// executor, in that recording.
pub(super) fn place() -> Option<(u64, u32)> {
    let ring = RING.get();
    // SAFETY: as in `put`: a pointer that is not null is that of this thread's live writer.
    (!ring.is_null()).then(|| unsafe { ((*ring).whose(), (*ring).number()) })
}
