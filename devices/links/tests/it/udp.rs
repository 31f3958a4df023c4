//! UDP on loopback: packets that are broken, refused, or too many.

#![cfg(feature = "net")]

use crate::common;
use common::{SpawnOk, watchdog, with_files};
use luna::devices::{DeviceError, DeviceState, OnLoss};
use luna::external::{BadRecord, Fault, Frame, Framing};
use luna::prelude::*;
use luna_links::{OnBad, reader, udp, writer};
use std::net::{SocketAddr, UdpSocket};

const ANY: &str = "127.0.0.1:0";

fn any() -> SocketAddr {
    ANY.parse().unwrap()
}

#[test]
fn packets_are_values_and_broken_ones_are_reported_in_order() {
    let Some(_watch) = with_files() else { return };
    let far = UdpSocket::bind(any()).unwrap();
    let mut system = System::new("udp");
    let devices = system.devices();
    let port = udp::open(&devices, any(), Some(far.local_addr().unwrap())).unwrap();
    far.connect(port.local_address().unwrap()).unwrap();
    let (sender, packets) = luna::channel::<Result<Frame<8>, BadRecord>>();
    let (answers, receiver) = luna::channel::<Frame<8>>();
    let input = reader(&port, sender, Framing::packets(8)).unwrap();
    let counts = input.counts();
    let main = system.executor("main").build().unwrap();
    main.process("in").spawn_ok(input);
    let output = writer(&port, receiver, Framing::packets(8)).unwrap();
    main.process("out").spawn_ok(output);
    main.process("user").spawn_ok(async move {
        assert_eq!(packets.recv().await?.unwrap()[..], *b"one");
        let bad = packets.recv().await?.unwrap_err();
        assert_eq!(bad.fault, Fault::TooLong { most: 8 });
        assert_eq!(packets.recv().await?.unwrap()[..], *b"two");
        answers.send(Frame::new(b"three").unwrap()).await?;
        Ok(())
    });
    drop(port);
    for packet in [&b"one"[..], b"", b"nine bytes", b"two"] {
        far.send(packet).unwrap();
    }
    system.run().unwrap();
    let mut answer = [0; 20];
    let length = far.recv(&mut answer).unwrap();
    assert_eq!(&answer[..length], b"three");
    // The empty one, too.
    assert_eq!((counts.records(), counts.bad()), (2, 2));
    assert_eq!(devices.list()[0].state, DeviceState::Closed);
}

#[test]
fn a_missing_peer_is_counted_and_no_loss() {
    let Some(_watch) = with_files() else { return };
    // A port that was just free.
    let gone = UdpSocket::bind(any()).unwrap().local_addr().unwrap();
    let mut system = System::new("no peer");
    let port = udp::open(&system.devices(), any(), Some(gone)).unwrap();
    let (values, receiver) = luna::channel::<[u8; 2]>();
    let output = writer(&port, receiver, Framing::packets(2)).unwrap();
    let counts = output.counts();
    let main = system.executor("main").build().unwrap();
    main.process("out").spawn_ok(output);
    let link = counts.clone();
    main.process("source").spawn_ok(async move {
        // A refusal is reported at the next packet.
        for _ in 0..100 {
            values.send([1, 2]).await?;
        }
        Ok(())
    });
    drop(port);
    system.run().unwrap();
    assert!(link.refused() > 0, "{link:?}");
    assert_eq!(link.refused() + link.records(), 100);
}

#[test]
fn a_reader_that_is_slow_gets_the_newest_value_and_nothing_grows() {
    let Some(_watch) = with_files() else { return };
    let far = UdpSocket::bind(any()).unwrap();
    let mut system = System::new("flood");
    let port = udp::open(&system.devices(), any(), Some(far.local_addr().unwrap())).unwrap();
    port.on_loss(OnLoss::Fail);
    far.connect(port.local_address().unwrap()).unwrap();
    let (sender, speeds) = luna::buffered::<[u8; 4]>(Buffer::overwrite_oldest(1));
    let input = reader(&port, sender, Framing::packets(4))
        .unwrap()
        .on_bad(OnBad::Drop);
    let counts = input.counts();
    let main = system.executor("main").build().unwrap();
    main.process("in").spawn_ok(input);
    main.process("control").spawn_ok(async move {
        // Behind all that came before it was read.
        while counts.records() < 50 {
            luna::yield_now().await;
        }
        assert_eq!(speeds.recv().await?, 49_u32.to_be_bytes());
        Ok(())
    });
    for number in 0..50_u32 {
        far.send(&number.to_be_bytes()).unwrap();
    }
    system.run().unwrap();
    drop(port);
}

#[test]
fn a_port_that_is_taken_is_busy_and_an_address_of_others_is_missing() {
    let _watch = watchdog();
    let taken = UdpSocket::bind(any()).unwrap();
    let system = System::new("busy");
    let devices = system.devices();
    let opened = udp::open(&devices, taken.local_addr().unwrap(), None);
    assert!(
        matches!(opened, Err(DeviceError::Busy { .. })),
        "{opened:?}"
    );
    // An address for documentation, which no machine has.
    let opened = udp::open(&devices, "192.0.2.1:9".parse().unwrap(), None);
    assert!(
        matches!(opened, Err(DeviceError::Missing { .. })),
        "{opened:?}"
    );
}
