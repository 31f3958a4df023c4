//! `luna model from`: a model of what ran.

use super::recording::{Recording, Seen, Slots};
use super::trace::SKEW;
use super::write_new;
use crate::failure::{Failure, failed};
use crate::print::say;
use clap::Args;
use luna_model::{Recorded, RecordedChannel, RecordedExecutor, RecordedProcess};
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::Duration;

/// The options of `luna model from`.
#[derive(Debug, Clone, Args)]
#[command(after_help = "\
The model has the processes and channels that communicated, with what uses what, buffers, priorities,
periods and executors. A process takes its communications in any order: write down what it really
does, and `luna model trace` says whether that is what ran.

Exit codes: 0 written, 1 standard output is closed, 2 bad arguments or files, or the
model is there already.")]
pub(crate) struct Arguments {
    /// The recording (.luna), made with events
    recording: PathBuf,
    /// The file to write (.toml); it must not be there yet; - is the standard output [default:
    /// beside the recording]
    #[arg(long, short, value_name = "FILE")]
    output: Option<PathBuf>,
}

/// A buffer of a model holds no more values than this.
const MOST: usize = 255;

pub(super) fn run(arguments: &Arguments) -> Result<ExitCode, Failure> {
    let path = &arguments.recording;
    let recording = Recording::read(path)?;
    let name = path.file_name().unwrap_or(path.as_os_str());
    let recorded = recorded(&recording);
    let same = recorded.same_names();
    if !same.is_empty() {
        return Err(failed(path)(format!(
            "several channels are called `{}`, and a model of them as one would be false: name each \
             apart (`.named(..)` where it is made), and record again",
            same.join("`, `")
        )));
    }
    let text = recorded.to_model(&name.to_string_lossy());
    if let Some(cut) = &recording.cut {
        eprintln!(
            "luna: {}: {cut}: the model is of what came before",
            path.display()
        );
    }
    let beside = path.with_extension("toml");
    let output = arguments.output.as_ref().unwrap_or(&beside);
    if output == Path::new("-") {
        say(&text)?;
        return Ok(ExitCode::SUCCESS);
    }
    write_new(output, &text)?;
    say(&format!(
        "{0}: check it against recordings with `luna model trace {0} {1}`\n",
        output.display(),
        path.display()
    ))?;
    Ok(ExitCode::SUCCESS)
}

fn recorded(recording: &Recording) -> Recorded {
    let numbers: Vec<u32> = processes(recording).into_iter().collect();
    let processes = numbers.iter().map(|&number| RecordedProcess {
        name: recording.process(number).unwrap_or_default(),
        priority: runs_on(recording, number).map(|(_, level)| level),
        period: {
            let mut loops = recording.loops.values().filter(|one| one.process == number);
            // One that has several has no period of its own.
            period(loops.next().filter(|_| loops.next().is_none()))
        },
        executor: runs_on(recording, number).map(|(executor, _)| recording.thread(executor)),
    });
    let places: BTreeMap<u32, usize> = numbers.iter().copied().zip(0..).collect();
    let mut channels: BTreeMap<u32, Vec<Seen>> = BTreeMap::new();
    for seen in &recording.communications {
        channels.entry(seen.channel).or_default().push(*seen);
    }
    let skew = if recording.is_virtual { 0 } else { SKEW };
    Recorded {
        system: recording.system.clone(),
        processes: processes.collect(),
        channels: channels
            .into_iter()
            .map(|(number, seen)| {
                let stated = recording
                    .channels
                    .get(&number)
                    .and_then(|(_, of)| stated(*of));
                let seen = channel(recording.channel(number), seen, &places, skew);
                RecordedChannel {
                    buffer: stated,
                    ..seen
                }
            })
            .collect(),
        executors: recording
            .threads
            .iter()
            .map(|(number, name)| {
                let cores = recording.cores.get(number).into_iter().flatten();
                let mut cores = cores.copied();
                // One that ran on several is bound to none.
                let core = cores.next().filter(|_| cores.next().is_none());
                RecordedExecutor {
                    name: name.clone(),
                    core,
                    ..Default::default()
                }
            })
            .collect(),
    }
}

fn runs_on(recording: &Recording, process: u32) -> Option<(u32, u8)> {
    recording
        .processes
        .get(&process)
        .and_then(|one| one.runs_on)
}

/// Those of the system, and those of other systems that communicated with them.
fn processes(recording: &Recording) -> BTreeSet<u32> {
    let named = recording.processes.iter();
    let own = named.filter(|(_, one)| one.runs_on.is_some());
    let mut numbers: BTreeSet<u32> = own.map(|(number, _)| *number).collect();
    for seen in &recording.communications {
        numbers.extend([seen.sender, seen.receiver]);
    }
    numbers.remove(&0);
    numbers
}

