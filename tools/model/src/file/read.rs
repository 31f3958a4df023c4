//! Reads a model file.

use super::values::{self, expr, piece};
use super::{Channel, Composition, Content, Definition, Document, Executor, Part, Run, Side};
use crate::language::body::{self, Named, RESERVED};
use crate::language::parser::Parser;
use crate::language::temporal;
use crate::network::Buffering;
use crate::text::{Problem, Source};
use luna::file::{self, Entry, MAX_PRIORITY, entries, parse};

const MAX_STATES: i64 = 1_000_000_000;

pub(crate) fn read(name: &str, text: &str) -> Result<Document, Problem> {
    let source = Source { name, text };
    let table = parse(source)?;
    let mut document = Document::default();
    for entry in entries(source, table.get_ref()) {
        match entry.key {
            "name" => document.name = Some(entry.text()?.to_owned()),
            "process" => {
                for process in entry.table()? {
                    document.definitions.push(definition(&process)?);
                }
            }
            "system" => {
                document.system = Some((entry.key_span(), composition(&entry)?));
            }
            "host" => {
                for host in entry.table()? {
                    document.deployment.hosts.push(host.name(&[])?);
                    if let Some(more) = host.table()?.first() {
                        return Err(more.unknown(&[]));
                    }
                }
            }
            "program" => {
                for program in entry.table()? {
                    let mut host = None;
                    for entry in program.table()? {
                        match entry.key {
                            "host" => host = Some(reference(&entry)?),
                            _ => return Err(entry.unknown(&["host"])),
                        }
                    }
                    document
                        .deployment
                        .programs
                        .push((program.name(&[])?, host));
                }
            }
            "executor" => {
                for entry in entry.table()? {
                    document.deployment.executors.push(executor(&entry)?);
                }
            }
            "check" => check(&entry, &mut document)?,
            "schedule" => {
                for entry in entry.table()? {
                    match entry.key {
                        "latency" => document.latency = Some(file::time(&entry)?),
                        _ => return Err(entry.unknown(&["latency"])),
                    }
                }
            }
            _ => {
                let known = [
                    "name", "process", "system", "host", "program", "executor", "check", "schedule",
                ];
                return Err(entry.unknown(&known));
            }
        }
    }
    Ok(document)
}

/// A text that names something, with its place.
fn reference(entry: &Entry<'_>) -> Result<Named, Problem> {
    Ok((entry.text()?.to_owned(), entry.span()))
}

fn definition(entry: &Entry<'_>) -> Result<Definition, Problem> {
    let name = entry.name(&RESERVED)?;
    let (mut parameters, mut ports, mut variables) = (Vec::new(), Vec::new(), Vec::new());
    let (mut body, mut composed) = (None, Composition::default());
    let mut is_composed = None;
    for entry in entry.table()? {
        match entry.key {
            "parameters" => {
                for entry in entry.table()? {
                    let number = entry.number(i32::MIN.into()..=i32::MAX.into())?;
                    parameters.push((entry.name(&RESERVED)?, number as i32));
                }
            }
            "ports" => {
                for entry in entry.table()? {
                    let side = [("send", Side::Send), ("receive", Side::Receive)];
                    ports.push((entry.name(&RESERVED)?, entry.one_of(&side)?));
                }
            }
            "variables" => {
                for entry in entry.table()? {
                    variables.push((entry.name(&RESERVED)?, values::variable(&entry)?));
                }
            }
            "body" => body = Some(body::parse(piece(&entry)?)?),
            "channel" | "part" => {
                is_composed = Some(entry.key_span());
                composed_of(&entry, &mut composed)?;
            }
            _ => {
                let known = [
                    "parameters",
                    "ports",
                    "variables",
                    "body",
                    "channel",
                    "part",
                ];
                return Err(entry.unknown(&known));
            }
        }
    }
    let content = match (body, is_composed) {
        (Some(body), None) => Content::Body(body),
        (None, Some(_)) => Content::Composition(composed),
        (Some(_), Some(span)) => {
            let message = "a process has a body or parts, not both";
            let advice = "make a process of the body, and a part of that process";
            return Err(entry.source.problem(span, message, advice));
        }
        (None, None) => {
            let advice = "write `body = \"…\"`, or parts";
            let message = "this process does nothing";
            return Err(entry.source.problem(entry.key_span(), message, advice));
        }
    };
    if let (Content::Composition(_), Some(((_, span), _))) = (&content, variables.first()) {
        let message = "a process that is made of parts has no variables";
        let advice = "move them to the part that uses them";
        return Err(entry.source.problem(span.clone(), message, advice));
    }
    let names = parameters.iter().map(|(name, _)| name);
    let names = names.chain(ports.iter().map(|(name, _)| name));
    let names: Vec<&Named> = names
        .chain(variables.iter().map(|(name, _)| name))
        .collect();
    for (at, (name, span)) in names.iter().enumerate() {
        if names[..at].iter().any(|(other, _)| other == name) {
            let message = "this name is used twice in the process";
            return Err(entry
                .source
                .problem(span.clone(), message, "rename one of the two"));
        }
    }
    Ok(Definition {
        name,
        parameters,
        ports,
        variables,
        content,
    })
}

