//! A partner that is killed, at instants that are known.

use crate::child::{Program, now};
use crate::shared::watchdog;
use crate::{Block, block, channel_name, files, run, spawn};
use luna::prelude::*;
use std::path::Path;

/// The link's error, in the error of its system.
fn died(error: &luna::Error, pid: u32) {
    let text = error.to_string();
    assert!(
        text.contains(&format!("process {pid}, has ended without closing it")),
        "{text}"
    );
}

#[test]
fn a_send_whose_receiver_is_killed_gets_its_value_back() {
    let _watchdog = watchdog();
    let name = channel_name("hold");
    let mut program = Program::start("hold", &name, Path::new(""));
    let pid = program.id();
    let (sender, link) = luna_ipc::sender::<Block>(&name).unwrap();
    let (failed, failure) = std::sync::mpsc::channel();
    let sent = spawn(Policy::fifo(30), link, async move {
        let error = sender.send(block(5)).await.unwrap_err();
        failed.send(now()).unwrap();
        assert!(error.is_poisoned());
        assert_eq!(error.into_inner(), block(5));
        Ok(())
    });
    program.wait_until_there();
    let killed = program.kill();
    let noticed = failure.recv().unwrap() - killed;
    println!("a pending send failed {} us after the kill", noticed / 1000);
    died(&sent.join().unwrap().unwrap_err(), pid);
    program.wait();

    // The next session does not see the value, and counts it.
    let (receiver, link) = luna_ipc::receiver::<Block>(&name).unwrap();
    let status = link.status();
    let received = spawn(Policy::Other, link, async move {
        assert_eq!(receiver.recv().await?, block(6));
        Ok(())
    });
    let (sender, link) = luna_ipc::sender::<Block>(&name).unwrap();
    run(Policy::Other, link, async move {
        sender.send(block(6)).await?;
        Ok(())
    })
    .unwrap();
    received.join().unwrap().unwrap();
    // Nobody had the channel open in between, so its numbers have begun anew.
    assert_eq!((status.number(), status.missing()), (1, 0));
    assert!(files(&name).is_empty());
}

#[test]
fn a_receive_whose_sender_is_killed_is_poisoned() {
    let _watchdog = watchdog();
    let name = channel_name("feed");
    let mut program = Program::start("feed", &name, Path::new(""));
    let pid = program.id();
    let (receiver, link) = luna_ipc::receiver::<Block>(&name).unwrap();
    let (failed, failure) = std::sync::mpsc::channel();
    let received = spawn(Policy::fifo(30), link, async move {
        assert_eq!(receiver.recv().await?, block(1));
        assert!(receiver.recv().await.unwrap_err().is_poisoned());
        failed.send(now()).unwrap();
        Ok(())
    });
    program.wait_until_there();
    let killed = program.kill();
    let noticed = failure.recv().unwrap() - killed;
    println!(
        "a pending receive failed {} us after the kill",
        noticed / 1000
    );
    died(&received.join().unwrap().unwrap_err(), pid);
    program.wait();
    assert!(files(&name).is_empty());
}

#[test]
fn numbers_go_on_and_loss_is_counted_while_one_side_stays() {
    let _watchdog = watchdog();
    let name = channel_name("numbers");
    let mut program = Program::start("hold", &name, Path::new(""));
    let (sender, mut link) = luna_ipc::sender::<Block>(&name).unwrap();
    let (joined, restarted) = std::sync::mpsc::channel::<()>();
    let sent = std::thread::spawn(move || {
        luna::run(async move {
            let send = async {
                assert!(sender.send(block(1)).await.is_err());
                Ok::<(), luna::Error>(())
            };
            let carry = async {
                assert!(link.run().await.is_err());
                Ok::<(), luna::Error>(())
            };
            par!(send, carry).await?;
            // The old session is still open here when the restarted receiver comes.
            luna::blocking(move || restarted.recv()).await.unwrap();
            drop(link);
            Ok(())
        })
    });
    program.wait_until_there();
    program.kill();
    program.wait();
    let (receiver, link) = luna_ipc::receiver::<Block>(&name).unwrap();
    joined.send(()).unwrap();
    let status = link.status();
    let received = spawn(Policy::Other, link, async move {
        assert_eq!(receiver.recv().await?, block(2));
        Ok(())
    });
    sent.join().unwrap().unwrap();
    let (sender, link) = luna_ipc::sender::<Block>(&name).unwrap();
    let sender_status = link.status();
    run(Policy::Other, link, async move {
        sender.send(block(2)).await?;
        Ok(())
    })
    .unwrap();
    received.join().unwrap().unwrap();
    for status in [status, sender_status] {
        assert_eq!((status.number(), status.missing()), (2, 1));
        assert_eq!(status.acknowledged(), 1);
    }
    assert!(files(&name).is_empty());
}

#[test]
fn files_of_programs_that_were_all_killed_are_reused_or_removed() {
    let _watchdog = watchdog();
    let _alone = crate::leaving_files();
    for reuse in [false, true] {
        let name = channel_name("left");
        let mut holds = Program::start("hold", &name, Path::new(""));
        let mut feeds = Program::start("feed", &name, Path::new(""));
        holds.wait_until_there();
        // So that it does not notice the other's death, and close in order.
        feeds.stop();
        holds.kill();
        feeds.kill();
        holds.wait();
        feeds.wait();
        assert_eq!(files(&name).len(), 4);
        if reuse {
            // Another type: nothing of the old segment counts.
            drop(luna_ipc::sender::<u64>(&name).unwrap());
        } else {
            assert!(luna_ipc::clean_up().unwrap() >= 1);
        }
        assert!(files(&name).is_empty());
    }
}
