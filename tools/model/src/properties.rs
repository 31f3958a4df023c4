//! The names in properties: variables of processes, and actions at which they are.

use crate::elaborate::{Elaborator, Scope};
use crate::language::expr::Expr;
use crate::language::parser::Path;
use crate::network::{Atom, Label, Network};
use crate::text::{Problem, Source, nearest};

pub(crate) fn resolve(elaborator: &mut Elaborator<'_>) -> Result<(), Problem> {
    let source = elaborator.source;
    let network = &elaborator.network;
    let mut name = |path: &Path| atom(source, network, path);
    let mut always = Vec::new();
    for ((title, _), expr) in &elaborator.document.always {
        always.push((title.clone(), expr.map(&mut name)?));
    }
    let mut ltl = Vec::new();
    for ((title, _), formula) in &elaborator.document.ltl {
        ltl.push((title.clone(), formula.map(&mut name)?));
    }
    elaborator.network.always = always;
    elaborator.network.ltl = ltl;
    Ok(())
}

/// `process.variable` or `process@action`.
fn atom(source: Source<'_>, network: &Network, path: &Path) -> Result<Expr<Atom>, Problem> {
    let mut words = Vec::new();
    for segment in &path.segments {
        let word = &segment.name;
        words.push(match &segment.index {
            None => word.clone(),
            Some(index) => {
                let index = Scope::default().constant(source, index, &path.span)?;
                format!("{word}[{index}]")
            }
        });
    }
    let variable = match path.action {
        Some(_) => None,
        None => words.pop(),
    };
    let process = words.join(".");
    let problem =
        |message: &str, advice: String| Err(source.problem(path.span.clone(), message, advice));
    let found = network
        .processes
        .iter()
        .position(|known| known.name == process);
    let Some(number) = found else {
        let known = network.processes.iter().map(|known| known.name.as_str());
        let advice = format!(
            "write `process.variable` or `process@action`; {}",
            nearest(&process, known)
        );
        return problem("there is no process of this name", advice);
    };
    if let Some(variable) = variable {
        let mut own = network.variables.iter().enumerate();
        let slot = own.find(|(_, known)| known.process == number && known.name == variable);
        let Some((slot, _)) = slot else {
            let own = network
                .variables
                .iter()
                .filter(|known| known.process == number);
            let advice = nearest(&variable, own.map(|known| known.name.as_str()));
            return problem("the process has no such variable", advice);
        };
        return Ok(Expr::Name(Atom::Variable(slot)));
    }
    let action = path.action.as_deref().unwrap_or("");
    let mut places = Vec::new();
    let mut known = std::collections::BTreeSet::new();
    for (agent, found) in network.agents.iter().enumerate() {
        for (place, found_place) in found.code.iter().enumerate() {
            if found.process != number {
                continue;
            }
            if let [edge] = found_place.step.edges()
                && let Label::Own(name) = &edge.label
            {
                known.insert(name.as_str());
                if name == action {
                    places.push((agent, place));
                }
            }
        }
    }
    if places.is_empty() {
        let advice = nearest(action, known.iter().copied());
        return problem("the process has no such action", advice);
    }
    Ok(Expr::Name(Atom::At(places)))
}
