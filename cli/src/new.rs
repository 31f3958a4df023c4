//! `luna new`: a project to begin with.

use crate::failure::{Failure, failed, unusable};
use crate::package::Stated;
use clap::{Args, ValueEnum};
use luna_model::{Luna, package_name};
use std::fs;
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// The options of `luna new`.
#[derive(Debug, Clone, Args)]
#[command(after_help = "\
Templates:
  loop   one loop at 1 kHz, and how late its cycles began
  axis   one axis: a simulated motor, a PID loop, set-points, a safety layer, signals for the scope
  cell   several units as processes, a choice with guards, an emergency
  ros2   a node of a ROS 2 graph: /cmd_vel to wheels, /joint_states back; runs also without ROS 2

Each runs by `cargo run`, has tests on a virtual clock (`cargo test`), a system file for the machine, a workflow of GitHub Actions, and a README with next steps.

Exit codes: 0 made, 1 standard output is closed, 2 bad arguments, the folder is there already, or it cannot be written.")]
pub(crate) struct Arguments {
    /// The folder to make; its last part is the package's name
    #[arg(value_name = "NAME")]
    path: PathBuf,
    /// What it begins with
    #[arg(long, short, value_enum, default_value = "loop")]
    template: Template,
    #[command(flatten)]
    luna: Stated,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Template {
    Loop,
    Axis,
    Cell,
    Ros2,
}

/// A file's path below the project, and its text.
type File = (&'static str, &'static str);

/// A file of a template, under the same name.
macro_rules! file {
    ($template:literal, $path:expr, $file:literal) => {
        (
            $path,
            include_str!(concat!("../templates/", $template, "/", $file)),
        )
    };
}

/// What all projects have.
const COMMON: [File; 3] = [
    file!("common", "Cargo.toml", "Cargo.toml.txt"),
    file!("common", ".gitignore", "gitignore.txt"),
    file!("common", ".github/workflows/ci.yml", "ci.yml"),
];

/// What a template has, but for the module that has its name.
macro_rules! files {
    ($template:literal, $($module:literal),*) => {
        &[
            file!($template, "README.md", "README.md"),
            file!($template, "system.toml", "system.toml"),
            file!($template, "src/main.rs", "main.rs"),
            file!($template, "src/tests.rs", "tests.rs"),
            $(file!($template, concat!("src/", $module), $module),)*
        ]
    };
}

impl Template {
    fn files(self) -> &'static [File] {
        match self {
            Self::Loop => files!("loop",),
            Self::Axis => files!("axis", "axis.rs"),
            Self::Cell => files!("cell", "cell.rs"),
            Self::Ros2 => files!("ros2", "base.rs", "bridge.rs"),
        }
    }

    /// The packages of LUNA that it depends on, beside `luna-rt`, and their folders in a checkout.
    fn packages(self) -> &'static [(&'static str, &'static str)] {
        match self {
            Self::Loop | Self::Cell => &[],
            Self::Axis => &[
                ("luna-plants", "simulation/plants"),
                ("luna-safety-blocks", "safety-blocks"),
            ],
            Self::Ros2 => &[("luna-ros2", "devices/ros2")],
        }
    }
}

pub(crate) fn run(arguments: &Arguments) -> Result<ExitCode, Failure> {
    let Arguments { path, template, .. } = arguments;
    let name = name(path)?;
    let (luna, known) = arguments.luna.luna()?;
    let dependencies = dependencies(*template, &luna);
    if let Some(parent) = path
        .parent()
        .filter(|parent| !parent.as_os_str().is_empty())
    {
        fs::create_dir_all(parent).map_err(failed(parent))?;
    }
    // It must not be there: nothing is ever overwritten.
    fs::create_dir(path).map_err(|error| match error.kind() {
        io::ErrorKind::AlreadyExists => {
            failed(path)("this is there already: give another name, or remove it")
        }
        _ => failed(path)(error),
    })?;
    for (below, text) in COMMON.iter().chain(template.files()) {
        let text = text
            .replace("{{name}}", name)
            .replace("{{dependencies}}", &dependencies);
        write(&path.join(below), &text)?;
    }
    let mut out = io::stdout().lock();
    let shown = path.display();
    writeln!(
        out,
        "{shown}: run it with `cargo run --release --manifest-path {shown}/Cargo.toml`, and read {shown}/README.md"
    )
    .map_err(Failure::Output)?;
    writeln!(out, "it depends on LUNA {luna}: {known}").map_err(Failure::Output)?;
    Ok(ExitCode::SUCCESS)
}

