//! The body of a process in Rust.

use super::branches::choice;
use super::expression::{Lookup, compound, condition, int};
use super::kind::{NAME, PERIOD, Periodic, Port, ProcessKind};
use super::lets::{self, Declares, Site, site};
use super::liveness::live_at_start;
use super::names::snake;
use super::types::Type;
use super::waiting::{diverges, surely_waits};
use super::writer::Writer;
use crate::language::body::{Block, Named, Offer, StatementKind};
use crate::language::expr::Expr;
use crate::language::parser::Path;
use crate::model::Model;
use crate::text::Problem;
use std::collections::{BTreeSet, HashMap};

/// What a body needs beside itself.
#[derive(Debug, Default)]
pub(super) struct Uses {
    pub(super) alt: bool,
    pub(super) pri_alt: bool,
    /// And `par`.
    pub(super) branch: bool,
    pub(super) stop: bool,
    pub(super) after: bool,
    pub(super) choices: usize,
    pub(super) actions: Vec<String>,
    /// Of ports, parameters and variables.
    pub(super) names: BTreeSet<String>,
}

#[derive(Debug)]
struct Variable {
    name: String,
    rust: String,
    is_bool: bool,
}

#[derive(Debug)]
pub(super) struct Body<'m> {
    pub(super) kind: &'m ProcessKind<'m>,
    pub(super) model: &'m Model,
    pub(super) uses: Uses,
    /// `rustc` would warn of a value that is never read.
    pub(super) sets_in_vain: bool,
    variables: Vec<Variable>,
    declares: HashMap<Site, Declares>,
    /// The loop that a period drives, if one is there.
    ticking: Option<Site>,
}

impl Lookup for Body<'_> {
    fn rust(&self, name: &str) -> String {
        let found = self.variables.iter().rfind(|one| one.name == name);
        found.map_or_else(|| snake(name), |one| one.rust.clone())
    }

    fn is_bool(&self, name: &str) -> bool {
        let found = self.variables.iter().rfind(|one| one.name == name);
        found.is_some_and(|one| one.is_bool)
    }
}

impl<'m> Body<'m> {
    pub(super) fn new(model: &'m Model, kind: &'m ProcessKind<'m>) -> Self {
        Self {
            kind,
            model,
            uses: Uses::default(),
            sets_in_vain: false,
            variables: Vec::new(),
            declares: HashMap::new(),
            ticking: None,
        }
    }

    /// What comes before the body, and the body.
    pub(super) fn write(&mut self) -> Result<(Writer, Writer), Problem> {
        let kind = self.kind;
        let block = &kind.body;
        let mut before = Writer::at(1);
        let is_periodic = self.kind.periodic != Periodic::None;
        let first_loop = super::waiting::first_loop(block);
        self.ticking = first_loop.filter(|_| is_periodic);
        let (live, in_vain) = live_at_start(block);
        // What is never read at all has a name that `rustc` expects no use of.
        let mut in_vain = in_vain.iter();
        self.sets_in_vain = in_vain.any(|name| lets::of_block(block, name).reads > 0);
        let mut at_start = Vec::new();
        for ((name, _), range) in &self.kind.definition.variables {
            let mentions = lets::of_block(block, name);
            let unread = if mentions.reads == 0 { "_" } else { "" };
            self.variables.push(Variable {
                name: name.clone(),
                rust: format!("{unread}{}", snake(name)),
                is_bool: range.is_bool,
            });
            match lets::declarations(block, name) {
                _ if !mentions.any() => {}
                Some(found) => self.declares.extend(found),
                None => {
                    self.sets_in_vain |= mentions.reads > 0 && !live.contains(name);
                    let first = range.first.as_ref().unwrap_or(&range.low);
                    at_start.push((name, first, mentions.sets > 0));
                }
            }
        }
        for (name, first, is_set) in at_start {
            let how = if is_set { "let mut" } else { "let" };
            let value = self.value(name, first);
            before.line(format!("{how} {} = {value};", self.rust(name)));
        }
        let mut text = Writer::at(1);
        if is_periodic {
            let mut tick = Writer::at(1);
            match self.kind.periodic {
                Periodic::All => tick.line(format!(
                    "let mut slots = luna::periodic({NAME}, {PERIOD})?;"
                )),
                Periodic::None => {}
                Periodic::Some => {
                    let made = format!("{PERIOD}.map(|period| luna::periodic({NAME}, period))");
                    tick.line(format!("let mut slots = {made}.transpose()?;"));
                }
            }
            tick.append(before);
            before = tick;
        }
        if is_periodic && self.ticking.is_none() {
            self.tick(&mut text);
        }
        self.block(block, &mut text)?;
        if !diverges(block) {
            text.line("Ok(())");
        }
        for number in 1..=self.uses.choices {
            before.line(format!("let mut {} = InTurn::default();", choice(number)));
        }
        Ok((before, text))
    }

