//! The scope of LUNA: shows a running system live in a browser.
//!
//! ```text
//!   recorder's thread ── blocks ──> [sink] ── bounded queue ──> feed ──> store ──> viewers
//!   a recording's file ── records, at their pace ──────────────────────────^
//! ```
//!
//! A [`Scope`] serves a page, which is part of the program and needs no internet, and sends each of
//! its viewers the recording: [`Scope::sink`] takes the blocks of a running system,
//! [`Scope::replay`] plays a recording. Nothing here is on the real-time path, and nothing here
//! makes the recorder wait: blocks that the scope cannot take in time are refused and counted as
//! lost for it.
//!
//! - Memory is bounded: the last blocks (16 MiB, unless [`Settings::memory`] sets another size, half
//!   of it for events), an overview of each signal since the beginning,
//!   the declarations, and a histogram for each loop. A viewer that connects later gets these.
//! - A viewer that reads too slowly misses blocks, and gets their number; a viewer that does not
//!   read at all is disconnected.
//! - Data beyond what a browser can draw is reduced: of the samples of one signal within 0.2 ms the
//!   first, the least and the greatest remain.
//! - A viewer can only look, and seek in a file. Parameters can be set with a token, if one was
//!   made.
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
mod merge;
mod of_system;
mod page;
mod parameters;
mod reduce;
mod replay;
mod scope;
mod server;
mod settings;
mod site;
mod store;
mod together;
mod token;

pub use feed::ScopeSink;
pub use merge::{MergeError, merge};
pub use parameters::{Parameter, Parameters};
pub use replay::{ReplayError, Speed};
pub use scope::Scope;
pub use settings::Settings;
pub use site::Site;
