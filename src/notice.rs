//! The framework's messages on standard error.

use luna_machine::signals;
use std::fmt;
use std::io::Write;

/// Writes a line, as `eprintln!` does, but never panics: standard error may be a pipe with a closed
/// reading end, and that must not end a system without its emergency functions.
macro_rules! notice {
    ($($line:tt)*) => {
        $crate::notice::line(format_args!($($line)*))
    };
}
pub(crate) use notice;

/// See [`notice!`].
pub(crate) fn line(line: fmt::Arguments<'_>) {
    // In one write, so that lines of several threads stay whole. An error is ignored: there is no
    // other place to report it. Standard error may be a file that has reached its limit, or a
    // terminal that this program may not write to: that is no reason to end the machine.
    let line = format!("{line}\n");
    let _ = signals::without_write_signals(|| std::io::stderr().write_all(line.as_bytes()));
}
