//! A model file of what was recorded: which processes and channels there are, and what uses what.

use crate::language::body::RESERVED;
use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write;
use std::time::Duration;

/// Larger buffers are no part of a model.
const MAX_BUFFER: usize = 255;
/// A buffer that would have held more values, and need not, is taken for one that overwrites.
const MAX_HELD: usize = 16;

/// What a recording says of a system.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Recorded {
    /// The system's name.
    pub system: String,
    /// Its processes; several of one name are one.
    pub processes: Vec<RecordedProcess>,
    /// Its channels; several of one name are one.
    pub channels: Vec<RecordedChannel>,
    /// Its executors and threads; several of one name are one.
    pub executors: Vec<RecordedExecutor>,
}

/// A process of a recording.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct RecordedProcess {
    /// Its name.
    pub name: String,
    /// Its level on its executor.
    pub priority: Option<u8>,
    /// The period of its loop.
    pub period: Option<Duration>,
    /// The name of its executor or thread.
    pub executor: Option<String>,
}

/// A channel of a recording.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct RecordedChannel {
    /// Its name.
    pub name: String,
    /// How many values it held at most, if it overwrites none. 0: senders and receivers met.
    pub held: usize,
    /// How many values a buffer that overwrites must hold, so that all that was received was there.
    pub least: usize,
    /// What sent, by the places of the processes. None: what is outside of the system.
    pub senders: BTreeSet<Option<usize>>,
    /// What received.
    pub receivers: BTreeSet<Option<usize>>,
}

/// An executor or thread of a recording.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct RecordedExecutor {
    /// Its name.
    pub name: String,
    /// The core on which it was seen.
    pub core: Option<usize>,
}

/// The name that something of a program has in a model: letters, digits and `_` stay, all else
/// becomes `_`. A digit at the begin, or a word with a meaning of its own, gets a `_`.
///
/// ```
/// use luna_model::name_in_model;
///
/// assert_eq!(name_in_model("pan"), "pan");
/// assert_eq!(name_in_model("philosopher[0]"), "philosopher_0");
/// assert_eq!(name_in_model("src/main.rs:12:5"), "src_main_rs_12_5");
/// assert_eq!((name_in_model("2nd"), name_in_model("loop")), ("_2nd".into(), "loop_".into()));
/// ```
#[must_use]
pub fn name_in_model(name: &str) -> String {
    let mut word = String::new();
    for letter in name.chars() {
        match letter {
            letter if letter.is_alphanumeric() || letter == '_' => word.push(letter),
            // No two for `].`, and none at the end.
            _ if !word.ends_with('_') => word.push('_'),
            _ => {}
        }
    }
    if !name.ends_with('_') {
        word.truncate(word.trim_end_matches('_').len());
    }
    let has_letter_first = |word: &str| {
        let first = word.chars().next();
        first.is_some_and(|first| first.is_alphabetic() || first == '_')
    };
    if !has_letter_first(&word) {
        word.insert(0, '_');
    }
    if RESERVED.contains(&word.as_str()) {
        word.push('_');
    }
    word
}

/// A process of the model: what is bound to what, by the names of channels.
#[derive(Debug, Default)]
struct Part {
    sends: BTreeSet<String>,
    receives: BTreeSet<String>,
    run: Vec<String>,
}

