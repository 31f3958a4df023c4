//! The `tracing` facade.

use crate::format::Level;
use crate::message::{Text, write};
use std::fmt::{self, Write};
use tracing_core::field::{Field, Visit};
use tracing_core::metadata::LevelFilter;
use tracing_core::span::{Attributes, Id, Record};
use tracing_core::{Dispatch, Event, Interest, Metadata, Subscriber, dispatcher};

/// A `tracing` subscriber that turns events into messages. [`install`](crate::install()) makes it
/// the program's default; use it directly for a part of a program.
///
/// ```
/// use luna_logger::{Level, TracingSubscriber};
/// tracing::subscriber::with_default(TracingSubscriber::new(Level::Info), || {
///     tracing::warn!(pressure = 7.5, "too high");
/// });
/// ```
#[derive(Debug)]
pub struct TracingSubscriber {
    most: LevelFilter,
}

impl TracingSubscriber {
    /// For events of level `most` and what matters more.
    pub fn new(most: Level) -> Self {
        Self {
            most: most.name().parse().unwrap_or(LevelFilter::TRACE),
        }
    }
}

impl Subscriber for TracingSubscriber {
    fn enabled(&self, metadata: &Metadata<'_>) -> bool {
        metadata.is_event() && *metadata.level() <= self.most
    }

    fn register_callsite(&self, metadata: &'static Metadata<'static>) -> Interest {
        // Decided once for each place in the program: a disabled event costs one load and one
        // branch.
        if self.enabled(metadata) {
            Interest::always()
        } else {
            Interest::never()
        }
    }

    fn max_level_hint(&self) -> Option<LevelFilter> {
        Some(self.most)
    }

    fn new_span(&self, _: &Attributes<'_>) -> Id {
        // No span is enabled; a number is required nevertheless.
        Id::from_u64(1)
    }

    fn record(&self, _: &Id, _: &Record<'_>) {}

    fn record_follows_from(&self, _: &Id, _: &Id) {}

    fn event(&self, event: &Event<'_>) {
        let metadata = event.metadata();
        let level = match *metadata.level() {
            tracing_core::Level::ERROR => Level::Error,
            tracing_core::Level::WARN => Level::Warn,
            tracing_core::Level::INFO => Level::Info,
            tracing_core::Level::DEBUG => Level::Debug,
            tracing_core::Level::TRACE => Level::Trace,
        };
        write(level, metadata.target(), |to| {
            event.record(&mut Fields { to, is_first: true });
            Ok(())
        });
    }

    fn enter(&self, _: &Id) {}

    fn exit(&self, _: &Id) {}
}

/// Writes the text, and the other fields as `name=value`, in the order of the event.
struct Fields<'a> {
    to: &'a mut Text,
    is_first: bool,
}

impl Fields<'_> {
    fn put(&mut self, field: &Field, value: fmt::Arguments<'_>) {
        if !std::mem::replace(&mut self.is_first, false) {
            let _ = self.to.write_char(' ');
        }
        if field.name() != "message" {
            let _ = write!(self.to, "{}=", field.name());
        }
        let _ = self.to.write_fmt(value);
    }
}

impl Visit for Fields<'_> {
    fn record_debug(&mut self, field: &Field, value: &dyn fmt::Debug) {
        self.put(field, format_args!("{value:?}"));
    }

    fn record_str(&mut self, field: &Field, value: &str) {
        if field.name() == "message" {
            self.put(field, format_args!("{value}"));
        } else {
            self.put(field, format_args!("{value:?}"));
        }
    }
}

pub(super) fn install(most: Level) -> bool {
    dispatcher::set_global_default(Dispatch::new(TracingSubscriber::new(most))).is_ok()
}
