//! A network in Promela: a `proctype` for each process and each branch of `par`.
//!
//! Sends and receives are Promela's own; so are the rendezvous and the buffers. Each statement that
//! is a move of the model has a line of its own, so that a trail of SPIN can be told in the model's
//! words.

use super::ending::Ending;
use super::wait::needs_choice;
use crate::file::Side;
use crate::language::expr::{Binary, Expr};
use crate::network::{Atom, Buffering, Edge, Network, Step};
use std::collections::BTreeMap;

/// A model for SPIN.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Promela {
    pub(crate) text: String,
    /// For each line that is a move: the agent, its place and the edge.
    pub(crate) moves: BTreeMap<usize, Mark>,
}

/// What a line of the text is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Mark {
    pub(crate) agent: usize,
    pub(crate) place: usize,
    pub(crate) edge: usize,
    pub(crate) is_closed: bool,
}

pub(crate) fn promela(network: &Network) -> Promela {
    let mut writer = Writer {
        network,
        ending: Ending::of(network),
        out: Promela {
            text: String::new(),
            moves: BTreeMap::new(),
        },
        lines: 0,
    };
    writer.head();
    for agent in 0..network.agents.len() {
        writer.agent(agent);
    }
    for (number, (title, formula)) in network.ltl.iter().enumerate() {
        let text = formula.text(&|expr| writer.property(expr));
        writer.line("");
        writer.line(&format!(
            "ltl property{number} {{ {text} }} /* {} */",
            comment(title)
        ));
    }
    writer.out
}

pub(super) struct Writer<'a> {
    pub(super) network: &'a Network,
    pub(super) ending: Ending,
    pub(super) out: Promela,
    pub(super) lines: usize,
}

