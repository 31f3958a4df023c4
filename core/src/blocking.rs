//! Blocking calls from processes that share an executor: a buddy thread makes the call, the process
//! awaits it.
//!
//! One pool for the program. A buddy that takes the last call that no other buddy is free for
//! starts another buddy first. So calls that wait for each other do not get stuck, and no process
//! ever starts a thread, save for the very first.

use crate::call_count::UnderWay;
use crate::current;
use crate::current::{PendingWake, Renewal, WakeHandle};
use luna_platform::clock::Instant;
use luna_platform::futex::Futex;
use luna_platform::lock::PiLock;
use luna_platform::thread::{self, Attributes};
use std::any::Any;
use std::collections::LinkedList;
use std::convert::Infallible;
use std::future::Future;
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::pin::Pin;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::task::{Context, Poll};

/// The most buddy threads there are. Further calls wait for one of them.
pub const MAX_BUDDIES: usize = 64;

type Job = Box<dyn FnOnce() + Send>;

struct Pool {
    state: PiLock<State>,
    /// Counts submissions: what idle buddies wait for.
    submitted: Futex,
}

struct State {
    jobs: LinkedList<Job>,
    buddies: usize,
    idle: usize,
}

static POOL: Pool = Pool {
    state: PiLock::new(State {
        jobs: LinkedList::new(),
        buddies: 0,
        idle: 0,
    }),
    submitted: Futex::new(0),
};

/// The system could not start a buddy thread.
#[derive(Debug, thiserror::Error)]
#[error("no thread for blocking calls could be started: {0}")]
pub struct NoBuddy(Box<dyn std::error::Error + Send + Sync>);

/// Starts the first buddy thread if there is none, so that the first blocking call of a process
/// need not.
///
/// # Errors
///
/// [`NoBuddy`] if the system refuses the thread.
pub fn prepare_blocking() -> Result<(), NoBuddy> {
    {
        let mut state = POOL.state.lock();
        if state.buddies > 0 {
            return Ok(());
        }
        state.buddies += 1;
    }
    start_buddy()
}

/// Starts a buddy that is counted already.
fn start_buddy() -> Result<(), NoBuddy> {
    // Without a real-time policy and on any core: a blocking call must not disturb those that it
    // was taken from.
    let started = thread::spawn(
        Attributes::new("luna-buddy"),
        |_| Ok::<(), Infallible>(()),
        |()| work(),
    );
    match started {
        // It lives as long as the program and is never joined.
        Ok(_) => Ok(()),
        Err(error) => {
            let mut state = POOL.state.lock();
            state.buddies -= 1;
            // Jobs that came meanwhile relied on this one. Each ends its call as it is dropped.
            let left = match state.buddies {
                0 => std::mem::take(&mut state.jobs),
                _ => LinkedList::new(),
            };
            drop(state);
            drop(left);
            Err(NoBuddy(Box::new(error)))
        }
    }
}

/// The life of a buddy thread.
fn work() {
    loop {
        let submitted = POOL.submitted.word().load(Ordering::Acquire);
        let mut state = POOL.state.lock();
        if let Some(job) = state.jobs.pop_front() {
            let alone = state.idle == 0 && state.buddies < MAX_BUDDIES;
            if alone {
                state.buddies += 1;
            }
            drop(state);
            if alone {
                // If no other buddy can be had, calls wait for this one.
                let _ = start_buddy();
            }
            // The call's own panic goes to the process that awaits it. A panic in the drop of a
            // result that is not awaited any more must not end the buddy; nor must one that the
            // panic's own value makes as it is dropped, which is then left alone.
            if let Err(panic) = catch_unwind(AssertUnwindSafe(job))
                && let Err(another) = catch_unwind(AssertUnwindSafe(|| drop(panic)))
            {
                std::mem::forget(another);
            }
        } else {
            state.idle += 1;
            drop(state);
            POOL.submitted.wait(submitted, Instant::NEVER);
            POOL.state.lock().idle -= 1;
        }
    }
}

fn submit(job: Job) {
    // The list's node is allocated before the lock is taken.
    let mut node = LinkedList::from([job]);
    while !node.is_empty() {
        if let Err(error) = prepare_blocking() {
            panic!("{error}");
        }
        let mut state = POOL.state.lock();
        // Else the first buddy, which another call was starting, was refused.
        if state.buddies > 0 {
            state.jobs.append(&mut node);
        }
    }
    POOL.submitted.word().fetch_add(1, Ordering::Release);
    POOL.submitted.wake_one();
}

struct Call<T> {
    state: PiLock<CallState<T>>,
}

enum CallState<T> {
    Running(Option<WakeHandle>),
    Done(Result<T, Box<dyn Any + Send>>),
    Taken,
}

