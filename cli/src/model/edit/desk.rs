//! What the page asks for, and what it gets.

use super::file::Kept;
use super::findings::Progress;
use super::{findings, page};
use crate::failure::Failure;
use luna_model::edit::{Draft, Edit, EditError, Thing};
use luna_model::{Model, Problem};
use luna_scope::Site;
use serde::Deserialize;
use serde_json::{Value, json};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard, PoisonError};

/// A message of the page.
#[derive(Debug, Deserialize)]
#[serde(tag = "type", rename_all = "lowercase")]
enum Request {
    /// Has anything changed since this version?
    Look {
        version: u64,
    },
    /// These edits are one step.
    Edit {
        edits: Vec<Edit>,
    },
    Undo,
    Redo,
    /// Looks at so many states at most, or as the model states.
    Check {
        max_states: Option<usize>,
    },
    /// How far has a check come?
    Progress,
    Times,
}

/// The file and its draft, for all pages that show it.
#[derive(Debug)]
pub(super) struct Desk {
    costs: Option<PathBuf>,
    progress: Progress,
    state: Mutex<State>,
}

#[derive(Debug)]
struct State {
    file: Kept,
    draft: Draft,
    /// Counts what the page is to show anew.
    version: u64,
    /// What another program did to the file.
    note: Option<String>,
    /// Why the file cannot be written as it is now on the disk.
    blocked: Option<String>,
}

/// Why nothing was changed, and at what.
struct Refused {
    error: String,
    line: Option<usize>,
    thing: Option<Thing>,
}

impl Desk {
    pub(super) fn open(path: &Path, costs: Option<PathBuf>) -> Result<Self, Failure> {
        let file = Kept::open(path)?;
        let draft = Draft::new(&file.name, file.content()).map_err(crate::model::problem)?;
        Ok(Self {
            costs,
            progress: Progress::default(),
            state: Mutex::new(State {
                file,
                draft,
                version: 1,
                note: None,
                blocked: None,
            }),
        })
    }

    fn state(&self) -> MutexGuard<'_, State> {
        // A step that panicked has changed nothing.
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// What the draft is worth, looked at without keeping others from it.
    fn of_model(&self, find: impl FnOnce(&Model) -> Value) -> Value {
        let model = self.state().draft.model();
        match model {
            Ok(model) => find(&model),
            Err(problem) => json!({"type": "failed", "error": problem.to_string()}),
        }
    }

    fn handle(&self, request: Request) -> Value {
        match request {
            Request::Check { max_states } => {
                self.of_model(|model| findings::check(model, max_states, &self.progress))
            }
            Request::Progress => self.progress.shown(),
            Request::Times => self.of_model(|model| findings::times(model, self.costs.as_deref())),
            Request::Look { version } => {
                let mut state = self.state();
                state.look();
                match state.version == version {
                    true => json!({"type": "same"}),
                    false => state.shown(None, self.costs.is_some()),
                }
            }
            step => {
                let mut state = self.state();
                let refused = state.step(step).err();
                state.shown(refused, self.costs.is_some())
            }
        }
    }
}

impl Site for Desk {
    fn file(&self, path: &str) -> Option<(&'static str, &'static [u8])> {
        page::file(path)
    }

    fn answer(&self, message: &str) -> String {
        let answer = match serde_json::from_str(message) {
            Ok(request) => self.handle(request),
            Err(error) => json!({"type": "failed", "error": error.to_string()}),
        };
        answer.to_string()
    }
}

impl State {
    /// Reads the file again if another program has written it.
    fn look(&mut self) {
        let name = &self.file.name;
        let blocked = match self.file.foreign() {
            Ok(None) => None,
            Ok(Some(text)) => match self.draft.replace(&text) {
                Ok(()) => {
                    self.note = Some(format!("{name} was changed by another program"));
                    self.file.know(text);
                    self.version += 1;
                    None
                }
                Err(problem) => Some(format!("another program has made it unreadable: {problem}")),
            },
            Err(error) => Some(format!("{name}: {error}")),
        };
        if blocked != self.blocked {
            self.blocked = blocked;
            self.version += 1;
        }
    }

    /// Does a step. A file that was changed meanwhile is read again instead.
    fn step(&mut self, step: Request) -> Result<(), Refused> {
        let before = self.version;
        self.look();
        if let Some(error) = &self.blocked {
            return Err(error.clone().into());
        }
        if self.version != before {
            let error =
                "the file was changed by another program, and read again: look, and try again";
            return Err(error.to_owned().into());
        }
        self.note = None;
        match step {
            Request::Edit { edits } => self.draft.apply(&edits)?,
            Request::Undo => drop(self.draft.undo()),
            Request::Redo => drop(self.draft.redo()),
            Request::Look { .. } | Request::Check { .. } | Request::Progress | Request::Times => {}
        }
        self.version += 1;
        let text = self.draft.text();
        if self.draft.model().is_ok() && text != self.file.content() {
            let failed = |error| Refused::from(format!("it was not written: {error}"));
            self.file.write(text).map_err(failed)?;
        }
        Ok(())
    }

    fn shown(&self, refused: Option<Refused>, has_costs: bool) -> Value {
        let model = self.draft.model();
        let max_states = model.as_ref().ok().map(Model::max_states);
        let problem = model.err();
        let (undo, redo) = self.draft.steps();
        json!({
            "type": "view",
            "version": self.version,
            "file": self.file.name,
            "view": self.draft.view(),
            "is_saved": self.draft.text() == self.file.content(),
            "problem": problem.map(|problem| self.problem(&problem)),
            "refused": refused.map(|refused| json!({
                "error": refused.error,
                "line": refused.line,
                "thing": refused.thing,
            })),
            "undo": undo,
            "redo": redo,
            "note": self.blocked.as_ref().or(self.note.as_ref()),
            "has_costs": has_costs,
            "max_states": max_states,
        })
    }

    fn problem(&self, problem: &Problem) -> Value {
        json!({
            "error": said(problem),
            "line": problem.line,
            "thing": self.draft.thing_at(problem.line),
        })
    }
}

/// Without the file's name, which the page shows anyway.
fn said(problem: &Problem) -> String {
    let Problem {
        line,
        column,
        value,
        message,
        advice,
        ..
    } = problem;
    format!("line {line}, column {column}: {message}: `{value}`; {advice}")
}

impl From<EditError> for Refused {
    fn from(error: EditError) -> Self {
        match error {
            EditError::Unreadable { problem, thing } => Self {
                error: said(&problem),
                line: Some(problem.line),
                thing,
            },
            other => other.to_string().into(),
        }
    }
}

impl From<String> for Refused {
    fn from(error: String) -> Self {
        Self {
            error,
            line: None,
            thing: None,
        }
    }
}

#[cfg(test)]
mod tests;
