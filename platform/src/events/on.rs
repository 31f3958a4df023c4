//! With events.

use super::ring::{Ring, Writer};
use super::{Kind, code};
use crate::current::{self, User};
use crate::lock::PiLock;
use std::cell::{Cell, RefCell};
use std::ptr;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Weak};

thread_local! {
    /// Where this thread's events go: null, or the ring of what it has in `ATTACHED`.
    static RING: Cell<*const Ring> = const { Cell::new(ptr::null()) };
    static ATTACHED: RefCell<Attached> = const { RefCell::new(Attached(None)) };
    /// What the present turn's process waits for.
    static WAITS: Cell<Waits> = const { Cell::new(Waits::NOTHING) };
}

struct Attached(Option<Writer>);

impl Drop for Attached {
    fn drop(&mut self) {
        RING.set(ptr::null());
    }
}

/// Kind and number in one word.
#[derive(Clone, Copy, PartialEq, Eq)]
struct Waits(u64);

impl Waits {
    const NOTHING: Waits = Waits(0);
    const SEVERAL: Waits = Waits(u64::MAX);
    /// For nothing: its body has failed.
    const FAILED: Waits = Waits(u64::MAX - 1);
}

/// Whether the calling thread is recorded. One load.
#[inline(always)]
pub fn is_on() -> bool {
    !RING.get().is_null()
}

/// From now on the calling thread's events go to this ring.
///
/// ```
/// use luna_platform::events::{self, Kind, code};
///
/// let (writer, mut reader) = events::ring(16, 0, None);
/// events::attach(writer);
/// events::tell(code::SLOT, 7, || [41, 250]);
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
        let before = std::mem::replace(&mut attached.borrow_mut().0, writer);
        RING.set(ring);
        before
    });
    // A thread that is ending is recorded no more.
    before.ok().flatten()
}

/// The ring of a home that shares its thread with others, while another has its turn.
#[derive(Debug, Default)]
pub struct Kept(Option<Writer>);

impl Kept {
    /// Makes this ring the thread's, and keeps the one that was: before a turn and after it.
    pub fn exchange(&mut self) {
        self.0 = exchange(self.0.take());
    }
}

/// Not an event, but the begin of a loop's name: its length in bytes, and its process. Behind it come parts of 16 bytes each: a name that is made on the real-time path.
pub const TEXT_HEAD: u16 = 0xFF00;
/// Not an event, but a part of a name.
pub const TEXT: u16 = 0xFF01;

#[inline]
fn put(of: u16, subject: u32, arguments: [u64; 2]) {
    let ring = RING.get();
    if !ring.is_null() {
        let head = u64::from(subject) << 32 | u64::from(of) << 16;
        // SAFETY: it is that of this thread's writer, which is live: before it goes, this is null.
        if !unsafe { (*ring).put(head, arguments) } {
            // Nobody reads any more. The writer stays: this may be the real-time path.
            RING.set(ptr::null());
        }
    }
}

/// Tells an event of the calling thread, if that is recorded. Real-time path: yes; wait-free, O(1).
#[inline(always)]
pub fn tell(of: u16, subject: u32, arguments: impl FnOnce() -> [u64; 2]) {
    if is_on() {
        told(of, subject, arguments());
    }
}

#[cold]
#[inline(never)]
fn told(of: u16, subject: u32, arguments: [u64; 2]) {
    put(of, subject, arguments);
}

/// Notes what the current process waits for, whose operation is about to return `Pending`: for the end of its turn.
#[inline(always)]
pub fn waits_for(what: impl FnOnce() -> (Kind, u32)) {
    if is_on() {
        let (kind, number) = what();
        note_wait(kind, number);
    }
}

#[cold]
#[inline(never)]
fn note_wait(kind: Kind, number: u32) {
    let new = Waits((kind as u64) << 32 | u64::from(number));
    let before = WAITS.get();
    WAITS.set(if before == Waits::NOTHING || before == new {
        new
    } else {
        Waits::SEVERAL
    });
}

/// Tells that a process of the calling thread has become ready, by who runs there.
#[inline(always)]
pub fn ready(process: impl FnOnce() -> u32) {
    if is_on() {
        told_ready(process());
    }
}

#[cold]
#[inline(never)]
fn told_ready(process: u32) {
    put(code::READY, process, [current_process(), 0]);
}

/// Tells that the turn of a process begins.
#[inline]
pub fn begin_turn(process: u32) {
    if is_on() {
        WAITS.set(Waits::NOTHING);
        put(code::RUNNING, process, [0, 0]);
    }
}

/// Tells that the turn of a process ends that has not ended itself; `is_ready` again already, or it waits.
#[inline]
pub fn end_turn(process: u32, is_ready: bool) {
    if is_on() {
        let arguments = match WAITS.get() {
            _ if is_ready => [code::STILL_READY, 0],
            Waits::NOTHING | Waits::SEVERAL | Waits::FAILED => [code::WAITS_UNKNOWN, 0],
            Waits(word) => [word >> 32, word & u64::from(u32::MAX)],
        };
        put(code::WAITING, process, arguments);
    }
}

