//! Closing and poisoning.

use crate::shared::watchdog;
use crate::{networks, run, spawn};
use luna::Policy;
use luna::channel::ChannelEnd;
use luna_net::{Config, Network};

#[test]
fn closing_the_receiving_side_closes_the_sending_one() {
    let _watchdog = watchdog();
    let (here, there) = networks(&Config::loopback());
    let (receiver, link) = there.receiver::<u64>("test/close").unwrap();
    let received = spawn(Policy::Other, link, async move {
        assert_eq!(receiver.recv().await?, 1);
        Ok(())
    });
    let (sender, link) = here.sender::<u64>("test/close").unwrap();
    run(Policy::Other, link, async move {
        sender.send(1).await?;
        let error = sender.send(2).await.unwrap_err();
        assert!(error.is_closed());
        assert_eq!(error.into_inner(), 2);
        Ok(())
    })
    .unwrap();
    received.join().unwrap().unwrap();
}

#[test]
fn poison_crosses_in_both_directions() {
    let _watchdog = watchdog();
    let (here, there) = networks(&Config::loopback());
    for from_sender in [false, true] {
        let (receiver, link) = there.receiver::<u64>("test/poison").unwrap();
        let received = spawn(Policy::Other, link, async move {
            assert_eq!(receiver.recv().await?, 1);
            if from_sender {
                assert!(receiver.recv().await.unwrap_err().is_poisoned());
            } else {
                receiver.poison();
            }
            Ok(())
        });
        let (sender, link) = here.sender::<u64>("test/poison").unwrap();
        let sent = run(Policy::Other, link, async move {
            sender.send(1).await?;
            if from_sender {
                sender.poison();
            } else {
                assert_eq!(sender.ended().await, ChannelEnd::Poisoned);
            }
            Ok(())
        });
        assert!(sent.unwrap_err().is_poisoned());
        assert!(received.join().unwrap().unwrap_err().is_poisoned());
    }
}

#[test]
fn a_link_that_is_dropped_closes_its_channel() {
    let _watchdog = watchdog();
    let (here, there) = networks(&Config::loopback());
    let (receiver, link) = there.receiver::<u64>("test/dropped").unwrap();
    let (sender, other) = here.sender::<u64>("test/dropped").unwrap();
    let status = other.status();
    let sent = spawn(Policy::Other, other, async move {
        assert!(sender.send(1).await.unwrap_err().is_closed());
        Ok(())
    });
    while !status.has_joined() {
        std::thread::yield_now();
    }
    drop((receiver, link));
    sent.join().unwrap().unwrap();
}

#[test]
fn the_end_of_a_side_that_nobody_has_joined_ends_its_link() {
    let _watchdog = watchdog();
    let network = Network::open(&Config::loopback()).unwrap();
    let (sender, link) = network.sender::<u64>("test/alone").unwrap();
    run(Policy::Other, link, async move {
        drop(sender);
        Ok(())
    })
    .unwrap();
    let (receiver, link) = network.receiver::<u64>("test/alone").unwrap();
    run(Policy::Other, link, async move {
        drop(receiver);
        Ok(())
    })
    .unwrap();
    let (sender, link) = network.sender::<u64>("test/alone").unwrap();
    let end = run(Policy::Other, link, async move {
        sender.poison();
        Ok(())
    });
    assert!(end.unwrap_err().is_poisoned());
}