fn write(path: &Path, text: &str) -> Result<(), Failure> {
    if let Some(parent) = path.parent() {
        fs::create_dir_all(parent).map_err(failed(parent))?;
    }
    fs::write(path, text).map_err(failed(path))
}

/// The package's name, which the folder has.
fn name(path: &Path) -> Result<&str, Failure> {
    let shown = path.file_name().unwrap_or(path.as_os_str());
    let name = shown.to_str().unwrap_or_default();
    let refused = |why: String| {
        let name = shown.to_string_lossy();
        let what = format!("`{name}` cannot be the name of a project");
        Err(unusable(what, why))
    };
    if name.replace('_', "-").starts_with("luna-") {
        return refused(
            "names that begin with `luna-` or `luna_` are those of LUNA's own packages".to_owned(),
        );
    }
    let possible = package_name(name, "my");
    match possible {
        _ if possible == name.replace('_', "-") => Ok(name),
        _ if possible == "my" => {
            refused("use lower-case letters, digits, `-` and `_`, a letter first".to_owned())
        }
        _ if has_empty_part(name) => refused(format!(
            "a `-` or `_` stands between two others, or at the end; `{possible}` can be one"
        )),
        _ => refused(format!(
            "use lower-case letters, digits, `-` and `_`, a letter first, and no word of Rust or Cargo; `{possible}` can be one"
        )),
    }
}

/// Whether all is well but a doubled or a last `-`.
fn has_empty_part(name: &str) -> bool {
    let is_letter = |letter: char| letter.is_ascii_lowercase() || letter.is_ascii_digit();
    let mut parts = name.split(['-', '_']);
    parts.clone().any(str::is_empty) && parts.all(|part| part.chars().all(is_letter))
}

fn dependencies(template: Template, luna: &Luna) -> String {
    let mut lines = format!(
        "\
# `events`: a run can be recorded with what its channels do (LUNA_LOG_EVENTS=65536). `scope`:
# LUNA_SCOPE=1 shows it in the browser.
luna-rt = {{ {}, features = [\"events\", \"scope\"] }}
",
        luna.source("")
    );
    for (package, folder) in template.packages() {
        lines += &format!("{package} = {{ {} }}\n", luna.source(folder));
    }
    lines
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_projects() {
        for good in ["arm", "my_arm-2", "folder/arm", "../arm"] {
            let expected = good.rsplit('/').next().unwrap();
            assert_eq!(name(Path::new(good)).unwrap(), expected);
        }
        for (wrong, advice) in [
            ("Arm", "`arm` can be one"),
            ("my arm", "`my-arm` can be one"),
            ("2-arms", "`my-2-arms` can be one"),
            ("match", "`my-match` can be one"),
            ("test", "`my-test` can be one"),
            ("luna", "`my-luna` can be one"),
            ("luna-plants", "LUNA's own packages"),
            ("luna_plants", "LUNA's own packages"),
            ("Ω", "a letter first"),
            ("..", "a letter first"),
            ("arm-", "at the end; `arm` can be one"),
            ("my--arm", "at the end; `my-arm` can be one"),
            ("my-_arm", "at the end; `my-arm` can be one"),
            ("My--arm", "no word of Rust or Cargo; `my-arm` can be one"),
        ] {
            let error = name(Path::new(wrong)).unwrap_err();
            assert!(error.to_string().ends_with(advice), "{wrong}: {error}");
            assert_eq!(error.exit_code(), 2);
        }
    }
}
