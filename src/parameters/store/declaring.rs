//! What processes declare in their `pre_run`, and which process reads it.

use super::{Declared, Entry, Group, State, Store, note_outside};
use crate::parameters::cells::{Cells, Reader};
use crate::parameters::error::DeclareError;
use luna_core::current::ProcessId;
use luna_core::latest_slots::LatestSlots;
use std::cell::RefCell;
use std::sync::{Arc, OnceLock};

/// The most bytes of a name, a unit and a description, as of a signal.
const MAX_NAME: usize = 255;
const MAX_UNIT: usize = 63;
const MAX_DESCRIPTION: usize = 1023;

/// The process that runs its `pre_run`.
struct Declaring {
    store: Arc<Store>,
    process: u32,
    name: Arc<str>,
}

thread_local! {
    static DECLARING: RefCell<Option<Declaring>> = const { RefCell::new(None) };
}

impl Store {
    /// Calls `pre_run` of a process, which may declare parameters.
    pub(crate) fn declaring<R>(
        self: &Arc<Self>,
        process: ProcessId,
        name: &str,
        pre_run: impl FnOnce() -> R,
    ) -> R {
        /// Puts back the process that was declaring before: a `pre_run` may spawn.
        struct Restored(Option<Declaring>);
        impl Drop for Restored {
            fn drop(&mut self) {
                let ended = DECLARING.replace(self.0.take());
                if let Some(ended) = ended {
                    ended.store.seal(ended.process);
                }
            }
        }
        let declaring = Declaring {
            store: self.clone(),
            process: process.get(),
            name: Arc::from(name),
        };
        let _restored = Restored(DECLARING.replace(Some(declaring)));
        pre_run()
    }

    /// Whether a `pre_run` runs on this thread.
    #[cfg(not(feature = "logger"))]
    pub(in crate::parameters) fn is_declaring() -> bool {
        DECLARING.with_borrow(Option::is_some)
    }

    /// Declares a parameter of the process that runs its `pre_run` on this thread.
    pub(in crate::parameters) fn declare(declared: Declared) -> Result<Arc<Cells>, DeclareError> {
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
        let whose = DECLARING.with_borrow(|whose| {
            let whose = whose.as_ref()?;
            Some((whose.store.clone(), whose.process, whose.name.clone()))
        });
        let Some((store, process, name)) = whose else {
            return Err(DeclareError::NotInPreRun {
                parameter: parameter(),
            });
        };
        store.enter(declared, process, name)
    }

    fn enter(
        &self,
        declared: Declared,
        process: u32,
        process_name: Arc<str>,
    ) -> Result<Arc<Cells>, DeclareError> {
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
                let reader = Arc::new(Reader {
                    process,
                    name: process_name,
                    slots: LatestSlots::new(),
                    cells: OnceLock::new(),
                });
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
        // All that this process has declared is of one set. It does not run yet, and setters wait
        // for the lock.
        reader.slots.latch();
        let words = &entries[number].words;
        let new = Arc::new(Cells::new(reader.clone(), name, number, words));
        cells.push(new.clone());
        Ok(new)
    }

    /// The process' `pre_run` is over.
    fn seal(&self, process: u32) {
        let state = self.state();
        let group = state
            .groups
            .iter()
            .find(|group| group.reader.process == process);
        if let Some(Group { reader, cells, .. }) = group {
            let _ = reader.cells.set(cells.iter().map(Arc::downgrade).collect());
        }
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
    pub(crate) fn reader(&self, process: ProcessId) -> Option<Arc<Reader>> {
        let readers = self.readers.lock();
        let found = readers
            .iter()
            .find(|reader| reader.process == process.get());
        found.cloned()
    }
}

impl State {
    fn declare_first(&mut self, declared: Declared) -> usize {
        let mut words = declared.default.clone();
        let mut source = None;
        if let Some(given) = self.wishes.remove(&*declared.name) {
            match declared.form.pack(&given.value) {
                Ok(wished) => (words, source) = (wished, Some(given.source)),
                // All refusals are reported together.
                Err(reason) => self.refused.push(given.refused(&declared.unit, reason)),
            }
        }
        let number = self.entries.len();
        self.numbers.insert(declared.name.clone(), number);
        self.entries.push(Entry {
            declared,
            words,
            set: 0,
            source,
        });
        number
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
        let who_has = self.groups.iter().find(|group| {
            let is_it = |cells: &&Arc<Cells>| cells.entry == number && Arc::strong_count(cells) > 1;
            group.cells.iter().any(|cells| is_it(&cells))
        });
        match who_has {
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
