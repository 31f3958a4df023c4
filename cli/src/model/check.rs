//! `luna model check`: whether a model does what it must not.

use super::found::{finding, found};
use super::{UNKNOWN, read, write};
use crate::failure::{Failure, failed};
use crate::progress::Progress;
use crate::text::Count;
use clap::Args;
use luna_model::{Exploration, Finding, FindingKind, Limit, Limits, Model, SpinCheck, TraceStep};
use serde_json::{Value, json};
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// The options of `luna model check`.
#[derive(Debug, Clone, Args)]
#[command(after_help = "\
What is found is shown with the shortest way to it. Branches that no run takes, and processes that may come to wait for ever while others go on, are shown, and are no error.

Keys of --json, which stay: schema, exit_code, model, processes, channels, states, is_complete, limit (null, states, memory), limit_bytes, findings (each kind, steps, trace, there, circle), unreached (each line, process, what), stuck (null, or processes, steps, trace, there), ltl (each property, holds: true, false, or null if it was not checked), spin (null, or findings, incomplete, error).

Exit codes: 0 nothing is wrong, 1 something is, 2 bad arguments or files, 4 unknown (nothing was found, but not all was looked at).")]
pub(crate) struct Arguments {
    /// The model (.toml)
    file: PathBuf,
    /// Look at so many states at most [default: what the model states, or 2 000 000]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    max_states: Option<u32>,
    /// Use so much memory for the states at most: bytes, or with K, M or G [default: half of what
    /// is free, of the machine, its control groups and limits]
    #[arg(long, value_name = "SIZE", value_parser = size)]
    max_memory: Option<u64>,
    /// Let SPIN check it too: deadlocks, assertions, and the LTL properties of the model; needs
    /// `spin` and a C compiler
    #[arg(long)]
    spin: bool,
    /// Draw the first of what is found, with the way to it, as a sequence of messages (SVG)
    #[arg(long, value_name = "FILE")]
    picture: Option<PathBuf>,
    /// Write the way to the deadlock, for the program that `luna model generate` makes: its option
    /// --replay FILE lets the real code go this way
    #[arg(long, value_name = "FILE")]
    replay: Option<PathBuf>,
    /// Write the model in Promela, the language of SPIN
    #[arg(long, value_name = "FILE")]
    promela: Option<PathBuf>,
    /// Write the model in CSPm, the input language of FDR, with what is checked here as assertions;
    /// comments name the properties that are left out
    #[arg(long, value_name = "FILE")]
    cspm: Option<PathBuf>,
    /// Print all of it as JSON, for scripts
    #[arg(long)]
    json: bool,
}

pub(super) fn run(arguments: &Arguments) -> Result<ExitCode, Failure> {
    let model = read(&arguments.file)?;
    if let Some(path) = &arguments.promela {
        write(path, &model.to_promela())?;
    }
    if let Some(path) = &arguments.cspm {
        write(path, &model.to_cspm().map_err(failed(&arguments.file))?)?;
    }
    let limit = arguments
        .max_states
        .map_or(model.max_states(), |n| n as usize);
    let mut limits = Limits::of_states(limit);
    if let Some(bytes) = arguments.max_memory {
        limits = limits.bytes(bytes);
    }
    let mut progress = Progress::new();
    let explored = model.explore_within(limits, |looked_at, known| {
        progress.show(|| format!("{looked_at} states looked at, {known} known"));
    });
    drop(progress);
    let mut out = io::stdout().lock();
    if !arguments.json {
        let shown = print(&mut out, &arguments.file, &model, &explored);
        shown.map_err(Failure::Output)?;
    }
    let mut first = explored.findings.first().cloned();
    let mut is_whole = explored.is_complete;
    let properties = model.ltl().count();
    let mut spin = None;
    if arguments.spin {
        let mut progress = Progress::new();
        progress.say("SPIN checks");
        let checked = model.check_with_spin();
        drop(progress);
        match checked {
            Ok(found) => {
                first = first.or_else(|| found.findings.first().cloned());
                is_whole &= found.incomplete.is_empty();
                if !arguments.json {
                    print_spin(&mut out, &model, &found).map_err(Failure::Output)?;
                }
                spin = Some(Ok(found));
            }
            Err(error) => {
                eprintln!("luna: SPIN: {error}");
                is_whole = false;
                spin = Some(Err(error.to_string()));
            }
        }
    } else if properties > 0 && !arguments.json {
        let note = "not checked: LTL properties; add --spin";
        writeln!(out, "{note} ({properties})").map_err(Failure::Output)?;
    }
    if let Some(path) = &arguments.replay {
        match explored.findings.iter().find_map(|one| one.replay.as_ref()) {
            Some(text) => write(path, text)?,
            None if arguments.json => {}
            None => {
                let path = path.display();
                let note = "not written: no deadlock was found, and nothing else can be replayed";
                writeln!(out, "{path}: {note}").map_err(Failure::Output)?;
            }
        }
    }
    if let (Some(path), Some(finding)) = (&arguments.picture, &first) {
        write(path, &finding.to_svg())?;
    }
    let code = match (first.is_some(), is_whole) {
        (true, _) => 1,
        (false, true) => 0,
        (false, false) => UNKNOWN,
    };
    if arguments.json {
        let text = as_json(&model, &explored, spin.as_ref(), code);
        writeln!(out, "{text:#}").map_err(Failure::Output)?;
    }
    Ok(ExitCode::from(code))
}

