//! A preprocessor of mdBook: links to files of the repository become links of the book.
//!
//! A page of the book stands in `book/src`, a page of the reference in `docs`, which the book shows
//! as `reference`. Their links lead to files as they lie in the repository. Of these, pages and
//! pictures of both folders are in the book. All others become addresses of the public repository.

use serde_json::Value;
use std::io;
use std::process::ExitCode;

/// Where the repository is to be read.
const REPOSITORY: &str = concat!(env!("CARGO_PKG_REPOSITORY"), "/blob/main/");

fn main() -> ExitCode {
    // mdBook asks first whether a renderer is supported: every one is.
    if std::env::args().nth(1).as_deref() == Some("supports") {
        return ExitCode::SUCCESS;
    }
    let read: Result<(Value, Value), _> = serde_json::from_reader(io::stdin());
    let written = read.and_then(|(_, mut book)| {
        each_chapter(&mut book, &mut rewrite);
        serde_json::to_writer(io::stdout(), &book)
    });
    match written {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("this is no book as mdBook passes it on: {error}");
            ExitCode::FAILURE
        }
    }
}

/// Calls `change` with each chapter's source path and text.
fn each_chapter(value: &mut Value, change: &mut dyn FnMut(&str, &mut String)) {
    match value {
        Value::Array(items) => items
            .iter_mut()
            .for_each(|item| each_chapter(item, &mut *change)),
        Value::Object(fields) => {
            let path = fields.get("source_path").and_then(Value::as_str);
            if let (Some(path), Some(Value::String(text))) =
                (path.map(str::to_owned), fields.get_mut("content"))
            {
                change(&path, text);
            }
            fields
                .values_mut()
                .for_each(|field| each_chapter(field, &mut *change));
        }
        _ => {}
    }
}

/// Turns the links of a chapter, outside of its programs.
fn rewrite(chapter: &str, text: &mut String) {
    let mut is_program = false;
    let mut lines = Vec::new();
    for line in text.lines() {
        if line.trim_start().starts_with("```") {
            is_program = !is_program;
        }
        lines.push(if is_program {
            line.to_owned()
        } else {
            rewrite_line(chapter, line)
        });
    }
    *text = lines.join("\n") + "\n";
}

fn rewrite_line(chapter: &str, line: &str) -> String {
    let mut parts = line.split("](");
    let mut rewritten = parts.next().unwrap_or_default().to_owned();
    for part in parts {
        rewritten.push_str("](");
        match part.split_once(')') {
            Some((target, rest)) => {
                rewritten.push_str(&turn(chapter, target));
                rewritten.push(')');
                rewritten.push_str(rest);
            }
            None => rewritten.push_str(part),
        }
    }
    rewritten
}

/// What a link of `chapter` to `target` is in the book.
fn turn(chapter: &str, target: &str) -> String {
    if target.starts_with('#') || target.contains(':') {
        return target.to_owned();
    }
    let (path, fragment) = match target.split_once('#') {
        Some((path, fragment)) => (path, format!("#{fragment}")),
        None => (target, String::new()),
    };
    let source = match chapter.strip_prefix("reference/") {
        Some(page) => format!("docs/{page}"),
        None => format!("book/src/{chapter}"),
    };
    let file = join(&source, path);
    let page = match (file.strip_prefix("docs/"), file.strip_prefix("book/src/")) {
        (Some(page), _) => format!("reference/{page}"),
        (_, Some(page)) => page.to_owned(),
        _ => return format!("{REPOSITORY}{file}{fragment}"),
    };
    // A folder is not in the book.
    if !page
        .rsplit('/')
        .next()
        .is_some_and(|name| name.contains('.'))
    {
        return format!("{REPOSITORY}{file}{fragment}");
    }
    let up = "../".repeat(chapter.matches('/').count());
    format!("{up}{}{fragment}", page.replace("README.md", "index.md"))
}

/// The path that `relative` is, seen from the file `source`.
fn join(source: &str, relative: &str) -> String {
    let mut parts: Vec<_> = source.split('/').collect();
    parts.pop();
    for part in relative.split('/') {
        match part {
            "" | "." => {}
            ".." => {
                parts.pop();
            }
            name => parts.push(name),
        }
    }
    parts.join("/")
}

#[cfg(test)]
mod tests {
    use super::{REPOSITORY, rewrite};

    fn rewritten(chapter: &str, text: &str) -> String {
        let mut text = text.to_owned();
        rewrite(chapter, &mut text);
        text
    }

    #[test]
    fn links_between_chapters_and_reference_stay_in_the_book() {
        for (chapter, text, expected) in [
            ("a.md", "[x](b.md#c)", "[x](b.md#c)\n"),
            (
                "a.md",
                "[x](../../docs/time.md#d) [y](#e)",
                "[x](reference/time.md#d) [y](#e)\n",
            ),
            (
                "from/go.md",
                "[x](../../../docs/README.md)",
                "[x](../reference/index.md)\n",
            ),
            (
                "reference/time.md",
                "[x](loops.md)",
                "[x](../reference/loops.md)\n",
            ),
            (
                "reference/time.md",
                "[x](../book/src/a.md)",
                "[x](../a.md)\n",
            ),
            (
                "reference/decisions/1.md",
                "[x](../time.md)",
                "[x](../../reference/time.md)\n",
            ),
            (
                "reference/time.md",
                "![x](scope/a.png)",
                "![x](../reference/scope/a.png)\n",
            ),
            (
                "a.md",
                "[x](https://a.example/b.md)",
                "[x](https://a.example/b.md)\n",
            ),
        ] {
            assert_eq!(rewritten(chapter, text), expected);
        }
    }

    #[test]
    fn other_files_are_read_in_the_repository() {
        for (chapter, text, file) in [
            ("a.md", "[x](../../README.md)", "README.md"),
            (
                "reference/time.md",
                "[x](../examples/jiwy)",
                "examples/jiwy",
            ),
            (
                "reference/time.md",
                "[x](internals/decisions)",
                "docs/internals/decisions",
            ),
        ] {
            assert_eq!(
                rewritten(chapter, text),
                format!("[x]({REPOSITORY}{file})\n")
            );
        }
    }

    #[test]
    fn programs_are_left_as_they_are() {
        let text = "```c\na[0](../b)\n```\n";
        assert_eq!(rewritten("a.md", text), text);
    }
}
