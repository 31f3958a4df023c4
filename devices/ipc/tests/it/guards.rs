//! The ends as guards of alternatives.

use crate::shared::watchdog;
use crate::{channel_name, run, spawn};
use luna::prelude::*;
use std::time::Duration;

#[test]
fn a_value_that_no_guard_chose_is_not_acknowledged() {
    let _watchdog = watchdog();
    let name = channel_name("input");
    let (receiver, link) = luna_ipc::receiver::<u64>(&name).unwrap();
    let status = link.status();
    let received = spawn(Policy::Other, link, async move {
        let (local, locals) = luna::buffered(Buffer::fifo(8));
        let mut sum = 0;
        for round in 0..200_u64 {
            local.send(1000).await?;
            // The local guard is ready and comes first: the other stays where it is.
            pri_alt! {
                value = locals.recv() => assert_eq!(value?, 1000),
                _ = receiver.recv() => panic!("it was not to be chosen"),
            }
            assert_eq!(status.acknowledged(), round);
            alt! {
                value = receiver.recv() => sum += value?,
                _ = locals.recv() => panic!("there is none"),
            }
        }
        let mut alternative = Alternative::fair(std::slice::from_ref(&receiver));
        let (_, value) = alternative.recv().await;
        assert_eq!((value?, sum), (200, (0..200).sum()));
        Ok(())
    });
    let (sender, link) = luna_ipc::sender::<u64>(&name).unwrap();
    run(Policy::Other, link, async move {
        for number in 0..=200 {
            sender.send(number).await?;
        }
        Ok(())
    })
    .unwrap();
    received.join().unwrap().unwrap();
}

#[test]
fn an_output_guard_is_not_chosen_before_the_other_program_joins() {
    let _watchdog = watchdog();
    let name = channel_name("output");
    let (sender, link) = luna_ipc::sender::<u64>(&name).unwrap();
    let (joined, join) = std::sync::mpsc::channel();
    let sent = spawn(Policy::Other, link, async move {
        let mut chosen = 0;
        alt! {
            _ = sender.send(1) => panic!("nobody has joined"),
            _ = luna::after(Duration::from_millis(20)) => chosen += 1,
        }
        // Exact: the value is still here.
        let late = sender.send_timeout(2, Duration::from_millis(1)).await;
        assert_eq!(late.unwrap_err().into_inner(), 2);
        joined.send(()).unwrap();
        alt! {
            sent = sender.send(3) => { sent?; chosen += 1 }
            _ = luna::after(Duration::from_secs(60)) => panic!("it has joined"),
        }
        assert_eq!(chosen, 2);
        Ok(())
    });
    join.recv().unwrap();
    let (receiver, link) = luna_ipc::receiver::<u64>(&name).unwrap();
    run(Policy::Other, link, async move {
        assert_eq!(receiver.recv().await?, 3);
        Ok(())
    })
    .unwrap();
    sent.join().unwrap().unwrap();
}