fn composition(entry: &Entry<'_>) -> Result<Composition, Problem> {
    let mut found = Composition::default();
    for entry in entry.table()? {
        match entry.key {
            "channel" | "part" => composed_of(&entry, &mut found)?,
            _ => return Err(entry.unknown(&["channel", "part"])),
        }
    }
    Ok(found)
}

fn composed_of(entry: &Entry<'_>, found: &mut Composition) -> Result<(), Problem> {
    for inner in entry.table()? {
        match entry.key {
            "channel" => found.channels.push(channel(&inner)?),
            _ => found.parts.push(part(&inner)?),
        }
    }
    Ok(())
}

fn channel(entry: &Entry<'_>) -> Result<Channel, Problem> {
    let mut found = Channel {
        name: entry.name(&RESERVED)?,
        array: None,
        kind: Buffering::Rendezvous,
        type_name: "()".to_owned(),
        values: None,
    };
    for entry in entry.table()? {
        match entry.key {
            "array" => found.array = Some(expr(&entry)?),
            "buffer" => found.kind = values::buffer(&entry)?,
            "type" => {
                found.type_name = entry.text()?.to_owned();
                found.values = values::channel_values(&entry)?;
                let first = found.values.as_ref().and_then(|range| range.first.as_ref());
                if first.is_some() {
                    let advice = "write `0..9`";
                    return Err(entry.problem("a channel has no first value", advice));
                }
            }
            _ => return Err(entry.unknown(&["array", "buffer", "type"])),
        }
    }
    Ok(found)
}

fn part(entry: &Entry<'_>) -> Result<Part, Problem> {
    let name = entry.name(&RESERVED)?;
    let (mut process, mut array, mut run) = (None, None, Run::default());
    let (mut bind, mut set, mut at) = (Vec::new(), Vec::new(), None);
    for entry in entry.table()? {
        match entry.key {
            "process" => process = Some(reference(&entry)?),
            "array" => array = Some(expr(&entry)?),
            "bind" => {
                for entry in entry.table()? {
                    bind.push((entry.named(), Parser::whole(piece(&entry)?, Parser::path)?));
                }
            }
            "set" => {
                for entry in entry.table()? {
                    set.push((entry.named(), expr(&entry)?));
                }
            }
            "priority" => run.priority = Some(entry.number(0..=MAX_PRIORITY)? as u8),
            "period" => run.period = Some(file::time(&entry)?),
            "on" => run.on = Some(reference(&entry)?),
            "cost" => run.cost = Some(file::time(&entry)?),
            "longest_poll" => run.longest_poll = Some(file::time(&entry)?),
            "deadline" => run.deadline = Some(file::time(&entry)?),
            "at" => at = Some(values::at(&entry)?),
            _ => {
                let known = [
                    "process",
                    "array",
                    "bind",
                    "set",
                    "priority",
                    "period",
                    "on",
                    "cost",
                    "longest_poll",
                    "deadline",
                    "at",
                ];
                return Err(entry.unknown(&known));
            }
        }
    }
    let process = process.ok_or_else(|| {
        let advice = "write `process = \"…\"`";
        let message = "this part names no process";
        entry.source.problem(entry.key_span(), message, advice)
    })?;
    Ok(Part {
        name,
        process,
        array,
        bind,
        set,
        run,
        at,
    })
}

fn executor(entry: &Entry<'_>) -> Result<Executor, Problem> {
    let mut found = Executor {
        name: entry.name(&[])?,
        is_thread: false,
        program: None,
        core: None,
        policy: None,
    };
    for entry in entry.table()? {
        match entry.key {
            "kind" => {
                found.is_thread = entry.one_of(&[("executor", false), ("thread", true)])?;
            }
            "program" => found.program = Some(reference(&entry)?),
            "core" => found.core = file::core(&entry)?,
            "policy" => found.policy = Some(file::policy_of_any(&entry)?.to_string()),
            _ => return Err(entry.unknown(&["kind", "program", "core", "policy"])),
        }
    }
    Ok(found)
}

fn check(entry: &Entry<'_>, document: &mut Document) -> Result<(), Problem> {
    for entry in entry.table()? {
        match entry.key {
            "max_states" => {
                document.max_states = Some(entry.number(1..=MAX_STATES)? as usize);
            }
            "always" => {
                for entry in entry.table()? {
                    let expr = Parser::whole(piece(&entry)?, Parser::expr)?;
                    document.always.push((entry.named(), expr));
                }
            }
            "ltl" => {
                for entry in entry.table()? {
                    let formula = temporal::parse(piece(&entry)?)?;
                    document.ltl.push((entry.name(&[])?, formula));
                }
            }
            _ => return Err(entry.unknown(&["max_states", "always", "ltl"])),
        }
    }
    Ok(())
}
