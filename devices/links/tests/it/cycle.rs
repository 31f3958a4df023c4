//! The link to another computer: on a simulated wire, on loopback, and between two network
//! namespaces.

mod bytes;
mod follow;
mod loopback;
mod namespaces;
mod process;
mod sessions;
mod simulated;
mod wire;
