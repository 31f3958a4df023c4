//! A process as others see it: its name, state and end.

use luna_platform::clock::Instant;
use luna_platform::current::{self, ProcessId, Wakeup};
use luna_platform::futex::Futex;
use luna_platform::lock::PiLock;
use luna_platform::wait_list::{WaitList, WaitNode};
use std::any::Any;
use std::cell::UnsafeCell;
use std::fmt;
use std::future::Future;
use std::marker::PhantomPinned;
use std::pin::Pin;
use std::ptr::NonNull;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU8, AtomicU64, AtomicUsize, Ordering};
use std::task::{Context, Poll, Waker};
use std::time::Duration;

/// What a process is to be: its name, its level, and whether its polls are timed.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ProcessSpec {
    id: ProcessId,
    name: String,
    level: u8,
    timed: bool,
}

impl ProcessSpec {
    /// The level of a process for which none was stated: the middle.
    pub const DEFAULT_LEVEL: u8 = 16;

    /// A process called `name`, at [`DEFAULT_LEVEL`](Self::DEFAULT_LEVEL).
    pub fn new(name: impl Into<String>) -> Self {
        Self {
            id: ProcessId::new(),
            name: name.into(),
            level: Self::DEFAULT_LEVEL,
            timed: false,
        }
    }

    /// The number that the process will have.
    pub fn id(&self) -> ProcessId {
        self.id
    }

    /// At `level`, 0 (lowest) to 31; a greater one counts as 31.
    #[must_use]
    pub fn level(mut self, level: u8) -> Self {
        self.level = level.min(current::LEVELS - 1);
        self
    }

    /// Measures how long each poll takes, at two clock reads a poll (about 50 ns).
    #[must_use]
    pub fn timed(mut self, timed: bool) -> Self {
        self.timed = timed;
        self
    }
}

/// What a process is doing.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum ProcessState {
    /// Made, and not started yet.
    Created,
    /// Able to run, and waiting for its executor.
    Ready,
    /// Running.
    Running,
    /// Waiting for a communication, a deadline, or another event.
    Waiting,
    /// Ended, in whatever way.
    Ended,
}

impl ProcessState {
    fn from_number(number: u8) -> Self {
        match number {
            0 => ProcessState::Created,
            1 => ProcessState::Ready,
            2 => ProcessState::Running,
            _ => ProcessState::Waiting,
        }
    }
}

/// How a process ended.
#[derive(Debug, Clone, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum Exit {
    /// Its body returned.
    Completed,
    /// It was cancelled: its body was dropped where it waited.
    Cancelled,
    /// Its body panicked, with this message.
    Panicked(String),
}

impl fmt::Display for Exit {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Exit::Completed => f.write_str("completed"),
            Exit::Cancelled => f.write_str("cancelled"),
            Exit::Panicked(message) => write!(f, "panicked: {message}"),
        }
    }
}

/// How it ended, before anybody asked: the message of a panic is made off the real-time path.
enum RawExit {
    Completed,
    Cancelled,
    Panicked(Box<dyn Any + Send>),
}

/// Counts the processes that have not ended, so that one thread can wait for the last.
#[derive(Debug)]
pub struct Living {
    count: AtomicUsize,
    ended: Futex,
}

impl Living {
    /// Nobody lives yet.
    #[expect(
        clippy::new_without_default,
        reason = "shared on purpose, not by default"
    )]
    pub fn new() -> Self {
        Self {
            count: AtomicUsize::new(0),
            ended: Futex::new(0),
        }
    }

    /// How many have not ended.
    pub fn count(&self) -> usize {
        self.count.load(Ordering::Acquire)
    }

    /// A number that changes whenever a process ends or [`announce`](Self::announce) is called.
    pub fn changes(&self) -> u32 {
        self.ended.word().load(Ordering::Acquire)
    }

    /// Sleeps until the number is no longer `seen`, or until `deadline`. May return without a cause.
    pub fn wait(&self, seen: u32, deadline: Instant) {
        self.ended.wait(seen, deadline);
    }

    /// Wakes who waits. One system call.
    pub fn announce(&self) {
        self.ended.word().fetch_add(1, Ordering::Release);
        self.ended.wake_all();
    }

    fn enter(&self) {
        self.count.fetch_add(1, Ordering::AcqRel);
    }

    fn leave(&self) {
        self.count.fetch_sub(1, Ordering::AcqRel);
        self.announce();
    }
}

