//! A survey as text for people.

use super::survey::{Board, Channel, Program, Side, Survey, Thread};
use crate::columns::of_rows;
use crate::text::Count;

/// No value or type is shown longer.
const WIDEST: usize = 40;

/// All tables that have rows, and what they leave out.
pub(super) fn draw(survey: &Survey) -> String {
    let mut tables = Vec::new();
    if !survey.programs.is_empty() {
        let head = ["PID", "PROGRAM", "SYSTEM", "THREADS"];
        let rows = survey.programs.iter().flat_map(program);
        tables.push(of_rows(head, &[0], rows));
    }
    if !survey.channels.is_empty() {
        let head = ["CHANNEL", "TYPE", "FROM", "TO", "VALUES", "PER S", "STATE"];
        let rows = survey.channels.iter().map(channel);
        tables.push(of_rows(head, &[4, 5], rows));
    }
    if !survey.blackboards.is_empty() {
        let head = [
            "BLACKBOARD",
            "TYPE",
            "FROM",
            "TO",
            "VALUES",
            "PER S",
            "AGE",
            "VALUE",
        ];
        let rows = survey.blackboards.iter().flat_map(board);
        tables.push(of_rows(head, &[4, 5, 6], rows));
    }
    if tables.is_empty() {
        tables.push("nothing is there: no channel, blackboard or announced system\n".to_owned());
    }
    tables.join("\n") + &notes(survey)
}

fn notes(survey: &Survey) -> String {
    let mut text = String::new();
    if survey.left_behind > 0 {
        let names = Count(survey.left_behind as u64, "name");
        text += &format!(
            "\n{names} of programs that were killed: --clean-up removes their files, and so does their next opening\n"
        );
    }
    if survey.hidden > 0 {
        text += &format!(
            "\n{} not to be looked at: of other users (sudo -u USER luna list), or of another version\n",
            Count(survey.hidden as u64, "file")
        );
    }
    text
}

/// A row for each system of it, or one without.
fn program(program: &Program) -> Vec<[String; 4]> {
    let row = |system: String, threads: String| {
        let pid = program.pid.to_string();
        [pid, program.program.clone(), system, threads]
    };
    let of_systems = program.systems.iter().map(|system| {
        let threads: Vec<String> = system.threads.iter().map(thread).collect();
        let addresses = system.addresses.iter();
        let addresses = addresses.map(|(what, address)| format!("{what} {address}"));
        let all: Vec<String> = threads.into_iter().chain(addresses).collect();
        row(system.name.clone(), all.join("; "))
    });
    let mut rows: Vec<[String; 4]> = of_systems.collect();
    if rows.is_empty() {
        rows.push(row("-".to_owned(), "-".to_owned()));
    }
    rows
}

fn thread(thread: &Thread) -> String {
    let core = match thread.core {
        Some(core) => format!(" core {core}"),
        None => String::new(),
    };
    format!(
        "{} {}{core}, {}",
        thread.name,
        thread.policy,
        Count(thread.processes as u64, "process")
    )
}

/// By its system, if that is announced.
fn side(side: Option<&Side>) -> String {
    let Some(side) = side else {
        return "-".to_owned();
    };
    let name = match side.systems.is_empty() {
        true => side.program.clone().unwrap_or_else(|| "?".to_owned()),
        false => side.systems.join(","),
    };
    match side.pid {
        Some(pid) => format!("{name} ({pid})"),
        None => name,
    }
}

fn rate(per_second: Option<f64>) -> String {
    per_second.map_or("-".to_owned(), |rate| format!("{rate:.1}"))
}

/// What is too long loses its end.
fn cut(text: &str) -> String {
    match text.chars().count() > WIDEST {
        true => text.chars().take(WIDEST - 1).chain(['…']).collect(),
        false => text.to_owned(),
    }
}

fn channel(channel: &Channel) -> [String; 7] {
    [
        channel.name.clone(),
        cut(&channel.value.name),
        side(channel.sender.as_ref()),
        side(channel.receiver.as_ref()),
        channel.sent.to_string(),
        rate(channel.per_second),
        channel.state.word().to_owned(),
    ]
}

/// A row for the blackboard, and one for each key.
fn board(board: &Board) -> Vec<[String; 8]> {
    let none = String::new;
    let readers = match (board.readers.is_empty(), board.has_readers) {
        (true, true) => "?".to_owned(),
        (true, false) => "-".to_owned(),
        (false, _) => {
            let readers: Vec<String> = board.readers.iter().map(|one| side(Some(one))).collect();
            readers.join(", ")
        }
    };
    let head = [
        board.name.clone(),
        none(),
        side(board.writer.as_ref()),
        readers,
        none(),
        none(),
        none(),
        none(),
    ];
    let keys = board.keys.iter().map(|key| {
        [
            format!("  {}", key.key),
            cut(&key.value_type.name),
            none(),
            none(),
            key.number.to_string(),
            rate(key.per_second),
            format!("{:.3} s", key.age_s),
            cut(key.text.as_deref().unwrap_or("-")),
        ]
    });
    std::iter::once(head).chain(keys).collect()
}
