//! The book as mdBook builds it. Where mdBook is missing, the test says so.

use crate::{files, repository};
use std::collections::HashSet;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

/// The values of an attribute.
fn values<'a>(page: &'a str, attribute: &str) -> Vec<&'a str> {
    let mark = format!(" {attribute}=\"");
    let values = page.split(mark.as_str()).skip(1);
    values
        .filter_map(|rest| rest.split_once('"'))
        .map(|(value, _)| value)
        .collect()
}

fn without_dots(path: &Path) -> PathBuf {
    let mut kept = PathBuf::new();
    for part in path {
        if part == ".." {
            kept.pop();
        } else if part != "." {
            kept.push(part);
        }
    }
    kept
}

#[test]
fn the_built_book_has_no_broken_link() {
    if Command::new("mdbook").arg("--version").output().is_err() {
        println!("skipped: the built book: mdbook is missing (cargo install mdbook)");
        return;
    }
    let place = Path::new(env!("CARGO_TARGET_TMPDIR")).join("html");
    let built = Command::new("mdbook")
        .args(["build", "book", "--dest-dir"])
        .arg(&place)
        .current_dir(repository())
        .output()
        .unwrap();
    let errors = String::from_utf8_lossy(&built.stderr);
    assert!(
        built.status.success() && !errors.contains("ERROR"),
        "{errors}"
    );
    let pages = files(&place, "html");
    assert!(pages.len() > 60, "{} pages", pages.len());
    let ids: HashSet<_> = pages
        .iter()
        .flat_map(|page| {
            let text = fs::read_to_string(page).unwrap();
            let ids = values(&text, "id").into_iter();
            ids.map(|id| (page.clone(), id.to_owned()))
                .collect::<Vec<_>>()
        })
        .collect();
    let mut broken = Vec::new();
    for page in &pages {
        // One page of all chapters, and a page that any address may lead to.
        if ["print.html", "404.html", "toc.html"]
            .iter()
            .any(|name| page.ends_with(name))
        {
            continue;
        }
        let text = fs::read_to_string(page).unwrap();
        let targets = values(&text, "href")
            .into_iter()
            .chain(values(&text, "src"));
        for target in targets.filter(|target| !target.contains(':')) {
            let (file, fragment) = target.split_once('#').unwrap_or((target, ""));
            let path = match file {
                "" => page.clone(),
                file => without_dots(&page.parent().unwrap().join(file)),
            };
            let has_target = path.is_dir()
                || path.is_file()
                    && (fragment.is_empty() || ids.contains(&(path.clone(), fragment.to_owned())));
            if !has_target {
                broken.push(format!("{}: {target}", page.display()));
            }
        }
    }
    assert!(broken.is_empty(), "{}", broken.join("\n"));
    let index = fs::read_dir(&place).unwrap();
    let mut names = index.map(|entry| entry.unwrap().file_name().to_string_lossy().into_owned());
    assert!(
        names.any(|name| name.starts_with("searchindex")),
        "it can be searched"
    );
}
