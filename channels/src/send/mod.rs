//! Sending.

mod guard;
mod operation;
mod sender;
mod timeout;

pub use operation::SendOp;
pub use sender::Sender;
pub use timeout::SendTimeout;
