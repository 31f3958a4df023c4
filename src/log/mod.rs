//! Signals, messages, and logs of both: what the system has of `luna-logger`.
//!
//! A [`Signal`] is declared where its process is [spawned](crate::system::ProcessBuilder::signal),
//! or, by a process that is a type, registered in `pre_run`. The process records samples on the
//! real-time path.
//! [`message`] logs a text. `Logging` (of the feature `logger`) says where a system's log goes: a
//! file, another computer, or any `Sink`. `docs/logger.md` has more.
//!
//! ```
//! use luna::log::{Level, message};
//! use luna::prelude::*;
//!
//! #[derive(Default)]
//! struct Motor { angle: Option<Signal<f64>> }
//!
//! impl Process for Motor {
//!     fn pre_run(&mut self) -> luna::Result<()> {
//!         self.angle = Some(Signal::with_unit("motor/angle", "rad").register()?);
//!         Ok(())
//!     }
//!
//!     async fn run(&mut self) -> luna::Result<()> {
//!         message(Level::Info, "motor", format_args!("starts"));
//!         self.angle.as_ref().inspect(|angle| angle.record(0.5));
//!         Ok(())
//!     }
//! }
//!
//! let mut system = System::new("arm");
//! let main = system.executor("main").build()?;
//! main.process("motor").spawn(Motor::default())?;
//! system.run()?;
//! # Ok::<(), luna::Error>(())
//! ```
//!
//! Without the feature `logger` signals and messages are there all the same, and are no code.

// Both files define the same names, so that the rest of the library, and a user's processes, are
// the same with and without.

#[cfg(feature = "logger")]
#[path = "on.rs"]
mod logger;
#[cfg(not(feature = "logger"))]
#[path = "off.rs"]
mod logger;

#[cfg(feature = "scope")]
#[path = "scope.rs"]
mod scope;
#[cfg(not(feature = "scope"))]
#[path = "no_scope.rs"]
mod scope;

pub use logger::*;
pub(crate) use scope::Shown;
