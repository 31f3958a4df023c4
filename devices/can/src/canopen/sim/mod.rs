//! A simulated node with an object dictionary, for tests.
//!
//! It has network management, a heartbeat (1017h), an SDO server, four PDOs in each direction
//! (1400h, 1600h, 1800h, 1A00h), SYNC and EMCY messages. What it receives by a synchronous PDO
//! takes effect at once. It has no block transfers, no LSS and no TIME.

mod dictionary;
mod node;
mod server;

pub use dictionary::Access;
pub use node::{Node, NodeControl};
