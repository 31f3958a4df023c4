//! `/proc/stat`: where the cores' time went.

/// The time of all cores together since the machine started, in ticks of the kernel's clock for
/// users.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(crate) struct CpuTime {
    /// All of it.
    pub(crate) total: u64,
    /// In which a virtual core could have run, and the hypervisor ran another.
    pub(crate) stolen: u64,
}

impl CpuTime {
    /// What has been added since `earlier`.
    pub(crate) fn since(self, earlier: CpuTime) -> CpuTime {
        CpuTime {
            total: self.total.saturating_sub(earlier.total),
            stolen: self.stolen.saturating_sub(earlier.stolen),
        }
    }

    /// Which part of it was stolen, 0 to 1; nothing if no time has passed.
    pub(crate) fn stolen_share(self) -> Option<f64> {
        (self.total > 0).then(|| self.stolen as f64 / self.total as f64)
    }
}

/// Reads the line of all cores in `/proc/stat`. `None` where it is missing or has no eight columns.
pub(crate) fn cpu_time(text: &str) -> Option<CpuTime> {
    let line = text.lines().find_map(|line| line.strip_prefix("cpu "))?;
    // user nice system idle iowait irq softirq steal; guest times follow, and are within user and
    // nice.
    let columns: Option<Vec<u64>> = line
        .split_whitespace()
        .take(8)
        .map(|word| word.parse().ok())
        .collect();
    let columns = columns.filter(|columns| columns.len() == 8)?;
    Some(CpuTime {
        total: columns.iter().fold(0, |sum, one| sum.saturating_add(*one)),
        stolen: columns[7],
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_line_of_all_cores() {
        let text = "cpu  193220 1592 7082 25973 244 0 39 1451 7 8\ncpu0 1 2 3 4 5 6 7 8 9 10\n";
        let time = cpu_time(text).unwrap();
        assert_eq!((time.total, time.stolen), (229_601, 1451));
        for bad in [
            "",
            "cpu0 1 2 3 4 5 6 7 8\n",
            "cpu 1 2 3\n",
            "cpu 1 2 3 4 5 6 7 x\n",
        ] {
            assert_eq!(cpu_time(bad), None, "{bad:?}");
        }
        assert_eq!(time.since(time).stolen_share(), None);
        let before = cpu_time("cpu 10 0 0 90 0 0 0 5 0 0\n").unwrap();
        let after = cpu_time("cpu 10 0 0 185 0 0 0 10 0 0\n").unwrap();
        assert_eq!(after.since(before).stolen_share(), Some(0.05));
    }

    #[test]
    fn sums_do_not_overflow() {
        let most = u64::MAX;
        let time = cpu_time(&format!("cpu {most} {most} 0 0 0 0 0 {most}\n")).unwrap();
        assert_eq!((time.total, time.stolen), (most, most));
    }
}
