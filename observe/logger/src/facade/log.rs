//! The `log` facade.

use crate::format::Level;
use crate::message::write;
use log::{LevelFilter, Log, Metadata, Record};
use std::fmt::Write;

struct Facade;

impl Log for Facade {
    fn enabled(&self, metadata: &Metadata<'_>) -> bool {
        metadata.level() <= log::max_level()
    }

    fn log(&self, record: &Record<'_>) {
        if self.enabled(record.metadata()) {
            let level = match record.level() {
                log::Level::Error => Level::Error,
                log::Level::Warn => Level::Warn,
                log::Level::Info => Level::Info,
                log::Level::Debug => Level::Debug,
                log::Level::Trace => Level::Trace,
            };
            write(level, record.target(), |to| to.write_fmt(*record.args()));
        }
    }

    /// The recorder moves messages on by itself.
    fn flush(&self) {}
}

pub(super) fn install(most: Level) -> bool {
    let is_first = log::set_logger(&Facade).is_ok();
    if is_first {
        log::set_max_level(most.name().parse().unwrap_or(LevelFilter::Trace));
    }
    is_first
}
