//! `lab setup`: what a guest is made of, from Debian's packages.

use crate::arch::Arch;
use crate::cargo;
use crate::place::{Place, which};
use nix::unistd::Uid;
use std::ffi::OsStr;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

/// The packages of the guest's files beside the kernel.
const ROOT: [&str; 5] = [
    "busybox-static",
    "libc6",
    "libgcc-s1",
    "libnuma1",
    "rt-tests",
];
/// What of them no program in a guest needs.
const UNUSED: [&str; 3] = ["usr/share", "etc", "usr/lib/TRIPLET/gconv"];
/// Debian's compiler, which comes with a standard library for each of its architectures.
const COMPILER: &str = "rustc-web";
const STANDARD_LIBRARY: &str = "libstd-rust-web-dev";

/// Runs the command.
///
/// # Errors
///
/// Something is missing, and what it needs to be installed is named.
pub(crate) fn command(place: &Place, arguments: &[String]) -> Result<u8, String> {
    let with_arm = match arguments {
        [] => false,
        [option] if option == "--arm" => true,
        _ => return Err("lab setup: there is one option: --arm".to_owned()),
    };
    let mut archs = vec![Arch::Amd64];
    if with_arm {
        archs.push(Arch::Arm64);
    }
    install_on_host(&archs)?;
    for &arch in &archs {
        match place.hindrance(arch) {
            None => {}
            Some(_) => in_new_folder(place, |new| guest(place, new, arch))?,
        }
        if let Some(reason) = place.hindrance(arch) {
            return Err(format!("lab setup: {reason}"));
        }
        println!("{}: kernel {}", arch.name(), place.kernel_version(arch)?);
    }
    if with_arm {
        if !place.rust().exists() {
            in_new_folder(place, |new| compiler(place, new))?;
        }
        if let Some(reason) = cargo::hindrance(place) {
            return Err(format!("lab setup: {reason}"));
        }
        println!("arm64: a compiler in {}", place.rust().display());
    }
    Ok(0)
}

/// Programs of this machine: QEMU, and for Arm the linker.
fn install_on_host(archs: &[Arch]) -> Result<(), String> {
    let is_missing = |arch: &Arch| {
        which(arch.qemu()).is_none() || (*arch == Arch::Arm64 && which(cargo::LINKER).is_none())
    };
    let missing: Vec<_> = archs.iter().filter(|arch| is_missing(arch)).collect();
    let packages: Vec<_> = missing
        .iter()
        .flat_map(|arch| arch.host_packages())
        .collect();
    if packages.is_empty() {
        return Ok(());
    }
    let named = packages
        .iter()
        .map(|name| **name)
        .collect::<Vec<_>>()
        .join(" ");
    if !Uid::effective().is_root() || which("apt-get").is_none() {
        return Err(format!(
            "lab setup: these packages of Debian are missing, and only root of a machine with \
             apt-get can install them here: {named}"
        ));
    }
    println!("installing {named}");
    call(Command::new("apt-get").args(["-qq", "update"]))?;
    let mut install = Command::new("apt-get");
    install
        .env("DEBIAN_FRONTEND", "noninteractive")
        .args(["-qq", "--yes", "--no-install-recommends", "install"])
        .args(packages)
        .stdout(Stdio::null());
    call(&mut install).map(drop)
}

/// Does its work in a new folder, which is removed. What is complete is renamed from there, so that
/// nothing is ever half there.
fn in_new_folder(
    place: &Place,
    work: impl FnOnce(&Path) -> Result<(), String>,
) -> Result<(), String> {
    for tool in ["apt-get", "apt-cache", "dpkg"] {
        if which(tool).is_none() {
            return Err(format!(
                "lab setup: {tool} is missing: the packages can be had on Debian alone; copy {} \
                 from such a machine",
                place.folder().display()
            ));
        }
    }
    let said = |error: std::io::Error| format!("{}: {error}", place.folder().display());
    fs::create_dir_all(place.folder()).map_err(said)?;
    let new = tempfile::Builder::new()
        .prefix("new-")
        .tempdir_in(place.folder())
        .map_err(said)?;
    work(new.path())
}

