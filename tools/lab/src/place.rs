//! The folder with kernels and root file systems.

use crate::arch::Arch;
use std::env;
use std::fs;
use std::path::{Path, PathBuf};

/// The laboratory's folder.
#[derive(Debug, Clone)]
pub(crate) struct Place {
    folder: PathBuf,
}

impl Place {
    /// `LUNA_LAB`, or `target/lab` of the checkout.
    pub(crate) fn of_environment() -> Place {
        let folder = match env::var_os("LUNA_LAB") {
            Some(folder) if !folder.is_empty() => PathBuf::from(folder),
            _ => checkout().join("target/lab"),
        };
        Place { folder }
    }

    /// A folder.
    #[cfg(test)]
    pub(crate) fn at(folder: &Path) -> Place {
        Place {
            folder: folder.to_owned(),
        }
    }

    /// Where it is.
    pub(crate) fn folder(&self) -> &Path {
        &self.folder
    }

    /// The guest's files, without programs of the user.
    pub(crate) fn root(&self, arch: Arch) -> PathBuf {
        self.folder.join(format!("root-{}", arch.name()))
    }

    /// The folder of the kernel's package.
    pub(crate) fn kernel_folder(&self, arch: Arch) -> PathBuf {
        self.folder.join(format!("kernel-{}", arch.name()))
    }

    /// The folder of the compiler for Arm.
    pub(crate) fn rust(&self) -> PathBuf {
        self.folder.join("rust")
    }

    /// The kernel.
    ///
    /// # Errors
    ///
    /// There is none.
    pub(crate) fn kernel(&self, arch: Arch) -> Result<PathBuf, String> {
        let boot = self.kernel_folder(arch).join("boot");
        let is_kernel = |path: &PathBuf| {
            let name = path.file_name().unwrap_or_default();
            name.to_string_lossy().starts_with("vmlinuz-")
        };
        let files = fs::read_dir(&boot).into_iter().flatten().flatten();
        let newest = files.map(|entry| entry.path()).filter(is_kernel).max();
        newest.ok_or_else(|| {
            format!(
                "no kernel for {} in {}: {}",
                arch.name(),
                boot.display(),
                remedy(arch)
            )
        })
    }

    /// The kernel's version, as in `6.1.0-56-rt-amd64`.
    ///
    /// # Errors
    ///
    /// There is no kernel.
    pub(crate) fn kernel_version(&self, arch: Arch) -> Result<String, String> {
        let kernel = self.kernel(arch)?;
        let name = kernel.file_name().unwrap_or_default().to_string_lossy();
        Ok(name.trim_start_matches("vmlinuz-").to_owned())
    }

    /// What is missing before a guest can be booted.
    pub(crate) fn hindrance(&self, arch: Arch) -> Option<String> {
        if which(arch.qemu()).is_none() {
            let package = arch.host_packages()[0];
            return Some(format!("{} is missing (Debian: {package})", arch.qemu()));
        }
        if let Err(reason) = self.kernel(arch) {
            return Some(reason);
        }
        let busybox = self.root(arch).join("bin/busybox");
        (!busybox.is_file()).then(|| format!("{} is missing: {}", busybox.display(), remedy(arch)))
    }
}

/// The workspace that this program was built from.
pub(crate) fn checkout() -> PathBuf {
    let own = Path::new(env!("CARGO_MANIFEST_DIR"));
    own.ancestors().nth(2).unwrap_or(own).to_owned()
}

/// Where a program is that can be called by its name.
pub(crate) fn which(program: &str) -> Option<PathBuf> {
    let path = env::var_os("PATH")?;
    env::split_paths(&path)
        .map(|folder| folder.join(program))
        .find(|file| file.is_file())
}

fn remedy(arch: Arch) -> &'static str {
    match arch {
        Arch::Amd64 => "run `lab setup`",
        Arch::Arm64 => "run `lab setup --arm`",
    }
}
