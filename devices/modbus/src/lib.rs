//! Modbus TCP: a process that polls registers and coils of a server, and gives them into channels.
//!
//! It is for what is slow: a PLC, a drive's settings, an energy meter. It runs beside the real-time
//! part, which never waits for it: a channel that overwrites its oldest value always has room, and
//! has the newest value.
//!
//! ```
//! use luna::prelude::*;
//! use luna_modbus::{Event, coil, input, sim};
//! use std::time::Duration;
//!
//! let plc = sim::Server::start()?; // Or one on the machine's network.
//! plc.set(input::<f32>(10), 21.5)?;
//!
//! let mut system = System::new("oven");
//! let server = luna_modbus::open(&system.devices(), plc.address())?;
//! let (value, temperature) = luna::buffered::<f32>(Buffer::overwrite_oldest(1));
//! let (heater, switch) = luna::buffered::<bool>(Buffer::overwrite_oldest(1));
//! let (event, events) = luna::buffered::<Event>(Buffer::fifo(8));
//! let client = luna_modbus::client(&server, Duration::from_millis(10), event)?
//!     .read(input::<f32>(10), value)?
//!     .write(coil(0), switch)?;
//! let main = system.executor("main").build()?;
//! main.process("plc").spawn(client)?;
//! main.process("control").spawn(async move {
//!     // A real-time loop would look with `try_recv`.
//!     assert_eq!(temperature.recv().await?, 21.5);
//!     heater.send(true).await?;
//!     assert_eq!(events.recv().await?, Event::Connected);
//!     Ok(())
//! })?;
//! # drop(server);
//! # match system.run() {
//! #     Err(error) if error.to_string().contains("needs Linux") => return Ok(()),
//! #     ran => ran,
//! # }?;
//! # #[cfg(any())]
//! system.run()?;
//! assert!(plc.get(coil(0))?); // also what was sent last is written
//! # Ok::<(), luna::Error>(())
//! ```
//!
//! | what happens | the client | counted |
//! | --- | --- | --- |
//! | the server answers a read by an exception | reports it once, and asks again in each cycle | `exceptions` |
//! | the server answers a write by an exception | reports it with the value | `exceptions`, `write_failures` |
//! | no answer in time | closes the connection, reports it, connects again | `timeouts` |
//! | an answer makes no sense | the same | `garbage` |
//! | an answer to another request | discards it, as the protocol says, and waits on | `strays` |
//! | the server goes away | the same, with the pauses of `Reconnect` | `connections` |
//! | the connection breaks in a write | reports the value, which may or may not be written; it is not repeated | `write_failures` |
//! | the attempts are used up | the device is lost: an emergency, or what `on_loss` says | – |
//! | the server is slower than the period | the next cycle begins at once | `late` |
//!
//! **In an emergency** the client ends like any process, and writes nothing more: what is to be safe
//! without this program needs a watchdog in the PLC.
//!
//! The frames are those of `rmodbus`, which is a protocol alone. `tokio-modbus` brings a runtime
//! with threads and timers of its own, which LUNA's priorities, clock and stop do not reach.
//!
//! [`sim`] is a server for tests. Clients run against pymodbus too; none has against a real device yet.

#![cfg(target_os = "linux")]

mod client;
mod connection;
mod counts;
mod device;
mod error;
mod exchange;
mod frame;
mod point;
mod points;
pub mod sim;

pub use client::{AnswerUnit, Client, client};
pub use counts::Counts;
pub use device::{ModbusServer, open};
pub use error::{Code, Event, Garbage, Request, RequestError, SetUpError};
pub use luna_links::tcp::Reconnect;
pub use point::{
    Register, Source, Table, Target, Value, WordOrder, coil, discrete, holding, input,
};
