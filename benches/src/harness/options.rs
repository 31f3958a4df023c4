//! A bench's command line.

use std::time::Duration;

use super::Case;

/// The options of the command line.
#[derive(Debug, Default, PartialEq)]
pub(super) struct Options {
    pub(super) quick: bool,
    pub(super) filter: String,
    /// One block of one case, for which this process was started: its title, and the number of
    /// operations.
    pub(super) apart: Option<(String, u64)>,
}

impl Options {
    /// Those of this program.
    pub(super) fn of_program() -> Result<Self, String> {
        Self::parse(std::env::args().skip(1))
    }

    pub(super) fn parse(arguments: impl IntoIterator<Item = String>) -> Result<Self, String> {
        let mut options = Options::default();
        let mut by_cargo_bench = false;
        let mut arguments = arguments.into_iter();
        while let Some(argument) = arguments.next() {
            match argument.as_str() {
                "--quick" => options.quick = true,
                "--filter" => options.filter = arguments.next().ok_or("--filter needs a text")?,
                "--bench" => by_cargo_bench = true,
                "--apart" => {
                    let title = arguments.next().ok_or("--apart needs a title")?;
                    let count = arguments.next().and_then(|count| count.parse().ok());
                    options.apart = Some((title, count.ok_or("--apart needs a count")?));
                }
                _ => return Err(format!("unknown argument {argument}")),
            }
        }
        // `cargo test --benches` runs the program too, for the checks, not the figures.
        options.quick |= !by_cargo_bench;
        Ok(options)
    }

    pub(super) fn wants(&self, case: &Case) -> bool {
        let text = case.title().to_lowercase();
        text.contains(&self.filter.to_lowercase())
    }

    pub(super) fn blocks(&self) -> usize {
        if self.quick { 3 } else { 9 }
    }

    pub(super) fn block_length(&self) -> Duration {
        Duration::from_millis(if self.quick { 10 } else { 100 })
    }
}

/// Whether this run is short: a bench then leaves out its largest sizes.
pub fn is_quick() -> bool {
    Options::of_program().is_ok_and(|options| options.quick)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parse(arguments: &[&str]) -> Result<Options, String> {
        Options::parse(arguments.iter().map(|&argument| argument.to_owned()))
    }

    #[test]
    fn options() {
        assert!(!parse(&["--bench"]).unwrap().quick);
        assert!(parse(&["--bench", "--quick"]).unwrap().quick);
        assert!(parse(&[]).unwrap().quick, "not called by cargo bench");
        assert_eq!(parse(&["--filter", "tokio"]).unwrap().filter, "tokio");
        assert!(parse(&["--filter"]).is_err());
        assert!(parse(&["--quack"]).is_err());
        let apart = parse(&["--apart", "ring, LUNA, 10", "7"]).unwrap().apart;
        assert_eq!(apart, Some(("ring, LUNA, 10".to_owned(), 7)));
        assert!(parse(&["--apart", "ring, LUNA, 10"]).is_err());
    }

    #[test]
    fn filter_knows_name_and_peer() {
        let options = parse(&["--filter", "TOKIO"]).unwrap();
        let case = |peer| Case::new("commstime", peer, "ns/cycle", |_| Duration::ZERO);
        assert!(options.wants(&case("tokio mpsc(1)")));
        assert!(!options.wants(&case("smol")));
    }
}
