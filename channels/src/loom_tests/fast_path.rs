//! The fast path: a model thread is an executor's, and owns the bias of the channel's lock.

use super::{Drops, Token, check_within};
use crate::core::taken;
use crate::lock_sync::Mutex;
use crate::{Alternative, Barrier, Party, Receiver, Sender, channel, pri_alt};
use loom::future::block_on;
use loom::sync::Arc;
use loom::thread;
use luna_core::biased_lock;
use luna_core::current::{self, ExecutorId, Methods, Process, ProcessId, QueueEnd};
use luna_core::timer_queue::TimerQueue;
use std::borrow::Borrow;
use std::cell::{Cell, RefCell};
use std::future::Future;
use std::pin::Pin;
use std::ptr::NonNull;
use std::rc::Rc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::task::{Context, Waker};

/// Upper limit of the preemptions of a thread in a model.
const PREEMPTIONS: usize = 3;

/// A process of the model's executor, with its body.
#[repr(C, align(32))]
struct Task {
    /// First, so that a pointer to it leads back to this.
    process: Process,
    body: RefCell<Pin<Box<dyn Future<Output = ()>>>>,
    is_over: Cell<bool>,
    /// What wakes the executor's thread.
    bell: Arc<Bell>,
}

/// What wakes the executor's thread from another one: which of its two processes are to be woken.
struct Bell {
    rung: loom::sync::Mutex<[bool; 2]>,
    changed: loom::sync::Condvar,
}

impl Bell {
    fn ring(&self, number: usize) {
        self.rung.lock().unwrap()[number] = true;
        self.changed.notify_one();
    }

    fn wait(&self) -> [bool; 2] {
        let mut rung = self.rung.lock().unwrap();
        while *rung == [false; 2] {
            rung = self.changed.wait(rung).unwrap();
        }
        std::mem::take(&mut *rung)
    }
}

static METHODS: Methods = Methods::without_body(ready_elsewhere, free);

/// # Safety
///
/// `process` is that of a task that is not freed yet, as [`Methods`] require; the level is the
/// process' number.
unsafe fn ready_elsewhere(process: NonNull<Process>, level: u8) {
    // SAFETY: a task stays valid until `free` is called for it.
    unsafe { process.cast::<Task>().as_ref() }
        .bell
        .ring(usize::from(level));
}

/// # Safety
///
/// `process` is that of a task that has ended, without any reference to it, as [`Methods`] require.
unsafe fn free(process: NonNull<Process>) {
    // SAFETY: this is called once for each task, without any reference to it; `Executor::run` made
    // it of a box.
    drop(unsafe { Box::from_raw(process.cast::<Task>().as_ptr()) });
}

/// Makes the calling model thread an executor's until it is dropped.
struct Executor {
    executor: ExecutorId,
    _entered: current::Cpu,
}

impl Executor {
    fn enter() -> Self {
        biased_lock::bias_after(1);
        let executor = ExecutorId::new();
        Self {
            executor,
            _entered: current::enter_executor(executor, Arc::new(TimerQueue::new()), false),
        }
    }

    /// A channel with its lock biased to this thread.
    fn channel<T: Send>(&self) -> (Sender<T>, Receiver<T>) {
        let (sender, receiver) = channel();
        // The first use in shared mode earns the bias.
        assert!(receiver.try_recv().is_err());
        (sender, receiver)
    }

