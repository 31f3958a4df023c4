//! External channels: records through pipes and sockets.

#![cfg(unix)]

use crate::common;
use common::{PLACEMENTS, Placement, SpawnOk, with_ends};
use luna::external::{Frame, Framing, FromBytes, Malformed, Prefix, ToBytes};
use luna::prelude::*;
use luna::process::IntoProcess;
use luna::{Buffer, Error, Report};
use std::io::{Read, Write};
use std::os::unix::net::{UnixDatagram, UnixStream};

/// Runs a link at `place`, and a process beside it on a thread.
pub(crate) fn run_beside_thread<M>(
    place: Placement,
    name: &str,
    link: impl IntoProcess<M>,
    other: impl Future<Output = luna::Result<()>> + Send + 'static,
) -> luna::Result<Report> {
    let mut system = System::new("beside a thread");
    place.process(&mut system, "place", name).spawn_ok(link);
    system.thread("other").process("other").spawn_ok(other);
    system.run()
}

/// Runs a link and another process on one executor.
pub(crate) fn run_on_one<M>(
    name: &str,
    link: impl IntoProcess<M>,
    other: impl Future<Output = luna::Result<()>> + Send + 'static,
) -> luna::Result<Report> {
    let mut system = System::new("on one executor");
    let main = system.executor("main").build()?;
    main.process(name).spawn_ok(link);
    main.process("other").spawn_ok(other);
    system.run()
}

#[derive(Debug, Clone, Copy, PartialEq)]
struct Pose {
    number: u32,
    angle: f64,
}

impl Pose {
    fn number(number: u32) -> Pose {
        Pose {
            number,
            angle: f64::from(number) / 8.0,
        }
    }
}

impl FromBytes for Pose {
    fn from_bytes(bytes: &[u8]) -> Result<Pose, Malformed> {
        let (number, angle) = bytes.split_at(4);
        Ok(Pose {
            number: u32::from_le_bytes(FromBytes::from_bytes(number)?),
            angle: f64::from_le_bytes(FromBytes::from_bytes(angle)?),
        })
    }
}

impl ToBytes for Pose {
    fn length(&self) -> usize {
        12
    }

    fn to_bytes(&self, to: &mut [u8]) {
        to[..4].copy_from_slice(&self.number.to_le_bytes());
        to[4..].copy_from_slice(&self.angle.to_le_bytes());
    }
}

/// A source, a link to one end of a socket, a link from the other, and a drain: typed values go
/// around, with links at each place.
#[test]
fn typed_values_go_out_and_come_in() {
    let Some(_watch) = with_ends() else { return };
    const COUNT: u32 = 2000;
    for out_place in PLACEMENTS {
        for in_place in PLACEMENTS {
            for framing in [Framing::fixed(12), Framing::prefixed(Prefix::U16Big, 12)] {
                let (near, far) = UnixStream::pair().unwrap();
                let (source, outgoing) = luna::channel::<Pose>();
                let (incoming, drain) = luna::channel::<Pose>();
                let mut system = System::new("around");
                out_place
                    .process(&mut system, "out", "output")
                    .spawn_ok(luna::external::output(outgoing, near, framing));
                in_place
                    .process(&mut system, "in", "input")
                    .spawn_ok(luna::external::input(far, incoming, framing));
                let ends = system.executor("ends").build().unwrap();
                ends.process("source").spawn_ok(async move {
                    for number in 0..COUNT {
                        source.send(Pose::number(number)).await?;
                    }
                    Ok(())
                });
                ends.process("drain").spawn_ok(async move {
                    for number in 0..COUNT {
                        assert_eq!(drain.recv().await?, Pose::number(number));
                    }
                    // The end of the source goes through both links and the file between them.
                    assert!(drain.recv().await.unwrap_err().is_closed());
                    Ok(())
                });
                system.run().unwrap();
            }
        }
    }
}

/// Records longer than what the file takes or gives at once: each write and each read is partial.
#[test]
fn records_longer_than_the_pipe() {
    let Some(_watch) = with_ends() else { return };
    // A pipe takes 64 KiB.
    const SIZE: usize = 150_000;
    struct Pattern(u8);
    impl ToBytes for Pattern {
        fn length(&self) -> usize {
            SIZE
        }
        fn to_bytes(&self, to: &mut [u8]) {
            for (index, byte) in to.iter_mut().enumerate() {
                *byte = (index as u8).wrapping_mul(3) ^ self.0;
            }
        }
    }
    impl FromBytes for Pattern {
        fn from_bytes(bytes: &[u8]) -> Result<Self, Malformed> {
            let first = bytes[0];
            let mut expected = vec![0; SIZE];
            Pattern(first).to_bytes(&mut expected);
            assert!(bytes == expected);
            Ok(Pattern(first))
        }
    }
    for framing in [
        Framing::fixed(SIZE),
        Framing::prefixed(Prefix::U32Little, SIZE),
    ] {
        let (reading, writing) = std::io::pipe().unwrap();
        let (source, outgoing) = luna::channel();
        let (incoming, drain) = luna::channel::<Pattern>();
        let mut system = System::new("long");
        // On one executor: each must let the other run when it is at its wits' end.
        let executor = system.executor("main").build().unwrap();
        executor
            .process("output")
            .spawn_ok(luna::external::output(outgoing, writing, framing));
        executor
            .process("input")
            .spawn_ok(luna::external::input(reading, incoming, framing));
        executor.process("both").spawn_ok(async move {
            let send = async {
                for number in 0..8 {
                    source.send(Pattern(number)).await?;
                }
                Ok(())
            };
            let receive = async {
                for number in 0..8 {
                    assert_eq!(drain.recv().await?.0, number);
                }
                Ok(())
            };
            par!(send, receive).await?;
            Ok(())
        });
        system.run().unwrap();
    }
}

