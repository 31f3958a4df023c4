//! Several waits for one file, dropped waits, numbers used again, files by the hundred, busy
//! executors.

#![cfg(all(unix, not(loom)))]

use crate::file_support;
use crate::support;
use file_support::{fill, pair, read_byte, with_files};
use futures_lite::future::or;
use luna_core::{Exit, ProcessSpec, ProcessState, block_on, readable, writable, yield_now};
use std::io::{Read, Write};
use std::os::fd::{AsRawFd, RawFd};
use std::os::unix::net::UnixStream;
use std::pin::pin;
use std::sync::Arc;
use support::{Gate, Log, executor, poll_once, until};

/// A file as the kernel identifies it: the number of its descriptor may have been another's before.
#[derive(Clone, Copy)]
struct Identity {
    fd: RawFd,
    inode: u64,
}

fn identity(file: &UnixStream) -> Identity {
    let fd = file.as_raw_fd();
    let link = std::fs::read_link(format!("/proc/self/fd/{fd}")).unwrap();
    // It reads "socket:[4711]".
    let digits: String = link
        .to_string_lossy()
        .chars()
        .filter(char::is_ascii_digit)
        .collect();
    Identity {
        fd,
        inode: digits.parse().unwrap(),
    }
}

/// Number of epolls of this program that contain the file, and whether any of them is armed for it.
fn known(file: Identity) -> (usize, bool) {
    let (mut count, mut armed) = (0, false);
    for info in std::fs::read_dir("/proc/self/fdinfo").unwrap() {
        // Other tests close files meanwhile.
        let Ok(text) = std::fs::read_to_string(info.unwrap().path()) else {
            continue;
        };
        // "tfd: 5 events: 1d data: 5 pos:0 ino:1267 sdev:8", the last four in hexadecimal.
        for line in text.lines().filter(|line| line.starts_with("tfd:")) {
            let words: Vec<&str> = line.split_whitespace().collect();
            let inode = line
                .split("ino:")
                .nth(1)
                .unwrap()
                .split_whitespace()
                .next()
                .unwrap();
            if words[1] == file.fd.to_string() && u64::from_str_radix(inode, 16) == Ok(file.inode) {
                count += 1;
                armed |= u32::from_str_radix(words[3], 16).unwrap() & 0xfff != 0;
            }
        }
    }
    (count, armed)
}

#[test]
fn all_that_wait_for_one_file_are_readied_most_urgent_first() {
    let Some(_watch) = with_files() else { return };
    let (executor, log) = (executor(), Log::new());
    let (near, mut far) = pair();
    let near = Arc::new(near);
    let processes: Vec<_> = [3, 8, 3, 20]
        .into_iter()
        .enumerate()
        .map(|(n, level)| {
            let (near, log) = (near.clone(), log.clone());
            executor.spawn(ProcessSpec::new("reads").level(level), move || async move {
                readable(&*near).await.unwrap();
                log.add((level, n));
            })
        })
        .collect();
    executor.release();
    until(|| {
        processes
            .iter()
            .all(|process| process.state() == ProcessState::Waiting)
    });
    far.write_all(b"x").unwrap();
    processes.iter().for_each(|process| drop(process.wait()));
    assert_eq!(log.take(), [(20, 3), (8, 1), (3, 0), (3, 2)]);
}

#[test]
fn a_reader_and_a_writer_of_one_file() {
    let Some(_watch) = with_files() else { return };
    let (executor, log) = (executor(), Log::new());
    let (near, mut far) = pair();
    fill(&near);
    let near = Arc::new(near);
    let (own, to_log) = (near.clone(), log.clone());
    let writer = executor.spawn(ProcessSpec::new("writes"), move || async move {
        writable(&*own).await.unwrap();
        to_log.add("writer");
    });
    let (own, to_log) = (near.clone(), log.clone());
    let reader = executor.spawn(ProcessSpec::new("reads"), move || async move {
        assert_eq!(read_byte(&own).await, Ok(Some(b'x')));
        to_log.add("reader");
        assert_eq!(read_byte(&own).await, Ok(Some(b'y')));
        to_log.add("reader");
    });
    executor.release();
    until(|| reader.state() == ProcessState::Waiting && writer.state() == ProcessState::Waiting);
    far.write_all(b"x").unwrap();
    until(|| log.len() == 1);
    // The report for the reader disarmed the file for the writer too: it must have been armed
    // again.
    until(|| reader.state() == ProcessState::Waiting);
    assert_eq!(writer.exit(), None);
    let mut sink = [0; 1 << 16];
    while far.read(&mut sink).is_ok() {}
    assert_eq!(writer.wait(), Exit::Completed);
    far.write_all(b"y").unwrap();
    reader.wait();
    assert_eq!(log.take(), ["reader", "writer", "reader"]);
}

#[test]
fn a_dropped_wait_is_withdrawn_and_leaves_the_others() {
    let Some(_watch) = with_files() else { return };
    let (near, mut far) = pair();
    fill(&near);
    let file = identity(&near);
    block_on(async {
        {
            let mut only = pin!(readable(&near));
            assert_eq!(poll_once(&mut only).await, None);
            assert_eq!(known(file), (1, true));
        }
        assert_eq!(known(file), (0, false), "nobody waits any more");
        let mut stays = pin!(readable(&near));
        for round in 0..3 {
            let mut writer = pin!(writable(&near));
            let mut reader = pin!(readable(&near));
            if round != 1 {
                assert_eq!(poll_once(&mut writer).await, None);
            }
            assert_eq!(poll_once(&mut stays).await, None);
            if round != 2 {
                assert_eq!(poll_once(&mut reader).await, None);
            }
        }
        assert_eq!(known(file), (1, true));
        far.write_all(b"x").unwrap();
        stays.await.unwrap();
        assert_eq!(known(file), (1, false), "known, and not armed");
        // A ready one that was never polled.
        let mut ready = pin!(readable(&near));
        assert_eq!(poll_once(&mut ready).await, None);
        yield_now().await;
    })
    .unwrap();
    assert_eq!(known(file), (0, false));
}

