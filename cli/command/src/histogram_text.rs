//! A histogram of durations for the terminal.

use std::fmt::Write;

/// The length of the longest bar.
const BAR: u64 = 48;
/// The bins of one power of ten begin at these tenths of it. Even on a logarithmic scale, roughly,
/// so that a long tail stays in sight.
const STEPS: [u64; 6] = [10, 15, 20, 30, 50, 70];

/// Values from `from` up to, but not including, `to`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Bin {
    from: u64,
    to: u64,
    count: u64,
}

/// Draws durations (ns) with their counts, in any order: a line for each bin from the shortest to
/// the longest, empty ones between too.
///
/// Bars are in proportion, but whatever happened has a mark. Nothing gives an empty text.
pub(crate) fn draw(values: impl Iterator<Item = (u64, u64)>) -> String {
    let bins = bins(values);
    let most = bins.iter().map(|bin| bin.count).max().unwrap_or(0).max(1);
    let mut text = String::new();
    for Bin { from, to, count } in bins {
        let length = (u128::from(count) * u128::from(BAR)).div_ceil(u128::from(most)) as usize;
        let bar = "#".repeat(length);
        // Writing to a string cannot fail.
        let _ = writeln!(
            text,
            "{:>9} to {:<9} {count:>9} {bar}",
            duration(from),
            duration(to)
        );
    }
    text.lines()
        .map(|line| format!("{}\n", line.trim_end()))
        .collect()
}

fn bins(values: impl Iterator<Item = (u64, u64)>) -> Vec<Bin> {
    let mut bins: Vec<Bin> = Vec::new();
    for (value, count) in values.filter(|(_, count)| *count > 0) {
        let (from, to) = edges(value);
        match bins.binary_search_by_key(&from, |bin| bin.from) {
            Ok(place) => bins[place].count += count,
            Err(place) => bins.insert(place, Bin { from, to, count }),
        }
    }
    // Fill the gaps: each bin begins where the one before ends.
    let mut filled: Vec<Bin> = Vec::new();
    for bin in bins {
        while let Some(last) = filled.last().filter(|last| last.to < bin.from) {
            let (from, to) = edges(last.to);
            filled.push(Bin { from, to, count: 0 });
        }
        filled.push(bin);
    }
    filled
}

/// The bin that holds `value`. Below 100 ns there is but one.
fn edges(value: u64) -> (u64, u64) {
    if value < 100 {
        return (0, 100);
    }
    let decade = 10_u64.pow(value.ilog10() - 1);
    let next = |step: usize| {
        STEPS
            .get(step)
            .map_or(decade.saturating_mul(100), |tenths| {
                tenths.saturating_mul(decade)
            })
    };
    let step = STEPS.partition_point(|tenths| tenths.saturating_mul(decade) <= value) - 1;
    (next(step), next(step + 1))
}

/// In the unit that leaves one to three digits before the point.
pub(crate) fn duration(nanoseconds: u64) -> String {
    let value = nanoseconds as f64;
    let (scaled, unit) = match nanoseconds {
        0..1_000 => (value, "ns"),
        1_000..1_000_000 => (value / 1e3, "µs"),
        1_000_000..1_000_000_000 => (value / 1e6, "ms"),
        _ => (value / 1e9, "s"),
    };
    // Three digits that count, no zeros after the point.
    let decimals = if scaled < 10.0 {
        2
    } else {
        usize::from(scaled < 100.0)
    };
    let text = format!("{scaled:.decimals$}");
    let text = if text.contains('.') {
        text.trim_end_matches('0').trim_end_matches('.')
    } else {
        &text
    };
    format!("{text} {unit}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nothing_is_empty() {
        assert_eq!(draw(std::iter::empty()), "");
        assert_eq!(draw([(5, 0)].into_iter()), "");
    }

    #[test]
    fn looks_as_it_should() {
        let text = draw(
            [
                (12_000, 1),
                (21_000, 96),
                (16_000, 48),
                (33, 1),
                (19_999, 48),
                (71_000, 2),
            ]
            .into_iter(),
        );
        let lines: Vec<&str> = text.lines().collect();
        assert_eq!(lines[0], "     0 ns to 100 ns            1 #");
        assert_eq!(lines[1], "   100 ns to 150 ns            0");
        let tail = [
            "    10 µs to 15 µs             1 #",
            "    15 µs to 20 µs            96 ################################################",
            "    20 µs to 30 µs            96 ################################################",
            "    30 µs to 50 µs             0",
            "    50 µs to 70 µs             0",
            "    70 µs to 100 µs            2 #",
        ];
        assert_eq!(lines[lines.len() - 6..], tail);
    }

    #[test]
    fn every_value_is_in_its_bin_and_none_is_lost() {
        let values: Vec<u64> = (0..64)
            .flat_map(|bit| [(1_u64 << bit) - 1, 1 << bit, (1 << bit) + 1])
            .chain([u64::MAX - 1])
            .collect();
        for &value in &values {
            let (from, to) = edges(value);
            assert!(from <= value && value < to, "{value} in {from} to {to}");
        }
        let bins = bins(values.iter().map(|value| (*value, 2)));
        assert_eq!(
            bins.iter().map(|bin| bin.count).sum::<u64>(),
            2 * values.len() as u64
        );
        assert!(bins.windows(2).all(|pair| pair[0].to == pair[1].from));
    }

    #[test]
    fn bars_are_in_proportion_and_never_missing() {
        let text = draw([(1_000, 1), (2_000, 1_000_000), (3_000, 500_000)].into_iter());
        let bars: Vec<usize> = text.lines().map(|line| line.matches('#').count()).collect();
        assert_eq!(bars, [1, 0, 48, 24]);
    }

    #[test]
    fn durations_read_well() {
        for (nanoseconds, text) in [
            (0, "0 ns"),
            (999, "999 ns"),
            (1_000, "1 µs"),
            (1_234, "1.23 µs"),
            (15_040, "15 µs"),
            (150_000, "150 µs"),
            (2_500_000, "2.5 ms"),
            (3_000_000_000, "3 s"),
        ] {
            assert_eq!(duration(nanoseconds), text);
        }
    }
}
