//! A model file of what was recorded: which processes and channels there are, and what uses what.

#[cfg(test)]
mod tests;
mod text;

use crate::language::body::RESERVED;
use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write;
use std::time::Duration;
pub(crate) use text::MAX_BUFFER;
use text::{Part, buffer, definition, executor, instance, key, quoted, run};

/// What a recording says of a system.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Recorded {
    /// The system's name.
    pub system: String,
    /// Its processes; several of one name are one.
    pub processes: Vec<RecordedProcess>,
    /// Its channels, each with a name of its own: see [`same_names`](Self::same_names).
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
    /// What its buffer is, as a model says it: `fifo 3`, `overwrite_oldest 1`; empty of a
    /// rendezvous. `None` if it is not known: then it is taken from the next two.
    pub buffer: Option<String>,
    /// How many values it held at most, if it overwrites none. 0: senders and receivers met.
    pub held: usize,
    /// The least size of an overwriting buffer with which all receives find a value. 0 if that is
    /// not known: then `held` is the capacity.
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
    /// Whether it has one process alone.
    pub is_thread: bool,
    /// Its policy, as in `fifo:80`; none if it is not known.
    pub policy: Option<String>,
    /// Its core; if its policy is not known, the core on which it was seen.
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

/// The name of what is outside of a system, in a model of it: no process of it has this name.
pub(crate) fn outside(is_taken: impl Fn(&str) -> bool) -> String {
    let mut outside = "outside".to_owned();
    while is_taken(&outside) {
        outside.push('_');
    }
    outside
}

impl Recorded {
    /// The names that several channels have, each once. Of these, a model cannot be made: in it
    /// they would be one channel.
    ///
    /// ```
    /// use luna_model::{Recorded, RecordedChannel};
    ///
    /// let channel = |name: &str| RecordedChannel { name: name.to_owned(), ..Default::default() };
    /// let recorded = Recorded {
    ///     channels: vec![channel("way"), channel("back"), channel("way")],
    ///     ..Default::default()
    /// };
    /// assert_eq!(recorded.same_names(), ["way"]);
    /// ```
    #[must_use]
    pub fn same_names(&self) -> Vec<&str> {
        let mut seen: BTreeMap<String, usize> = BTreeMap::new();
        let again = self.channels.iter().filter(|channel| {
            let times = seen.entry(name_in_model(&channel.name)).or_default();
            *times += 1;
            *times == 2
        });
        again.map(|channel| channel.name.as_str()).collect()
    }

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
        for (name, channel) in self.channels() {
            let _ = write!(
                text,
                "\n[system.channel.{}]\n{}",
                key(&name),
                buffer(channel)
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
            let run = run(process);
            if run.len() > part.run.len() {
                part.run = run;
            }
        }
        let outside = outside(|name| names.iter().any(|known| known == name));
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

    /// By their names in the model.
    fn channels(&self) -> BTreeMap<String, &RecordedChannel> {
        let channels = self.channels.iter();
        let named = channels.map(|channel| (name_in_model(&channel.name), channel));
        named.collect()
    }

    fn executors(&self) -> String {
        let used = self
            .processes
            .iter()
            .filter_map(|one| one.executor.as_ref());
        let mut executors: BTreeMap<String, RecordedExecutor> = used
            .map(|name| (name_in_model(name), RecordedExecutor::default()))
            .collect();
        for executor in &self.executors {
            if let Some(known) = executors.get_mut(&name_in_model(&executor.name)) {
                let core = executor.core.or(known.core);
                *known = RecordedExecutor {
                    core,
                    ..executor.clone()
                };
            }
        }
        executors
            .iter()
            .map(|(name, one)| executor(name, one))
            .collect()
    }
}