impl Recorded {
    /// A model file with a process for each name. A process takes its communications in any order:
    /// that is for the reader to refine. `source` is where it comes from, for a comment.
    ///
    /// ```
    /// use luna_model::{Model, Recorded, RecordedChannel, RecordedProcess};
    ///
    /// let process = |name: &str| RecordedProcess { name: name.to_owned(), ..Default::default() };
    /// let recorded = Recorded {
    ///     system: "pair".to_owned(),
    ///     processes: vec![process("one"), process("other")],
    ///     channels: vec![RecordedChannel {
    ///         name: "way".to_owned(),
    ///         senders: [Some(0)].into(),
    ///         receivers: [Some(1)].into(),
    ///         ..Default::default()
    ///     }],
    ///     ..Default::default()
    /// };
    /// let model = Model::parse("pair.toml", &recorded.to_model("pair.luna"))?;
    /// assert_eq!((model.name(), model.processes(), model.channels()), ("pair", 2, 1));
    /// # Ok::<(), luna_model::Problem>(())
    /// ```
    #[must_use]
    pub fn to_model(&self, source: &str) -> String {
        let parts = self.parts();
        let mut text = format!(
            "# What ran in {}: its processes and channels.\n\
             # A process takes its communications in any order here. Write down what it really does:\n\
             # until then, a check of this file says nothing about the program.\n\
             name = {}\n",
            source.replace(char::is_control, " "),
            quoted(&self.system),
        );
        for (name, part) in &parts {
            text += &definition(name, part);
        }
        text += &self.executors();
        for (name, [held, least]) in self.channels() {
            let _ = write!(
                text,
                "\n[system.channel.{}]\n{}",
                key(&name),
                buffer(held, least)
            );
        }
        for (name, part) in &parts {
            text += &instance(name, part);
        }
        text
    }

    /// By their names in the model.
    fn parts(&self) -> BTreeMap<String, Part> {
        let mut parts: BTreeMap<String, Part> = BTreeMap::new();
        let names: Vec<String> = self
            .processes
            .iter()
            .map(|process| name_in_model(&process.name))
            .collect();
        for (name, process) in names.iter().zip(&self.processes) {
            let part = parts.entry(name.clone()).or_default();
            part.run = run(process);
        }
        // No process of the recording has this name.
        let mut outside = "outside".to_owned();
        while names.contains(&outside) {
            outside.push('_');
        }
        let outside = Some(&outside);
        let name_of = |user: &Option<usize>| match user {
            Some(process) => names.get(*process),
            None => outside,
        };
        for channel in &self.channels {
            let name = name_in_model(&channel.name);
            let none = BTreeSet::from([None]);
            let or_none = |users: &BTreeSet<Option<usize>>| match users.is_empty() {
                true => none.clone(),
                false => users.clone(),
            };
            for user in or_none(&channel.senders).iter().filter_map(name_of) {
                let part = parts.entry(user.clone()).or_default();
                part.sends.insert(name.clone());
            }
            for user in or_none(&channel.receivers).iter().filter_map(name_of) {
                let part = parts.entry(user.clone()).or_default();
                part.receives.insert(name.clone());
            }
        }
        parts
    }

    /// By their names in the model, with what they held, and must hold. Buffers of one name hold
    /// together what each of them holds.
    fn channels(&self) -> BTreeMap<String, [usize; 2]> {
        let mut channels: BTreeMap<String, [usize; 2]> = BTreeMap::new();
        for channel in &self.channels {
            let [held, least] = channels.entry(name_in_model(&channel.name)).or_default();
            *held = held.saturating_add(channel.held);
            *least = least.saturating_add(channel.least);
        }
        channels
    }

    fn executors(&self) -> String {
        let used = self
            .processes
            .iter()
            .filter_map(|one| one.executor.as_ref());
        let mut executors: BTreeMap<String, Option<usize>> =
            used.map(|name| (name_in_model(name), None)).collect();
        for executor in &self.executors {
            if let Some(core) = executors.get_mut(&name_in_model(&executor.name)) {
                *core = executor.core.or(*core);
            }
        }
        let mut text = String::new();
        for (name, core) in executors {
            let _ = write!(
                text,
                "\n[executor.{}] # its policy is not recorded\n",
                key(&name)
            );
            if let Some(core) = core {
                let _ = writeln!(text, "core = {core} # where it ran when a cycle was late");
            }
        }
        text
    }
}

fn buffer(held: usize, least: usize) -> String {
    match held {
        0 => String::new(),
        _ if held <= MAX_HELD || (held <= least && held <= MAX_BUFFER) => {
            format!("buffer = \"fifo {held}\" # it held no more\n")
        }
        _ => {
            let least = least.clamp(1, MAX_BUFFER);
            format!("buffer = \"overwrite_oldest {least}\" # or a FIFO of {held} or more\n")
        }
    }
}

