//! Files, a deadline and other threads end a wait; each file is reported once.

#![cfg(all(target_os = "linux", not(luna_portable), not(loom)))]

use luna_platform::clock::Instant;
use luna_platform::reactor::{
    Ended, FIRST_RESERVED_TOKEN, Interest, Reactor, ReactorError, Readiness,
};
use std::fs::File;
use std::io::{Read, Write};
use std::os::fd::AsFd;
use std::os::unix::net::UnixStream;
use std::sync::Arc;
use std::time::Duration;

/// One wait, and the files that it reported.
fn wait(reactor: &Reactor, deadline: Instant) -> (Ended, Vec<(u64, Readiness)>) {
    let mut ready = Vec::new();
    let ended = reactor
        .wait(deadline, &mut |token, readiness| {
            ready.push((token, readiness))
        })
        .unwrap();
    assert_eq!(ended.files, ready.len());
    (ended, ready)
}

/// Looks without waiting.
fn look(reactor: &Reactor) -> Vec<(u64, Readiness)> {
    wait(reactor, Instant::from_nanos(0)).1
}

fn in_millis(millis: u64) -> Instant {
    Instant::now() + Duration::from_millis(millis)
}

const WATCHDOG: u64 = 60_000;

#[test]
fn smoke() {
    let reactor = Reactor::new().unwrap();
    let (mut writer, reader) = UnixStream::pair().unwrap();
    reactor
        .register(reader.as_fd(), 7, Interest::Readable)
        .unwrap();
    assert_eq!(look(&reactor), []);
    writer.write_all(b"x").unwrap();
    let (ended, ready) = wait(&reactor, in_millis(WATCHDOG));
    assert!(!ended.woken && !ended.timed_out);
    assert!(
        matches!(
            ready[..],
            [(
                7,
                Readiness {
                    readable: true,
                    closed: false,
                    ..
                }
            )]
        ),
        "{ready:?}"
    );
}

#[test]
fn reported_once_until_rearmed() {
    let reactor = Reactor::new().unwrap();
    let (mut writer, mut reader) = UnixStream::pair().unwrap();
    reactor
        .register(reader.as_fd(), 1, Interest::Readable)
        .unwrap();
    writer.write_all(b"ab").unwrap();
    assert_eq!(look(&reactor).len(), 1);
    assert_eq!(look(&reactor), [], "not a second time");
    writer.write_all(b"c").unwrap();
    assert_eq!(look(&reactor), [], "nor for more of the same");
    // Still readable, so it is reported at once, with the token given now.
    reactor
        .rearm(reader.as_fd(), 2, Interest::Readable)
        .unwrap();
    assert_eq!(look(&reactor).first().map(|ready| ready.0), Some(2));
    reader.read_exact(&mut [0; 3]).unwrap();
    reactor
        .rearm(reader.as_fd(), 3, Interest::Readable)
        .unwrap();
    assert_eq!(look(&reactor), []);
    reactor.rearm(reader.as_fd(), 4, Interest::Both).unwrap();
    let ready = look(&reactor);
    assert!(
        matches!(
            ready[..],
            [(
                4,
                Readiness {
                    readable: false,
                    writable: true,
                    ..
                }
            )]
        ),
        "{ready:?}"
    );
    reactor.deregister(reader.as_fd()).unwrap();
    writer.write_all(b"d").unwrap();
    assert_eq!(look(&reactor), []);
}

#[test]
fn a_file_whose_other_side_has_gone_is_ready() {
    let reactor = Reactor::new().unwrap();
    let (writer, reader) = UnixStream::pair().unwrap();
    reactor
        .register(reader.as_fd(), 1, Interest::Readable)
        .unwrap();
    drop(writer);
    let ready = wait(&reactor, in_millis(WATCHDOG)).1;
    assert!(
        matches!(
            ready[..],
            [(
                1,
                Readiness {
                    readable: true,
                    closed: true,
                    ..
                }
            )]
        ),
        "{ready:?}"
    );
}

#[test]
fn a_deadline_ends_the_wait_and_not_before() {
    let reactor = Reactor::new().unwrap();
    for _ in 0..3 {
        let deadline = in_millis(2);
        let ended = wait(&reactor, deadline).0;
        assert!(Instant::now() >= deadline);
        assert!(ended.timed_out && !ended.woken && ended.files == 0);
    }
}

