//! What packages that this command writes depend on.

use crate::failure::{Failure, failed, unusable};
use clap::Args;
use luna_model::{Luna, is_luna};
use std::path::{Path, PathBuf};
use std::{env, fs};

/// The folder that this command was built from.
const BUILT_FROM: &str = env!("CARGO_MANIFEST_DIR");

/// Where the user says that LUNA is.
#[derive(Debug, Clone, Args)]
pub(crate) struct Stated {
    /// The checkout of LUNA that the package depends on [default: the one around the current
    /// folder, else what this `luna` was built from]
    #[arg(long, value_name = "PATH")]
    luna: Option<PathBuf>,
    /// The repository of the LUNA that the package depends on
    #[arg(long, value_name = "URL", conflicts_with = "luna")]
    git: Option<String>,
}

impl Stated {
    /// Whether anything was said.
    pub(crate) fn is_stated(&self) -> bool {
        self.luna.is_some() || self.git.is_some()
    }

    /// What the package is to depend on, and how that is known.
    ///
    /// # Errors
    ///
    /// What was stated is no checkout; or nothing was, and there is none to be found.
    pub(crate) fn luna(&self) -> Result<(Luna, &'static str), Failure> {
        if let Some(url) = &self.git {
            return Ok((Luna::Git(url.clone()), "as stated"));
        }
        if let Some(folder) = &self.luna {
            if !is_checkout(folder) {
                return Err(failed(folder)(
                    "this is no checkout of LUNA: --luna wants the folder whose Cargo.toml has the package luna-rt",
                ));
            }
            return Ok((checkout(folder)?, "as stated"));
        }
        let current = env::current_dir().map_err(failed(Path::new(".")))?;
        if let Some(around) = current.ancestors().find(|folder| is_checkout(folder)) {
            let known = "the checkout around the current folder";
            return Ok((checkout(around)?, known));
        }
        built_from(Path::new(BUILT_FROM))
    }
}

/// What a command was built from, in this folder: a checkout, or a published package.
fn built_from(folder: &Path) -> Result<(Luna, &'static str), Failure> {
    if let Some(above) = folder.parent().filter(|above| is_checkout(above)) {
        let known = "the checkout that this `luna` was built from";
        return Ok((checkout(above)?, known));
    }
    // There, Cargo keeps the packages of registries.
    let is_published = folder.to_string_lossy().contains("/registry/src/");
    if is_published {
        let version = env!("CARGO_PKG_VERSION").to_owned();
        return Ok((Luna::Version(version), "as published with this `luna`"));
    }
    Err(unusable(
        "it is not known where LUNA is",
        format_args!(
            "this `luna` was built from {}, which is no checkout of LUNA now; say --luna PATH for a \
             checkout, or --git URL for a repository",
            folder.display()
        ),
    ))
}

fn is_checkout(folder: &Path) -> bool {
    let manifest = fs::read_to_string(folder.join("Cargo.toml"));
    manifest.is_ok_and(|manifest| is_luna(&manifest))
}

fn checkout(folder: &Path) -> Result<Luna, Failure> {
    let absolute = fs::canonicalize(folder).map_err(failed(folder))?;
    Ok(Luna::Folder(absolute))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_command_knows_what_it_was_built_from() {
        let (here, known) = built_from(Path::new(BUILT_FROM)).unwrap();
        let above = fs::canonicalize(Path::new(BUILT_FROM).join("..")).unwrap();
        assert_eq!(here, Luna::Folder(above));
        assert!(known.contains("built from"), "{known}");
        let published = Path::new("/home/one/.cargo/registry/src/index.crates.io-1/luna-cli-0.2.0");
        let (version, _) = built_from(published).unwrap();
        let expected = env!("CARGO_PKG_VERSION").to_owned();
        assert_eq!(version, Luna::Version(expected));
        let error = built_from(Path::new("/gone/cli")).unwrap_err();
        assert_eq!(error.exit_code(), 2);
        let error = error.to_string();
        for part in ["/gone/cli", "--luna PATH", "--git URL"] {
            assert!(error.contains(part), "{error}");
        }
    }
}
