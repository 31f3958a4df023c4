//! All parameters of a system: what was declared, what was set, and who has taken it. Its lock is for the set-up and for who sets, never for the path.

use super::cells::{Cells, Reader};
use super::error::{DeclareError, Reason, Refusal, SetError, Source};
use super::form::Form;
use super::handle::Info;
use super::nearest::nearest;
use super::sources::{self, Given, merge};
use super::value::Value;
use super::watch::{self, Stamp};
use crate::logging::{Level, Log, message};
use luna_platform::clock::Clock;
use luna_platform::current::{self, ProcessId};
use luna_platform::lock::PiLock;
use luna_platform::three_slots::ThreeSlots;
use std::cell::RefCell;
use std::collections::{BTreeMap, HashMap};
use std::path::PathBuf;
use std::sync::{Arc, Mutex, MutexGuard, OnceLock, PoisonError};

/// The most bytes of a name, a unit and a description, as of a signal.
const MOST_NAME: usize = 255;
const MOST_UNIT: usize = 63;
const MOST_DESCRIPTION: usize = 1023;

/// The parameters of a system.
pub(crate) struct Store {
    system: String,
    state: Mutex<State>,
    /// For loops that begin: by their processes.
    readers: PiLock<Vec<Arc<Reader>>>,
}

#[derive(Default)]
struct State {
    phase: Phase,
    /// As the program asks.
    file: Option<PathBuf>,
    given: Vec<Given>,
    /// Of the file, before the start has read it.
    stamp: Option<Stamp>,
    /// What the start found, until somebody declares it.
    wishes: BTreeMap<String, Given>,
    refused: Vec<Refusal>,
    entries: Vec<Entry>,
    numbers: HashMap<Arc<str>, usize>,
    groups: Vec<Group>,
    /// How many sets were taken since the start.
    sets: u64,
    is_replay: bool,
    log: Option<Log>,
    clock: Option<Clock>,
}

#[derive(Debug, Default, Clone, Copy, PartialEq, Eq)]
enum Phase {
    #[default]
    Described,
    Running,
    Ended,
}

/// What a parameter is declared as.
pub(super) struct Declared {
    pub(super) name: Arc<str>,
    pub(super) unit: String,
    pub(super) description: String,
    pub(super) form: Form,
    pub(super) default: Box<[u64]>,
    pub(super) is_shared: bool,
}

struct Entry {
    declared: Declared,
    words: Box<[u64]>,
    /// The set that it was last named in.
    set: u64,
    /// Where its value came from, unless it is the default.
    source: Option<Source>,
}

/// The parameters of one process.
struct Group {
    reader: Arc<Reader>,
    cells: Vec<Arc<Cells>>,
    /// All sets up to this one were taken, or did not concern it, when it was last offered another.
    taken: u64,
}

impl Group {
    /// Whether what it reads is of this set, or a later one; it is of all sets if nothing is on offer.
    fn has_taken(&self, set: u64) -> bool {
        set <= self.taken || !self.reader.slots.is_fresh()
    }

    /// Whether anybody has a handle of it, or a loop that takes it.
    fn is_used(&self) -> bool {
        // Its own, the list's, and one of each of its parameters.
        self.cells.iter().any(|cells| Arc::strong_count(cells) > 1)
            || Arc::strong_count(&self.reader) > 2 + self.cells.len()
    }
}

/// Whose `pre_run` runs.
struct Declaring {
    store: Arc<Store>,
    process: u32,
    name: Arc<str>,
}

thread_local! {
    static DECLARING: RefCell<Option<Declaring>> = const { RefCell::new(None) };
}

impl Store {
    pub(crate) fn new(system: &str) -> Arc<Self> {
        Arc::new(Self {
            system: system.to_owned(),
            state: Mutex::default(),
            readers: PiLock::new(Vec::new()),
        })
    }

    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Names the file to read at the start.
    pub(crate) fn read_from(&self, file: PathBuf) {
        self.state().file = Some(file);
    }

