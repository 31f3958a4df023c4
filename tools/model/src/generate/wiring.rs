//! What is written anew each time: modules, ports, the system.

use super::kind::{Kinds, NAME, PERIOD, Periodic, ProcessKind};
use super::names::unlike;
use super::skeleton::imports;
use super::types::{Type, type_of};
use super::writer::Writer;
use crate::file::{Executor, Side};
use crate::model::Model;
use crate::network::{Buffering, Process};
use crate::text::Problem;
use luna::Policy;
use std::time::Duration;

/// Loops that a system has room for, if it asks for no more.
const LOOPS: usize = 16;
/// Higher priorities are those of the timer manager and the emergency manager.
const HIGHEST: u8 = 97;

/// `src/generated/mod.rs`
pub(super) fn root(kinds: &Kinds<'_>) -> String {
    let mut out = Writer::default();
    out.line("");
    let allowed = "#[allow(dead_code, reason = \"not each model needs all of it\")]";
    out.line(allowed);
    out.line("pub mod pipes;");
    out.line("pub mod ports;");
    out.line("pub mod replay;");
    out.line("pub mod rest;");
    out.line("pub mod script;");
    out.line(allowed);
    out.line("pub mod support;");
    out.line("pub mod system;");
    if !kinds.types.is_empty() {
        out.line("#[path = \"../types.rs\"]");
        out.line("pub mod types;");
    }
    out.line("");
    out.line("#[path = \"../processes\"]");
    out.block("pub mod processes {", |out| {
        let mut modules: Vec<&str> = kinds.all.iter().map(|kind| kind.module.as_str()).collect();
        modules.sort_unstable();
        for module in modules {
            out.line(format!("pub mod {module};"));
        }
    });
    out.line("");
    out.line("/// Describes the system, prepares it, and runs it as the command line says.");
    out.open("pub fn run(");
    out.line("prepare: impl FnOnce(&mut luna::System) -> luna::Result<()>,");
    out.close(") -> std::process::ExitCode {");
    out.line("    support::run(system::build, prepare)");
    out.line("}");
    out.finish()
}

/// `src/generated/ports.rs`
pub(super) fn ports(kinds: &Kinds<'_>) -> String {
    let mut out = Writer::default();
    out.line("");
    if !kinds.types.is_empty() {
        out.line("use super::types;");
    }
    for kind in &kinds.all {
        out.line("");
        let process = &kind.definition.name.0;
        out.line(format!(
            "/// What a `{process}` has: its ends of channels, its parameters."
        ));
        let fields = fields(kind);
        if fields.is_empty() {
            out.line(format!("pub struct {} {{}}", kind.name));
            continue;
        }
        out.block(format!("pub struct {} {{", kind.name), |out| {
            for (name, holds) in fields {
                out.line(format!("pub {name}: {holds},"));
            }
        });
    }
    out.finish()
}

fn fields(kind: &ProcessKind<'_>) -> Vec<(String, String)> {
    let mut fields = Vec::new();
    for port in &kind.ports {
        let end = match port.side {
            Side::Send => "Sender",
            Side::Receive => "Receiver",
        };
        let holds = port.holds.path();
        fields.push((port.rust.clone(), format!("luna::{end}<{holds}>")));
    }
    for (_, rust) in &kind.parameters {
        fields.push((rust.clone(), "i32".to_owned()));
    }
    let period = match kind.periodic {
        Periodic::None => return fields,
        Periodic::Some => "Option<std::time::Duration>",
        Periodic::All => "std::time::Duration",
    };
    fields.push((NAME.to_owned(), "&'static str".to_owned()));
    fields.push((PERIOD.to_owned(), period.to_owned()));
    fields
}