/// What outlives the body of a process.
pub(crate) struct Record {
    name: String,
    id: ProcessId,
    level: u8,
    timed: bool,
    /// What it is doing, as last said: a late wake may say that it is ready when it has ended, so `ended` has the last word.
    state: AtomicU8,
    ended: AtomicBool,
    cancelled: AtomicBool,
    /// Written by the process' thread alone.
    polls: AtomicU64,
    longest_poll: AtomicU64,
    waker: PiLock<Option<Waker>>,
    end: PiLock<End>,
    living: Arc<Living>,
}

struct End {
    exit: Option<RawExit>,
    joining: WaitList,
}

impl Record {
    pub(crate) fn new(spec: ProcessSpec, living: Arc<Living>) -> Arc<Self> {
        living.enter();
        Arc::new(Self {
            name: spec.name,
            id: spec.id,
            level: spec.level,
            timed: spec.timed,
            state: AtomicU8::new(ProcessState::Created as u8),
            ended: AtomicBool::new(false),
            cancelled: AtomicBool::new(false),
            polls: AtomicU64::new(0),
            longest_poll: AtomicU64::new(0),
            waker: PiLock::new(None),
            end: PiLock::new(End {
                exit: None,
                joining: WaitList::new(),
            }),
            living,
        })
    }

    pub(crate) fn id(&self) -> ProcessId {
        self.id
    }

    pub(crate) fn level(&self) -> u8 {
        self.level
    }

    #[inline]
    pub(crate) fn set_state(&self, state: ProcessState) {
        self.state.store(state as u8, Ordering::Relaxed);
    }

    /// Whether the body has ended.
    #[inline]
    pub(crate) fn has_ended(&self) -> bool {
        self.ended.load(Ordering::Acquire)
    }

    pub(crate) fn state(&self) -> ProcessState {
        if self.has_ended() {
            return ProcessState::Ended;
        }
        ProcessState::from_number(self.state.load(Ordering::Relaxed))
    }

    pub(crate) fn set_waker(&self, waker: Waker) {
        *self.waker.lock() = Some(waker);
    }

    pub(crate) fn drop_waker(&self) {
        let waker = self.waker.lock().take();
        drop(waker);
    }

    pub(crate) fn cancel(&self) {
        self.cancelled.store(true, Ordering::Release);
        let waker = self.waker.lock().clone();
        if let Some(waker) = waker {
            waker.wake();
        }
    }

    /// Ends a process whose body never ran.
    pub(crate) fn end_unstarted(&self) {
        self.finish(RawExit::Cancelled);
    }

    /// Ends a process whose body could not be made.
    pub(crate) fn end_panicked(&self, payload: Box<dyn Any + Send>) {
        self.finish(RawExit::Panicked(payload));
    }

    fn finish(&self, exit: RawExit) {
        let mut end = self.end.lock();
        if end.exit.is_some() {
            return;
        }
        end.exit = Some(exit);
        self.ended.store(true, Ordering::Release);
        // One by one, so that the lock is never held for more than a few steps.
        while let Some(node) = end.joining.pop() {
            // SAFETY: a node in the list is live and guarded by the lock that is held; its join is pending until `gone` is set.
            let ready = unsafe {
                let node = &mut *node.cast::<JoinNode>().as_ptr();
                let ready = node.wait.wakeup_mut().take().map(|wakeup| wakeup.take());
                node.listed = false;
                ready
            };
            drop(end);
            if let Some(ready) = ready {
                ready.wake();
            }
            end = self.end.lock();
        }
        drop(end);
        self.living.leave();
    }
}

impl fmt::Debug for Record {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Process")
            .field("name", &self.name)
            .field("id", &self.id.get())
            .field("level", &self.level)
            .field("state", &self.state())
            .finish_non_exhaustive()
    }
}