    /// Runs two processes to their ends.
    fn run(&self, bodies: [Pin<Box<dyn Future<Output = ()>>>; 2]) {
        let bell = Arc::new(Bell {
            rung: loom::sync::Mutex::new([false; 2]),
            changed: loom::sync::Condvar::new(),
        });
        let mut level = 0;
        let tasks = bodies.map(|body| {
            let task = NonNull::from(Box::leak(Box::new(Task {
                process: Process::new(ProcessId::new(), self.executor, 0, level),
                body: RefCell::new(body),
                is_over: Cell::new(false),
                bell: bell.clone(),
            })));
            // SAFETY: no other thread knows it yet. It stays where it is until `free`, and is ended
            // once, below. The waker is known by its address, and its wake is never used.
            unsafe {
                task.as_ref().process.set_waker(Waker::noop().clone());
                Process::set_methods(task.cast(), &METHODS);
                task.as_ref().process.ready_at(level, QueueEnd::Back);
            }
            level += 1;
            task
        });
        // SAFETY: they are freed after their end alone, which is below.
        let is_over = |task: &NonNull<Task>| unsafe { task.as_ref() }.is_over.get();
        while !tasks.iter().all(is_over) {
            // SAFETY: each process that is taken out is given its turn at once.
            while let Some(process) = unsafe { current::next_ready() } {
                // SAFETY: its task is live until its end.
                unsafe { Self::give_turn(process.cast().as_ref()) };
            }
            if tasks.iter().all(is_over) {
                break;
            }
            for (number, is_rung) in bell.wait().into_iter().enumerate() {
                if is_rung {
                    // SAFETY: this is the executor's thread, and the task is live.
                    unsafe {
                        tasks[number]
                            .as_ref()
                            .process
                            .ready_at(number as u8, QueueEnd::Back)
                    };
                }
            }
        }
        for task in tasks {
            // SAFETY: this is the executor's thread, and it is not polled again.
            unsafe { Process::end(task.cast()) };
        }
    }

    /// # Safety
    ///
    /// The task was just taken out of the run queue of this thread.
    unsafe fn give_turn(task: &Task) {
        // SAFETY: the task was taken out of the run queue of this thread, which is its executor's;
        // the process has not ended, since its end is after all turns, and lives until `end_turns`.
        unsafe {
            current::give_turn(&task.process, || {
                if task.is_over.get() {
                    return;
                }
                let waker = task.process.waker().expect("set by `run`");
                let polled = task
                    .body
                    .borrow_mut()
                    .as_mut()
                    .poll(&mut Context::from_waker(waker));
                if polled.is_ready() {
                    task.is_over.set(true);
                    let nothing: Pin<Box<dyn Future<Output = ()>>> = Box::pin(async {});
                    drop(task.body.replace(nothing));
                }
            });
            // SAFETY: this is the thread of the model's executor. The poll is over.
            unsafe {
                task.process.end_turn();
                current::end_turns();
            }
        }
    }
}

/// A token, or one that is moved as a word.
trait Value: From<Token> + Borrow<Token> + Send + 'static {}
impl Value for Token {}
impl Value for Word {}
type Word = Box<Token>;

/// Receives until the channel has ended, and notes which tokens came.
async fn take_all<V: Value>(receiver: Receiver<V>, taken: Rc<RefCell<Vec<usize>>>) {
    while let Ok(token) = receiver.recv().await {
        taken.borrow_mut().push(token.borrow().id);
    }
}

/// Sends the tokens 1 and 2, and notes which went.
async fn send_two<V: Value>(sender: Sender<V>, drops: Drops, sent: Rc<RefCell<Vec<usize>>>) {
    for id in [1, 2] {
        if sender.send(drops.token(id).into()).await.is_ok() {
            sent.borrow_mut().push(id);
        }
    }
}

/// A sender and a receiver on the biased thread, and `other` on another one, which returns what it
/// has received and sent. All that was sent is received once, in order, and each token is dropped
/// once.
fn against<V: Value>(
    tokens: usize,
    other: impl Fn(Sender<V>, Receiver<V>, Drops) -> [Option<usize>; 2] + Copy + Send + Sync + 'static,
) {
    // Either process runs first, so that each is the one that waits.
    for sends_first in [false, true] {
        let before = taken::count();
        check_within(PREEMPTIONS, move || {
            let drops = Drops::default();
            let executor = Executor::enter();
            let (sender, receiver) = executor.channel();
            let (taken, sent) = <(Rc<RefCell<Vec<_>>>, Rc<RefCell<Vec<_>>>)>::default();
            let (theirs, from, to) = (drops.clone(), sender.clone(), receiver.clone());
            let thread = thread::spawn(move || other(from, to, theirs));
            let sends: Pin<Box<dyn Future<Output = ()>>> =
                Box::pin(send_two(sender, drops.clone(), sent.clone()));
            let takes = Box::pin(take_all(receiver, taken.clone()));
            // The second one has the higher level.
            executor.run(match sends_first {
                true => [takes, sends],
                false => [sends, takes],
            });
            let [got, gave] = thread.join().unwrap();
            let (mut taken, mut sent) = (taken.take(), sent.take());
            assert!(taken.iter().filter(|id| **id < 3).is_sorted(), "{taken:?}");
            taken.extend(got);
            sent.extend(gave);
            taken.sort_unstable();
            assert_eq!(taken, sent);
            assert_eq!(drops.count(), tokens);
        });
        assert!(taken::count() > before, "no prologue was taken");
    }
}