/// `src/generated/system.rs`
pub(super) fn system(model: &Model, kinds: &Kinds<'_>) -> Result<String, Problem> {
    let network = &model.network;
    let mut text = Writer::at(1);
    let own = ["network", "ports", "process", "script"];
    let mut taken: Vec<String> = own.map(str::to_owned).into();
    let name = literal(&network.name);
    text.line(format!("let mut network = Network::new({name}, script);"));
    let loops = network.processes.iter();
    let loops = loops.filter(|process| process.period.is_some()).count();
    if loops > LOOPS {
        text.line(format!("network.system.max_loops({loops});"));
    }
    let places = places(model, &mut taken, &mut text)?;
    text.line("");
    let mut uses_types = false;
    let mut channels = Vec::new();
    for channel in &network.channels {
        let variable = unlike(&channel.name, &mut taken);
        let holds = type_of(model, channel)?;
        uses_types |= matches!(holds, Type::Defined(_));
        let buffer = match channel.kind {
            Buffering::Rendezvous => "None".to_owned(),
            Buffering::Fifo(n) => format!("Some(Buffer::fifo({n}))"),
            Buffering::OverwriteOldest(n) => format!("Some(Buffer::overwrite_oldest({n}))"),
            Buffering::OverwriteNewest(n) => format!("Some(Buffer::overwrite_newest({n}))"),
        };
        let (holds, path) = (holds.path(), literal(&channel.name));
        text.line(format!(
            "let {variable} = network.channel::<{holds}>({path}, {buffer});"
        ));
        channels.push(variable);
    }
    for process in &network.processes {
        if let Some(kind) = kinds.of(process) {
            text.line("");
            add(&mut text, process, kind, &channels, places.of(process));
        }
    }
    text.line("Ok(network)");

    let mut out = Writer::default();
    out.line("");
    let mut modules: Vec<&str> = kinds.all.iter().map(|kind| kind.module.as_str()).collect();
    modules.sort_unstable();
    imports(&mut out, "super::processes", &modules);
    out.line("use super::script::Script;");
    out.line("use super::support::Network;");
    imports(
        &mut out,
        "super",
        if uses_types {
            &["ports", "types"]
        } else {
            &["ports"]
        },
    );
    let has_buffer = network
        .channels
        .iter()
        .any(|channel| channel.kind.capacity() > 0);
    if has_buffer {
        out.line("use luna::Buffer;");
    }
    out.line("use luna::Policy;");
    if loops > 0 {
        out.line("use std::time::Duration;");
    }
    out.line("");
    out.line("/// The system, with all its channels and processes.");
    out.open("pub fn build(script: Option<Script>) -> luna::Result<Network> {");
    out.append(text);
    out.close("}");
    Ok(out.finish())
}

fn add(
    out: &mut Writer,
    process: &Process,
    kind: &ProcessKind<'_>,
    channels: &[String],
    place: Place<'_>,
) {
    let name = literal(&process.name);
    let mut values = Vec::new();
    for port in &kind.ports {
        if let Some((channel, side)) = process.scope.port(&port.name) {
            let end = match side {
                Side::Send => "sender",
                Side::Receive => "receiver",
            };
            let channel = &channels[channel];
            values.push(format!("{}: {channel}.{end}({name})", port.rust));
        }
    }
    for (name, rust) in &kind.parameters {
        let value = process.scope.parameter(name).unwrap_or_default();
        values.push(format!("{rust}: {value}"));
    }
    if kind.periodic != Periodic::None {
        let period = process.period.map(duration);
        let period = match kind.periodic {
            Periodic::All => period.unwrap_or_default(),
            _ => period.map_or("None".to_owned(), |period| format!("Some({period})")),
        };
        values.push(format!("{NAME}: {name}"));
        values.push(format!("{PERIOD}: {period}"));
    }
    out.open(format!("let ports = ports::{} {{", kind.name));
    for value in values {
        out.line(format!("{value},"));
    }
    out.close("};");
    let builder = match place {
        Place::Executor(variable) => format!("{variable}.process({name})"),
        Place::Thread(found) => {
            let (core, policy) = attributes(found);
            let thread = literal(&found.name.0);
            format!("network.thread({thread}, {core}, {policy}, {name})")
        }
    };
    let level = process.priority;
    let level = level.map_or(String::new(), |level| format!(".priority({level})"));
    let module = &kind.module;
    out.line(format!("let process = {builder}{level};"));
    out.line(format!(
        "network.spawn({name}, process, move || {module}::process(ports))?;"
    ));
}

