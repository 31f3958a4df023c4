//! Messages that anybody may send where a channel waits, and while it works.

use crate::shared::{Random, watchdog};
use crate::{address, spawn};
use luna::Policy;
use luna_net::{Config, Network, Status};
use std::sync::mpsc;
use std::time::Duration;
use zenoh::{Session, Wait};

/// A program of zenoh that is none of LUNA, connected to this address.
fn stranger(address: &str) -> Session {
    let mut config = zenoh::Config::default();
    for (key, value) in [
        ("mode", "\"peer\"".to_owned()),
        ("connect/endpoints", format!("[\"{address}\"]")),
        ("listen/endpoints", "[]".to_owned()),
        ("scouting/multicast/enabled", "false".to_owned()),
    ] {
        config.insert_json5(key, &value).unwrap();
    }
    zenoh::open(config).wait().unwrap()
}

/// Publishes until the side has dropped so many more.
fn until_dropped(status: &Status, count: u64, mut publish: impl FnMut()) {
    let end = status.dropped() + count;
    while status.dropped() < end {
        publish();
        std::thread::yield_now();
    }
}

/// What a side says while it waits.
fn hello_on(stranger: &Session, key: &str) -> Vec<u8> {
    let (found, heard) = mpsc::channel();
    let _subscriber = stranger
        .declare_subscriber(key.to_owned())
        .callback(move |sample| drop(found.send(sample.payload().to_bytes().into_owned())))
        .wait()
        .unwrap();
    heard.recv().unwrap()
}

#[test]
fn broken_messages_end_no_channel_that_waits_and_are_counted() {
    let _watchdog = watchdog();
    let address = address();
    // A busy machine is no reason to lose a partner.
    let config = Config::loopback().lost_after(Duration::from_secs(8));
    let here = Network::open(&config.clone().listen(&address)).unwrap();
    let (sender, link) = here.sender::<u64>("test/broken").unwrap();
    let status = link.status();
    let (told, joined) = mpsc::channel();
    let sent = spawn(Policy::Other, link, async move {
        for value in 0..200 {
            sender.send(value).await?;
            let _ = told.send(());
        }
        Ok(())
    });

    let stranger = stranger(&address);
    let hello = hello_on(&stranger, "luna/test/broken/from-sender");
    let to = "luna/test/broken/from-receiver";
    let put = |bytes: Vec<u8>| stranger.put(to, bytes).wait().unwrap();
    let mut random = Random::seeded();
    // As bytes get damaged: one of them, a part of them, all of them.
    until_dropped(&status, 500, || {
        let mut bytes = hello.clone();
        match random.below(4_u8) {
            0 => bytes.truncate(random.below(bytes.len())),
            1 => bytes
                .iter_mut()
                .for_each(|byte| *byte = random.next() as u8),
            _ => {
                let place = random.below(bytes.len());
                bytes[place] ^= 1 << random.below(8_u8);
            }
        }
        put(bytes);
    });
    assert!(!status.has_joined());
    until_dropped(&status, 1, || put(b"lunanet1, of old".to_vec()));
    assert!(status.has_heard_other_version());

    // The partner comes, and values pass beside more of them.
    let there = Network::open(&config.connect(&address)).unwrap();
    let (receiver, link) = there.receiver::<u64>("test/broken").unwrap();
    let received = spawn(Policy::Other, link, async move {
        for value in 0..200 {
            assert_eq!(receiver.recv().await?, value);
        }
        assert!(receiver.recv().await.is_err_and(|error| error.is_closed()));
        Ok(())
    });
    let mut count = 0;
    for () in joined {
        put(hello[..hello.len() - 1].to_vec());
        count += 1;
    }
    assert_eq!(count, 200);
    received.join().unwrap().unwrap();
    sent.join().unwrap().unwrap();
    assert_eq!(status.acknowledged(), 200);
}
