//! The texts of processes, parts and buffers.

use super::{RecordedChannel, RecordedExecutor, RecordedProcess, name_in_model};
use std::collections::BTreeSet;
use std::fmt::Write;

/// Larger buffers have too many states to be checked.
pub(crate) const MAX_BUFFER: usize = 255;
/// A buffer that would have held more values, and need not, is taken for one that overwrites.
const MAX_HELD: usize = 16;

/// A process of the model: what is bound to what, by the names of channels.
#[derive(Debug, Default)]
pub(super) struct Part {
    pub(super) sends: BTreeSet<String>,
    pub(super) receives: BTreeSet<String>,
    pub(super) run: Vec<String>,
}

pub(super) fn buffer(channel: &RecordedChannel) -> String {
    let (held, least) = (channel.held, channel.least);
    match &channel.buffer {
        Some(none) if none.is_empty() => return String::new(),
        Some(buffer) => return format!("buffer = {}\n", quoted(buffer)),
        None => {}
    }
    match held {
        0 => String::new(),
        _ if least == 0 && held > MAX_BUFFER => {
            format!("buffer = \"fifo {MAX_BUFFER}\" # of {held}\n")
        }
        _ if least == 0 => format!("buffer = \"fifo {held}\"\n"),
        _ if held <= MAX_HELD || (held <= least && held <= MAX_BUFFER) => {
            format!("buffer = \"fifo {held}\" # it held no more\n")
        }
        _ => {
            let least = least.clamp(1, MAX_BUFFER);
            format!("buffer = \"overwrite_oldest {least}\" # or a FIFO of {held} or more\n")
        }
    }
}

pub(super) fn run(process: &RecordedProcess) -> Vec<String> {
    let mut lines = Vec::new();
    if let Some(priority) = process.priority {
        lines.push(format!("priority = {priority}"));
    }
    if let Some(period) = process.period.filter(|period| !period.is_zero()) {
        let nanos = period.as_nanos();
        let (number, unit) = match nanos {
            _ if nanos.is_multiple_of(1_000_000) => (nanos / 1_000_000, "ms"),
            _ if nanos.is_multiple_of(1000) => (nanos / 1000, "us"),
            _ => (nanos, "ns"),
        };
        if number <= 1_000_000_000 {
            lines.push(format!("period = \"{number} {unit}\""));
        }
    }
    if let Some(executor) = &process.executor {
        lines.push(format!("on = {}", quoted(&name_in_model(executor))));
    }
    lines
}

pub(super) fn executor(name: &str, executor: &RecordedExecutor) -> String {
    let mut text = format!("\n[executor.{}]", key(name));
    let mut line = |line: std::fmt::Arguments<'_>| {
        let _ = writeln!(text, "{line}");
    };
    match &executor.policy {
        Some(policy) => line(format_args!("\npolicy = {}", quoted(policy))),
        None => line(format_args!(" # its policy is not recorded")),
    }
    if executor.is_thread {
        line(format_args!("kind = \"thread\""));
    }
    match (executor.core, &executor.policy) {
        (Some(core), Some(_)) => line(format_args!("core = {core}")),
        (Some(core), None) => line(format_args!(
            "core = {core} # where it ran when a cycle was late"
        )),
        (None, _) => {}
    }
    text
}

/// The ports of a part, each with its channel: first those that receive, then those that send.
fn ports(part: &Part) -> Vec<(String, &str, &'static str)> {
    let mut ports: Vec<(String, &str, &str)> = Vec::new();
    let receives = part.receives.iter().map(|channel| (channel, "receive"));
    let sends = part.sends.iter().map(|channel| (channel, "send"));
    for (channel, side) in receives.chain(sends) {
        let mut port = channel.clone();
        // It both sends and receives there.
        while ports.iter().any(|(other, ..)| *other == port) {
            port += "_out";
        }
        ports.push((port, channel, side));
    }
    ports
}

pub(super) fn definition(name: &str, part: &Part) -> String {
    let ports = ports(part);
    let mut text = format!("\n[process.{}]\n", key(name));
    if !ports.is_empty() {
        let listed: Vec<String> = ports
            .iter()
            .map(|(port, _, side)| format!("{} = \"{side}\"", key(port)))
            .collect();
        let _ = writeln!(text, "ports = {{ {} }}", listed.join(", "));
    }
    // What it sends to itself, one of its branches sends to another.
    let is_own = |channel: &str| part.sends.contains(channel) && part.receives.contains(channel);
    let offers = |is_second: bool| -> Vec<String> {
        let chosen = ports
            .iter()
            .filter(|(_, channel, side)| is_second == (is_own(channel) && *side == "receive"));
        let offer = |(port, _, side): &(String, &str, &str)| match *side {
            "send" => format!("{port}!"),
            _ => format!("{port}?"),
        };
        chosen.map(offer).collect()
    };
    let (first, second) = (offers(false), offers(true));
    let body = match (&first[..], &second[..]) {
        ([], []) => "loop { work }".to_owned(),
        (_, []) => any_of(&first),
        _ => format!("par {{ {} | {} }}", any_of(&first), any_of(&second)),
    };
    let _ = writeln!(text, "body = \"{body}\"");
    text
}

/// Takes any of these, again and again.
fn any_of(offers: &[String]) -> String {
    match offers {
        [only] => format!("loop {{ {only} }}"),
        _ => format!("loop {{ alt {{ {} }} }}", offers.join(" | ")),
    }
}

pub(super) fn instance(name: &str, part: &Part) -> String {
    let mut text = format!(
        "\n[system.part.{}]\nprocess = {}\n",
        key(name),
        quoted(name)
    );
    let ports = ports(part);
    if !ports.is_empty() {
        let bound: Vec<String> = ports
            .iter()
            .map(|(port, channel, _)| format!("{} = {}", key(port), quoted(channel)))
            .collect();
        let _ = writeln!(text, "bind = {{ {} }}", bound.join(", "));
    }
    for line in &part.run {
        let _ = writeln!(text, "{line}");
    }
    text
}

/// A key of TOML: other letters than those of ASCII stand in quotes.
pub(super) fn key(name: &str) -> String {
    match name.is_ascii() {
        true => name.to_owned(),
        false => quoted(name),
    }
}

/// A text of TOML.
pub(super) fn quoted(text: &str) -> String {
    let mut quoted = String::from("\"");
    for letter in text.chars() {
        match letter {
            '"' | '\\' => quoted.extend(['\\', letter]),
            letter if letter.is_control() => {
                let _ = write!(quoted, "\\u{:04X}", u32::from(letter));
            }
            letter => quoted.push(letter),
        }
    }
    quoted + "\""
}
