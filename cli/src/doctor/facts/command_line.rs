//! The kernel's command line (`/proc/cmdline`), as it was booted with.

use luna_machine::facts::parse::core_list;

/// The value of `key=value`; the last one counts. `None` if there is no such word.
pub(crate) fn value<'a>(command_line: &'a str, key: &str) -> Option<&'a str> {
    let mut values = command_line
        .split_whitespace()
        .filter_map(|word| word.strip_prefix(key)?.strip_prefix('='));
    values.next_back()
}

/// Whether the word itself is there, without a value.
pub(crate) fn has(command_line: &str, word: &str) -> bool {
    command_line.split_whitespace().any(|one| one == word)
}

/// The cores of `key=cores`, such as `rcu_nocbs=2-3` or `isolcpus=managed_irq,domain,2-3`, with
/// leading words skipped. `None` if there is no such word or its value is no list; `Some` of an
/// empty list for `key` without a value.
pub(crate) fn cores(command_line: &str, key: &str, count: usize) -> Option<Vec<usize>> {
    let value = value(command_line, key)?;
    let list = value.split(',').skip_while(|part| {
        part.starts_with(|first: char| first.is_ascii_lowercase()) && *part != "all"
    });
    let last = count.saturating_sub(1).to_string();
    // `N` is the last core there can be, `all` are all.
    let list: Vec<String> = list
        .map(|part| match part {
            "all" => format!("0-{last}"),
            part => part.replace('N', &last),
        })
        .collect();
    core_list(&list.join(","))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_last_value_counts() {
        assert_eq!(value("a=1 b=2 a=3", "a"), Some("3"));
        assert_eq!(value("ab=1", "a"), None);
        assert_eq!(value("", "a"), None);
        assert_eq!(value("quiet nosmt=force nosmt=", "nosmt"), Some(""));
        assert_eq!(value("quiet", "quiet"), None);
        assert!(has("ro threadirqs", "threadirqs"));
    }

    #[test]
    fn lists_behind_words() {
        for (line, cores_of) in [
            ("isolcpus=1", Some(vec![1])),
            ("isolcpus=managed_irq,domain,2-3,5", Some(vec![2, 3, 5])),
            ("isolcpus=all", Some(vec![0, 1, 2, 3])),
            ("isolcpus=2-N", Some(vec![2, 3])),
            ("isolcpus=nohz,domain,1-2", Some(vec![1, 2])),
            ("isolcpus=domain", Some(vec![])),
            ("isolcpus=", Some(vec![])),
            ("isolcpus=1-x", None),
            ("isolcpus=3-1", None),
            ("isolcpus=1:2", None),
            ("quiet", None),
        ] {
            assert_eq!(cores(line, "isolcpus", 4), cores_of, "{line}");
        }
    }
}
