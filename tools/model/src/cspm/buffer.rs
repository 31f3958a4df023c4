//! A buffer: a process that takes and gives values by its kind.

use super::Writer;
use crate::file::Side;
use crate::network::Buffering;
use std::fmt::Write;

impl Writer<'_> {
    /// Whether a buffer is to know which receivers have not ended: without one it takes no more.
    fn counts_receivers(&self, channel: usize) -> bool {
        !self.alphabets.senders[channel].is_empty()
            && self.ending.may_close(self.network, channel, Side::Send)
    }

    /// A buffer that holds nothing.
    pub(super) fn empty_buffer(&self, channel: usize) -> String {
        let name = &self.names.channels[channel].process;
        let empty = if self.network.channels[channel].values.is_some() {
            "<>"
        } else {
            "0"
        };
        match self.counts_receivers(channel) {
            true => {
                let receivers = self.partners(channel, Side::Send);
                format!("{name}({empty}, {})", self.agents(&receivers))
            }
            false => format!("{name}({empty})"),
        }
    }

    pub(super) fn buffer(&mut self, channel: usize) {
        let found = &self.network.channels[channel];
        let (senders, receivers) = (
            &self.alphabets.senders[channel],
            &self.alphabets.receivers[channel],
        );
        if found.kind == Buffering::Rendezvous || senders.is_empty() && receivers.is_empty() {
            return;
        }
        let names = &self.names.channels[channel];
        let counts_receivers = self.counts_receivers(channel);
        let has_values = found.values.is_some();
        let live = if counts_receivers { ", live" } else { "" };
        let this = |content: &str| format!("{}({content}{live})", names.process);
        // What it holds: a sequence of values, or their number.
        let (content, length) = if has_values { ("q", "#q") } else { ("n", "n") };
        let one_more = if has_values { "q ^ <value>" } else { "n + 1" };
        let full = match (found.kind, has_values) {
            (Buffering::OverwriteNewest(_), true) => "without_newest(q) ^ <value>",
            (_, true) => "tail(q) ^ <value>",
            (_, false) => "n",
        };
        let capacity = found.kind.capacity();
        let sender = if senders.len() > 1 { "?sender" } else { "" };
        let receiver = if receivers.len() > 1 { "?receiver" } else { "" };
        let mut offers = Vec::new();
        if !senders.is_empty() {
            let value = if has_values { "?value" } else { "" };
            let mut conditions = Vec::new();
            if counts_receivers {
                conditions.push("(not empty(live))".to_owned());
            }
            let next = match found.kind {
                Buffering::Rendezvous | Buffering::Fifo(_) => {
                    conditions.push(format!("({length} < {capacity})"));
                    this(one_more)
                }
                Buffering::OverwriteOldest(_) | Buffering::OverwriteNewest(_) => {
                    let (more, full) = (this(one_more), this(full));
                    format!("(if {length} < {capacity} then {more} else {full})")
                }
            };
            let put = format!("{}{sender}{value} -> {next}", names.put);
            offers.push(match conditions.is_empty() {
                true => format!("({put})"),
                false => format!("(({}) & ({put}))", conditions.join(" and ")),
            });
        }
        if !receivers.is_empty() {
            let (value, rest) = if has_values {
                ("!head(q)", "tail(q)")
            } else {
                ("", "n - 1")
            };
            let get = format!("{}{receiver}{value} -> {}", names.get, this(rest));
            offers.push(format!("(({length} > 0) & ({get}))"));
        }
        if !self.alphabets.closed(channel, Side::Receive).is_empty() {
            let end_notice = format!("{}?receiver -> {}", names.no_sender, this(content));
            offers.push(format!("(({length} == 0) & ({end_notice}))"));
        }
        if counts_receivers {
            let next = format!("{}({content}, diff(live, {{other}}))", names.process);
            offers.push(format!("(ends?other:live -> {next})"));
        }
        let title = super::comment(&found.name);
        let _ = writeln!(
            self.text,
            "\n-- The buffer {title}\n{} =\n  {}",
            this(content),
            offers.join("\n  [] ")
        );
    }

    pub(super) fn buffer_events(&self, channel: usize) -> Vec<String> {
        let names = &self.names.channels[channel];
        let mut events = Vec::new();
        if !self.alphabets.senders[channel].is_empty() {
            events.push(names.put.clone());
        }
        if !self.alphabets.receivers[channel].is_empty() {
            events.push(names.get.clone());
        }
        if !self.alphabets.closed(channel, Side::Receive).is_empty() {
            events.push(names.no_sender.clone());
        }
        if self.counts_receivers(channel) {
            let receivers = self.partners(channel, Side::Send);
            events.extend(
                receivers
                    .iter()
                    .map(|&one| format!("ends.{}", self.names.agents[one])),
            );
        }
        events
    }
}