/// The kernel and the files of a guest.
fn guest(place: &Place, new: &Path, arch: Arch) -> Result<(), String> {
    println!(
        "{}: downloading the kernel and the guest's files",
        arch.name()
    );
    let apt = Apt::new(new, arch)?;
    let image = format!("linux-image-rt-{}", arch.name());
    let kernels = apt.depends(&image, "linux-image-")?;
    let kernel = kernels.first().ok_or_else(|| {
        format!("lab setup: there is no package {image} among those of this machine's apt sources")
    })?;
    let (kernel_folder, root) = (new.join("kernel"), new.join("root"));
    apt.unpack(&[kernel], &kernel_folder)?;
    apt.unpack(&ROOT, &root)?;
    // The modules: what a guest needs is in the kernel itself.
    let mut unused = vec![kernel_folder.join("lib"), kernel_folder.join("usr")];
    unused.extend(
        UNUSED
            .iter()
            .map(|path| root.join(path.replace("TRIPLET", arch.triplet()))),
    );
    for path in unused.iter().filter(|path| path.exists()) {
        fs::remove_dir_all(path).map_err(|error| format!("{}: {error}", path.display()))?;
    }
    replace(&root, &place.root(arch))?;
    replace(&kernel_folder, &place.kernel_folder(arch))
}

/// The compiler for Arm, which runs on this machine.
fn compiler(place: &Place, new: &Path) -> Result<(), String> {
    println!("arm64: downloading a compiler");
    let rust = new.join("rust");
    let (amd64, arm64) = (Apt::new(new, Arch::Amd64)?, Apt::new(new, Arch::Arm64)?);
    amd64.unpack(
        &amd64.closure(COMPILER, &["libstd-rust-web-", "libllvm"])?,
        &rust,
    )?;
    arm64.unpack(
        &arm64.closure(STANDARD_LIBRARY, &["libstd-rust-web-"])?,
        &rust,
    )?;
    let mut rustc = Command::new(cargo::rustc(&rust));
    call(
        rustc
            .arg("--version")
            .env("LD_LIBRARY_PATH", cargo::libraries(&rust)),
    )?;
    replace(&rust, &place.rust())
}

/// Puts a folder in the place of another.
fn replace(from: &Path, to: &Path) -> Result<(), String> {
    let said = |error: std::io::Error| format!("{}: {error}", to.display());
    if to.exists() {
        fs::remove_dir_all(to).map_err(said)?;
    }
    fs::rename(from, to).map_err(said)
}

/// Debian's packages of an architecture, by lists of its own: nothing of the machine's is changed.
struct Apt {
    options: Vec<String>,
    downloads: PathBuf,
}

impl Apt {
    fn new(new: &Path, arch: Arch) -> Result<Apt, String> {
        let folder = new.join(format!("apt-{}", arch.name()));
        let (lists, cache) = (folder.join("lists"), folder.join("cache"));
        let downloads = folder.join("downloads");
        for path in [
            lists.join("partial"),
            cache.join("archives/partial"),
            downloads.clone(),
        ] {
            fs::create_dir_all(&path).map_err(|error| format!("{}: {error}", path.display()))?;
        }
        let options = vec![
            format!("-oAPT::Architecture={}", arch.name()),
            format!("-oAPT::Architectures={}", arch.name()),
            format!("-oDir::State::Lists={}", lists.display()),
            format!("-oDir::Cache={}", cache.display()),
            // The folder is this program's user's, and none of apt's own user.
            "-oAPT::Sandbox::User=".to_owned(),
        ];
        let apt = Apt { options, downloads };
        call(
            Command::new("apt-get")
                .args(&apt.options)
                .args(["-qq", "update"]),
        )?;
        Ok(apt)
    }

