//! The hop to another computer. Both computers are here, each with a socket of its own.

use super::{Places, ROUNDS};
use luna::Buffer;
use luna_links::cycle::{CycleLink, Reading, Settings};
use std::net::UdpSocket;
use std::time::Duration;

type Link = CycleLink<[u8; 8], [u8; 8]>;

fn hop() -> [Link; 2] {
    let sockets = [(); 2].map(|()| UdpSocket::bind("127.0.0.1:0").unwrap());
    let [a, b] = [0, 1].map(|n: usize| sockets[n].local_addr().unwrap());
    // Long enough for a busy machine: neither side is to be taken for silent.
    let settings = Settings::new(Duration::from_secs(10));
    let [left, right] = sockets;
    [
        Link::over(left, b, &settings).unwrap(),
        Link::over(right, a, &settings).unwrap(),
    ]
}

/// A process carries values between the socket and channels.
pub(crate) fn cycles_of_a_link(places: &mut Places) {
    let [left, right] = hop();
    let (values, outgoing) = luna::buffered(Buffer::overwrite_oldest(1));
    let (incoming, unread) = luna::buffered(Buffer::overwrite_oldest(1));
    let link = places.next("left link");
    link.spawn(left.process(outgoing, incoming)).unwrap();
    let (silent, outgoing) = luna::buffered(Buffer::overwrite_oldest(1));
    let (incoming, readings) = luna::channel();
    let link = places.next("right link");
    link.spawn(right.process(outgoing, incoming)).unwrap();
    let (done, is_done) = luna::channel();
    places.process("sends", async move {
        let mut tick = luna::periodic("sends", Duration::from_millis(1))?;
        let mut n = 0;
        while is_done.try_recv().is_err_and(|error| error.is_empty()) {
            n += 1;
            values.send(u64::to_le_bytes(n)).await?;
            tick.next().await;
        }
        luna::realtime::off_path(|| drop((values, is_done, unread)));
        Ok(())
    });
    places.process("receives", async move {
        let mut last = 0;
        for _ in 0..ROUNDS {
            if let Reading::Fresh(sample) = readings.recv().await? {
                let value = u64::from_le_bytes(sample.value);
                assert!(value > last);
                last = value;
            }
        }
        done.send(()).await?;
        luna::realtime::off_path(|| drop((readings, done, silent)));
        Ok(())
    });
}

/// A loop sends and looks itself.
pub(crate) fn cycles_of_a_loop(places: &mut Places) {
    for (name, mut link) in ["left", "right"].into_iter().zip(hop()) {
        places.process(name, async move {
            let mut tick = luna::periodic(name, Duration::from_millis(1))?;
            let mut fresh = 0;
            for n in 0.. {
                let cycle = tick.next().await;
                link.send_in_slot(&u64::to_le_bytes(n), cycle.deadline).map_err(luna::Error::other)?;
                if link.newest().map_err(luna::Error::other)?.is_some() {
                    fresh += 1;
                }
                if fresh >= ROUNDS {
                    break;
                }
            }
            // The partner may need more.
            for n in 0..200 {
                tick.next().await;
                link.send(&u64::to_le_bytes(n)).map_err(luna::Error::other)?;
            }
            luna::realtime::off_path(|| drop((link, tick)));
            Ok(())
        });
    }
}
