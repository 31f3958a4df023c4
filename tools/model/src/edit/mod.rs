//! Changes of a model file, as an editor makes them.
//!
//! # Why the text is changed, and not the model
//!
//! People write model files, comment them and compare their versions. So an edit changes the text,
//! by `toml_edit`: what it does not mean stays as it is, to the byte. `tree` has the few changes of
//! tables that this takes, `apply` says what each edit does by them, and `view` is what an editor
//! shows: the file as it is written, with arrays and expressions as texts, not the network of it.
//!
//! # Why there is a draft
//!
//! A part whose ports are not bound yet is no model, and an editor cannot bind them before there is
//! a part. So a [`Draft`] may be such a text: all values in it can be read, but names may be missing,
//! ports unbound, channels without a sender. An edit after which a value cannot be read (a body with
//! a wrong word, a time without its unit) is refused, and changes nothing. [`Draft::model`] says
//! whether the draft is whole; only then it ought to be written to the file.
//!
//! ```
//! use luna_model::edit::{Draft, Edit, Kind, Thing, Value};
//!
//! let mut draft = Draft::new("first.toml", luna_model::TEMPLATE)?;
//! let producer = Thing { kind: Kind::Part, within: None, name: "producer".into() };
//! draft.apply(&[Edit::Set {
//!     thing: producer,
//!     key: "priority".into(),
//!     value: Some(Value::Number(7)),
//! }])?;
//! let line = "period = \"1 ms\"\n";
//! assert_eq!(draft.text(), luna_model::TEMPLATE.replace(line, &format!("{line}priority = 7\n")));
//! assert!(draft.undo() && draft.text() == luna_model::TEMPLATE);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod apply;
mod draft;
#[cfg(test)]
mod random;
#[cfg(test)]
mod tests;
mod tree;
mod view;

pub use draft::Draft;
pub use view::{Channel, Definition, Part, Scope, View};

use crate::text::Problem;
use serde::{Deserialize, Serialize};

/// What an edit is about.
#[derive(Debug, Clone, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Thing {
    /// Of what kind.
    pub kind: Kind,
    /// The process that a part or channel is in; none for the system.
    #[serde(default)]
    pub within: Option<String>,
    /// Its name.
    pub name: String,
}

/// Kinds of things.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Kind {
    /// `[process.NAME]`: what several parts may be.
    Process,
    /// `[system.part.NAME]`, or a part of a process that is made of parts.
    Part,
    /// `[system.channel]`, or a channel of a process that is made of parts.
    Channel,
}

/// A value in the file.
#[derive(Debug, Clone, PartialEq, Eq, Deserialize)]
#[serde(untagged)]
pub enum Value {
    /// A whole number.
    Number(i64),
    /// A text; one with several lines is written as such.
    Text(String),
    /// A place, in pixels.
    Place([i64; 2]),
}

/// A change.
#[derive(Debug, Clone, PartialEq, Eq, Deserialize)]
#[serde(tag = "do", rename_all = "snake_case", deny_unknown_fields)]
pub enum Edit {
    /// Adds a thing, behind the last one of its kind.
    Add {
        /// What is not there yet.
        thing: Thing,
        /// Its keys, as in [`Set`](Self::Set).
        #[serde(default)]
        keys: Vec<(String, Value)>,
    },
    /// Removes a thing with the comment directly above it. Ports that were bound to a channel are
    /// bound no more.
    Remove {
        /// What.
        thing: Thing,
    },
    /// Gives a thing another name, also where it is named: a process in parts, a channel in `bind`,
    /// a part of the system in the properties of `[check]`.
    Rename {
        /// What.
        thing: Thing,
        /// The name.
        to: String,
    },
    /// Sets a key of a thing, or removes it.
    Set {
        /// Of what.
        thing: Thing,
        /// `period`, or with a table `bind.left`, `ports.left`.
        key: String,
        /// Without a value the key is removed.
        value: Option<Value>,
    },
}

/// Why an edit was refused. It has changed nothing then.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum EditError {
    /// There is no such thing.
    #[error("there is no `{}` any more", .0.name)]
    NotThere(Thing),
    /// Two things cannot have one name.
    #[error("there is a `{0}` already; use another name")]
    Taken(String),
    /// The value stands where the file has something else.
    #[error("`{0}` cannot be changed here; change it in the file")]
    NoPlace(String),
    /// A value cannot be read afterwards.
    #[error("{problem}")]
    Unreadable {
        /// In the text that the edit would have made.
        problem: Box<Problem>,
        /// What it is in.
        thing: Option<Thing>,
    },
}