    /// The packages whose names begin so, of those that a package depends on.
    fn depends(&self, package: &str, prefix: &str) -> Result<Vec<String>, String> {
        let mut command = Command::new("apt-cache");
        let text = call(command.args(&self.options).args(["depends", package]))?;
        Ok(dependencies(&text, prefix))
    }

    /// A package, and all that it depends on with names that begin so.
    fn closure(&self, package: &str, prefixes: &[&str]) -> Result<Vec<String>, String> {
        let mut all = vec![package.to_owned()];
        let mut next = 0;
        while next < all.len() {
            let package = all[next].clone();
            for prefix in prefixes {
                for name in self.depends(&package, prefix)? {
                    if !all.contains(&name) {
                        all.push(name);
                    }
                }
            }
            next += 1;
        }
        Ok(all)
    }

    fn unpack<S: AsRef<OsStr>>(&self, packages: &[S], to: &Path) -> Result<(), String> {
        let mut command = Command::new("apt-get");
        command
            .args(&self.options)
            .args(["-qq", "download"])
            .args(packages);
        call(command.current_dir(&self.downloads))?;
        fs::create_dir_all(to).map_err(|error| format!("{}: {error}", to.display()))?;
        let files = fs::read_dir(&self.downloads);
        let files = files.map_err(|error| format!("{}: {error}", self.downloads.display()))?;
        for file in files.flatten() {
            call(Command::new("dpkg").arg("-x").args([&file.path(), to]))?;
            fs::remove_file(file.path()).map_err(|error| format!("{:?}: {error}", file.path()))?;
        }
        Ok(())
    }
}

fn dependencies(text: &str, prefix: &str) -> Vec<String> {
    let depends = text
        .lines()
        .filter_map(|line| line.trim().strip_prefix("Depends: "));
    depends
        .filter(|name| name.starts_with(prefix))
        .map(str::to_owned)
        .collect()
}

/// Runs a program, and returns what it prints.
fn call(command: &mut Command) -> Result<String, String> {
    let program = command.get_program().to_string_lossy().into_owned();
    let said = command
        .output()
        .map_err(|error| format!("lab setup: {program}: {error}"))?;
    if !said.status.success() {
        let arguments: Vec<_> = command
            .get_args()
            .map(|word| word.to_string_lossy())
            .collect();
        return Err(format!(
            "lab setup: {program} {}: {}\n{}",
            arguments.join(" "),
            said.status,
            String::from_utf8_lossy(&said.stderr).trim()
        ));
    }
    Ok(String::from_utf8_lossy(&said.stdout).into_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_packages_dependencies_are_read() {
        let text = "\
linux-image-rt-amd64
  Depends: linux-image-6.1.0-56-rt-amd64
  Recommends: linux-image-other
 |Depends: <linux-image-virtual>
  Depends: kmod
";
        assert_eq!(
            dependencies(text, "linux-image-"),
            ["linux-image-6.1.0-56-rt-amd64"]
        );
    }

    #[test]
    fn a_folder_takes_the_place_of_another_whole() {
        let place = tempfile::tempdir().unwrap();
        let (old, new) = (place.path().join("root"), place.path().join("new"));
        for (folder, file) in [(&old, "old"), (&new, "new")] {
            fs::create_dir(folder).unwrap();
            fs::write(folder.join(file), "").unwrap();
        }
        replace(&new, &old).unwrap();
        let names: Vec<_> = fs::read_dir(&old)
            .unwrap()
            .map(|entry| entry.unwrap().file_name())
            .collect();
        assert_eq!(names, ["new"]);
        assert!(!new.exists());
    }

    #[test]
    fn a_program_that_fails_is_named_with_what_it_says() {
        let said =
            call(Command::new("sh").args(["-c", "echo no such thing >&2; exit 3"])).unwrap_err();
        assert!(
            said.contains("sh -c") && said.contains("no such thing"),
            "{said}"
        );
    }
}