/// The time between two slots.
fn period(slots: Option<&Slots>) -> Option<Duration> {
    let [first, last] = slots?.ends?;
    let cycles = last.0.checked_sub(first.0).filter(|cycles| *cycles > 0)?;
    let nanos = last.1.saturating_sub(first.1) / cycles;
    // Time stamps are not exact, and periods mostly round.
    let unit = match nanos {
        100_000.. => 1000,
        10_000.. => 100,
        _ => 1,
    };
    // A damaged recording may state any times.
    Some(Duration::from_nanos(
        nanos.saturating_add(unit / 2) / unit * unit,
    ))
}

/// What a buffer is, as a model says it, by what the record of its channel's name has of it.
fn stated(of: u32) -> Option<String> {
    let (capacity, policy) = (of / 4, of % 4);
    if policy == 0 {
        return None; // it is not known
    }
    // A model's buffer has 255 values at most; a larger one is judged by what it held.
    if capacity as usize > MOST {
        return None;
    }
    Some(match (capacity, policy) {
        (0, _) => String::new(),
        (_, 1) => format!("fifo {capacity}"),
        (_, 2) => format!("overwrite_oldest {capacity}"),
        _ => format!("overwrite_newest {capacity}"),
    })
}

fn channel(
    name: String,
    mut seen: Vec<Seen>,
    places: &BTreeMap<u32, usize>,
    skew: u64,
) -> RecordedChannel {
    let is_sent = |one: &Seen| one.sender != 0 && one.receiver == 0;
    let is_received = |one: &Seen| one.sender == 0;
    let has = |what: &dyn Fn(&Seen) -> bool| seen.iter().any(what);
    // Else what is not known is outside of the system.
    let is_buffer = has(&is_sent) && has(&is_received);
    let user = |process: u32| places.get(&process).copied();
    let mut senders: BTreeSet<Option<usize>> = BTreeSet::new();
    let mut receivers: BTreeSet<Option<usize>> = BTreeSet::new();
    for one in &seen {
        if !(is_buffer && is_received(one)) {
            senders.insert(user(one.sender));
        }
        if !(is_buffer && is_sent(one)) {
            receivers.insert(user(one.receiver));
        }
    }
    let (mut held, mut least) = (0, 0);
    if is_buffer {
        // Of one thread the order is known. Of several, what was received at nearly the same time
        // was there before.
        let is_of_one = seen.iter().all(|one| one.thread == seen[0].thread);
        if !is_of_one {
            seen.sort_by_key(|one| match is_received(one) {
                true => (one.time.saturating_add(skew), 1),
                false => (one.time, 0),
            });
        }
        let filled = fill(&seen, usize::MAX);
        if filled.is_none() {
            // More was received than was sent by processes that are recorded.
            senders.insert(None);
        }
        let mut sizes = (0..8).map(|power| 1 << power).chain([MOST]);
        let enough = |size: &usize| fill(&seen, *size).is_some();
        held = filled.unwrap_or(MOST).max(1);
        least = sizes.find(enough).unwrap_or(MOST);
    }
    RecordedChannel {
        name,
        buffer: None,
        held,
        least,
        senders,
        receivers,
    }
}

/// How many values a buffer held at most that overwrites when it holds `size`; none if it was empty
/// when something was received from it.
fn fill(seen: &[Seen], size: usize) -> Option<usize> {
    let (mut now, mut most) = (0_usize, 0);
    for one in seen {
        if one.sender != 0 {
            now = (now + 1).min(size);
            most = most.max(now);
        }
        if one.receiver != 0 {
            now = now.checked_sub(1)?;
        }
    }
    Some(most)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn slots_may_be_at_any_times() {
        let of = |ends| period(Some(&Slots { process: 1, ends }));
        assert_eq!(
            of(Some([(1, 10), (3, 2_000_300)])),
            Some(Duration::from_millis(1))
        );
        let most = of(Some([(0, 0), (1, u64::MAX)]));
        assert_eq!(most, Some(Duration::from_nanos(u64::MAX / 1000 * 1000)));
        assert_eq!(of(Some([(2, 5), (2, 9)])), None);
    }

    #[test]
    fn what_the_main_thread_receives_makes_no_buffer() {
        let seen = |sender, receiver| Seen {
            thread: 0,
            time: 0,
            channel: 1,
            sender,
            receiver,
        };
        let places = BTreeMap::from([(1, 0), (2, 1)]);
        let of = |seen| channel("c".to_owned(), seen, &places, 0);
        let met = of(vec![seen(1, 2), seen(1, 0)]);
        assert_eq!(met.held, 0);
        assert_eq!(met.receivers, BTreeSet::from([None, Some(1)]));
        let buffer = of(vec![seen(1, 0), seen(0, 2)]);
        assert_eq!(
            (buffer.held, buffer.receivers),
            (1, BTreeSet::from([Some(1)]))
        );
    }
}
