//! A Rust package from a model.
//!
//! What the model decides is generated again and again, below `src/generated`: the ends that a
//! process of each kind has (`ports`), which processes and channels there are and where they run
//! (`system`), and the run itself (`support`, `replay`, `rest`). What a person writes is generated once, as a
//! skeleton that runs: the body of each kind of process, the types that the model only names, the
//! manifest and `main`. A skeleton takes its ports apart by their names, so a port that is new or
//! gone is an error of the compiler there.
//!
//! # Why plain text
//!
//! The files are written as text, line by line. `prettyplease` would drop the comments that tell
//! what to fill in, and its layout is not that of `rustfmt`, which the reader's editor applies.
//! Neither of them lays out the inside of `alt!`, which is no expression. The command gives the
//! text to `rustfmt` where that is installed, for long lines; the text is right without it.

mod alternative;
mod body;
mod branches;
mod expression;
mod kind;
mod lets;
mod liveness;
mod manifest;
mod names;
mod skeleton;
mod types;
mod waiting;
mod wiring;
mod writer;

pub use manifest::{Luna, is_luna, package_name};

use crate::model::Model;
use crate::text::Problem;
use kind::Kinds;

/// The first line of all that is written anew.
const HEAD: &str =
    "//! Written by `luna model generate`, each time anew: change the model instead.";

/// A file of a package.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct File {
    /// Below the package's folder, with `/`.
    pub path: String,
    /// What is in it.
    pub text: String,
    /// Whether it is written again and again. Else it is a person's as soon as it is there.
    pub is_generated: bool,
    /// The names that it is to define: a file that was written earlier may lack some.
    pub defines: Vec<String>,
}

impl File {
    /// Whether `text` was generated, so that it may be replaced.
    #[must_use]
    pub fn was_generated(text: &str) -> bool {
        text.starts_with(HEAD)
    }

    /// The names of [`defines`](Self::defines) that `text` does not have.
    pub fn missing_in<'f>(&'f self, text: &str) -> impl Iterator<Item = &'f str> {
        let is_word = |c: char| c.is_alphanumeric() || c == '_';
        let names = self.defines.iter().map(String::as_str);
        let missing: Vec<&str> = names
            .filter(|name| !text.split(|c| !is_word(c)).any(|word| word == *name))
            .collect();
        missing.into_iter()
    }

    fn generated(path: &str, text: String) -> Self {
        Self {
            path: path.to_owned(),
            text: format!("{HEAD}\n{text}"),
            is_generated: true,
            defines: Vec::new(),
        }
    }

    fn skeleton(path: String, text: String) -> Self {
        Self {
            path,
            text,
            is_generated: false,
            defines: Vec::new(),
        }
    }
}

pub(crate) fn generate(model: &Model, luna: &Luna) -> Result<Vec<File>, Problem> {
    types::check(model)?;
    let kinds = Kinds::new(model)?;
    let mut files = vec![
        File::generated("src/generated/mod.rs", wiring::root(&kinds)),
        File::generated("src/generated/ports.rs", wiring::ports(&kinds)),
        File::generated("src/generated/system.rs", wiring::system(model, &kinds)?),
        File::generated("src/generated/support.rs", SUPPORT.to_owned()),
        File::generated("src/generated/replay.rs", REPLAY.to_owned()),
        File::generated("src/generated/rest.rs", REST.to_owned()),
        File::generated("src/generated/pipes.rs", PIPES.to_owned()),
        File::generated("src/generated/script.rs", SCRIPT.to_owned()),
        File::skeleton("Cargo.toml".to_owned(), manifest::manifest(model, luna)),
        File::skeleton("src/main.rs".to_owned(), MAIN.to_owned()),
    ];
    for kind in &kinds.all {
        let path = format!("src/processes/{}.rs", kind.module);
        files.push(File::skeleton(path, skeleton::skeleton(model, kind)?));
    }
    if !kinds.types.is_empty() {
        let text = types::skeleton(&kinds.types);
        let mut file = File::skeleton("src/types.rs".to_owned(), text);
        file.defines.clone_from(&kinds.types);
        files.push(file);
    }
    Ok(files)
}

const SUPPORT: &str = include_str!("support.rs.txt");
const REPLAY: &str = include_str!("replay.rs.txt");
const REST: &str = include_str!("rest.rs.txt");
const PIPES: &str = include_str!("pipes.rs.txt");
const SCRIPT: &str = include_str!("script.rs.txt");
const MAIN: &str = include_str!("main.rs.txt");
