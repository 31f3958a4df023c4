//! What is refused, with the names.

use std::fmt;
use std::sync::Arc;
use thiserror::Error;

/// Why a parameter cannot be declared.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum DeclareError {
    /// There is a parameter of that name.
    #[error(
        "process `{process}` has a parameter `{parameter}` already; give each a name of its own, or declare it as shared in all processes that read it"
    )]
    Duplicate {
        /// The name.
        parameter: String,
        /// The process that has it.
        process: String,
    },
    /// One of that name is there or was, and it was declared otherwise.
    #[error(
        "parameter `{parameter}` was declared before with another type, unit, range or default; declare it alike"
    )]
    Differs {
        /// The name.
        parameter: String,
    },
    /// Its name cannot be written in files and on command lines.
    #[error(
        "`{parameter}` cannot be a parameter's name; use one without `=`, `,`, quotes, brackets and control characters, and without spaces or slashes \
                 at its ends"
    )]
    Name {
        /// The name.
        parameter: String,
    },
    /// One of its texts is too long.
    #[error("the {what} of parameter `{parameter}` has more than {most} bytes; use a shorter one")]
    TooLong {
        /// The parameter's name.
        parameter: String,
        /// Which of its texts.
        what: &'static str,
        /// How many bytes it may have.
        most: usize,
    },
    /// Its range contains nothing, or has a limit that is not finite.
    #[error(
        "parameter `{parameter}` has the range {range}; give it finite limits, the lower one first"
    )]
    Range {
        /// The parameter's name.
        parameter: String,
        /// The range.
        range: String,
    },
    /// Its default cannot be its value.
    #[error("the default {value} of parameter `{parameter}`: {reason}")]
    Default {
        /// The parameter's name.
        parameter: String,
        /// The default.
        value: String,
        /// Why.
        reason: Reason,
    },
}

/// Where a value came from.
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub enum Source {
    /// From a file, at this line.
    File {
        /// Which.
        path: Arc<str>,
        /// From 1.
        line: usize,
    },
    /// From this variable of the environment.
    Environment(&'static str),
    /// From the command line.
    Argument,
    /// From the program, or a tool that uses it, such as a scope.
    Program,
    /// From the recording that is replayed.
    Recording,
}

impl fmt::Display for Source {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Source::File { path, line } => write!(f, "{path}:{line}: "),
            Source::Environment(variable) => write!(f, "{variable}: "),
            Source::Argument => f.write_str("--set: "),
            Source::Program => Ok(()),
            Source::Recording => f.write_str("recording: "),
        }
    }
}

/// Why a value was refused.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum Reason {
    /// No process has declared such a parameter.
    #[error("there is no such parameter{}", meant(nearest))]
    Unknown {
        /// A declared name like it.
        nearest: Option<String>,
    },
    /// It is outside of the parameter's range, or of its type's range.
    #[error("it must be {least} to {most}")]
    OutOfRange {
        /// The least that it can be.
        least: String,
        /// The most.
        most: String,
    },
    /// It is not of the parameter's type.
    #[error("it must be {expected}")]
    WrongType {
        /// What it has to be.
        expected: String,
    },
    /// A list of another length.
    #[error("it must have {expected} elements, and has {found}")]
    WrongLength {
        /// The parameter's.
        expected: usize,
        /// The value's.
        found: usize,
    },
    /// It is infinite, or no number.
    #[error("it must be finite")]
    NotFinite,
    /// A whole number that a parameter with fractions would round.
    #[error("it has more digits than the type; write fewer")]
    NotExact,
    /// It is none of the choices.
    #[error("it must be one of {choices}{}", meant(nearest))]
    NoSuchChoice {
        /// The choices.
        choices: String,
        /// Which is like it.
        nearest: Option<String>,
    },
    /// The set has two values for it.
    #[error("it is set twice; leave one out")]
    Twice,
}

/// The question behind a name that is not known.
fn meant(nearest: &Option<String>) -> String {
    match nearest {
        Some(name) => format!("; did you mean `{name}`?"),
        None => String::new(),
    }
}

/// A refused value: its parameter, its source, and the reason.
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub struct Refusal {
    /// The parameter's name, as it was given.
    pub name: String,
    /// The value.
    pub value: String,
    /// The parameter's unit, if it is known.
    pub unit: String,
    /// Where it came from.
    pub source: Source,
    /// What is wrong about it.
    pub reason: Reason,
}

impl fmt::Display for Refusal {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Refusal {
            name,
            value,
            unit,
            source,
            reason,
        } = self;
        write!(f, "{source}`{name}` = {value}: {reason}")?;
        match reason {
            Reason::OutOfRange { .. } if !unit.is_empty() => write!(f, " {unit}"),
            _ => Ok(()),
        }
    }
}

/// Why a set of parameters was not taken. Nothing of it was.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum SetError {
    /// These of its values.
    #[error("no parameter was set{}", reasons(.0))]
    Refused(Vec<Refusal>),
    /// The file cannot be read, or is no TOML.
    #[error(
        "no parameter was set: {path}{}: {message}",
        .line.map_or_else(String::new, |line| format!(":{line}"))
    )]
    File {
        /// Which.
        path: String,
        /// Where, from 1, if it is known.
        line: Option<usize>,
        /// What is wrong.
        message: String,
    },
    /// An assignment is not of the form `NAME=VALUE`.
    #[error("no parameter was set: {source}`{text}` is not NAME=VALUE, such as pan/kp=2.5")]
    Syntax {
        /// Where it came from.
        r#source: Source,
        /// What was written.
        text: String,
    },
    /// A file was to be read again, and there is none.
    #[error(
        "there is no file of parameters to read again; name one by System::parameters_from or LUNA_PARAMETERS"
    )]
    NoFile,
    /// The system does not run yet, or does no longer.
    #[error(
        "system `{system}` does not run, so its parameters cannot be replaced; before the start use System::set_parameter"
    )]
    NotRunning {
        /// Its name.
        system: String,
    },
    /// The system is replayed: it gets the recorded values.
    #[error(
        "the system is replayed, with the parameters that were recorded, so they cannot be replaced"
    )]
    Replayed,
}

fn reasons(refused: &[Refusal]) -> String {
    let refused: Vec<_> = refused.iter().map(Refusal::to_string).collect();
    match refused.is_empty() {
        true => String::new(),
        false => format!(": {}", refused.join("; ")),
    }
}