#[test]
fn a_number_that_is_used_again_for_another_file() {
    let Some(_watch) = with_files() else { return };
    block_on(async {
        let mut kept = Vec::new();
        for byte in 0..50 {
            let (near, mut far) = pair();
            if byte % 2 == 0 {
                // The file stays open by another number, and stays known to the epoll by the old
                // one.
                kept.push(near.try_clone().unwrap());
            }
            let mut wait = pin!(readable(&near));
            assert_eq!(poll_once(&mut wait).await, None);
            far.write_all(&[byte]).unwrap();
            wait.await.unwrap();
            assert_eq!(read_byte(&near).await, Ok(Some(byte)));
            // Left readable: a later file by this number must not be taken for it.
            far.write_all(&[byte]).unwrap();
            kept.push(far);
        }
        let (near, mut far) = pair();
        let mut wait = pin!(readable(&near));
        assert_eq!(poll_once(&mut wait).await, None);
        for _ in 0..200 {
            yield_now().await;
        }
        assert_eq!(poll_once(&mut wait).await, None, "nothing was written");
        far.write_all(b"x").unwrap();
        wait.await.unwrap();
    })
    .unwrap();
}

#[test]
fn hundreds_of_files_at_once() {
    let Some(_watch) = with_files() else { return };
    let (executor, log) = (executor(), Log::new());
    // More than one look reports, and more than there are lists.
    let (near, mut far): (Vec<_>, Vec<_>) = (0..300).map(|_| pair()).unzip();
    let processes: Vec<_> = near
        .into_iter()
        .enumerate()
        .map(|(n, near)| {
            let log = log.clone();
            executor.spawn(ProcessSpec::new("reads"), move || async move {
                assert_eq!(read_byte(&near).await, Ok(Some(n as u8)));
                log.add(n);
            })
        })
        .collect();
    executor.release();
    until(|| {
        processes
            .iter()
            .all(|process| process.state() == ProcessState::Waiting)
    });
    for (n, far) in far.iter_mut().enumerate() {
        far.write_all(&[n as u8]).unwrap();
    }
    processes
        .iter()
        .for_each(|process| assert_eq!((process.wait(), process.polls()), (Exit::Completed, 2)));
    let mut done = log.take();
    done.sort_unstable();
    assert_eq!(done, (0..300).collect::<Vec<_>>());
}

#[test]
fn a_busy_low_process_does_not_keep_a_high_one_from_its_file() {
    let Some(_watch) = with_files() else { return };
    let (executor, log) = (executor(), Log::new());
    let (near, mut far) = pair();
    let own = log.clone();
    executor.spawn(ProcessSpec::new("high").level(20), move || async move {
        for _ in 0..20 {
            own.add(read_byte(&near).await.unwrap().unwrap());
        }
    });
    let seen = log.clone();
    let busy = executor.spawn(ProcessSpec::new("busy").level(1), move || async move {
        for n in 0..20 {
            for _ in 0..n * 5 {
                yield_now().await;
            }
            far.write_all(&[n]).unwrap();
            let mut rounds = 0;
            while seen.len() == 0 {
                rounds += 1;
                yield_now().await;
            }
            assert!(rounds <= 64, "{rounds} polls of a lower process came first");
            assert_eq!(seen.take(), [n]);
        }
    });
    executor.release();
    assert_eq!(busy.wait(), Exit::Completed);
}

#[test]
fn a_process_that_always_readies_itself_again_sees_its_files() {
    let Some(_watch) = with_files() else { return };
    let (near, mut far) = pair();
    let never = async {
        far.write_all(b"x").unwrap();
        loop {
            yield_now().await;
        }
    };
    assert_eq!(block_on(or(readable(&near), never)), Ok(Ok(())));
}

#[test]
fn a_wait_moves_to_the_thread_that_polls_it() {
    let Some(_watch) = with_files() else { return };
    let (near, mut far) = pair();
    let file = identity(&near);
    std::thread::scope(|scope| {
        let mut wait = Box::pin(readable(&near));
        assert_eq!(block_on(poll_once(&mut wait)), Ok(None));
        let gate = Gate::default();
        let waits = scope.spawn({
            let gate = gate.clone();
            move || {
                block_on(async {
                    assert_eq!(poll_once(&mut wait).await, None);
                    gate.open();
                    wait.await
                })
            }
        });
        block_on(gate.pass()).unwrap();
        far.write_all(b"x").unwrap();
        assert_eq!(waits.join().unwrap(), Ok(Ok(())));
        // And one that is dropped elsewhere while its thread sleeps.
        let (silent, _other) = pair();
        block_on(async {
            let mut left = Box::pin(readable(&silent));
            assert_eq!(poll_once(&mut left).await, None);
            std::thread::scope(|scope| drop(scope.spawn(move || drop(left)).join()));
        })
        .unwrap();
        assert_eq!(known(identity(&silent)), (0, false));
    });
    drop(near);
    assert_eq!(known(file), (0, false));
}
