//! `luna model trace`: whether what was recorded is what a model allows.

use super::names::Names;
use super::recording::Recording;
use super::{UNKNOWN, read};
use crate::failure::{Failure, failed};
use crate::progress::Progress;
use crate::text::Count;
use clap::Args;
use luna_model::{Communication, Rejected, TraceOptions, TraceVerdict, communication};
use std::collections::BTreeSet;
use std::io::{self, Write};
use std::path::PathBuf;
use std::process::ExitCode;

/// So many names or alternatives are printed at most.
const MAX_PRINTED: usize = 12;

/// The options of `luna model trace`.
#[derive(Debug, Clone, Args)]
#[command(after_help = "\
Channels and processes are found by their names: those of the model with their parts
(`cell.left[3]`), or what becomes of a name where all but letters and digits is `_`. Communications
of other channels are left out. Values are not recorded: any value will do.

Exit codes: 0 it is a trace, 1 it is none (the first communication that the model does not allow is
shown), 2 bad arguments or files, 4 unknown (events were lost, the recording is damaged, or a limit
was reached).")]
pub(crate) struct Arguments {
    /// The model (.toml)
    file: PathBuf,
    /// The recording (.luna), made with events
    recording: PathBuf,
    /// Channels of the model that are not recorded: their communications may happen at any time
    #[arg(long, value_name = "CHANNELS", value_delimiter = ',')]
    hide: Vec<String>,
    /// Communications that two threads have recorded within so many nanoseconds may have happened
    /// in either order [default: 1000; 0 on a virtual clock]
    #[arg(long, value_name = "NS")]
    skew: Option<u64>,
    /// Compare the ends, too: what ended by itself, before anything was cancelled or panicked, must
    /// be able to end in the model
    #[arg(long)]
    ends: bool,
    /// Follow so many states of the model at most
    #[arg(long, value_name = "N", default_value = "2000000", value_parser = clap::value_parser!(u32).range(1..))]
    max_states: u32,
}

/// The clocks of cores differ by less, and so does what a processor reads ahead of time.
pub(super) const SKEW: u64 = 1000;

pub(super) fn run(arguments: &Arguments) -> Result<ExitCode, Failure> {
    let model = read(&arguments.file)?;
    let recording = Recording::read(&arguments.recording)?;
    let names = Names::of(&model, &recording);
    let channels: Vec<&str> = model.channel_names().collect();
    let mut hidden = Vec::new();
    for name in &arguments.hide {
        let found = channels.iter().position(|channel| channel == name);
        hidden.push(found.ok_or_else(|| {
            let there = listed(&channels);
            let why = format!("--hide {name}: it has no such channel; there are {there}");
            failed(&arguments.file)(why)
        })?);
    }
    let (events, seen): (Vec<Communication>, Vec<usize>) = recording
        .communications
        .iter()
        .enumerate()
        .filter_map(|(place, seen)| Some((names.communication(seen, &hidden)?, place)))
        .unzip();
    let skew = match recording.is_virtual {
        true => arguments.skew.unwrap_or_default(),
        false => arguments.skew.unwrap_or(SKEW),
    };
    let options = TraceOptions {
        skew,
        // After a loss, what was lost may have come before the end.
        ended: match arguments.ends && recording.cut.is_none() {
            true => names.ended(&recording, skew),
            false => Vec::new(),
        },
        unrecorded: names.unrecorded.clone(),
        hidden,
        max_states: arguments.max_states as usize,
        ..TraceOptions::default()
    };
    let mut progress = Progress::new();
    let traced = model.trace_with(&events, &options, |accepted| {
        let all = events.len();
        progress.show(|| format!("{accepted} of {all} communications followed"));
    });
    drop(progress);
    let mut out = io::stdout().lock();
    let mut report = Report {
        out: &mut out,
        recording: &recording,
        events: &events,
        seen: &seen,
    };
    let code = report
        .names(&names, &channels, &options.hidden)
        .and_then(|()| report.verdict(traced.accepted, &traced.verdict, &names));
    code.map(ExitCode::from).map_err(Failure::Output)
}

/// The first names of many.
fn listed(names: &[&str]) -> String {
    let mut text = names[..names.len().min(MAX_PRINTED)].join(", ");
    if names.len() > MAX_PRINTED {
        text += &format!(" and {} more", names.len() - MAX_PRINTED);
    }
    text
}

struct Report<'a, W> {
    out: &'a mut W,
    recording: &'a Recording,
    events: &'a [Communication],
    /// The places of the events in the recording.
    seen: &'a [usize],
}