/// Makes a blocking call on a buddy thread and awaits its result.
///
/// The call starts at the first poll. Cancel-safe in that dropping the future forgets the result; a
/// call that has started runs to its end. The executor goes on meanwhile, and other processes run.
/// On a virtual clock time stands until the call is done, and results come in the order in which
/// the calls were begun. Real-time path: no, since it allocates the call; the waiting itself blocks
/// no process. The buddy has no real-time policy.
///
/// # Panics
///
/// With the call's own panic, if it panics. If there is no buddy thread and none can be started;
/// [`prepare_blocking`], which a system's start calls, finds that out before.
///
/// ```
/// let length = luna_core::block_on(async {
///     luna_core::blocking(|| "a slow system call".len()).await
/// });
/// assert_eq!(length, Ok(18));
/// ```
#[doc(alias = "spawn_blocking")]
pub fn blocking<F, T>(call: F) -> Blocking<F, T>
where
    F: FnOnce() -> T + Send + 'static,
    T: Send + 'static,
{
    Blocking {
        call: Some(call),
        running: None,
    }
}

/// Made by [`blocking`].
#[must_use = "the call is made only when this is awaited"]
pub struct Blocking<F, T> {
    call: Option<F>,
    running: Option<Arc<Call<T>>>,
}

// Nothing in it is pinned: the call moves to the heap when it starts.
impl<F, T> Unpin for Blocking<F, T> {}

impl<F, T> Future for Blocking<F, T>
where
    F: FnOnce() -> T + Send + 'static,
    T: Send + 'static,
{
    type Output = T;

    fn poll(mut self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<T> {
        // Cloned before the call is taken: a panic leaves it as it was.
        let wake_handle = self.call.is_some().then(|| WakeHandle::of(cx));
        if let Some(call) = self.call.take() {
            current::replay_log(|log| log.outside("`blocking`"));
            let running = Arc::new(Call {
                state: PiLock::new(CallState::Running(wake_handle)),
            });
            self.running = Some(running.clone());
            submit(job(call, running));
            return Poll::Pending;
        }
        let Some(running) = &self.running else {
            panic!("a blocking call was polled after it was done");
        };
        let is_running = Renewal::of(cx).put(|renewal| match &mut *running.state.lock() {
            CallState::Running(wake_handle) => {
                renewal.store(wake_handle);
                true
            }
            _ => false,
        });
        if is_running {
            return Poll::Pending;
        }
        // Taken when no waker is left to be dropped.
        let done = std::mem::replace(&mut *running.state.lock(), CallState::Taken);
        self.running = None;
        match done {
            CallState::Done(Ok(value)) => Poll::Ready(value),
            CallState::Done(Err(payload)) => resume_unwind(payload),
            CallState::Running(_) | CallState::Taken => {
                unreachable!("only the future takes the result")
            }
        }
    }
}

/// A call, for a buddy.
fn job<F, T>(call: F, running: Arc<Call<T>>) -> Job
where
    F: FnOnce() -> T + Send + 'static,
    T: Send + 'static,
{
    let (under_way, running) = (UnderWay::begin(), Unanswered(running));
    Box::new(move || {
        // What is mentioned first is dropped first: the call is under way until its process is
        // woken, also if the job is dropped, or the result panics as it is.
        let (running, call, mut under_way) = (running, call, under_way);
        let result = {
            let _clock = under_way.clock().enter();
            catch_unwind(AssertUnwindSafe(call))
        };
        under_way.deliver(move || running.finish(result));
    })
}

/// The call of a job that no buddy has made. Dropped so, it ends with a panic: there is none.
struct Unanswered<T>(Arc<Call<T>>);

impl<T> Unanswered<T> {
    /// Gives the call its result, unless it has one.
    fn finish(&self, result: Result<T, Box<dyn Any + Send>>) {
        let ready = {
            let mut state = self.0.state.lock();
            let CallState::Running(wake_handle) = &mut *state else {
                return;
            };
            let ready = wake_handle
                .take()
                .map_or(PendingWake::NONE, WakeHandle::take);
            *state = CallState::Done(result);
            ready
        };
        ready.wake();
    }
}

impl<T> Drop for Unanswered<T> {
    fn drop(&mut self) {
        self.finish(Err(Box::new(
            "no thread for blocking calls could be started",
        )));
    }
}

impl<F, T> Drop for Blocking<F, T> {
    fn drop(&mut self) {
        if let Some(running) = &self.running {
            let former = match &mut *running.state.lock() {
                CallState::Running(wake_handle) => wake_handle.take(),
                _ => None,
            };
            // After the lock: dropping a waker is the user's code.
            drop(former);
        }
    }
}

luna_platform::debug_fields!(
    impl[F, T] Blocking<F, T>, |blocking|
    started: blocking.running.is_some()
);

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_job_that_is_never_made_ends_its_call() {
        let call = Arc::new(Call {
            state: PiLock::new(CallState::Running(None)),
        });
        drop(job(|| 7, call.clone()));
        let state = std::mem::replace(&mut *call.state.lock(), CallState::Taken);
        let CallState::Done(Err(payload)) = state else {
            panic!("it waits for ever");
        };
        let message = payload.downcast_ref::<&str>().unwrap();
        assert!(message.contains("no thread"), "{message}");
    }
}
