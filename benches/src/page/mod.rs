//! The pages of all benches' results: `docs/internals/benchmarks.md` with the goals, and a page for
//! each bench in `docs/internals/benchmarks`, with a table and a plot for each scenario.

mod svg;

use std::{fmt::Write as _, fs, io, path::Path, time::SystemTime};

use serde::{Deserialize, Serialize};

use crate::harness::{LUNA, Row, scenarios};
use svg::{Dot, Line, short};

/// The origin of the figures, for the page's head.
#[derive(Debug, Serialize, Deserialize)]
pub struct Origin {
    /// The lines of [`machine::facts`](crate::machine::facts).
    pub facts: Vec<(String, String)>,
    /// The day when the first bench began.
    pub date: String,
    /// Whether the benches were cut short.
    pub quick: bool,
    /// Seconds of CPU time that a virtual machine's host gave to others meanwhile, and the total.
    pub stolen: Option<(f64, f64)>,
}

/// A bench and its rows.
pub type Found = (&'static str, Vec<Row>);

/// The day of `time`, UTC.
///
/// # Panics
///
/// When the clock is set to before 1970.
pub fn date(time: SystemTime) -> String {
    let since = time.duration_since(SystemTime::UNIX_EPOCH);
    let days = since.expect("the clock is right").as_secs() / 86_400;
    // By eras of 400 years, each of which begins on a 1 March.
    let day = days + 719_468;
    let (era, of_era) = (day / 146_097, day % 146_097);
    let year = (of_era - of_era / 1_460 + of_era / 36_524 - of_era / 146_096) / 365;
    let of_year = of_era - (365 * year + year / 4 - year / 100);
    let month = (5 * of_year + 2) / 153;
    let day = of_year - (153 * month + 2) / 5 + 1;
    let (year, month) = match month {
        0..=9 => (era * 400 + year, month + 3),
        _ => (era * 400 + year + 1, month - 9),
    };
    format!("{year}-{month:02}-{day:02}")
}

/// Writes `benchmarks.md`, and a page for each bench with its plots into the folder `benchmarks`.
///
/// # Errors
///
/// A file cannot be written.
pub fn write(docs: &Path, origin: &Origin, benches: &[Found]) -> io::Result<()> {
    let folder = docs.join("benchmarks");
    match fs::remove_dir_all(&folder) {
        Err(error) if error.kind() != io::ErrorKind::NotFound => return Err(error),
        _ => fs::create_dir_all(&folder)?,
    }
    let mut page = head(origin);
    page += &goals(benches);
    page += "\n## Benches\n\n| bench | what it times |\n| --- | --- |\n";
    for (bench, rows) in benches {
        let mut names = Vec::new();
        let mut of_bench = format!(
            "# {}\n\nAfter reading this page you can compare the figures of the bench `{bench}`. \
             [benchmarks.md](../benchmarks.md) says where they come from.\n",
            capital(bench)
        );
        for scenario in scenarios(rows) {
            let name = &scenario[0].name;
            let _ = write!(of_bench, "\n## {}\n\n{}", capital(name), table(scenario));
            // Two dots say no more than the table.
            if scenario.len() > 2 {
                let file = format!("{bench}-{}.svg", slug(name));
                fs::write(folder.join(&file), plot(scenario))?;
                let _ = write!(of_bench, "\n![{name}]({file})\n");
            }
            names.push(name.as_str());
        }
        fs::write(folder.join(format!("{bench}.md")), of_bench)?;
        let names = names.join("; ");
        let _ = writeln!(page, "| [{bench}](benchmarks/{bench}.md) | {names} |");
    }
    fs::write(docs.join("benchmarks.md"), page)
}

fn head(origin: &Origin) -> String {
    let mut text = "# Benchmarks\n\n\
        After reading this page you can compare LUNA with its peers, and with the machine's own primitives. \
        This page is made by `cargo run --release -p luna-benches --bin all-benches`; \
        [measurements.md](measurements.md) says what such figures do not show.\n\n"
        .to_owned();
    if origin.quick {
        text += "**These figures are of a short run (`--quick`): they show that everything runs, and little else.**\n\n";
    }
    text += "| | |\n| --- | --- |\n";
    let _ = writeln!(text, "| date | {} |", origin.date);
    for (key, value) in &origin.facts {
        let _ = writeln!(text, "| {key} | {value} |");
    }
    if let Some((stolen, all)) = origin.stolen {
        let _ = writeln!(
            text,
            "| taken by the host | {stolen:.1} s of CPU time in {all:.0} s |"
        );
    }
    text += "\nEach figure is the median of the rounds (nine blocks of 100 ms; three for what is expensive to set up); the rows of a bench are \
        measured in turn, round by round. LUNA runs as users run it: a `System` with named processes at the default priority. All without a \
        real-time policy.\n";
    text
}

fn goals(benches: &[Found]) -> String {
    let mut text = String::new();
    for row in benches.iter().flat_map(|(_, rows)| rows) {
        for outcome in &row.goals {
            let size = row.size.map(|size| format!(", {}", grouped(size)));
            let verdict = if outcome.met { "met" } else { "**missed**" };
            let primitives: Vec<String> = outcome
                .primitives
                .iter()
                .map(|(name, times)| format!("{} × {name}", short(*times)))
                .collect();
            let _ = writeln!(
                text,
                "| {}: {}{} | {} {} | {} | {:.2} | {verdict} | {} |",
                row.name,
                row.peer,
                size.unwrap_or_default(),
                short(row.median),
                row.unit,
                outcome.goal,
                outcome.ratio,
                primitives.join(", ")
            );
        }
    }
    if text.is_empty() {
        return text;
    }
    "\n## Goals\n\nGoals in nanoseconds are figures of another machine (AMD EPYC, family 25 model 17): the last column sets them against primitives of \
     this one. Goals that are multiples are judged by the median of the rounds' ratios.\n\n\
     | what | reached | goal | ratio to it | | in primitives of this run |\n| --- | --- | --- | --- | --- | --- |\n"
        .to_owned()
        + &text
}

fn table(scenario: &[Row]) -> String {
    if scenario[0].size.is_some() {
        table_of_sizes(scenario)
    } else {
        table_of_peers(scenario)
    }
}

fn table_of_peers(scenario: &[Row]) -> String {
    let (label, reference) = scenario[0].reference(scenario);
    let mut text = format!(
        "| {} | median | min | {label} |\n| --- | ---: | ---: | ---: |\n",
        scenario[0].unit
    );
    for row in scenario {
        let _ = writeln!(
            text,
            "| {} | {} | {} | {:.2} |",
            strong(row, &row.peer),
            strong(row, &short(row.median)),
            short(row.min),
            row.median / reference.median
        );
    }
    text
}

fn table_of_sizes(scenario: &[Row]) -> String {
    let sizes = sizes(scenario);
    let mut text = format!("| {} |", scenario[0].unit);
    for &size in &sizes {
        let _ = write!(text, " {} |", grouped(size));
    }
    text += "\n| --- |";
    text += &" ---: |".repeat(sizes.len());
    for peer in peers(scenario) {
        let of_peer = || scenario.iter().filter(move |row| row.peer == peer);
        let first = of_peer().next().expect("the peer is one of the rows'");
        let _ = write!(text, "\n| {} |", strong(first, peer));
        for &size in &sizes {
            let row = of_peer().find(|row| row.size == Some(size));
            let figure = row.map(|row| strong(row, &short(row.median)));
            let _ = write!(text, " {} |", figure.unwrap_or_default());
        }
    }
    text + "\n"
}

fn plot(scenario: &[Row]) -> String {
    let (title, unit) = (capital(&scenario[0].name), &scenario[0].unit);
    if scenario[0].size.is_none() {
        let mut rows: Vec<&Row> = scenario.iter().collect();
        rows.sort_by(|one, other| one.median.total_cmp(&other.median));
        let dots: Vec<Dot> = rows
            .iter()
            .map(|row| Dot {
                label: row.peer.clone(),
                figure: row.median,
                ours: is_ours(row),
            })
            .collect();
        return svg::dots(&title, unit, &dots);
    }
    let lines: Vec<Line> = peers(scenario)
        .into_iter()
        .map(|peer| {
            let rows = || scenario.iter().filter(move |row| row.peer == peer);
            Line {
                label: peer.to_owned(),
                points: rows()
                    .map(|row| (row.size.unwrap_or_default() as f64, row.median))
                    .collect(),
                ours: rows().any(is_ours),
            }
        })
        .collect();
    svg::lines(&title, unit, &lines)
}

fn is_ours(row: &Row) -> bool {
    row.peer.starts_with(LUNA)
}

/// In bold, if it is ours.
fn strong(row: &Row, text: &str) -> String {
    if is_ours(row) {
        format!("**{text}**")
    } else {
        text.to_owned()
    }
}

/// The sizes of a scenario, ascending.
fn sizes(scenario: &[Row]) -> Vec<u64> {
    let mut sizes: Vec<u64> = scenario.iter().filter_map(|row| row.size).collect();
    sizes.sort_unstable();
    sizes.dedup();
    sizes
}

/// The peers of a scenario, in the order of their first rows.
fn peers(scenario: &[Row]) -> Vec<&str> {
    let mut peers: Vec<&str> = Vec::new();
    for row in scenario {
        if !peers.contains(&row.peer.as_str()) {
            peers.push(&row.peer);
        }
    }
    peers
}

fn capital(name: &str) -> String {
    let mut letters = name.chars();
    let first = letters
        .next()
        .map(|letter| letter.to_uppercase().to_string());
    first.unwrap_or_default() + letters.as_str()
}

/// A name as part of a file's.
fn slug(name: &str) -> String {
    let words = name.split(|letter: char| !letter.is_ascii_alphanumeric());
    let words: Vec<&str> = words.filter(|word| !word.is_empty()).collect();
    words.join("-").to_lowercase()
}

/// A number with its digits in groups of three.
fn grouped(number: u64) -> String {
    let digits = number.to_string();
    let mut text = String::new();
    for (index, digit) in digits.chars().enumerate() {
        if index > 0 && (digits.len() - index).is_multiple_of(3) {
            text.push(' ');
        }
        text.push(digit);
    }
    text
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;

    #[test]
    fn dates() {
        let at = |days: u64| date(SystemTime::UNIX_EPOCH + Duration::from_secs(days * 86_400 + 5));
        assert_eq!(at(0), "1970-01-01");
        assert_eq!(at(11_016), "2000-02-29");
        assert_eq!(at(11_017), "2000-03-01");
        assert_eq!(at(20_453), "2025-12-31");
        assert_eq!(at(20_454), "2026-01-01");
    }

    #[test]
    fn numbers_and_names() {
        assert_eq!(grouped(1_000_000), "1 000 000");
        assert_eq!(grouped(64), "64");
        assert_eq!(
            slug("rendezvous, two cores, asleep"),
            "rendezvous-two-cores-asleep"
        );
    }

    fn row(peer: &str, size: Option<u64>, median: f64) -> Row {
        let json = serde_json::json!({
            "name": "ring", "peer": peer, "unit": "ns/hop", "size": size, "median": median, "min": median, "samples": 3
        });
        serde_json::from_value(json).unwrap()
    }

    #[test]
    fn sizes_are_columns() {
        let rows = [
            row("LUNA", Some(10), 5.0),
            row("LUNA", Some(1_000), 6.0),
            row("tokio", Some(1_000), 70.0),
        ];
        let table = table(&rows);
        assert_eq!(
            table,
            "| ns/hop | 10 | 1 000 |\n| --- | ---: | ---: |\n| **LUNA** | **5** | **6** |\n| tokio |  | 70 |\n"
        );
    }

    #[test]
    fn the_pages_are_written_with_their_plots() {
        let docs = std::env::temp_dir().join(format!("luna-page-{}", std::process::id()));
        let origin = Origin {
            facts: vec![("kernel".to_owned(), "Linux".to_owned())],
            date: "2026-01-01".to_owned(),
            quick: true,
            stolen: Some((0.5, 20.0)),
        };
        let rows = vec![
            row("LUNA", None, 5.0),
            row("tokio", None, 70.0),
            row("smol", None, 90.0),
        ];
        fs::create_dir_all(&docs).unwrap();
        let written = write(&docs, &origin, &[("ring", rows)]);
        let page = fs::read_to_string(docs.join("benchmarks.md"));
        let of_bench = fs::read_to_string(docs.join("benchmarks/ring.md"));
        let plot = fs::read_to_string(docs.join("benchmarks/ring-ring.svg"));
        fs::remove_dir_all(&docs).unwrap();
        written.unwrap();
        let page = page.unwrap();
        assert!(
            page.contains("short run") && page.contains("| kernel | Linux |"),
            "{page}"
        );
        assert!(page.contains("(benchmarks/ring.md)"), "{page}");
        let of_bench = of_bench.unwrap();
        assert!(
            of_bench.contains("| smol |") && of_bench.contains("(ring-ring.svg)"),
            "{of_bench}"
        );
        assert!(plot.unwrap().ends_with("</svg>\n"));
    }
}