/// A process, seen from outside. Cloning it is cheap; dropping it does nothing to the process.
///
/// ```
/// # fn main() -> Result<(), Box<dyn std::error::Error>> {
/// use luna_executors::{Executor, Exit, ProcessSpec, ProcessState};
/// use luna_platform::thread::Attributes;
///
/// let executor = Executor::start(Attributes::new("work"))?;
/// let process = executor.spawn(ProcessSpec::new("greeter").level(20), || async { println!("hello") });
/// executor.release();
/// assert_eq!(process.wait(), Exit::Completed);
/// assert_eq!((process.name(), process.priority(), process.polls()), ("greeter", 20, 1));
/// assert_eq!(process.state(), ProcessState::Ended);
/// executor.stop();
/// # Ok(()) }
/// ```
#[derive(Clone)]
pub struct ProcessHandle(pub(crate) Arc<Record>);

impl ProcessHandle {
    /// The process' name.
    pub fn name(&self) -> &str {
        &self.0.name
    }

    /// The process' number.
    pub fn id(&self) -> ProcessId {
        self.0.id
    }

    /// The level on its executor, 0 (lowest) to 31.
    pub fn priority(&self) -> u8 {
        self.0.level
    }

    /// What the process was doing at some instant during this call.
    pub fn state(&self) -> ProcessState {
        self.0.state()
    }

    /// How often it has been polled: how often it was given the processor.
    pub fn polls(&self) -> u64 {
        self.0.polls.load(Ordering::Relaxed)
    }

    /// The longest time between two awaits, if its polls are timed ([`ProcessSpec::timed`]) and it has run.
    pub fn longest_poll(&self) -> Option<Duration> {
        (self.0.timed && self.polls() > 0)
            .then(|| Duration::from_nanos(self.0.longest_poll.load(Ordering::Relaxed)))
    }

    /// Asks the process to end: its body is dropped on its own thread, where it waits, as soon as that thread comes to it.
    ///
    /// What it waited for is withdrawn. A body that computes or blocks without awaiting ends at its next await. Does nothing to one that
    /// has ended. Real-time path: yes; O(1), a system call only if its thread sleeps.
    pub fn cancel(&self) {
        self.0.cancel();
    }

    /// Waits until the process has ended, and says how. Cancel-safe. Real-time path: yes, but for the message of a panic,
    /// which is allocated here.
    pub fn join(&self) -> Join<'_> {
        Join {
            record: &self.0,
            node: UnsafeCell::new(JoinNode {
                wait: WaitNode::new(),
                listed: false,
            }),
            _pinned: PhantomPinned,
        }
    }

    /// Blocks this thread until the process has ended, and says how. Not for processes of an executor: they [`join`](Self::join).
    pub fn wait(&self) -> Exit {
        luna_platform::park::block_on(self.join())
    }

    /// How it ended, if it has.
    pub fn exit(&self) -> Option<Exit> {
        exit_of(&self.0.end.lock())
    }
}

impl fmt::Debug for ProcessHandle {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.fmt(f)
    }
}

fn exit_of(end: &End) -> Option<Exit> {
    Some(match end.exit.as_ref()? {
        RawExit::Completed => Exit::Completed,
        RawExit::Cancelled => Exit::Cancelled,
        RawExit::Panicked(payload) => Exit::Panicked(panic_message(&**payload)),
    })
}

/// What a panic said.
pub fn panic_message(payload: &(dyn Any + Send)) -> String {
    if let Some(text) = payload.downcast_ref::<&str>() {
        (*text).to_owned()
    } else if let Some(text) = payload.downcast_ref::<String>() {
        text.clone()
    } else {
        "(a panic whose message is no text)".to_owned()
    }
}

#[derive(Debug)]
#[repr(C)]
struct JoinNode {
    wait: WaitNode,
    listed: bool,
}

/// Waits for the end of a process: see [`ProcessHandle::join`].
///
/// # Invariants
///
/// `node` is accessed under the lock of the record's end alone, once it is listed; while `listed` it is in that end's list.
#[must_use = "a join does nothing unless awaited"]
pub struct Join<'a> {
    record: &'a Record,
    node: UnsafeCell<JoinNode>,
    _pinned: PhantomPinned,
}

