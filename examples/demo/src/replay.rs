//! `luna demo --record` and `--replay`: a run that is kept, and the same run again.

use crate::args;
use crate::failure::{Failure, unusable};
use crate::jiwy::executors;
use crate::print::print;
use luna::prelude::*;
use luna::replay::{RecordError, Recording};
use luna::report::RecordReport;
use luna::{Error, Policy};
use luna_command::place::Placement;
use luna_jiwy::joystick;
use luna_jiwy::{Settings, Start, hardware, network};
use serde::{Deserialize, Serialize};
use std::path::Path;

/// The settings in the replay log, which make the same network again.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
struct Kept {
    seconds: f64,
    rate: u32,
    calibrated: bool,
}

/// What was recorded: as a part of the demo's JSON object.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub(crate) struct Recorded {
    /// To which file.
    file: String,
    events: u64,
    /// What did not fit; a replay goes up to there.
    lost: u64,
    bytes: u64,
}

/// What `luna demo --replay FILE --json` prints.
#[derive(Debug, Clone, PartialEq, Serialize)]
struct Replayed {
    /// From which file.
    file: String,
    /// Whether all came again as it was recorded.
    same: bool,
    /// Whether the replay log is of the whole run.
    whole: bool,
    processes: usize,
    /// In the replay log.
    events: u64,
    /// Of these, how many are outputs of the model, which were compared.
    outputs: u64,
    /// The first difference.
    difference: Option<String>,
    /// How many events had come again before.
    after_events: Option<u64>,
}

/// Records the system, on request.
pub(super) fn record(system: &mut System, arguments: &args::Demo) {
    let Some(path) = &arguments.record else {
        return;
    };
    let kept = Kept {
        seconds: arguments.seconds,
        rate: arguments.rate,
        calibrated: arguments.calibrated,
    };
    // Numbers and a `bool` have a text.
    let note = serde_json::to_string(&kept).unwrap_or_default();
    system.record(path).record_note(note);
    if arguments.replace {
        system.replace_recordings();
    }
}

/// What was recorded.
pub(super) fn recorded(arguments: &args::Demo, report: Option<&RecordReport>) -> Option<Recorded> {
    let (path, report) = (arguments.record.as_ref()?, report?);
    Some(Recorded {
        file: path.display().to_string(),
        events: report.events,
        lost: report.lost,
        bytes: report.bytes,
    })
}

/// The same in words; nothing if nothing was.
pub(super) fn text(recorded: Option<&Recorded>) -> String {
    recorded.map_or_else(String::new, |recorded| {
        let Recorded {
            file,
            events,
            lost,
            bytes,
        } = recorded;
        format!("recorded {events} events, {lost} lost, in {bytes} bytes: {file}\n")
    })
}

/// Repeats the recorded run. Prints and returns whether its outputs were the same.
pub(super) fn replay(path: &Path, arguments: &args::Demo) -> Result<bool, Failure> {
    let unusable = |error| unusable(format_args!("--replay {}", path.display()), error);
    // A replay log that lost events is good up to there; a damaged one is not to be trusted.
    let recording = Recording::open(path).map_err(unusable)?;
    let kept: Kept =
        serde_json::from_str(recording.note()).map_err(|_| unusable(RecordError::NoRecording))?;
    let difference = match again(&recording, kept, arguments) {
        Ok(()) => None,
        Err(Failure::Luna(Error::Record(error))) => Some(error),
        Err(failure) => return Err(failure),
    };
    let replayed = Replayed {
        file: path.display().to_string(),
        same: difference.is_none(),
        whole: recording.is_whole(),
        processes: recording.processes().count(),
        events: recording.events(),
        outputs: recording.outputs(),
        after_events: match &difference {
            Some(RecordError::Diverged(divergence)) => Some(divergence.event),
            _ => None,
        },
        difference: difference.map(|error| error.to_string()),
    };
    print(arguments.place.json, &replayed, || [words(&replayed)])?;
    Ok(replayed.same)
}

fn again(recording: &Recording, kept: Kept, arguments: &args::Demo) -> Result<(), Failure> {
    let demo = args::Demo {
        seconds: kept.seconds,
        rate: kept.rate,
        calibrated: kept.calibrated,
        place: Placement {
            policy: Policy::Other,
            ..arguments.place.clone()
        },
        ..arguments.clone()
    };
    let settings = Settings {
        period: demo.period(),
        cycles: demo.cycles(),
        start: match demo.calibrated {
            true => Start::Calibrated,
            false => Start::Calibrate,
        },
        // What the joystick gave is in the replay log.
        joystick: joystick::Recording::built_in().play(),
    };
    let mut system = System::new("jiwy");
    system.replay(recording);
    let executors = executors(&mut system, &demo.place)?;
    let machine = hardware::simulated(&mut system, &executors.mechanism, settings.period)?;
    network::build(&executors, machine.registers, settings)?;
    drop(executors);
    system.run().map(drop).map_err(Failure::Luna)
}

fn words(replayed: &Replayed) -> String {
    let Replayed {
        file,
        processes,
        events,
        outputs,
        ..
    } = replayed;
    let part = match replayed.whole {
        true => "",
        false => " The replay log is not whole: events were lost, and the replay went up to there.",
    };
    match &replayed.difference {
        None => format!(
            "the outputs are the same: {processes} processes, {events} events, {outputs} of them outputs, came again as in {file}.{part}\n"
        ),
        Some(difference) => format!("the outputs are not the same: {difference}.{part}\n"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_kept_comes_back() {
        let kept = Kept {
            seconds: 0.3,
            rate: 1000,
            calibrated: true,
        };
        let note = serde_json::to_string(&kept).unwrap();
        assert_eq!(serde_json::from_str::<Kept>(&note).unwrap(), kept);
    }

    #[test]
    fn a_difference_is_told_with_its_event() {
        let mut replayed = Replayed {
            file: "run.replay".to_owned(),
            same: true,
            whole: false,
            processes: 51,
            events: 9,
            outputs: 4,
            difference: None,
            after_events: None,
        };
        assert!(words(&replayed).starts_with("the outputs are the same: 51 processes, 9 events"));
        assert!(words(&replayed).contains("not whole"));
        replayed.difference = Some("after 5 events".to_owned());
        assert!(words(&replayed).contains("not the same: after 5 events"));
    }
}
