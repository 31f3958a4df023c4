//! Tests of channels between computers, over loopback. One program; a module a subject.

#[path = "../../../../tests/shared/mod.rs"]
#[macro_use]
mod shared;
#[path = "../../../../tests/shared/links.rs"]
mod links;

mod bad_network;
mod broken;
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

use links::{run, spawn};
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
