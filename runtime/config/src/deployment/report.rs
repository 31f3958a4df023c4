//! What a file has changed.

use std::fmt;

/// The system file of a run, and what it has changed.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct DeploymentReport {
    /// The file, as it was named.
    pub file: String,
    /// In the order of the file.
    pub overrides: Vec<Override>,
}

/// A value of a system file that is another than the program's, and went over it.
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub struct Override {
    /// Its line, from 1.
    pub line: usize,
    /// What it was for: `` executor `control` ``, `` process `x axis` ``, `` loop `x axis` ``,
    /// `system`.
    pub of: String,
    /// The key.
    pub key: &'static str,
    /// The file's value.
    pub file: String,
    /// The program's. None for a loop that has not begun: the value had no effect.
    pub program: Option<String>,
}

impl fmt::Display for DeploymentReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "system file {}:", self.file)?;
        if self.overrides.is_empty() {
            f.write_str(" it changes nothing")?;
        }
        for one in &self.overrides {
            let Override {
                line,
                of,
                key,
                file,
                program,
            } = one;
            write!(f, "\n  line {line}: {of}: {key} {file}")?;
            match program {
                Some(program) => write!(f, " (the program: {program})")?,
                None => f.write_str(", which had no effect: no loop of this name began")?,
            }
        }
        Ok(())
    }
}
