//! What a system is made of, and what its processes wait for: its [`Composition`], the report of a
//! [`Deadlock`], all channels, barriers and locks of the program ([`wait_points`]), and the systems
//! of this computer that wish to be found ([`announced_systems`]).
//!
//! ```
//! use luna::inspect::{Composition, ThreadKind};
//! use luna::prelude::*;
//!
//! let mut system = System::new("greeter");
//! let main = system.executor("main").build()?;
//! main.process("hello").spawn(async { Ok(()) })?;
//! let composition: Composition = system.composition();
//! assert_eq!(composition.threads[0].kind, ThreadKind::Executor);
//! assert_eq!(composition.threads[0].processes[0].name, "hello");
//! system.run()?;
//! # Ok::<(), luna::Error>(())
//! ```

pub use crate::csp::composition::{
    ChannelKind, ChannelPart, Composition, EndUser, ProcessKind, ProcessPart, ThreadKind,
    ThreadPart, WaitingPart,
};
pub use crate::system::Observer;
pub use crate::system::announcement::{
    AnnouncedSystem, AnnouncedSystems, AnnouncedThread, announced_systems,
};
pub use luna_channels::inspect::{Role, WaitPointKind, WaitPointView, Waiting, wait_points};
pub use luna_error::{Deadlock, Operation, Partner, Wait};
