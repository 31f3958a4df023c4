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

/// The blocks of a page: language and lines.
fn blocks(text: &str) -> Vec<(String, Vec<&str>)> {
    let mut blocks = Vec::new();
    let mut lines = text.lines();
    while let Some(line) = lines.next() {
        if let Some(language) = line.trim_start().strip_prefix("```") {
            let block = lines.by_ref().take_while(|line| line.trim() != "```");
            blocks.push((language.to_owned(), block.collect()));
        }
    }
    blocks
}

/// Where programs of other tests and of CI stand.
const TESTED: [&str; 4] = [
    "book/programs/src/bin/",
    "examples/",
    "devices/ipc/examples/",
    "devices/ros2/examples/",
];

#[test]
fn programs_are_included_from_tested_ones() {
    let mut shown = HashSet::new();
    for chapter in chapters() {
        let text = fs::read_to_string(&chapter).unwrap();
        for (language, lines) in blocks(&text) {
            let included: Vec<_> = lines
                .iter()
                .filter_map(|line| line.strip_prefix("{{#include "))
                .collect();
            for include in &included {
                let include = include.trim_end_matches("}}");
                let (file, anchor) = include.split_once(':').unwrap_or((include, ""));
                // Lines by number are for what is printed, where no mark can stand.
                let is_of_output = file.ends_with(".txt");
                let path = chapter.parent().unwrap().join(file);
                let path = path
                    .canonicalize()
                    .unwrap_or_else(|error| panic!("{}: {file}: {error}", chapter.display()));
                let program = fs::read_to_string(&path).unwrap();
                if !anchor.is_empty() && !is_of_output {
                    for mark in ["ANCHOR: ", "ANCHOR_END: "] {
                        assert!(
                            program
                                .lines()
                                .any(|line| line.ends_with(&format!("{mark}{anchor}"))),
                            "{}: {include} has no {mark}",
                            chapter.display()
                        );
                    }
                }
                let root = repository().canonicalize().unwrap();
                shown.insert(path.strip_prefix(root).unwrap().to_owned());
            }
            if language == "rust" {
                assert_eq!(
                    included.len(),
                    lines.len(),
                    "{}: {lines:?}",
                    chapter.display()
                );
            }
        }
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
