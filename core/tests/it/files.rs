//! Processes that wait for files: on executors, threads of their own and the calling thread; with
//! wakes, deadlines and others beside.

#![cfg(all(unix, not(loom)))]

use crate::file_support;
use crate::support;
use file_support::{fill, pair, read_byte, with_files, write_byte};
use luna_core::timer_queue::Sleep;
use luna_core::{
    Exit, FileError, OsThread, ProcessSpec, ProcessState, block_on, prepare_files, readable,
    writable, yield_now,
};
use luna_platform::clock::Instant;
use luna_platform::thread::Attributes;
use std::fs::File;
use std::io::{ErrorKind, Read, Write};
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Duration;
use support::{Gate, Log, executor, rounds, until};

#[test]
fn smoke() {
    let Some(_watch) = with_files() else { return };
    let (mut near, far) = pair();
    let executor = executor();
    let process = executor.spawn(ProcessSpec::new("reads"), move || async move {
        assert_eq!(read_byte(&far).await, Ok(Some(7)));
        assert_eq!(read_byte(&far).await, Ok(None), "the end counts as ready");
    });
    executor.release();
    until(|| process.state() == ProcessState::Waiting);
    near.write_all(&[7]).unwrap();
    drop(near);
    assert_eq!(process.wait(), Exit::Completed);
    assert!((2..=3).contains(&process.polls()));
}

#[test]
fn where_the_platform_cannot_it_says_so() {
    let (near, _far) = pair();
    match block_on(async { prepare_files() }).unwrap() {
        Ok(()) => report!("skipped: where_the_platform_cannot_it_says_so: it can"),
        Err(prepared) => {
            let error = block_on(readable(&near)).unwrap().unwrap_err();
            assert_eq!(error, prepared);
            assert!(
                error.is_unsupported() && error.to_string().contains("needs Linux"),
                "{error}"
            );
            assert_eq!(std::io::Error::from(error).kind(), ErrorKind::Unsupported);
        }
    }
}

#[test]
fn a_thread_that_runs_no_process_says_so() {
    let (near, _far) = pair();
    assert_eq!(
        futures_lite::future::block_on(readable(&near)),
        Err(FileError::NoProcess)
    );
    assert_eq!(prepare_files(), Err(FileError::NoProcess));
    assert_eq!(
        std::io::Error::from(FileError::NoProcess).kind(),
        ErrorKind::Other
    );
}

#[test]
fn a_file_on_a_disk_is_refused() {
    let Some(_watch) = with_files() else { return };
    let file = File::open(std::env::current_exe().unwrap()).unwrap();
    for wait in [readable(&file), writable(&file)] {
        let error = block_on(wait).unwrap().unwrap_err();
        assert!(
            error.to_string().contains("on a disk") && error.to_string().contains("blocking call"),
            "{error}"
        );
        assert!(!error.is_unsupported());
        assert_eq!(std::io::Error::from(error).kind(), ErrorKind::Unsupported);
    }
}

#[test]
fn written_when_there_is_room() {
    let Some(_watch) = with_files() else { return };
    let (mut near, far) = pair();
    let executor = executor();
    let process = executor.spawn(ProcessSpec::new("writes"), move || async move {
        assert_eq!(writable(&far).await, Ok(()));
        fill(&far);
        write_byte(&far, 9).await.unwrap();
    });
    executor.release();
    until(|| process.polls() == 2 && process.state() == ProcessState::Waiting);
    let mut all = Vec::new();
    near.set_nonblocking(false).unwrap();
    near.read_to_end(&mut all).unwrap();
    assert_eq!((process.wait(), all.last()), (Exit::Completed, Some(&9)));
}

