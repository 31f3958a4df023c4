//! From a body to places and steps.

use crate::elaborate::Scope;
use crate::file::Side;
use crate::language::body::{Block, Guard, Named, Offer, Span, Statement, StatementKind};
use crate::language::expr::Expr;
use crate::language::parser::Path;
use crate::network::{Agent, END, Edge, Label, Network, Place, Step, Variable};
use crate::text::{Problem, Source, nearest};

pub(crate) struct Compiler<'a> {
    pub(crate) source: Source<'a>,
    pub(crate) network: &'a mut Network,
    pub(crate) scope: &'a Scope,
    pub(crate) process: usize,
    pub(crate) name: &'a str,
    /// The variables of the process, and those of `for` around.
    pub(crate) variables: Vec<(String, usize)>,
    /// Those of `for` around.
    pub(crate) counters: Vec<usize>,
}

impl Compiler<'_> {
    /// Adds an agent that is this block.
    pub(crate) fn agent(&mut self, block: &Block, parent: Option<usize>) -> Result<usize, Problem> {
        let number = self.network.agents.len();
        let name = match parent {
            None => self.name.to_owned(),
            Some(_) => {
                let first = self.network.processes[self.process].agent;
                format!("{}, branch {}", self.name, number - first)
            }
        };
        self.network.agents.push(Agent {
            process: self.process,
            name,
            parent,
            siblings: Vec::new(),
            start: END,
            code: Vec::new(),
        });
        let mut code = vec![Place {
            step: Step::End,
            line: 0,
        }];
        let start = self.block(number, &mut code, block, END)?;
        let agent = &mut self.network.agents[number];
        agent.start = start;
        agent.code = code;
        Ok(number)
    }

    /// Returns where the block begins, which goes on at `next`.
    fn block(
        &mut self,
        agent: usize,
        code: &mut Vec<Place>,
        block: &Block,
        next: usize,
    ) -> Result<usize, Problem> {
        let mut next = next;
        for statement in block.iter().rev() {
            next = self.statement(agent, code, statement, next)?;
        }
        Ok(next)
    }

    fn statement(
        &mut self,
        agent: usize,
        code: &mut Vec<Place>,
        statement: &Statement,
        next: usize,
    ) -> Result<usize, Problem> {
        let line = self.source.position(statement.span.start).0;
        let step = match &statement.kind {
            StatementKind::Skip => return Ok(next),
            StatementKind::Stop => Step::Wait(Vec::new()),
            StatementKind::Offer(offer) => {
                let label = self.label(offer)?;
                Step::Wait(vec![edge(label, next, line)])
            }
            StatementKind::Action(name) => {
                if self.scope.port(name).is_some() {
                    let message = "this port is neither sent to nor received from";
                    let advice = "write `!` or `?` behind it";
                    return Err(self.source.problem(statement.span.clone(), message, advice));
                }
                Step::Wait(vec![edge(Label::Own(name.clone()), next, line)])
            }
            StatementKind::Assign(variable, value) => {
                Step::Assign(self.set(variable)?, self.expr(value)?, next)
            }
            StatementKind::Assert(condition) => Step::Assert(self.expr(condition)?, next),
            StatementKind::If(condition, then, otherwise) => {
                let condition = self.expr(condition)?;
                let then = self.block(agent, code, then, next)?;
                let otherwise = self.block(agent, code, otherwise, next)?;
                Step::Branch(condition, then, otherwise)
            }
            StatementKind::Loop(inner) => {
                let head = add(code, Step::Goto(END), line);
                let start = self.block(agent, code, inner, head)?;
                code[head].step = Step::Goto(start);
                return Ok(head);
            }
            StatementKind::While(condition, inner) => {
                let head = add(code, Step::Goto(END), line);
                let condition = self.expr(condition)?;
                let start = self.block(agent, code, inner, head)?;
                code[head].step = Step::Branch(condition, start, next);
                return Ok(head);
            }
            StatementKind::For(variable, from, to, inner) => {
                return self.counted(agent, code, (variable, from, to, inner), line, next);
            }
            StatementKind::Par(blocks) => self.par(agent, code, blocks, &statement.span, next)?,
            StatementKind::Choose(blocks) => {
                let mut edges = Vec::new();
                for block in blocks {
                    let at = block
                        .first()
                        .map_or(line, |first| self.source.position(first.span.start).0);
                    let start = self.block(agent, code, block, next)?;
                    edges.push(edge(Label::Choice, start, at));
                }
                Step::Wait(edges)
            }
            StatementKind::Alternative { guards, .. } => {
                let edges = guards
                    .iter()
                    .map(|guard| self.guard(agent, code, guard, next));
                Step::Wait(edges.collect::<Result<_, _>>()?)
            }
        };
        Ok(add(code, step, line))
    }

    fn guard(
        &mut self,
        agent: usize,
        code: &mut Vec<Place>,
        guard: &Guard,
        next: usize,
    ) -> Result<Edge, Problem> {
        let condition = guard.condition.as_ref();
        Ok(Edge {
            condition: condition.map(|found| self.expr(found)).transpose()?,
            label: self.label(&guard.offer)?,
            next: self.block(agent, code, &guard.body, next)?,
            line: self.source.position(guard.span.start).0,
        })
    }

    /// `for`: a variable of its own, which is 0 steps from its start again at the end.
    fn counted(
        &mut self,
        agent: usize,
        code: &mut Vec<Place>,
        (variable, from, to, inner): (&Named, &Expr<Path>, &Expr<Path>, &Block),
        line: usize,
        next: usize,
    ) -> Result<usize, Problem> {
        let from = self.scope.constant(self.source, from, &variable.1)?;
        let to = self.scope.constant(self.source, to, &variable.1)?;
        let high = to.max(from);
        let slot = self.network.variables.len();
        self.network.variables.push(Variable {
            process: self.process,
            name: variable.0.clone(),
            low: from,
            high,
            first: from,
        });
        let known = self.variables.iter().any(|(name, _)| *name == variable.0);
        if known || self.scope.knows(&variable.0) {
            let message = "this name is used already";
            let advice = "use another name for the variable of this loop";
            return Err(self.source.problem(variable.1.clone(), message, advice));
        }
        self.variables.push((variable.0.clone(), slot));
        self.counters.push(slot);
        let reset = add(code, Step::Assign(slot, Expr::Number(from), next), line);
        let head = add(code, Step::Goto(END), line);
        let one_more = Expr::Binary(
            crate::language::expr::Binary::Plus,
            Box::new(Expr::Name(slot)),
            Box::new(Expr::Number(1)),
        );
        let count = add(code, Step::Assign(slot, one_more, head), line);
        let start = self.block(agent, code, inner, count)?;
        let is_below = Expr::Binary(
            crate::language::expr::Binary::Less,
            Box::new(Expr::Name(slot)),
            Box::new(Expr::Number(to)),
        );
        code[head].step = Step::Branch(is_below, start, reset);
        self.variables.pop();
        self.counters.pop();
        Ok(head)
    }

    fn par(
        &mut self,
        agent: usize,
        code: &mut Vec<Place>,
        blocks: &[Block],
        span: &Span,
        next: usize,
    ) -> Result<Step, Problem> {
        let branches = blocks
            .iter()
            .map(|block| self.agent(block, Some(agent)))
            .collect::<Result<Vec<usize>, _>>()?;
        for &branch in &branches {
            self.network.agents[branch].siblings.clone_from(&branches);
        }
        for (at, &branch) in branches.iter().enumerate() {
            let assigned = self.network.uses(branch).1;
            for &other in branches
                .iter()
                .enumerate()
                .filter(|(i, _)| *i != at)
                .map(|(_, b)| b)
            {
                if let Some(&slot) = self.network.uses(other).0.intersection(&assigned).next() {
                    let name = &self.network.variables[slot].name;
                    let message = format!("`{name}` is set by one branch and used by another");
                    let advice = "send it on a channel, or use two variables";
                    return Err(self.source.problem(span.clone(), message, advice));
                }
            }
        }
        let line = self.source.position(span.start).0;
        let join = add(code, Step::Join(branches.clone(), next), line);
        Ok(Step::Fork(branches, join))
    }

    fn label(&self, offer: &Offer) -> Result<Label, Problem> {
        Ok(match offer {
            Offer::Skip => Label::Skip,
            Offer::After => Label::After,
            Offer::Send(port, value) => {
                let channel = self.channel(port, Side::Send, value.is_some())?;
                let value = value.as_ref().map(|value| self.expr(value)).transpose()?;
                Label::Send(channel, value)
            }
            Offer::Receive(port, variable) => {
                let channel = self.channel(port, Side::Receive, variable.is_some())?;
                let variable = variable.as_ref().map(|name| self.set(name)).transpose()?;
                Label::Receive(channel, variable)
            }
        })
    }

    fn channel(&self, port: &Named, side: Side, has_value: bool) -> Result<usize, Problem> {
        let problem =
            |message: &str, advice: &str| Err(self.source.problem(port.1.clone(), message, advice));
        let Some((channel, declared)) = self.scope.port(&port.0) else {
            let names = self.scope.ports.iter().map(|(name, _, _)| name.as_str());
            return problem("the process has no such port", &nearest(&port.0, names));
        };
        if declared != side {
            let message = "the port has the other direction";
            return problem(
                message,
                "change it in `ports`, or use `!` to send and `?` to receive",
            );
        }
        let found = &self.network.channels[channel];
        match (found.values, has_value, side) {
            (None, true, _) => {
                let advice = format!(
                    "give the channel `{}` a type as `0..9` or `bool`, or leave the value out",
                    found.name
                );
                problem("the check follows no values of this channel", &advice)
            }
            (Some(_), false, Side::Send) => {
                let advice = format!("write what is sent, a value of `{}`", found.type_name);
                problem("a value is missing", &advice)
            }
            _ => Ok(channel),
        }
    }

    /// A variable that the body sets: not that of a loop, which counts.
    fn set(&self, name: &Named) -> Result<usize, Problem> {
        let slot = self.variable(name)?;
        if self.counters.contains(&slot) {
            let message = "the variable of a `for` cannot be set";
            let advice = "use a variable of the process and `while`";
            return Err(self.source.problem(name.1.clone(), message, advice));
        }
        Ok(slot)
    }

    fn variable(&self, name: &Named) -> Result<usize, Problem> {
        let found = self.variables.iter().find(|(known, _)| *known == name.0);
        found.map(|(_, slot)| *slot).ok_or_else(|| {
            let known = self.variables.iter().map(|(name, _)| name.as_str());
            let message = "the process has no such variable";
            self.source
                .problem(name.1.clone(), message, nearest(&name.0, known))
        })
    }

    fn expr(&self, expr: &Expr<Path>) -> Result<Expr<usize>, Problem> {
        expr.map(&mut |path: &Path| {
            let word = path.word().unwrap_or("");
            if let Some(number) = self.scope.parameter(word) {
                return Ok(Expr::Number(number));
            }
            let found = self.variables.iter().find(|(known, _)| known == word);
            found.map(|(_, slot)| Expr::Name(*slot)).ok_or_else(|| {
                let known = self.variables.iter().map(|(name, _)| name.as_str());
                let parameters = self.scope.parameters.iter().map(|(name, _)| name.as_str());
                let message = "there is no variable or parameter of this name";
                let advice = nearest(word, known.chain(parameters));
                self.source.problem(path.span.clone(), message, advice)
            })
        })
    }
}

fn add(code: &mut Vec<Place>, step: Step, line: usize) -> usize {
    code.push(Place { step, line });
    code.len() - 1
}

fn edge(label: Label, next: usize, line: usize) -> Edge {
    Edge {
        condition: None,
        label,
        next,
        line,
    }
}