#[derive(Debug, Clone, Copy)]
enum Place<'a> {
    /// The variable that holds it.
    Executor(&'a str),
    Thread(&'a Executor),
}

/// Where processes run.
#[derive(Debug)]
struct Places<'m> {
    /// With the variable of each executor.
    all: Vec<(&'m Executor, String)>,
    /// The variable of the executor of those that state none.
    other: String,
}

impl Places<'_> {
    fn of(&self, process: &Process) -> Place<'_> {
        let stated = process.on.as_ref();
        let found = stated.and_then(|on| self.all.iter().find(|(one, _)| one.name.0 == *on));
        match found {
            Some((thread, _)) if thread.is_thread => Place::Thread(thread),
            Some((_, variable)) => Place::Executor(variable),
            None => Place::Executor(&self.other),
        }
    }
}

/// Makes the executors that have processes.
fn places<'m>(
    model: &'m Model,
    taken: &mut Vec<String>,
    out: &mut Writer,
) -> Result<Places<'m>, Problem> {
    let processes = &model.network.processes;
    let executors = &model.document.deployment.executors;
    let mut all = Vec::new();
    for executor in executors {
        let name = &executor.name.0;
        let on_it = processes.iter().filter(|one| one.on.as_ref() == Some(name));
        let number = on_it.count();
        if executor.is_thread && number > 1 {
            let message = format!("{number} processes are to run on this thread");
            let advice = "make it an executor, or give each of them a thread of its own";
            let span = executor.name.1.clone();
            return Err(model.source().problem(span, message, advice));
        }
        if number == 0 {
            continue;
        }
        let policy = executor.policy.as_deref().unwrap_or("other");
        let level = policy
            .split_once(':')
            .and_then(|(_, level)| level.parse().ok());
        if level.is_some_and(|level: u8| level > HIGHEST) {
            let message = format!("the policy `{policy}` is LUNA's own");
            let advice = format!("use a priority of 1 to {HIGHEST}");
            let span = executor.name.1.clone();
            return Err(model.source().problem(span, message, advice));
        }
        let mut variable = String::new();
        if !executor.is_thread {
            variable = unlike(name, taken);
            make(out, &variable, name, &attributes(executor));
        }
        all.push((executor, variable));
    }
    let mut other = String::new();
    if processes.iter().any(|one| one.on.is_none()) {
        // Executors have their names once.
        let names: Vec<&str> = executors.iter().map(|one| one.name.0.as_str()).collect();
        let mut name = "main".to_owned();
        while names.contains(&name.as_str()) {
            name.push_str(" (other)");
        }
        other = unlike(&name, taken);
        let plain = ("None".to_owned(), "Policy::Other".to_owned());
        make(out, &other, &name, &plain);
    }
    Ok(Places { all, other })
}

fn make(out: &mut Writer, variable: &str, name: &str, (core, policy): &(String, String)) {
    let name = literal(name);
    out.line(format!(
        "let {variable} = network.executor({name}, {core}, {policy})?;"
    ));
}

/// Core and policy.
fn attributes(executor: &Executor) -> (String, String) {
    let core = executor.core;
    let core = core.map_or("None".to_owned(), |core| format!("Some({core})"));
    let policy = executor.policy.as_deref().unwrap_or("other");
    // What was read from a file is one.
    let policy = match policy.parse().unwrap_or_default() {
        Policy::Fifo(level) => format!("Policy::fifo({level})"),
        Policy::RoundRobin(level) => format!("Policy::round_robin({level})"),
        other => format!("Policy::{other:?}"),
    };
    (core, policy)
}

fn duration(period: Duration) -> String {
    let nanos = period.as_nanos();
    let (number, unit) = match nanos {
        _ if nanos.is_multiple_of(1_000_000_000) => (nanos / 1_000_000_000, "secs"),
        _ if nanos.is_multiple_of(1_000_000) => (nanos / 1_000_000, "millis"),
        _ if nanos.is_multiple_of(1_000) => (nanos / 1_000, "micros"),
        _ => (nanos, "nanos"),
    };
    format!("Duration::from_{unit}({number})")
}

/// A text in Rust.
fn literal(text: &str) -> String {
    format!("{text:?}")
}