    /// Gives values that come over those of the file.
    pub(super) fn give(&self, given: Given) {
        let mut state = self.state();
        // The last word counts; but who writes two on one command line means one of them.
        let is_argument = |given: &Given| given.source == Source::Argument;
        state.given.retain(|earlier| {
            earlier.name != given.name || is_argument(earlier) && is_argument(&given)
        });
        state.given.push(given);
    }

    /// The file, and what comes over it.
    fn sources(&self) -> (Option<PathBuf>, Vec<Given>) {
        let state = self.state();
        let file = state.file.clone();
        let given = state.given.clone();
        (file.or_else(sources::file_of_environment), given)
    }

    /// Reads what the parameters of a system that starts are to be. Gives that, as a recording is to keep it; `recorded` takes its place in a replay.
    pub(crate) fn begin(
        &self,
        log: &Log,
        clock: &Clock,
        recorded: Option<&[(String, String)]>,
    ) -> Result<Vec<(String, String)>, SetError> {
        let mut refused = Vec::new();
        let mut stamp = None;
        let wishes = match recorded {
            Some(recorded) => {
                let given = recorded.iter().map(|(name, value)| Given {
                    name: name.clone(),
                    value: Value::Written(value.clone()),
                    source: Source::Recording,
                });
                merge([given.collect()], &mut refused)
            }
            None => {
                let (file, given) = self.sources();
                stamp = file.as_deref().and_then(watch::stamp);
                let file = file.as_deref().map(sources::read).transpose()?;
                let environment = sources::values_of_environment()?;
                merge([file.unwrap_or_default(), environment, given], &mut refused)
            }
        };
        let kept = wishes
            .iter()
            .map(|(name, given)| (name.clone(), given.value.to_string()));
        let kept = kept.collect();
        let mut state = self.state();
        state.stamp = stamp;
        state.wishes = wishes;
        state.refused = refused;
        state.is_replay = recorded.is_some();
        state.log = Some(log.clone());
        state.clock = Some(clock.clone());
        Ok(kept)
    }

    /// All `pre_run` are over: every value must have been somebody's, and one that it can have.
    pub(crate) fn all_declared(&self) -> Result<(), SetError> {
        let mut state = self.state();
        let mut refused = std::mem::take(&mut state.refused);
        let wishes = std::mem::take(&mut state.wishes);
        let names = || state.entries.iter().map(|entry| &*entry.declared.name);
        refused.extend(wishes.into_values().map(|given| {
            let nearest = nearest(&given.name, names()).map(str::to_owned);
            given.refused("", Reason::Unknown { nearest })
        }));
        if !refused.is_empty() {
            return Err(SetError::Refused(refused));
        }
        state.phase = Phase::Running;
        state.tell(|entry| {
            let default = &entry.declared.default;
            (entry.words != *default).then(|| default.clone())
        });
        Ok(())
    }

    /// The system has ended.
    pub(crate) fn end(&self) {
        let mut state = self.state();
        state.phase = Phase::Ended;
        state.log = None;
        state.clock = None;
    }

