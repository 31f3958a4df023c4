//! What of a recording is what of a model, by their names.

use super::recording::{Recording, Seen};
use luna_model::{Communication, Model, Party, name_in_model};
use std::collections::{BTreeMap, BTreeSet};

/// What of the recording is what of the model.
pub(super) struct Names<'a> {
    pub(super) channels: BTreeMap<u32, usize>,
    pub(super) processes: BTreeMap<u32, usize>,
    /// Processes of the model that the recording does not have.
    pub(super) unrecorded: Vec<usize>,
    /// Names that one of the two has alone.
    pub(super) only_recorded: [Vec<&'a str>; 2],
    pub(super) only_modelled: [Vec<&'a str>; 2],
    /// Names that several recorded processes, and channels, have or get in the model.
    pub(super) shared: [Vec<&'a str>; 2],
}

/// Names with their places.
pub(super) fn numbered<'a>(names: impl Iterator<Item = &'a str>) -> BTreeMap<&'a str, usize> {
    names.zip(0..).collect()
}

/// The name of a model that a recorded name is, and its place.
pub(super) fn find<'a>(known: &BTreeMap<&'a str, usize>, name: &str) -> Option<(&'a str, usize)> {
    let found = known.get_key_value(name);
    let found = found.or_else(|| known.get_key_value(&*name_in_model(name)));
    found.map(|(name, place)| (*name, *place))
}

impl<'a> Names<'a> {
    pub(super) fn of(model: &'a Model, recording: &'a Recording) -> Self {
        let channels = numbered(model.channel_names());
        let processes = numbered(model.process_names());
        let find = |known: &BTreeMap<&'a str, usize>, name: &str| {
            find(known, name).map(|(_, place)| place)
        };
        let mut names = Names {
            channels: BTreeMap::new(),
            processes: BTreeMap::new(),
            unrecorded: Vec::new(),
            only_recorded: [Vec::new(), Vec::new()],
            only_modelled: [Vec::new(), Vec::new()],
            shared: [Vec::new(), Vec::new()],
        };
        let all = recording.communications.iter();
        let used: BTreeSet<u32> = all.clone().map(|seen| seen.channel).collect();
        let active: BTreeSet<u32> = all.flat_map(|seen| [seen.sender, seen.receiver]).collect();
        // Whatever has not communicated may as well be missing in the model.
        let mut seen = BTreeSet::new();
        for (number, process) in &recording.processes {
            match find(&processes, &process.name) {
                Some(found) => {
                    names.processes.insert(*number, found);
                    if active.contains(number) && !seen.insert(found) {
                        names.shared[0].push(&process.name);
                    }
                }
                None if active.contains(number) => names.only_recorded[0].push(&process.name),
                None => {}
            }
        }
        let mut seen = BTreeSet::new();
        for (number, (name, _)) in &recording.channels {
            match (find(&channels, name), used.contains(number)) {
                (Some(found), is_used) => {
                    names.channels.insert(*number, found);
                    if is_used && !seen.insert(found) {
                        names.shared[1].push(name);
                    }
                }
                (None, true) => names.only_recorded[1].push(name),
                (None, false) => {}
            }
        }
        for names in names.only_recorded.iter_mut().chain(&mut names.shared) {
            names.sort_unstable();
            names.dedup();
        }
        let missing = |known: &BTreeMap<&'a str, usize>, found: &BTreeMap<u32, usize>| {
            let found: BTreeSet<usize> = found.values().copied().collect();
            let missing = known.iter().filter(|(_, number)| !found.contains(number));
            missing.map(|(name, number)| (*name, *number)).unzip()
        };
        (names.only_modelled[0], names.unrecorded) = missing(&processes, &names.processes);
        names.only_modelled[1] = missing(&channels, &names.channels).0;
        names
    }

    /// The processes of the model that have ended by themselves.
    pub(super) fn ended(&self, recording: &Recording, skew: u64) -> Vec<usize> {
        let limit = recording
            .stopped
            .map_or(u64::MAX, |stopped| stopped.saturating_sub(skew));
        let all = self.processes.iter();
        // Of several processes of one name all must have ended.
        let lives = |number: &u32| recording.ended.get(number).is_none_or(|end| *end >= limit);
        let alive: BTreeSet<usize> = all
            .clone()
            .filter(|(number, _)| lives(number))
            .map(|(_, process)| *process)
            .collect();
        let ended: BTreeSet<usize> = all.map(|(_, process)| *process).collect();
        ended.difference(&alive).copied().collect()
    }

    /// None for a channel that is not followed.
    pub(super) fn communication(&self, seen: &Seen, hidden: &[usize]) -> Option<Communication> {
        let channel = *self.channels.get(&seen.channel)?;
        let party = |process: u32| match (process, self.processes.get(&process)) {
            (0, _) => Party::None,
            (_, Some(found)) => Party::Process(*found),
            (_, None) => Party::Stranger,
        };
        (!hidden.contains(&channel)).then(|| Communication {
            thread: seen.thread,
            time: seen.time,
            channel,
            sender: party(seen.sender),
            receiver: party(seen.receiver),
        })
    }
}
