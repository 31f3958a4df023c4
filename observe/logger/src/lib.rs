//! The logger of LUNA: records what a running machine does without disturbing it.
//!
//! - A [`Signal`] is a number, a boolean or a small vector that a process records, each sample with
//!   its time. A [`message`] is text, also through the `log` and `tracing` facades.
//! - Each thread has its own rings, created before the start, into which its processes write:
//!   wait-free, without allocation and without a system call. A full ring drops new entries and
//!   counts them exactly.
//! - A [`Recorder`] moves entries from the rings to a [`Sink`], such as a file, on an ordinary
//!   thread. If the sink blocks or fails, the real-time path does not wait: samples are lost, and
//!   counted.
//! - [`TcpSink`] and [`UdpSink`] send a recording to another computer, where a [`Receiver`] opens a
//!   sink for each sender.
//! - [`format`](mod@format) defines, reads and writes the contents of files.
//!
//! Most programs use it through `luna-rt`, which creates the [`Hub`] and the recorder with the
//! system. Used directly:
//!
//! ```
//! use luna_logger::format::{Reader, Record};
//! use luna_logger::{Hub, Recorder, Logging, Signal};
//!
//! let file = std::env::temp_dir().join(format!("luna-logger-{}.luna", std::process::id()));
//! let hub = Hub::new("bench", Default::default());
//! let recorder = Recorder::start(&hub, Logging::to_file(&file)).unwrap();
//! let _inside = hub.enter();
//! let current = Signal::<f64>::with_unit("motor/current", "A").register()?;
//! for n in 0..10 {
//!     current.record(f64::from(n));
//! }
//! let report = recorder.finish();
//! assert_eq!((report.signals[0].recorded, report.signals[0].lost), (10, 0));
//!
//! let mut reader = Reader::new(std::fs::File::open(&file).unwrap()).unwrap();
//! let mut samples = 0;
//! while let Some(record) = reader.next().unwrap() {
//!     samples += u32::from(matches!(record, Record::Sample { .. }));
//! }
//! assert_eq!(samples, 10);
//! # std::fs::remove_file(file).unwrap();
//! # Ok::<(), luna_logger::RegisterError>(())
//! ```

mod facade;
pub mod format;
mod hub;
mod lane;
mod message;
mod monitor;
mod net;
mod recorder;
mod registry;
mod sample;
mod signal;
mod thread;

#[cfg(feature = "tracing")]
pub use facade::TracingSubscriber;
pub use facade::install;
pub use format::Level;
pub use hub::{Entered, Hub, TimeBase};
pub use message::message;
pub use net::{Departure, Handler, Peer, PeerError, Receiver, Receiving, TcpSink, UdpSink};
#[cfg(feature = "events")]
pub use recorder::EventsReport;
pub use recorder::{
    FileSink, Logging, LoggingReport, MessagesReport, Recorder, SignalReport, Sink, StartError,
    Tee, WriterSink,
};
pub use registry::RegisterError;
pub use sample::{Element, Sample};
pub use signal::{Signal, SignalBuilder};
