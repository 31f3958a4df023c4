//! What is seen from outside.

use crate::child::Program;
use crate::shared::watchdog;
use crate::{block, channel_name, files, spawn};
use luna::Policy;
use luna_ipc::Blackboard;
use luna_ipc::look::{self, Found, Kind};
use nix::fcntl::{FcntlArg, fcntl};
use std::path::Path;

fn found(name: &str) -> Found {
    look::at(name).unwrap().expect("it is there")
}

#[test]
fn a_channel_is_seen_from_its_opening_to_its_end() {
    let _watchdog = watchdog();
    let name = channel_name("looked-at");
    assert_eq!(look::at(&name).unwrap(), None);
    let (sender, link) = luna_ipc::sender::<crate::Block>(&name).unwrap();
    let alone = found(&name);
    assert_eq!(alone.kind, Kind::Channel);
    assert_eq!(
        (&*alone.value.name, alone.value.size),
        ("luna_ipc_test::Block", 16)
    );
    let own = std::process::id();
    assert_eq!(alone.sender.as_ref().map(|one| one.pid), Some(own));
    assert_eq!((alone.receiver.as_ref(), alone.is_joined), (None, false));
    assert!(look::all().unwrap().found.contains(&found(&name)));

    let mut program = Program::start("hold", &name, Path::new(""));
    let sent = spawn(Policy::Other, link, async move {
        assert!(sender.send(block(1)).await.is_err());
        Ok(())
    });
    // The child holds the value, and does not let its sender go on.
    program.wait_until_there();
    let held = found(&name);
    assert_eq!(
        held.receiver.as_ref().map(|one| one.pid),
        Some(program.id())
    );
    assert!(held.is_joined && held.is_under_way(), "{held:?}");
    assert_eq!((held.sent, held.taken, held.openings), (1, 0, [1, 1]));

    program.kill();
    program.wait();
    // The sender may have closed it already.
    let after = look::at(&name).unwrap();
    assert!(after.is_none_or(|found| found.receiver.is_none()));
    assert!(sent.join().unwrap().is_err());
    assert_eq!(look::at(&name).unwrap(), None);
}

#[test]
fn what_killed_programs_have_left_is_not_alive() {
    let _watchdog = watchdog();
    let _alone = crate::leaving_files();
    let name = channel_name("left-to-look-at");
    let mut program = Program::start("hold", &name, Path::new(""));
    while look::at(&name)
        .unwrap()
        .is_none_or(|found| !found.is_alive())
    {
        std::thread::yield_now();
    }
    program.kill();
    program.wait();
    let left = found(&name);
    assert!(!left.is_alive() && !left.is_joined, "{left:?}");
    assert!(!files(&name).is_empty(), "looking removes nothing");
    drop(luna_ipc::sender::<crate::Block>(&name).unwrap());
    assert!(files(&name).is_empty());
}

/// The set-up lock is held by a program that never lets go, as one that was stopped.
#[test]
fn looking_waits_for_no_lock() {
    let _watchdog = watchdog();
    let name = channel_name("locked");
    let opened = luna_ipc::sender::<u8>(&name).unwrap();
    let path = format!("/dev/shm/luna-ipc.{}.lock", name.replace('/', "+"));
    let file = std::fs::File::options().read(true).write(true).open(path);
    let file = file.unwrap();
    let set_up = libc::flock {
        l_type: libc::F_WRLCK as libc::c_short,
        l_whence: libc::SEEK_SET as libc::c_short,
        l_start: 0,
        l_len: 1,
        l_pid: 0,
    };
    fcntl(&file, FcntlArg::F_OFD_SETLK(&set_up)).unwrap();
    assert!(found(&name).sender.is_some());
    assert!(
        look::all()
            .unwrap()
            .found
            .iter()
            .any(|one| one.name == name)
    );
    drop(file);
    drop(opened);
}

#[test]
fn a_blackboards_values_are_seen_whole_while_they_are_written() {
    let _watchdog = watchdog();
    let name = channel_name("board-looked-at");
    let mut program = Program::start("board", &name, Path::new(""));
    program.wait_until_there();
    let (mut last, mut whole) = (0, 0);
    for round in 0.. {
        // Its writer never pauses: so each other look is at one that is stopped somewhere.
        let stops = round % 2 == 0;
        if stops {
            program.stop();
        }
        let found = found(&name);
        if stops {
            program.go_on();
        }
        let key = &found.keys[0];
        assert_eq!((&*key.key, found.kind), ("large", Kind::Blackboard));
        assert!(key.number >= last, "it goes back");
        last = key.number;
        // Without bytes it was set anew during each copy.
        let (words, rest) = key.bytes.as_chunks::<8>();
        assert!(rest.is_empty());
        if let Some(first) = words.first() {
            assert!(words.iter().all(|word| word == first), "torn");
            assert_eq!(u64::from_ne_bytes(*first) + 1, key.number);
            whole += 1;
        }
        if last > 2000 && whole >= 20 {
            break;
        }
    }
    // Readers share a role, and say nothing: the kernel is asked.
    let writer = found(&name);
    assert_eq!(
        writer.sender.as_ref().map(|one| one.pid),
        Some(program.id())
    );
    assert_eq!(
        (writer.receiver.as_ref(), look::readers(&writer).unwrap()),
        (None, vec![])
    );
    let reader = Blackboard::new(&name).read().unwrap();
    let read = found(&name);
    assert!(read.receiver.is_some());
    assert_eq!(look::readers(&read).unwrap(), [std::process::id()]);
    drop(reader);
    program.kill();
    program.wait();
    drop(Blackboard::new(&name).entry("large", 0_u8).write().unwrap());
    assert!(files(&name).is_empty());
}

#[test]
fn kinds_are_told_apart() {
    let name = channel_name("kinds");
    let kind = |of: &str| found(&format!("{name}/{of}")).kind;
    let endpoint = |of: &str| luna_ipc::Endpoint::new(&format!("{name}/{of}"));
    let _call = endpoint("call").client::<[u8; 3], f64>().unwrap();
    let _loan = endpoint("loan").loan_sender(2, &[0_u64; 9]).unwrap();
    assert_eq!((kind("call"), kind("loan")), (Kind::Call, Kind::Loan));
    #[cfg(feature = "serde")]
    {
        let _serde = endpoint("serde").serde_sender::<Vec<String>>(100).unwrap();
        assert_eq!(kind("serde"), Kind::Serde);
    }
    assert!(look::at("two words").is_err());
}
