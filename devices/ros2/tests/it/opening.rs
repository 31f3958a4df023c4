//! What is refused.

use crate::{domain, node};
use luna::System;
use luna_ros2::msg::std_msgs::Int32;
use luna_ros2::{Node, Options, Qos, Ros2Error};

#[test]
fn names_depths_and_domains_that_cannot_be() {
    own_process!();
    let node = node(domain(), "opener");
    for name in ["", "a//b", "/2nd", "two words", "end/"] {
        let error = node.publisher::<Int32>(name, Qos::default()).unwrap_err();
        assert!(matches!(error, Ros2Error::Name { .. }), "{error}");
        assert!(error.to_string().contains(&format!("`{name}`")), "{error}");
        let error = node
            .subscription::<Int32>(name, Qos::default())
            .unwrap_err();
        assert!(matches!(error, Ros2Error::Name { .. }), "{error}");
    }
    let error = node
        .publisher::<Int32>("/x", Qos::default().depth(0))
        .unwrap_err();
    assert!(matches!(error, Ros2Error::Depth { .. }), "{error}");
    let error = Node::new("/", "far", Options::new().domain(233)).unwrap_err();
    assert!(
        matches!(error, Ros2Error::Domain { domain: 233 }),
        "{error}"
    );
    let error = Node::new("arm", "x", Options::new()).unwrap_err();
    assert!(matches!(error, Ros2Error::Name { .. }), "{error}");

    luna_ros2::message! {
        /// Its name lacks the middle part.
        pub struct Wrong: "std_msgs/Wrong" { pub data: i32 }
    }
    let error = node.publisher::<Wrong>("/x", Qos::default()).unwrap_err();
    assert!(error.to_string().contains("`std_msgs/Wrong`"), "{error}");
}

#[test]
fn the_environment_names_the_domain() {
    own_process!();
    let domain = domain();
    // SAFETY: this process runs this test alone, and no other thread reads the environment now.
    unsafe { std::env::set_var("ROS_DOMAIN_ID", domain.to_string()) };
    assert_eq!(
        Node::new("/", "a", Options::new()).unwrap().domain(),
        domain
    );
    // SAFETY: this process runs this test alone, and the drop of the node has ended its threads: no
    // other thread reads the environment now.
    unsafe { std::env::set_var("ROS_DOMAIN_ID", "lab") };
    let error = Node::new("/", "a", Options::new()).unwrap_err();
    assert!(matches!(error, Ros2Error::DomainVariable { ref value } if value == "lab"));
}

#[test]
fn a_virtual_clock_is_refused() {
    own_process!();
    let node = node(domain(), "simulated");
    let (sender, link) = node.publisher::<Int32>("/x", Qos::default()).unwrap();
    let mut system = System::new("test");
    system.virtual_clock();
    let main = system.executor("main").build().unwrap();
    main.process("link").spawn(link).unwrap();
    let body = async move { Ok(sender.send(Int32 { data: 1 }).await?) };
    main.process("body").spawn(body).unwrap();
    let error = system.run().unwrap_err().to_string();
    assert!(
        error.contains("/x") && error.contains("virtual clock"),
        "{error}"
    );
}

/// The threads of DDS have no real-time priority, whichever thread makes the node.
#[test]
fn no_thread_of_the_node_has_a_real_time_priority() {
    own_process!();
    let made = luna_platform::thread::spawn(
        luna_platform::thread::Attributes::new("maker").policy(luna::Policy::fifo(20)),
        |_| Ok::<_, std::convert::Infallible>(()),
        |()| {
            let node = node(domain(), "made");
            let mut threads = 0;
            for entry in std::fs::read_dir("/proc/self/task").unwrap() {
                let path = entry.unwrap().path();
                let (Ok(name), Ok(stat)) = (
                    std::fs::read_to_string(path.join("comm")),
                    std::fs::read_to_string(path.join("stat")),
                ) else {
                    continue; // It has ended.
                };
                let name = name.trim();
                if !(name.starts_with("RustDDS") || name.starts_with("ros2")) {
                    continue;
                }
                threads += 1;
                // The fields after the name, from the third; the policy is the 41st.
                let fields = stat.rsplit_once(") ").unwrap().1;
                let policy = fields.split(' ').nth(41 - 3).unwrap();
                assert_eq!(policy, "0", "`{name}`");
            }
            drop(node);
            threads
        },
    );
    assert!(made.unwrap().join().unwrap() >= 3);
}
