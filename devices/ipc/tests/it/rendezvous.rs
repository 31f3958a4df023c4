//! Values, their order, and when each side goes on.

use crate::shared::watchdog;
use crate::{Block, block, channel_name, files, policies, run, spawn};
use luna::Policy;
use luna::channel::ChannelEnd;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering::SeqCst};
use std::sync::mpsc;

#[test]
fn all_values_come_in_order_and_each_send_waits_for_its_taker() {
    let _watchdog = watchdog();
    let cases = policies()
        .into_iter()
        .flat_map(|policy| [(policy, 0), (policy, 50)]);
    for (policy, looks) in cases {
        let name = channel_name("order");
        let taken = Arc::new(AtomicU64::new(0));
        let (receiver, link) = luna_ipc::receiver::<Block>(&name).unwrap();
        let link = link.looks(looks);
        let taking = taken.clone();
        let received = spawn(policy, link, async move {
            for number in 1..=500 {
                // The sender goes on when this is finished.
                let value = receiver.recv_extended().await?;
                assert_eq!(*value, block(number));
                taking.store(number, SeqCst);
                drop(value);
            }
            assert!(receiver.recv().await.is_err_and(|error| error.is_closed()));
            Ok(())
        });
        let (sender, link) = luna_ipc::sender::<Block>(&name).unwrap();
        let link = link.looks(looks);
        let status = link.status();
        run(policy, link, async move {
            for number in 1..=500 {
                sender.send(block(number)).await?;
                assert_eq!(taken.load(SeqCst), number);
            }
            Ok(())
        })
        .unwrap();
        received.join().unwrap().unwrap();
        assert_eq!((status.acknowledged(), status.number()), (500, 500));
        assert_eq!(status.missing(), 0);
        assert_eq!(status.partner(), Some(std::process::id()));
        assert!(files(&name).is_empty(), "{:?}", files(&name));
    }
}

#[test]
fn either_side_may_come_first() {
    let _watchdog = watchdog();
    for sender_first in [false, true] {
        let name = channel_name("first");
        let (is_open, opened) = mpsc::channel();
        let (go, gone) = mpsc::channel::<()>();
        let other = name.clone();
        let feeder = std::thread::spawn(move || {
            if !sender_first {
                gone.recv().unwrap();
            }
            let (sender, link) = luna_ipc::sender::<u64>(&other).unwrap();
            let _ = is_open.send(());
            run(Policy::Other, link, async move {
                sender.send(7).await?;
                Ok(())
            })
        });
        if sender_first {
            opened.recv().unwrap();
        }
        let (receiver, link) = luna_ipc::receiver::<u64>(&name).unwrap();
        if !sender_first {
            go.send(()).unwrap();
        }
        run(Policy::Other, link, async move {
            assert_eq!(receiver.recv().await?, 7);
            Ok(())
        })
        .unwrap();
        feeder.join().unwrap().unwrap();
    }
}

#[test]
fn large_and_empty_values() {
    let _watchdog = watchdog();
    let (large, empty) = (channel_name("large"), channel_name("empty"));
    let (receiver, link) = luna_ipc::receiver::<[u64; 4096]>(&large).unwrap();
    let received = spawn(Policy::Other, link, async move {
        let value = receiver.recv().await?;
        assert!((0..4096).all(|n| value[n as usize] == n));
        Ok(())
    });
    let (sender, link) = luna_ipc::sender::<[u64; 4096]>(&large).unwrap();
    run(Policy::Other, link, async move {
        sender.send(std::array::from_fn(|n| n as u64)).await?;
        Ok(())
    })
    .unwrap();
    received.join().unwrap().unwrap();

    let (receiver, link) = luna_ipc::receiver::<()>(&empty).unwrap();
    let received = spawn(Policy::Other, link, async move {
        receiver.recv().await?;
        Ok(())
    });
    let (sender, link) = luna_ipc::sender::<()>(&empty).unwrap();
    run(Policy::Other, link, async move {
        sender.send(()).await?;
        Ok(())
    })
    .unwrap();
    received.join().unwrap().unwrap();
}

#[test]
fn the_end_of_a_side_that_nobody_has_joined_ends_its_link() {
    let _watchdog = watchdog();
    let name = channel_name("alone");
    let (sender, link) = luna_ipc::sender::<u64>(&name).unwrap();
    run(Policy::Other, link, async move {
        drop(sender);
        Ok(())
    })
    .unwrap();
    let (receiver, link) = luna_ipc::receiver::<u64>(&name).unwrap();
    run(Policy::Other, link, async move {
        drop(receiver);
        Ok(())
    })
    .unwrap();
    let (sender, link) = luna_ipc::sender::<u64>(&name).unwrap();
    let end = run(Policy::Other, link, async move {
        sender.poison();
        Ok(())
    });
    assert!(end.unwrap_err().is_poisoned());
    assert!(files(&name).is_empty());
}

#[test]
fn closing_the_receiving_side_closes_the_sending_one() {
    let _watchdog = watchdog();
    let name = channel_name("close");
    let (receiver, link) = luna_ipc::receiver::<u64>(&name).unwrap();
    let received = spawn(Policy::Other, link, async move {
        assert_eq!(receiver.recv().await?, 1);
        Ok(())
    });
    let (sender, link) = luna_ipc::sender::<u64>(&name).unwrap();
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
    for from_sender in [false, true] {
        let name = channel_name("poison");
        let (receiver, link) = luna_ipc::receiver::<u64>(&name).unwrap();
        let received = spawn(Policy::Other, link, async move {
            assert_eq!(receiver.recv().await?, 1);
            if from_sender {
                assert!(receiver.recv().await.unwrap_err().is_poisoned());
            } else {
                receiver.poison();
            }
            Ok(())
        });
        let (sender, link) = luna_ipc::sender::<u64>(&name).unwrap();
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
        assert!(files(&name).is_empty());
    }
}
