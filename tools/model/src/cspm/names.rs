//! Names: those of the model, made to names that CSPm has, each for one thing.

use super::alphabets::{Alphabets, Component};
use super::always::{Field, Property, PropertyNames, Seen};
use crate::file::Side;
use crate::network::{Label, Network, Step};
use std::collections::{BTreeMap, BTreeSet};

/// Keywords, what is defined already, and what this translation defines.
const TAKEN: &str = "\
    and or not if then else let within channel assert datatype subtype nametype external \
    transparent include print module instance exports endmodule timed Timed true false True \
    False STOP SKIP CHAOS RUN DIV WAIT TSTOP TSKIP Int Bool Char Proc Events Event Set Seq Map \
    Union Inter union inter diff member empty card seq set concat head tail length elem null \
    show error extensions productions prioritise prioritisepo chase chase_nocache normal \
    sbisim wbisim dbisim drbisim sbdia lazyenumerate diamond tau_loop_factor model_compress \
    explicate mapFromList mapLookup mapMember mapToList mapUpdate mapUpdateMultiple mapDelete \
    emptyMap mtransclose relational_image relational_inverse_image transpose loop attribute \
    embed deadlock free deterministic divergence livelock tau tock trace has refines Agent A P \
    System Observed Observations Silent BROKEN quotient remainder without_newest after ends start done failed step \
    called_off choose broken over a b i q live line value sender receiver other process who n \
    has_failed";

#[derive(Debug)]
pub(super) struct ChannelNames {
    pub(super) plain: String,
    pub(super) put: String,
    pub(super) get: String,
    pub(super) no_receiver: String,
    pub(super) no_sender: String,
    /// Of its buffer: as an agent, and as a definition.
    buffer: String,
    pub(super) process: String,
}

impl ChannelNames {
    /// The event by which this side learns that the other has ended.
    pub(super) fn closed(&self, side: Side) -> &String {
        match side {
            Side::Send => &self.no_receiver,
            Side::Receive => &self.no_sender,
        }
    }
}

#[derive(Debug)]
pub(super) struct Names {
    pub(super) agents: Vec<String>,
    pub(super) channels: Vec<ChannelNames>,
    /// Unique within a process.
    pub(super) variables: Vec<String>,
    pub(super) actions: BTreeMap<String, String>,
    /// For each agent a definition for each place.
    pub(super) places: Vec<Vec<String>>,
    /// For each agent two more: of a branch that does not run, and of one that has failed; or of a
    /// process that has ended.
    pub(super) idle: Vec<String>,
    pub(super) over: Vec<String>,
    /// For each agent, place and branch that may fail, where the agent waits for the branch's end.
    pub(super) joins: BTreeMap<(usize, usize, usize), String>,
    /// The channels by which a branch gets a variable (true), or gives it back.
    pub(super) hands: BTreeMap<(bool, usize, usize), String>,
    /// Of the properties of `check.always`; those of one that is not exported are unused.
    pub(super) properties: Vec<PropertyNames>,
}

