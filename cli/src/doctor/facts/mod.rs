//! Facts about a machine that the doctor alone looks at.

pub(crate) mod command_line;
pub(crate) mod config;
pub(crate) mod cpu_time;
pub(crate) mod interrupts;
pub(crate) mod task;

/// Reads `cpu.rt_runtime_us`-like numbers: one, with white space around it.
pub(crate) fn number(text: &str) -> Option<i64> {
    text.trim().parse().ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers() {
        assert_eq!(number(" 1000000\n"), Some(1_000_000));
        assert_eq!(number("-1"), Some(-1));
        assert_eq!(number(""), None);
    }
}
