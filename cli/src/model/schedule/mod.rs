//! `luna model schedule`: when each cycle is over at the latest.
//!
//! `measured` takes execution times from a recording, `shown` is what is printed.

mod measured;
mod shown;

use super::{UNKNOWN, read};
use crate::failure::{Failure, failed};
use crate::print::print;
use clap::Args;
use luna_model::Model;
use luna_model::schedule::{Costs, Schedule, Verdict};
use measured::Missing;
use shown::Shown;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// The options of `luna model schedule`.
#[derive(Debug, Clone, Args)]
#[command(after_help = "\
A part needs an executor with a core and a policy as `fifo:80`, a period, and a cost; docs/model-and-program.md has the keys and what is assumed.
A file of costs has a table for each part: [servo] with cost = \"120 us\" and longest_poll = \"40 us\".
A recording needs events (`Logging::events`, or LUNA_LOG_EVENTS); processes are found there by their names. Of a figure that both
have, the larger one counts.

Exit codes: 0 all bounds are within their deadlines, 1 one is not or does not exist, 2 bad arguments or files, 4 unknown (some parts
could not be analysed, or the recording lacks something or has what the model does not; nothing else is wrong).

JSON: model, latency_ns, parts (name, executor, host, core, policy, priority, period_ns, is_seen, cost_ns, longest_poll_ns, bound_ns,
measured_ns, deadline_ns, slack_ns, may_wait, verdict, advice), cores (host, core, utilization, is_more), not_counted, strangers,
lost_events, is_damaged.")]
pub(crate) struct Arguments {
    /// The model (.toml)
    file: PathBuf,
    /// Execution times: a recording (.luna) with events, or a file of costs (.toml)
    #[arg(long, value_name = "FILE")]
    costs: Option<PathBuf>,
    /// Print one JSON object and nothing else
    #[arg(long)]
    json: bool,
}

pub(super) fn run(arguments: &Arguments) -> Result<ExitCode, Failure> {
    let model = read(&arguments.file)?;
    let (costs, missing) = costs(&model, arguments.costs.as_deref())?;
    let schedule = model.schedule(&costs);
    let shown = Shown::of(&model, &schedule, &missing);
    print(arguments.json, &shown, || [shown.text()])?;
    Ok(exit_code(&schedule, &shown))
}

/// The costs of a file, and how many events it has lost.
fn costs(model: &Model, path: Option<&Path>) -> Result<(Costs, Missing), Failure> {
    let Some(path) = path else {
        return Ok((Costs::new(), Missing::default()));
    };
    let is_stated = path.extension().is_some_and(|found| found == "toml");
    match is_stated {
        true => Ok((stated(model, path)?, Missing::default())),
        false => measured::read(path, model),
    }
}

/// What `--json` prints.
pub(super) fn table(model: &Model, costs_of: Option<&Path>) -> Result<serde_json::Value, Failure> {
    let (costs, missing) = costs(model, costs_of)?;
    let schedule = model.schedule(&costs);
    Ok(serde_json::json!(Shown::of(model, &schedule, &missing)))
}

fn stated(model: &Model, path: &Path) -> Result<Costs, Failure> {
    let text = fs::read_to_string(path).map_err(failed(path))?;
    let costs = model.parse_costs(&path.display().to_string(), &text);
    costs.map_err(super::problem)
}

fn exit_code(schedule: &Schedule, shown: &Shown<'_>) -> ExitCode {
    let rows = &schedule.rows;
    if rows.iter().any(|row| row.verdict.is_bad()) {
        return ExitCode::from(1);
    }
    let is_open = rows.iter().any(|row| row.verdict == Verdict::Unknown);
    match is_open || shown.is_incomplete() {
        true => ExitCode::from(UNKNOWN),
        false => ExitCode::SUCCESS,
    }
}
