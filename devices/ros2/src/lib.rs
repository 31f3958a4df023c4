//! A LUNA system as a node of a ROS 2 graph: topics, services and parameters as channels.
//!
//! A [`Node`] makes publishers, subscriptions, services and clients. Each is an ordinary end of a
//! channel and a *link*: a process that carries the values to a thread of its own, at SCHED_OTHER,
//! between the channel and DDS (RustDDS, by ros2-client). No executor runs DDS, and none waits for
//! it.
//!
//! ```
//! use luna::prelude::*;
//! use luna_ros2::msg::std_msgs;
//! use luna_ros2::{Node, Options, Qos};
//!
//! let node = Node::new("/", "talker", Options::new().domain(76))?;
//! let (chatter, link) = node.publisher::<std_msgs::String>("/chatter", Qos::default())?;
//! # let listener = Node::new("/", "listener", Options::new().domain(76))?;
//! # let (heard, from_graph) = listener.subscription::<std_msgs::String>("chatter", Qos::default())?;
//! # let other = from_graph.status();
//! let status = link.status();
//! let mut system = System::new("talker");
//! let main = system.executor("main").build()?;
//! main.process("link").priority(2).spawn(link)?;
//! # main.process("other link").priority(2).spawn(from_graph)?;
//! main.process("talker").spawn(async move {
//!     status.wait_for_partners(1).await; // `ros2 topic echo /chatter`
//! #   other.wait_for_partners(1).await;
//!     chatter.send(std_msgs::String { data: "hello".into() }).await?;
//! #   let received = heard.recv().await?;
//! #   assert_eq!(received.value.data, "hello");
//!     Ok(())
//! })?;
//! system.run()?;
//! # Ok::<(), luna::Error>(())
//! ```
//!
//! `docs/ros2.md` says which promises of a channel hold, and which weaken.
//!
//! With the feature `node` left out, only the [generator](generate) of message types is there, for
//! build scripts.

#![cfg_attr(not(test), warn(clippy::unwrap_used, clippy::expect_used))]

// What macros and the generator write names the crate.
#[cfg(feature = "node")]
extern crate self as luna_ros2;

pub mod generate;

#[cfg(feature = "node")]
mod carrier;
#[cfg(feature = "node")]
mod error;
#[cfg(feature = "node")]
mod graph;
#[cfg(feature = "node")]
mod link;
#[cfg(feature = "node")]
mod message;
#[cfg(feature = "node")]
pub mod msg;
#[cfg(feature = "node")]
mod names;
#[cfg(feature = "node")]
mod node;
#[cfg(feature = "node")]
mod parameters;
#[cfg(feature = "node")]
mod publish;
#[cfg(feature = "node")]
mod qos;
#[cfg(feature = "node")]
mod service;
#[cfg(feature = "node")]
mod status;
#[cfg(feature = "node")]
mod subscribe;

#[cfg(feature = "node")]
pub use self::{
    error::Ros2Error,
    link::Link,
    message::{Message, Payload, Service, big_array},
    node::{Node, Options, Rmw},
    publish::PublisherLink,
    qos::Qos,
    status::Status,
    subscribe::Received,
};
/// Strings and lists in place, for messages without heap.
#[cfg(feature = "node")]
pub use arrayvec;
/// What messages derive from.
#[cfg(feature = "node")]
pub use serde;

#[cfg(all(doctest, feature = "node"))]
#[doc = include_str!("../../../docs/ros2.md")]
struct Page;
