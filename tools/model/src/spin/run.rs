//! Runs SPIN: `spin -a`, a C compiler, and the verifier that they make.

use super::promela::Promela;
use std::path::Path;
use std::process::{Command, Output};
use tempfile::TempDir;

const ASSERTION: &str = "assertion violated";
/// What an error of the model is called.
const REASONS: [&str; 5] = [
    ASSERTION,
    "invalid end state",
    "acceptance cycle",
    "end state in claim",
    "claim violated",
];

/// SPIN counts processes in a byte.
const MAX_AGENTS: usize = 255;
/// Models with at most so many processes and branches are small.
const SMALL: usize = 32;
/// The deepest way that is followed, in steps, and the size of the table of states, as a power of
/// 2. Most models are small; the others are tried once more. Properties have longer ways.
const SIZES: [[&str; 2]; 2] = [["-m100000", "-w20"], ["-m5000000", "-w24"]];
const SIZES_OF_CLAIMS: [[&str; 2]; 2] = [["-m1000000", "-w20"], SIZES[1]];
const TOO_SHALLOW: &str = "max search depth too small";
/// The verifier gives up after so many minutes, or with so many MB.
const MINUTES: &str = "-Q5";
const MEMORY: &str = "-DMEMLIM=2048";

/// Why SPIN has no verdict.
#[derive(Debug, thiserror::Error)]
pub enum SpinError {
    /// A program is not there.
    #[error("{program} is missing; install it (Debian: {package}), or check without --spin")]
    Missing {
        /// Its name.
        program: &'static str,
        /// Of Debian.
        package: &'static str,
    },
    /// The model is larger than SPIN's.
    #[error("the model has {0} processes and branches, and SPIN takes 255; check without --spin")]
    TooLarge(usize),
    /// A file or program cannot be used.
    #[error("{what}: {error}")]
    Io {
        /// Which.
        what: String,
        /// Why.
        error: std::io::Error,
    },
    /// A program has refused what it was given.
    #[error("{program} failed: {output}")]
    Failed {
        /// Its name.
        program: &'static str,
        /// What it wrote.
        output: String,
    },
}

/// What the verifier has come to.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) enum Verdict {
    /// Nothing is wrong.
    Holds,
    /// Something is, and this is how it comes to that: SPIN's own words.
    Fails { reason: String, trail: String },
    /// It has not seen all states.
    Incomplete,
}

impl Verdict {
    /// Whether an assertion is broken.
    pub(crate) fn is_assertion(&self) -> bool {
        matches!(self, Self::Fails { reason, .. } if reason.contains(ASSERTION))
    }
}

/// A verifier that is ready to run.
#[derive(Debug)]
pub(crate) struct Verifier {
    folder: TempDir,
    sizes: [[&'static str; 2]; 2],
}

const FILE: &str = "model.pml";

impl Verifier {
    /// `claims`: for properties; else for deadlocks and assertions.
    pub(crate) fn make(promela: &Promela, agents: usize, claims: bool) -> Result<Self, SpinError> {
        if agents > MAX_AGENTS {
            return Err(SpinError::TooLarge(agents));
        }
        let io = |what: &Path| {
            let what = what.display().to_string();
            move |error| SpinError::Io { what, error }
        };
        let folder = tempfile::Builder::new().prefix("luna-model-").tempdir();
        let folder = folder.map_err(io(&std::env::temp_dir()))?;
        let file = folder.path().join(FILE);
        std::fs::write(&file, &promela.text).map_err(io(&file))?;
        let sizes = if claims { SIZES_OF_CLAIMS } else { SIZES };
        let made = Self { folder, sizes };
        made.run("spin", "spin", &["-a", FILE])?;
        let fair = format!("-DNFAIR={}", agents.div_ceil(8) + 3);
        let kind: &[&str] = match claims {
            true => &["-DNOREDUCE", &fair],
            false => &["-DSAFETY", "-DNOCLAIM"],
        };
        // For deadlocks of small models the compiler takes longer than the verifier.
        let optimized = match (agents > SMALL, claims) {
            (true, _) => "-O2",
            (false, true) => "-O1",
            (false, false) => "-O0",
        };
        let mut arguments = vec!["-w", optimized, MEMORY, "-o", "pan", "pan.c"];
        arguments.extend(kind);
        made.run("cc", "gcc", &arguments)?;
        Ok(made)
    }

    /// Runs the verifier with these options.
    pub(crate) fn verify(&self, options: &[&str]) -> Result<Verdict, SpinError> {
        let mut text = String::new();
        for size in self.sizes {
            let pan = self.folder.path().join("pan");
            let mut command = Command::new(pan);
            command.args(size).arg(MINUTES).args(options);
            let output = self.output(&mut command, "pan")?;
            text = String::from_utf8_lossy(&output.stdout).into_owned();
            // Stopped by a signal, for one.
            if !text.contains("errors: ") {
                return Err(SpinError::Failed {
                    program: "pan",
                    output: format!("{}: {}", output.status, text.trim()),
                });
            }
            if !text.contains(TOO_SHALLOW) {
                break;
            }
        }
        if text.contains("errors: 0") {
            let is_cut = text.contains("not completed") || text.contains(TOO_SHALLOW);
            return Ok(match is_cut {
                true => Verdict::Incomplete,
                false => Verdict::Holds,
            });
        }
        let reason = text.lines().find_map(|line| line.strip_prefix("pan:1: "));
        if text.contains(TOO_SHALLOW) && reason.is_none() {
            return Ok(Verdict::Incomplete);
        }
        // The verifier reports limits of its own as errors, too.
        let is_of_model = reason.is_some_and(|reason| REASONS.iter().any(|of| reason.contains(of)));
        if !is_of_model {
            return Err(SpinError::Failed {
                program: "pan",
                output: text.trim().to_owned(),
            });
        }
        let trail = self.run("spin", "spin", &["-t", "-p", FILE])?;
        Ok(Verdict::Fails {
            reason: reason.unwrap_or("an error").to_owned(),
            trail,
        })
    }

    fn run(
        &self,
        program: &'static str,
        package: &'static str,
        arguments: &[&str],
    ) -> Result<String, SpinError> {
        let mut command = Command::new(program);
        let output = match self.output(command.args(arguments), program) {
            Err(SpinError::Io { error, .. }) if error.kind() == std::io::ErrorKind::NotFound => {
                return Err(SpinError::Missing { program, package });
            }
            output => output?,
        };
        let mut text = String::from_utf8_lossy(&output.stdout).into_owned();
        if !output.status.success() {
            text.push_str(&String::from_utf8_lossy(&output.stderr));
            return Err(SpinError::Failed {
                program,
                output: text.trim().to_owned(),
            });
        }
        Ok(text)
    }

    fn output(&self, command: &mut Command, what: &str) -> Result<Output, SpinError> {
        let output = command.current_dir(self.folder.path()).output();
        output.map_err(|error| SpinError::Io {
            what: what.to_owned(),
            error,
        })
    }
}
