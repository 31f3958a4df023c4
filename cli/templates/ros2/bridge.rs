//! The bridge between the base and a ROS 2 graph, by luna-ros2. It needs no installation of ROS 2:
//! it speaks DDS itself.

use crate::base::{Command, Ends, Wheels};
use luna::prelude::*;
use luna_ros2::arrayvec::{ArrayString, ArrayVec};
use luna_ros2::msg::builtin_interfaces::Time;
use luna_ros2::msg::geometry_msgs::Twist;
use luna_ros2::{Node, Options, Qos};
use std::time::{Duration, SystemTime, UNIX_EPOCH};

/// If no other node has come by then, the bridge says so.
const PATIENCE: Duration = Duration::from_secs(2);
/// How often the wheels are published.
const PUBLISHED: Duration = Duration::from_millis(20);

luna_ros2::message! {
    /// A header without heap.
    #[derive(Default)]
    struct Header { stamp: Time, frame_id: ArrayString<16> }
}

luna_ros2::message! {
    /// `sensor_msgs/JointState` of two wheels, without heap.
    #[derive(Default)]
    struct JointState: "sensor_msgs/msg/JointState" {
        header: Header,
        name: ArrayVec<ArrayString<8>, 2>,
        position: ArrayVec<f64, 2>,
        velocity: ArrayVec<f64, 2>,
        effort: ArrayVec<f64, 2>,
    }
}

/// This computer alone, and the domain of ROS_DOMAIN_ID. Other computers: `Options::network`.
pub fn describe(system: &mut System, ends: Ends) -> luna::Result<()> {
    let node = match Node::new("/", "base", Options::new()) {
        Ok(node) => node,
        Err(error) => {
            eprintln!("no bridge to ROS 2, so the base gets no commands: {error}");
            return Ok(());
        }
    };
    let latest = Qos::default().depth(1);
    let (commands, from_graph) = node.subscription::<Twist>("/cmd_vel", latest)?;
    let (joints, to_graph) = node.publisher::<JointState>("/joint_states", Qos::default())?;
    let (status, domain) = (from_graph.status(), node.domain());

    // Nothing of DDS runs on the loop's executor, and the loop waits for none of it.
    let bridge = system.executor("bridge").build()?;
    bridge.process("from graph").spawn(from_graph)?;
    bridge.process("to graph").spawn(to_graph)?;
    let Ends {
        commands: out,
        wheels,
    } = ends;
    let (running, is_over) = luna::channel::<()>();
    bridge.process("commands").spawn(async move {
        loop {
            alt! {
                received = commands.recv() => {
                    let Twist { linear, angular } = received?.value;
                    let command = Command { ahead: linear.x, turn: angular.z };
                    if out.send(command).await.is_err() {
                        return Ok(()); // the base has ended
                    }
                },
                _ = is_over.recv() => return Ok(()),
            }
        }
    })?;
    bridge.process("joint states").spawn(async move {
        let _running = running; // dropped at the end, which the other process sees
        let mut asked_for_help = false;
        let begin = luna::now();
        let mut tick = luna::periodic("joint states", PUBLISHED)?;
        loop {
            tick.next().await;
            match wheels.try_recv() {
                Ok(state) => joints.send(message(state)).await?,
                Err(error) if error.is_empty() => {}
                Err(_) => return Ok(()), // the base has ended
            }
            if luna::now() - begin >= PATIENCE && status.partners() == 0 && !asked_for_help {
                asked_for_help = true;
                eprintln!(
                    "no ROS 2 node of this computer publishes /cmd_vel in domain {domain}, so the \
                     base stands still; try\n  ros2 topic pub --rate 10 /cmd_vel \
                     geometry_msgs/msg/Twist '{{linear: {{x: 0.2}}}}'"
                );
            }
        }
    })?;
    Ok(())
}

fn message(wheels: Wheels) -> JointState {
    let now = SystemTime::now()
        .duration_since(UNIX_EPOCH)
        .unwrap_or_default();
    let name = |name| ArrayString::from(name).unwrap_or_default();
    JointState {
        header: Header {
            stamp: Time::from_nanos(now.as_nanos() as i64),
            frame_id: ArrayString::default(),
        },
        name: ["left", "right"].map(name).into(),
        position: wheels.angles.into(),
        velocity: wheels.speeds.into(),
        effort: ArrayVec::default(),
    }
}