#[test]
fn a_thread_of_its_own_and_the_calling_thread_wait_too() {
    let Some(_watch) = with_files() else { return };
    let (near, far) = pair();
    let thread = OsThread::start(
        Attributes::new("echo"),
        ProcessSpec::new("echo"),
        move || async move {
            while let Ok(Some(byte)) = read_byte(&far).await {
                write_byte(&far, byte + 1).await.unwrap();
            }
        },
    )
    .unwrap();
    thread.release();
    let process = thread.process().clone();
    block_on(async move {
        for byte in 0..200 {
            write_byte(&near, byte).await.unwrap();
            assert_eq!(read_byte(&near).await, Ok(Some(byte + 1)));
        }
        drop(near);
        assert_eq!(process.join().await, Exit::Completed);
    })
    .unwrap();
}

#[test]
fn cancelled_while_it_waits_for_a_file() {
    let Some(_watch) = with_files() else { return };
    let body = || async {
        let (near, _far) = pair();
        readable(&near).await.unwrap();
    };
    let executor = executor();
    let process = executor.spawn(ProcessSpec::new("waits"), body);
    let thread = OsThread::start(Attributes::new("test"), ProcessSpec::new("waits"), body).unwrap();
    executor.release();
    thread.release();
    for process in [&process, thread.process()] {
        until(|| process.state() == ProcessState::Waiting);
        process.cancel();
        assert_eq!(process.wait(), Exit::Cancelled);
    }
}

#[test]
fn wakes_from_elsewhere_and_files_lose_nothing_of_each_other() {
    let Some(_watch) = with_files() else { return };
    let count = rounds(3_000);
    let (here, there) = (executor(), executor());
    let (near, far) = pair();
    let handle = there.handle().clone();
    let echo = there.spawn(ProcessSpec::new("echo"), move || async move {
        while let Ok(Some(byte)) = read_byte(&far).await {
            write_byte(&far, byte).await.unwrap();
        }
    });
    let process = here.spawn(ProcessSpec::new("asks"), move || async move {
        for n in 0..count {
            write_byte(&near, n as u8).await.unwrap();
            assert_eq!(read_byte(&near).await, Ok(Some(n as u8)));
            // Wakes both executors from elsewhere, each from its epoll or on its way there.
            assert_eq!(
                handle
                    .spawn(ProcessSpec::new("short"), || async { yield_now().await })
                    .join()
                    .await,
                Exit::Completed
            );
        }
    });
    here.release();
    there.release();
    assert_eq!(
        (process.wait(), echo.wait()),
        (Exit::Completed, Exit::Completed)
    );
}

#[test]
fn a_thread_in_its_epoll_is_unparked() {
    let Some(_watch) = with_files() else { return };
    let (gates, passed) = (Log::<Gate>::new(), Arc::new(AtomicUsize::new(0)));
    let count = rounds(5_000);
    let (own, done) = (gates.clone(), passed.clone());
    let thread = OsThread::start(
        Attributes::new("test"),
        ProcessSpec::new("woken"),
        move || async move {
            prepare_files().unwrap();
            for _ in 0..count {
                let gate = Gate::default();
                own.add(gate.clone());
                gate.pass().await;
                done.fetch_add(1, Ordering::SeqCst);
            }
        },
    )
    .unwrap();
    thread.release();
    while passed.load(Ordering::SeqCst) < count {
        gates.take().iter().for_each(Gate::open);
    }
    assert_eq!(thread.process().wait(), Exit::Completed);
}

#[test]
fn deadlines_beside_files() {
    let Some(_watch) = with_files() else { return };
    let executor = executor();
    let (near, mut far) = pair();
    let waits = executor.spawn(ProcessSpec::new("waits"), move || async move {
        assert_eq!(read_byte(&near).await, Ok(Some(1)));
    });
    let sleeps = executor.spawn(ProcessSpec::new("sleeps"), || async {
        for _ in 0..20 {
            let deadline = Instant::now() + Duration::from_micros(300);
            Sleep::until(deadline).await;
            assert!(Instant::now() >= deadline);
        }
    });
    executor.release();
    assert_eq!((sleeps.wait(), waits.exit()), (Exit::Completed, None));
    assert!(sleeps.polls() <= 21);
    far.write_all(&[1]).unwrap();
    assert_eq!((waits.wait(), waits.polls()), (Exit::Completed, 2));
}
