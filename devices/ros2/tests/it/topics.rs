//! Publishers and subscriptions of nodes of this program.

use crate::{domain, node};
use luna::prelude::*;
use luna_ros2::arrayvec::{ArrayString, ArrayVec};
use luna_ros2::msg::geometry_msgs::{PoseWithCovariance, Twist};
use luna_ros2::msg::std_msgs::{self, Int32};
use luna_ros2::{Message, Qos};
use std::time::Duration;

fn number(data: i32) -> Int32 {
    Int32 { data }
}

/// Sends one value from node to node, and gives what came.
fn once<M: Message + PartialEq + std::fmt::Debug>(sent: M) -> luna_ros2::Received<M> {
    let domain = domain();
    let (talker, listener) = (node(domain, "talker"), node(domain, "listener"));
    let (sender, out) = talker.publisher::<M>("/one", Qos::default()).unwrap();
    let (receiver, back) = listener.subscription::<M>("/one", Qos::default()).unwrap();
    let (there, here) = (out.status(), back.status());
    let (result, results) = std::sync::mpsc::channel();
    let mut system = System::new("test");
    let main = system.executor("main").build().unwrap();
    main.process("out").priority(2).spawn(out).unwrap();
    main.process("back").priority(2).spawn(back).unwrap();
    let value = sent.clone();
    let body = async move {
        there.wait_for_partners(1).await;
        here.wait_for_partners(1).await;
        sender.send(value).await?;
        result.send(receiver.recv().await?).ok();
        Ok(())
    };
    main.process("body").spawn(body).unwrap();
    system.run().unwrap();
    let came = results.recv().unwrap();
    assert_eq!(came.value, sent);
    came
}

#[test]
fn a_value_comes_with_its_number_and_its_age() {
    own_process!();
    let came = once(std_msgs::String {
        data: "grüße".to_owned(),
    });
    assert_eq!(came.number, 1);
    assert!(came.sent.is_some());
    // It was sent before it came, and both are in this test.
    let age = came.age_by_wall_clock().unwrap();
    assert!(came.age() <= age + Duration::from_millis(1), "{came:?}");
    assert!(age < Duration::from_secs(60), "{came:?}");
}

#[test]
fn large_arrays_and_types_without_heap_come_as_they_went() {
    own_process!();
    let mut pose = PoseWithCovariance::default();
    assert_eq!(pose.pose.orientation.w, 1.0);
    for (index, element) in pose.covariance.iter_mut().enumerate() {
        *element = index as f64;
    }
    once(pose);

    luna_ros2::message! {
        /// Without heap.
        pub struct Names: "test_msgs/msg/Names" {
            pub names: ArrayVec<ArrayString<8>, 3>,
            pub flags: [bool; 3],
            pub numbers: ArrayVec<i16, 4>,
            pub last: u64,
        }
    }
    let names = ["left", "right"].map(|name| ArrayString::from(name).unwrap());
    once(Names {
        names: names.into_iter().collect(),
        flags: [true, false, true],
        numbers: [-1, 300].into_iter().collect(),
        last: u64::MAX,
    });
}

#[test]
fn values_come_in_order_each_once() {
    own_process!();
    let domain = domain();
    let (talker, listener) = (node(domain, "talker"), node(domain, "listener"));
    let qos = Qos::default().keep_all();
    let (sender, out) = talker.publisher::<Int32>("count", qos.clone()).unwrap();
    let (receiver, back) = listener.subscription::<Int32>("/count", qos).unwrap();
    let (published, came) = (out.status(), back.status());
    let (there, here) = (out.status(), back.status());
    let mut system = System::new("test");
    let main = system.executor("main").build().unwrap();
    main.process("out").priority(2).spawn(out).unwrap();
    main.process("back").priority(2).spawn(back).unwrap();
    main.process("sends")
        .spawn(async move {
            there.wait_for_partners(1).await;
            here.wait_for_partners(1).await;
            for data in 1..=500 {
                sender.send(number(data)).await?;
            }
            Ok(())
        })
        .unwrap();
    main.process("receives")
        .spawn(async move {
            for expected in 1..=500 {
                let received = receiver.recv().await?;
                assert_eq!(received.value.data, expected);
                assert_eq!(received.number, expected as u64);
            }
            Ok(())
        })
        .unwrap();
    system.run().unwrap();
    assert_eq!((published.carried(), came.carried()), (500, 500));
    assert_eq!((published.overwritten(), published.refused()), (0, 0));
}

