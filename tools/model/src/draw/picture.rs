//! What is drawn: boxes in boxes, and arrows between the innermost ones.

use crate::file::At;
use crate::network::{Buffering, Network};
use std::collections::BTreeMap;

/// A group's content, in the order of the file.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Item {
    Group(usize),
    Process(usize),
}

/// Channels from one process to another; more than one with the same ends are one arrow.
#[derive(Debug, PartialEq, Eq)]
pub(super) struct Arrow {
    pub(super) from: usize,
    pub(super) to: usize,
    pub(super) channels: Vec<usize>,
    /// The channels' names without the parts that they are in, and what they hold.
    pub(super) label: String,
}

/// At most so many channels are named on one arrow.
const MAX_NAMED: usize = 3;

pub(super) fn arrows(network: &Network) -> Vec<Arrow> {
    let mut found: BTreeMap<(usize, usize), (Vec<usize>, Vec<String>)> = BTreeMap::new();
    for (number, channel) in network.channels.iter().enumerate() {
        let mut label = short(&channel.name).to_owned();
        match channel.kind {
            Buffering::Rendezvous => {}
            Buffering::Fifo(n) => label.push_str(&format!(" (fifo {n})")),
            Buffering::OverwriteOldest(n) => label.push_str(&format!(" (overwrite oldest {n})")),
            Buffering::OverwriteNewest(n) => label.push_str(&format!(" (overwrite newest {n})")),
        }
        for &from in &channel.senders {
            for &to in &channel.receivers {
                let (channels, labels) = found.entry((from, to)).or_default();
                channels.push(number);
                labels.push(label.clone());
            }
        }
    }
    let arrows = found.into_iter().map(|((from, to), (channels, labels))| {
        let more = labels.len().saturating_sub(MAX_NAMED);
        let mut label = labels[..labels.len() - more].join(", ");
        if more > 0 {
            label.push_str(&format!(", {more} more"));
        }
        Arrow {
            from,
            to,
            channels,
            label,
        }
    });
    arrows.collect()
}

/// A box around others: the system, a part that is made of parts, or processes whose names differ
/// in their last word alone.
#[derive(Debug)]
pub(super) struct Group<'a> {
    pub(super) name: &'a str,
    pub(super) parent: Option<usize>,
    pub(super) at: Option<At>,
}

/// Which boxes are in which.
#[derive(Debug)]
pub(super) struct Groups<'a> {
    /// The system first; a group stands behind the one that it is in.
    pub(super) all: Vec<Group<'a>>,
    /// Of each process the group that it is in.
    pub(super) of: Vec<usize>,
}

/// So many processes in one box are too many to be told apart: those whose names differ in their
/// last word alone are put together.
const MANY: usize = 12;

/// The groups of the model, and those of names.
pub(super) fn groups(network: &Network) -> Groups<'_> {
    let of_model = network.groups.iter().map(|group| Group {
        name: short(&group.name),
        parent: group.parent,
        at: group.at,
    });
    let mut groups = Groups {
        all: of_model.collect(),
        of: network.processes.iter().map(|one| one.group).collect(),
    };
    for parent in 0..network.groups.len() {
        let within = (0..groups.of.len()).filter(|one| groups.of[*one] == parent);
        let within: Vec<usize> = within.collect();
        let is_placed = |one: &usize| network.processes[*one].at.is_some();
        if within.len() < MANY || within.iter().any(is_placed) {
            continue;
        }
        let mut by_words: BTreeMap<&str, Vec<usize>> = BTreeMap::new();
        for &process in &within {
            let name = short(&network.processes[process].name);
            if let Some((words, _)) = name.rsplit_once(['_', ' ', '/']) {
                by_words.entry(words).or_default().push(process);
            }
        }
        by_words.retain(|_, processes| (2..within.len()).contains(&processes.len()));
        for (name, processes) in by_words {
            for process in processes {
                groups.of[process] = groups.all.len();
            }
            let parent = Some(parent);
            let at = None;
            groups.all.push(Group { name, parent, at });
        }
    }
    groups
}

/// Each group's content.
pub(super) fn contents(groups: &Groups<'_>) -> Vec<Vec<Item>> {
    let mut contents = vec![Vec::new(); groups.all.len()];
    for (number, group) in groups.all.iter().enumerate() {
        if let Some(parent) = group.parent {
            contents[parent].push(Item::Group(number));
        }
    }
    for (process, group) in groups.of.iter().enumerate() {
        contents[*group].push(Item::Process(process));
    }
    contents
}

/// A name without the parts that it is in.
pub(super) fn short(name: &str) -> &str {
    name.rsplit('.').next().unwrap_or(name)
}

/// The second line of a process: what it is, and how it runs.
pub(super) fn details(network: &Network, process: usize) -> String {
    let process = &network.processes[process];
    let mut words = vec![process.definition.clone()];
    if let Some(period) = process.period {
        words.push(format!("{period:?}"));
    }
    if let Some(priority) = process.priority {
        words.push(format!("priority {priority}"));
    }
    if let Some(on) = &process.on {
        words.push(format!("on {on}"));
    }
    words.join(", ")
}

/// How a language of pictures writes what is drawn, all by their numbers and labels.
pub(super) struct Text {
    pub(super) quoted: fn(&str) -> String,
    pub(super) process: fn(usize, &str) -> String,
    /// The begin of a group, behind this indentation.
    pub(super) group: fn(usize, &str, &str) -> String,
    pub(super) end: &'static str,
    pub(super) arrow: fn(usize, usize, &str) -> String,
}

/// The groups with what is in them, and then the arrows.
pub(super) fn written(network: &Network, text: &Text) -> String {
    let groups = groups(network);
    let mut lines = inner(network, &groups, text, &contents(&groups), 0, "  ");
    for arrow in arrows(network) {
        let label = (text.quoted)(&arrow.label);
        lines += &format!("  {}\n", (text.arrow)(arrow.from, arrow.to, &label));
    }
    lines
}

fn inner(
    network: &Network,
    groups: &Groups<'_>,
    text: &Text,
    contents: &[Vec<Item>],
    group: usize,
    indent: &str,
) -> String {
    let items = contents[group].iter().map(|item| match *item {
        Item::Process(process) => {
            let name = short(&network.processes[process].name);
            let label = (text.quoted)(&format!("{name}\n{}", details(network, process)));
            format!("{indent}{}\n", (text.process)(process, &label))
        }
        Item::Group(group) => {
            let label = (text.quoted)(groups.all[group].name);
            let begin = (text.group)(group, &label, indent);
            let within = inner(
                network,
                groups,
                text,
                contents,
                group,
                &format!("{indent}  "),
            );
            format!("{indent}{begin}\n{within}{indent}{}\n", text.end)
        }
    });
    items.collect()
}
