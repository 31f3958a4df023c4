//! The chapters as they are written: every program is a tested one, and every link leads somewhere.

use crate::{files, repository};
use std::collections::HashSet;
use std::fs;
use std::path::{Path, PathBuf};

/// The chapters, but not the summary.
fn chapters() -> Vec<PathBuf> {
    let mut chapters = files(&repository().join("book/src"), "md");
    chapters.retain(|chapter| !chapter.ends_with("SUMMARY.md"));
    assert!(chapters.len() >= 3);
    chapters
}

/// What stands in the line before a program that a page shows: `<!-- shown: FILE:PART -->`.
fn source_of(line: &str) -> Option<&str> {
    let line = line.trim_start().strip_prefix("<!-- shown: ")?;
    line.strip_suffix(" -->")
}

/// The lines of a program between two marks, or those of an output by their numbers.
fn part(program: &str, name: &str) -> Result<Vec<String>, String> {
    let mut lines: Vec<_> = program.lines().map(str::to_owned).collect();
    if let Some((first, last)) = name.split_once(':') {
        let range = first.parse::<usize>().ok().zip(last.parse::<usize>().ok());
        let (first, last) = range.ok_or("no two numbers of lines")?;
        lines.truncate(last);
        lines.drain(..first - 1);
    } else if !name.is_empty() {
        let at = |mark: String| {
            let found = lines.iter().position(|line| line.ends_with(&mark));
            found.ok_or(format!("has no {mark}"))
        };
        let (start, end) = (
            at(format!("ANCHOR: {name}"))?,
            at(format!("ANCHOR_END: {name}"))?,
        );
        lines = lines[start + 1..end].to_vec();
    }
    lines.retain(|line| !line.contains("ANCHOR"));
    Ok(lines)
}

/// Where programs of other tests and of CI stand.
const TESTED: [&str; 4] = [
    "book/programs/src/bin/",
    "examples/",
    "devices/ipc/examples/",
    "devices/ros2/examples/",
];

/// A page with its programs as they are now, and the files that they are from.
fn with_programs(page: &Path, text: &str) -> (String, Vec<PathBuf>) {
    let (mut written, mut shown) = (Vec::new(), Vec::new());
    let mut lines = text.lines();
    let mut source = None;
    while let Some(line) = lines.next() {
        written.push(line.to_owned());
        let Some(language) = line.trim_start().strip_prefix("```") else {
            source = source_of(line);
            continue;
        };
        let block: Vec<_> = lines
            .by_ref()
            .take_while(|line| line.trim() != "```")
            .collect();
        match source.take() {
            Some(source) => {
                let (file, name) = source.split_once(':').unwrap_or((source, ""));
                let path = page.parent().unwrap().join(file);
                let fails = |error: &dyn std::fmt::Display| -> ! {
                    panic!("{}: {source}: {error}", page.display())
                };
                let path = path.canonicalize().unwrap_or_else(|error| fails(&error));
                let program = fs::read_to_string(&path).unwrap();
                written.extend(part(&program, name).unwrap_or_else(|error| fails(&error)));
                shown.push(path);
            }
            None => {
                let is_rust = language == "rust";
                assert!(!is_rust, "{}: of no program: {block:?}", page.display());
                written.extend(block.into_iter().map(str::to_owned));
            }
        }
        written.push("```".to_owned());
    }
    (written.join("\n") + "\n", shown)
}

#[test]
fn pages_show_tested_programs_as_they_are() {
    let root = repository().canonicalize().unwrap();
    let mut shown = HashSet::new();
    let readme = repository().join("README.md");
    for chapter in chapters().into_iter().chain([readme]) {
        let text = fs::read_to_string(&chapter).unwrap();
        let (expected, files) = with_programs(&chapter, &text);
        if std::env::var_os("LUNA_BOOK_WRITE").is_some() {
            fs::write(&chapter, &expected).unwrap();
        } else {
            assert!(
                text == expected,
                "{} shows a program as it was: LUNA_BOOK_WRITE=1 cargo test -p luna-book",
                chapter.display()
            );
        }
        let inside = files.iter().map(|path| path.strip_prefix(&root).unwrap());
        shown.extend(inside.map(Path::to_owned));
    }
    for path in &shown {
        let is_tested = TESTED.iter().any(|folder| path.starts_with(folder));
        let is_kept = ["book/programs/outputs", "book/programs/theirs"];
        assert!(
            is_tested || is_kept.iter().any(|folder| path.starts_with(folder)),
            "{} is under no test",
            path.display()
        );
    }
    // What no chapter shows is to be deleted.
    let root = repository();
    for (folder, extension) in [("src/bin", "rs"), ("outputs", "txt")] {
        for path in files(&root.join("book/programs").join(folder), extension) {
            let path = Path::new("book/programs")
                .join(folder)
                .join(path.file_name().unwrap());
            assert!(shown.contains(&path), "no chapter shows {}", path.display());
        }
    }
}

