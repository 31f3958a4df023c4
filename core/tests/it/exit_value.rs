//! The exit value of a body: kept until it is taken, from any thread that it ran on.

use crate::support::quiet_panics;
use luna_core::current::fail_current;
use luna_core::{
    Executor, ExecutorHandle, Exit, ExitValue, OsThread, PollMonitor, ProcessHandle,
    ProcessRegistry, ProcessSpec, Verdict, yield_now,
};
use luna_platform::clock::Instant;
use luna_platform::thread::Attributes;
use std::sync::Arc;

/// Counted, so that the tests see what is kept; larger than the body that returns it.
struct Word(
    Option<Arc<()>>,
    #[expect(dead_code, reason = "its size")] [u64; 40],
);

impl ExitValue for Word {
    fn failed() -> Self {
        unreachable!("no process fails here")
    }

    fn is_nothing(&self) -> bool {
        self.0.is_none()
    }
}

fn word(token: &Arc<()>) -> Word {
    Word(Some(token.clone()), [7; 40])
}

fn exit_value_of(process: &ProcessHandle) -> Option<Word> {
    process.take_exit_value::<Word>()
}

#[test]
fn one_that_ends_on_an_executor_is_heard_afterwards() {
    let token = Arc::new(());
    let executor = Executor::start(Attributes::new("main")).unwrap();
    let start = |name: &'static str, word: Option<Word>| {
        let body = move || async { word.unwrap_or(Word(None, [0; 40])) };
        let (announced, process) = executor.handle().announce(ProcessSpec::new(name), body);
        assert!(announced.start().is_none());
        process
    };
    let speaker = start("speaker", Some(word(&token)));
    let silent = start("silent", None);
    let unheard = start("unheard", Some(word(&token)));
    executor.release();
    assert_eq!(unheard.wait(), Exit::Completed);
    assert_eq!(speaker.wait(), Exit::Completed);
    assert_eq!(silent.wait(), Exit::Completed);
    assert!(exit_value_of(&silent).is_none());
    // Also when the executor has gone.
    drop(executor);
    assert_eq!(Arc::strong_count(&token), 3, "it is kept");
    drop(unheard);
    assert_eq!(Arc::strong_count(&token), 2, "it goes with its process");
    assert!(speaker.take_exit_value::<()>().is_none(), "of another type");
    let words = exit_value_of(&speaker).expect("it was kept");
    assert!(exit_value_of(&speaker).is_none(), "it is taken once");
    assert_eq!(speaker.exit(), Some(Exit::Completed));
    drop(words);
    assert_eq!(Arc::strong_count(&token), 1);
}

#[test]
fn a_large_body_goes_with_the_handles_that_are_not_kept_for_long() {
    let token = Arc::new(());
    let executor = Executor::start(Attributes::new("main")).unwrap();
    let start = |size: bool, word: Word| {
        let body = move || async move {
            if size {
                let large = std::hint::black_box([1_u8; 4096]);
                luna_core::yield_now().await;
                assert_eq!(large[4095], 1);
            }
            word
        };
        executor
            .handle()
            .announce(ProcessSpec::new("large").level(3), body)
    };
    let (announced, mut process) = start(true, word(&token));
    assert!(announced.start().is_none());
    process.forget_body();
    executor.release();
    assert_eq!(process.wait(), Exit::Completed);
    let other = process.clone();
    drop(executor);
    assert_eq!(Arc::strong_count(&token), 2);
    process.forget_body();
    assert_eq!(Arc::strong_count(&token), 2, "the other handle keeps it");
    let known = |one: &ProcessHandle| {
        let state = (one.exit(), one.state(), one.polls(), one.priority());
        (one.name().to_owned(), one.id(), state)
    };
    assert_eq!(known(&process), known(&other));
    assert_eq!((process.polls(), process.wait()), (2, Exit::Completed));
    drop(other);
    assert_eq!(
        Arc::strong_count(&token),
        1,
        "it went with the room of its body"
    );
}

#[test]
fn one_that_is_cancelled_or_panics_says_nothing() {
    let executor = Executor::start(Attributes::new("main")).unwrap();
    let start = |name: &'static str, panics: bool| {
        let body = move || async move {
            assert!(!panics, "on purpose");
            std::future::pending::<Word>().await
        };
        let (announced, process) = executor.handle().announce(ProcessSpec::new(name), body);
        assert!(announced.start().is_none());
        process
    };
    let (stuck, hasty) = (start("stuck", false), start("hasty", true));
    executor.release();
    stuck.cancel();
    assert_eq!(stuck.wait(), Exit::Cancelled);
    assert_eq!(hasty.wait(), Exit::Panicked("on purpose".to_owned()));
    assert!(exit_value_of(&stuck).is_none() && exit_value_of(&hasty).is_none());
    assert_eq!(hasty.exit(), Some(Exit::Panicked("on purpose".to_owned())));
}

