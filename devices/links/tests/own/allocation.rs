//! Links neither allocate nor free on the real-time path. One test alone, since the allocator
//! counts the whole program.

use crate::common;
use crate::counting;
use common::{SpawnOk, with_files};
use counting::Counting;
use luna::devices::{Device, Sharing};
use luna::external::{BadRecord, Frame, Framing};
use luna::prelude::*;
use luna_links::driver::driver;
use luna_links::{OnBad, Transport, reader, writer};
use std::io;
use std::os::fd::OwnedFd;
use std::os::unix::net::UnixStream;

#[global_allocator]
static ALLOCATOR: Counting = Counting::new();

struct Socket(UnixStream);

impl Transport for Socket {
    fn file(&self) -> io::Result<OwnedFd> {
        Ok(self.0.try_clone()?.into())
    }
}

fn socket(system: &System, name: &str, stream: UnixStream) -> Device<Socket> {
    let devices = system.devices();
    devices
        .open(name, "socket", Sharing::Exclusive, || Ok(Socket(stream)))
        .unwrap()
}

/// Thousands of records both ways, broken ones, calls to a driver, pins, and the end of all of
/// them.
#[test]
fn links_allocate_nothing() {
    let Some(_watch) = with_files() else { return };
    let (near, far) = UnixStream::pair().unwrap();
    let mut system = System::new("quiet");
    let (near, far) = (socket(&system, "near", near), socket(&system, "far", far));
    let (source, outgoing) = luna::channel::<Frame<32>>();
    let (incoming, drain) = luna::channel::<Result<Frame<24>, BadRecord>>();
    let (client, calls) = luna::channel::call_channel::<u32, u32>();
    let places = system.executor("links").build().unwrap();
    let output = writer(&near, outgoing, Framing::lines(31)).unwrap();
    places.process("out").spawn_ok(output);
    let input = reader(&far, incoming, Framing::lines(31))
        .unwrap()
        .on_bad(OnBad::Drop);
    places.process("in").spawn_ok(input);
    let link = driver(&near, (), calls, |(), number| Ok(number + 1));
    places.process("driver").spawn_ok(link);
    pins(&mut system);
    let _links = hop(&places);
    let ends = system.executor("ends").build().unwrap();
    ends.process("source").spawn_ok(async move {
        for length in 0..1000 {
            let record = [b'x'; 31];
            let frame = Frame::new(&record[..length % 32]).unwrap_or_default();
            source.send(frame).await?;
        }
        Ok(())
    });
    ends.process("caller").spawn_ok(async move {
        for number in 0..200 {
            assert_eq!(client.call(number).await?, number + 1);
        }
        Ok(())
    });
    ends.process("drain").spawn_ok(async move {
        let (mut good, mut bad) = (0, 0);
        while good + bad < 1000 {
            match drain.recv().await? {
                Ok(_) => good += 1,
                Err(_) => bad += 1,
            }
        }
        assert_eq!(good, 1000 - 7 * 31);
        Ok(())
    });
    // `near` stays open, or its end would be the loss of `far` before all was received.
    drop(far);
    system.run().unwrap();
    drop(near);
    assert_eq!(ALLOCATOR.on_path(), (0, 0));
    assert!(ALLOCATOR.everywhere().0 > 0, "it does count");
}

#[cfg(feature = "gpio")]
fn pins(system: &mut System) {
    use luna_links::gpio::{self, Chip, Levels, Lines};
    struct Simulated;
    impl Chip for Simulated {
        fn set(&self, _: Levels) -> io::Result<()> {
            Ok(())
        }
        fn get(&self, _: usize) -> io::Result<bool> {
            Ok(false)
        }
        fn edges(&self) -> io::Result<OwnedFd> {
            Err(io::ErrorKind::Unsupported.into())
        }
    }
    let lines = Lines::new("quiet").output(1, false);
    let pins = gpio::open_chip(&system.devices(), "chip", &lines, || Ok(Simulated)).unwrap();
    let (levels, receiver) = luna::channel();
    let place = system.executor("pins").build().unwrap();
    let writer = gpio::writer(&pins, receiver);
    place.process("pins").spawn_ok(writer);
    place.process("levels").spawn_ok(async move {
        for number in 0..1000 {
            levels.send(Levels::NONE.with(0, number % 2 == 0)).await?;
        }
        Ok(())
    });
}

#[cfg(not(feature = "gpio"))]
fn pins(_: &mut System) {}

/// Values both ways between two processes, by both ways of receiving. The links are freed with
/// what is returned, after the run.
#[cfg(feature = "net")]
fn hop(place: &luna::Executor) -> impl Sized {
    use luna_links::cycle::{CycleLink, Settings};
    use std::net::UdpSocket;
    type Link = CycleLink<[u8; 8], [u8; 8]>;
    let sockets = [0, 1].map(|_| UdpSocket::bind("127.0.0.1:0").unwrap());
    let addresses = [0, 1].map(|side: usize| sockets[side].local_addr().unwrap());
    let settings = Settings::new(std::time::Duration::from_secs(30));
    let [here, there] = sockets;
    let mut here = Link::over(here, addresses[1], &settings).unwrap();
    let mut there = Link::over(there, addresses[0], &settings).unwrap();
    let (back, links) = luna::buffered::<Link>(Buffer::fifo(2));
    let also_back = back.clone();
    place.process("near").spawn_ok(async move {
        let mut came = 0;
        while came < 200 {
            here.send(&[1; 8])?;
            came += u32::from(here.newest()?.is_some());
            luna::yield_now().await;
        }
        here.send(&[2; 8])?;
        back.send(here).await.map_err(|_| luna::Error::Closed)
    });
    place.process("far").spawn_ok(async move {
        while there.recv().await?.value != [2; 8] {
            there.send(&[0; 8])?;
        }
        also_back.send(there).await.map_err(|_| luna::Error::Closed)
    });
    links
}

#[cfg(not(feature = "net"))]
fn hop(_: &luna::Executor) -> impl Sized {}