/// Notes that the body of the current process has returned an error: for [`done`].
#[inline]
pub fn note_failure() {
    if is_on() {
        WAITS.set(Waits::FAILED);
    }
}

/// Tells that a process has ended; `how` is one of [`code::ended`], where an error that was noted counts.
#[inline]
pub fn done(process: u32, how: u64) {
    if is_on() {
        let has_failed = how == code::ended::OK && WAITS.get() == Waits::FAILED;
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

/// Tells of the executor that the calling thread is: that it sleeps, or is awake.
#[inline]
pub fn tell_executor(of: u16) {
    if let Some(number) = number() {
        put(of, number, [0, 0]);
    }
}

/// Names a loop of the current process, on the real-time path: in the ring. Wait-free, O(bytes).
pub fn name_loop(number: u32, name: &str) {
    if !is_on() {
        return;
    }
    put(TEXT_HEAD, number, [name.len() as u64, current_process()]);
    for part in name.as_bytes().chunks(16) {
        let mut words = [0; 16];
        words[..part.len()].copy_from_slice(part);
        let (first, second) = words.split_at(8);
        let word = |bytes: &[u8]| u64::from_le_bytes(bytes.try_into().unwrap_or_default());
        put(TEXT, number, [word(first), word(second)]);
    }
}

/// The number of the calling thread, or executor, in its recording.
fn number() -> Option<u32> {
    let ring = RING.get();
    // SAFETY: as in `put`.
    (!ring.is_null()).then(|| unsafe { (*ring).number() })
}

/// Something with a name.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Name {
    /// What it is.
    pub kind: Kind,
    /// Its number.
    pub number: u32,
    /// The number of what it belongs to; 0 if nothing.
    pub parent: u32,
    /// Its name.
    pub text: String,
    /// A process': the number of its executor, and its level there.
    pub runs_on: Option<(u32, u8)>,
}

/// What was named since it was last asked.
#[derive(Debug)]
pub struct Names(PiLock<Vec<Name>>);

static LISTENERS: PiLock<Vec<Weak<Names>>> = PiLock::new(Vec::new());
static LISTENING: AtomicUsize = AtomicUsize::new(0);

/// Who listens learns of each process, channel, barrier, lock and loop of the program that is named from now on, until it is dropped.
///
/// ```
/// use luna_platform::events::{self, Kind};
///
/// let names = events::listen();
/// events::name(Kind::Channel, 4_000_000_001, 0, || "setpoint".to_owned());
/// assert!(names.take().iter().any(|name| name.text == "setpoint"));
/// ```
pub fn listen() -> Arc<Names> {
    let names = Arc::new(Names(PiLock::new(Vec::new())));
    let mut listeners = LISTENERS.lock();
    listeners.retain(|one| one.strong_count() > 0);
    listeners.push(Arc::downgrade(&names));
    LISTENING.fetch_add(1, Ordering::Relaxed);
    names
}

impl Names {
    /// What was named since the last call.
    pub fn take(&self) -> Vec<Name> {
        std::mem::take(&mut *self.0.lock())
    }

    /// Names something to this listener alone.
    pub fn name(&self, kind: Kind, number: u32, text: String) {
        self.0.lock().push(Name {
            kind,
            number,
            parent: 0,
            text,
            runs_on: None,
        });
    }
}

impl Drop for Names {
    fn drop(&mut self) {
        LISTENING.fetch_sub(1, Ordering::Relaxed);
    }
}

/// Names something, to all who listen. Not for the real-time path: it locks and allocates, if anybody does.
#[inline]
pub fn name(kind: Kind, number: u32, parent: u32, text: impl FnOnce() -> String) {
    if LISTENING.load(Ordering::Relaxed) > 0 {
        named(kind, number, parent, text(), None);
    }
}

/// Names a process, on the thread that it runs on. As [`name`].
#[inline]
pub fn name_process(process: u32, level: u8, text: impl FnOnce() -> String) {
    if is_on() && LISTENING.load(Ordering::Relaxed) > 0 {
        let runs_on = number().map(|executor| (executor, level));
        named(Kind::Process, process, 0, text(), runs_on);
    }
}

/// Names the executor that the calling thread is, if it is recorded. As [`name`].
#[inline]
pub fn name_executor(text: impl FnOnce() -> String) {
    if let Some(number) = number() {
        named(Kind::Executor, number, 0, text(), None);
    }
}

#[cold]
fn named(kind: Kind, number: u32, parent: u32, text: String, runs_on: Option<(u32, u8)>) {
    let on_path = current::set_on_path(false);
    for names in LISTENERS.lock().iter().filter_map(Weak::upgrade) {
        names.0.lock().push(Name {
            kind,
            number,
            parent,
            text: text.clone(),
            runs_on,
        });
    }
    current::set_on_path(on_path);
}
