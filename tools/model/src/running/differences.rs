//! What of a system is not as its model says.

use super::read::{capacity, users};
use crate::network::{Channel, Executor, Network, Process};
use crate::recorded::{MAX_BUFFER, name_in_model, outside};
use luna::Policy;
use luna::inspect::{ChannelPart, Composition, EndUser, ProcessPart, ThreadKind, ThreadPart};
use rustc_hash::FxHashMap;
use std::fmt;

/// One difference between a system and its model.
///
/// Its text names the part, and what it is here and there.
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub struct Difference {
    /// `process`, `thread` (also an executor's) or `channel`.
    pub part: &'static str,
    /// The name of that.
    pub name: String,
    /// What it is in the system; none if it is not there, `there` if it is in the system alone.
    pub system: Option<String>,
    /// What it is in the model; none if it is not there, `there` if it is in the model alone.
    pub model: Option<String>,
}

impl fmt::Display for Difference {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} `{}`", self.part, self.name)?;
        match (&self.system, &self.model) {
            (Some(system), Some(model)) => write!(f, ": {system}, in the model {model}"),
            (Some(_), None) => f.write_str(" is not in the model"),
            (None, _) => f.write_str(" is in the model alone"),
        }
    }
}

/// A system is not as its model says.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("the system is not as its model {model} says:{}", listed(differences))]
#[non_exhaustive]
pub struct Wiring {
    /// The name of the model.
    pub model: String,
    /// All that differs: processes, executors, channels.
    pub differences: Vec<Difference>,
}

fn listed(differences: &[Difference]) -> String {
    let lines = differences
        .iter()
        .map(|difference| format!("\n  {difference}"));
    lines.collect()
}

/// The parts of one kind by their names.
fn by_name<T>(
    parts: impl Iterator<Item = T>,
    name: impl Fn(&T) -> &str,
) -> FxHashMap<String, Vec<T>> {
    let mut found: FxHashMap<String, Vec<T>> = FxHashMap::default();
    for part in parts {
        found
            .entry(name_in_model(name(&part)))
            .or_default()
            .push(part);
    }
    found
}

pub(super) fn between(network: &Network, parts: &Composition) -> Vec<Difference> {
    let running = parts.threads.iter().flat_map(|thread| {
        let processes = thread.processes.iter();
        processes.map(move |process| (process, thread))
    });
    let running: Vec<(&ProcessPart, &ThreadPart)> = running.collect();
    let model = by_name(network.processes.iter(), |process| &process.name);
    let system = by_name(running.iter().copied(), |(process, _)| &process.name);
    let mut found = Found {
        all: Vec::new(),
        outside: outside(|name| system.contains_key(name)),
    };
    found.same_names("process", model.values(), |process| &process.name);
    for process in &network.processes {
        match system.get(&name_in_model(&process.name)) {
            Some(parts) => {
                for (part, thread) in parts {
                    found.process(process, part, thread);
                }
            }
            None if process.name == found.outside => {}
            None => found.add("process", &process.name, None, Some("there")),
        }
    }
    for (process, _) in &running {
        if !model.contains_key(&name_in_model(&process.name)) {
            found.add("process", &process.name, Some("there"), None);
        }
    }
    let threads = by_name(parts.threads.iter(), |thread| &thread.name);
    for executor in &network.executors {
        // Processes that are to be there and are not were named before.
        for thread in threads
            .get(&name_in_model(&executor.name))
            .into_iter()
            .flatten()
        {
            found.executor(executor, thread);
        }
    }
    let channels = by_name(network.channels.iter(), |channel| &channel.name);
    found.same_names("channel", channels.values(), |channel| &channel.name);
    for channel in &parts.channels {
        let Some(capacity) = capacity(channel) else {
            continue;
        };
        let name = channel.name.as_ref().unwrap_or(&channel.made_at);
        match channels.get(&name_in_model(name)) {
            Some(known) => found.channel(network, known[0], channel, capacity),
            None => found.add("channel", name, Some("there"), None),
        }
    }
    found.all
}

