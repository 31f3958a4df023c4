//! From a file to a network: arrays and compositions are laid out, names are resolved.

use crate::compile::Compiler;
use crate::draw::layout;
use crate::file::{self, Composition, Content, Definition, Document, Part, Range, Run, Side};
use crate::language::body::{Named, Span};
use crate::language::expr::Expr;
use crate::language::parser::Path;
use crate::network::{Channel, Group, Network, Process, Variable};
use crate::properties;
use crate::text::{Problem, Source, nearest};

/// More processes, channels or variables than this are refused.
const MAX_PARTS: usize = 20_000;
/// Compositions within compositions.
const MAX_DEPTH: usize = 32;

/// The names within one instance.
#[derive(Debug, Default, Clone)]
pub(crate) struct Scope {
    pub(crate) parameters: Vec<(String, i32)>,
    /// The channels behind the ports.
    pub(crate) ports: Vec<(String, usize, Side)>,
}

impl Scope {
    pub(crate) fn port(&self, name: &str) -> Option<(usize, Side)> {
        let found = self.ports.iter().find(|(known, _, _)| known == name);
        found.map(|&(_, channel, side)| (channel, side))
    }

    pub(crate) fn parameter(&self, name: &str) -> Option<i32> {
        let found = self.parameters.iter().find(|(known, _)| known == name);
        found.map(|&(_, value)| value)
    }

    pub(crate) fn knows(&self, name: &str) -> bool {
        self.parameter(name).is_some() || self.port(name).is_some()
    }

    /// The value of an expression over parameters. `span` is where it stands, or near it.
    pub(crate) fn constant(
        &self,
        source: Source<'_>,
        expr: &Expr<Path>,
        span: &Span,
    ) -> Result<i32, Problem> {
        let expr: Expr<()> = expr.map(&mut |path: &Path| {
            let word = path.word().unwrap_or("");
            self.parameter(word).map(Expr::Number).ok_or_else(|| {
                let known = self.parameters.iter().map(|(name, _)| name.as_str());
                let message = "there is no parameter of this name";
                source.problem(path.span.clone(), message, nearest(word, known))
            })
        })?;
        expr.value(&|()| 0).map_err(|fault| {
            let message = format!("an expression here {fault}");
            source.problem(span.clone(), message, "change it")
        })
    }
}

pub(crate) struct Elaborator<'a> {
    pub(crate) source: Source<'a>,
    pub(crate) document: &'a Document,
    pub(crate) network: Network,
}

/// Where an instance is to be.
struct At<'a> {
    name: String,
    group: usize,
    /// Where it is drawn.
    drawn: Option<file::At>,
    run: &'a Run,
    depth: usize,
}

pub(crate) fn elaborate(source: Source<'_>, document: &Document) -> Result<Network, Problem> {
    let Some((span, system)) = &document.system else {
        let advice = "write `[system.part.NAME]` with `process = \"…\"`";
        return Err(source.problem(0..0, "the file has no system", advice));
    };
    crate::deployment::check(source, document)?;
    let name = document.name.clone().unwrap_or_else(|| "system".to_owned());
    let mut elaborator = Elaborator {
        source,
        document,
        network: Network {
            name: name.clone(),
            groups: vec![Group {
                name,
                parent: None,
                at: None,
            }],
            max_states: document.max_states,
            executors: crate::deployment::executors(document),
            latency: document.latency,
            ..Network::default()
        },
    };
    let at = At {
        name: String::new(),
        group: 0,
        drawn: None,
        run: &Run::default(),
        depth: 0,
    };
    elaborator.composition(system, &Scope::default(), &at)?;
    if elaborator.network.processes.is_empty() {
        let advice = "write `[system.part.NAME]` with `process = \"…\"`";
        return Err(source.problem(span.clone(), "the system has no processes", advice));
    }
    properties::resolve(&mut elaborator)?;
    Ok(elaborator.network)
}