#[test]
fn a_try_send_from_another_thread_ends_the_bias() {
    fn send(
        sender: Sender<impl Value>,
        receiver: Receiver<impl Value>,
        drops: Drops,
    ) -> [Option<usize>; 2] {
        drop(receiver);
        let sent = sender.try_send(drops.token(3).into());
        [None, sent.is_ok().then_some(3)]
    }
    against::<Token>(3, send);
    against::<Word>(3, send);
}

#[test]
fn a_receiver_comes_by_the_slow_path() {
    against(2, |sender: Sender<Word>, receiver, _| {
        drop(sender);
        [block_on(receiver.recv()).ok().map(|word| word.id), None]
    });
}

#[test]
fn an_alternative_comes_from_another_thread() {
    against(2, |sender: Sender<Token>, receiver, _| {
        drop(sender);
        let (_never, other) = channel::<Token>();
        let got = block_on(async {
            pri_alt! {
                token = other.recv() => token.ok(),
                token = receiver.recv() => token.ok(),
            }
        });
        [got.map(|token| token.id), None]
    });
}

#[test]
fn the_channel_is_poisoned_from_another_thread() {
    against(2, |sender: Sender<Word>, receiver, _| {
        drop(receiver);
        sender.poison();
        [None, None]
    });
}

/// Two parties on the biased thread, and `other` on another one, with a party of its own.
fn barrier_against(other: impl Fn(Party, &AtomicUsize) + Copy + Send + Sync + 'static) {
    check_within(PREEMPTIONS, move || {
        let executor = Executor::enter();
        let barrier = Barrier::new(2);
        // The first use in shared mode earns the bias.
        let party = barrier.enroll();
        // Not watched by loom: it only shows the order.
        let come = Arc::new(AtomicUsize::new(0));
        let theirs = come.clone();
        let thread = thread::spawn(move || other(party, &theirs));
        let bodies = [0, 1].map(|_| {
            let (barrier, come) = (barrier.clone(), come.clone());
            let body: Pin<Box<dyn Future<Output = ()>>> = Box::pin(async move {
                for round in 1..=2 {
                    come.fetch_add(1, Ordering::SeqCst);
                    barrier.sync().await;
                    assert!(come.load(Ordering::SeqCst) >= 2 * round);
                }
            });
            body
        });
        executor.run(bodies);
        thread.join().unwrap();
        assert_eq!(barrier.parties(), 2);
    });
}

#[test]
fn a_party_comes_from_another_thread_and_resigns() {
    barrier_against(|party, come| {
        block_on(party.sync());
        assert!(come.load(Ordering::SeqCst) >= 2);
    });
}

#[test]
fn a_party_resigns_on_another_thread() {
    barrier_against(|party, _| drop(party));
}

/// A process of the executor receives two values, by an alternative or an `Alternative` over two
/// channels. Another process sends one on the first channel, and another thread sends one on the
/// second: it revokes the bias of the commit lock.
fn alternative_against<V: Value, F: Future<Output = usize> + 'static>(
    receive_two: impl Fn([Receiver<V>; 2]) -> F + Copy + Send + Sync + 'static,
) {
    for sends_first in [false, true] {
        check_within(PREEMPTIONS, move || {
            let drops = Drops::default();
            let executor = Executor::enter();
            let (sender, receiver) = executor.channel::<V>();
            let (from_elsewhere, other) = executor.channel();
            // Neither channel ends before both values have come.
            let _open = (sender.clone(), from_elsewhere.clone());
            let theirs = drops.clone();
            let thread = thread::spawn(move || {
                let sent = block_on(from_elsewhere.send(theirs.token(2).into()));
                assert!(sent.is_ok());
            });
            let token = drops.token(1);
            let sends: Pin<Box<dyn Future<Output = ()>>> = Box::pin(async move {
                assert!(sender.send(token.into()).await.is_ok());
            });
            let takes = Box::pin(async move {
                assert_eq!(receive_two([receiver, other]).await, 3);
            });
            executor.run(match sends_first {
                true => [takes, sends],
                false => [sends, takes],
            });
            thread.join().unwrap();
            assert_eq!(drops.count(), 2);
        });
    }
}

