//! The first text of a process' file: its body as in the model, and its actions empty.

use super::body::Body;
use super::kind::{NAME, PERIOD, Periodic, ProcessKind};
use super::names::{Names, snake};
use super::writer::Writer;
use crate::language::body::{Block, Statement, StatementKind};
use crate::model::Model;
use crate::text::Problem;

pub(super) fn skeleton(model: &Model, kind: &ProcessKind<'_>) -> Result<String, Problem> {
    let mut body = Body::new(model, kind);
    let (before, text) = body.write()?;
    let mut out = Writer::default();
    let process = &kind.definition.name.0;
    out.line(format!(
        "//! The process `{process}`. `luna model generate` wrote this once: change it as you like."
    ));
    out.line("");
    out.line(format!("use crate::generated::ports::{};", kind.name));
    let used = &body.uses;
    let mut support = Vec::new();
    support.extend((used.choices > 0).then_some("InTurn"));
    support.extend(used.branch.then_some("branch"));
    support.extend(used.stop.then_some("stop"));
    imports(&mut out, "crate::generated::support", &support);
    let mut macros = Vec::new();
    macros.extend(used.alt.then_some("alt"));
    macros.extend(used.branch.then_some("par"));
    macros.extend(used.pri_alt.then_some("pri_alt"));
    imports(&mut out, "luna", &macros);
    if used.after {
        out.line("use std::time::Duration;");
        out.line("");
        out.line("/// How long an `after` takes: the model does not say.");
        out.line("const AFTER: Duration = Duration::from_millis(100);");
    }
    out.line("");
    if body.sets_in_vain {
        let reason = "the model sets what nothing reads";
        out.line(format!(
            "#[allow(unused_assignments, reason = \"{reason}\")]"
        ));
    }
    let name = &kind.name;
    out.open(format!(
        "pub async fn process(ports: {name}) -> luna::Result<()> {{"
    ));
    ports(&mut out, kind, &body);
    out.append(before);
    out.append(text);
    out.close("}");
    for action in &body.uses.actions {
        out.line("");
        out.block(format!("fn {}() {{", snake(action)), |out| {
            out.line(format!("// What `{action}` does."));
        });
    }
    Ok(out.finish())
}

/// `use from::{what};`
pub(super) fn imports(out: &mut Writer, from: &str, what: &[&str]) {
    match what {
        [] => {}
        [only] => out.line(format!("use {from}::{only};")),
        _ => out.line(format!("use {from}::{{{}}};", what.join(", "))),
    }
}

/// Takes the ports apart: what comes or goes is an error of the compiler here.
fn ports(out: &mut Writer, kind: &ProcessKind<'_>, body: &Body<'_>) {
    let mut fields = Vec::new();
    let names = kind.ports.iter().map(|port| (&port.name, &port.rust));
    let parameters = kind.parameters.iter().map(|(name, rust)| (name, rust));
    for (name, rust) in names.chain(parameters) {
        fields.push(match body.uses.names.contains(name) {
            true => rust.clone(),
            false => format!("{rust}: _{rust}"),
        });
    }
    if kind.periodic != Periodic::None {
        fields.extend([NAME.to_owned(), PERIOD.to_owned()]);
    }
    let name = &kind.name;
    if fields.is_empty() {
        out.line(format!("let {name} {{}} = ports;"));
        return;
    }
    let line = format!("let {name} {{ {} }} = ports;", fields.join(", "));
    if line.len() + 4 <= 100 {
        out.line(line);
        return;
    }
    out.open(format!("let {name} {{"));
    for field in fields {
        out.line(format!("{field},"));
    }
    out.close("} = ports;");
}

/// Takes the names of loops' variables and of actions.
pub(super) fn take_names(block: &Block, names: &mut Names<'_>) -> Result<(), Problem> {
    let mut found: Vec<(String, bool)> = Vec::new();
    let mut outcome = Ok(());
    each(block, &mut |statement| {
        let (named, is_action) = match &statement.kind {
            StatementKind::For(variable, ..) => (variable.clone(), false),
            StatementKind::Action(action) => ((action.clone(), statement.span.clone()), true),
            StatementKind::Offer(_)
            | StatementKind::Skip
            | StatementKind::Stop
            | StatementKind::Assign(..)
            | StatementKind::Assert(_)
            | StatementKind::If(..)
            | StatementKind::While(..)
            | StatementKind::Loop(_)
            | StatementKind::Par(_)
            | StatementKind::Choose(_)
            | StatementKind::Alternative { .. } => return,
        };
        let known = (named.0.clone(), is_action);
        if outcome.is_ok() && !found.contains(&known) {
            let what = if is_action {
                "the action"
            } else {
                "the variable"
            };
            outcome = names.take(snake(&named.0), &named, what);
            found.push(known);
        }
    });
    outcome
}

/// All statements of a block, also those within others.
pub(super) fn each<'b>(block: &'b Block, see: &mut impl FnMut(&'b Statement)) {
    for statement in block {
        see(statement);
        for inner in statement.kind.blocks() {
            each(inner, see);
        }
    }
}
