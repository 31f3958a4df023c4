//! What packages that this command writes depend on.

use crate::failure::{Failure, failed};
use luna_model::{Luna, is_luna};
use std::path::Path;
use std::{env, fs};

/// What the package is to depend on.
pub(crate) fn luna(stated: Option<&Path>) -> Result<Luna, Failure> {
    let here = |folder: &Path| {
        let manifest = fs::read_to_string(folder.join("Cargo.toml"));
        manifest.is_ok_and(|manifest| is_luna(&manifest))
    };
    if let Some(folder) = stated {
        if !here(folder) {
            return Err(failed(folder)(
                "this is no checkout of LUNA: --luna wants the folder whose Cargo.toml has the package luna-rt",
            ));
        }
        let absolute = fs::canonicalize(folder).map_err(failed(folder))?;
        return Ok(Luna::Folder(absolute));
    }
    let current = env::current_dir().map_err(failed(Path::new(".")))?;
    let around = current.ancestors().find(|folder| here(folder));
    Ok(match around {
        Some(folder) => Luna::Folder(folder.to_owned()),
        None => Luna::Version(env!("CARGO_PKG_VERSION").to_owned()),
    })
}
