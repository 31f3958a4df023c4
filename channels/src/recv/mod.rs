//! Receiving.

mod guard;
mod operation;
mod receiver;
mod timeout;

pub use operation::RecvOp;
pub use receiver::Receiver;
pub use timeout::RecvTimeout;
