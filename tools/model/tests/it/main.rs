//! Tests of models. One program; a module a subject.

mod cspm;
mod drawing;
mod errors;
mod examples;
mod generation;
mod random;
mod random_networks;
mod schedule;
mod verdicts;

/// Writes a line to standard error itself, since the harness captures what a macro prints.
fn say(text: &str) {
    use std::io::Write;
    let _ = writeln!(std::io::stderr(), "{text}");
}

/// Says that the calling test cannot run here.
fn skip(why: &str) {
    let thread = std::thread::current();
    say(&format!(
        "skipped: {}: {why}",
        thread.name().unwrap_or("a test")
    ));
}

fn number(variable: &str) -> Option<u64> {
    std::env::var(variable).ok()?.parse().ok()
}

/// LUNA_SEED from the environment, else one of the clock. It is printed.
fn seed() -> u64 {
    let seed = number("LUNA_SEED").unwrap_or_else(|| {
        let since = std::time::UNIX_EPOCH.elapsed();
        since.map_or(1, |since| since.as_nanos() as u64)
    });
    println!("LUNA_SEED={seed}");
    seed
}

fn is_long() -> bool {
    std::env::var("LUNA_LONG").is_ok_and(|long| long == "1")
}
