//! `/proc/interrupts` and masks of cores.

/// One line of `/proc/interrupts`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Interrupt {
    /// Its number, or the kernel's letters for those without one (`LOC`, `RES`).
    pub(crate) id: String,
    /// How often it came since the machine started: (core, count), for the cores that the table
    /// has.
    pub(crate) counts: Vec<(usize, u64)>,
    /// What it is of.
    pub(crate) name: String,
}

impl Interrupt {
    /// Whether it is of a device, and so has an affinity: it has a number.
    pub(crate) fn is_of_a_device(&self) -> bool {
        self.id.parse::<u32>().is_ok()
    }

    /// How often it came to `core`.
    pub(crate) fn on(&self, core: usize) -> u64 {
        let count = self.counts.iter().find(|(one, _)| *one == core);
        count.map_or(0, |(_, count)| *count)
    }
}

/// Reads `/proc/interrupts`. Lines of another form (`ERR:`, a column short) keep what they have;
/// `None` if the heading names no core.
pub(crate) fn interrupts(text: &str) -> Option<Vec<Interrupt>> {
    let mut lines = text.lines();
    let cores = lines.next()?.split_whitespace();
    let cores: Option<Vec<usize>> = cores
        .map(|core| core.strip_prefix("CPU")?.parse().ok())
        .collect();
    let cores = cores.filter(|cores| !cores.is_empty())?;
    let interrupts = lines.filter_map(|line| {
        let (id, rest) = line.split_once(':')?;
        let mut words = rest.split_whitespace().peekable();
        let mut counts = Vec::new();
        for &core in &cores {
            let Some(count) = words.peek().and_then(|word| word.parse().ok()) else {
                break;
            };
            words.next();
            counts.push((core, count));
        }
        Some(Interrupt {
            id: id.trim().to_owned(),
            counts,
            name: words.collect::<Vec<_>>().join(" "),
        })
    });
    Some(interrupts.collect())
}

/// Reads a mask of cores as the kernel writes it, `ff,00000001`: groups of 32 bits in hexadecimal,
/// the highest first. Ascending.
pub(crate) fn core_mask(text: &str) -> Option<Vec<usize>> {
    let groups: Option<Vec<u32>> = text
        .trim()
        .split(',')
        .map(|group| u32::from_str_radix(group, 16).ok())
        .collect();
    let mut cores = Vec::new();
    for (position, group) in groups?.into_iter().rev().enumerate() {
        let bits = (0..32).filter(|bit| group & (1 << bit) != 0);
        cores.extend(bits.map(|bit| 32 * position + bit));
    }
    Some(cores)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_table_with_gaps_and_short_lines() {
        let text =
            "  CPU0  CPU2\n  1:  10  20  IO-APIC 1-edge  keyboard\nERR:  0\n 9: 5\nnothing\n";
        let all = interrupts(text).unwrap();
        assert_eq!(all.len(), 3);
        assert!(all[0].is_of_a_device() && !all[1].is_of_a_device());
        assert_eq!(
            (all[0].on(0), all[0].on(1), all[0].on(2), &*all[0].name),
            (10, 0, 20, "IO-APIC 1-edge keyboard")
        );
        assert_eq!((all[1].id.as_str(), all[1].counts.len()), ("ERR", 1));
        assert_eq!((all[2].on(0), all[2].on(2)), (5, 0));
        for bad in ["", "\n", "CPU0 x\n", "CPUx\n"] {
            assert_eq!(interrupts(bad), None, "{bad:?}");
        }
    }

    #[test]
    fn masks() {
        assert_eq!(core_mask("00000000,00000000"), Some(vec![]));
        assert_eq!(core_mask("f0"), Some(vec![4, 5, 6, 7]));
        assert_eq!(core_mask("1,00000002"), Some(vec![1, 32]));
        for bad in ["", ",", "1,,1", "123456789", "-1"] {
            assert_eq!(core_mask(bad), None, "{bad:?}");
        }
    }
}
