//! What the deployment names: whether it is there, and where processes run.

use crate::file::{Composition, Content, Document, Executor};
use crate::language::body::Named;
use crate::network;
use crate::text::{Problem, Source, nearest};

pub(crate) fn check(source: Source<'_>, document: &Document) -> Result<(), Problem> {
    let known = |what: &str, name: &Named, names: &[&Named]| {
        if names.iter().any(|(known, _)| *known == name.0) {
            return Ok(());
        }
        let message = format!("there is no {what} of this name");
        let advice = nearest(&name.0, names.iter().map(|(name, _)| name.as_str()));
        Err(source.problem(name.1.clone(), message, advice))
    };
    let deployment = &document.deployment;
    let hosts: Vec<&Named> = deployment.hosts.iter().collect();
    let programs: Vec<&Named> = deployment.programs.iter().map(|(name, _)| name).collect();
    let executors: Vec<&Named> = deployment
        .executors
        .iter()
        .map(|found| &found.name)
        .collect();
    for host in deployment
        .programs
        .iter()
        .filter_map(|(_, host)| host.as_ref())
    {
        known("host", host, &hosts)?;
    }
    for program in deployment
        .executors
        .iter()
        .filter_map(|found| found.program.as_ref())
    {
        known("program", program, &programs)?;
    }
    let composed = document
        .definitions
        .iter()
        .filter_map(|found| match &found.content {
            Content::Composition(composition) => Some(composition),
            Content::Body(_) => None,
        });
    let system = document.system.iter().map(|(_, system)| system);
    let all: Vec<&Composition> = composed.chain(system).collect();
    for part in all.iter().flat_map(|composition| &composition.parts) {
        if let Some(on) = &part.run.on {
            known("executor", on, &executors)?;
        }
    }
    Ok(())
}

/// The executors and threads, with their hosts.
pub(crate) fn executors(document: &Document) -> Vec<network::Executor> {
    let deployment = &document.deployment;
    let host = |program: &str| {
        let known = deployment.programs.iter();
        let found = known
            .filter(|(name, _)| name.0 == program)
            .find_map(|(_, host)| host.as_ref());
        found.map(|(host, _)| host.clone())
    };
    let located = |executor: &Executor| network::Executor {
        name: executor.name.0.clone(),
        is_thread: executor.is_thread,
        host: executor
            .program
            .as_ref()
            .and_then(|(program, _)| host(program))
            .unwrap_or_default(),
        core: executor.core,
        policy: executor.policy.clone(),
    };
    deployment.executors.iter().map(located).collect()
}