fn run(process: &RecordedProcess) -> Vec<String> {
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

fn definition(name: &str, part: &Part) -> String {
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

fn instance(name: &str, part: &Part) -> String {
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
fn key(name: &str) -> String {
    match name.is_ascii() {
        true => name.to_owned(),
        false => quoted(name),
    }
}

/// A text of TOML.
fn quoted(text: &str) -> String {
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Model;
    use crate::network::Kind;

    fn process(name: &str) -> RecordedProcess {
        RecordedProcess {
            name: name.to_owned(),
            ..RecordedProcess::default()
        }
    }

    fn channel(name: &str, held: usize, from: &[usize], to: &[usize]) -> RecordedChannel {
        let users = |users: &[usize]| users.iter().copied().map(Some).collect();
        RecordedChannel {
            name: name.to_owned(),
            held,
            least: 2,
            senders: users(from),
            receivers: users(to),
        }
    }

    fn parse(recorded: &Recorded) -> Model {
        let text = recorded.to_model("a.luna\nb");
        Model::parse("a.toml", &text).unwrap_or_else(|problem| panic!("{problem}\n{text}"))
    }

    #[test]
    fn what_ran_becomes_a_model_with_all_that_is_known() {
        let recorded = Recorded {
            system: "a \"quoted\" name".to_owned(),
            processes: vec![
                RecordedProcess {
                    priority: Some(7),
                    period: Some(Duration::from_micros(1500)),
                    executor: Some("main thread".to_owned()),
                    ..process("pan/control")
                },
                process("motor[0]"),
                process("idle"),
                process("outside"),
            ],
            channels: vec![
                channel("torque[0]", 0, &[0], &[1]),
                channel("image", 3, &[0], &[1]),
                channel("log", 300, &[1], &[]),
                channel("own", 0, &[0], &[0]),
                channel("own", 0, &[1], &[]),
                channel("größe", 0, &[], &[1]),
            ],
            executors: vec![RecordedExecutor {
                name: "main thread".to_owned(),
                core: Some(1),
            }],
        };
        let model = parse(&recorded);
        let network = &model.network;
        assert_eq!(network.name, "a \"quoted\" name");
        let names: Vec<&str> = model.process_names().collect();
        let expected = ["idle", "motor_0", "outside", "outside_", "pan_control"];
        assert_eq!(names, expected);
        let channels: Vec<&str> = model.channel_names().collect();
        assert_eq!(channels, ["größe", "image", "log", "own", "torque_0"]);
        let control = &network.processes[4];
        assert_eq!(control.priority, Some(7));
        assert_eq!(control.period, Some(Duration::from_micros(1500)));
        assert_eq!(control.on.as_deref(), Some("main_thread"));
        let kinds = network.channels.iter().map(|channel| channel.kind);
        let (rendezvous, fifo, overwriting) =
            (Kind::Rendezvous, Kind::Fifo(3), Kind::OverwriteOldest(2));
        assert!(kinds.eq([rendezvous, fifo, overwriting, rendezvous, rendezvous]));
        let own = &network.channels[3];
        assert_eq!(
            (&own.senders[..], &own.receivers[..]),
            (&[1, 4][..], &[3, 4][..])
        );
    }

    #[test]
    fn any_name_is_one_of_a_model() {
        for name in [
            "", "[", "a.b[3].c", "2", "if", "über", "_", "a_", "a-b", "system", "x\ny",
        ] {
            let recorded = Recorded {
                processes: vec![process(name), process("other one")],
                channels: vec![channel(name, 0, &[0], &[1])],
                ..Recorded::default()
            };
            let model = parse(&recorded);
            let word = name_in_model(name);
            assert!(model.process_names().any(|found| found == word), "{name}");
            assert_eq!(model.channel_names().next(), Some(word.as_str()));
        }
    }
}
