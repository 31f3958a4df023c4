//! CANopen with simulated nodes.

mod clients;
mod codings;
mod nodes;
mod peer;
mod process_data;
mod supervision;
mod transfers;

use crate::common::{Bench, SpawnOk};
use luna_can::canopen::sim::{Node, NodeControl};
use luna_can::canopen::{Network, NodeId};
use luna_can::sim::Port;

/// The number of the node of the tests.
fn id() -> NodeId {
    NodeId::new(5).unwrap()
}

/// The master's side of a bus with a node, which has a controller yet to be spawned.
fn master(bench: &mut Bench) -> Network<Port> {
    Network::new(&bench.open("master"))
}

/// A node that is named `node`.
fn node(bench: &mut Bench, change: impl FnOnce(Node<Port>) -> Node<Port>) -> NodeControl {
    let device = bench.open("node");
    let node = change(Node::new(&device, id()));
    let control = node.control();
    bench.main.process("node").spawn_ok(node);
    control
}
