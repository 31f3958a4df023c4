//! Makes FMUs of `model.c`.

use luna_plants::fmu::Version;
use std::collections::HashMap;
use std::fs::File;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::Mutex;
use std::sync::atomic::{AtomicU32, Ordering};

/// Deviations from a valid model.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Odd {
    /// For the compiler: "-DNO_STEP".
    pub(crate) flag: Option<&'static str>,
    /// In the description: this by that.
    pub(crate) replaced: Option<(&'static str, &'static str)>,
    /// The platform that its code is declared for.
    pub(crate) platform: Option<&'static str>,
    /// Without a description.
    pub(crate) is_mute: bool,
    /// What is in `y.txt` in its resources; without it it has none.
    pub(crate) resource: Option<&'static str>,
}

/// An FMU's file, of a name of its own.
pub(crate) fn fmu(version: Version, odd: Odd) -> PathBuf {
    static NUMBER: AtomicU32 = AtomicU32::new(0);
    let number = NUMBER.fetch_add(1, Ordering::Relaxed);
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR"));
    let (description, platform) = match version {
        Version::Two => (include_str!("two.xml"), "linux64"),
        Version::Three => (include_str!("three.xml"), three_platform()),
    };
    let description = match odd.replaced {
        Some((this, by)) => {
            assert!(description.contains(this), "{this}");
            description.replace(this, by)
        }
        None => description.to_owned(),
    };
    let path = folder.join(format!("lag-{number}.fmu"));
    let mut archive = zip::ZipWriter::new(File::create(&path).unwrap());
    let mut add = |name: &str, bytes: &[u8]| {
        archive
            .start_file(name, zip::write::SimpleFileOptions::default())
            .unwrap();
        archive.write_all(bytes).unwrap();
    };
    if !odd.is_mute {
        add("modelDescription.xml", description.as_bytes());
    }
    if let Some(text) = odd.resource {
        add("resources/y.txt", text.as_bytes());
    }
    let platform = odd.platform.unwrap_or(platform);
    add(
        &format!("binaries/{platform}/lag.so"),
        &code(version, odd.flag),
    );
    archive.finish().unwrap();
    path
}

/// The shared library, compiled once.
fn code(version: Version, flag: Option<&'static str>) -> Vec<u8> {
    type Compiled = HashMap<(Version, Option<&'static str>), Vec<u8>>;
    static COMPILED: Mutex<Option<Compiled>> = Mutex::new(None);
    let mut compiled = COMPILED.lock().unwrap();
    let compiled = compiled.get_or_insert_default();
    let number = compiled.len();
    compiled
        .entry((version, flag))
        .or_insert_with(|| {
            let library = Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("lag-{number}.so"));
            compile(version, flag, &library);
            std::fs::read(library).unwrap()
        })
        .clone()
}

fn compile(version: Version, flag: Option<&str>, to: &Path) {
    let source = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/it/fmu/model.c");
    let number = match version {
        Version::Two => "-DFMI=2",
        Version::Three => "-DFMI=3",
    };
    let compiler = std::env::var("CC").unwrap_or_else(|_| "cc".to_owned());
    let compiled = Command::new(&compiler)
        .args(["-shared", "-fPIC", "-O1", "-Wall", "-Wextra", "-Werror"])
        .args(["-fvisibility=hidden", number])
        .args(flag)
        .arg("-o")
        .args([to, &source])
        .arg("-lm")
        .status();
    match compiled {
        Ok(status) => assert!(status.success(), "`{compiler}` refuses model.c"),
        Err(error) => panic!("these tests need a C compiler: `{compiler}`: {error}"),
    }
}

fn three_platform() -> &'static str {
    if cfg!(target_arch = "aarch64") {
        "aarch64-linux"
    } else {
        "x86_64-linux"
    }
}
