//! Tests of channels between computers, over loopback. One program; a module a subject.

#[path = "../../../../tests/shared/mod.rs"]
#[macro_use]
mod shared;

mod bad_network;
mod child;
mod death;
mod ends;
mod guards;
mod kill;
mod opening;
mod relay;
mod rendezvous;
mod secure;
mod streams;

use luna::{Policy, System};
use luna_net::{Config, Network};
use std::time::Duration;

/// An address on this computer with a port that is free now.
fn address() -> String {
    let listener = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
    format!("tcp/{}", listener.local_addr().unwrap())
}

/// Two networks that are connected, as of two computers.
fn networks(config: &Config) -> (Network, Network) {
    let address = address();
    let here = Network::open(&config.clone().listen(&address)).unwrap();
    let there = config.clone().connect(&address);
    let there = there.connect_within(Duration::from_secs(30));
    (here, Network::open(&there).unwrap())
}

/// Runs a process and a link on an executor of their own, on the calling thread. Without the
/// privilege for a policy the threads are ordinary ones.
fn run(
    policy: Policy,
    link: impl luna::Process + Send + 'static,
    body: impl Future<Output = luna::Result<()>> + Send + 'static,
) -> luna::Result<()> {
    let mut system = System::new("test");
    let main = system.executor("main").policy(policy).build()?;
    main.process("link").priority(2).spawn(link)?;
    main.process("body").priority(1).spawn(body)?;
    system.run().map(drop)
}

/// As [`run`], on a thread of its own.
fn spawn(
    policy: Policy,
    link: impl luna::Process + Send + 'static,
    body: impl Future<Output = luna::Result<()>> + Send + 'static,
) -> std::thread::JoinHandle<luna::Result<()>> {
    std::thread::spawn(move || run(policy, link, body))
}
