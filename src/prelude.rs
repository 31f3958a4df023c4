//! What most programs use: `use luna::prelude::*;`.
//!
//! It has the types that a program names again and again, and the macros. Functions are called by
//! their path (`luna::channel`, `luna::periodic`), which says whose they are.
//!
//! ```
//! use luna::prelude::*;
//!
//! let (sender, receiver) = luna::channel();
//! let mut system = System::new("pair");
//! let main = system.executor("main").build()?;
//! main.process("one").spawn(async move { Ok(sender.send(1).await?) })?;
//! main.process("other").spawn(async move {
//!     assert_eq!(receiver.recv().await, Ok(1));
//!     Ok(())
//! })?;
//! system.run()?;
//! # Ok::<(), luna::Error>(())
//! ```

pub use crate::{
    Alternative, Barrier, Buffer, Parameter, Policy, Process, Receiver, Sender, Signal, System,
    alt, par, pri_alt, pri_par,
};
