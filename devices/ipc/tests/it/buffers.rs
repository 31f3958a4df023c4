//! A buffer in front of the sending side.

use crate::child::Program;
use crate::shared::watchdog;
use crate::{Block, block, channel_name, files, run, spawn};
use luna::prelude::*;
use luna_ipc::Endpoint;
use std::path::Path;

#[test]
fn a_fifo_takes_values_before_the_other_program_is_there() {
    let _watchdog = watchdog();
    let name = channel_name("fifo");
    let endpoint = Endpoint::new(&name);
    let (sender, link) = endpoint.buffered_sender::<u64>(Buffer::fifo(4)).unwrap();
    let status = link.status();
    let (filled, full) = std::sync::mpsc::channel();
    let sent = spawn(Policy::Other, link, async move {
        for number in 1..=4 {
            // One decision suffices for an output guard.
            pri_alt! {
                sent = sender.send(number) => sent?,
                skip => panic!("there is room for {number}"),
            }
        }
        assert_eq!(sender.try_send(5).unwrap_err().into_inner(), 5);
        drop(sender);
        filled.send(()).unwrap();
        Ok(())
    });
    full.recv().unwrap();
    assert_eq!((status.has_joined(), status.acknowledged()), (false, 0));
    let (receiver, link) = luna_ipc::receiver::<u64>(&name).unwrap();
    run(Policy::Other, link, async move {
        for number in 1..=4 {
            assert_eq!(receiver.recv().await?, number);
        }
        assert!(receiver.recv().await.is_err_and(|error| error.is_closed()));
        Ok(())
    })
    .unwrap();
    sent.join().unwrap().unwrap();
    assert_eq!((status.acknowledged(), status.number()), (4, 4));
    assert!(files(&name).is_empty());
}

#[test]
fn an_overwriting_buffer_keeps_the_newest() {
    let _watchdog = watchdog();
    let name = channel_name("newest");
    let buffer = Buffer::overwrite_oldest(1);
    let opened = Endpoint::new(&name).buffered_sender::<u64>(buffer);
    let (sender, link) = opened.unwrap();
    for number in 1..=10 {
        sender.try_send(number).unwrap();
    }
    let sent = spawn(Policy::Other, link, async move {
        drop(sender);
        Ok(())
    });
    let (receiver, link) = luna_ipc::receiver::<u64>(&name).unwrap();
    run(Policy::Other, link, async move {
        assert_eq!(receiver.recv().await?, 10);
        assert!(receiver.recv().await.is_err());
        Ok(())
    })
    .unwrap();
    sent.join().unwrap().unwrap();
}

#[test]
fn poison_ends_a_link_that_waits_to_deliver() {
    let _watchdog = watchdog();
    let name = channel_name("undelivered");
    let endpoint = Endpoint::new(&name);
    let (sender, link) = endpoint.buffered_sender::<u64>(Buffer::fifo(4)).unwrap();
    sender.try_send(1).unwrap();
    let ended = run(Policy::Other, link, async move {
        sender.poison();
        Ok(())
    });
    assert!(ended.unwrap_err().is_poisoned());
    assert!(files(&name).is_empty());
}

#[test]
fn a_killed_receiver_poisons_the_buffer() {
    let _watchdog = watchdog();
    let name = channel_name("buffer-hold");
    let mut program = Program::start("hold", &name, Path::new(""));
    let endpoint = Endpoint::new(&name);
    let (sender, link) = endpoint.buffered_sender::<Block>(Buffer::fifo(4)).unwrap();
    let status = link.status();
    let (filled, full) = std::sync::mpsc::channel();
    let sent = spawn(Policy::Other, link, async move {
        // Four in the buffer, and one under way.
        for number in 1..=5 {
            sender.send(block(number)).await?;
        }
        filled.send(()).unwrap();
        let error = sender.send(block(6)).await.unwrap_err();
        assert!(error.is_poisoned());
        assert_eq!(error.into_inner(), block(6));
        Ok(())
    });
    program.wait_until_there();
    full.recv().unwrap();
    program.kill();
    assert!(sent.join().unwrap().is_err());
    assert_eq!(status.acknowledged(), 0);
}
