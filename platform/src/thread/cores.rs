//! Lists of cores, as the kernel writes them.

/// Reads a list of cores or nodes as the kernel writes it, `0-3,8,10-11`; an empty one is a list
/// without members.
///
/// Ascending, without doubles. `None` if it is no such list: a range backwards, a number above
/// 65535, or anything else.
///
/// ```
/// use luna_platform::thread::core_list;
///
/// assert_eq!(core_list("0-3,8,10-11\n"), Some(vec![0, 1, 2, 3, 8, 10, 11]));
/// assert_eq!(core_list("\n"), Some(vec![]));
/// assert_eq!(core_list("3-1"), None);
/// ```
pub fn core_list(text: &str) -> Option<Vec<usize>> {
    let text = text.trim();
    // Some kernels write `(null)` for a mask that was never made.
    if text.is_empty() || text == "(null)" {
        return Some(Vec::new());
    }
    let mut cores = Vec::new();
    for part in text.split(',') {
        let (first, last) = part.split_once('-').unwrap_or((part, part));
        // Sixteen bits: no kernel has more cores, and a mistaken range takes little memory.
        let (first, last) = (
            first.trim().parse::<u16>().ok()?,
            last.trim().parse::<u16>().ok()?,
        );
        if first > last {
            return None;
        }
        cores.extend((first..=last).map(usize::from));
    }
    cores.sort_unstable();
    cores.dedup();
    Some(cores)
}

/// Writes ascending numbers as the kernel does; `none` if there are none.
///
/// ```
/// assert_eq!(luna_platform::thread::write_core_list(&[0, 1, 2, 5, 7, 8]), "0-2,5,7-8");
/// ```
pub fn write_core_list(cores: &[usize]) -> String {
    if cores.is_empty() {
        return "none".to_owned();
    }
    let parts = cores.chunk_by(|before, after| *after == before.saturating_add(1));
    let parts = parts.map(|run| match run {
        [first, .., last] => format!("{first}-{last}"),
        _ => run.iter().map(usize::to_string).collect(),
    });
    parts.collect::<Vec<_>>().join(",")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lists_with_gaps_and_without_order() {
        for (text, cores) in [
            ("0", vec![0]),
            ("0-1\n", vec![0, 1]),
            ("0-3,8,10-11", vec![0, 1, 2, 3, 8, 10, 11]),
            ("4,0-1,1", vec![0, 1, 4]),
            ("", vec![]),
            (" (null)\n", vec![]),
            ("0-255", (0..256).collect()),
        ] {
            assert_eq!(core_list(text), Some(cores), "{text:?}");
        }
    }

    #[test]
    fn no_lists() {
        for text in [
            "x",
            "1-",
            "-1",
            "1,,2",
            "3-1",
            "1-2-3",
            "0-4294967295",
            "0:3",
            "1 2",
        ] {
            assert_eq!(core_list(text), None, "{text:?}");
        }
    }

    #[test]
    fn lists_and_back() {
        for text in ["0", "0-1", "0,2", "0-3,8,10-11", "5,7-9"] {
            assert_eq!(write_core_list(&core_list(text).unwrap()), text);
        }
        assert_eq!(write_core_list(&[]), "none");
    }
}