// SAFETY: the node is guarded by the record's lock, wherever the future is.
unsafe impl Send for Join<'_> {}
// SAFETY: `&Join` gives access to nothing.
unsafe impl Sync for Join<'_> {}

impl Future for Join<'_> {
    type Output = Exit;

    fn poll(self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<Exit> {
        let mut end = self.record.end.lock();
        if let Some(exit) = exit_of(&end) {
            return Poll::Ready(exit);
        }
        let node = NonNull::new(self.node.get()).expect("a cell's address is never null");
        // SAFETY: the lock is held; the node is pinned with the future and leaves the list before it dies.
        let former = unsafe {
            if (*node.as_ptr()).listed {
                (*node.as_ptr()).wait.wakeup_mut().replace(Wakeup::of(cx))
            } else {
                end.joining
                    .insert(node.cast(), current::priority(), Wakeup::of(cx));
                (*node.as_ptr()).listed = true;
                None
            }
        };
        drop(end);
        // Dropping a waker is the user's code, which may drop a join.
        drop(former);
        Poll::Pending
    }
}

impl Drop for Join<'_> {
    fn drop(&mut self) {
        let mut end = self.record.end.lock();
        let node = NonNull::new(self.node.get()).expect("a cell's address is never null");
        // SAFETY: the lock is held, and `listed` says whether the node is in the list.
        unsafe {
            if (*node.as_ptr()).listed {
                end.joining.remove(node.cast());
            }
        }
    }
}

impl fmt::Debug for Join<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Join")
            .field("process", &self.record.name)
            .finish()
    }
}

/// A process' body, with all that the framework does around each of its polls.
pub(crate) struct Body<F> {
    /// `None` once it has ended.
    future: Option<F>,
    record: Arc<Record>,
}

impl<F: Future<Output = ()>> Body<F> {
    pub(crate) fn new(future: F, record: Arc<Record>) -> Self {
        Self {
            future: Some(future),
            record,
        }
    }
}

impl<F: Future<Output = ()>> Future for Body<F> {
    type Output = ();

    #[inline]
    fn poll(self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<()> {
        // SAFETY: `future` is never moved: it is polled pinned, and dropped in place.
        let this = unsafe { self.get_unchecked_mut() };
        let record = &*this.record;
        if !record.cancelled.load(Ordering::Acquire) {
            let Some(future) = this.future.as_mut() else {
                return Poll::Ready(());
            };
            record.set_state(ProcessState::Running);
            record
                .polls
                .store(record.polls.load(Ordering::Relaxed) + 1, Ordering::Relaxed);
            let started = record.timed.then(Instant::now);
            // SAFETY: see above.
            let future = unsafe { Pin::new_unchecked(future) };
            // A body that panicked is dropped and never polled again, so nobody sees what it left half done.
            let polled = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| future.poll(cx)));
            if let Some(started) = started {
                let took = Instant::now().nanos_since(started);
                if took > record.longest_poll.load(Ordering::Relaxed) {
                    record.longest_poll.store(took, Ordering::Relaxed);
                }
            }
            match polled {
                // A wake during the poll schedules after this store, so it has the last word.
                Ok(Poll::Pending) if !record.cancelled.load(Ordering::Acquire) => {
                    record.set_state(ProcessState::Waiting);
                    return Poll::Pending;
                }
                Ok(Poll::Pending) => {}
                Ok(Poll::Ready(())) => return this.end(RawExit::Completed),
                Err(payload) => return this.end(RawExit::Panicked(payload)),
            }
        }
        this.end(RawExit::Cancelled)
    }
}

impl<F> Body<F> {
    fn end(&mut self, exit: RawExit) -> Poll<()> {
        // Dropping the body ends its channels before anybody learns that the process has ended.
        let dropped = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| self.future = None));
        let exit = match (exit, dropped) {
            (RawExit::Panicked(payload), _) | (_, Err(payload)) => RawExit::Panicked(payload),
            (exit, Ok(())) => exit,
        };
        self.record.finish(exit);
        Poll::Ready(())
    }
}
