//! What a command prints. A reader that is gone is an error, not a panic.

use crate::failure::Failure;
use std::io::Write;

/// One JSON object on one line.
pub(crate) fn print_json(
    out: &mut impl Write,
    value: &impl serde::Serialize,
) -> std::io::Result<()> {
    serde_json::to_writer(&mut *out, value)?;
    writeln!(out)?;
    out.flush()
}

/// Parts with an empty line between them.
pub(crate) fn print_parts(
    out: &mut impl Write,
    parts: impl IntoIterator<Item = String>,
) -> std::io::Result<()> {
    for (n, part) in parts.into_iter().enumerate() {
        let gap = if n == 0 { "" } else { "\n" };
        writeln!(out, "{gap}{}", part.trim_end())?;
    }
    out.flush()
}

/// Writes text to standard output.
pub(crate) fn say(text: &str) -> Result<(), Failure> {
    let mut out = std::io::stdout().lock();
    let written = out.write_all(text.as_bytes()).and_then(|()| out.flush());
    written.map_err(Failure::Output)
}