struct Found {
    all: Vec<Difference>,
    /// A process of this name in a model stands for what is not in the system.
    outside: String,
}

impl Found {
    fn add(&mut self, part: &'static str, name: &str, system: Option<&str>, model: Option<&str>) {
        self.all.push(Difference {
            part,
            name: name.to_owned(),
            system: system.map(str::to_owned),
            model: model.map(str::to_owned),
        });
    }

    /// Parts of the model with names that cannot be distinguished in the system.
    fn same_names<'a, T: 'a>(
        &mut self,
        part: &'static str,
        names: impl Iterator<Item = &'a Vec<T>>,
        name: impl Fn(&T) -> &str,
    ) {
        let mut same: Vec<[&str; 2]> = names
            .flat_map(|same| {
                same.iter()
                    .skip(1)
                    .map(|other| [&same[0], other].map(&name))
            })
            .collect();
        same.sort_unstable();
        for [first, other] in same {
            let here = format!("the same name as `{first}`");
            self.add(part, other, Some(&here), Some("another one"));
        }
    }

    /// `what` may say what the values are.
    fn unless_equal<T: PartialEq>(
        &mut self,
        (part, name): (&'static str, &str),
        what: &str,
        [system, model]: [T; 2],
        text: impl Fn(&T) -> String,
    ) {
        if system != model {
            let here = format!("{what}{}", text(&system));
            self.add(part, name, Some(&here), Some(&text(&model)));
        }
    }

    fn process(&mut self, process: &Process, part: &ProcessPart, thread: &ThreadPart) {
        let this = ("process", part.name.as_str());
        if let (Some(priority), ThreadKind::Executor) = (process.priority, thread.kind) {
            let both = [part.priority, priority];
            self.unless_equal(this, "priority ", both, u8::to_string);
        }
        if let Some(on) = &process.on {
            let both = [&thread.name, on].map(|name| name_in_model(name));
            self.unless_equal(this, "on ", both, String::clone);
        }
    }

    fn executor(&mut self, executor: &Executor, thread: &ThreadPart) {
        let is_thread = thread.kind == ThreadKind::OsThread;
        let kind = |is_thread: &bool| match is_thread {
            true => "a thread",
            false => "an executor",
        };
        let this = ("thread", thread.name.as_str());
        let both = [is_thread, executor.is_thread];
        self.unless_equal(this, "", both, |is_thread| kind(is_thread).to_owned());
        if let Some(core) = executor.core {
            let both = [thread.core, Some(usize::from(core))];
            let text =
                |core: &Option<usize>| core.map_or("any".to_owned(), |core| core.to_string());
            self.unless_equal(this, "core ", both, text);
        }
        let asked = executor.policy.as_ref();
        if let Some(policy) = asked.and_then(|policy| policy.parse::<Policy>().ok()) {
            let both = [thread.policy, policy];
            self.unless_equal(this, "policy ", both, Policy::to_string);
        }
    }

    fn channel(&mut self, network: &Network, known: &Channel, part: &ChannelPart, capacity: usize) {
        let this = ("channel", known.name.as_str());
        // The largest one of a model stands for all that are larger.
        let both = [capacity.min(MAX_BUFFER), known.kind.capacity()];
        self.unless_equal(this, "", both, |capacity| match capacity {
            0 => "a rendezvous".to_owned(),
            values => format!("a buffer of {values}"),
        });
        for (sends, of_model) in [(true, &known.senders), (false, &known.receivers)] {
            let of_model = || {
                of_model
                    .iter()
                    .map(|one| network.processes[*one].name.as_str())
            };
            for user in users(part, sends) {
                let user = match user {
                    EndUser::Process(name) => name.clone(),
                    _ => self.outside.clone(),
                };
                let is_known = of_model().any(|one| name_in_model(one) == name_in_model(&user));
                let what = match sends {
                    true => "sent to by",
                    false => "received from by",
                };
                if !is_known {
                    let there: Vec<&str> = of_model().collect();
                    let here = format!("{what} {user}");
                    self.add(this.0, this.1, Some(&here), Some(&there.join(", ")));
                }
            }
        }
    }
}
