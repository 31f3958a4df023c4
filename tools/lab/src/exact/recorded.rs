//! The recorded figures: `recorded.txt`, which the gate compares with.

use super::rows;
use std::collections::BTreeMap;
use std::fmt::Write;
use std::path::PathBuf;
use std::{fs, io};

/// The latencies of a row, in µs.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Figures {
    /// The median, where the program gives it.
    pub(crate) p50: Option<f64>,
    /// 99 of 100 are no longer.
    pub(crate) p99: Option<f64>,
    /// The longest.
    pub(crate) max: f64,
}

/// Figures, and what they were taken with.
#[derive(Debug, Default, Clone, PartialEq)]
pub(crate) struct Recorded {
    /// The compiler of the measured programs.
    pub(crate) compiler: String,
    /// The guest's kernel.
    pub(crate) kernel: String,
    /// The emulator.
    pub(crate) qemu: String,
    /// By the rows' names.
    pub(crate) figures: BTreeMap<String, Figures>,
}

const HEAD: &str = "\
# Wake-up latencies in exact time, in µs. Written by `cargo run -p luna-lab -- exact record`;
# docs/internals/laboratory.md says what is measured, and when these figures may change.
";

/// Where it is, in the sources that this program was built from.
pub(crate) fn path() -> PathBuf {
    PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/recorded.txt"))
}

impl Recorded {
    /// Reads the file; without a file nothing is recorded.
    ///
    /// # Errors
    ///
    /// The file cannot be read, or has a malformed line.
    pub(crate) fn load() -> Result<Recorded, String> {
        let text = match fs::read_to_string(path()) {
            Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(Self::default()),
            read => read.map_err(|error| format!("{}: {error}", path().display()))?,
        };
        Self::parse(&text)
    }

    fn parse(text: &str) -> Result<Recorded, String> {
        let mut recorded = Recorded::default();
        for line in text.lines() {
            if line.starts_with('#') || line.trim().is_empty() {
                continue;
            }
            if let Some(compiler) = line.strip_prefix("compiler: ") {
                recorded.compiler = compiler.to_owned();
            } else if let Some(kernel) = line.strip_prefix("kernel: ") {
                recorded.kernel = kernel.to_owned();
            } else if let Some(qemu) = line.strip_prefix("emulator: ") {
                recorded.qemu = qemu.to_owned();
            } else {
                let (name, figures) =
                    figures(line).ok_or_else(|| format!("no latencies: {line}"))?;
                recorded.figures.insert(name, figures);
            }
        }
        Ok(recorded)
    }

    /// Writes the file.
    ///
    /// # Errors
    ///
    /// When it cannot be written.
    pub(crate) fn save(&self) -> Result<(), String> {
        fs::write(path(), self.print()).map_err(|error| format!("{}: {error}", path().display()))
    }

    fn print(&self) -> String {
        let mut text = format!(
            "{HEAD}compiler: {}\nkernel: {}\nemulator: {}\n\n#    p50       p99       max   row\n",
            self.compiler, self.kernel, self.qemu
        );
        for row in rows::all().rows() {
            if let Some(Figures { p50, p99, max }) = self.figures.get(row.name) {
                let shown =
                    |figure: Option<f64>| figure.map_or("-".to_owned(), |it| format!("{it:.2}"));
                let (p50, p99, name) = (shown(*p50), shown(*p99), row.name);
                writeln!(text, "{p50:>8} {p99:>9} {max:>9.2}   {name}")
                    .expect("a string takes all");
            }
        }
        text
    }

    /// Why these figures are none for the machine of the others.
    pub(crate) fn is_of_another(&self, measured: &Recorded) -> Option<String> {
        let pairs = [
            (&self.compiler, &measured.compiler),
            (&self.kernel, &measured.kernel),
            (&self.qemu, &measured.qemu),
        ];
        let (old, now) = pairs.into_iter().find(|(old, now)| old != now)?;
        if old.is_empty() {
            return Some("nothing is recorded".to_owned());
        }
        Some(format!(
            "the figures are recorded for {old}, and this is {now}"
        ))
    }
}

/// Reads `P50 P99 MAX NAME`.
fn figures(line: &str) -> Option<(String, Figures)> {
    let mut rest = line.trim();
    let mut next = || {
        let (word, after) = rest.split_once(' ')?;
        rest = after.trim_start();
        Some(word)
    };
    let optional = |word: &str| match word {
        "-" => Some(None),
        word => word.parse().ok().map(Some),
    };
    let figures = Figures {
        p50: optional(next()?)?,
        p99: optional(next()?)?,
        max: next()?.parse().ok()?,
    };
    Some((rest.to_owned(), figures))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn example() -> Recorded {
        let figures = |p50, p99, max| Figures { p50, p99, max };
        Recorded {
            compiler: "rustc 1.95.0".to_owned(),
            kernel: "6.1.0-56-rt-amd64".to_owned(),
            qemu: "QEMU emulator version 7.2.22".to_owned(),
            figures: BTreeMap::from([
                (
                    "luna jitter".to_owned(),
                    figures(Some(8.96), Some(10.88), 11.39),
                ),
                (
                    "hackbench: cyclictest, 10 kHz".to_owned(),
                    figures(None, None, 13.0),
                ),
            ]),
        }
    }

    #[test]
    fn what_is_written_is_read_again() {
        let recorded = example();
        assert_eq!(Recorded::parse(&recorded.print()).unwrap(), recorded);
    }

    #[test]
    fn a_line_without_figures_is_refused() {
        for line in [
            "8.96 luna jitter",
            "8.96 10.88 long luna jitter",
            "luna jitter",
            "1 2 -  x",
        ] {
            assert!(Recorded::parse(line).is_err(), "{line}");
        }
    }

    #[test]
    fn figures_of_another_kernel_are_not_compared() {
        let recorded = example();
        assert_eq!(recorded.is_of_another(&example()), None);
        let newer = Recorded {
            kernel: "6.12.0-1-rt-amd64".to_owned(),
            ..example()
        };
        let said = recorded.is_of_another(&newer).unwrap();
        assert!(
            said.contains("6.1.0-56-rt-amd64") && said.contains("6.12.0-1"),
            "{said}"
        );
        assert!(
            Recorded::default()
                .is_of_another(&newer)
                .unwrap()
                .contains("nothing")
        );
    }

    #[test]
    fn the_file_in_the_repository_has_all_rows() {
        let recorded = Recorded::load().unwrap();
        for row in rows::all().rows() {
            assert!(
                recorded.figures.contains_key(row.name),
                "{} is not recorded",
                row.name
            );
        }
    }
}