/// DDS's thread does not run before the link, so the buffer of a link at a higher level than the
/// sender is full soon: nothing waits, and what is lost is counted.
#[test]
fn a_full_buffer_is_overwritten_and_counted() {
    own_process!();
    let node = node(domain(), "talker");
    let (sender, out) = node
        .publisher::<Int32>("/flood", Qos::default().depth(1))
        .unwrap();
    let status = out.status();
    let mut system = System::new("test");
    let main = system.executor("main").build().unwrap();
    main.process("out").priority(2).spawn(out).unwrap();
    let sends = async move {
        for data in 0..20_000 {
            sender.send(number(data)).await?;
        }
        Ok(())
    };
    main.process("sends").spawn(sends).unwrap();
    system.run().unwrap();
    assert_eq!(status.carried() + status.overwritten(), 20_000);
    assert_eq!(status.refused(), 0, "{:?}", status.last_fault());
}

#[test]
fn a_slow_receiver_sees_which_values_were_overwritten() {
    own_process!();
    let domain = domain();
    let (talker, listener) = (node(domain, "talker"), node(domain, "listener"));
    let all = Qos::default().keep_all();
    let (sender, out) = talker.publisher::<Int32>("/fast", all).unwrap();
    let latest = Qos::default().depth(2);
    let (receiver, back) = listener.subscription::<Int32>("/fast", latest).unwrap();
    let (published, came) = (out.status(), back.status());
    let mut system = System::new("test");
    let main = system.executor("main").build().unwrap();
    main.process("out").priority(2).spawn(out).unwrap();
    main.process("back").priority(2).spawn(back).unwrap();
    main.process("body")
        .spawn(async move {
            published.wait_for_partners(1).await;
            came.wait_for_partners(1).await;
            // One by one, so that none is lost in DDS, whose depth is 2 too.
            for data in 1..=10 {
                sender.send(number(data)).await?;
                while came.carried() < data as u64 {
                    luna::after(Duration::from_millis(1)).await;
                }
            }
            let (first, second) = (receiver.recv().await?, receiver.recv().await?);
            assert_eq!((first.number, second.number), (9, 10));
            assert_eq!((first.value.data, second.value.data), (9, 10));
            Ok(())
        })
        .unwrap();
    system.run().unwrap();
}

#[test]
fn a_subscription_is_a_guard() {
    own_process!();
    let domain = domain();
    let (talker, listener) = (node(domain, "talker"), node(domain, "listener"));
    let (velocity, out) = talker
        .publisher::<Twist>("/cmd_vel", Qos::sensor_data())
        .unwrap();
    let (commands, back) = listener
        .subscription::<Twist>("/cmd_vel", Qos::sensor_data())
        .unwrap();
    let status = out.status();
    let (stop, stopped) = luna::channel::<()>();
    let (go, gone) = luna::channel::<()>();
    let mut system = System::new("test");
    let main = system.executor("main").build().unwrap();
    main.process("out").priority(2).spawn(out).unwrap();
    main.process("back").priority(2).spawn(back).unwrap();
    main.process("sends")
        .spawn(async move {
            assert!(gone.recv().await.is_err());
            status.wait_for_partners(1).await;
            let mut twist = Twist::default();
            // Best effort: again until one has come.
            loop {
                twist.linear.x += 1.0;
                pri_alt! {
                    _ = stopped.recv() => return Ok(()),
                    sent = velocity.send(twist) => sent?,
                }
                luna::after(Duration::from_millis(1)).await;
            }
        })
        .unwrap();
    main.process("drives")
        .spawn(async move {
            alt! {
                received = commands.recv() => panic!("{received:?} was not sent yet"),
                _ = luna::after(Duration::from_millis(5)) => drop(go),
            }
            let x = alt! {
                received = commands.recv() => received?.value.linear.x,
                _ = luna::after(Duration::from_secs(30)) => panic!("nothing came"),
            };
            assert!(x >= 1.0);
            drop(stop);
            Ok(())
        })
        .unwrap();
    system.run().unwrap();
}

