//! The scope of LUNA: what a running system does, live in a browser.
//!
//! ```text
//!   recorder's thread ── blocks ──> [sink] ── bounded queue ──> feed ──> store ──> viewers (WebSocket)
//!   a recording's file ── records, at their pace ──────────────────────────^
//! ```
//!
//! A [`Scope`] serves a page, which is part of the program and needs no internet, and to each viewer of it what is recorded: [`Scope::sink`] takes the blocks of a running system,
//! [`Scope::replay`] plays a recording. Nothing here is on the real-time path, and nothing here makes the recorder wait: what the scope cannot take in time is refused, and
//! counted as lost for it.
//!
//! - Memory is bounded: the last blocks (16 MiB, unless [`Settings::memory`] says otherwise), what was declared, and a histogram for each loop. Who comes late gets these.
//! - A viewer that reads too slowly misses blocks, and is told how many; one that does not read at all is dropped.
//! - More than a browser can draw is reduced: of the samples of one signal within 0.2 ms the first, the least and the greatest stay.
//! - A viewer can only look. Parameters can be set by who has the token, if there is one.
//!
//! ```
//! use luna_scope::{Scope, Settings};
//! use std::io::{Read, Write};
//!
//! let scope = Scope::open(Settings::default().address(([127, 0, 0, 1], 0).into()))?;
//! println!("look at {}", scope.url());
//! let recording = luna_logger::Logging::to_sink(scope.sink()?); // for `System::log`
//!
//! let mut browser = std::net::TcpStream::connect(scope.address())?;
//! write!(browser, "GET / HTTP/1.1\r\nHost: localhost\r\n\r\n")?;
//! let mut page = String::new();
//! browser.read_to_string(&mut page)?;
//! assert!(page.contains("<title>LUNA scope</title>"));
//! # drop(recording);
//! # Ok::<(), std::io::Error>(())
//! ```

mod feed;
mod histogram;
mod loops;
mod page;
mod parameters;
mod reduce;
mod replay;
mod scope;
mod server;
mod settings;
mod store;
mod token;

pub use feed::ScopeSink;
pub use parameters::{Parameter, Parameters};
pub use replay::{ReplayError, Speed};
pub use scope::Scope;
pub use settings::Settings;
