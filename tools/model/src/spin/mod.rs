//! Promela, and SPIN as a second opinion.

pub(crate) mod ending;
pub(crate) mod promela;
pub(crate) mod run;
pub(crate) mod trail;
mod wait;

use crate::explore::{Finding, FindingKind};
use crate::network::Network;
use promela::{Promela, promela};
use run::{SpinError, Verdict, Verifier};

/// What SPIN has found.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct SpinCheck {
    /// At most one deadlock or assertion, and one finding for each property.
    pub findings: Vec<Finding>,
    /// What it could not see all states for: `deadlocks and assertions`, or a property's title.
    pub incomplete: Vec<String>,
}

/// Assertions first: what goes on after a broken one is no run of the model.
pub(crate) fn check(network: &Network) -> Result<SpinCheck, SpinError> {
    let promela = promela(network);
    let agents = network.agents.len();
    let mut found = SpinCheck {
        findings: Vec::new(),
        incomplete: Vec::new(),
    };
    let safety = Verifier::make(&promela, agents, false)?;
    // One run finds either. After a deadlock, another looks for assertions alone.
    let (verdict, kind) = match safety.verify(&[])? {
        found if found.is_assertion() => (found, FindingKind::Assertion),
        found @ Verdict::Fails { .. } => match safety.verify(&["-E"])? {
            broken @ Verdict::Fails { .. } => (broken, FindingKind::Assertion),
            _ => (found, FindingKind::Deadlock),
        },
        other => (other, FindingKind::Deadlock),
    };
    found.add(network, &promela, verdict, kind, "deadlocks and assertions");
    if network.ltl.is_empty() {
        return Ok(found);
    }
    // The verifier of a property would stop at the assertion, and take it for the property.
    if found
        .findings
        .iter()
        .any(|finding| finding.kind == FindingKind::Assertion)
    {
        let titles = network.ltl.iter().map(|(title, _)| title.clone());
        found.incomplete.extend(titles);
        return Ok(found);
    }
    let liveness = Verifier::make(&promela, agents, true)?;
    for (number, (title, _)) in network.ltl.iter().enumerate() {
        let name = format!("property{number}");
        let verdict = liveness.verify(&["-a", "-f", "-N", &name])?;
        let kind = FindingKind::Ltl(title.clone());
        found.add(network, &promela, verdict, kind, title);
    }
    Ok(found)
}

impl SpinCheck {
    fn add(
        &mut self,
        network: &Network,
        promela: &Promela,
        verdict: Verdict,
        kind: FindingKind,
        title: &str,
    ) {
        match verdict {
            Verdict::Holds => {}
            Verdict::Incomplete => self.incomplete.push(title.to_owned()),
            Verdict::Fails { reason, trail } => {
                let trace = trail::words(network, promela, &trail);
                let there = vec![format!("SPIN: {reason}")];
                self.findings.push(Finding::new(kind, trace, there));
            }
        }
    }
}
