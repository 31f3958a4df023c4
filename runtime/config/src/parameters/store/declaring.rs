//! What is declared for processes that are to be spawned, and which process reads it.

use super::{Declared, Entry, Group, State, Store, note_outside};
use crate::parameters::cells::{Cells, Reader};
use crate::parameters::error::DeclareError;
use luna_core::current::ProcessId;
use std::sync::Arc;

/// The most bytes of a name, a unit and a description, as of a signal.
const MAX_NAME: usize = 255;
const MAX_UNIT: usize = 63;
const MAX_DESCRIPTION: usize = 1023;

impl Store {
    /// Declares a parameter of a process that does not run yet.
    pub(in crate::parameters) fn declare(
        &self,
        declared: Declared,
        process: ProcessId,
        process_name: &str,
    ) -> Result<Arc<Cells>, DeclareError> {
        let parameter = || declared.name.to_string();
        let texts = [
            ("name", declared.name.len(), MAX_NAME),
            ("unit", declared.unit.len(), MAX_UNIT),
            ("description", declared.description.len(), MAX_DESCRIPTION),
        ];
        for (what, length, most) in texts {
            if length > most {
                return Err(DeclareError::TooLong {
                    parameter: parameter(),
                    what,
                    most,
                });
            }
        }
        if !is_name(&declared.name) {
            return Err(DeclareError::Name {
                parameter: parameter(),
            });
        }
        let process = process.get();
        let mut state = self.state();
        self.sweep(&mut state);
        let name = declared.name.clone();
        let number = match state.numbers.get(&name).copied() {
            Some(number) => {
                state.declare_again(number, &declared)?;
                number
            }
            None => state.declare_first(declared),
        };
        let group = match state
            .groups
            .iter()
            .position(|group| group.reader.process == process)
        {
            Some(group) => group,
            None => {
                let reader = Reader::new(process, process_name);
                let taken = state.sets;
                state.groups.push(Group {
                    reader,
                    cells: Vec::new(),
                    taken,
                });
                self.list(&state.groups);
                state.groups.len() - 1
            }
        };
        let State {
            groups, entries, ..
        } = &mut *state;
        let Group { reader, cells, .. } = &mut groups[group];
        // All that this process has declared is of one set. Its owner does not run yet, and setters
        // wait for the lock.
        reader.take_offer();
        let words = &entries[number].words;
        let new = Arc::new(Cells::new(reader.clone(), name, number, words));
        cells.push(new.clone());
        Ok(new)
    }

    /// Lists the readers of these groups for loops that begin. The list is made and the former one
    /// freed outside of the lock, which loops wait for: under it two are exchanged.
    fn list(&self, groups: &[Group]) {
        let mut readers = groups.iter().map(|group| group.reader.clone()).collect();
        std::mem::swap(&mut *self.readers.lock(), &mut readers);
    }

    /// Frees what ended processes have left.
    fn sweep(&self, state: &mut State) {
        if state.groups.iter().all(Group::is_used) {
            return;
        }
        let (used, unused): (Vec<_>, Vec<_>) = std::mem::take(&mut state.groups)
            .into_iter()
            .partition(Group::is_used);
        state.groups = used;
        self.list(&state.groups);
        // A loop may have begun in between.
        let has_loop = |group: &Group| Arc::strong_count(&group.reader) > 1 + group.cells.len();
        let listed = state.groups.len();
        state.groups.extend(unused.into_iter().filter(has_loop));
        if state.groups.len() > listed {
            self.list(&state.groups);
        }
    }

    /// What a loop of `process` is to take, if that has parameters. O(processes that have). No
    /// allocation.
    pub fn reader(&self, process: ProcessId) -> Option<Arc<Reader>> {
        let readers = self.readers.lock();
        let found = readers
            .iter()
            .find(|reader| reader.process == process.get());
        found.cloned()
    }
}

impl State {
    fn declare_first(&mut self, declared: Declared) -> usize {
        let number = self.entries.len();
        self.numbers.insert(declared.name.clone(), number);
        self.entries.push(Entry {
            words: declared.default.clone(),
            declared,
            set: 0,
            source: None,
        });
        self.give_wish(number);
        number
    }

    /// Gives a parameter the value that the start found for it, if there is one.
    fn give_wish(&mut self, number: usize) {
        let entry = &mut self.entries[number];
        let Some(given) = self.wishes.remove(&*entry.declared.name) else {
            return;
        };
        match entry.declared.form.pack(&given.value) {
            Ok(words) => (entry.words, entry.source) = (words, Some(given.source)),
            // All refusals are reported together.
            Err(reason) => {
                let unit = &entry.declared.unit;
                self.refused.push(given.refused(unit, reason));
            }
        }
    }

    /// Gives all parameters that are declared already what the start found for them.
    pub(super) fn give_wishes(&mut self) {
        (0..self.entries.len()).for_each(|number| self.give_wish(number));
        for group in &self.groups {
            group.offer(&self.entries);
            // No process runs yet, so this thread is the owner.
            group.reader.take_offer();
        }
    }

    fn declare_again(&mut self, number: usize, declared: &Declared) -> Result<(), DeclareError> {
        let entry = &self.entries[number];
        let there = &entry.declared;
        let parameter = || declared.name.to_string();
        if there.form != declared.form
            || there.unit != declared.unit
            || there.default != declared.default
        {
            return Err(DeclareError::Differs {
                parameter: parameter(),
            });
        }
        match self.groups.iter().find(|group| group.has(number)) {
            Some(group) if !(there.is_shared && declared.is_shared) => {
                return Err(DeclareError::Duplicate {
                    parameter: parameter(),
                    process: group.reader.name.to_string(),
                });
            }
            Some(_) => {}
            // A new declaration of a free name defines it anew.
            None => {
                let there = &mut self.entries[number].declared;
                there.is_shared = declared.is_shared;
                there.description.clone_from(&declared.description);
            }
        }
        if self.entries[number].set > 0 {
            // Its first value would have to be recorded, and no process exists yet to record it.
            note_outside("a parameter that was set before its process was spawned");
        }
        Ok(())
    }
}

/// Whether a file and a command line can name it.
fn is_name(name: &str) -> bool {
    let is_odd = |letter: char| letter.is_control() || "=,[]\"'#".contains(letter);
    let has_ends = name.trim() == name && !name.starts_with('/') && !name.ends_with('/');
    !name.is_empty() && has_ends && !name.contains(is_odd) && !name.contains("//")
}
