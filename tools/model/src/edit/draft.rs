//! The text while it is edited.

use super::apply::apply;
use super::view::View;
use super::{Edit, EditError, Thing};
use crate::file::read;
use crate::model::Model;
use crate::text::Problem;

/// So many steps can be undone.
const MOST: usize = 200;

/// A model file while it is edited: its values can be read, but it may be no whole model yet.
///
/// Not real-time.
#[derive(Debug)]
pub struct Draft {
    file: String,
    text: String,
    before: Vec<String>,
    after: Vec<String>,
}

impl Draft {
    /// A draft that begins with this text. `file` is its name in errors.
    ///
    /// # Errors
    ///
    /// A value that cannot be read, with its place in the file.
    pub fn new(file: &str, text: &str) -> Result<Self, Problem> {
        read(file, text)?;
        Ok(Self {
            file: file.to_owned(),
            text: text.to_owned(),
            before: Vec::new(),
            after: Vec::new(),
        })
    }

    /// What the file ought to be.
    #[must_use]
    pub fn text(&self) -> &str {
        &self.text
    }

    /// Does some edits as one step, or none of them.
    ///
    /// # Errors
    ///
    /// Why nothing was changed.
    pub fn apply(&mut self, edits: &[Edit]) -> Result<(), EditError> {
        let text = apply(&self.text, edits)?;
        if let Err(problem) = read(&self.file, &text) {
            return Err(EditError::Unreadable {
                thing: View::of(&text).thing_at(problem.line),
                problem: Box::new(problem),
            });
        }
        self.step_to(text);
        Ok(())
    }

    /// Takes a text that another program has written, as one step.
    ///
    /// # Errors
    ///
    /// A value that cannot be read; the draft has not changed then.
    pub fn replace(&mut self, text: &str) -> Result<(), Problem> {
        read(&self.file, text)?;
        self.step_to(text.to_owned());
        Ok(())
    }

    fn step_to(&mut self, text: String) {
        if text == self.text {
            return;
        }
        if self.before.len() == MOST {
            self.before.remove(0);
        }
        self.before.push(std::mem::replace(&mut self.text, text));
        self.after.clear();
    }

    /// Takes the last step back. Returns whether there was one.
    pub fn undo(&mut self) -> bool {
        let Some(text) = self.before.pop() else {
            return false;
        };
        self.after.push(std::mem::replace(&mut self.text, text));
        true
    }

    /// Does again what was undone last. Returns whether there was anything.
    pub fn redo(&mut self) -> bool {
        let Some(text) = self.after.pop() else {
            return false;
        };
        self.before.push(std::mem::replace(&mut self.text, text));
        true
    }

    /// Whether there are steps to undo, and to redo.
    #[must_use]
    pub fn steps(&self) -> (bool, bool) {
        (!self.before.is_empty(), !self.after.is_empty())
    }

    /// The model.
    ///
    /// # Errors
    ///
    /// What is missing first, with its place in the text; [`thing_at`](Self::thing_at) names the
    /// thing.
    pub fn model(&self) -> Result<Model, Problem> {
        Model::parse(&self.file, &self.text)
    }

    /// What there is to show.
    #[must_use]
    pub fn view(&self) -> View {
        View::of(&self.text)
    }

    /// What stands on a line, from 1.
    #[must_use]
    pub fn thing_at(&self, line: usize) -> Option<Thing> {
        self.view().thing_at(line)
    }
}
