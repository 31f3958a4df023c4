//! The recorded figures: `recorded.txt`, which the gate compares with.

use std::collections::BTreeMap;
use std::fmt::Write;
use std::path::PathBuf;
use std::{fs, io};

/// What one operation executes, as recorded.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Figures {
    /// Instructions.
    pub(crate) instructions: f64,
    /// Atomic ones among them.
    pub(crate) atomics: f64,
}

/// All that is recorded.
#[derive(Debug, Default, PartialEq)]
pub(crate) struct Recorded {
    /// The compiler that the figures hold for.
    pub(crate) compiler: String,
    /// The C library that they hold for, where it has a share in them.
    pub(crate) c_library: String,
    /// By the operations' names.
    pub(crate) figures: BTreeMap<String, Figures>,
}

const HEAD: &str = "\
# What LUNA's hot operations execute. Written by `cargo run -p luna-instructions -- record`;
# docs/internals/instruction-counts.md says what is counted, and when these figures may change.
";

/// Where it is, in the sources that this program was built from.
pub(crate) fn path() -> PathBuf {
    PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/recorded.txt"))
}

impl Recorded {
    /// Reads the file; without a file nothing is recorded.
    ///
    /// # Errors
    ///
    /// The file cannot be read, or has a malformed line.
    pub(crate) fn load() -> Result<Recorded, String> {
        let text = match fs::read_to_string(path()) {
            Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(Self::default()),
            read => read.map_err(|error| format!("{}: {error}", path().display()))?,
        };
        Self::parse(&text)
    }

    fn parse(text: &str) -> Result<Recorded, String> {
        let mut recorded = Recorded::default();
        for line in text.lines() {
            if line.starts_with('#') || line.trim().is_empty() {
                continue;
            }
            if let Some(compiler) = line.strip_prefix("compiler: ") {
                recorded.compiler = compiler.to_owned();
                continue;
            }
            if let Some(c_library) = line.strip_prefix("c library: ") {
                recorded.c_library = c_library.to_owned();
                continue;
            }
            let (name, figures) = figures(line).ok_or_else(|| format!("not a figure: {line}"))?;
            recorded.figures.insert(name, figures);
        }
        Ok(recorded)
    }

    /// Writes the file, with the operations in the order of `names`.
    ///
    /// # Errors
    ///
    /// When it cannot be written.
    pub(crate) fn save<'a>(&self, names: impl Iterator<Item = &'a str>) -> Result<(), String> {
        fs::write(path(), self.print(names))
            .map_err(|error| format!("{}: {error}", path().display()))
    }

    fn print<'a>(&self, names: impl Iterator<Item = &'a str>) -> String {
        let mut text = format!(
            "{HEAD}compiler: {}\nc library: {}\n\n# instructions   atomic   operation\n",
            self.compiler, self.c_library
        );
        for name in names {
            if let Some(Figures {
                instructions,
                atomics,
            }) = self.figures.get(name)
            {
                writeln!(text, "{instructions:14.1} {atomics:8.2}   {name}")
                    .expect("a string takes all");
            }
        }
        text
    }
}

/// Reads `INSTRUCTIONS ATOMIC NAME`.
fn figures(line: &str) -> Option<(String, Figures)> {
    let (instructions, rest) = line.trim().split_once(' ')?;
    let (atomics, name) = rest.trim().split_once(' ')?;
    let figures = Figures {
        instructions: instructions.parse().ok()?,
        atomics: atomics.parse().ok()?,
    };
    Some((name.trim().to_owned(), figures))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_written_is_read_again() {
        let mut recorded = Recorded {
            compiler: "rustc 1.95.0 (59807616e 2026-04-14)".to_owned(),
            c_library: "glibc 2.36".to_owned(),
            ..Recorded::default()
        };
        for (name, instructions, atomics) in [("a switch", 276.0, 0.0), ("rendezvous", 692.5, 6.25)]
        {
            let figures = Figures {
                instructions,
                atomics,
            };
            recorded.figures.insert(name.to_owned(), figures);
        }
        let text = recorded.print(["rendezvous", "a switch", "new"].into_iter());
        assert_eq!(Recorded::parse(&text).unwrap(), recorded);
        assert!(text.find("rendezvous") < text.find("a switch"));
    }

    #[test]
    fn a_line_without_figures_is_refused() {
        assert!(Recorded::parse("12.5 rendezvous\n").is_err());
        assert!(Recorded::parse("few 1.0 rendezvous\n").is_err());
        assert!(Recorded::parse("rendezvous\n").is_err());
    }

    #[test]
    fn the_file_in_the_repository_is_one() {
        let recorded = Recorded::load().unwrap();
        assert!(recorded.compiler.starts_with("rustc "));
        assert!(!recorded.figures.is_empty());
    }
}
