//! Choice: [`alt!`], [`pri_alt!`], and [`Alternative`] over any number of channels; the guards that
//! they choose from.
//!
//! Guards are the operations of channels, calls, barriers and timers. Those of time are in
//! [`time`](crate::time).
//!
//! ```
//! use luna::alternative::When;
//! use luna::prelude::*;
//!
//! /// Waits for the first of both, if `open` allows the second.
//! async fn first(one: &Receiver<u8>, other: &Receiver<u8>, open: bool) -> luna::Result<u8> {
//!     alt! {
//!         value = one.recv() => Ok(value?),
//!         value = other.recv(), if open => Ok(value?),
//!     }
//! }
//!
//! let ((left, from_left), (_right, from_right)) = (luna::channel(), luna::channel());
//! let value = luna::run(async {
//!     par!(async { Ok(left.send(7).await?) }, first(&from_left, &from_right, true)).await
//! })?;
//! assert_eq!(value.1, 7);
//! # let _: Option<When<luna::time::After>> = None;
//! # Ok::<(), luna::Error>(())
//! ```

pub use luna_channels::{Alternative, AlternativeRecv, Guard, When, alt, pri_alt};
