//! What a command prints. A reader that is gone is an error, not a panic.

use crate::failure::Failure;
use std::io::Write;

/// Prints what a command has found: as one JSON object on one line, or as parts of text with an
/// empty line between them.
pub fn print<P: IntoIterator<Item = String>>(
    as_json: bool,
    value: &impl serde::Serialize,
    parts: impl FnOnce() -> P,
) -> Result<(), Failure> {
    if as_json {
        let json = serde_json::to_string(value);
        return say(&(json.map_err(|error| Failure::Output(error.into()))? + "\n"));
    }
    let parts = parts().into_iter();
    let parts: Vec<String> = parts
        .map(|part| part.trim_end().to_owned() + "\n")
        .collect();
    say(&parts.join("\n"))
}

/// Writes text to standard output.
pub fn say(text: &str) -> Result<(), Failure> {
    let mut out = std::io::stdout().lock();
    let written = out.write_all(text.as_bytes()).and_then(|()| out.flush());
    written.map_err(Failure::Output)
}