impl<W: Write> Report<'_, W> {
    /// What one of the two has alone.
    fn names(&mut self, names: &Names<'_>, channels: &[&str], hidden: &[usize]) -> io::Result<()> {
        let is_shown = |name: &&str| !hidden.iter().any(|&hidden| channels[hidden] == *name);
        let only_modelled = names.only_modelled[1].iter().copied();
        let unused: Vec<&str> = only_modelled.filter(is_shown).collect();
        let [processes, recorded] = &names.only_recorded;
        for (what, names, note) in [
            ("processes that the model does not have", processes, ""),
            (
                "processes that the recording does not have",
                &names.only_modelled[0],
                "",
            ),
            (
                "channels that the model does not have",
                recorded,
                " (left out)",
            ),
            (
                "channels that the recording does not have",
                &unused,
                " (never used, unless they are recorded by another name: see --hide)",
            ),
            (
                "names that several recorded processes have in the model",
                &names.shared[0],
                " (all of one name are compared as one process)",
            ),
            (
                "names that several recorded channels have in the model",
                &names.shared[1],
                " (all of one name are compared as one channel)",
            ),
        ] {
            if !names.is_empty() {
                writeln!(self.out, "{what}: {}{note}", listed(names))?;
            }
        }
        Ok(())
    }

    fn verdict(
        &mut self,
        accepted: usize,
        verdict: &TraceVerdict,
        names: &Names<'_>,
    ) -> io::Result<u8> {
        let recording = self.recording;
        let after = Count(accepted as u64, "communication");
        match verdict {
            TraceVerdict::Accepted if self.events.is_empty() => {
                writeln!(
                    self.out,
                    "unknown: no communication on a channel of the model was recorded"
                )?;
                self.cut()?;
                Ok(UNKNOWN)
            }
            TraceVerdict::Accepted => {
                let times = self.events.iter().map(|event| event.time);
                let [first, last] =
                    [times.clone().min(), times.max()].map(Option::unwrap_or_default);
                let channels: BTreeSet<usize> = self.events.iter().map(|one| one.channel).collect();
                let (what, code) = match recording.cut {
                    None => ("trace accepted", 0),
                    Some(_) => ("a trace as far as it goes", UNKNOWN),
                };
                writeln!(
                    self.out,
                    "{what}: {} of {}, from {} to {}",
                    Count(self.events.len() as u64, "communication"),
                    Count(channels.len() as u64, "channel"),
                    recording.seconds(first),
                    recording.seconds(last),
                )?;
                self.cut()?;
                Ok(code)
            }
            // Up to here, what was lost may explain it.
            TraceVerdict::Rejected(rejected) if self.seen[rejected.latest] >= recording.certain => {
                writeln!(
                    self.out,
                    "unknown after {after}, since something may be missing there"
                )?;
                self.cut()?;
                self.rejected(rejected)?;
                Ok(UNKNOWN)
            }
            TraceVerdict::Rejected(rejected) => {
                writeln!(self.out, "trace rejected after {after}")?;
                self.rejected(rejected)?;
                Ok(1)
            }
            TraceVerdict::Unended(processes) => {
                writeln!(self.out, "trace rejected after {after}, by the ends")?;
                let recorded = names.processes.iter();
                for (number, _) in recorded.filter(|(_, process)| processes.contains(process)) {
                    let name = recording.process(*number).unwrap_or_default();
                    let end = recording.ended.get(number).copied().unwrap_or_default();
                    let time = recording.seconds(end);
                    writeln!(
                        self.out,
                        "       {time}  {name} ended, and cannot in the model"
                    )?;
                }
                Ok(1)
            }
            TraceVerdict::Broken => {
                writeln!(
                    self.out,
                    "trace rejected: the model breaks a rule before its first communication; see \
                     `luna model check`"
                )?;
                Ok(1)
            }
            TraceVerdict::TooLarge => {
                writeln!(
                    self.out,
                    "unknown: after {after} the model may be in too many states, or the times leave \
                     too many orders open; raise --max-states, free memory, or model less that is not \
                     recorded"
                )?;
                Ok(UNKNOWN)
            }
        }
    }

    /// Why the recording is not used to its end.
    fn cut(&mut self) -> io::Result<()> {
        match &self.recording.cut {
            None => Ok(()),
            Some(cut) => writeln!(self.out, "the check stops there: {cut}"),
        }
    }

    fn rejected(&mut self, rejected: &Rejected) -> io::Result<()> {
        let event = self.line(rejected.event);
        let thread = self.recording.thread(self.events[rejected.event].thread);
        writeln!(
            self.out,
            "not allowed:\n{event} (recorded by the thread {thread})"
        )?;
        if !rejected.before.is_empty() {
            writeln!(self.out, "before it:")?;
        }
        for &event in &rejected.before {
            let line = self.line(event);
            writeln!(self.out, "{line}")?;
        }
        let count = rejected.allowed.len();
        match count {
            0 => writeln!(self.out, "no communication was allowed there")?,
            _ => writeln!(self.out, "allowed there:")?,
        }
        for line in rejected.allowed.iter().take(MAX_PRINTED) {
            writeln!(self.out, "       {line}")?;
        }
        if count > MAX_PRINTED {
            writeln!(self.out, "       and {} more", count - MAX_PRINTED)?;
        }
        if !rejected.there.is_empty() {
            writeln!(self.out, "in the model:")?;
        }
        for line in rejected.there.iter().take(MAX_PRINTED) {
            writeln!(self.out, "       {line}")?;
        }
        Ok(())
    }

    /// An event in the words of the recording.
    fn line(&self, event: usize) -> String {
        let seen = &self.recording.communications[self.seen[event]];
        let [sender, receiver] =
            [seen.sender, seen.receiver].map(|one| self.recording.process(one));
        let channel = self.recording.channel(seen.channel);
        let said = communication(&channel, sender.as_deref(), receiver.as_deref());
        format!("       {}  {said}", self.recording.seconds(seen.time))
    }
}
