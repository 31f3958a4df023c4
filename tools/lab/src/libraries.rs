//! The shared libraries that a program of the user needs.

use crate::arch::Arch;
use object::Endianness;
use object::elf::{DT_NEEDED, FileHeader64};
use object::read::elf::{Dyn, FileHeader};
use std::collections::BTreeMap;
use std::env;
use std::fs;
use std::path::{Path, PathBuf};

/// The libraries that these files need and that the guest does not have, by their names: where they
/// are on this machine. What is no ELF file, such as a script, needs none.
///
/// # Errors
///
/// A file is of another architecture, or a library is nowhere.
pub(crate) fn missing(
    arch: Arch,
    root: &Path,
    files: &[PathBuf],
) -> Result<BTreeMap<String, PathBuf>, String> {
    let triplet = arch.triplet();
    let in_guest = [
        root.join("lib64"),
        root.join("lib"),
        root.join("lib").join(triplet),
        root.join("usr/lib").join(triplet),
    ];
    let on_host = host_folders(arch);
    let mut found = BTreeMap::new();
    let mut open = files.to_vec();
    while let Some(file) = open.pop() {
        for name in needed(arch, &file)? {
            let given = |path: &PathBuf| path.file_name().is_some_and(|own| own == &*name);
            if found.contains_key(&name)
                || in_guest.iter().any(|folder| folder.join(&name).exists())
            {
                continue;
            }
            let path = files.iter().find(|path| given(path)).cloned().or_else(|| {
                let candidates = on_host.iter().map(|folder| folder.join(&name));
                candidates.into_iter().find(|path| path.is_file())
            });
            let Some(path) = path else {
                return Err(format!(
                    "{} needs {name}, which is in none of {}: link it statically, or name the \
                     library's file too",
                    file.display(),
                    on_host
                        .iter()
                        .map(|it| it.display().to_string())
                        .collect::<Vec<_>>()
                        .join(", "),
                ));
            };
            open.push(path.clone());
            found.insert(name, path);
        }
    }
    Ok(found)
}

fn host_folders(arch: Arch) -> Vec<PathBuf> {
    let triplet = arch.triplet();
    let mut folders = Vec::new();
    if arch.elf_machine() == host_machine() {
        if let Some(path) = env::var_os("LD_LIBRARY_PATH") {
            folders.extend(env::split_paths(&path).filter(|folder| folder.is_absolute()));
        }
        folders.push(PathBuf::from("/usr/local/lib"));
        for folder in ["/lib", "/usr/lib"] {
            folders.push(Path::new(folder).join(triplet));
        }
        folders.extend(["/lib64", "/usr/lib64", "/lib", "/usr/lib"].map(PathBuf::from));
    } else {
        folders.push(PathBuf::from(format!("/usr/{triplet}/lib")));
        folders.push(Path::new("/usr/lib").join(triplet));
    }
    folders
}

fn host_machine() -> object::elf::Machine {
    let arch = if cfg!(target_arch = "aarch64") {
        Arch::Arm64
    } else {
        Arch::Amd64
    };
    arch.elf_machine()
}

/// The names of the libraries that a file names itself.
fn needed(arch: Arch, path: &Path) -> Result<Vec<String>, String> {
    let said = |error: &dyn std::fmt::Display| format!("{}: {error}", path.display());
    let bytes = fs::read(path).map_err(|error| said(&error))?;
    if !bytes.starts_with(b"\x7fELF") {
        return Ok(Vec::new());
    }
    let data = &*bytes;
    let head = FileHeader64::<Endianness>::parse(data).map_err(|error| said(&error))?;
    let endian = head.endian().map_err(|error| said(&error))?;
    if head.e_machine(endian) != arch.elf_machine() {
        return Err(format!(
            "{} is no program for {}",
            path.display(),
            arch.name()
        ));
    }
    let sections = head.sections(endian, data).map_err(|error| said(&error))?;
    let Some((entries, link)) = sections
        .dynamic(endian, data)
        .map_err(|error| said(&error))?
    else {
        return Ok(Vec::new());
    };
    let strings = sections
        .strings(endian, data, link)
        .map_err(|error| said(&error))?;
    let mut names = Vec::new();
    for entry in entries {
        if entry.tag(endian) == DT_NEEDED {
            let name = entry
                .string(endian, strings)
                .map_err(|error| said(&error))?;
            names.push(String::from_utf8_lossy(name).into_owned());
        }
    }
    Ok(names)
}

#[cfg(test)]
#[cfg(target_arch = "x86_64")]
mod tests {
    use super::*;

    fn own() -> PathBuf {
        env::current_exe().unwrap()
    }

    #[test]
    fn a_program_names_its_libraries() {
        let names = needed(Arch::Amd64, &own()).unwrap();
        assert!(
            names.iter().any(|name| name.starts_with("libc.so")),
            "{names:?}"
        );
    }

    #[test]
    fn what_the_guest_has_not_is_found_here() {
        let root = tempfile::tempdir().unwrap();
        let all = missing(Arch::Amd64, root.path(), &[own()]).unwrap();
        assert!(all["libc.so.6"].is_file(), "{all:?}");
        fs::create_dir(root.path().join("lib64")).unwrap();
        fs::write(root.path().join("lib64/libc.so.6"), "").unwrap();
        let all = missing(Arch::Amd64, root.path(), &[own()]).unwrap();
        assert!(!all.contains_key("libc.so.6"), "{all:?}");
    }

    #[test]
    fn another_architecture_is_refused_and_a_script_needs_nothing() {
        let root = tempfile::tempdir().unwrap();
        let said = missing(Arch::Arm64, root.path(), &[own()]).unwrap_err();
        assert!(said.ends_with("is no program for arm64"), "{said}");
        let script = root.path().join("script");
        fs::write(&script, "#!/bin/sh\n").unwrap();
        assert!(
            missing(Arch::Arm64, root.path(), &[script])
                .unwrap()
                .is_empty()
        );
    }
}
