//! A mobile base as a node of a ROS 2 graph: it takes `/cmd_vel`, sets two wheels in a loop of
//! 1 kHz, and publishes `/joint_states`. Without a new command for 200 ms it stops.
//!
//! `cargo run -p luna-ros2 --example twist_to_axes`
//!
//! It plays the operator too, for a second. With `--serve` it waits for one on the graph instead:
//! `ros2 topic pub --rate 10 /cmd_vel geometry_msgs/msg/Twist '{linear: {x: 0.2}}'`.

use luna::prelude::*;
use luna_ros2::arrayvec::{ArrayString, ArrayVec};
use luna_ros2::msg::builtin_interfaces::Time;
use luna_ros2::msg::geometry_msgs::Twist;
use luna_ros2::{Node, Options, Qos, Received};
use std::time::{Duration, SystemTime, UNIX_EPOCH};

const PERIOD: Duration = Duration::from_millis(1);
const SILENCE: Duration = Duration::from_millis(200);
/// Of a wheel, and half of the distance between the two, in metres.
const RADIUS: f64 = 0.05;
const HALF_TRACK: f64 = 0.15;

luna_ros2::message! {
    /// A header without heap.
    #[derive(Default)]
    struct Header { stamp: Time, frame_id: ArrayString<16> }
}

luna_ros2::message! {
    /// `sensor_msgs/JointState` of two wheels, without heap: the loop makes it.
    #[derive(Default)]
    struct Wheels: "sensor_msgs/msg/JointState" {
        header: Header,
        name: ArrayVec<ArrayString<8>, 2>,
        position: ArrayVec<f64, 2>,
        velocity: ArrayVec<f64, 2>,
        effort: ArrayVec<f64, 2>,
    }
}

// ANCHOR: drive
/// The control loop. It waits for nothing but its tick.
async fn drive(commands: Receiver<Received<Twist>>, joints: Sender<Wheels>) -> luna::Result<()> {
    let mut wheels = Wheels::default();
    for name in ["left", "right"] {
        wheels
            .name
            .push(ArrayString::from(name).unwrap_or_default());
    }
    let mut angles = [0.0; 2];
    let mut command: Option<Received<Twist>> = None;
    let mut tick = luna::periodic("drive", PERIOD)?;
    let mut cycle = 0_u64;
    loop {
        tick.next().await;
        match commands.try_recv() {
            Ok(new) => command = Some(new),
            Err(error) if error.is_empty() => {}
            Err(_) => return Ok(()),
        }
        let fresh = command.filter(|command| command.age() < SILENCE);
        let twist = fresh.map(|command| command.value).unwrap_or_default();
        let turn = twist.angular.z * HALF_TRACK;
        let speeds = [twist.linear.x - turn, twist.linear.x + turn].map(|speed| speed / RADIUS);
        for (angle, speed) in angles.iter_mut().zip(speeds) {
            *angle += speed * PERIOD.as_secs_f64();
        }
        cycle += 1;
        if cycle.is_multiple_of(20) {
            let now = SystemTime::now()
                .duration_since(UNIX_EPOCH)
                .unwrap_or_default();
            wheels.header.stamp = Time::from_nanos(now.as_nanos() as i64);
            wheels.position = angles.into_iter().collect();
            wheels.velocity = speeds.into_iter().collect();
            // The link takes it at once, and waits for nobody.
            joints.send(wheels.clone()).await?;
        }
    }
}
// ANCHOR_END: drive

// ANCHOR: node
fn main() -> luna::Result<()> {
    let options = Options::new();
    let node = Node::new("/", "base", options.clone())?;
    let latest = Qos::default().depth(1);
    let (commands, from_graph) = node.subscription::<Twist>("/cmd_vel", latest.clone())?;
    let (joints, to_graph) = node.publisher::<Wheels>("/joint_states", Qos::default())?;
    let status = to_graph.status();
    let mut system = System::new("base");
    let main = system.executor("main").build()?;
    main.process("commands").priority(10).spawn(from_graph)?;
    main.process("joint states").priority(10).spawn(to_graph)?;
    let driven = main.process("drive").priority(20);
    if std::env::args().any(|argument| argument == "--serve") {
        driven.spawn(drive(commands, joints))?;
        system.run()?;
        return Ok(());
    }
    // ANCHOR_END: node
    // The operator's end of the loop ends all of it.
    let (over, is_over) = luna::channel::<()>();
    driven.spawn(async move {
        let until = async { is_over.ended().await };
        futures_lite::future::or(drive(commands, joints), async {
            until.await;
            Ok(())
        })
        .await
    })?;

    let operator = Node::new("/", "operator", options)?;
    let (velocity, out) = operator.publisher::<Twist>("/cmd_vel", latest)?;
    let states = Qos::default().depth(1);
    let (wheels, back) = operator
        .subscription::<luna_ros2::msg::sensor_msgs::JointState>("/joint_states", states)?;
    let connected = out.status();
    let other = system.executor("operator").build()?;
    other.process("out").spawn(out)?;
    other.process("back").spawn(back)?;
    other.process("operator").spawn(async move {
        connected.wait_for_partners(1).await;
        let mut twist = Twist::default();
        twist.linear.x = 0.2;
        twist.angular.z = 0.4;
        let mut last = None;
        let mut tick = luna::periodic("operator", Duration::from_millis(50))?;
        for _ in 0..20 {
            tick.next().await;
            velocity.send(twist).await?;
            if let Ok(state) = wheels.try_recv() {
                last = Some(state);
            }
        }
        // One more, for a machine that is slow.
        let state = wheels.recv().await?;
        let (now, before) = (state.age(), last.map(|last| last.number));
        println!("{:?} {:?}", state.value.name, state.value.position);
        println!("{now:?} old, number {}; before it {before:?}", state.number);
        drop(over);
        Ok(())
    })?;
    system.run()?;
    println!("{} states went to the graph", status.carried());
    Ok(())
}