#[test]
fn a_late_subscription_gets_the_latched_value() {
    own_process!();
    let domain = domain();
    let talker = node(domain, "talker");
    let (sender, out) = talker.publisher::<Int32>("/map", Qos::latched()).unwrap();
    let status = out.status();
    let (late, later) = std::sync::mpsc::channel();
    let (seen, was_seen) = luna::channel::<()>();
    let thread = std::thread::spawn(move || {
        later.recv().unwrap();
        let listener = node(domain, "listener");
        let (receiver, back) = listener
            .subscription::<Int32>("/map", Qos::latched())
            .unwrap();
        let body = async move {
            // DDS may have kept the one before it.
            while receiver.recv().await?.value.data != 2 {}
            drop(seen);
            Ok(())
        };
        crate::run([back], body).unwrap();
    });
    let body = async move {
        sender.send(number(1)).await?;
        sender.send(number(2)).await?;
        while status.carried() + status.overwritten() < 2 {
            luna::after(Duration::from_millis(1)).await;
        }
        luna::realtime::off_path(|| late.send(()).unwrap());
        assert!(was_seen.recv().await.is_err());
        Ok(())
    };
    crate::run([out], body).unwrap();
    thread.join().unwrap();
}

#[test]
fn what_does_not_fit_is_reported_on_both_sides() {
    own_process!();
    let domain = domain();
    let (talker, listener) = (node(domain, "talker"), node(domain, "listener"));
    let (sender, out) = talker
        .publisher::<Int32>("/scan", Qos::sensor_data())
        .unwrap();
    let (receiver, back) = listener
        .subscription::<Int32>("/scan", Qos::default())
        .unwrap();
    let (there, here) = (out.status(), back.status());
    let mut system = System::new("test");
    let main = system.executor("main").build().unwrap();
    main.process("out").spawn(out).unwrap();
    main.process("back").spawn(back).unwrap();
    main.process("body")
        .spawn(async move {
            let _ends = (sender, receiver);
            for status in [there, here] {
                status.wait_for_incompatible(1).await;
                let what = status.last_incompatible().unwrap();
                assert!(
                    what.contains("rt/scan") && what.contains("BestEffort"),
                    "{what}"
                );
                assert_eq!(status.partners(), 0);
            }
            Ok(())
        })
        .unwrap();
    system.run().unwrap();
}

#[test]
fn another_type_under_the_same_name_is_reported() {
    own_process!();
    let domain = domain();
    let (talker, listener) = (node(domain, "talker"), node(domain, "listener"));
    let (sender, out) = talker.publisher::<Int32>("/x", Qos::default()).unwrap();
    let (receiver, back) = listener
        .subscription::<std_msgs::String>("/x", Qos::default())
        .unwrap();
    let status = back.status();
    let mut system = System::new("test");
    let main = system.executor("main").build().unwrap();
    main.process("out").spawn(out).unwrap();
    main.process("back").spawn(back).unwrap();
    main.process("body")
        .spawn(async move {
            let _ends = (sender, receiver);
            status.wait_for_incompatible(1).await;
            let what = status.last_incompatible().unwrap();
            for part in [
                "std_msgs::msg::dds_::Int32_",
                "std_msgs::msg::dds_::String_",
            ] {
                assert!(what.contains(part), "{what}");
            }
            Ok(())
        })
        .unwrap();
    system.run().unwrap();
}

#[test]
fn poison_ends_the_links() {
    own_process!();
    let node = node(domain(), "talker");
    let (sender, out) = node.publisher::<Int32>("/p", Qos::default()).unwrap();
    let error = crate::run([out], async move {
        sender.poison();
        Ok(())
    });
    assert!(error.unwrap_err().is_poisoned());
    let (receiver, back) = node.subscription::<Int32>("/p", Qos::default()).unwrap();
    let error = crate::run([back], async move {
        receiver.poison();
        Ok(())
    });
    assert!(error.unwrap_err().is_poisoned());
}