impl Elaborator<'_> {
    pub(crate) fn problem<T>(
        &self,
        span: &Span,
        message: &str,
        advice: &str,
    ) -> Result<T, Problem> {
        Err(self.source.problem(span.clone(), message, advice))
    }

    fn composition(
        &mut self,
        composition: &Composition,
        scope: &Scope,
        at: &At<'_>,
    ) -> Result<(), Problem> {
        let mut local: Vec<(&Named, usize, Option<usize>)> = Vec::new();
        for channel in &composition.channels {
            let span = &channel.name.1;
            let values = channel.values.as_ref();
            let values = values
                .map(|range| self.range(range, scope, span))
                .transpose()?;
            let count = self.count(channel.array.as_ref(), scope, span)?;
            if scope.knows(&channel.name.0) {
                return self.problem(span, "this name is used already", "use another name");
            }
            local.push((&channel.name, self.network.channels.len(), count));
            for name in indexed(&at.name, &channel.name.0, count) {
                self.network.channels.push(Channel {
                    name,
                    kind: channel.kind,
                    type_name: channel.type_name.clone(),
                    values: values.map(|(low, high, _)| (low, high)),
                    senders: Vec::new(),
                    receivers: Vec::new(),
                });
            }
        }
        for part in &composition.parts {
            self.part(part, scope, &local, at)?;
        }
        for &(name, first, count) in &local {
            for number in first..first + count.unwrap_or(1) {
                let channel = &self.network.channels[number];
                let missing = match (channel.senders.is_empty(), channel.receivers.is_empty()) {
                    (false, false) => continue,
                    (true, _) => "send",
                    _ => "receive",
                };
                let message = format!("no part can {missing} on the channel `{}`", channel.name);
                let advice = "bind a port of a part to it, or remove it";
                return self.problem(&name.1, &message, advice);
            }
        }
        Ok(())
    }

    /// How many; nothing for what is no array.
    fn count(
        &self,
        array: Option<&Expr<Path>>,
        scope: &Scope,
        span: &Span,
    ) -> Result<Option<usize>, Problem> {
        let Some(array) = array else { return Ok(None) };
        let count = scope.constant(self.source, array, span)?;
        let have = self.network.processes.len() + self.network.channels.len();
        match usize::try_from(count) {
            Ok(count) if count >= 1 && have + count <= MAX_PARTS => Ok(Some(count)),
            _ => {
                let message = format!("the array has the size {count}");
                let advice = format!("use 1 or more, and at most {MAX_PARTS} in all");
                self.problem(span, &message, &advice)
            }
        }
    }

    /// Lowest, highest and first value.
    fn range(&self, range: &Range, scope: &Scope, span: &Span) -> Result<(i32, i32, i32), Problem> {
        let low = scope.constant(self.source, &range.low, span)?;
        let high = scope.constant(self.source, &range.high, span)?;
        let first = range.first.as_ref();
        let first = first.map(|first| scope.constant(self.source, first, span));
        let first = first.transpose()?.unwrap_or(low);
        if low > high || !(low..=high).contains(&first) {
            let message = format!("the values {low}..{high} = {first} are no range");
            let advice = "write `LOWEST..HIGHEST = FIRST`, all of them included";
            return self.problem(span, &message, advice);
        }
        Ok((low, high, first))
    }

    fn part(
        &mut self,
        part: &Part,
        scope: &Scope,
        local: &[(&Named, usize, Option<usize>)],
        at: &At<'_>,
    ) -> Result<(), Problem> {
        let definitions = &self.document.definitions;
        let Some(definition) = definitions.iter().find(|d| d.name.0 == part.process.0) else {
            let known = definitions.iter().map(|d| d.name.0.as_str());
            let advice = nearest(&part.process.0, known);
            return self.problem(&part.process.1, "there is no process of this name", &advice);
        };
        let run = Run {
            priority: part.run.priority.or(at.run.priority),
            period: part.run.period.or(at.run.period),
            on: part.run.on.clone().or_else(|| at.run.on.clone()),
            cost: part.run.cost.or(at.run.cost),
            longest_poll: part.run.longest_poll.or(at.run.longest_poll),
            deadline: part.run.deadline.or(at.run.deadline),
        };
        if run
            .cost
            .zip(run.longest_poll)
            .is_some_and(|(cost, poll)| poll > cost)
        {
            let message = "the longest poll of this part is longer than its cost";
            let advice = "`cost` is the time of all polls of a cycle: raise it";
            return self.problem(&part.name.1, message, advice);
        }
        let count = self.count(part.array.as_ref(), scope, &part.name.1)?;
        for (number, name) in indexed(&at.name, &part.name.0, count)
            .into_iter()
            .enumerate()
        {
            if self.network.processes.len() + self.network.groups.len() > MAX_PARTS {
                let advice = format!("at most {MAX_PARTS} are possible");
                return self.problem(&part.name.1, "there are too many processes", &advice);
            }
            let mut outer = scope.clone();
            if count.is_some() {
                outer.parameters.retain(|(name, _)| name != "i");
                outer.parameters.push(("i".to_owned(), number as i32));
            }
            let inner = self.inner_scope(part, definition, &outer, local)?;
            let at = At {
                name,
                group: at.group,
                drawn: part.at.map(|at| layout::of_element(at, number)),
                run: &run,
                depth: at.depth + 1,
            };
            self.instance(definition, &inner, at, &part.process.1)?;
        }
        Ok(())
    }

    fn instance(
        &mut self,
        definition: &Definition,
        scope: &Scope,
        at: At<'_>,
        used: &Span,
    ) -> Result<(), Problem> {
        let body = match &definition.content {
            Content::Composition(_) if at.depth > MAX_DEPTH => {
                let message = "the process is made of itself, or nested too deeply";
                return self.problem(used, message, "name another process");
            }
            Content::Composition(composition) => {
                let group = self.network.groups.len();
                self.network.groups.push(Group {
                    name: at.name.clone(),
                    parent: Some(at.group),
                    at: at.drawn,
                });
                return self.composition(composition, scope, &At { group, ..at });
            }
            Content::Body(body) => body,
        };
        let process = self.network.processes.len();
        for &(_, channel, side) in &scope.ports {
            let channel = &mut self.network.channels[channel];
            let ends = match side {
                Side::Send => &mut channel.senders,
                Side::Receive => &mut channel.receivers,
            };
            if ends.last() != Some(&process) {
                ends.push(process);
            }
        }
        let mut variables = Vec::new();
        for ((name, span), range) in &definition.variables {
            let (low, high, first) = self.range(range, scope, span)?;
            variables.push((name.clone(), self.network.variables.len()));
            self.network.variables.push(Variable {
                process,
                name: name.clone(),
                low,
                high,
                first,
            });
        }
        self.network.processes.push(Process {
            name: at.name.clone(),
            definition: definition.name.0.clone(),
            group: at.group,
            at: at.drawn,
            agent: self.network.agents.len(),
            priority: at.run.priority,
            period: at.run.period,
            on: at.run.on.as_ref().map(|(name, _)| name.clone()),
            cost: at.run.cost,
            longest_poll: at.run.longest_poll,
            deadline: at.run.deadline,
            scope: scope.clone(),
        });
        let mut compiler = Compiler {
            source: self.source,
            network: &mut self.network,
            scope,
            process,
            name: &at.name,
            variables,
            counters: Vec::new(),
        };
        compiler.agent(body, None)?;
        Ok(())
    }
}

/// The names of an array's elements, or the one name.
fn indexed(outer: &str, name: &str, count: Option<usize>) -> Vec<String> {
    let name = match outer {
        "" => name.to_owned(),
        _ => format!("{outer}.{name}"),
    };
    match count {
        None => vec![name],
        Some(count) => (0..count).map(|i| format!("{name}[{i}]")).collect(),
    }
}