#[test]
fn bytes_that_come_one_by_one() {
    let Some(_watch) = with_ends() else { return };
    for place in PLACEMENTS {
        let (near, mut far) = std::io::pipe().unwrap();
        let (sender, lines) = luna::channel::<Frame<8>>();
        let (next, go) = luna::channel::<()>();
        let mut system = System::new("slow");
        place
            .process(&mut system, "place", "input")
            .spawn_ok(luna::external::input(near, sender, Framing::lines(8)));
        system.thread("far").process("far").spawn_ok(async move {
            for byte in b"one\ntwo\r\n" {
                go.recv().await?;
                far.write_all(&[*byte])?;
            }
            Ok(())
        });
        system
            .executor("reader")
            .build()
            .unwrap()
            .process("reader")
            .spawn_ok(async move {
                for (line, bytes) in [("one", 4), ("two", 5)] {
                    for _ in 0..bytes {
                        assert!(lines.try_recv().is_err_and(|error| error.is_empty()));
                        next.send(()).await?;
                    }
                    assert_eq!(lines.recv().await?.text(), Ok(line));
                }
                assert!(lines.recv().await.unwrap_err().is_closed());
                Ok(())
            });
        system.run().unwrap();
    }
}

#[test]
fn chunks_are_all_the_bytes() {
    let Some(_watch) = with_ends() else { return };
    let text: Vec<u8> = (0..100_000_u32)
        .map(|n| (n.wrapping_mul(n) % 251) as u8)
        .collect();
    let (near, mut far) = UnixStream::pair().unwrap();
    let own = text.clone();
    let writer = std::thread::spawn(move || far.write_all(&own).unwrap());
    let (sender, chunks) = luna::buffered::<Frame<500>>(Buffer::fifo(3));
    let link = luna::external::input(near, sender, Framing::chunks(500));
    let reader = async move {
        let mut got = Vec::new();
        while let Ok(chunk) = chunks.recv().await {
            assert!((1..=500).contains(&chunk.len()));
            got.extend_from_slice(&chunk);
        }
        assert_eq!(got, text);
        Ok(())
    };
    run_on_one("input", link, reader).unwrap();
    writer.join().unwrap();
}

#[test]
fn packets_stay_apart() {
    let Some(_watch) = with_ends() else { return };
    type Got = Result<Frame<4>, luna::external::BadRecord>;
    let (near, far) = UnixDatagram::pair().unwrap();
    for packet in [&b"a"[..], b"bcde", b"too long", b"f"] {
        far.send(packet).unwrap();
    }
    let (sender, packets) = luna::channel::<Got>();
    let link = luna::external::input(near, sender, Framing::packets(4));
    let reader = async move {
        assert_eq!(&**packets.recv().await?.as_ref().unwrap(), b"a");
        assert_eq!(&**packets.recv().await?.as_ref().unwrap(), b"bcde");
        let bad = packets.recv().await?.unwrap_err();
        assert_eq!(bad.number, 3);
        assert_eq!(bad.fault, luna::external::Fault::TooLong { most: 4 });
        assert_eq!(&**packets.recv().await?.as_ref().unwrap(), b"f");
        far.send(b"").map_err(Error::other)?;
        assert!(packets.recv().await.unwrap_err().is_closed());
        Ok(())
    };
    run_on_one("input", link, reader).unwrap();
}

/// A device is read and written at once, by two links with clones of the file.
#[test]
fn both_directions_of_one_socket() {
    let Some(_watch) = with_ends() else { return };
    let (near, mut far) = UnixStream::pair().unwrap();
    let echo = std::thread::spawn(move || {
        let mut byte = [0];
        while far.read(&mut byte).unwrap() > 0 {
            far.write_all(&byte).unwrap();
        }
    });
    let (source, outgoing) = luna::channel::<[u8; 2]>();
    let (incoming, drain) = luna::channel::<[u8; 2]>();
    let framing = Framing::fixed(2);
    let mut system = System::new("both");
    let executor = system.executor("main").build().unwrap();
    let clone = near.try_clone().unwrap();
    executor
        .process("output")
        .spawn_ok(luna::external::output(outgoing, clone, framing));
    executor
        .process("input")
        .spawn_ok(luna::external::input(near, incoming, framing));
    executor.process("asks").spawn_ok(async move {
        for number in 0..100 {
            source.send([number, 1]).await?;
            assert_eq!(drain.recv().await?, [number, 1]);
        }
        Ok(())
    });
    // The input's file is open while the input waits. Only the end of its channel stops it.
    system.run().unwrap();
    echo.join().unwrap();
}

/// The channel of a link is one as any: a guard among others, at both of its ends.
#[test]
fn external_channels_are_guards() {
    let Some(_watch) = with_ends() else { return };
    let (reading, writing) = std::io::pipe().unwrap();
    let (source, outgoing) = luna::channel::<[u8; 1]>();
    let (incoming, drain) = luna::channel::<[u8; 1]>();
    let mut system = System::new("guards");
    let links = system.executor("links").build().unwrap();
    links
        .process("output")
        .spawn_ok(luna::external::output(outgoing, writing, Framing::fixed(1)));
    links
        .process("input")
        .spawn_ok(luna::external::input(reading, incoming, Framing::fixed(1)));
    let executor = system.executor("main").build().unwrap();
    executor.process("both").spawn_ok(async move {
        let (mut sent, mut received) = (0, 0);
        while received < 100 {
            luna::alt! {
                result = source.send([sent]), if sent < 100 => { result?; sent += 1; }
                byte = drain.recv() => { assert_eq!(byte?, [received]); received += 1; }
            }
        }
        Ok(())
    });
    system.run().unwrap();
}
