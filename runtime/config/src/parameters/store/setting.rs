//! Sets of values that take the place of others while the system runs.

use super::{Phase, State, Store, note_outside};
use crate::parameters::error::{Refusal, SetError, Source};
use crate::parameters::sources::{self, Given, merge};
use luna_core::current;
use std::collections::{BTreeMap, HashMap};

impl Store {
    /// Reads the file again: the values are what a start would make them.
    pub(in crate::parameters) fn reload(&self) -> Result<u64, SetError> {
        note_outside("Parameters::reload");
        self.reload_if(|| true)
    }

    /// As [`reload`](Self::reload), if the file is whole, which is asked when it has been read;
    /// else whatever was read is nothing. Returns the number of the last set, also if nothing was
    /// taken.
    pub(in crate::parameters) fn reload_if(
        &self,
        is_whole: impl FnOnce() -> bool,
    ) -> Result<u64, SetError> {
        let (file, given) = self.sources();
        let file = file.ok_or(SetError::NoFile)?;
        self.is_running(&self.state())?;
        let read = sources::read(&file);
        if !is_whole() {
            return Ok(self.state().sets);
        }
        let read = read?;
        let environment = sources::values_of_environment()?;
        let mut refused = Vec::new();
        let wishes = merge([read, environment, given], &mut refused);
        self.replace(wishes.into_values(), refused, true)
    }

    fn is_running(&self, state: &State) -> Result<(), SetError> {
        match state.phase {
            Phase::Running => Ok(()),
            Phase::Described | Phase::Ended => Err(SetError::NotRunning {
                system: self.system.clone(),
            }),
        }
    }

    /// Replaces the values of some parameters, all or none.
    pub(in crate::parameters) fn set(&self, given: Vec<Given>) -> Result<u64, SetError> {
        let mut refused = Vec::new();
        let given = merge([given], &mut refused);
        let set = self.replace(given.into_values(), refused, false)?;
        // Sets of other threads in between are not determined.
        Ok(luna_replay::input("set of parameters", || set))
    }

    fn replace(
        &self,
        given: impl IntoIterator<Item = Given>,
        mut refused: Vec<Refusal>,
        all: bool,
    ) -> Result<u64, SetError> {
        let mut guard = self.state();
        let state = &mut *guard;
        self.is_running(state)?;
        if state.is_replay && !current::has_replay_log() {
            return Err(SetError::Replayed);
        }
        let mut new: BTreeMap<usize, (Box<[u64]>, Option<Source>)> = BTreeMap::new();
        if all {
            let defaults = state.entries.iter().enumerate();
            new.extend(
                defaults.map(|(number, entry)| (number, (entry.declared.default.clone(), None))),
            );
        }
        for given in given {
            match state.check(&given) {
                Ok((number, words)) => drop(new.insert(number, (words, Some(given.source)))),
                Err(refusal) => refused.push(*refusal),
            }
        }
        if !refused.is_empty() {
            return Err(SetError::Refused(refused));
        }
        if new.is_empty() {
            return Ok(state.sets);
        }
        state.sets += 1;
        let set = state.sets;
        let mut former = HashMap::new();
        for (&number, (words, source)) in &mut new {
            let entry = &mut state.entries[number];
            entry.set = set;
            entry.source = source.take();
            if entry.words != *words {
                former.insert(
                    number,
                    std::mem::replace(&mut entry.words, std::mem::take(words)),
                );
            }
        }
        // Values of a process that has ended are not read.
        for group in state.groups.iter_mut().filter(|group| group.is_used()) {
            let mut cells = group.cells.iter();
            let changes = cells.any(|cells| former.contains_key(&cells.entry));
            if changes && group.offer(&state.entries) {
                group.taken = set - 1;
            }
        }
        state.notify(|entry| former.remove(state.numbers.get(&entry.declared.name)?));
        Ok(set)
    }

    /// Whether every process reads what the set of this number made of it.
    pub(in crate::parameters) fn is_taken(&self, set: u64) -> bool {
        note_outside("Parameters::is_taken");
        let state = self.state();
        set <= state.sets
            && state
                .groups
                .iter()
                .filter(|group| group.is_used())
                .all(|group| group.has_taken(set))
    }
}

impl State {
    /// The number of the parameter, and the words of its new value.
    fn check(&self, given: &Given) -> Result<(usize, Box<[u64]>), Box<Refusal>> {
        let Some(&number) = self.numbers.get(&*given.name) else {
            return Err(self.unknown(given).into());
        };
        let declared = &self.entries[number].declared;
        match declared.form.pack(&given.value) {
            Ok(words) => Ok((number, words)),
            Err(reason) => Err(given.refused(&declared.unit, reason).into()),
        }
    }
}
