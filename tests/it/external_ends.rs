//! External channels: how links end, and what ends with them.

#![cfg(unix)]

use crate::common;
use crate::external::{run_beside_thread, run_on_one};
use common::{PLACEMENTS, Placement, SpawnOk, watchdog, with_ends};
use luna::external::{Frame, Framing, LinkError, Prefix, ToBytes};
use luna::prelude::*;
use luna::{Buffer, Error};
use std::io::{Read, Write};
use std::os::unix::net::UnixStream;

/// What the buffer holds is received before the end shows.
#[test]
fn the_end_comes_after_what_is_buffered() {
    let Some(_watch) = with_ends() else { return };
    let (near, mut far) = std::io::pipe().unwrap();
    far.write_all(b"1\n2\n3\n").unwrap();
    drop(far);
    let (sender, lines) = luna::buffered::<Frame<8>>(Buffer::fifo(8));
    let mut system = System::new("end");
    let executor = system.executor("main").build().unwrap();
    executor
        .process("input")
        .priority(20)
        .spawn_ok(luna::external::input(near, sender, Framing::lines(8)));
    executor
        .process("reader")
        .priority(10)
        .spawn_ok(async move {
            while lines.buffered() < 3 {
                luna::yield_now().await;
            }
            for text in ["1", "2", "3"] {
                assert_eq!(lines.recv().await?.text(), Ok(text));
            }
            assert!(lines.recv().await.unwrap_err().is_closed());
            Ok(())
        });
    system.run().unwrap();
}

/// While the system goes on: the far side, which is a process of it, sees the file close.
#[test]
fn a_link_that_has_ended_closes_its_file() {
    let Some(_watch) = with_ends() else { return };
    for place in PLACEMENTS {
        let (near, mut far) = UnixStream::pair().unwrap();
        let (source, outgoing) = luna::channel::<[u8; 1]>();
        let link = luna::external::output(outgoing, near, Framing::fixed(1));
        let far = async move {
            source.send(*b"x").await?;
            drop(source);
            let mut all = Vec::new();
            far.read_to_end(&mut all)?;
            assert_eq!(all, b"x");
            Ok(())
        };
        run_beside_thread(place, "output", link, far).unwrap();
    }
}

/// No process wants the device's data any more: no error.
#[test]
fn an_input_without_receivers_ends() {
    let Some(_watch) = with_ends() else { return };
    let (near, mut far) = std::io::pipe().unwrap();
    let (sender, lines) = luna::channel::<Frame<8>>();
    far.write_all(b"1\n2\n").unwrap();
    let link = luna::external::input(near, sender, Framing::lines(8));
    let reader = async move {
        assert_eq!(lines.recv().await?.text(), Ok("1"));
        Ok(())
    };
    run_on_one("input", link, reader).unwrap();
    assert_eq!(
        far.write(b"3\n").unwrap_err().kind(),
        std::io::ErrorKind::BrokenPipe
    );
}

/// The far side of an output closes: the link fails, and each sender gets its value back.
#[test]
fn an_output_whose_far_side_has_gone() {
    let Some(_watch) = with_ends() else { return };
    for place in PLACEMENTS {
        let (far, near) = std::io::pipe().unwrap();
        drop(far);
        let (source, outgoing) = luna::channel::<[u8; 4]>();
        let link = luna::external::output(outgoing, near, Framing::fixed(4));
        let sends = async move {
            source.send(*b"lost").await?;
            let error = source.send(*b"back").await.unwrap_err();
            assert!(error.is_closed());
            assert_eq!(error.into_inner(), *b"back");
            Ok(())
        };
        let (name, error) = link_error(run_beside_thread(place, "output", link, sends));
        assert_eq!(name, "output");
        assert!(error.is_far_end_closed(), "{error}");
        let text = error.to_string();
        assert!(text.contains("record 1, after 0"), "{text}");
    }
}

/// A waiting write sees it as well.
#[test]
fn a_far_side_that_goes_while_an_output_waits_for_room() {
    let Some(_watch) = with_ends() else { return };
    let (far, near) = UnixStream::pair().unwrap();
    let (source, outgoing) = luna::channel::<Frame<4096>>();
    let mut system = System::new("gone");
    let executor = system.executor("main").build().unwrap();
    executor.process("output").spawn_ok(luna::external::output(
        outgoing,
        near,
        Framing::chunks(4096),
    ));
    executor.process("source").priority(1).spawn_ok(async move {
        let full = Frame::new(&[1; 4096]).unwrap();
        // Until the file has no more room and the link waits for some.
        while source
            .send_timeout(full, std::time::Duration::from_millis(20))
            .await
            .is_ok()
        {}
        drop(far);
        while source.send(full).await.is_ok() {}
        Ok(())
    });
    let (_, error) = link_error(system.run());
    assert!(error.is_far_end_closed(), "{error}");
}

#[track_caller]
fn link_error<T: std::fmt::Debug>(outcome: luna::Result<T>) -> (String, LinkError) {
    match outcome.unwrap_err() {
        Error::Process { name, source } => match *source {
            Error::External(error) => (name, error),
            other => panic!("expected a link's error, got {other:?}"),
        },
        other => panic!("expected a process' error, got {other:?}"),
    }
}

