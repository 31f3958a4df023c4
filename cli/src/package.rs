//! What packages that this command writes depend on.

use crate::failure::Failure;
use luna_model::{Luna, is_luna};
use std::path::{Path, PathBuf};
use std::{env, fs, io};

/// What the package is to depend on.
pub(crate) fn luna(stated: Option<&Path>) -> Result<Luna, Failure> {
    let here = |folder: &Path| {
        let manifest = fs::read_to_string(folder.join("Cargo.toml"));
        manifest.is_ok_and(|manifest| is_luna(&manifest))
    };
    if let Some(folder) = stated {
        if !here(folder) {
            return Err(Failure::Package {
                path: folder.to_owned(),
                why: "this is no checkout of LUNA: --luna wants the folder whose Cargo.toml has the package luna-rt",
            });
        }
        return absolute(folder).map(Luna::Folder);
    }
    let current = env::current_dir().map_err(|error| Failure::ModelFile {
        path: ".".into(),
        error,
    })?;
    let around = current.ancestors().find(|folder| here(folder));
    Ok(match around {
        Some(folder) => Luna::Folder(folder.to_owned()),
        None => Luna::Version(env!("CARGO_PKG_VERSION").to_owned()),
    })
}

fn absolute(folder: &Path) -> Result<PathBuf, Failure> {
    fs::canonicalize(folder).map_err(failed(folder))
}

pub(crate) fn failed(path: &Path) -> impl FnOnce(io::Error) -> Failure {
    let path = path.to_owned();
    move |error| Failure::ModelFile { path, error }
}