/// The targets of links and pictures outside of programs.
fn links(text: &str) -> Vec<&str> {
    let mut is_program = false;
    let mut found = Vec::new();
    for line in text.lines() {
        if line.trim_start().starts_with("```") {
            is_program = !is_program;
        } else if !is_program {
            let targets = line.split("](").skip(1);
            found.extend(
                targets
                    .filter_map(|rest| rest.split_once(')'))
                    .map(|(target, _)| target),
            );
        }
    }
    found
}

/// What a heading is called in an address.
fn slug(heading: &str) -> String {
    let kept = heading.chars().filter_map(|character| match character {
        ' ' => Some('-'),
        '-' | '_' => Some(character),
        _ => character
            .is_alphanumeric()
            .then(|| character.to_ascii_lowercase()),
    });
    kept.collect()
}

fn has_heading(page: &Path, fragment: &str) -> bool {
    let text = fs::read_to_string(page).unwrap();
    let headings = text.lines().filter(|line| line.starts_with('#'));
    let mut slugs = headings.map(|line| slug(line.trim_start_matches('#').trim()));
    slugs.any(|slug| slug == fragment)
}

#[test]
fn links_of_all_pages_lead_somewhere() {
    let root = repository();
    let mut pages = chapters();
    pages.extend(files(&root.join("docs"), "md"));
    pages.extend(
        [
            "README.md",
            "examples/README.md",
            "CONTRIBUTING.md",
            "SECURITY.md",
            "ARCHITECTURE.md",
            "book/README.md",
            "book/src/SUMMARY.md",
        ]
        .map(|page| root.join(page)),
    );
    let mut checked = 0;
    for page in pages {
        let text = fs::read_to_string(&page).unwrap();
        for link in links(&text) {
            if link.contains(':') {
                continue;
            }
            let (file, fragment) = link.split_once('#').unwrap_or((link, ""));
            let target = match file {
                "" => page.clone(),
                file => page.parent().unwrap().join(file),
            };
            assert!(target.exists(), "{}: {link}", page.display());
            let is_page = target
                .extension()
                .is_some_and(|extension| extension == "md");
            if is_page && !fragment.is_empty() {
                assert!(has_heading(&target, fragment), "{}: {link}", page.display());
            }
            checked += 1;
        }
    }
    assert!(checked > 300, "{checked} links");
}

#[test]
fn every_page_is_in_the_summary() {
    let root = repository();
    let summary = fs::read_to_string(root.join("book/src/SUMMARY.md")).unwrap();
    let listed: HashSet<_> = links(&summary).into_iter().collect();
    let source = root.join("book/src");
    for chapter in chapters() {
        let name = chapter.strip_prefix(&source).unwrap().to_str().unwrap();
        assert!(listed.contains(name), "{name}");
    }
    let docs = root.join("docs");
    let pages = files(&docs, "md").into_iter().filter_map(|page| {
        let name = Path::new("reference").join(page.strip_prefix(&docs).unwrap());
        let text = fs::read_to_string(&page).unwrap();
        let title = text.lines().next().unwrap().trim_start_matches("# ");
        let line = format!("- [{title}]({})", name.display());
        (!listed.contains(name.to_str().unwrap())).then_some(line)
    });
    let missing: Vec<_> = pages.collect();
    assert!(
        missing.is_empty(),
        "to be put into book/src/SUMMARY.md:\n{}",
        missing.join("\n")
    );
}
