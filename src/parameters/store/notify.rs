//! Reports on parameters: the list of all of them, and a message for each change of a value.

use super::{Declared, Entry, Group, State, Store, note_outside};
use crate::log::{Level, message};
use crate::parameters::error::Source;
use crate::parameters::handle::Info;
use std::sync::Arc;

impl Store {
    pub(in crate::parameters) fn infos(&self) -> Vec<Info> {
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
}

impl State {
    /// Writes a message for each parameter that `changed` gives the former words of.
    pub(super) fn notify(&self, mut changed: impl FnMut(&Entry) -> Option<Box<[u64]>>) {
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