    /// Calls `pre_run` of a process, which may declare parameters.
    pub(crate) fn declaring<R>(
        self: &Arc<Self>,
        process: ProcessId,
        name: &str,
        pre_run: impl FnOnce() -> R,
    ) -> R {
        /// Puts back who was declaring before: a `pre_run` may spawn.
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

    /// Declares a parameter of the process whose `pre_run` runs on this thread.
    pub(super) fn declare(declared: Declared) -> Result<Arc<Cells>, DeclareError> {
        let parameter = || declared.name.to_string();
        let texts = [
            ("name", declared.name.len(), MOST_NAME),
            ("unit", declared.unit.len(), MOST_UNIT),
            ("description", declared.description.len(), MOST_DESCRIPTION),
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
                    slots: ThreeSlots::new(),
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
        // All that this process has declared is of one set. It does not run yet, and who sets waits for the lock.
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

    /// Lists the readers of these groups for loops that begin. The list is made and the former one freed outside of the lock, which loops wait for: under it two are exchanged.
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

    /// What a loop of `process` is to take, if that has parameters. O(processes that have). No allocation.
    pub(crate) fn reader(&self, process: ProcessId) -> Option<Arc<Reader>> {
        let readers = self.readers.lock();
        let found = readers
            .iter()
            .find(|reader| reader.process == process.get());
        found.cloned()
    }

    /// Reads the file again: the values are what a start would make them.
    pub(super) fn reload(&self) -> Result<u64, SetError> {
        note_outside("Parameters::reload");
        let (file, given) = self.readable()?;
        self.take_file(sources::read(&file)?, given)
    }

    /// As [`reload`](Self::reload), if the file is whole, which is asked when it has been read; else whatever was read is nothing.
    pub(super) fn reload_if(&self, is_whole: impl FnOnce() -> bool) -> Result<(), SetError> {
        let (file, given) = self.readable()?;
        let read = sources::read(&file);
        if is_whole() {
            self.take_file(read?, given)?;
        }
        Ok(())
    }

    /// The file that is to be read again, and what comes over it.
    fn readable(&self) -> Result<(PathBuf, Vec<Given>), SetError> {
        let (file, given) = self.sources();
        let file = file.ok_or(SetError::NoFile)?;
        self.is_running(&self.state())?;
        Ok((file, given))
    }

    fn take_file(&self, file: Vec<Given>, given: Vec<Given>) -> Result<u64, SetError> {
        let environment = sources::values_of_environment()?;
        let mut refused = Vec::new();
        let wishes = merge([file, environment, given], &mut refused);
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
    pub(super) fn set(&self, given: Vec<Given>) -> Result<u64, SetError> {
        let mut refused = Vec::new();
        let given = merge([given], &mut refused);
        let set = self.replace(given.into_values(), refused, false)?;
        // What others have set meanwhile cannot be foreseen.
        Ok(crate::record::input("set of parameters", || set))
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
        if state.is_replay && !current::is_taped() {
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
        // Nobody reads what a process that has ended leaves.
        for group in state.groups.iter_mut().filter(|group| group.is_used()) {
            let Group { reader, cells, .. } = &*group;
            if !cells.iter().any(|cells| former.contains_key(&cells.entry)) {
                continue;
            }
            let had_taken = reader.slots.publish(set + 1, |slot| {
                for cells in cells {
                    cells.fill(slot, &state.entries[cells.entry].words);
                }
            });
            if had_taken {
                group.taken = set - 1;
            }
        }
        state.tell(|entry| former.remove(state.numbers.get(&entry.declared.name)?));
        Ok(set)
    }

    pub(super) fn infos(&self) -> Vec<Info> {
        note_outside("Parameters::list");
        let state = self.state();
        let mut infos: Vec<Info> = state
            .entries
            .iter()
            .enumerate()
            .map(|(number, entry)| {
                let groups = || {
                    let has = move |group: &&Group| {
                        group
                            .cells
                            .iter()
                            .any(|cells| cells.entry == number && Arc::strong_count(cells) > 1)
                    };
                    state.groups.iter().filter(has)
                };
                let Entry {
                    declared,
                    words,
                    set,
                    ..
                } = entry;
                let (least, most) = declared.form.range.clone().unzip();
                Info {
                    name: declared.name.to_string(),
                    unit: declared.unit.clone(),
                    description: declared.description.clone(),
                    type_name: declared.form.type_name(),
                    choices: declared.form.choices(),
                    least,
                    most,
                    default: declared.form.unpack(&declared.default),
                    value: declared.form.unpack(words),
                    set: *set,
                    processes: groups()
                        .map(|group| group.reader.name.to_string())
                        .collect(),
                    taken: groups().all(|group| group.has_taken(*set)),
                }
            })
            .collect();
        infos.sort_by(|one, other| one.name.cmp(&other.name));
        infos
    }

    /// Whether everybody reads what the set of this number made of it.
    pub(super) fn is_taken(&self, set: u64) -> bool {
        note_outside("Parameters::is_taken");
        let state = self.state();
        set <= state.sets
            && state
                .groups
                .iter()
                .filter(|group| group.is_used())
                .all(|group| group.has_taken(set))
    }

    /// Of the file, before the start has read it.
    pub(super) fn stamp(&self) -> Option<Stamp> {
        self.state().stamp
    }

    /// The file that is read, if there is one.
    pub(crate) fn file(&self) -> Option<PathBuf> {
        self.sources().0
    }
}

impl State {
    /// The number of the parameter, and the words of its new value.
    fn check(&self, given: &Given) -> Result<(usize, Box<[u64]>), Box<Refusal>> {
        let Some(&number) = self.numbers.get(&*given.name) else {
            let names = self.entries.iter().map(|entry| &*entry.declared.name);
            let nearest = nearest(&given.name, names).map(str::to_owned);
            return Err(given.refused("", Reason::Unknown { nearest }).into());
        };
        let declared = &self.entries[number].declared;
        match declared.form.pack(&given.value) {
            Ok(words) => Ok((number, words)),
            Err(reason) => Err(given.refused(&declared.unit, reason).into()),
        }
    }

    fn declare_first(&mut self, declared: Declared) -> usize {
        let mut words = declared.default.clone();
        let mut source = None;
        if let Some(given) = self.wishes.remove(&*declared.name) {
            match declared.form.pack(&given.value) {
                Ok(wished) => (words, source) = (wished, Some(given.source)),
                // All that is wrong is told together.
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
            // Who declares it when nobody has it says anew what it is.
            None => {
                let there = &mut self.entries[number].declared;
                there.is_shared = declared.is_shared;
                there.description.clone_from(&declared.description);
            }
        }
        if self.entries[number].set > 0 {
            // Its first value would have to be recorded, and nobody is there yet who could.
            note_outside("a parameter that was set before its process was spawned");
        }
        Ok(())
    }

    /// Writes a message for each parameter that `changed` gives the former words of.
    fn tell(&self, mut changed: impl FnMut(&Entry) -> Option<Box<[u64]>>) {
        let (Some(log), Some(clock)) = (&self.log, &self.clock) else {
            return;
        };
        if !log.is_recording() {
            return;
        }
        let (_log, _clock) = (log.enter(), clock.enter());
        for entry in &self.entries {
            if let Some(former) = changed(entry) {
                let Declared {
                    name, unit, form, ..
                } = &entry.declared;
                let space = if unit.is_empty() { "" } else { " " };
                let (before, after) = (form.unpack(&former), form.unpack(&entry.words));
                let from = entry
                    .source
                    .as_ref()
                    .map_or_else(String::new, Source::to_string);
                let from = from.trim_end_matches([':', ' ']);
                let (open, close) = if from.is_empty() {
                    ("", "")
                } else {
                    (" (", ")")
                };
                message(
                    Level::Info,
                    "parameters",
                    format_args!(
                        "set {}: {name} {before} -> {after}{space}{unit}{open}{from}{close}",
                        self.sets
                    ),
                );
            }
        }
    }
}

/// What a process that is recorded does here cannot be replayed.
fn note_outside(construct: &'static str) {
    current::tape(|tape| tape.outside(construct));
}

/// Whether a file and a command line can name it.
fn is_name(name: &str) -> bool {
    let is_odd = |letter: char| letter.is_control() || "=,[]\"'#".contains(letter);
    let has_ends = name.trim() == name && !name.starts_with('/') && !name.ends_with('/');
    !name.is_empty() && has_ends && !name.contains(is_odd) && !name.contains("//")
}
