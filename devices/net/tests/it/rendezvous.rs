//! Values, their order, and when each side goes on.

use crate::shared::watchdog;
use crate::{networks, run, spawn};
use luna::Policy;
use luna_net::Config;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering::SeqCst};

#[test]
fn all_values_come_in_order_and_each_send_waits_for_its_taker() {
    let _watchdog = watchdog();
    let (here, there) = networks(&Config::loopback());
    for policy in [Policy::Other, Policy::fifo(30)] {
        let taken = Arc::new(AtomicU64::new(0));
        let (receiver, link) = there.receiver::<(u64, String)>("test/order").unwrap();
        let taking = taken.clone();
        let received = spawn(policy, link, async move {
            for number in 1..=300 {
                // The sender goes on when this is finished.
                let value = receiver.recv_extended().await?;
                assert_eq!(*value, (number, number.to_string()));
                taking.store(number, SeqCst);
                drop(value);
            }
            assert!(receiver.recv().await.is_err_and(|error| error.is_closed()));
            Ok(())
        });
        let (sender, link) = here.sender::<(u64, String)>("test/order").unwrap();
        let status = link.status();
        run(policy, link, async move {
            for number in 1..=300 {
                sender.send((number, number.to_string())).await?;
                assert_eq!(taken.load(SeqCst), number);
            }
            Ok(())
        })
        .unwrap();
        received.join().unwrap().unwrap();
        assert_eq!((status.acknowledged(), status.in_doubt()), (300, 0));
        let partner = status.partner().unwrap();
        assert_eq!(partner.pid, std::process::id());
    }
}

#[test]
fn either_side_may_come_first() {
    let _watchdog = watchdog();
    let (here, there) = networks(&Config::loopback());
    for sender_first in [false, true] {
        let (is_open, opened) = std::sync::mpsc::channel();
        let network = here.clone();
        let send = move || {
            let (sender, link) = network.sender::<u64>("test/first").unwrap();
            is_open.send(()).unwrap();
            run(Policy::Other, link, async move {
                sender.send(7).await?;
                Ok(())
            })
        };
        let (receiver, link, sent);
        if sender_first {
            sent = std::thread::spawn(send);
            opened.recv().unwrap();
            (receiver, link) = there.receiver::<u64>("test/first").unwrap();
        } else {
            (receiver, link) = there.receiver::<u64>("test/first").unwrap();
            sent = std::thread::spawn(send);
        }
        run(Policy::Other, link, async move {
            assert_eq!(receiver.recv().await?, 7);
            Ok(())
        })
        .unwrap();
        sent.join().unwrap().unwrap();
    }
}

#[test]
fn both_sides_may_be_in_one_network() {
    let _watchdog = watchdog();
    let (here, _there) = networks(&Config::loopback());
    let (receiver, link) = here.receiver::<()>("test/local").unwrap();
    let received = spawn(Policy::Other, link, async move {
        receiver.recv().await?;
        Ok(())
    });
    let (sender, link) = here.sender::<()>("test/local").unwrap();
    run(Policy::Other, link, async move {
        sender.send(()).await?;
        Ok(())
    })
    .unwrap();
    received.join().unwrap().unwrap();
}

#[test]
fn values_larger_than_a_message_of_the_transport() {
    let _watchdog = watchdog();
    let (here, there) = networks(&Config::loopback());
    let (receiver, link) = there.receiver::<Vec<u32>>("test/large").unwrap();
    let received = spawn(Policy::Other, link, async move {
        let value = receiver.recv().await?;
        assert!(value.iter().copied().eq(0..300_000));
        Ok(())
    });
    let endpoint = here.endpoint("test/large").capacity(2_000_000);
    let (sender, link) = endpoint.sender::<Vec<u32>>().unwrap();
    run(Policy::Other, link, async move {
        sender.send((0..300_000).collect()).await?;
        Ok(())
    })
    .unwrap();
    received.join().unwrap().unwrap();
}