/// By hand, without a system, in a parallel construct.
#[test]
fn links_run_by_hand() {
    let Some(_watch) = with_ends() else { return };
    let (reading, writing) = std::io::pipe().unwrap();
    let (source, outgoing) = luna::channel::<[u8; 1]>();
    let (incoming, drain) = luna::channel::<[u8; 1]>();
    let mut output = luna::external::output(outgoing, writing, Framing::fixed(1));
    let mut input = luna::external::input(reading, incoming, Framing::fixed(1));
    luna::run(async {
        output.pre_run()?;
        input.pre_run()?;
        let own = async {
            source.send([7]).await?;
            assert_eq!(drain.recv().await?, [7]);
            drop(source);
            Ok(())
        };
        let out = async {
            output.run().await?;
            output.post_run();
            Ok(())
        };
        par!(out, input.run(), own).await?;
        let again = input.run().await;
        assert_eq!(again, Err(Error::External(LinkError::NotPrepared)));
        Ok(())
    })
    .unwrap();
}

#[test]
fn what_cannot_be_set_up() {
    let _watch = watchdog();
    for (framing, part) in [
        (Framing::fixed(0), "at most 0 bytes"),
        (Framing::lines(usize::MAX), "1 GiB"),
        (Framing::prefixed(Prefix::U8, 256), "255 at most"),
        (Framing::prefixed(Prefix::U16Big, 65536), "65535 at most"),
    ] {
        let (near, far) = std::io::pipe().unwrap();
        let (sender, receiver) = luna::channel::<[u8; 1]>();
        let mut system = System::new("wrong");
        for (name, place) in [
            ("input", Placement::Executor),
            ("output", Placement::Thread),
        ] {
            let process = place.process(&mut system, name, name);
            if name == "input" {
                let near = near.try_clone().unwrap();
                process.spawn(luna::external::input(near, sender.clone(), framing))
            } else {
                let far = far.try_clone().unwrap();
                process.spawn(luna::external::output(receiver.clone(), far, framing))
            }
            .unwrap();
        }
        let (name, error) = link_error(system.run());
        assert_eq!(name, "input");
        assert!(error.to_string().contains(part), "{error}");
        let mut output = luna::external::output(receiver, far, framing);
        assert_eq!(output.pre_run(), Err(Error::External(error)));
    }
}

/// The device is silent, or has no room, for ever: the link ends and the file is closed, which the
/// far side sees.
#[test]
fn poison_ends_a_link_that_waits_for_its_file() {
    let Some(_watch) = with_ends() else { return };
    for place in PLACEMENTS {
        for from_far_end in [false, true] {
            let (near, mut far) = UnixStream::pair().unwrap();
            let (sender, receiver) = luna::channel::<[u8; 4]>();
            let own = sender.clone();
            let link = luna::external::input(near, sender, Framing::fixed(4));
            let far = async move {
                far.write_all(b"oncehalf")?;
                assert_eq!(receiver.recv().await?, *b"once");
                if from_far_end {
                    receiver.poison();
                } else {
                    own.poison();
                }
                // In the middle of a record, and with the channel's ends still here.
                assert_eq!(far.read(&mut [0])?, 0);
                drop((own, receiver));
                Ok(())
            };
            assert_poisoned(run_beside_thread(place, "input", link, far), "input");
        }
    }
}

/// 50 000 bytes, without room for them in the value.
struct Full;

impl ToBytes for Full {
    fn length(&self) -> usize {
        50_000
    }

    fn to_bytes(&self, to: &mut [u8]) {
        to.fill(1);
    }
}

#[test]
fn poison_ends_a_link_that_waits_for_room() {
    let Some(_watch) = with_ends() else { return };
    for place in PLACEMENTS {
        let (mut far, near) = std::io::pipe().unwrap();
        let (sender, receiver) = luna::channel::<Full>();
        let link = luna::external::output(receiver, near, Framing::chunks(50_000));
        let far = async move {
            // The pipe takes 64 KiB: the second record waits in the link.
            sender.send(Full).await?;
            sender.send(Full).await?;
            sender.poison();
            // Comes back only when the file is closed.
            let mut all = Vec::new();
            far.read_to_end(&mut all)?;
            assert!((50_000..=100_000).contains(&all.len()));
            Ok(())
        };
        assert_poisoned(run_beside_thread(place, "output", link, far), "output");
    }
}

#[track_caller]
fn assert_poisoned<T: std::fmt::Debug>(outcome: luna::Result<T>, of: &str) {
    match outcome.unwrap_err() {
        Error::Process { name, source } => {
            assert_eq!(name, of);
            assert_eq!(*source, Error::Poisoned);
        }
        other => panic!("{other:?}"),
    }
}

/// A sibling that fails ends a link in a parallel construct, also one that waits for its file.
#[test]
fn a_failed_sibling_ends_a_link() {
    let Some(_watch) = with_ends() else { return };
    let (near, _far) = UnixStream::pair().unwrap();
    let (sender, _receiver) = luna::channel::<[u8; 1]>();
    let mut link = luna::external::input(near, sender, Framing::fixed(1));
    let outcome = luna::run(async {
        link.pre_run()?;
        let fails = async {
            luna::yield_now().await;
            Err::<(), _>(Error::other("the sibling"))
        };
        par!(link.run(), fails).await
    });
    assert!(outcome.unwrap_err().to_string().contains("the sibling"));
}