impl Names {
    pub(super) fn of(
        network: &Network,
        alphabets: &Alphabets,
        properties: &[Result<Property, &str>],
    ) -> Self {
        let mut taken: BTreeSet<String> = TAKEN.split_whitespace().map(str::to_owned).collect();
        let mut new = |name: &str| unique(&mut taken, &plain(name));
        let agents: Vec<String> = network
            .agents
            .iter()
            .map(|agent| new(&agent.name))
            .collect();
        let channels = network
            .channels
            .iter()
            .map(|channel| {
                let name = new(&channel.name);
                ChannelNames {
                    put: new(&format!("{name}_put")),
                    get: new(&format!("{name}_get")),
                    no_receiver: new(&format!("{name}_no_receiver")),
                    no_sender: new(&format!("{name}_no_sender")),
                    buffer: new(&format!("{name}_buffer")),
                    process: new(&format!("Buffer_{name}")),
                    plain: name,
                }
            })
            .collect();
        let actions: BTreeSet<&String> = alphabets.actions.iter().map(|(name, _)| name).collect();
        let actions = actions
            .into_iter()
            .map(|name| (name.clone(), new(name)))
            .collect();
        let mut places = Vec::new();
        let (mut idle, mut over) = (Vec::new(), Vec::new());
        let (mut joins, mut hands) = (BTreeMap::new(), BTreeMap::new());
        for (number, agent) in network.agents.iter().enumerate() {
            let name = &agents[number];
            places.push(
                (0..agent.code.len())
                    .map(|at| new(&format!("At_{name}_{at}")))
                    .collect(),
            );
            idle.push(new(&format!("Idle_{name}")));
            over.push(new(&format!("Over_{name}")));
            for (at, place) in agent.code.iter().enumerate() {
                let Step::Join(branches, _) = &place.step else {
                    continue;
                };
                for branch in 0..branches.len() {
                    let join = new(&format!("At_{name}_{at}_branch_{branch}"));
                    joins.insert((number, at, branch), join);
                }
            }
            if agent.parent.is_some() {
                let (used, set) = network.uses(number);
                for (is_given, slots) in [(true, used), (false, set)] {
                    let word = if is_given { "give" } else { "take" };
                    for slot in slots {
                        let variable = &network.variables[slot].name;
                        let hand = new(&format!("{word}_{name}_{variable}"));
                        hands.insert((is_given, number, slot), hand);
                    }
                }
            }
        }
        let titles = network.always.iter().map(|(title, _)| title);
        let channels_of_properties: Vec<(String, String)> = titles
            .map(|title| {
                let channel = new(&format!("always_{title}"));
                let wrong = new(&format!("Wrong_{channel}"));
                (channel, wrong)
            })
            .collect();
        let properties = channels_of_properties.into_iter().zip(properties);
        let properties = properties
            .map(|((channel, wrong), property)| {
                let fields = property.as_ref().map_or(&[][..], |found| &found.fields);
                let mut own = taken.clone();
                let name = |field: &Field| unique(&mut own, &plain(&field_name(network, field)));
                PropertyNames {
                    channel,
                    wrong,
                    fields: fields.iter().map(name).collect(),
                }
            })
            .collect();
        let mut own: BTreeMap<usize, BTreeSet<String>> = BTreeMap::new();
        let variables = network.variables.iter().map(|variable| {
            let own = own.entry(variable.process).or_insert_with(|| taken.clone());
            unique(own, &plain(&variable.name))
        });
        let variables = variables.collect();
        Self {
            agents,
            channels,
            variables,
            actions,
            places,
            idle,
            over,
            joins,
            hands,
            properties,
        }
    }

    pub(super) fn component(&self, component: Component) -> &str {
        match component {
            Component::Agent(agent) => &self.agents[agent],
            Component::Buffer(channel) => &self.channels[channel].buffer,
        }
    }
}

/// What a property names, in its own words.
fn field_name(network: &Network, field: &Field) -> String {
    let process = &network.agents[field.agent].name;
    let what = match &field.of {
        Seen::Variable(slot) => network.variables[*slot].name.as_str(),
        Seen::At(places) => {
            let places = places
                .iter()
                .map(|&at| &network.agents[field.agent].code[at]);
            let mut edges = places.filter_map(|place| place.step.edges().first());
            match edges.next().map(|edge| &edge.label) {
                Some(Label::Own(name)) => name,
                _ => "place",
            }
        }
    };
    format!("{process}_{what}")
}

/// Letters, digits and underlines, a letter first.
fn plain(name: &str) -> String {
    let mut plain = String::new();
    for c in name.chars() {
        if c.is_ascii_alphanumeric() {
            plain.push(c);
        } else if !plain.ends_with('_') {
            plain.push('_');
        }
    }
    let plain = plain.trim_matches('_');
    match plain.chars().next() {
        Some(first) if first.is_ascii_alphabetic() => plain.to_owned(),
        Some(_) => format!("n_{plain}"),
        None => "n".to_owned(),
    }
}

fn unique(taken: &mut BTreeSet<String>, name: &str) -> String {
    let mut found = name.to_owned();
    let mut number = 2;
    while !taken.insert(found.clone()) {
        found = format!("{name}_{number}");
        number += 1;
    }
    found
}
