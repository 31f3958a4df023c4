//! All parameters of a system: what was declared, what was set, and which processes have taken it.
//! Its lock is for the set-up and for setters, never for the real-time path.

mod declaring;
mod setting;

use super::cells::{Cells, Reader};
use super::error::{Reason, Refusal, SetError, Source};
use super::form::Form;
use super::sources::{self, Given, merge};
use super::value::Value;
use super::watch::{FileValues, Stamp};
use crate::file::of_environment;
use crate::nearest::nearest;
use crate::parameters::handle::Info;
use luna_core::current;
use luna_platform::lock::PiLock;
use std::collections::{BTreeMap, HashMap};
use std::fmt;
use std::panic::{RefUnwindSafe, UnwindSafe};
use std::path::PathBuf;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// The parameters of a system.
pub struct Store {
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
    /// What the start found, until it is declared.
    wishes: BTreeMap<String, Given>,
    refused: Vec<Refusal>,
    entries: Vec<Entry>,
    numbers: HashMap<Arc<str>, usize>,
    groups: Vec<Group>,
    /// How many sets were taken since the start.
    sets: u64,
    is_replay: bool,
    /// While the system runs.
    notify: Option<Notify>,
}

/// Writes a message about a set, if messages are kept.
pub type Notify = Box<dyn Fn(fmt::Arguments<'_>) + Send>;

#[derive(Default, PartialEq, Eq)]
enum Phase {
    #[default]
    Described,
    Running,
    Ended,
}

/// What a parameter is declared as.
#[derive(Clone)]
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
    /// Whether its process has the parameter with this number.
    fn has(&self, entry: usize) -> bool {
        let mut cells = self.cells.iter();
        cells.any(|cells| cells.entry == entry && Arc::strong_count(cells) > 1)
    }

    /// Offers what the parameters have now. Returns whether the process had taken all before.
    fn offer(&self, entries: &[Entry]) -> bool {
        self.reader.offer(|| {
            for cells in &self.cells {
                cells.fill(&entries[cells.entry].words);
            }
        })
    }

    /// Whether what it reads is of this set, or a later one; it is of all sets if nothing is on
    /// offer.
    fn has_taken(&self, set: u64) -> bool {
        set <= self.taken || !self.reader.is_fresh()
    }

    /// Whether a handle of it is left, or a loop that takes it.
    fn is_used(&self) -> bool {
        // The handle's own, the list's, and one of each of its parameters.
        self.cells.iter().any(|cells| Arc::strong_count(cells) > 1)
            || Arc::strong_count(&self.reader) > 2 + self.cells.len()
    }
}

// Nothing of the user's runs under its locks, and what they guard is whole between two statements.
impl UnwindSafe for Store {}
impl RefUnwindSafe for Store {}

impl Store {
    /// Of the system of this name.
    pub fn new(system: &str) -> Arc<Self> {
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
    pub fn read_from(&self, file: PathBuf) {
        self.state().file = Some(file);
    }

    /// Gives values that come over those of the file.
    pub(super) fn give(&self, given: Given) {
        let mut state = self.state();
        // The last one counts; but two on one command line are a mistake.
        let is_argument = |given: &Given| given.source == Source::Argument;
        state.given.retain(|earlier| {
            earlier.name != given.name || is_argument(earlier) && is_argument(&given)
        });
        state.given.push(given);
    }

    /// The file, and the sources that override it.
    fn sources(&self) -> (Option<PathBuf>, Vec<Given>) {
        let state = self.state();
        let file = state.file.clone();
        let given = state.given.clone();
        (file.or_else(|| of_environment(sources::FILE)), given)
    }

    /// What the parameters of a system that starts are to be. Gives that, as a recording is to keep
    /// it: `recorded` in a replay, else what the `file` has, the environment and the program.
    ///
    /// # Errors
    ///
    /// [`SetError::Syntax`] of the environment.
    pub fn begin(
        &self,
        recorded: Option<&[(String, String)]>,
        file: Option<FileValues>,
        notify: Notify,
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
                let mut of_file = Vec::new();
                if let Some(file) = file {
                    (stamp, of_file) = (file.stamp, file.values);
                }
                let environment = sources::values_of_environment()?;
                merge([of_file, environment, self.sources().1], &mut refused)
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
        state.give_wishes();
        state.is_replay = recorded.is_some();
        state.notify = Some(notify);
        Ok(kept)
    }

    /// All processes of the start are spawned: every value must belong to a declared parameter, and
    /// be one that it can have.
    ///
    /// # Errors
    ///
    /// [`SetError::Refused`] with those that do not.
    pub fn all_declared(&self) -> Result<(), SetError> {
        let mut state = self.state();
        let mut refused = std::mem::take(&mut state.refused);
        let wishes = std::mem::take(&mut state.wishes);
        refused.extend(wishes.into_values().map(|given| state.unknown(&given)));
        if !refused.is_empty() {
            return Err(SetError::Refused(refused));
        }
        state.phase = Phase::Running;
        state.notify(|entry| {
            let default = &entry.declared.default;
            (entry.words != *default).then(|| default.clone())
        });
        Ok(())
    }

    /// The system has ended.
    pub fn end(&self) {
        let mut state = self.state();
        state.phase = Phase::Ended;
        state.notify = None;
    }

    /// Of the file, before the start has read it.
    pub(super) fn stamp(&self) -> Option<Stamp> {
        self.state().stamp
    }

    /// The file that is read, if there is one.
    pub fn file(&self) -> Option<PathBuf> {
        self.sources().0
    }
}

/// What a process that is recorded does here cannot be replayed.
fn note_outside(construct: &'static str) {
    current::replay_log(|log| log.outside(construct));
}

impl Store {
    pub(in crate::parameters) fn infos(&self) -> Vec<Info> {
        note_outside("Parameters::list");
        let state = self.state();
        let mut infos: Vec<Info> = state
            .entries
            .iter()
            .enumerate()
            .map(|(number, entry)| {
                let groups = || state.groups.iter().filter(move |group| group.has(number));
                let declared = &entry.declared;
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
                    value: declared.form.unpack(&entry.words),
                    set: entry.set,
                    processes: groups()
                        .map(|group| group.reader.name.to_string())
                        .collect(),
                    taken: groups().all(|group| group.has_taken(entry.set)),
                }
            })
            .collect();
        infos.sort_by(|one, other| one.name.cmp(&other.name));
        infos
    }
}

impl State {
    /// Refuses a value for a parameter that nobody has declared.
    fn unknown(&self, given: &Given) -> Refusal {
        let names = self.entries.iter().map(|entry| &*entry.declared.name);
        let nearest = nearest(&given.name, names).map(str::to_owned);
        given.refused("", Reason::Unknown { nearest })
    }

    /// Writes a message for each parameter that `changed` gives the former words of.
    pub(super) fn notify(&self, mut changed: impl FnMut(&Entry) -> Option<Box<[u64]>>) {
        let Some(notify) = &self.notify else {
            return;
        };
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
                notify(format_args!(
                    "set {}: {name} {before} -> {after}{space}{unit}{open}{from}{close}",
                    self.sets
                ));
            }
        }
    }
}

luna_platform::debug_fields!(Store, |store| system: store.system);