/// Rises when a key changes its meaning or goes.
const SCHEMA: u32 = 1;

fn as_json(
    model: &Model,
    explored: &Exploration,
    spin: Option<&Result<SpinCheck, String>>,
    code: u8,
) -> Value {
    let mut all = found(model, explored, usize::MAX);
    all["schema"] = SCHEMA.into();
    all["exit_code"] = code.into();
    let checked = spin.and_then(|spin| spin.as_ref().ok());
    let ltl = model.ltl().map(|title| {
        let holds = checked.and_then(|checked| holds(checked, title));
        json!({"property": title, "holds": holds})
    });
    all["ltl"] = ltl.collect();
    all["spin"] = match spin {
        None => Value::Null,
        Some(Err(error)) => json!({"findings": [], "incomplete": [], "error": error}),
        Some(Ok(checked)) => {
            let findings = checked.findings.iter().map(|one| finding(one, usize::MAX));
            json!({
                "findings": findings.collect::<Vec<_>>(),
                "incomplete": checked.incomplete,
                "error": null,
            })
        }
    };
    all
}

/// Whether a property holds, as SPIN says; none if it has not looked at all states.
fn holds(checked: &SpinCheck, title: &str) -> Option<bool> {
    let of_it = FindingKind::Ltl(title.to_owned());
    if checked.findings.iter().any(|finding| finding.kind == of_it) {
        return Some(false);
    }
    let is_open = checked.incomplete.iter().any(|open| open == title);
    (!is_open).then_some(true)
}

/// A number of bytes: `4096`, `512M`, `2G`.
fn size(text: &str) -> Result<u64, String> {
    let (number, shift) = match text.char_indices().last() {
        Some((end, 'K' | 'k')) => (&text[..end], 10),
        Some((end, 'M' | 'm')) => (&text[..end], 20),
        Some((end, 'G' | 'g')) => (&text[..end], 30),
        _ => (text, 0),
    };
    let number: u64 = number.parse().map_err(|_| "no size, such as 512M or 2G")?;
    let bytes = number.checked_mul(1 << shift);
    let bytes = bytes.filter(|bytes| *bytes > 0);
    bytes.ok_or_else(|| "a size is at least 1, and below 2^64 bytes".to_owned())
}

fn print(
    out: &mut impl Write,
    file: &Path,
    model: &Model,
    explored: &Exploration,
) -> io::Result<()> {
    let processes = Count(model.processes() as u64, "process");
    let channels = Count(model.channels() as u64, "channel");
    let states = explored.states;
    writeln!(out, "{}: {processes}, {channels}", model.name())?;
    match explored.limit {
        None => writeln!(out, "all {states} states were looked at")?,
        Some(Limit::Memory(bytes)) => writeln!(
            out,
            "{states} states were looked at, and there are more than {} MiB hold: raise --max-memory",
            bytes >> 20
        )?,
        Some(_) => writeln!(
            out,
            "{states} states were looked at, and there are more: raise --max-states"
        )?,
    }
    for finding in &explored.findings {
        print_finding(out, finding)?;
    }
    for branch in &explored.unreached {
        let (line, process, what) = (branch.line, &branch.process, &branch.what);
        let file = file.display();
        writeln!(out, "{file}:{line}: in {process} no run takes {what}")?;
    }
    if let Some(stuck) = &explored.stuck {
        let (steps, names) = (stuck.trace.len(), stuck.processes.join(", "));
        writeln!(out, "for ever without {names}, after {steps} steps:")?;
        print_way(out, &stuck.trace, &stuck.there)?;
    }
    if explored.findings.is_empty() {
        writeln!(
            out,
            "no deadlock, no livelock, no broken assertion was found"
        )?;
    }
    Ok(())
}

fn print_finding(out: &mut impl Write, finding: &Finding) -> io::Result<()> {
    let steps = finding.trace.len();
    writeln!(out, "{}, after {steps} steps:", finding.kind)?;
    print_way(out, &finding.trace, &finding.there)
}

fn print_way(out: &mut impl Write, trace: &[TraceStep], there: &[String]) -> io::Result<()> {
    for (number, line) in trace.iter().enumerate() {
        writeln!(out, "{:>5}  {line}", number + 1)?;
    }
    for line in there {
        writeln!(out, "       {line}")?;
    }
    Ok(())
}

fn print_spin(out: &mut impl Write, model: &Model, found: &SpinCheck) -> io::Result<()> {
    writeln!(out, "SPIN:")?;
    for finding in &found.findings {
        print_finding(out, finding)?;
    }
    for title in &found.incomplete {
        writeln!(out, "not all states were looked at: {title}")?;
    }
    for title in model.ltl() {
        if holds(found, title) == Some(true) {
            writeln!(out, "property {title} holds")?;
        }
    }
    if found.findings.is_empty() && found.incomplete.is_empty() {
        writeln!(out, "SPIN found nothing wrong")?;
    }
    Ok(())
}