/// Also a model of the owner that leaves the commit lock after it has committed the alternative.
#[test]
fn an_alternative_of_the_executor_is_met_from_another_thread() {
    async fn receive_two([receiver, other]: [Receiver<impl Value>; 2]) -> usize {
        let mut sum = 0;
        for _ in 0..2 {
            sum += pri_alt! {
                token = receiver.recv() => token.map_or(0, |token| token.borrow().id),
                token = other.recv() => token.map_or(0, |token| token.borrow().id),
            };
        }
        sum
    }
    alternative_against::<Token, _>(receive_two);
    alternative_against::<Word, _>(receive_two);
}

#[test]
fn a_registered_alternative_of_the_executor_is_met_from_another_thread() {
    alternative_against(|receivers: [Receiver<Word>; 2]| async move {
        let mut both = Alternative::prioritized(&receivers);
        let mut sum = 0;
        for _ in 0..2 {
            sum += both.recv().await.1.map_or(0, |token| token.id);
        }
        sum
    });
}

#[test]
fn a_mutex_of_the_executor_is_locked_on_another_thread() {
    check_within(PREEMPTIONS, || {
        let executor = Executor::enter();
        let mutex = Mutex::new(0);
        // The first use in shared mode earns the bias.
        drop(mutex.try_lock());
        let theirs = mutex.clone();
        let thread = thread::spawn(move || {
            *block_on(theirs.lock()).expect("no holder dies") += 1;
        });
        executor.run([0, 1].map(|_| {
            let mutex = mutex.clone();
            let body: Pin<Box<dyn Future<Output = ()>>> = Box::pin(async move {
                *mutex.lock().await.expect("no holder dies") += 1;
            });
            body
        }));
        thread.join().unwrap();
        assert_eq!(*block_on(mutex.lock()).expect("no holder dies"), 3);
    });
}

/// Processes leave a receive and a party waiting as they end. Other processes meet them, which
/// wakes no process, and frees those that have ended: loom reports a bell that is kept. It has one
/// thread, and shuttle refuses such a model.
#[cfg(not(shuttle))]
#[test]
fn what_ended_processes_have_left_is_met_and_frees_them() {
    check_within(PREEMPTIONS, || {
        let drops = Drops::default();
        let executor = Executor::enter();
        let (sender, receiver) = executor.channel::<Token>();
        let barrier = Barrier::new(2);
        assert_eq!(barrier.parties(), 2);
        let taken = Rc::new(Cell::new(0));
        let last = barrier.clone();
        let receives: Pin<Box<dyn Future<Output = ()>>> = {
            let taken = taken.clone();
            Box::pin(async move { taken.set(receiver.recv().await.map_or(0, |token| token.id)) })
        };
        let comes = Box::pin(async move { barrier.sync().await });
        let left = Rc::new(RefCell::new(Vec::new()));
        executor.run([receives, comes].map(|mut waits| {
            let left = left.clone();
            let body: Pin<Box<dyn Future<Output = ()>>> = Box::pin(async move {
                std::future::poll_fn(|cx| {
                    assert!(waits.as_mut().poll(cx).is_pending());
                    std::task::Poll::Ready(())
                })
                .await;
                left.borrow_mut().push(waits);
            });
            body
        }));
        let token = drops.token(1);
        // The sender, the lower one, comes when no process is ready.
        executor.run([
            Box::pin(async move { assert!(sender.send(token).await.is_ok()) }),
            Box::pin(async move { last.sync().await }),
        ]);
        for waits in left.take() {
            block_on(waits);
        }
        assert_eq!((taken.get(), drops.count()), (1, 1));
    });
}
