//! Finds the declared name that is nearest to an unknown one.

/// The name that is nearest to `wrong`, if one is near: fewest letters to insert, leave out,
/// replace, or exchange for their neighbour.
pub(super) fn nearest<'a>(
    wrong: &str,
    names: impl IntoIterator<Item = &'a str>,
) -> Option<&'a str> {
    let wrong: Vec<char> = wrong.chars().take(MAX).collect();
    let most = 2.max(wrong.len() / 3);
    names
        .into_iter()
        .map(|name| (distance(&wrong, name), name))
        .filter(|(distance, _)| *distance <= most)
        .min_by_key(|(distance, _)| *distance)
        .map(|(_, name)| name)
}

/// Longer names are compared as far as this.
const MAX: usize = 100;

fn distance(one: &[char], other: &str) -> usize {
    let other: Vec<char> = other.chars().take(MAX).collect();
    let mut before = Vec::new();
    let mut row: Vec<usize> = (0..=other.len()).collect();
    for (i, a) in one.iter().enumerate() {
        let mut next = vec![i + 1];
        for (j, b) in other.iter().enumerate() {
            let mut least = (row[j] + usize::from(a != b))
                .min(row[j + 1] + 1)
                .min(next[j] + 1);
            if i > 0 && j > 0 && *a == other[j - 1] && one[i - 1] == *b {
                let before: &Vec<usize> = &before;
                least = least.min(before[j - 1] + 1);
            }
            next.push(least);
        }
        before = std::mem::replace(&mut row, next);
    }
    row[other.len()]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_nearest_is_found_and_nobody_far_away() {
        let names = ["pan/kp", "pan/kd", "tilt/kp", "limits/speed"];
        for (wrong, meant) in [
            ("pan/pk", Some("pan/kp")),
            ("pan/kdd", Some("pan/kd")),
            ("titl/kp", Some("tilt/kp")),
            ("limit/sped", Some("limits/speed")),
            ("camera", None),
            ("", None),
        ] {
            assert_eq!(nearest(wrong, names), meant, "{wrong}");
        }
    }
}
