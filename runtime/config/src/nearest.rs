//! Finds the declared name that is nearest to an unknown one.

/// The name that is nearest to `wrong`, if one is near: fewest letters to insert, leave out,
/// replace, or exchange for their neighbour.
pub(crate) fn nearest<'a>(
    wrong: &str,
    names: impl IntoIterator<Item = &'a str>,
) -> Option<&'a str> {
    let most = 2.max(wrong.chars().count() / 3);
    names
        .into_iter()
        .map(|name| (strsim::osa_distance(wrong, name), name))
        .filter(|(distance, _)| *distance <= most)
        .min_by_key(|(distance, _)| *distance)
        .map(|(_, name)| name)
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
