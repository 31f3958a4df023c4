//! Streams: order, back pressure, the newest value, and how old values are.

use crate::shared::watchdog;
use crate::{networks, run, spawn};
use luna::Policy;
use luna::prelude::*;
use luna_net::{Config, Stamped};
use std::sync::mpsc;
use std::time::Duration;

#[test]
fn a_stream_keeps_its_order_and_is_delivered_before_it_closes() {
    let _watchdog = watchdog();
    let (here, there) = networks(&Config::loopback());
    let (receiver, link) = there
        .endpoint("test/stream")
        .buffered_receiver::<u64>(Buffer::fifo(16))
        .unwrap();
    let received = spawn(Policy::fifo(30), link, async move {
        for number in 1..=20_000 {
            let value = receiver.recv().await?;
            assert_eq!((*value.get(), value.number()), (number, number));
            // One computer, one clock: the age is exact.
            let (way, age) = (value.under_way(), value.age());
            assert_eq!(way.at_most, Some(way.at_least));
            assert!(age.at_least >= way.at_least);
            assert!(age.at_least < Duration::from_secs(60));
        }
        assert!(receiver.recv().await.is_err_and(|error| error.is_closed()));
        Ok(())
    });
    let endpoint = here.endpoint("test/stream").capacity(16);
    let (sender, link) = endpoint.buffered_sender::<u64>(Buffer::fifo(16)).unwrap();
    let status = link.status();
    run(Policy::fifo(30), link, async move {
        for number in 1..=20_000 {
            sender.send(number).await?;
        }
        Ok(())
    })
    .unwrap();
    received.join().unwrap().unwrap();
    assert_eq!((status.acknowledged(), status.in_doubt()), (20_000, 0));
}

#[test]
fn back_pressure_reaches_the_sender() {
    let _watchdog = watchdog();
    let (here, there) = networks(&Config::loopback());
    let (receiver, link) = there.receiver::<u64>("test/pressure").unwrap();
    let (go, gone) = mpsc::channel::<()>();
    let received = spawn(Policy::Other, link, async move {
        luna::blocking(move || gone.recv()).await.unwrap();
        for number in 1..=13 {
            assert_eq!(receiver.recv().await?, number);
        }
        Ok(())
    });
    let endpoint = here.endpoint("test/pressure").window(8);
    let (sender, link) = endpoint.buffered_sender::<u64>(Buffer::fifo(4)).unwrap();
    run(Policy::Other, link, async move {
        let mut number = 1;
        let limit = Duration::from_secs(2);
        while sender.send_timeout(number, limit).await.is_ok() {
            number += 1;
        }
        // Eight under way, and four in the buffer.
        assert_eq!(number, 13);
        go.send(()).unwrap();
        sender.send(number).await?;
        Ok(())
    })
    .unwrap();
    received.join().unwrap().unwrap();
}

#[test]
fn the_newest_value_is_there_and_no_one_waits_for_it() {
    let _watchdog = watchdog();
    let (here, there) = networks(&Config::loopback());
    let newest = Buffer::overwrite_oldest(1);
    let (receiver, link) = there
        .endpoint("test/newest")
        .buffered_receiver::<u64>(newest)
        .unwrap();
    let received = spawn(Policy::Other, link, async move {
        let mut last = 0;
        while let Ok(value) = receiver.recv().await {
            let value: Stamped<u64> = value;
            assert!(*value.get() > last);
            last = value.into_inner();
        }
        assert_eq!(last, 10_000);
        Ok(())
    });
    let endpoint = here.endpoint("test/newest").window(2);
    let (sender, link) = endpoint.buffered_sender::<u64>(newest).unwrap();
    let status = link.status();
    run(Policy::Other, link, async move {
        for number in 1..=10_000 {
            sender.try_send(number).unwrap();
            if number % 16 == 0 {
                luna::yield_now().await;
            }
        }
        Ok(())
    })
    .unwrap();
    received.join().unwrap().unwrap();
    assert!(status.acknowledged() <= 10_000 && status.acknowledged() > 0);
}

#[test]
fn a_stamped_rendezvous_says_how_long_it_was_under_way() {
    let _watchdog = watchdog();
    let (here, there) = networks(&Config::loopback());
    let endpoint = there.endpoint("test/age");
    let (receiver, link) = endpoint.stamped_receiver::<u64>().unwrap();
    let received = spawn(Policy::Other, link, async move {
        luna::after(Duration::from_millis(1)).await;
        let value = receiver.recv().await?;
        let at_most = value.under_way().at_most.unwrap();
        println!("under way for {at_most:?}, now {:?} old", value.age());
        assert!(at_most > Duration::ZERO && at_most < Duration::from_secs(30));
        assert!(value.arrived() <= luna::now());
        Ok(())
    });
    let (sender, link) = here.sender::<u64>("test/age").unwrap();
    run(Policy::Other, link, async move {
        sender.send(1).await?;
        Ok(())
    })
    .unwrap();
    received.join().unwrap().unwrap();
}

#[test]
fn a_receiver_reports_room_only_where_it_has_it() {
    let _watchdog = watchdog();
    // What finds no room is sent again after half of this.
    let (here, there) = networks(&Config::loopback().lost_after(Duration::from_secs(40)));
    let endpoint = there.endpoint("test/room").window(1);
    let (receiver, link) = endpoint.receiver::<u64>().unwrap();
    let received = spawn(Policy::Other, link, async move {
        for number in 1..=3_000 {
            assert_eq!(receiver.recv().await?, number);
        }
        Ok(())
    });
    let endpoint = here.endpoint("test/room");
    let (sender, link) = endpoint.buffered_sender::<u64>(Buffer::fifo(16)).unwrap();
    let status = link.status();
    run(Policy::Other, link, async move {
        for number in 1..=3_000 {
            sender.send(number).await?;
        }
        Ok(())
    })
    .unwrap();
    received.join().unwrap().unwrap();
    assert_eq!((status.acknowledged(), status.resent()), (3_000, 0));
}