    fn tick(&self, out: &mut Writer) {
        match self.kind.periodic {
            Periodic::None => {}
            Periodic::All => out.line("slots.next().await;"),
            Periodic::Some => out.block("if let Some(slots) = &mut slots {", |out| {
                out.line("slots.next().await;");
            }),
        }
    }

    pub(super) fn note(&mut self, expr: &Expr<Path>) {
        let names = &mut self.uses.names;
        expr.each(&mut |path| names.extend(path.word().map(str::to_owned)));
    }

    /// An expression as the variable `name` holds it.
    fn value(&mut self, name: &str, expr: &Expr<Path>) -> String {
        self.note(expr);
        match self.is_bool(name) {
            true => condition(expr, self),
            false => int(expr, self),
        }
    }

    pub(super) fn condition(&mut self, expr: &Expr<Path>) -> String {
        self.note(expr);
        condition(expr, self)
    }

    fn port(&mut self, named: &Named) -> Result<&'m Port, Problem> {
        self.uses.names.insert(named.0.clone());
        let kind = self.kind;
        let found = kind.ports.iter().find(|port| port.name == named.0);
        found.ok_or_else(|| {
            let source = self.model.source();
            source.problem(named.1.clone(), "the process has no such port", "rename it")
        })
    }

    /// `port.send(value)` or `port.recv()`.
    pub(super) fn operation(&mut self, offer: &Offer) -> Result<String, Problem> {
        Ok(match offer {
            Offer::Send(port, value) => {
                let port = self.port(port)?;
                let value = match (&port.holds, value) {
                    (Type::Bool, Some(value)) => self.condition(value),
                    (_, Some(value)) => {
                        self.note(value);
                        int(value, self)
                    }
                    (holds, None) => holds.any().to_owned(),
                };
                format!("{}.send({value})", port.rust)
            }
            Offer::Receive(port, _) => format!("{}.recv()", self.port(port)?.rust),
            Offer::Skip | Offer::After => {
                self.uses.after = true;
                "luna::after(AFTER)".to_owned()
            }
        })
    }

    /// A statement that takes the outcome of an operation, which is the text `outcome`.
    pub(super) fn take(
        &mut self,
        offer: &Offer,
        at: Site,
        outcome: &str,
    ) -> Result<String, Problem> {
        let Offer::Receive(port, variable) = offer else {
            return Ok(format!("{outcome}?;"));
        };
        let holds = &self.port(port)?.holds;
        let Some((variable, _)) = variable else {
            return Ok(match holds {
                Type::OfRust(_) | Type::Defined(_) => format!("let _ = {outcome}?;"),
                Type::Unit | Type::Bool | Type::Int => format!("{outcome}?;"),
            });
        };
        let value = match (holds, self.is_bool(variable)) {
            (Type::Bool, false) => format!("i32::from({outcome}?)"),
            (Type::Bool, true) | (_, false) => format!("{outcome}?"),
            (_, true) => format!("{outcome}? != 0"),
        };
        Ok(format!("{} = {value};", self.place(variable, at)))
    }

    /// The left side of what is set.
    fn place(&self, name: &str, at: Site) -> String {
        let rust = self.rust(name);
        let bare = rust.trim_start_matches('_');
        match self.declares.get(&at) {
            Some(Declares::Once) => format!("let {rust}"),
            Some(Declares::Mutable) => format!("let mut {rust}"),
            Some(Declares::Unread) => format!("let _{bare}"),
            None => rust,
        }
    }

    pub(super) fn block(&mut self, block: &Block, out: &mut Writer) -> Result<(), Problem> {
        for statement in block {
            self.statement(&statement.kind, site(statement), out)?;
        }
        Ok(())
    }

    fn statement(
        &mut self,
        kind: &StatementKind,
        at: Site,
        out: &mut Writer,
    ) -> Result<(), Problem> {
        match kind {
            // Taken out before.
            StatementKind::Skip => {}
            StatementKind::Stop => {
                self.uses.stop = true;
                out.line("stop().await;");
            }
            StatementKind::Offer(offer) => {
                let operation = self.operation(offer)?;
                out.line(self.take(offer, at, &format!("{operation}.await"))?);
            }
            StatementKind::Action(action) => {
                if !self.uses.actions.contains(action) {
                    self.uses.actions.push(action.clone());
                }
                out.line(format!("{}();", snake(action)));
            }
            StatementKind::Assign((name, _), value) => {
                let text = self.value(name, value);
                let is_declared = self.declares.contains_key(&at);
                let short = compound(name, value, self);
                match short.filter(|_| !is_declared && !self.is_bool(name)) {
                    Some((sign, rest)) => out.line(format!("{} {sign} {rest};", self.rust(name))),
                    None => out.line(format!("{} = {text};", self.place(name, at))),
                }
            }
            StatementKind::Assert(claim) => {
                let claim = self.condition(claim);
                out.line(format!("assert!({claim});"));
            }
            StatementKind::If(claim, then, otherwise) => {
                self.conditional("", claim, then, otherwise, out)?;
            }
            StatementKind::While(claim, inner) => {
                let claim = match claim {
                    Expr::Number(number) if *number != 0 => None,
                    claim => Some(self.condition(claim)),
                };
                let head =
                    claim.map_or_else(|| "loop {".to_owned(), |claim| format!("while {claim} {{"));
                self.repeated(&head, inner, at, true, out)?;
            }
            StatementKind::Loop(inner) => self.repeated("loop {", inner, at, true, out)?,
            StatementKind::For((name, _), from, to, inner) => {
                self.note(from);
                self.note(to);
                let (from, to) = (int(from, self), int(to, self));
                let is_read = lets::of_block(inner, name).reads > 0;
                let rust = if is_read { snake(name) } else { "_".to_owned() };
                let head = format!("for {rust} in {from}..{to} {{");
                self.variables.push(Variable {
                    name: name.clone(),
                    rust,
                    is_bool: false,
                });
                self.repeated(&head, inner, at, false, out)?;
                self.variables.pop();
            }
            StatementKind::Par(blocks) => self.par(blocks, out)?,
            StatementKind::Choose(blocks) => self.choose(blocks, out)?,
            StatementKind::Alternative {
                prioritized,
                guards,
            } => super::alternative::write(self, *prioritized, guards, out)?,
        }
        Ok(())
    }

    /// `may_spin`: it has no end of its own.
    fn repeated(
        &mut self,
        head: &str,
        inner: &Block,
        at: Site,
        may_spin: bool,
        out: &mut Writer,
    ) -> Result<(), Problem> {
        let ticks = self.ticking == Some(at);
        out.open(head);
        if ticks {
            self.tick(out);
        }
        self.block(inner, out)?;
        let always_ticks = ticks && self.kind.periodic == Periodic::All;
        let spins = may_spin && !always_ticks && !surely_waits(inner, self.kind);
        if spins && !diverges(inner) {
            out.line("luna::yield_now().await; // nothing above waits for sure");
        }
        out.close("}");
        Ok(())
    }
}
