//! The ends as guards of alternatives, and deadlines.

use crate::shared::watchdog;
use crate::{networks, run, spawn};
use luna::prelude::*;
use luna_net::Config;
use std::time::Duration;

#[test]
fn a_value_that_no_guard_chose_is_not_acknowledged() {
    let _watchdog = watchdog();
    let (here, there) = networks(&Config::loopback());
    let (receiver, link) = there.receiver::<u64>("test/input").unwrap();
    let status = link.status();
    let received = spawn(Policy::Other, link, async move {
        let (local, locals) = luna::buffered(Buffer::fifo(8));
        let mut sum = 0;
        for round in 0..100_u64 {
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
        assert_eq!(sum, (0..100).sum::<u64>());
        Ok(())
    });
    let (sender, link) = here.sender::<u64>("test/input").unwrap();
    run(Policy::Other, link, async move {
        for number in 0..100 {
            sender.send(number).await?;
        }
        Ok(())
    })
    .unwrap();
    received.join().unwrap().unwrap();
}

#[test]
fn a_deadline_is_exact_before_the_other_program_joins() {
    let _watchdog = watchdog();
    let (here, there) = networks(&Config::loopback());
    let (sender, link) = here.sender::<u64>("test/output").unwrap();
    let (joined, join) = std::sync::mpsc::channel();
    let sent = spawn(Policy::Other, link, async move {
        alt! {
            _ = sender.send(1) => panic!("nobody has joined"),
            _ = luna::after(Duration::from_millis(20)) => {}
        }
        // The value is still here.
        let late = sender.send_timeout(2, Duration::from_millis(1)).await;
        assert_eq!(late.unwrap_err().into_inner(), 2);
        joined.send(()).unwrap();
        alt! {
            sent = sender.send(3) => sent?,
            _ = luna::after(Duration::from_secs(60)) => panic!("it has joined"),
        }
        Ok(())
    });
    join.recv().unwrap();
    let (receiver, link) = there.receiver::<u64>("test/output").unwrap();
    run(Policy::Other, link, async move {
        assert_eq!(receiver.recv().await?, 3);
        Ok(())
    })
    .unwrap();
    sent.join().unwrap().unwrap();
}

#[test]
fn a_deadline_after_the_link_has_the_value_leaves_it_in_doubt() {
    let _watchdog = watchdog();
    let (here, there) = networks(&Config::loopback());
    let (receiver, link) = there.receiver::<u64>("test/doubt").unwrap();
    let (go, gone) = std::sync::mpsc::channel::<()>();
    let received = spawn(Policy::Other, link, async move {
        luna::blocking(move || gone.recv()).await.unwrap();
        assert_eq!((receiver.recv().await?, receiver.recv().await?), (1, 2));
        Ok(())
    });
    let (sender, link) = here.sender::<u64>("test/doubt").unwrap();
    let status = link.status();
    run(Policy::Other, link, async move {
        let limit = Duration::from_millis(20);
        // Until the link takes it. Then it is under way, so it returns as sent, and the status says
        // the rest.
        while sender.send_timeout(1, limit).await.is_err() {}
        assert_eq!((status.in_doubt(), status.acknowledged()), (1, 0));
        go.send(()).unwrap();
        sender.send(2).await?;
        assert_eq!((status.in_doubt(), status.acknowledged()), (0, 2));
        Ok(())
    })
    .unwrap();
    received.join().unwrap().unwrap();
}
