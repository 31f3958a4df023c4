//! A running LUNA system in Foxglove and Lichtblick.
//!
//! A [`Foxglove`] is a server of their WebSocket protocol. [`Foxglove::sink`] takes the blocks of a
//! system's recording, and each viewer gets what it subscribes to, live:
//!
//! | topic | messages |
//! | --- | --- |
//! | `/` and a signal's name | JSON with a schema: `value` is the sample, an array is a list |
//! | `/luna/log` | `foxglove.Log`, as protobuf |
//! | `/luna/events` | JSON with a schema: CSP events in words, and by their numbers |
//!
//! Unit and description of a signal are metadata of its topic. Signals, messages and events have the
//! topics and fields of `luna convert --to mcap`, so one layout fits both. The time of a message is
//! when it was recorded, as time of the day; in a system on a virtual clock, that clock's.
//!
//! Nothing here is on the real-time path, and nothing here makes the recorder wait. What no viewer
//! has subscribed to is not encoded. A viewer that reads too slowly misses its oldest messages.
//!
//! ```
//! use luna_foxglove::Foxglove;
//!
//! let foxglove = Foxglove::open(([127, 0, 0, 1], 0).into())?;
//! println!("connect to {}", foxglove.url());
//! let recording = luna_logger::Logging::to_sink(foxglove.sink()); // for `System::log`
//! # drop(recording);
//! # Ok::<(), std::io::Error>(())
//! ```

mod server;
mod sink;
mod topics;

pub use server::Foxglove;
pub use sink::FoxgloveSink;