#[test]
fn the_exit_value_of_a_thread_process_is_taken_or_dropped_with_its_record() {
    let token = Arc::new(());
    let start = || {
        let word = word(&token);
        let spec = ProcessSpec::new("alone");
        let registry = Arc::new(ProcessRegistry::new());
        let build = move || async { word };
        let announce = |executor: &ExecutorHandle| executor.announce(spec, build);
        OsThread::start_counted(Attributes::new("alone"), registry, announce).unwrap()
    };
    let heard = start();
    let unheard = start();
    for thread in [&heard, &unheard] {
        thread.release();
        assert_eq!(thread.process().wait(), Exit::Completed);
    }
    let process = heard.process().clone();
    drop((heard, unheard));
    assert_eq!(Arc::strong_count(&token), 2, "whose record is there");
    assert!(exit_value_of(&process).is_some());
    assert_eq!(Arc::strong_count(&token), 1);
}

/// Looks on, and does `ends` at the end of each poll.
struct Looks(fn() -> Verdict);

impl PollMonitor for Looks {
    fn poll_begins(&self, _: Instant) {}

    fn poll_ends(&self, _: Instant, _: Instant) -> Verdict {
        (self.0)()
    }
}

fn monitored(name: &'static str, ends: fn() -> Verdict) -> ProcessSpec {
    ProcessSpec::new(name).monitored(Arc::new(Looks(ends)))
}

#[test]
fn a_monitor_that_panics_behind_the_last_poll_ends_the_process_once() {
    quiet_panics();
    let token = Arc::new(());
    let executor = Executor::start(Attributes::new("main")).unwrap();
    let own = word(&token);
    let spec = monitored("ended", || panic!("on purpose"));
    let (announced, ended) = executor.handle().announce(spec, move || async { own });
    assert!(announced.start().is_none());
    let other = executor.spawn(ProcessSpec::new("other"), yield_now);
    executor.release();
    assert!(matches!(ended.wait(), Exit::Panicked(_)));
    assert!(exit_value_of(&ended).is_none());
    assert_eq!(other.wait(), Exit::Completed);
    drop((executor, ended));
    assert_eq!(Arc::strong_count(&token), 1);
}

/// Says how its body ended.
struct Failed(bool);

impl ExitValue for Failed {
    fn failed() -> Self {
        Failed(true)
    }

    fn is_nothing(&self) -> bool {
        false
    }
}

#[test]
fn a_failure_counts_more_than_a_cancellation_in_the_same_poll() {
    let executor = Executor::start(Attributes::new("main")).unwrap();
    let start = |spec: ProcessSpec| {
        let (announced, process) = executor.handle().announce(spec, || async {
            fail_current();
            std::future::pending::<Failed>().await
        });
        assert!(announced.start().is_none());
        process
    };
    let plain = start(ProcessSpec::new("plain"));
    let poisoned = start(monitored("poisoned", || Verdict::Poison));
    executor.release();
    for process in [plain, poisoned] {
        assert_eq!(process.wait(), Exit::Completed);
        assert!(process.take_exit_value::<Failed>().unwrap().0);
    }
}

/// An exit value that panics when it is dropped, if it is to.
struct Spiteful {
    panics: bool,
    is_failure: bool,
}

impl ExitValue for Spiteful {
    fn failed() -> Self {
        Self {
            panics: false,
            is_failure: true,
        }
    }

    fn is_nothing(&self) -> bool {
        false
    }
}

impl Drop for Spiteful {
    fn drop(&mut self) {
        assert!(!self.panics, "on purpose");
    }
}

#[test]
fn a_value_that_comes_with_a_failure_is_dropped_before_the_process_ends() {
    quiet_panics();
    let executor = Executor::start(Attributes::new("main")).unwrap();
    let start = |name: &'static str, panics: bool| {
        let body = move || async move {
            fail_current();
            Spiteful {
                panics,
                is_failure: false,
            }
        };
        let (announced, process) = executor.handle().announce(ProcessSpec::new(name), body);
        assert!(announced.start().is_none());
        process
    };
    let failed = start("failed", false);
    let panicked = start("panicked", true);
    executor.release();
    assert_eq!(failed.wait(), Exit::Completed);
    assert!(failed.take_exit_value::<Spiteful>().unwrap().is_failure);
    assert!(matches!(panicked.wait(), Exit::Panicked(_)));
    assert!(panicked.take_exit_value::<Spiteful>().is_none());
}
