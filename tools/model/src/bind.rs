//! What the names within a part stand for.

use crate::elaborate::{Elaborator, Scope};
use crate::file::{Definition, Part, Side};
use crate::language::body::Named;
use crate::language::parser::Path;
use crate::text::{Problem, nearest};

impl Elaborator<'_> {
    /// The names within an instance of a part.
    pub(crate) fn inner_scope(
        &self,
        part: &Part,
        definition: &Definition,
        outer: &Scope,
        local: &[(&Named, usize, Option<usize>)],
    ) -> Result<Scope, Problem> {
        let mut inner = Scope::default();
        for ((name, _), value) in &definition.parameters {
            let set = part.set.iter().find(|((known, _), _)| known == name);
            let value = match set {
                Some(((_, span), expr)) => outer.constant(self.source, expr, span)?,
                None => *value,
            };
            inner.parameters.push((name.clone(), value));
        }
        for ((name, span), _) in &part.set {
            if inner.parameter(name).is_none() {
                let known = definition
                    .parameters
                    .iter()
                    .map(|((name, _), _)| name.as_str());
                let advice = nearest(name, known);
                return self.problem(span, "the process has no such parameter", &advice);
            }
        }
        for ((name, _), side) in &definition.ports {
            let bound = part.bind.iter().find(|((known, _), _)| known == name);
            let Some((_, path)) = bound else {
                let message = format!("the port `{name}` of `{}` is not bound", definition.name.0);
                let advice = format!("write `bind.{name} = \"CHANNEL\"`");
                return self.problem(&part.name.1, &message, &advice);
            };
            let channel = self.channel(path, *side, outer, local)?;
            inner.ports.push((name.clone(), channel, *side));
        }
        for ((name, span), _) in &part.bind {
            if inner.port(name).is_none() {
                let known = definition.ports.iter().map(|((name, _), _)| name.as_str());
                let advice = nearest(name, known);
                return self.problem(span, "the process has no such port", &advice);
            }
        }
        Ok(inner)
    }

    /// The channel that a port is bound to.
    fn channel(
        &self,
        path: &Path,
        side: Side,
        outer: &Scope,
        local: &[(&Named, usize, Option<usize>)],
    ) -> Result<usize, Problem> {
        let span = &path.span;
        let [segment] = &path.segments[..] else {
            let advice = "bind it to a channel of the same composition, or to a port of it";
            return self.problem(span, "a channel within a part cannot be reached", advice);
        };
        let index = segment.index.as_ref();
        let index = index
            .map(|index| outer.constant(self.source, index, span))
            .transpose()?;
        if let Some((channel, of_port)) = outer.port(&segment.name) {
            if of_port != side {
                let advice = "bind it to a port of the same direction, or to a channel";
                return self.problem(span, "the port has the other direction", advice);
            }
            if index.is_some() || path.action.is_some() {
                return self.problem(span, "a port is no array", "write its name alone");
            }
            return Ok(channel);
        }
        let found = local.iter().find(|(name, _, _)| name.0 == segment.name);
        let Some(&(_, first, count)) = found else {
            let ports = outer.ports.iter().map(|(name, _, _)| name.as_str());
            let known = local
                .iter()
                .map(|(name, _, _)| name.0.as_str())
                .chain(ports);
            let advice = nearest(&segment.name, known);
            return self.problem(span, "there is no channel of this name here", &advice);
        };
        match (count, index) {
            (None, None) => Ok(first),
            (None, Some(_)) => self.problem(span, "this channel is no array", "remove the index"),
            (Some(count), Some(index)) if (0..count as i64).contains(&i64::from(index)) => {
                Ok(first + index as usize)
            }
            (Some(count), Some(index)) => {
                let message = format!("the index is {index}");
                let advice = format!("use 0 to {}", count - 1);
                self.problem(span, &message, &advice)
            }
            (Some(_), None) => self.problem(
                span,
                "this channel is an array",
                "write an index: `channel[i]`",
            ),
        }
    }
}
