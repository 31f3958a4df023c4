//! The interface with the feature `events`.

use super::ring::{Ring, Writer};
use super::{Kind, code, waits};
use crate::current::{self, User};
use core::cell::{Cell, RefCell};
use core::ptr;
use core::task::Poll;

pub use super::names::{Name, Names, listen, name, name_executor, name_process};
pub use super::waits::{
    WaitsIn, beside, waits_for, waits_for_other, waits_for_several, waits_in, waits_no_more,
};

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

/// Whether the calling thread is recorded. One load.
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

/// From now on the calling thread is not recorded.
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
    // A thread that is ending is recorded no more.
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

/// Not an event, but the begin of a name that is made on the real-time path: its length in bytes
/// with its [`Kind`] in the upper half, and its process. Parts of 16 bytes each follow.
pub const TEXT_HEAD: u16 = 0xFF00;
/// Not an event, but a part of a name.
pub const TEXT: u16 = 0xFF01;

#[inline]
fn put(of: u16, subject: u32, arguments: [u64; 2]) {
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

/// Reports an event of the calling thread, if the thread is recorded. Real-time path: yes;
/// wait-free, O(1).
#[inline(always)]
pub fn report(of: u16, subject: u32, arguments: impl FnOnce() -> [u64; 2]) {
    if is_on() {
        report_now(of, subject, arguments());
    }
}

#[cold]
#[inline(never)]
fn report_now(of: u16, subject: u32, arguments: [u64; 2]) {
    put(of, subject, arguments);
}

/// Reports that a process of the calling thread has become ready, and the current process as the
/// one that readied it.
#[inline(always)]
pub fn ready(process: impl FnOnce() -> u32) {
    if is_on() {
        report_ready(process());
    }
}

#[cold]
#[inline(never)]
fn report_ready(process: u32) {
    put(code::READY, process, [current_process(), 0]);
}

/// Reports that the turn of a process begins.
#[inline]
pub fn begin_turn(process: u32) {
    if is_on() {
        waits::clear();
        put(code::RUNNING, process, [0, 0]);
    }
}

/// Reports that the turn of a process ends and the process goes on; `is_ready`: it is ready again
/// already, else it waits.
#[inline]
pub fn end_turn(process: u32, is_ready: bool) {
    if is_on() {
        let arguments = match is_ready {
            true => [code::STILL_READY, 0],
            false => waits::arguments(),
        };
        put(code::WAITING, process, arguments);
    }
}

/// Runs the turn of a sub-process, and reports it: `of` are its process, and the sub-process around
/// it or 0. What the sub-process waits for is reported for it alone, and counts as what its process
/// waits for, too.
pub fn sub_turn<T>(number: u32, of: [u64; 2], poll: impl FnOnce() -> Poll<T>) -> Poll<T> {
    put(code::SUB_RUNNING, number, of);
    let (polled, waits) = waits::of_part(poll);
    if polled.is_pending() {
        put(code::SUB_WAITING, number, waits);
    }
    polled
}

/// Notes that the body of the current process has returned an error: for [`done`].
#[inline]
pub fn note_failure() {
    if is_on() {
        waits::fail();
    }
}

/// Reports that a process has ended; `how` is one of [`code::ended`]. A noted error takes
/// precedence.
#[inline]
pub fn done(process: u32, how: u64) {
    if is_on() {
        let has_failed = how == code::ended::OK && waits::has_failed();
        put(
            code::DONE,
            process,
            [if has_failed { code::ended::ERROR } else { how }, 0],
        );
    }
}

/// The number of the current process; 0 if there is none.
pub fn current_process() -> u64 {
    match current::user() {
        User::Process(id) => id.get().into(),
        User::Outside => 0,
    }
}

/// Reports that the executor of the calling thread sleeps, or is awake.
#[inline]
pub fn report_executor(of: u16) {
    if let Some((_, number)) = place() {
        put(of, number, [0, 0]);
    }
}

/// Names a part of the current process, on the real-time path: in the ring. Wait-free, O(bytes).
pub fn name_in_ring(kind: Kind, number: u32, name: &str) {
    if !is_on() {
        return;
    }
    let head = (kind as u64) << 32 | name.len() as u64;
    put(TEXT_HEAD, number, [head, current_process()]);
    for part in name.as_bytes().chunks(16) {
        let mut words = [0; 16];
        words[..part.len()].copy_from_slice(part);
        let (first, second) = words.split_at(8);
        let word = |bytes: &[u8]| u64::from_le_bytes(bytes.try_into().unwrap_or_default());
        put(TEXT, number, [word(first), word(second)]);
    }
}

/// Whether the calling thread is recorded for this listener: see [`Names::id`].
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
