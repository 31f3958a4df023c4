//! Tests of nodes of a ROS 2 graph. One program; a module a subject. All of it is on the loopback.

#[path = "../../../../tests/shared/mod.rs"]
#[macro_use]
mod shared;

mod cyclone;
mod generate;
mod opening;
mod parameters;
mod services;
mod topics;

use luna::System;
use luna_ros2::{Node, Options, Rmw};
use std::sync::atomic::{AtomicU16, Ordering};

/// A domain that no other test of this program has, nor probably one of another program.
fn domain() -> u16 {
    static NEXT: AtomicU16 = AtomicU16::new(0);
    let begin = (std::process::id() % 100) as u16;
    1 + (begin + NEXT.fetch_add(1, Ordering::Relaxed)) % 100
}

fn node(domain: u16, name: &str) -> Node {
    let options = Options::new().domain(domain).rmw(Rmw::Cyclone);
    Node::new("/", name, options).unwrap()
}

/// Runs links and a process on an executor of their own.
fn run<L: luna::Process + Send + 'static>(
    links: impl IntoIterator<Item = L>,
    body: impl Future<Output = luna::Result<()>> + Send + 'static,
) -> luna::Result<()> {
    let mut system = System::new("test");
    let main = system.executor("main").build()?;
    for (number, link) in links.into_iter().enumerate() {
        let name = format!("link {number}");
        main.process(&name).priority(2).spawn(link)?;
    }
    main.process("body").priority(1).spawn(body)?;
    system.run().map(drop)
}