#[test]
fn an_earlier_deadline_does_not_end_a_later_wait() {
    let reactor = Reactor::new().unwrap();
    // Armed for an early one, which is then not waited for.
    let (early, late) = (in_millis(5), in_millis(20));
    reactor.wake();
    assert!(wait(&reactor, early).0.woken);
    assert!(wait(&reactor, late).0.timed_out);
    assert!(Instant::now() >= late);
    // And one that is left behind for no deadline at all: only the wake ends it.
    reactor.wake();
    wait(&reactor, in_millis(3));
    let reactor = Arc::new(reactor);
    let waker = reactor.clone();
    let waking = std::thread::spawn(move || {
        std::thread::sleep(Duration::from_millis(10));
        waker.wake();
    });
    let ended = wait(&reactor, Instant::NEVER).0;
    assert!(ended.woken && !ended.timed_out);
    waking.join().unwrap();
}

#[test]
fn a_later_deadline_does_not_delay_an_earlier_wait() {
    let reactor = Reactor::new().unwrap();
    let late = in_millis(WATCHDOG);
    reactor.wake();
    assert!(wait(&reactor, late).0.woken);
    // Armed for the late one, which is then not waited for.
    assert!(wait(&reactor, in_millis(2)).0.timed_out);
    assert!(Instant::now() < late);
}

#[test]
fn one_deadline_waited_for_twice() {
    let reactor = Reactor::new().unwrap();
    let deadline = in_millis(10);
    reactor.wake();
    assert!(wait(&reactor, deadline).0.woken);
    assert!(wait(&reactor, deadline).0.timed_out, "still armed");
    assert!(
        wait(&reactor, deadline).0.timed_out,
        "it has passed, so this does not wait"
    );
}

#[test]
fn no_wake_is_lost() {
    let reactor = Arc::new(Reactor::new().unwrap());
    let waker = reactor.clone();
    let waking = std::thread::spawn(move || {
        for _ in 0..10_000 {
            waker.wake();
        }
    });
    // All wakes during which no thread waits are one wake; there is at least one, and the last is
    // seen after the thread has ended.
    let mut seen = 0;
    while !waking.is_finished() {
        seen += usize::from(wait(&reactor, in_millis(1)).0.woken);
    }
    waking.join().unwrap();
    seen += usize::from(wait(&reactor, Instant::from_nanos(0)).0.woken);
    assert!((1..=10_000).contains(&seen));
    assert!(
        !wait(&reactor, Instant::from_nanos(0)).0.woken,
        "all are taken"
    );
    for _ in 0..3 {
        reactor.wake();
        assert!(
            wait(&reactor, in_millis(WATCHDOG)).0.woken,
            "an eventfd that was never read is woken by each write"
        );
    }
}

#[test]
fn more_files_than_one_wait_reports() {
    let reactor = Reactor::new().unwrap();
    let pairs: Vec<_> = (0..100).map(|_| UnixStream::pair().unwrap()).collect();
    for (token, (_, reader)) in pairs.iter().enumerate() {
        reactor
            .register(reader.as_fd(), token as u64, Interest::Writable)
            .unwrap();
    }
    let mut tokens: Vec<u64> = Vec::new();
    while let ready @ [_, ..] = &look(&reactor)[..] {
        tokens.extend(ready.iter().map(|ready| ready.0));
    }
    tokens.sort_unstable();
    assert_eq!(tokens, (0..100).collect::<Vec<_>>());
}

#[test]
fn mistakes_are_named() {
    let reactor = Reactor::new().unwrap();
    let (one, _two) = UnixStream::pair().unwrap();
    let token = FIRST_RESERVED_TOKEN;
    assert_eq!(
        reactor.register(one.as_fd(), token, Interest::Both),
        Err(ReactorError::ReservedToken { token })
    );
    assert!(matches!(
        reactor.rearm(one.as_fd(), 0, Interest::Both),
        Err(ReactorError::NotRegistered { .. })
    ));
    assert!(matches!(
        reactor.deregister(one.as_fd()),
        Err(ReactorError::NotRegistered { .. })
    ));
    reactor
        .register(one.as_fd(), 0, Interest::Readable)
        .unwrap();
    let error = reactor
        .register(one.as_fd(), 0, Interest::Readable)
        .unwrap_err();
    assert!(
        matches!(error, ReactorError::AlreadyRegistered { .. }),
        "{error}"
    );
    let file = File::open(std::env::current_exe().unwrap()).unwrap();
    let error = reactor
        .register(file.as_fd(), 1, Interest::Readable)
        .unwrap_err();
    assert!(
        matches!(error, ReactorError::AlwaysReady { .. }) && error.to_string().contains("blocking"),
        "{error}"
    );
}