impl Writer<'_> {
    pub(super) fn line(&mut self, text: &str) {
        self.out.text.push_str(text);
        self.out.text.push('\n');
        self.lines += 1;
    }

    fn head(&mut self) {
        let network = self.network;
        self.line(&format!(
            "/* {}, from a model of LUNA */",
            comment(&network.name)
        ));
        self.line("chan no_sender = [0] of { int };");
        self.line("chan no_receiver = [0] of { int };");
        for (number, channel) in network.channels.iter().enumerate() {
            let kind = match channel.values {
                Some(_) => "int",
                None => "bit",
            };
            let size = channel.kind.capacity();
            let name = comment(&channel.name);
            self.line(&format!(
                "chan c{number} = [{size}] of {{ {kind} }}; /* {name} */"
            ));
        }
        for (number, variable) in network.variables.iter().enumerate() {
            let process = &network.processes[variable.process].name;
            let (name, first) = (&variable.name, variable.first);
            let name = comment(&format!("{process}.{name}"));
            self.line(&format!("int v{number} = {first}; /* {name} */"));
        }
        for (number, process) in network.processes.iter().enumerate() {
            if self.ending.processes[number] {
                self.line(&format!(
                    "bit ended{number}; /* {} */",
                    comment(&process.name)
                ));
            }
        }
        for (number, agent) in network.agents.iter().enumerate() {
            if agent.parent.is_some() {
                let name = comment(&agent.name);
                self.line(&format!("bit go{number}; byte done{number}; /* {name} */"));
            }
        }
    }

    fn agent(&mut self, number: usize) {
        let agent = &self.network.agents[number];
        self.line("");
        self.line(&format!(
            "active proctype p{number}() {{ /* {} */",
            comment(&agent.name)
        ));
        // A step without an effect, which SPIN would not take in a circle as `skip`.
        self.line("  bit nothing;");
        let edges = || agent.code.iter().map(|place| place.step.edges());
        if edges().flatten().any(|edge| self.rotates(edge)) {
            self.line("  int r;");
        }
        let guards = edges().map(|of| of.iter().filter(|edge| needs_choice(edge)).count());
        for guard in 0..guards.max().unwrap_or(0) {
            self.line(&format!("  chan g{guard};"));
        }
        if agent.parent.is_some() {
            self.line("end_wait:");
            self.line(&format!("  atomic {{ (go{number}) -> go{number} = 0 }}"));
        }
        self.line(&format!("  goto L{};", agent.start));
        for place in 1..agent.code.len() {
            self.place(number, place);
        }
        // Where it ends; a branch that has failed is told apart by 2.
        match agent.parent {
            None => {
                let process = agent.process;
                self.line("L0:");
                match self.ending.processes[process] {
                    true => self.line(&format!("  ended{process} = 1")),
                    false => self.line("  skip"),
                }
            }
            Some(_) => {
                self.line("L0:");
                self.line(&format!("  done{number} = 1; goto end_wait;"));
                if self.ending.fails[number] {
                    self.line("Lfail:");
                    self.line(&format!("  done{number} = 2; goto end_wait"));
                }
            }
        }
        self.line("}");
    }

    /// Whether it needs a variable to overwrite the newest value.
    fn rotates(&self, edge: &Edge) -> bool {
        edge.label.end().is_some_and(|(channel, side)| {
            side == Side::Send
                && matches!(
                    self.network.channels[channel].kind,
                    Buffering::OverwriteNewest(2..)
                )
        })
    }

    /// The label at which an agent goes on that has found a channel closed.
    pub(super) fn fail_label(&self, agent: usize) -> &'static str {
        match self.network.agents[agent].parent {
            None => "L0",
            Some(_) => "Lfail",
        }
    }

    fn place(&mut self, agent: usize, at: usize) {
        let network = self.network;
        let place = &network.agents[agent].code[at];
        self.line(&format!("L{at}: /* line {} */", place.line));
        match &place.step {
            Step::End => {}
            Step::Goto(next) => self.line(&format!("  nothing = 0; goto L{next};")),
            Step::Assign(slot, value, next) => {
                self.divisors(value);
                let variable = &network.variables[*slot];
                let (low, high) = (variable.low, variable.high);
                let value = expr(value);
                self.line(&format!("  assert({value} >= {low} && {value} <= {high});"));
                self.line(&format!("  v{slot} = {value}; goto L{next};"));
            }
            Step::Branch(condition, then, otherwise) => {
                self.divisors(condition);
                let condition = expr(condition);
                self.line("  if");
                self.line(&format!("  :: {condition} -> goto L{then}"));
                self.line(&format!("  :: else -> goto L{otherwise}"));
                self.line("  fi;");
            }
            Step::Assert(condition, next) => {
                self.divisors(condition);
                self.line(&format!("  assert({}); goto L{next};", expr(condition)));
            }
            Step::Fork(branches, next) => {
                let go = branches.iter().map(|branch| format!("go{branch} = 1"));
                let go = go.collect::<Vec<_>>().join("; ");
                self.line(&format!("  atomic {{ {go} }}; goto L{next};"));
            }
            Step::Join(branches, next) => self.join(agent, branches, *next),
            Step::Wait(edges) => self.wait(agent, at, edges),
        }
    }

    fn join(&mut self, agent: usize, branches: &[usize], next: usize) {
        let join = |each: &dyn Fn(&usize) -> String, sign: &str| {
            branches.iter().map(each).collect::<Vec<_>>().join(sign)
        };
        let all = join(&|branch| format!("done{branch}"), " && ");
        let one = join(&|branch| format!("done{branch} == 2"), " || ");
        let reset = join(&|branch| format!("done{branch} = 0"), "; ");
        self.line("  if");
        self.line(&format!(
            "  :: d_step {{ ({all} && !({one})) -> {reset} }}; goto L{next}"
        ));
        if branches.iter().any(|&branch| self.ending.fails[branch]) {
            let fail = self.fail_label(agent);
            self.line(&format!(
                "  :: d_step {{ ({all} && ({one})) -> {reset} }}; goto {fail}"
            ));
        }
        self.line("  fi;");
    }

    pub(super) fn divisors(&mut self, of: &Expr<usize>) {
        self.divisors_if("true", of);
    }

    /// As `divisors`, where the expression is evaluated only if `open` holds.
    pub(super) fn divisors_if(&mut self, open: &str, of: &Expr<usize>) {
        let mut found = Vec::new();
        of.divisors(&mut found);
        for divisor in found {
            self.line(&format!("  assert(!{open} || {} != 0);", expr(divisor)));
        }
    }

    fn property(&self, of: &Expr<Atom>) -> String {
        let name = |atom: &Atom| match atom {
            Atom::Variable(slot) => format!("v{slot}"),
            Atom::At(places) => {
                let at = places
                    .iter()
                    .map(|(agent, place)| format!("p{agent}@L{place}"));
                format!("({})", at.collect::<Vec<_>>().join(" || "))
            }
        };
        of.text(&name, &Binary::sign, "!")
    }
}

pub(super) fn expr(of: &Expr<usize>) -> String {
    of.text(&|slot| format!("v{slot}"), &Binary::sign, "!")
}

/// Names are letters and digits of any script, brackets and dots; a title may be anything.
fn comment(text: &str) -> String {
    let harmless = |c: char| match c {
        '*' | '/' | '\n' | '\r' | '"' => ' ',
        _ => c,
    };
    text.chars().map(harmless).collect()
}
