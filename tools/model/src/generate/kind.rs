//! The kinds of processes that a system has: what their parts have in common.

use super::names::{Names, Taken, camel, snake};
use super::types::{Type, type_of};
use super::waiting::reachable;
use crate::file::{Content, Definition, Side};
use crate::language::body::Block;
use crate::model::Model;
use crate::network::Process;
use crate::text::Problem;

/// What `ports` has beside the ports and parameters of the model.
pub(super) const NAME: &str = "process_name";
pub(super) const PERIOD: &str = "process_period";

/// Names of a skeleton that are its own.
const OWN: [Taken; 13] = [
    ("the body of the process", &["process"]),
    ("the ports of the process", &["ports"]),
    ("the name of the process", &[NAME]),
    ("the period of the process", &[PERIOD]),
    ("the slots of its period", &["slots"]),
    ("the outcome of a guard", &["outcome"]),
    ("the turn of a `choose`", &["choice"]),
    ("the branch that is chosen", &["chosen"]),
    ("the library", &["luna"]),
    ("the standard library", &["std"]),
    ("the generated support", &["support"]),
    ("a branch of `par!`", &["branch"]),
    ("a macro", &["alt", "par"]),
];

/// Modules that generated code names beside those of processes.
const MODULES: [Taken; 3] = [
    (
        "a module of its own",
        &["ports", "support", "system", "types"],
    ),
    ("the library", &["luna"]),
    ("the standard library", &["std"]),
];

/// Names that generated code uses in the sense of Rust or of its own.
const TYPES: [Taken; 2] = [
    (
        "a type of Rust",
        &[
            "Ok", "Err", "Some", "None", "Option", "Result", "Default", "String", "Duration",
            "Self",
        ],
    ),
    ("a type of its own", &["InTurn"]),
];

/// A process of the model with a body, of which the system has parts.
#[derive(Debug)]
pub(super) struct ProcessKind<'m> {
    pub(super) definition: &'m Definition,
    /// Without what is never reached or does nothing.
    pub(super) body: Block,
    /// Of its file.
    pub(super) module: String,
    /// Of the struct of its ports.
    pub(super) name: String,
    pub(super) ports: Vec<Port>,
    /// In the model and in Rust.
    pub(super) parameters: Vec<(String, String)>,
    pub(super) periodic: Periodic,
}

/// Which parts of a kind have a period.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Periodic {
    None,
    Some,
    All,
}

#[derive(Debug)]
pub(super) struct Port {
    /// In the model.
    pub(super) name: String,
    pub(super) rust: String,
    pub(super) side: Side,
    pub(super) holds: Type,
    /// Whether an operation may wait for the other side.
    pub(super) waits: bool,
}

/// All kinds, and the types that a person is to define.
#[derive(Debug)]
pub(super) struct Kinds<'m> {
    pub(super) all: Vec<ProcessKind<'m>>,
    pub(super) types: Vec<String>,
}

impl<'m> Kinds<'m> {
    pub(super) fn new(model: &'m Model) -> Result<Self, Problem> {
        let (mut all, mut types) = (Vec::new(), Vec::new());
        let mut modules = Names::new(model.source(), &MODULES);
        let mut names = Names::new(model.source(), &TYPES);
        for definition in &model.document.definitions {
            let Content::Body(body) = &definition.content else {
                continue;
            };
            let parts = model.network.processes.iter();
            let parts: Vec<&Process> = parts
                .filter(|process| process.definition == definition.name.0)
                .collect();
            if parts.is_empty() {
                continue;
            }
            let kind = kind(model, definition, body, &parts)?;
            modules.take(kind.module.clone(), &definition.name, "the process")?;
            names.take(kind.name.clone(), &definition.name, "the process")?;
            for port in &kind.ports {
                if let Type::Defined(name) = &port.holds
                    && !types.contains(name)
                {
                    types.push(name.clone());
                }
            }
            all.push(kind);
        }
        Ok(Self { all, types })
    }

    /// The kind of a process.
    pub(super) fn of(&self, process: &Process) -> Option<&ProcessKind<'m>> {
        let mut all = self.all.iter();
        all.find(|kind| kind.definition.name.0 == process.definition)
    }
}

fn kind<'m>(
    model: &'m Model,
    definition: &'m Definition,
    body: &Block,
    parts: &[&Process],
) -> Result<ProcessKind<'m>, Problem> {
    let mut names = Names::new(model.source(), &OWN);
    let mut ports = Vec::new();
    for (named, side) in &definition.ports {
        let rust = snake(&named.0);
        names.take(rust.clone(), named, "the port")?;
        let channels = parts.iter().filter_map(|part| part.scope.port(&named.0));
        let channels: Vec<_> = channels
            .map(|(channel, _)| &model.network.channels[channel])
            .collect();
        let mut holds = None;
        for channel in &channels {
            let found = type_of(model, channel)?;
            let before = holds.get_or_insert_with(|| found.clone());
            if *before != found {
                let message = format!(
                    "channels of two types are bound to this port: `{}` and `{}`",
                    before.rust(),
                    found.rust()
                );
                let advice = "make two processes of it, one for each type";
                return Err(model.source().problem(named.1.clone(), message, advice));
            }
        }
        let mut channels = channels.iter();
        let sends_at_once =
            *side == Side::Send && channels.any(|channel| channel.kind.overwrites());
        ports.push(Port {
            name: named.0.clone(),
            rust,
            side: *side,
            holds: holds.unwrap_or(Type::Unit),
            waits: !sends_at_once,
        });
    }
    let mut parameters = Vec::new();
    for (named, _) in &definition.parameters {
        let rust = snake(&named.0);
        names.take(rust.clone(), named, "the parameter")?;
        parameters.push((named.0.clone(), rust));
    }
    for (named, _) in &definition.variables {
        names.take(snake(&named.0), named, "the variable")?;
    }
    super::skeleton::take_names(body, &mut names)?;
    let periods = parts.iter().filter(|part| part.period.is_some()).count();
    Ok(ProcessKind {
        definition,
        body: reachable(body),
        module: snake(&definition.name.0),
        name: camel(&definition.name.0),
        ports,
        parameters,
        periodic: match periods {
            0 => Periodic::None,
            all if all == parts.len() => Periodic::All,
            _ => Periodic::Some,
        },
    })
}
